//! What trains of tensors and of matrices have in common.

macro_rules! shared {
    ($class:ident($train:ident)) => {
        /// What both kinds of trains have.
        #[pymethods]
        impl $class {
            /// Ranks, the ones at both ends included.
            #[getter]
            fn ranks(&self) -> Vec<usize> {
                self.train.ranks()
            }

            /// The largest rank.
            #[getter]
            fn max_rank(&self) -> usize {
                self.train.max_rank()
            }

            /// Number of cores d.
            #[getter]
            fn num_cores(&self) -> usize {
                self.train.num_cores()
            }

            /// The cores, (left rank, mode, right rank) each; modes of a matrix are rows[k] * columns[k].
            /// Copies.
            #[getter]
            pub(super) fn cores<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
                self.train.cores().iter().map(|core| core_array(py, core)).collect()
            }

            /// Writes the train to a file.
            fn save(&self, path: PathBuf) -> PyResult<()> {
                self.train.save(&path).or_raise()
            }

            /// Reads what save wrote.
            #[staticmethod]
            fn load(path: PathBuf) -> PyResult<Self> {
                Ok($train::load(&path).or_raise()?.into())
            }

            /// Writes the train to an HDF5 file.
            fn save_hdf5(&self, path: PathBuf) -> PyResult<()> {
                self.train.save_hdf5(&path).or_raise()
            }

            /// Reads what save_hdf5 wrote.
            #[staticmethod]
            fn load_hdf5(path: PathBuf) -> PyResult<Self> {
                Ok($train::load_hdf5(&path).or_raise()?.into())
            }

            /// A train of the smallest ranks within a relative error in the Frobenius norm (Oseledets 2011).
            /// O(d n r^3). With return_report=True also a dict: error (the error itself), floor (what
            /// rounding adds at most), norm, capped.
            #[pyo3(signature = (tolerance=1e-10, *, max_rank=None, return_report=false))]
            fn round<'py>(
                &self,
                py: Python<'py>,
                tolerance: f64,
                max_rank: Option<usize>,
                return_report: bool,
            ) -> PyResult<Bound<'py, PyAny>> {
                let found = detached(py, || self.train.round(&truncation(tolerance, max_rank)))?;
                maybe_with_report::<_, Self>(py, found, return_report)
            }

            /// Without dependent rows and columns of cores: true ranks, to the last digit of every term of a
            /// sum.
            fn without_dependent_ranks(&self, py: Python<'_>) -> Self {
                py.detach(|| self.train.without_dependent_ranks()).into()
            }

            /// Frobenius norm. O(d n r^3).
            fn norm(&self, py: Python<'_>) -> f64 {
                py.detach(|| self.train.norm())
            }

            /// ||self - other|| / ||other||, without cancellation.
            fn relative_distance(&self, py: Python<'_>, other: &Self) -> PyResult<f64> {
                detached(py, || self.train.relative_distance(&other.train))
            }

            fn __add__(&self, other: &Self) -> PyResult<Self> {
                Ok(self.train.add(&other.train).or_raise()?.into())
            }

            fn __sub__(&self, other: &Self) -> PyResult<Self> {
                Ok(self.train.subtract(&other.train).or_raise()?.into())
            }

            fn __mul__(&self, factor: f64) -> Self {
                self.train.scale(factor).into()
            }

            fn __rmul__(&self, factor: f64) -> Self {
                self.__mul__(factor)
            }

            fn __neg__(&self) -> Self {
                self.__mul__(-1.0)
            }

            /// The product entry by entry: ranks multiply.
            fn hadamard(&self, other: &Self) -> PyResult<Self> {
                Ok(self.train.hadamard(&other.train).or_raise()?.into())
            }
        }
    };
}

pub(super) use shared;
