//! Passes over bodies against N itself.

use super::*;
use crate::delassus::tests::{random_rigid, uniform};
use crate::delassus::{CoupledBodies, RigidDelassus, TurningRows, cell_tests::random_cell};
use crate::problem::TurningFriction;

/// With mechanisms of 0 to 17 motions, compliant contacts, contacts that resist turning, by the bits of
/// `kind`.
fn problem(mut rigid: RigidDelassus, kind: usize) -> Ccp {
    let mut random = uniform(9);
    let (bodies, contacts) = (rigid.num_bodies() as u32, rigid.num_contacts());
    if kind & 1 != 0 {
        let of = |(first, degrees): (u32, usize)| {
            let own: Vec<u32> = (first..bodies).step_by(24).collect();
            let factor = (0..6 * own.len() * degrees).map(|_| random() - 0.5).collect();
            CoupledBodies { bodies: own, degrees, factor }
        };
        rigid = rigid.with_coupled((0..).zip([1, 7, 8, 9, 17, 0]).map(of).collect());
    }
    if kind & 2 != 0 {
        rigid = rigid.with_compliance((0..contacts).map(|i| f64::from((i % 3) as u32)).collect());
    }
    let turns = if kind & 4 != 0 { contacts as u32 } else { 0 };
    let turning = || (0..turns).filter(|contact| contact % 3 != 1);
    rigid = rigid.with_turning(turning().map(|contact| TurningRows { contact, length: 0.4 }).collect());
    let turning = turning().map(|contact| TurningFriction { contact, rolling: 0.2, spinning: 0.1 }).collect();
    let r = (0..3 * rigid.num_blocks()).map(|k| (1.3 * k as f64).sin()).collect();
    Ccp::with_turning(Delassus::Rigid(rigid), r, vec![0.3; contacts], turning).unwrap()
}

/// N' x + r' and the quadratic form of a pass, and the diagonal blocks, are those of N.
fn check(problem: &Ccp) {
    let residual = ResidualScale::new(problem);
    let scaled = ScaledProblem::new(problem, &residual);
    let (mut x, mut u) = (scaled.zeros(), scaled.zeros());
    let (mut image, mut work) = (scaled.zero_image(), scaled.work());
    let mut g: Vec<f64> = (0..problem.r.len()).map(|k| 0.2 + (0.7 * k as f64).sin()).collect();
    scaled.pack(&g, &mut x);
    scaled.unpack(&x, &mut g);
    let quadratic = scaled.image_of(&mut x, &mut image, &mut work);
    scaled.gradient(&image, &mut u, &mut work);
    let mut expected = vec![0.0; g.len()];
    problem.delassus.multiply(&g, &mut expected, &mut problem.delassus.work());
    let form: f64 = expected.iter().zip(&g).map(|(u, g)| u * g).sum::<f64>() / residual.size().powi(2);
    assert!((quadratic - form).abs() < 1e-9 * form, "{quadratic} {form}");
    let factors = block_scaling(problem, &residual);
    for (place, i) in ScaledProblem::places_of(&scaled.order) {
        let factor = |k: usize| factors[i][k.min(1)];
        let (own, block) = (scaled.diagonal_block(place), problem.delassus.diagonal_block(i));
        for k in 0..3 {
            let expected = factor(k) / residual.size() * (expected[3 * i + k] + problem.r[3 * i + k]);
            let found = u[place / LANES][k].0[place % LANES];
            assert!((found - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{i}: {found} {expected}");
        }
        for (k, (own, block)) in own.into_iter().zip(block).enumerate() {
            let block = factor(k / 3) * factor(k % 3) * block;
            assert!(problem.contacts_across() > 0 || (own - block).abs() < 1e-9, "{i}: {own} {block}");
        }
    }
}

#[test]
fn passes_over_bodies_do_what_n_does() {
    for (bodies, contacts) in [(7, 9), (60, 90), (900, 2300)] {
        for kind in 0..8 {
            check(&problem(random_rigid(bodies, contacts, 3), kind));
            check(&problem(random_cell(bodies, contacts, 3), kind));
        }
    }
}
