//! Contact problems for graintrain's own tests: those that this project made, with their optima, in
//! `problems/`, and the way to the public data of others, which lie outside of the repository.

pub mod pages;

use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A problem with the optimum of its relaxation, found by another program (see `problems/optimum.py`).
#[derive(Clone, Debug)]
pub struct Problem {
    /// File name.
    pub name: String,
    /// The file: FCLIB (`.hdf5`) or Siconos text (`.dat`).
    pub path: PathBuf,
    /// Number of contacts.
    pub contacts: usize,
    /// Least 1/2 g . N g + r . g over the friction cones, J.
    pub objective: f64,
    /// Relative error of the impulses it was computed from.
    pub accuracy: f64,
}

/// The problems of this repository.
///
/// # Panics
/// Where `problems/reference.csv` is damaged.
pub fn problems() -> Vec<Problem> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("problems");
    let text = std::fs::read_to_string(folder.join("reference.csv")).expect("the repository has it");
    let problem = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |k: usize| fields[k].parse::<f64>().expect("reference.csv holds numbers");
        Problem {
            name: fields[0].to_string(),
            path: folder.join(fields[0]),
            contacts: number(1) as usize,
            objective: number(4),
            accuracy: number(5),
        }
    };
    text.lines().skip(1).map(problem).collect()
}

/// A file or folder of the public data, which are found in the folder named by the variable `GRAINTRAIN_DATA`
/// or in `../shared/data` beside the checkout. Where it is absent that is said, and with
/// `GRAINTRAIN_SKIPPED=FILE` written into that file, a line per test that asked: `.ci/run` counts them, so
/// that nothing is skipped in silence.
pub fn public_data(path: &str) -> Option<PathBuf> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let folder = std::env::var_os("GRAINTRAIN_DATA").map_or_else(|| PathBuf::from(default), PathBuf::from);
    let found = folder.join(path);
    if found.exists() {
        return Some(found);
    }
    let test = std::thread::current().name().unwrap_or("a test").to_string();
    println!("skipped: {} is not there (set GRAINTRAIN_DATA)", found.display());
    if let Some(list) = std::env::var_os("GRAINTRAIN_SKIPPED") {
        let line = format!("{test}: {}\n", found.display());
        let file = std::fs::File::options().create(true).append(true).open(list);
        // One write per line: tests of several processes share the file.
        let written = file.and_then(|mut file| file.write_all(line.as_bytes()));
        written.expect("the list of skipped tests can be written");
    }
    None
}
