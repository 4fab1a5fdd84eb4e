//! Long computations end when they are asked to.

use graintrain_tt::complex::{ComplexMatrix, ComplexVector};
use graintrain_tt::cross::{CrossSettings, Function, cross_sparse_within, cross_within};
use graintrain_tt::fit::{FitSettings, fit_within};
use graintrain_tt::inverse::{InverseForm, inverse_within, newton_schulz_within};
use graintrain_tt::qtt::{laplacian, ramp};
use graintrain_tt::quantics::{Axis, Grid, GridFunction, Points};
use graintrain_tt::solve::{
    evolve_within, gmres_within, lowest_eigenpairs_within, solve_matrix_within, solve_within,
};
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::{Truncation, TtError, TtMatrix, TtVector};
use std::sync::atomic::{AtomicUsize, Ordering};

#[test]
fn every_long_computation_stops() {
    let (a, y) = (laplacian(6).unwrap(), TtVector::constant(&[2; 6], 1.0).unwrap());
    let identity = TtMatrix::identity(&[2; 6]).unwrap();
    let x = ramp(6, 1.0, 0.1).unwrap();
    let source = Function::new(&[4; 4], |index| index.iter().sum::<usize>() as f64);
    let indices: Vec<usize> = (0..60).flat_map(|p| [p % 3, p / 3 % 4, p / 12]).collect();
    let values: Vec<f64> = indices.chunks_exact(3).map(|i| (i[0] + i[1] * i[2]) as f64).collect();
    let sparse = QuadtreeMatrix::from_entries(2, 3, (0..16).map(|k| (k, k, 1.0))).unwrap();
    let complex = ComplexMatrix::new(&a, &identity).unwrap();
    let right = ComplexVector::from_real(&y).unwrap();
    let grid = Grid::new(
        vec![Axis::new("x", 0.0, 1.0, 8).unwrap()],
        graintrain_tt::qtt::DigitOrder::Morton,
        Points::Ends,
    )
    .unwrap();
    let on_grid = Function::new(&[2; 8], |index| index[0] as f64);
    let cross = CrossSettings::default();
    type Computation<'a> = (&'a str, Box<dyn Fn(graintrain_tt::Stop<'_>) -> Result<(), TtError> + 'a>);
    let all: Vec<Computation<'_>> = vec![
        ("solve", Box::new(|s| solve_within(&a, &y, None, &Default::default(), s).map(|_| ()))),
        (
            "solve_matrix",
            Box::new(|s| solve_matrix_within(&a, &identity, None, &Default::default(), s).map(|_| ())),
        ),
        ("complex", Box::new(|s| complex.solve_within(&right, &Default::default(), s).map(|_| ()))),
        ("gmres", Box::new(|s| gmres_within(&a, &y, None, None, &Default::default(), s).map(|_| ()))),
        ("eigenpairs", Box::new(|s| lowest_eigenpairs_within(&a, 2, &Default::default(), s).map(|_| ()))),
        ("evolve", Box::new(|s| evolve_within(&a, &y, -0.1, &Default::default(), s).map(|_| ()))),
        (
            "inverse",
            Box::new(|s| {
                inverse_within(&a, InverseForm::Symmetric, None, &Default::default(), s).map(|_| ())
            }),
        ),
        (
            "newton",
            Box::new(|s| {
                newton_schulz_within(&a, &identity.scale(0.2), &Truncation::to(1e-8), 1e-3, 30, s).map(|_| ())
            }),
        ),
        ("cross", Box::new(|s| cross_within(&source, None, &[], &cross, s).map(|_| ()))),
        ("cross_sparse", Box::new(|s| cross_sparse_within(&sparse, None, 1, &cross, s).map(|_| ()))),
        ("grid", Box::new(|s| GridFunction::cross_source(&grid, &on_grid, &[], &cross, s).map(|_| ()))),
        ("map", Box::new(|s| TtVector::map_within(&[&x], |x| x[0].exp(), &cross, s).map(|_| ()))),
        ("square_root", Box::new(|s| x.square_root_within(&cross, s).map(|_| ()))),
        ("reciprocal", Box::new(|s| x.reciprocal_within(&Default::default(), s).map(|_| ()))),
        (
            "fit",
            Box::new(|s| fit_within(&[3, 4, 5], &indices, &values, &FitSettings::default(), s).map(|_| ())),
        ),
    ];
    for (name, computation) in &all {
        let asked = AtomicUsize::new(0);
        // At the first question and at the second.
        for until in [0, 1] {
            asked.store(0, Ordering::Relaxed);
            let found = computation(&|| asked.fetch_add(1, Ordering::Relaxed) >= until);
            assert!(matches!(found, Err(TtError::Stopped)), "{name} after {until}: {found:?}");
        }
        computation(&|| false).unwrap();
    }
}
