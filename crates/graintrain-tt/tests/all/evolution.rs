//! x' = A x against exponentials of full matrices by their eigenvectors.

use crate::dense::dense;
use graintrain_linalg::dense::{Matrix, symmetric_eigen};
use graintrain_tt::solve::{EvolutionSettings, Sites, evolve};
use graintrain_tt::{TtError, TtMatrix, TtVector, qtt};

/// f(H) v for a symmetric H.
fn function(h: &TtMatrix, v: &[f64], f: impl Fn(f64) -> f64) -> Vec<f64> {
    let (values, vectors) = symmetric_eigen(dense(h).view()).unwrap();
    let mut result = vec![0.0; v.len()];
    for (k, value) in values.iter().enumerate() {
        let column = vectors.column(k);
        let weight = f(*value) * column.iter().zip(v).map(|(q, x)| q * x).sum::<f64>();
        result.iter_mut().zip(column).for_each(|(r, q)| *r += weight * q);
    }
    result
}

fn distance(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt()
}

/// A chain of spins with neighbours coupled: sum J_k sz sz + g sx, couplings that differ.
fn chain(d: usize, g: f64) -> TtMatrix {
    let (sx, sz) = (vec![0.0, 1.0, 1.0, 0.0], vec![1.0, 0.0, 0.0, -1.0]);
    let eye = vec![1.0, 0.0, 0.0, 1.0];
    let mut total: Option<TtMatrix> = None;
    for k in 0..d {
        let mut field = vec![eye.clone(); d];
        field[k] = sx.iter().map(|x| g * x).collect();
        let mut terms = vec![field];
        if k + 1 < d {
            let mut pair = vec![eye.clone(); d];
            pair[k] = sz.iter().map(|x| (1.0 + 0.1 * k as f64) * x).collect();
            pair[k + 1].clone_from(&sz);
            terms.push(pair);
        }
        for term in terms {
            let term = TtMatrix::rank_one(&term, &vec![2; d], &vec![2; d]).unwrap();
            total = Some(total.map_or(term.clone(), |sum| sum.add(&term).unwrap()));
        }
    }
    total.unwrap().without_dependent_ranks()
}

#[test]
fn errors_stay_below_the_reported_sum() {
    let d = 6;
    let h = chain(d, 0.7);
    let size = dense(&h);
    let (values, _) = symmetric_eigen(size.view()).unwrap();
    // Shifted so that nothing grows.
    let decay = h.add(&TtMatrix::identity(&[2; 6]).unwrap().scale(-values[values.len() - 1])).unwrap();
    for (rank, sites, steps, tolerance, max_rank) in [
        (1, Sites::Two, 20, 1e-9, 200),
        (1, Sites::Two, 40, 1e-4, 200),
        (1, Sites::Two, 10, 1e-6, 3),
        (1, Sites::One, 20, 0.0, 200),
        (3, Sites::One, 20, 0.0, 200),
        (8, Sites::One, 20, 0.0, 200),
    ] {
        let x = TtVector::random(&[2; 6], rank, 3).unwrap();
        let x = x.scale(1.0 / x.norm());
        let settings = EvolutionSettings { sites, steps, tolerance, max_rank };
        let (y, report) = evolve(&decay, &x, 1.0, &settings).unwrap();
        let exact = function(&decay, &x.to_full().unwrap(), f64::exp);
        let truth = distance(&y.to_full().unwrap(), &exact);
        println!("{sites:?} rank {rank} cap {max_rank}: true {truth:e} of {:e}, {report:?}", report.error());
        assert!(truth <= report.error(), "{truth:e} {report:?}");
        assert!(report.error() < 300.0 * truth + 1e-10, "{truth:e} {report:?}");
        assert!(sites == Sites::Two || y.max_rank() <= rank.max(1));
        assert!(report.capped || report.truncation <= tolerance.max(1e-14), "{report:?}");
    }
}

#[test]
fn quantum_motion_keeps_the_norm() {
    // i H as a real matrix on one more digit: (re, im)' = [0 H; -H 0] (re, im).
    let d = 6;
    let h = chain(d, 1.3);
    let turn = TtMatrix::rank_one(&[vec![0.0, -1.0, 1.0, 0.0]], &[2], &[2]).unwrap();
    let motion = h.kronecker(&turn);
    let product = TtVector::unit(&[2; 7], &[0, 1, 0, 1, 0, 1, 0]).unwrap();
    let full_rank = TtVector::random(&[2; 7], 8, 5).unwrap();
    // The product has no neighbours of the last digit in its first steps: the projection says so. With all
    // ranks nothing is projected and nothing split.
    for x in [product, full_rank.scale(1.0 / full_rank.norm())] {
        let full = x.to_full().unwrap();
        let (real, imaginary) = full.split_at(64);
        let turned = |v: &[f64], w: &[f64], sign: f64| -> Vec<f64> {
            let (c, s) = (function(&h, v, |e| (2.0 * e).cos()), function(&h, w, |e| (2.0 * e).sin()));
            c.iter().zip(&s).map(|(c, s)| c + sign * s).collect()
        };
        let exact = [turned(real, imaginary, 1.0), turned(imaginary, real, -1.0)].concat();
        for steps in [20, 40] {
            let settings = EvolutionSettings { steps, tolerance: 1e-11, ..Default::default() };
            let (y, report) = evolve(&motion, &x, 2.0, &settings).unwrap();
            let truth = distance(&y.to_full().unwrap(), &exact);
            println!("{steps} from rank {}: {truth:e} of {:e}", x.max_rank(), report.error());
            assert!(truth <= report.error(), "{truth:e} {report:?}");
            assert!((y.norm() - 1.0).abs() < 1e-9 && (x.max_rank() == 1 || truth < 1e-9));
        }
    }
}

#[test]
fn matrices_that_are_not_symmetric_are_followed() {
    // Not symmetric: a shift with decay; exp(t (S - 1)) x has Poisson weights.
    let d = 6;
    let a = qtt::shift(d).unwrap().subtract(&TtMatrix::identity(&[2; 6]).unwrap()).unwrap();
    let x = TtVector::unit(&[2; 6], &[0; 6]).unwrap();
    let exact: Vec<f64> = (0..64)
        .scan((-3.0f64).exp(), |weight, k| {
            let now = *weight;
            *weight *= 3.0 / (k + 1) as f64;
            Some(now)
        })
        .collect();
    let settings = EvolutionSettings { steps: 60, tolerance: 1e-10, ..Default::default() };
    let (y, report) = evolve(&a, &x, 3.0, &settings).unwrap();
    let truth = distance(&y.to_full().unwrap(), &exact);
    println!("{truth:e} {report:?}");
    assert!(truth <= report.error() && truth < 1e-3, "{truth:e} {report:?}");
    assert_eq!(evolve(&a, &x, 3.0, &settings).unwrap().0, y);
}

#[test]
fn what_cannot_be_followed_is_an_error() {
    let (a, x) = (qtt::laplacian(10).unwrap(), TtVector::random(&[2; 10], 2, 1).unwrap());
    let one = EvolutionSettings { steps: 1, ..Default::default() };
    // Growth by e^4000.
    assert!(matches!(evolve(&a, &x, 1000.0, &one), Err(TtError::Setting { what: "time step", .. })));
    assert!(evolve(&a, &x, f64::NAN, &one).is_err());
    assert!(evolve(&a, &TtVector::random(&[2; 9], 2, 1).unwrap(), 1.0, &one).is_err());
    assert!(evolve(&a, &x, 1.0, &EvolutionSettings { steps: 0, ..one }).is_err());
    let infinite = TtVector::unit(&[2; 10], &[0; 10]).unwrap().scale(f64::INFINITY);
    assert!(evolve(&a, &infinite, 1.0, &one).is_err());
    // Nothing moves nothing; no time moves nothing; one core is its exponential.
    let zero = x.scale(0.0);
    assert_eq!(evolve(&a, &zero, 1.0, &one).unwrap().0.norm(), 0.0);
    assert!(evolve(&a, &x, 0.0, &one).unwrap().0.relative_distance(&x).unwrap() < 1e-12);
    let single = TtMatrix::rank_one(&[vec![0.0, 1.0, -1.0, 0.0]], &[2], &[2]).unwrap();
    let (y, _) = evolve(&single, &TtVector::rank_one(&[vec![1.0, 0.0]]).unwrap(), 1.0, &one).unwrap();
    assert!(
        (y.to_full().unwrap()[0] - 1f64.cos()).abs() < 1e-14
            && (y.to_full().unwrap()[1] - 1f64.sin()).abs() < 1e-14
    );
}

/// Diffusion far beyond what the backward parts of a sweep stand: refused, or within what is reported.
#[test]
fn stiff_steps_are_refused_or_their_error_is_seen() {
    let a = qtt::laplacian(8).unwrap().scale(-1.0);
    let x = TtVector::random(&[2; 8], 2, 1).unwrap();
    let x = x.scale(1.0 / x.norm());
    for time in [0.3, 3.0, 30.0, 300.0, 3000.0] {
        for steps in [1, 4, 16] {
            for sites in [Sites::One, Sites::Two] {
                let settings = EvolutionSettings { sites, steps, ..Default::default() };
                match evolve(&a, &x, time, &settings) {
                    Ok((y, report)) => {
                        let exact = function(&a, &x.to_full().unwrap(), |e| (time * e).exp());
                        let truth = distance(&y.to_full().unwrap(), &exact);
                        println!("{time} {steps} {sites:?}: {truth:e} {:e}", report.error());
                        assert!(
                            truth <= report.error() && report.error() <= 200.0 * truth + 1e-9,
                            "{time} {steps} {sites:?}: {truth:e} {report:?}"
                        );
                    }
                    Err(error) => {
                        assert!(matches!(error, TtError::Setting { what: "time step", .. }), "{error}")
                    }
                }
            }
        }
    }
}

#[test]
fn units_do_not_matter() {
    let h = chain(4, 0.7).scale(-1.0);
    let x = TtVector::random(&[2; 4], 2, 3).unwrap();
    let settings = EvolutionSettings::default();
    let (plain, first) = evolve(&h, &x, 0.5, &settings).unwrap();
    for scale in [1e-200, 1e150] {
        let (y, report) = evolve(&h.scale(scale), &x.scale(scale), 0.5 / scale, &settings).unwrap();
        assert!(y.scale(1.0 / scale).relative_distance(&plain).unwrap() < 1e-10, "{scale:e}");
        assert!(
            (report.error() / scale - first.error()).abs() <= 0.1 * first.error() + 1e-9,
            "{report:?} {first:?}"
        );
    }
    // No matrix: nothing moves.
    assert_eq!(evolve(&h.scale(0.0), &x, 1.0, &settings).unwrap().0, x);
}

/// The estimate against the truth over eight matrices: decaying, growing, turning, not symmetric, coupled
/// over all distances, from all ranks, few steps and many.
#[test]
fn the_estimate_is_never_below_the_error_and_half_are_near_it() {
    let d = 6;
    let modes = [2; 6];
    let eye = TtMatrix::identity(&modes).unwrap();
    let (sx, sz) = (vec![0.0, 1.0, 1.0, 0.0], vec![1.0, 0.0, 0.0, -1.0]);
    let mut long = eye.scale(-12.0);
    for k in 0..d {
        let mut field = vec![vec![1.0, 0.0, 0.0, 1.0]; d];
        field[k].clone_from(&sx);
        long = long.add(&TtMatrix::rank_one(&field, &modes, &modes).unwrap()).unwrap();
        for l in k + 1..d {
            let mut pair = vec![vec![1.0, 0.0, 0.0, 1.0]; d];
            pair[k] = sz.iter().map(|x| x / (l - k) as f64).collect();
            pair[l].clone_from(&sz);
            long = long.add(&TtMatrix::rank_one(&pair, &modes, &modes).unwrap()).unwrap();
        }
    }
    let line = qtt::laplacian(d).unwrap().scale(-1.0);
    let wind = qtt::shift(d).unwrap();
    let wind = line.add(&wind.subtract(&wind.transpose()).unwrap().scale(0.3)).unwrap();
    let cases = [
        ("line", line.clone(), 0.3),
        ("line", line, 3.0),
        ("long", long.scale(0.5), 0.05),
        ("long", long.scale(0.5), 3.0),
        ("growing", long.scale(-0.5), 0.1),
        ("wind", wind, 2.0),
        ("chain", chain(d, 0.7), 0.5),
        ("chain back", chain(d, 0.7), -0.5),
    ];
    let mut ratios = Vec::new();
    for (name, a, time) in cases {
        let a = a.without_dependent_ranks();
        for rank in [1, 2, 8] {
            let x = TtVector::random(&modes, rank, 5).unwrap();
            let x = x.scale(1.0 / x.norm());
            let exact = exponential_times(&dense(&a), time, &x.to_full().unwrap());
            for sites in [Sites::One, Sites::Two] {
                for (steps, tolerance) in [(1, 1e-8), (4, 1e-8), (5, 1e-8), (20, 1e-8), (20, 1e-4)] {
                    let settings = EvolutionSettings { sites, steps, tolerance, ..Default::default() };
                    let (y, report) = evolve(&a, &x, time, &settings).unwrap();
                    let truth = distance(&y.to_full().unwrap(), &exact);
                    let reported = report.error();
                    assert!(
                        truth <= reported,
                        "{name} {time} {rank} {sites:?} {steps}: {truth:e} {report:?}"
                    );
                    if truth > 1e-10 {
                        ratios.push(reported / truth);
                    }
                }
            }
        }
    }
    ratios.sort_by(f64::total_cmp);
    let (half, most) = (ratios[ratios.len() / 2], ratios[ratios.len() - 1]);
    println!("{} ratios: half of them below {half:.1}, all below {most:.1}", ratios.len());
    assert!(half < 8.0 && most < 1000.0, "{half} {most}");
}

/// exp(t A) v by its series, in steps of norm below 1.
fn exponential_times(a: &Matrix, time: f64, v: &[f64]) -> Vec<f64> {
    let n = v.len();
    let size = a.data().iter().map(|x| x * x).sum::<f64>().sqrt() * time.abs();
    let parts = size.ceil().max(1.0) as usize;
    let mut result = v.to_vec();
    for _ in 0..parts {
        let mut term = result.clone();
        for k in 1..=25 {
            let mut next = vec![0.0; n];
            for (j, x) in term.iter().enumerate() {
                let factor = x * time / (parts * k) as f64;
                next.iter_mut().zip(a.column(j)).for_each(|(y, a)| *y += factor * a);
            }
            result.iter_mut().zip(&next).for_each(|(x, y)| *x += y);
            term = next;
        }
    }
    result
}
