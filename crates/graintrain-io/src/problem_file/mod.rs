//! Files that hold one contact problem: FCLIB (HDF5), the text problems of Siconos, NumPy archives,
//! MatrixMarket files, and the program's own dumps, which are FCLIB files.
//!
//! | module | holds |
//! |---|---|
//! | `fclib`, `siconos` | the two formats |
//! | `numpy`, `matrix_market` | `.npz` archives, MatrixMarket files side by side |
//! | `raw` | a problem as a file states it: local (W, q, mu) or global (M, H, f, w, mu) |
//! | `local`, `global` | from there to the CCP |
//! | `rolling` | from the five rows of contacts with rolling friction to block rows |
//! | `rigid` | recognises the rigid bodies of a global problem |
//! | `dump` | writes problems |
//! | `hdf5` | the files of both; without the feature `fclib`, `without_fclib` refuses them |

mod dense;
#[cfg(feature = "fclib")]
mod dump;
mod error;
#[cfg(feature = "fclib")]
mod fclib;
mod global;
#[cfg(feature = "fclib")]
mod hdf5;
mod local;
mod matrix;
mod matrix_market;
mod numpy;
mod raw;
mod rigid;
mod rolling;
mod siconos;
#[cfg(not(feature = "fclib"))]
mod without_fclib;

pub use error::ProblemFileError;
pub use hdf5::write;

use error::Defect;
use graintrain_ccp::{Ccp, CcpError, Delassus, FrictionModel};
use matrix::{Entry, Matrix};
use raw::{Extras, GlobalForm, LocalForm, RawProblem, Stated};
use std::path::Path;
#[cfg(not(feature = "fclib"))]
use without_fclib as hdf5;

/// How a file states its problem, and what became of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// u = W r + q: an explicit matrix.
    Local,
    /// M v = H r + f with rigid bodies, which are kept.
    RigidBodies,
    /// M v = H r + f with other bodies: condensed to an explicit matrix.
    Condensed,
}

/// A problem read from a file. Contacts keep the order of the file, components their frame (normal, tangent
/// 1, tangent 2).
#[derive(Clone, Debug)]
pub struct ProblemFile {
    /// The problem. Its matrix is symmetric; its impulses are the `r` of the file, its velocities the `u`.
    pub problem: Ccp,
    /// How the file states it.
    pub form: Form,
    /// The title in the file; empty where it has none.
    pub title: String,
    /// Number of bodies (independent blocks of M); 0 where the file does not know them.
    pub bodies: usize,
    /// The problem with the matrix W, or with H^T M^-1 H, as it is in the file, where that is noticeably
    /// asymmetric. `problem` has its symmetric part.
    pub as_filed: Option<Ccp>,
    /// Where contacts have rolling friction, the length of each one's turning rows, m: the impulses of these
    /// rows in `problem` are the file's moments over it, the velocities the file's times it. Empty without
    /// rolling friction.
    pub turning_length: Vec<f64>,
    /// max |A - A^T| / max |A| of the matrix in the file (W or M) that has to be symmetric.
    pub asymmetry: f64,
    /// What was taken in another way than the file says it, one sentence each.
    pub remarks: Vec<String>,
}

/// Asymmetry that is worth telling the user about.
const NOTICEABLE_ASYMMETRY: f64 = 1e-9;

impl ProblemFile {
    /// The problem that a friction model poses: exact friction holds for the matrix as it is in the file; the
    /// relaxation is a minimisation, and takes its symmetric part.
    pub fn posed(&self, model: FrictionModel) -> &Ccp {
        match (model, &self.as_filed) {
            (FrictionModel::Coulomb, Some(as_filed)) => as_filed,
            _ => &self.problem,
        }
    }

    /// What the user should know about the file, one sentence each.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = self.remarks.clone();
        if self.asymmetry > NOTICEABLE_ASYMMETRY {
            let taken = match self.as_filed {
                Some(_) => "exact friction takes it as it is, the relaxation its symmetric part",
                None => "its symmetric part is solved",
            };
            notes.push(format!(
                "the matrix in the file is asymmetric ({:.1e} of its largest entry); {taken}",
                self.asymmetry
            ));
        }
        notes
    }
}

/// Reads a problem file; its contents decide the format, not its name.
///
/// # Errors
/// [`ProblemFileError`]: unreadable, damaged, or a problem that is not solved here (two-dimensional).
pub fn read(path: &Path) -> Result<ProblemFile, ProblemFileError> {
    let bytes =
        std::fs::read(path).map_err(|source| ProblemFileError::Io { path: path.to_path_buf(), source })?;
    let problem = if matrix_market::is_matrix_market(&bytes) {
        matrix_market::parse(path).and_then(stated)
    } else {
        parse(bytes)
    };
    problem.map_err(|defect| defect.in_file(path))
}

/// A sparse matrix by its entries (row, column, value), in any order; entries at the same place are added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Entries {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Row, column, value.
    pub entries: Vec<(usize, usize, f64)>,
}

impl Entries {
    fn matrix(self, name: &str) -> Result<Matrix, Defect> {
        let entry = |(row, column, value)| Entry { row, column, value };
        Matrix::new(name, self.rows, self.columns, self.entries.into_iter().map(entry).collect())
    }
}

/// The problem u = W g + q, as [`read`] takes it from a file. `name` is what messages call the matrices.
///
/// # Errors
/// [`ProblemFileError`] for what [`read`] would refuse in a file.
pub fn from_local(
    name: &str,
    w: Entries,
    q: Vec<f64>,
    friction: Vec<f64>,
) -> Result<ProblemFile, ProblemFileError> {
    let local = |w| RawProblem::Local(LocalForm { w, q, friction, rolling: None, equalities: None });
    w.matrix("W").map(local).and_then(stated).map_err(|defect| defect.in_file(Path::new(name)))
}

/// The problem M v = H g + f, u = H^T v + w, as [`read`] takes it from a file: rigid bodies are recognised
/// and kept.
///
/// # Errors
/// [`ProblemFileError`] for what [`read`] would refuse in a file.
pub fn from_global(
    name: &str,
    [m, h]: [Entries; 2],
    [f, w]: [Vec<f64>; 2],
    friction: Vec<f64>,
) -> Result<ProblemFile, ProblemFileError> {
    let raw = || {
        let (m, h) = (m.matrix("M")?, h.matrix("H")?);
        stated(RawProblem::Global(GlobalForm { m, h, f, w, friction, rolling: None, equalities: None }))
    };
    raw().map_err(|defect| defect.in_file(Path::new(name)))
}

/// A problem that was stated by nothing but its matrices.
fn stated(raw: RawProblem) -> Result<ProblemFile, Defect> {
    raw.check(str::to_string)?;
    build(Stated { raw, title: String::new(), remark: None, extras: Extras::default() })
}

/// Whether this is an HDF5 file: its signature stands at the beginning or at 512, 1024, 2048, ...
fn is_hdf5(bytes: &[u8]) -> bool {
    let places = std::iter::successors(Some(512_usize), |place| place.checked_mul(2));
    std::iter::once(0)
        .chain(places.take_while(|&place| place < bytes.len()))
        .any(|place| bytes[place..].starts_with(b"\x89HDF\r\n\x1a\n"))
}

fn parse(bytes: Vec<u8>) -> Result<ProblemFile, Defect> {
    if is_hdf5(&bytes) {
        build(hdf5::parse(bytes)?)
    } else if numpy::is_npz(&bytes) {
        stated(numpy::parse(&bytes)?)
    } else {
        stated(siconos::parse(&bytes)?)
    }
}

fn build(stated: Stated) -> Result<ProblemFile, Defect> {
    let Stated { mut raw, title, remark, mut extras } = stated;
    let mut remarks: Vec<String> = remark.into_iter().chain(extras.remark.take()).collect();
    remarks.extend(raw.mirror_triangles().into_iter().map(|name| {
        format!(
            "{name} has entries on one side of its diagonal only and is taken as one triangle of a symmetric matrix"
        )
    }));
    let mut matrix_as_filed;
    let rolling = raw.spread_rolling()?;
    let (mut delassus, mut r, points, friction, form, bodies, asymmetry) = match raw {
        RawProblem::Local(mut local) => {
            let friction = std::mem::take(&mut local.friction);
            let reduced = local::reduce(local)?;
            matrix_as_filed = reduced.as_filed;
            (reduced.delassus, reduced.r, Vec::new(), friction, Form::Local, 0, reduced.asymmetry)
        }
        RawProblem::Global(mut global) => {
            let friction = std::mem::take(&mut global.friction);
            let reduced = match extras.bodies {
                Some(bodies) => global::Reduced::from_bodies(bodies, std::mem::take(&mut global.w)),
                None => global::reduce(&global, rolling.is_some())?,
            };
            matrix_as_filed = reduced.as_filed;
            let form = match reduced.delassus {
                Delassus::Rigid(_) => Form::RigidBodies,
                Delassus::Sparse(_) => Form::Condensed,
            };
            (reduced.delassus, reduced.r, reduced.points, friction, form, reduced.bodies, reduced.asymmetry)
        }
    };
    let invalid =
        |error: CcpError| Defect::damaged("the contact problem", error.to_string(), error::WRITE_AGAIN);
    let (mut turning, mut turning_length) = (Vec::new(), Vec::new());
    if let Some(rolling) = rolling {
        let scaled = rolling::scale(&delassus, matrix_as_filed.as_ref(), r, &rolling)?;
        (delassus, matrix_as_filed) = (scaled.delassus, scaled.as_filed);
        (r, turning, turning_length) = (scaled.r, scaled.turning, scaled.length);
    }
    let mut problem = Ccp::with_turning(delassus, r, friction, turning).map_err(invalid)?;
    problem.velocity_scale = extras.velocity_scale;
    problem.identity = extras.identity;
    problem.points = if extras.points.is_empty() { points } else { extras.points };
    problem.validate().map_err(invalid)?;
    let as_filed =
        matrix_as_filed.map(|matrix| Ccp { delassus: std::sync::Arc::new(matrix), ..problem.clone() });
    Ok(ProblemFile { problem, form, title, bodies, as_filed, turning_length, asymmetry, remarks })
}
