//! Sums of products of local operators.

use super::matrix::full_matrix;
use super::{TrainMatrix, array, detached, settings};
use crate::error::OrRaise;
use graintrain_tt::FullMatrix;
use graintrain_tt::operator_sum::{self as sums, LocalOperator};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyString;

/// sum_t w_t O_{t,1} (x) ... (x) O_{t,d}: a sum of products of local operators on a chain of sites, and its
/// matrix train of the smallest ranks.
///
/// An operator is an array (n, n) or a name: "S+", "S-", "Sx", "iSy", "Sz" of a spin (n - 1) / 2 with the
/// largest Sz first, "A", "A+", "N" of an oscillator with up to n - 1 quanta, "Identity". The Heisenberg
/// chain of ten spins:
///
/// >>> chain = OperatorSum([2] * 10) >>> for w, a, b
/// in [(0.5, "S+", "S-"), (0.5, "S-", "S+"), (1, "Sz", "Sz")]: chain.add_translates(w, [a, b])
#[pyclass(module = "graintrain.tt")]
pub struct OperatorSum {
    sum: sums::OperatorSum,
}

/// An operator from its name or an array.
fn operator(what: &str, given: &Bound<'_, PyAny>, n: usize) -> PyResult<FullMatrix> {
    match given.cast::<PyString>() {
        Ok(name) => settings::choice::<LocalOperator>(what, &name.to_cow()?)?.matrix(n).or_raise(),
        Err(_) => full_matrix(what, given),
    }
}

#[pymethods]
impl OperatorSum {
    /// The empty sum over sites of these sizes.
    #[new]
    fn new(modes: Vec<usize>) -> PyResult<Self> {
        Ok(Self { sum: sums::OperatorSum::new(&modes).or_raise()? })
    }

    /// Sizes of the sites.
    #[getter]
    fn modes(&self) -> Vec<usize> {
        self.sum.modes().to_vec()
    }

    /// Terms added so far.
    #[getter]
    fn num_terms(&self) -> usize {
        self.sum.num_terms()
    }

    /// Adds weight times the product of (site, operator) pairs; several at one site are multiplied as
    /// written, none at all is the identity.
    fn add(&mut self, weight: f64, factors: Vec<(usize, Bound<'_, PyAny>)>) -> PyResult<()> {
        let mut matrices = Vec::with_capacity(factors.len());
        for (k, (site, given)) in factors.iter().enumerate() {
            let Some(&n) = self.sum.modes().get(*site) else {
                let sites = self.sum.modes().len();
                return Err(PyValueError::new_err(format!("site {site} of {sites} (the first one is 0)")));
            };
            matrices.push((*site, operator(&format!("factors[{k}]"), given, n)?));
        }
        let factors: Vec<(usize, &FullMatrix)> = matrices.iter().map(|(site, m)| (*site, m)).collect();
        self.sum.add(weight, &factors).or_raise()?;
        Ok(())
    }

    /// Adds weight times the product of operators at neighbouring sites k, k + 1, ..., for every k. (All
    /// sites they meet are of one size.)
    fn add_translates(&mut self, weight: f64, factors: Vec<Bound<'_, PyAny>>) -> PyResult<()> {
        let n = self.sum.modes()[0];
        let matrix = |(k, given): (usize, &Bound<'_, PyAny>)| operator(&format!("factors[{k}]"), given, n);
        let matrices = factors.iter().enumerate().map(matrix).collect::<PyResult<Vec<_>>>()?;
        self.sum.add_translates(weight, &matrices.iter().collect::<Vec<_>>()).or_raise()?;
        Ok(())
    }

    /// The matrix train, site 0 the lowest digit, exact and with the smallest ranks.
    fn to_matrix(&self, py: Python<'_>) -> PyResult<TrainMatrix> {
        Ok(detached(py, || self.sum.to_matrix())?.into())
    }

    fn __repr__(&self) -> String {
        format!("<graintrain.tt.OperatorSum: {} terms, modes {:?}>", self.num_terms(), self.modes())
    }
}

/// The n x n matrix of an operator that has a name; see OperatorSum.
#[pyfunction]
pub fn local_operator<'py>(py: Python<'py>, name: &str, n: usize) -> PyResult<Bound<'py, PyAny>> {
    let full = settings::choice::<LocalOperator>("name", name)?.matrix(n).or_raise()?;
    array(py, full.into_vec(), &[n, n])
}
