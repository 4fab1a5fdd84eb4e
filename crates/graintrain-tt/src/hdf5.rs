//! Trains in HDF5 files (feature `hdf5`), for h5py, Julia and others.
//!
//! ```text
//! train/modes      u64, d numbers              (a vector)
//! train/rows, train/columns                    (a matrix, in place of modes)
//! train/core_1 ... train/core_d    f64, shape right x mode x left, or right x columns x rows x left
//! ```
//!
//! HDF5 counts the last index fastest, so the numbers lie as everywhere in this crate and the shapes are
//! reversed: in h5py, G = f["train/core_1"][:].T is left x mode x right.

use crate::vector::Core;
use crate::{TtError, TtMatrix, TtVector};
use hdf5_pure::{File, FileBuilder};
use std::path::Path;

impl TtVector {
    /// Writes the train to an HDF5 file, replacing what is there.
    ///
    /// # Errors
    /// [`TtError::File`] if the file cannot be written, [`TtError::Format`] if HDF5 cannot hold it.
    pub fn save_hdf5(&self, file: &Path) -> Result<(), TtError> {
        write(file, &[("modes", self.modes())], self, |core, _| vec![core.right(), core.mode(), core.left()])
    }

    /// Reads a train from an HDF5 file.
    ///
    /// # Errors
    /// [`TtError::File`] if it cannot be read, [`TtError::Format`] if it holds no train of a vector,
    /// [`TtError::Shape`] if its cores do not fit together.
    pub fn load_hdf5(file: &Path) -> Result<Self, TtError> {
        let input = Input::open(file)?;
        let modes = input.sizes("modes")?;
        input.train(modes.len(), |k| vec![modes[k]])
    }
}

impl TtMatrix {
    /// Writes the train to an HDF5 file, replacing what is there.
    ///
    /// # Errors
    /// As for [`TtVector::save_hdf5`].
    pub fn save_hdf5(&self, file: &Path) -> Result<(), TtError> {
        let sizes = [("rows", self.rows.clone()), ("columns", self.columns.clone())];
        write(file, &sizes, &self.train, |core, k| {
            vec![core.right(), self.columns[k], self.rows[k], core.left()]
        })
    }

    /// Reads a train from an HDF5 file.
    ///
    /// # Errors
    /// As for [`TtVector::load_hdf5`].
    pub fn load_hdf5(file: &Path) -> Result<Self, TtError> {
        let input = Input::open(file)?;
        let (rows, columns) = (input.sizes("rows")?, input.sizes("columns")?);
        if rows.len() != columns.len() {
            return Err(input.fault("train", &format!("{} rows for {} columns", rows.len(), columns.len())));
        }
        let train = input.train(rows.len(), |k| vec![columns[k], rows[k]])?;
        Self::from_vector(train, &rows, &columns)
    }
}

fn write(
    file: &Path,
    sizes: &[(&str, Vec<usize>)],
    train: &TtVector,
    shape: impl Fn(&Core, usize) -> Vec<usize>,
) -> Result<(), TtError> {
    let mut builder = FileBuilder::new();
    let mut group = builder.create_group("train");
    for (name, list) in sizes {
        group.create_dataset(name).with_u64_data(&list.iter().map(|&n| n as u64).collect::<Vec<_>>());
    }
    for (k, core) in train.cores().iter().enumerate() {
        let shape: Vec<u64> = shape(core, k).iter().map(|&n| n as u64).collect();
        group.create_dataset(&format!("core_{}", k + 1)).with_f64_data(core.data()).with_shape(&shape);
    }
    builder.add_group(group.finish());
    let name = || file.display().to_string();
    let bytes = builder.finish().map_err(|error| TtError::Format {
        file: name(),
        offset: 0,
        what: error.to_string(),
    })?;
    std::fs::write(file, bytes).map_err(|source| TtError::File { file: name(), source })
}

/// An HDF5 file being read.
struct Input<'a> {
    path: &'a Path,
    file: File,
}

impl<'a> Input<'a> {
    fn open(path: &'a Path) -> Result<Self, TtError> {
        let name = || path.display().to_string();
        let bytes = std::fs::read(path).map_err(|source| TtError::File { file: name(), source })?;
        let file = File::from_bytes(bytes).map_err(|error| TtError::Format {
            file: name(),
            offset: 0,
            what: error.to_string(),
        })?;
        Ok(Self { path, file })
    }

    fn fault(&self, place: &str, what: &str) -> TtError {
        TtError::Format { file: self.path.display().to_string(), offset: 0, what: format!("{place}: {what}") }
    }

    fn sizes(&self, name: &str) -> Result<Vec<usize>, TtError> {
        let place = format!("train/{name}");
        let list = self.file.dataset(&place).and_then(|dataset| dataset.read_u64());
        let list = list.map_err(|error| self.fault(&place, &error.to_string()))?;
        let size = |&n: &u64| usize::try_from(n).map_err(|_| self.fault(&place, &format!("size {n}")));
        list.iter().map(size).collect()
    }

    /// The d cores; `inner` are the sizes between the ranks.
    fn train(&self, d: usize, inner: impl Fn(usize) -> Vec<usize>) -> Result<TtVector, TtError> {
        let mut cores = Vec::with_capacity(d);
        for k in 0..d {
            let place = format!("train/core_{}", k + 1);
            let fault = |error: hdf5_pure::Error| self.fault(&place, &error.to_string());
            let dataset = self.file.dataset(&place).map_err(fault)?;
            let shape = dataset.shape().map_err(fault)?;
            let expected: Vec<u64> = inner(k).iter().map(|&n| n as u64).collect();
            if shape.len() != expected.len() + 2 || shape[1..shape.len() - 1] != expected[..] {
                return Err(self.fault(&place, &format!("shape {shape:?} around sizes {expected:?}")));
            }
            let data = dataset.read_f64().map_err(fault)?;
            if let Some(x) = data.iter().find(|x| !x.is_finite()) {
                return Err(self.fault(&place, &format!("holds {x}, expected finite numbers")));
            }
            let mode = inner(k).iter().fold(1usize, |product, &n| product.saturating_mul(n));
            let rank = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
            cores.push(Core::new(rank(shape[shape.len() - 1]), mode, rank(shape[0]), data)?);
        }
        TtVector::from_cores(cores)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trains_survive_and_lie_as_documented() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("train.h5");
        let (x, a) = (
            TtVector::random(&[3, 2, 5], 4, 1).unwrap(),
            TtMatrix::random(&[3, 2, 5], &[2, 2, 4], 3, 1).unwrap(),
        );
        x.save_hdf5(&file).unwrap();
        assert_eq!(TtVector::load_hdf5(&file).unwrap(), x);
        assert!(matches!(TtMatrix::load_hdf5(&file), Err(TtError::Format { .. })));
        let second = File::open(&file).unwrap().dataset("train/core_2").unwrap();
        assert_eq!(second.shape().unwrap(), [4, 2, 3]);
        // Last index fastest: left, then mode, then right.
        assert_eq!(second.read_f64().unwrap()[1 + 3 * (1 + 2 * 2)], x.cores()[1].get(1, 1, 2));
        a.save_hdf5(&file).unwrap();
        assert_eq!(TtMatrix::load_hdf5(&file).unwrap(), a);
        let mut cores = x.cores().to_vec();
        cores[1] = Core::new(3, 2, 4, vec![f64::NAN; 24]).unwrap();
        TtVector::from_cores(cores).unwrap().save_hdf5(&file).unwrap();
        assert!(TtVector::load_hdf5(&file).unwrap_err().to_string().contains("core_2: holds NaN"));
        a.save_hdf5(&file).unwrap();
        let bytes = std::fs::read(&file).unwrap();
        for length in [0, 8, 100, bytes.len() / 2, bytes.len() - 8] {
            std::fs::write(&file, &bytes[..length]).unwrap();
            assert!(TtMatrix::load_hdf5(&file).is_err(), "{length}");
        }
        assert!(matches!(TtVector::load_hdf5(&folder.path().join("absent")), Err(TtError::File { .. })));
        // Cores that do not fit together.
        let mut builder = FileBuilder::new();
        let mut group = builder.create_group("train");
        group.create_dataset("modes").with_u64_data(&[2]);
        group.create_dataset("core_1").with_f64_data(&[1.0; 4]).with_shape(&[2, 2, 1]);
        builder.add_group(group.finish());
        std::fs::write(&file, builder.finish().unwrap()).unwrap();
        assert!(matches!(TtVector::load_hdf5(&file), Err(TtError::Shape { .. })));
    }
}
