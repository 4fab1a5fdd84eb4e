//! Whether a solve has anything to do: where nothing has moved, the impulses of the last step solve this one,
//! too, and packing the problem would cost more than to find that out.

use crate::delassus::{FIXED, RigidDelassus};
use crate::problem::Ccp;
use crate::residual::{FrictionModel, Residual, ResidualScale};

/// Contacts looked at before all of them are.
pub(super) const SAMPLE: usize = 64;

/// The residual of a few contacts, evenly spread over the list, with the impulses that act on their bodies:
/// of a start that is not good enough it tells so at next to no cost. For problems over rigid bodies that no
/// joint couples, and whose contacts do not resist turning.
pub(super) fn sampled_residual(
    problem: &Ccp,
    rigid: &RigidDelassus,
    scale: &ResidualScale,
    g: &[f64],
    model: FrictionModel,
) -> Residual {
    let contacts = problem.num_contacts();
    // Zeros that nobody touches cost nothing.
    let (mut force, mut velocity) = (vec![0.0; 3 * contacts], vec![0.0; 6 * rigid.num_bodies()]);
    let mut u = vec![0.0; 3 * contacts];
    // A plate that touches all of them is looked at once.
    let mut known = vec![false; rigid.num_bodies()];
    let (mut sum, mut count, mut max) = (0.0, 0.0, 0.0_f64);
    for i in (0..contacts).step_by(contacts.div_ceil(SAMPLE).max(1)) {
        let contact = &rigid.contacts()[i];
        for body in [contact.body_a, contact.body_b].into_iter().filter(|&body| body != FIXED) {
            if std::mem::replace(&mut known[body as usize], true) {
                continue;
            }
            for side in rigid.sides(body as usize) {
                let k = side.contact as usize;
                let [n, t1, t2] = &rigid.contacts()[k].frame;
                for axis in 0..3 {
                    force[3 * k + axis] =
                        n[axis] * g[3 * k] + t1[axis] * g[3 * k + 1] + t2[axis] * g[3 * k + 2];
                }
            }
            let own = &mut velocity[6 * body as usize..6 * body as usize + 6];
            own.copy_from_slice(&rigid.body_velocity_change(&force, body as usize));
        }
        let change = rigid.contact_velocity(i, &velocity);
        for axis in 0..3 {
            u[3 * i + axis] = change[axis] + problem.r[3 * i + axis];
        }
        let error = scale.of_contact(problem, g, &u, model, i);
        if error.is_nan() {
            return Residual { max: f64::NAN, rms: f64::NAN };
        }
        (sum, count, max) = (sum + error * error, count + 1.0, max.max(error));
    }
    Residual { max, rms: (sum / f64::max(count, 1.0)).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delassus::Delassus;
    use crate::delassus::tests::random_rigid;

    /// Of fewer contacts than are sampled it is the residual.
    #[test]
    fn a_sample_of_all_contacts_is_the_residual() {
        let r = (0..3 * SAMPLE).map(|k| (1.3 * k as f64).cos()).collect();
        let rigid = random_rigid(20, SAMPLE, 7);
        let problem = Ccp::new(Delassus::Rigid(rigid.clone()), r, vec![0.4; SAMPLE]).unwrap();
        let mut g: Vec<f64> = (0..problem.r.len()).map(|k| (k as f64).sin()).collect();
        problem.project(&mut g);
        let scale = ResidualScale::new(&problem);
        let mut u = vec![0.0; g.len()];
        problem.velocity(&g, &mut u, &mut problem.delassus.work());
        for model in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
            let (found, expected) = (
                sampled_residual(&problem, &rigid, &scale, &g, model),
                scale.residual(&problem, &g, &u, model),
            );
            assert!((found.max / expected.max - 1.0).abs() < 1e-12, "{found:?} {expected:?}");
            assert!((found.rms / expected.rms - 1.0).abs() < 1e-12, "{found:?} {expected:?}");
        }
    }
}
