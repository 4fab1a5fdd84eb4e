//! Tensor trains: everything of the crate graintrain-tt, under its names.
//!
//! | module | holds |
//! |---|---|
//! | `vector`, `matrix`, `complex` | the types: making, reading, algebra, rounding |
//! | `sparse` | sparse and symmetric matrices, sketches, operators on full vectors |
//! | `cross` | trains from functions and from data: cross, map, fit |
//! | `solve` | linear systems, inverses, eigenpairs, evolution |
//! | `fourier` | Fourier transform and convolution; files of other programs |
//! | `qtt` | quantized trains with known ranks |
//! | `quantics`, `operator_sum` | functions on named grids, sums of local operators |
//! | `settings`, `shared` | settings and choices from keywords; what all real trains have |

pub mod complex;
pub mod cross;
pub mod fourier;
pub mod matrix;
pub mod operator_sum;
pub mod qtt;
pub mod quantics;
mod settings;
mod shared;
pub mod solve;
pub mod sparse;
pub mod vector;

use crate::arrays::owned;
use crate::error::OrRaise;
use crate::plain::plain;
use crate::world::interruptible;
pub use complex::{ComplexMatrix, ComplexVector};
use graintrain_tt::{Core, Measured, Stop, Truncation, TtError};
pub use matrix::TrainMatrix;
use numpy::Element;
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PySlice;
use serde::Serialize;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
pub use vector::TrainVector;

fn truncation(tolerance: f64, max_rank: Option<usize>) -> Truncation {
    Truncation::capped(tolerance, max_rank.unwrap_or(usize::MAX))
}

/// Numbers in C order as numbers in F order.
fn column_major<T: Copy + Default>(numbers: &[T], shape: &[usize]) -> Vec<T> {
    let mut turned = vec![T::default(); numbers.len()];
    let strides: Vec<usize> = shape
        .iter()
        .scan(1, |product, n| {
            let stride = *product;
            *product *= n;
            Some(stride)
        })
        .collect();
    for (k, &number) in numbers.iter().enumerate() {
        let (mut rest, mut place) = (k, 0);
        for (n, stride) in shape.iter().zip(&strides).rev() {
            place += rest % n * stride;
            rest /= n;
        }
        turned[place] = number;
    }
    turned
}

/// Numbers in F order as an array.
fn array<'py, T: Element>(py: Python<'py>, full: Vec<T>, shape: &[usize]) -> PyResult<Bound<'py, PyAny>> {
    let turned: Vec<usize> = shape.iter().rev().copied().collect();
    owned(py, full, &turned)?.into_any().getattr("T")
}

/// Multi-indices, one after the other, as rows of an array.
fn index_rows<'py>(py: Python<'py>, indices: &[usize], width: usize) -> PyResult<Bound<'py, PyAny>> {
    let rows: Vec<i64> = indices.iter().map(|&index| index as i64).collect();
    let shape = [rows.len() / width.max(1), width];
    Ok(owned(py, rows, &shape)?.into_any())
}

/// Cores as arrays.
type Cores<'py> = Vec<Bound<'py, PyAny>>;

/// The core as an array (left rank, mode, right rank).
fn core_array<'py>(py: Python<'py>, core: &Core) -> PyResult<Bound<'py, PyAny>> {
    array(py, core.data().to_vec(), &[core.left(), core.mode(), core.right()])
}

/// Cores from arrays (left rank, mode, right rank).
fn cores_of(arrays: &[Bound<'_, PyAny>]) -> PyResult<Vec<Core>> {
    let core = |(k, object): (usize, &Bound<'_, PyAny>)| {
        let what = format!("cores[{k}]");
        let (numbers, shape) = crate::arrays::numbers(&what, object)?;
        let [left, mode, right] = shape[..] else {
            return Err(PyValueError::new_err(format!(
                "{what} has {} dimensions, expected 3: left rank, mode, right rank",
                shape.len()
            )));
        };
        Core::new(left, mode, right, column_major(&numbers, &shape)).or_raise()
    };
    arrays.iter().enumerate().map(core).collect()
}

/// Ranges of digits from numbers and slices.
fn ranges(what: &str, given: &[Bound<'_, PyAny>], modes: &[usize]) -> PyResult<Vec<Range<usize>>> {
    if given.len() != modes.len() {
        return Err(PyValueError::new_err(format!(
            "{what}: {} ranges, expected {}",
            given.len(),
            modes.len()
        )));
    }
    let range = |(object, &n): (&Bound<'_, PyAny>, &usize)| {
        let Ok(slice) = object.cast::<PySlice>() else {
            let digit: usize = object.extract()?;
            return Ok(digit..digit.saturating_add(1));
        };
        let found = slice.indices(n as isize)?;
        if found.step != 1 {
            return Err(PyValueError::new_err(format!(
                "{what}: a slice has the step {}, expected 1",
                found.step
            )));
        }
        Ok(found.start as usize..found.stop as usize)
    };
    given.iter().zip(modes).map(range).collect()
}

/// Long work without the interpreter's lock, which Ctrl-C stops.
fn stoppable<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(Stop<'_>) -> Result<T, TtError> + Send,
) -> PyResult<T> {
    let flag = Arc::<AtomicBool>::default();
    let asked = Arc::clone(&flag);
    interruptible(py, &[flag], move || work(&|| asked.load(Ordering::Relaxed)))?.or_raise()
}

/// Work without the interpreter's lock.
fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T, TtError> + Send) -> PyResult<T> {
    py.detach(work).or_raise()
}

/// A train and its report as a dict.
fn with_report<'py, T, P: From<T>>(
    py: Python<'py>,
    (train, report): (T, impl Serialize),
) -> PyResult<(P, Bound<'py, PyAny>)> {
    Ok((train.into(), plain(py, &report)?))
}

/// A train, with its report where it is asked for.
fn maybe_with_report<'py, T, P: From<T> + IntoPyObject<'py>>(
    py: Python<'py>,
    found: (T, impl Serialize),
    wanted: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let (train, report) = with_report::<T, P>(py, found)?;
    let train = train.into_bound_py_any(py)?;
    if wanted { (train, report).into_bound_py_any(py) } else { Ok(train) }
}

/// The value and what rounding leaves uncertain about it.
fn value_and_floor(measured: Measured) -> (f64, f64) {
    (measured.value, measured.floor)
}
