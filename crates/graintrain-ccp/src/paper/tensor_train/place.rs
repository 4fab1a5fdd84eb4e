//! Where contacts and bodies lie in space, for the orders that tensor trains need.

use crate::delassus::{Delassus, FIXED, RigidDelassus};
use crate::problem::Ccp;
use std::collections::VecDeque;

/// One point per contact, m. Taken from the problem where it has them; else reconstructed from the arms; for
/// a bare matrix, which has no space, a contact's place in a breadth-first walk of the matrix graph along one
/// axis.
pub fn contact_points(problem: &Ccp) -> Vec<[f64; 3]> {
    if !problem.points.is_empty() {
        return problem.points.clone();
    }
    match &*problem.delassus {
        Delassus::Rigid(rigid) => {
            let centres = reconstructed_centres(rigid);
            rigid
                .contacts()
                .iter()
                .map(|contact| {
                    let (body, arm) = match (contact.body_a, contact.body_b) {
                        (FIXED, FIXED) => return [0.0; 3],
                        (FIXED, b) => (b, contact.arm_b),
                        (a, _) => (a, contact.arm_a),
                    };
                    let centre = centres[body as usize];
                    std::array::from_fn(|k| centre[k] + arm[k])
                })
                .collect()
        }
        Delassus::Sparse(matrix) => {
            let mut point = vec![[0.0; 3]; matrix.num_rows()];
            breadth_first(
                matrix.num_rows(),
                |i, visit| {
                    for &j in matrix.row(i).0 {
                        visit(j as usize);
                    }
                },
                |order, i, _| point[i] = [order as f64, 0.0, 0.0],
            );
            point
        }
    }
}

/// The centre of every body, m: contact point minus arm; bodies without contacts lie at the origin.
pub fn body_centres(problem: &Ccp, rigid: &RigidDelassus) -> Vec<[f64; 3]> {
    if problem.points.is_empty() {
        return reconstructed_centres(rigid);
    }
    (0..rigid.num_bodies())
        .map(|body| {
            rigid.sides(body).first().map_or([0.0; 3], |side| {
                let point = problem.points[side.contact as usize];
                std::array::from_fn(|k| point[k] - side.arm[k])
            })
        })
        .collect()
}

/// Centres from arms alone: x_B = x_A + r_A - r_B across every contact, up to one shift per connected
/// component.
fn reconstructed_centres(rigid: &RigidDelassus) -> Vec<[f64; 3]> {
    let mut centre = vec![[0.0; 3]; rigid.num_bodies()];
    let other_body = |body: usize, contact: u32| {
        let contact = &rigid.contacts()[contact as usize];
        if contact.body_a as usize == body { contact.body_b } else { contact.body_a }
    };
    breadth_first(
        rigid.num_bodies(),
        |body, visit| {
            for side in rigid.sides(body) {
                let other = other_body(body, side.contact);
                if other != FIXED {
                    visit(other as usize);
                }
            }
        },
        |_, body, parent| {
            let Some(parent) = parent else { return };
            for side in rigid.sides(parent) {
                if other_body(parent, side.contact) as usize == body {
                    let contact = &rigid.contacts()[side.contact as usize];
                    let (mine, theirs) = if contact.body_a as usize == parent {
                        (contact.arm_a, contact.arm_b)
                    } else {
                        (contact.arm_b, contact.arm_a)
                    };
                    centre[body] = std::array::from_fn(|k| centre[parent][k] + mine[k] - theirs[k]);
                    break;
                }
            }
        },
    );
    centre
}

/// Visits every vertex of a graph: `reached(order, vertex, parent)`, roots in ascending order.
fn breadth_first(
    vertices: usize,
    neighbours: impl Fn(usize, &mut dyn FnMut(usize)),
    mut reached: impl FnMut(usize, usize, Option<usize>),
) {
    let mut known = vec![false; vertices];
    let mut queue = VecDeque::new();
    let mut order = 0;
    for root in 0..vertices {
        if known[root] {
            continue;
        }
        known[root] = true;
        queue.push_back((root, None));
        while let Some((vertex, parent)) = queue.pop_front() {
            reached(order, vertex, parent);
            order += 1;
            neighbours(vertex, &mut |next| {
                if !known[next] {
                    known[next] = true;
                    queue.push_back((next, Some(vertex)));
                }
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delassus::{BodyInverseMass, RigidContact};

    /// A row of unit spheres along (1, 2, 2) / 3, touching, the first against a wall.
    fn chain(with_points: bool) -> (Ccp, Vec<[f64; 3]>) {
        let axis = [1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0];
        let t1 = [2.0 / 3.0, 1.0 / 3.0, -2.0 / 3.0];
        let t2 = [-2.0 / 3.0, 2.0 / 3.0, -1.0 / 3.0];
        let centres: Vec<[f64; 3]> = (0..5).map(|b| axis.map(|a| 2.0 * f64::from(b) * a)).collect();
        let contact = |body_a, body_b| RigidContact {
            body_a,
            body_b,
            frame: [axis, t1, t2],
            arm_a: axis.map(|a| -a),
            arm_b: axis,
        };
        let contacts = vec![contact(0, FIXED), contact(1, 0), contact(2, 1), contact(3, 2), contact(4, 3)];
        let mass = BodyInverseMass { linear: [1.0; 3], angular: [1., 0., 0., 0., 1., 0., 0., 0., 1.] };
        let rigid = RigidDelassus::new(contacts, vec![mass; 5]);
        let mut problem = Ccp::new(Delassus::Rigid(rigid), vec![0.0; 15], vec![0.5; 5]).unwrap();
        if with_points {
            problem.points = (0..5).map(|b| axis.map(|a| (2.0 * f64::from(b) - 1.0) * a)).collect();
        }
        (problem, centres)
    }

    #[test]
    fn centres_follow_from_points_and_arms_or_from_arms_alone() {
        for with_points in [true, false] {
            let (problem, centres) = chain(with_points);
            let Delassus::Rigid(rigid) = &*problem.delassus else { unreachable!() };
            let found = body_centres(&problem, rigid);
            let points = contact_points(&problem);
            for body in 0..5 {
                for k in 0..3 {
                    assert!((found[body][k] - centres[body][k]).abs() < 1e-14);
                    let expected = centres[body][k] - centres[1][k] / 2.0;
                    assert!((points[body][k] - expected).abs() < 1e-14);
                }
            }
        }
    }

    #[test]
    fn a_bare_matrix_gets_the_order_of_a_walk_of_its_graph() {
        let (problem, _) = chain(false);
        let bare = Ccp::new(Delassus::Sparse(problem.delassus.assemble()), vec![0.0; 15], vec![0.5; 5]);
        let points = contact_points(&bare.unwrap());
        assert_eq!(points.iter().map(|p| p[0]).collect::<Vec<_>>(), [0.0, 1.0, 2.0, 3.0, 4.0]);
    }
}
