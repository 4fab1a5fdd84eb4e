//! Files that are refused: truncated, garbled, not a number, or a problem that is not solved here. Never a
//! panic.

use super::data;
use graintrain_io::problem_file::{self, ProblemFileError};
use hdf5_pure::FileBuilder;
use proptest::prelude::Rng as _;
use proptest::test_runner::{RngAlgorithm, TestRng};
use std::path::{Path, PathBuf};

/// Every problem file of the public data that is small enough to be read hundreds of times.
fn small_files() -> Vec<PathBuf> {
    let Some(data) = data() else { return Vec::new() };
    let mut files: Vec<PathBuf> = std::fs::read_dir(data.join("fclib"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "dat" || extension == "hdf5"))
        .filter(|path| path.metadata().unwrap().len() < 200_000)
        .collect();
    files.sort();
    files
}

/// Reads bytes as a problem file; an error must name the file and a remedy.
fn outcome(folder: &Path, bytes: &[u8]) -> Result<(), ProblemFileError> {
    let path = folder.join("damaged");
    std::fs::write(&path, bytes).unwrap();
    problem_file::read(&path).map(|_| ()).inspect_err(|error| {
        assert!(error.to_string().starts_with(&path.display().to_string()), "{error}");
        assert!(!error.remedy().is_empty());
    })
}

#[test]
fn truncated_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for path in small_files() {
        let bytes = std::fs::read(&path).unwrap();
        let step = (bytes.len() / 150).max(1);
        let lengths = (0..40).chain((40..bytes.len()).step_by(step)).filter(|&length| length < bytes.len());
        for length in lengths {
            let result = outcome(folder.path(), &bytes[..length]);
            // The last tenth of an HDF5 file may hold what is not needed, and a cut last number is a number.
            assert!(result.is_err() || length > bytes.len() * 9 / 10, "{} at {length}", path.display());
        }
    }
}

#[test]
fn garbled_files_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[3; 32]);
    for path in small_files() {
        let bytes = std::fs::read(&path).unwrap();
        for _ in 0..120 {
            let mut garbled = bytes.clone();
            for _ in 0..1 + rng.next_u32() % 8 {
                // Headers matter most: half of the hits go there.
                let range =
                    if rng.next_u32().is_multiple_of(2) { bytes.len().min(4096) } else { bytes.len() };
                let place = rng.next_u32() as usize % range;
                garbled[place] = rng.next_u32() as u8;
            }
            let _ = outcome(folder.path(), &garbled);
        }
    }
    for junk in
        [&b""[..], b"\x89HDF\r\n\x1a\n", b"hello", b"3\n", b"3 99999999999999999999", b"3\n4\n0\n12\n12\n"]
    {
        assert!(outcome(folder.path(), junk).is_err());
    }
}

/// A correct text problem with one contact, to be spoilt.
const TEXT: &str = "3\n1\n0\n3\n3\n3\t3\n 2. 0. 0. 0. 2. 0. 0. 0. 2.\n-1. 0. 0.\n0.5\n";

#[test]
fn errors_tell_the_line_and_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    assert!(outcome(folder.path(), TEXT.as_bytes()).is_ok());
    let cases = [
        ("-1. 0.", "nan 0.", "line 8: q contains NaN"),
        ("-1. 0.", "-1. x", "line 8: expected q (a number), found 'x'"),
        ("0.5", "", "line 10: the file ends where mu is expected"),
        ("0.5", "-0.5", "the coefficient of friction of contact 0 is -0.5"),
        ("3\n1", "2\n1", "two-dimensional"),
        ("3\n1", "5\n1", "has W 5 x 5"),
        ("3\n1\n0", "3\n1\n7", "storage 7"),
        ("0.5", "0.5 1 2 3 4 5", "9 numbers and no second matrix follow a 3 x 3 matrix"),
        ("3\n1", "3\n2", "a local problem of 2 contacts (line 2) has W 6 x 6"),
    ];
    for (from, to, expected) in cases {
        let error = outcome(folder.path(), TEXT.replacen(from, to, 1).as_bytes()).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    }
}

#[test]
fn problems_of_another_kind_are_refused_by_name() {
    let Some(data) = data() else { return };
    let cases = [
        ("fc2d_granularflowonwall_00667_00000.dat", "two-dimensional"),
        ("FrictionContactProblem00071.dat", "two-dimensional"),
    ];
    for (name, expected) in cases {
        let error = problem_file::read(&data.join("fclib").join(name)).unwrap_err();
        assert!(matches!(error, ProblemFileError::Unsupported { .. }));
        let text = error.to_string();
        assert!(text.contains(name) && text.contains(expected), "{text}");
    }
}

#[test]
fn deformable_bodies_are_condensed() {
    let Some(data) = data() else { return };
    for (name, contacts, bodies) in [("LMGC_GFC3D_CubeH8.hdf5", 1, None), ("GFC3D_TwoRods1.dat", 3, Some(2))]
    {
        let file = problem_file::read(&data.join("fclib").join(name)).unwrap();
        assert_eq!(file.form, problem_file::Form::Condensed);
        assert_eq!(file.problem.num_contacts(), contacts);
        println!("{name}: {} bodies, asymmetry {:.1e}", file.bodies, file.asymmetry);
        if let Some(bodies) = bodies {
            assert_eq!(file.bodies, bodies, "{name}");
        }
    }
}

/// Whole numbers stored as floats are read; what is no whole number is not rounded to another matrix.
#[test]
fn indices_that_are_no_whole_numbers_are_refused() {
    let read = |count: f64| {
        let mut builder = FileBuilder::new();
        let mut group = builder.create_group("fclib_local");
        group.create_dataset("spacedim").with_i32_data(&[3]);
        let mut matrix = group.create_group("W");
        for (name, data) in [("m", [3]), ("n", [3]), ("nzmax", [3])] {
            matrix.create_dataset(name).with_i32_data(&data);
        }
        matrix.create_dataset("nz").with_f64_data(&[count]);
        for name in ["p", "i"] {
            matrix.create_dataset(name).with_i32_data(&[0, 1, 2]);
        }
        matrix.create_dataset("x").with_f64_data(&[2.0, 3.0, 3.0]);
        group.add_group(matrix.finish());
        let mut vectors = group.create_group("vectors");
        vectors.create_dataset("q").with_f64_data(&[-1.0, 0.0, 0.0]);
        vectors.create_dataset("mu").with_f64_data(&[0.5]);
        group.add_group(vectors.finish());
        builder.add_group(group.finish());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("problem.hdf5");
        builder.write(&path).unwrap();
        problem_file::read(&path).map(|file| file.problem.num_contacts()).map_err(|error| error.to_string())
    };
    assert_eq!(read(3.0), Ok(1));
    for count in [f64::NAN, 2.5] {
        let error = read(count).unwrap_err();
        assert!(error.contains("W/nz") && error.contains("no whole number"), "{error}");
    }
}
