//! What the factorisation promises, by definition.

use super::*;
use crate::math::Vec3;
use rand::{RngExt, SeedableRng};

fn sparse(rows: &[Vec<f64>]) -> Vec<SparseRow> {
    let entries = |row: &Vec<f64>| row.iter().copied().enumerate().filter(|(_, x)| *x != 0.0).collect();
    rows.iter().map(entries).collect()
}

fn random_rows(count: usize, length: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    (0..count).map(|_| (0..length).map(|_| random.random_range(-1.0..1.0)).collect()).collect()
}

/// Projection, multipliers and free motions by their definitions, of these rows and mixtures of them.
fn obeys_its_optimality_conditions(bodies: usize, rows: &[Vec<f64>], length: usize, mixing: &[Vec<f64>]) {
    let mut rows = rows.to_vec();
    let independent = rows.len();
    for mix in mixing {
        rows.push((0..length).map(|k| mix.iter().zip(&rows).map(|(m, row)| m * row[k]).sum()).collect());
    }
    let z_of_rhs = random_rows(1, length, 5).remove(0);
    let b: Vec<f64> = rows.iter().map(|row| dot(row, &z_of_rhs)).collect();
    let start = random_rows(1, length, 6).remove(0);
    let own = Elimination::new(bodies, length, &sparse(&rows));
    let is_zero = |mix: &&Vec<f64>| mix.iter().all(|m| *m == 0.0);
    assert_eq!(own.relations.len(), mixing.len() - mixing.iter().filter(is_zero).count());
    let mut z = start.clone();
    own.project(&mut z, &b);
    for (row, b) in rows.iter().zip(&b) {
        assert!((dot(row, &z) - b).abs() < 1e-13 * length as f64);
    }
    let way: Vec<f64> = z.iter().zip(&start).map(|(z, start)| z - start).collect();
    let lambda = own.multipliers(&way);
    for k in 0..length {
        let sum: f64 = rows.iter().zip(&lambda).map(|(row, lambda)| row[k] * lambda).sum();
        let size = lambda.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
        assert!((sum - way[k]).abs() < 1e-13 * size, "{sum} {} {size}", way[k]);
    }
    let free = own.free_motions();
    assert_eq!(free.len(), length - independent);
    for (i, motion) in free.iter().enumerate() {
        assert!(rows.iter().all(|row| dot(row, motion).abs() < 1e-13));
        for (j, other) in free.iter().enumerate() {
            assert!((dot(motion, other) - f64::from(u8::from(i == j))).abs() < 1e-13);
        }
    }
    // The shortest multipliers are in the range of B: orthogonal to every relation among the rows.
    for (mix, place) in mixing.iter().zip(independent..) {
        let relation: f64 = mix.iter().zip(&lambda).map(|(m, l)| m * l).sum::<f64>() - lambda[place];
        let size = lambda.iter().fold(1.0_f64, |most, x| most.max(x.abs()));
        assert!(relation.abs() < 1e-12 * size, "{relation}");
    }
}

#[test]
fn projections_obey_their_optimality_conditions() {
    for (independent, repeated, length) in [(4, 0, 9), (5, 3, 9), (7, 0, 7), (1, 4, 3), (0, 2, 4)] {
        let rows = random_rows(independent, length, 3 + length as u64);
        let mixing = random_rows(repeated, independent, 11);
        obeys_its_optimality_conditions(length / 6, &rows, length, &mixing);
    }
}

/// Rows over pairs of bodies (none: over one alone), so many of each, those of every third with a
/// coordinate of their own; bodies from 1e-3 to 1e3 times as light.
fn rows_of_joints(joints: &[(usize, Option<usize>, usize)], bodies: usize) -> (Vec<Vec<f64>>, usize) {
    let springs = joints.len().div_ceil(3);
    let mut rows = Vec::new();
    for (joint, &(first, second, count)) in joints.iter().enumerate() {
        for dense in random_rows(count, 13, joint as u64) {
            let mut row = vec![0.0; 6 * bodies + springs];
            for (end, body) in [Some(first), second].into_iter().enumerate() {
                let Some(body) = body else { continue };
                let light = 10_f64.powi(body as i32 % 7 - 3);
                let own = dense[6 * end..6 * end + 6].iter().map(|x| light * x);
                row[6 * body..6 * body + 6].iter_mut().zip(own).for_each(|(row, x)| *row = x);
            }
            if joint % 3 == 0 {
                row[6 * bodies + joint / 3] = dense[12];
            }
            let norm = dot(&row, &row).sqrt();
            rows.push(row.into_iter().map(|x| x / norm).collect());
        }
    }
    (rows, 6 * bodies + springs)
}

/// The same of rows that touch few bodies each: chains, trees, rings, stars, a lattice, parts that hang
/// together by nothing; with joints that repeat what others do, and bodies that none holds.
#[test]
fn fronts_eliminate_what_the_whole_matrix_does() {
    let chain = |n: usize, rows: usize| (1..n).map(move |k| (k - 1, Some(k), rows)).collect::<Vec<_>>();
    let tree = (1..13).map(|k| ((k - 1) / 3, Some(k), 4)).collect();
    let star = (1..9).map(|k| (0, Some(k), 5)).collect();
    let mut ring = chain(9, 3);
    ring.extend([(8, Some(0), 3), (4, None, 2)]);
    let lattice = |k: usize| [(k, k + 1, k % 4 < 3), (k, k + 4, k < 12)];
    let lattice = (0..16).flat_map(lattice).filter(|(.., is)| *is).map(|(a, b, _)| (a, Some(b), 2)).collect();
    for joints in
        [chain(30, 5), tree, star, ring, lattice, vec![(2, Some(3), 4), (0, None, 6), (5, Some(7), 5)]]
    {
        let (rows, length) = rows_of_joints(&joints, 31);
        for repeated in [0, 4] {
            // Each repeats rows of one joint, as a second joint there does.
            let mix = |k: usize| {
                (0..rows.len())
                    .map(move |row| f64::from(u8::from(row == 2 * k)) - f64::from(u8::from(row == 2 * k + 1)))
            };
            let mixing: Vec<Vec<f64>> = (0..repeated).map(|k| mix(k).collect()).collect();
            obeys_its_optimality_conditions(31, &rows, length, &mixing);
        }
    }
}

/// Twenty copies of one rod leave no rounding to be taken for coordinates: nor do the joints of a hub.
#[test]
fn what_repeats_and_what_a_hub_holds_leave_no_noise() {
    let joints: Vec<_> = (1..100).map(|k| (0, Some(k), 3)).collect();
    let (mut rows, length) = rows_of_joints(&joints, 100);
    let copies: Vec<_> = (0..20).map(|_| rows[30].clone()).collect();
    rows.extend(copies);
    let own = Elimination::new(100, length, &sparse(&rows));
    assert!(own.fronts.iter().all(|front| front.slots.len() <= 12 + 3));
    assert_eq!(own.relations.len(), 20);
    assert!(own.multipliers(&rows[40]).iter().all(|x| x.is_finite()));
}

/// Unit rows of n x n plates that hinges on their edges hold together, and those of the first row to the
/// world, with everything displaced by up to this: of every loop rows repeat others but for that.
fn rows_of_plates(n: usize, off: f64) -> Vec<Vec<f64>> {
    let mut random = random_rows(1, 9 * n * n, 8).remove(0).into_iter().cycle();
    let mut shifted =
        |v: [f64; 3]| Vec3::from(v) + off * Vec3::from_array([0; 3].map(|_| random.next().unwrap()));
    let number = |i: usize, j: usize| i * n + j;
    let places: Vec<Vec3> = (0..n * n).map(|k| shifted([(k / n) as f64, (k % n) as f64, 0.0])).collect();
    let mut hinges = Vec::new();
    for (i, j) in (0..n * n).map(|k| (k / n, k % n)) {
        let [x, y] = [i, j].map(|k| k as f64);
        let mut hinge = |pair: [Option<usize>; 2], point: [f64; 3], axis: [f64; 3]| {
            let across = [Vec3::from([axis[1], axis[0], 0.0]), Vec3::Z];
            let axis = shifted(axis).normalize();
            hinges.push((pair, Vec3::from(point), across.map(|t| t.reject_from_normalized(axis))));
        };
        let own = Some(number(i, j));
        if i + 1 < n {
            hinge([own, Some(number(i + 1, j))], [x + 0.5, y, 0.0], [0.0, 1.0, 0.0]);
        }
        if j + 1 < n {
            hinge([own, Some(number(i, j + 1))], [x, y + 0.5, 0.0], [1.0, 0.0, 0.0]);
        }
        if j == 0 {
            hinge([own, None], [x, y - 0.5, 0.0], [1.0, 0.0, 0.0]);
        }
    }
    let mut rows = Vec::new();
    for (pair, point, across) in hinges {
        let translations = [Vec3::X, Vec3::Y, Vec3::Z].map(|e| (e, None));
        let turns = across.map(|t| (Vec3::ZERO, Some(t)));
        for (linear, angular) in translations.into_iter().chain(turns) {
            let mut row = vec![0.0; 6 * n * n];
            for (body, sign) in pair.into_iter().zip([1.0, -1.0]) {
                let Some(body) = body else { continue };
                let angular = angular.unwrap_or_else(|| (point - places[body]).cross(linear));
                let parts = [linear, 2.0 * angular].map(|part| (sign * part).to_array());
                row[6 * body..6 * body + 6].copy_from_slice(parts.as_flattened());
            }
            let norm = dot(&row, &row).sqrt();
            rows.push(row.into_iter().map(|x| x / norm).collect());
        }
    }
    rows
}

/// What is asked for and possible is reached, whether rows that repeat others are misaligned at the
/// start, at the end, or not at all.
#[test]
fn misaligned_rows_that_repeat_others_do_no_harm() {
    for (n, off) in [2, 3, 4].into_iter().flat_map(|n| [0.0, 1e-13, 1e-10, 1e-8, 1e-6].map(|off| (n, off))) {
        let length = 6 * n * n;
        let [plain, others] = [0.0, off].map(|off| rows_of_plates(n, off));
        let way: Vec<f64> = random_rows(1, length, 99).remove(0);
        let seen =
            |rows: &[Vec<f64>], z: &[f64]| -> Vec<f64> { rows.iter().map(|row| dot(row, z)).collect() };
        let missed = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let own = Elimination::new(n * n, length, &sparse(&plain));
        let wanted = seen(&plain, &way);
        let mut z = vec![0.0; length];
        own.project(&mut z, &own.changes(sparse(&others), &wanted));
        let left = missed(&seen(&others, &z), &wanted);
        assert!(left < 1e-6 + 1e2 * off, "{n} {off}: {left}");
        let other = Elimination::new(n * n, length, &sparse(&others));
        let wanted = seen(&others, &way);
        let mut z = vec![0.0; length];
        other.project(&mut z, &wanted);
        let left = missed(&seen(&others, &z), &wanted);
        assert!(left < 1e-7, "{n} {off}: {left}");
    }
}

/// A body on two balls a micrometre apart, that turns about both: badly conditioned rows, which turn
/// alike.
#[test]
fn rows_that_are_next_to_each_other_are_seen_as_they_turn() {
    let rows = |angle: f64| -> Vec<Vec<f64>> {
        let turn = crate::math::Quat::from_rotation_y(angle);
        let points = [0.0, 1e-6].map(|y| turn * Vec3::new(-0.5, y, 0.0));
        let row = |(point, e): (Vec3, Vec3)| {
            let parts = [e, point.cross(e)].map(|part| part.to_array());
            parts.as_flattened().iter().map(|x| x / 1.25_f64.sqrt()).collect()
        };
        points.into_iter().flat_map(|point| [Vec3::X, Vec3::Y, Vec3::Z].map(|e| row((point, e)))).collect()
    };
    let own = Elimination::new(1, 6, &sparse(&rows(0.0)));
    assert_eq!(own.relations.len(), 1);
    let (others, way) = (rows(0.1), random_rows(1, 6, 4).remove(0));
    let wanted: Vec<f64> = others.iter().map(|row| dot(row, &way)).collect();
    let mut z = vec![0.0; 6];
    own.project(&mut z, &own.changes(sparse(&others), &wanted));
    for (row, wanted) in others.iter().zip(&wanted) {
        assert!((dot(row, &z) - wanted).abs() < 1e-9, "{} {wanted}", dot(row, &z));
    }
}

/// A chain costs what its links do: no front is larger than those of two bodies.
#[test]
fn the_fronts_of_a_chain_are_small() {
    let joints: Vec<_> = (1..200).map(|k| (k - 1, Some(k), 3)).collect();
    let (rows, length) = rows_of_joints(&joints, 200);
    let own = Elimination::new(200, length, &sparse(&rows));
    assert_eq!(own.fronts.len(), 199);
    assert!(own.fronts.iter().all(|front| front.slots.len() <= 12 + 3 && front.names.len() <= 9));
}

/// What other rows see of the changes is what was asked for, with and without rows that repeat others.
#[test]
fn other_rows_see_the_changes_that_they_ask_for() {
    for repeated in [0, 2] {
        let mixing = random_rows(repeated, 4, 11);
        let with_repeated = |mut rows: Vec<Vec<f64>>| {
            for mix in &mixing {
                let sum = |k: usize| mix.iter().zip(&rows).map(|(m, row)| m * row[k]).sum();
                rows.push((0..9).map(sum).collect());
            }
            rows
        };
        let [own, others] = [3, 7].map(|seed| with_repeated(random_rows(4, 9, seed)));
        let way = random_rows(1, 9, 5).remove(0);
        let wanted: Vec<f64> = others.iter().map(|row| dot(row, &way)).collect();
        let elimination = Elimination::new(1, 9, &sparse(&own));
        let changes = elimination.changes(sparse(&others), &wanted);
        let mut z = vec![0.0; 9];
        elimination.project(&mut z, &changes);
        for (row, wanted) in others.iter().zip(&wanted) {
            assert!((dot(row, &z) - wanted).abs() < 1e-12);
        }
    }
}
