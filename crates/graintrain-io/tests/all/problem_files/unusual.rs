//! FCLIB files as people write them who have not read the report to the end: what is meant is read, and what
//! could be misread is refused.

use super::by_hand::{
    Dense, MU, Storage, add_matrix, assert_close, dot, positive_definite, random, velocity,
};
use graintrain_io::problem_file::{self, ProblemFile, ProblemFileError};
use hdf5_pure::{AttrValue, FileBuilder, GroupBuilder};

/// Writes a group of a file and reads the file.
fn written(
    name: &str,
    fill: impl FnOnce(&mut GroupBuilder, &mut GroupBuilder),
) -> Result<ProblemFile, ProblemFileError> {
    let mut builder = FileBuilder::new();
    let mut group = builder.create_group(name);
    let mut vectors = group.create_group("vectors");
    fill(&mut group, &mut vectors);
    group.add_group(vectors.finish());
    builder.add_group(group.finish());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("problem.hdf5");
    builder.write(&path).unwrap();
    problem_file::read(&path)
}

fn dimension(group: &mut GroupBuilder) {
    group.create_dataset("spacedim").with_i32_data(&[3]);
}

fn message(result: Result<ProblemFile, ProblemFileError>) -> String {
    let error = result.unwrap_err();
    format!("{error}; {}", error.remedy())
}

/// A matrix of which one triangle is stored; the diagonal always is.
fn triangle(a: &Dense, is_upper: bool) -> Dense {
    let keep = |i: usize, j: usize| i == j || (i < j) == is_upper;
    let row = |(i, row): (usize, &Vec<f64>)| {
        row.iter().enumerate().map(|(j, &x)| if keep(i, j) { x } else { 0.0 }).collect()
    };
    a.iter().enumerate().map(row).collect()
}

#[test]
fn one_triangle_of_a_symmetric_matrix_stands_for_both() {
    let (w, q) = (positive_definite(6, 1), random(1, 6, 2).remove(0));
    let g = random(1, 6, 3).remove(0);
    let expected: Vec<f64> = w.iter().zip(&q).map(|(row, q)| dot(row, &g) + q).collect();
    for is_upper in [true, false] {
        let file = written("fclib_local", |group, vectors| {
            dimension(group);
            add_matrix(group, "W", &triangle(&w, is_upper), Storage::Columns);
            vectors.create_dataset("q").with_f64_data(&q);
            vectors.create_dataset("mu").with_f64_data(&MU);
        })
        .unwrap();
        assert_close(&velocity(&file, &g), &expected, 1e-14);
        assert_eq!((file.asymmetry, file.notes().len()), (0.0, 1));
        assert!(file.notes()[0].contains("one triangle"), "{:?}", file.notes());

        // H = I and f = 0: N = M^-1.
        let unit: Dense = (0..6).map(|i| (0..6).map(|j| f64::from(u8::from(i == j))).collect()).collect();
        let global = |m: &Dense| {
            written("fclib_global", |group, vectors| {
                dimension(group);
                add_matrix(group, "M", m, Storage::Rows);
                add_matrix(group, "H", &unit, Storage::Rows);
                vectors.create_dataset("f").with_f64_data(&[0.0; 6]);
                vectors.create_dataset("w").with_f64_data(&q);
                vectors.create_dataset("mu").with_f64_data(&MU);
            })
            .unwrap()
        };
        let (whole, half) = (global(&w), global(&triangle(&w, is_upper)));
        assert_close(&velocity(&half, &g), &velocity(&whole, &g), 1e-14);
        assert!(whole.notes().is_empty() && half.notes().len() == 1);
    }
}

#[test]
fn half_of_an_equality_constraint_is_refused() {
    let (w, v, r) = (positive_definite(6, 1), random(6, 2, 4), positive_definite(2, 5));
    for (name, matrix) in [("V", &v), ("R", &r)] {
        let text = message(written("fclib_local", |group, vectors| {
            dimension(group);
            add_matrix(group, "W", &w, Storage::Columns);
            add_matrix(group, name, matrix, Storage::Columns);
            vectors.create_dataset("q").with_f64_data(&[0.1; 6]);
            vectors.create_dataset("s").with_f64_data(&[0.1; 2]);
            vectors.create_dataset("mu").with_f64_data(&MU);
        }));
        assert!(text.contains(&format!("fclib_local/{name}: stands without")), "{text}");
    }
}

#[test]
fn rolling_friction_of_contacts_with_three_rows_is_refused() {
    let text = message(written("fclib_local", |group, vectors| {
        dimension(group);
        add_matrix(group, "W", &positive_definite(6, 1), Storage::Columns);
        vectors.create_dataset("q").with_f64_data(&[0.1; 6]);
        vectors.create_dataset("mu").with_f64_data(&MU);
        vectors.create_dataset("mu_r").with_f64_data(&[0.1; 2]);
    }));
    assert!(text.contains("fclib_local/vectors/mu_r: gives coefficients of rolling friction"), "{text}");
}

/// W of two contacts with everything that FCLIB wants as data sets of one number given as attributes.
fn with_attributes(group: &mut GroupBuilder, w: &Dense) {
    let mut matrix = group.create_group("W");
    for (name, value) in [("m", 6), ("n", 6), ("nz", -1), ("nzmax", 36)] {
        matrix.set_attr(name, AttrValue::I64(value));
    }
    matrix.create_dataset("p").with_i32_data(&[0, 6, 12, 18, 24, 30, 36]);
    matrix.create_dataset("i").with_i32_data(&(0..36).map(|k| k % 6).collect::<Vec<i32>>());
    // Symmetric: by columns is by rows.
    matrix.create_dataset("x").with_f64_data(&w.concat());
    group.add_group(matrix.finish());
}

#[test]
fn sizes_may_be_attributes_and_one_coefficient_of_friction_holds_for_all() {
    let (w, q, g) = (positive_definite(6, 1), random(1, 6, 2).remove(0), random(1, 6, 3).remove(0));
    let expected: Vec<f64> = w.iter().zip(&q).map(|(row, q)| dot(row, &g) + q).collect();
    let read = |dimension: Option<i32>, mu: &[f64]| {
        written("fclib_local", |group, vectors| {
            if let Some(dimension) = dimension {
                group.set_attr("spacedim", AttrValue::I32(dimension));
            }
            with_attributes(group, &w);
            vectors.create_dataset("q").with_f64_data(&q);
            vectors.create_dataset("mu").with_f64_data(mu);
        })
    };
    for (dimension, mu, friction) in
        [(Some(3), &MU[..], MU), (None, &MU[..], MU), (Some(3), &[0.4][..], [0.4, 0.4])]
    {
        let file = read(dimension, mu).unwrap();
        assert_close(&velocity(&file, &g), &expected, 1e-14);
        assert_eq!(file.problem.friction, friction);
    }
    // Two unknowns per contact, or a single coefficient: not distinguished without the dimension.
    for (dimension, mu, expected) in [
        (Some(2), &MU[..], "two-dimensional"),
        (None, &[0.4; 3][..], "fclib_local/spacedim: is missing"),
        (None, &[0.4][..], "fclib_local/spacedim: is missing"),
        (Some(3), &[0.4; 3][..], "fclib_local/vectors/mu: 3 numbers, expected 2"),
    ] {
        let text = message(read(dimension, mu));
        assert!(text.contains(expected), "{text}");
    }
}

#[test]
fn a_file_with_both_forms_says_which_is_solved() {
    let mut builder = FileBuilder::new();
    for (name, matrices, vectors) in
        [("fclib_local", &["W"][..], &["q"][..]), ("fclib_global", &["M", "H"], &["f", "w"])]
    {
        let mut group = builder.create_group(name);
        dimension(&mut group);
        for matrix in matrices {
            add_matrix(&mut group, matrix, &positive_definite(6, 1), Storage::Triplets);
        }
        let mut part = group.create_group("vectors");
        for vector in vectors {
            part.create_dataset(vector).with_f64_data(&[0.5; 6]);
        }
        part.create_dataset("mu").with_f64_data(&MU);
        group.add_group(part.finish());
        builder.add_group(group.finish());
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("both.hdf5");
    builder.write(&path).unwrap();
    let file = problem_file::read(&path).unwrap();
    assert_eq!(file.form, problem_file::Form::Condensed);
    assert!(file.notes()[0].contains("fclib_global"), "{:?}", file.notes());
}

/// Contacts were taken out of a dump, but not out of the group of our own.
#[test]
fn an_edited_dump_is_read_without_what_no_longer_fits() {
    let mut builder = FileBuilder::new();
    let mut group = builder.create_group("fclib_local");
    dimension(&mut group);
    add_matrix(&mut group, "W", &positive_definite(6, 1), Storage::Triplets);
    let mut vectors = group.create_group("vectors");
    vectors.create_dataset("q").with_f64_data(&[0.5; 6]);
    vectors.create_dataset("mu").with_f64_data(&MU);
    group.add_group(vectors.finish());
    builder.add_group(group.finish());
    let mut own = builder.create_group("graintrain");
    own.create_dataset("version").with_i32_data(&[1]);
    own.create_dataset("velocity_scale").with_f64_data(&[0.25]);
    own.create_dataset("points").with_f64_data(&[0.0; 9]);
    builder.add_group(own.finish());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("edited.hdf5");
    builder.write(&path).unwrap();
    let file = problem_file::read(&path).unwrap();
    assert_eq!((file.problem.num_contacts(), file.problem.velocity_scale), (2, Some(0.25)));
    assert!(file.problem.points.is_empty());
    assert!(file.notes()[0].contains("tells of 3 contacts, the problem has 2"), "{:?}", file.notes());
}

#[test]
fn a_transposed_jacobian_is_named() {
    let text = message(written("fclib_global", |group, vectors| {
        dimension(group);
        add_matrix(group, "M", &positive_definite(12, 1), Storage::Columns);
        add_matrix(group, "H", &random(6, 12, 2), Storage::Columns);
        vectors.create_dataset("f").with_f64_data(&[0.0; 12]);
        vectors.create_dataset("w").with_f64_data(&[0.1; 6]);
        vectors.create_dataset("mu").with_f64_data(&MU);
    }));
    assert!(text.contains("fclib_global/H: a 6 x 12 matrix, expected 12 x"), "{text}");
}
