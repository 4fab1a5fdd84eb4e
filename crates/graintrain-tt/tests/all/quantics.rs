//! Functions on grids against their values, exact integrals and brute force over all points.

use graintrain_tt::cross::{CrossSettings, CrossStatus};
use graintrain_tt::qtt::DigitOrder;
use graintrain_tt::quantics::{Axis, Grid, GridFunction, Points};
use graintrain_tt::{Truncation, TtError, TtVector};
use std::f64::consts::{PI, TAU};

const ORDERS: [DigitOrder; 2] = [DigitOrder::Separated, DigitOrder::Morton];
const KINDS: [Points; 3] = [Points::Midpoints, Points::Ends, Points::Periodic];

fn grid(axes: &[(&str, f64, f64, usize)], order: DigitOrder, points: Points) -> Grid {
    let axes = axes.iter().map(|&(name, low, high, bits)| Axis::new(name, low, high, bits).unwrap());
    Grid::new(axes.collect(), order, points).unwrap()
}

#[test]
fn all_points_go_in_and_come_back() {
    for order in ORDERS {
        for kind in KINDS {
            let grid = grid(&[("x", -1.0, 2.0, 3), ("t", 0.0, 4.0, 2), ("y", 1.0, 2.0, 4)], order, kind);
            let axes = ["x", "t", "y"].map(|name| grid.coordinates(name).unwrap());
            let f = |x: f64, t: f64, y: f64| x * x + 3.0 * t - (x * y).sin();
            let mut full = Vec::new();
            let mut points = Vec::new();
            for &y in &axes[2] {
                for &t in &axes[1] {
                    for &x in &axes[0] {
                        full.push(f(x, t, y));
                        points.extend([x, t, y]);
                    }
                }
            }
            let (function, _) = GridFunction::from_full(&grid, &full, &Truncation::to(1e-14)).unwrap();
            let close = |found: &[f64], expected: &[f64]| {
                found.len() == expected.len()
                    && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12)
            };
            assert!(close(&function.to_full().unwrap(), &full), "{order:?} {kind:?}");
            assert!(close(&function.values(&points).unwrap(), &full));
            // The entry of the train at the digits of a point is the value there.
            let indices = grid.nearest(&points).unwrap();
            assert!(close(&grid.points(&indices).unwrap(), &points));
            assert!(close(&function.train().entries(&indices).unwrap(), &full));
            // Sums over all points by the weights of the rule.
            let weight = |axis: usize, j: usize| {
                let n = axes[axis].len();
                let h = axes[axis][1] - axes[axis][0];
                if kind == Points::Ends && (j == 0 || j + 1 == n) { 0.5 * h } else { h }
            };
            let mut over_x = vec![0.0; 4 * 16];
            let mut total = 0.0;
            for (entry, value) in full.iter().enumerate() {
                let (i, j, k) = (entry % 8, entry / 8 % 4, entry / 32);
                over_x[entry / 8] += weight(0, i) * value;
                total += weight(0, i) * weight(1, j) * weight(2, k) * value;
            }
            assert!(close(&function.integrate(&["x"]).unwrap().to_full().unwrap(), &over_x));
            assert!((function.integral().unwrap() - total).abs() < 1e-11);
            assert!((function.integrate(&["y", "x"]).unwrap().integral().unwrap() - total).abs() < 1e-11);
        }
    }
}

#[test]
fn integrals_are_the_exact_ones() {
    let settings = CrossSettings { tolerance: 1e-9, ..Default::default() };
    for order in ORDERS {
        for kind in [Points::Midpoints, Points::Ends] {
            // exp(-x) cos(y) z^2 + x y: over [0, 1] x [0, pi/2] x [-1, 1] it is (1 - 1/e) 2/3 + pi^2 / 8.
            let grid =
                grid(&[("x", 0.0, 1.0, 18), ("y", 0.0, PI / 2.0, 18), ("z", -1.0, 1.0, 18)], order, kind);
            let f = |p: &[f64]| (-p[0]).exp() * p[1].cos() * p[2] * p[2] + p[0] * p[1];
            let (function, report) = GridFunction::cross(&grid, f, &[], &settings).unwrap();
            assert_eq!(report.status, CrossStatus::Converged, "{order:?} {kind:?} {report:?}");
            let exact = (1.0 - (-1.0f64).exp()) * 2.0 / 3.0 + PI * PI / 8.0;
            assert!(
                (function.integral().unwrap() - exact).abs() < 2e-9,
                "{:e}",
                function.integral().unwrap() - exact
            );
            // Over z alone: a function of x and y.
            let plane = function.integrate(&["z"]).unwrap();
            let at = [0.3, 0.4];
            let value = 2.0 / 3.0 * (-0.3f64).exp() * 0.4f64.cos() + 2.0 * 0.3 * 0.4;
            assert!((plane.values(&at).unwrap()[0] - value).abs() < 1e-8);
            // At one y, between its points: a function of x and z.
            let section = function.restrict("y", 0.4).unwrap();
            let found = section.values(&[0.3, -0.7]).unwrap()[0];
            assert!((found - f(&[0.3, 0.4, -0.7])).abs() < 1e-8 && section.grid().axes().len() == 2);
        }
    }
}

#[test]
fn periodic_functions_are_integrated_to_every_order() {
    // The Bessel function: mean of exp(cos x) = I_0(1). 2^5 points suffice for 15 digits.
    let grid = grid(&[("x", 0.0, TAU, 5)], DigitOrder::Morton, Points::Periodic);
    let (f, _) = GridFunction::cross(
        &grid,
        |p| p[0].cos().exp(),
        &[],
        &CrossSettings { tolerance: 1e-14, ..Default::default() },
    )
    .unwrap();
    assert!((f.integral().unwrap() / TAU - 1.266_065_877_752_008_4).abs() < 1e-13);
    // Any number is a place, and the end meets the beginning.
    let found = f.values(&[0.0, TAU, -TAU, 2.5 * TAU, PI]).unwrap();
    assert!(
        (found[0] - 1f64.exp()).abs() < 1e-12
            && found[1] == found[0]
            && found[2] == found[0]
            && found[3] == found[4]
    );
    let h = TAU / 32.0;
    let last = f.values(&[TAU - 0.5 * h]).unwrap()[0];
    assert!((last - 0.5 * (1f64.exp() + h.cos().exp())).abs() < 1e-12);
}

#[test]
fn interpolation_errs_by_the_second_derivative() {
    for bits in [6, 9] {
        for kind in KINDS {
            let grid = grid(&[("x", 0.0, TAU, bits), ("y", 0.0, TAU, bits)], DigitOrder::Morton, kind);
            let settings = CrossSettings { tolerance: 1e-12, ..Default::default() };
            let f = |p: &[f64]| p[0].sin() * (p[1] + 0.3).cos();
            let (function, _) = GridFunction::cross(&grid, f, &[], &settings).unwrap();
            let points: Vec<f64> = (0..2000).map(|k| (k as f64 * 0.618_033_988_7).fract() * TAU).collect();
            let h = TAU / ((1 << bits) as f64 - 1.0);
            let bound = 2.0 * h * h / 8.0;
            // (The outer half cells of midpoints are extrapolated: 3/8 h^2 there.)
            let bound = if kind == Points::Midpoints { 3.0 * bound } else { bound };
            for (point, value) in points.chunks_exact(2).zip(function.values(&points).unwrap()) {
                assert!((value - f(point)).abs() <= bound + 1e-11, "{bits} {kind:?} {point:?}");
            }
        }
    }
}

#[test]
fn a_peak_that_is_pointed_at_is_found() {
    let grid = grid(&[("x", 0.0, 1.0, 20), ("y", 0.0, 1.0, 20)], DigitOrder::Morton, Points::Midpoints);
    let (a, b, width) = (0.314, 0.271, 1e-3);
    let f = |p: &[f64]| (-((p[0] - a).powi(2) + (p[1] - b).powi(2)) / (width * width)).exp();
    let settings = CrossSettings { tolerance: 1e-8, ..Default::default() };
    let (function, report) = GridFunction::cross(&grid, f, &[a, b], &settings).unwrap();
    let exact = PI * width * width;
    let found = function.integral().unwrap();
    assert!((found / exact - 1.0).abs() < 1e-6, "{found:e} {exact:e} {report:?}");
    assert!((function.values(&[a + width, b]).unwrap()[0] - (-1.0f64).exp()).abs() < 1e-6);
}

#[test]
fn axes_of_different_lengths_share_their_coarse_levels() {
    let grid = grid(&[("x", 0.0, 1.0, 2), ("y", 0.0, 1.0, 4)], DigitOrder::Morton, Points::Periodic);
    // y's two fine digits first, then x and y by turns.
    assert_eq!(grid.points(&[0, 0, 0, 1, 0, 0]).unwrap(), [0.0, 0.25]);
    assert_eq!(grid.points(&[1, 0, 0, 0, 1, 0]).unwrap(), [0.5, 0.0625]);
    assert_eq!(
        (grid.order(), grid.kind(), grid.axis("y").unwrap()),
        (DigitOrder::Morton, Points::Periodic, 1)
    );
    assert_eq!(
        (grid.axes()[1].name(), grid.axes()[1].interval(), grid.axes()[1].bits()),
        ("y", (0.0, 1.0), 4)
    );
}

#[test]
fn what_is_wrong_is_named() {
    let message = |error: TtError| error.to_string();
    assert_eq!(message(Axis::new("", 0.0, 1.0, 3).unwrap_err()), "axis \"\": the name is empty");
    for (low, high, bits) in
        [(1.0, 1.0, 3), (f64::NAN, 1.0, 3), (-1e308, 1e308, 3), (0.0, 1.0, 0), (0.0, 1.0, 53)]
    {
        assert!(matches!(Axis::new("x", low, high, bits), Err(TtError::Axis { .. })));
    }
    let x = Axis::new("x", 0.0, 1.0, 3).unwrap();
    assert!(Grid::new(Vec::new(), DigitOrder::Morton, Points::Ends).is_err());
    let twice = Grid::new(vec![x.clone(), x.clone()], DigitOrder::Morton, Points::Ends).unwrap_err();
    assert_eq!(message(twice), "axis \"x\": two axes have this name");
    let grid =
        Grid::new(vec![x, Axis::new("y", 0.0, 1.0, 40).unwrap()], DigitOrder::Morton, Points::Ends).unwrap();
    assert_eq!(message(grid.axis("z").unwrap_err()), "axis \"z\": there is none; axes are x, y");
    assert!(matches!(grid.coordinates("y"), Err(TtError::TooLarge { .. })));
    assert!(
        grid.points(&[0; 42]).is_err() && grid.points(&[2; 43]).is_err() && grid.nearest(&[0.1]).is_err()
    );
    let f = GridFunction::new(&grid, TtVector::constant(&[2; 43], 1.0).unwrap()).unwrap();
    assert!(GridFunction::new(&grid, TtVector::constant(&[2; 42], 1.0).unwrap()).is_err());
    assert!(GridFunction::from_full(&grid, &[1.0], &Truncation::to(0.0)).is_err());
    assert!((f.integral().unwrap() - 1.0).abs() < 1e-14);
    assert!(f.to_full().is_err() && f.values(&[0.5]).is_err());
    assert_eq!(message(f.values(&[0.5, 1.5]).unwrap_err()), "axis \"y\": 1.5 lies outside [0, 1]");
    assert!(
        f.values(&[f64::NAN, 0.5]).is_err()
            && f.restrict("x", -1.0).is_err()
            && f.restrict("z", 0.0).is_err()
    );
    assert!(f.integrate(&["x", "y"]).is_err() && f.integrate(&["z"]).is_err());
    let bad = GridFunction::cross(&grid, |p| 1.0 / (p[0] - p[0]), &[], &CrossSettings::default());
    assert!(matches!(bad, Err(TtError::Entry { .. })));
}
