//! FCLIB files written by hand, in every storage, and what they must mean, by dense linear algebra.

use graintrain_io::problem_file::{self, Form, ProblemFile};
use hdf5_pure::{FileBuilder, GroupBuilder};
use proptest::prelude::Rng as _;
use proptest::test_runner::{RngAlgorithm, TestRng};

/// A dense matrix by rows.
pub(crate) type Dense = Vec<Vec<f64>>;

/// How a matrix is stored in the file.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Storage {
    Columns,
    Rows,
    /// i rows, p columns, as CSparse has it; the last entry is split in two.
    Triplets,
    /// p rows, i columns, as `fclib.h` has it.
    SwappedTriplets,
}

fn signed(seed: u8) -> impl FnMut() -> f64 {
    let mut rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[seed; 32]);
    move || (rng.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

pub(crate) fn random(rows: usize, columns: usize, seed: u8) -> Dense {
    let mut next = signed(seed);
    (0..rows).map(|_| (0..columns).map(|_| next()).collect()).collect()
}

fn transposed(a: &Dense) -> Dense {
    (0..a[0].len()).map(|j| a.iter().map(|row| row[j]).collect()).collect()
}

fn product(a: &Dense, b: &Dense) -> Dense {
    let columns = transposed(b);
    a.iter().map(|row| columns.iter().map(|column| dot(row, column)).collect()).collect()
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A A^T + I.
pub(crate) fn positive_definite(size: usize, seed: u8) -> Dense {
    let a = random(size, size, seed);
    let mut square = product(&a, &transposed(&a));
    for (k, row) in square.iter_mut().enumerate() {
        row[k] += 1.0;
    }
    square
}

/// Solves A x = b by Gaussian elimination with partial pivoting.
pub(crate) fn solve(a: &Dense, b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let mut rows: Dense = a.iter().zip(b).map(|(row, &b)| row.iter().copied().chain([b]).collect()).collect();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| rows[i][k].abs().total_cmp(&rows[j][k].abs())).unwrap();
        rows.swap(k, pivot);
        for i in k + 1..n {
            let factor = rows[i][k] / rows[k][k];
            for j in k..=n {
                rows[i][j] -= factor * rows[k][j];
            }
        }
    }
    let mut x = vec![0.0; n];
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|j| rows[i][j] * x[j]).sum();
        x[i] = (rows[i][n] - sum) / rows[i][i];
    }
    x
}

pub(crate) fn add_matrix(group: &mut GroupBuilder, name: &str, a: &Dense, storage: Storage) {
    let (rows, columns) = (a.len(), a[0].len());
    let mut entries: Vec<(usize, usize, f64)> = Vec::new();
    for (i, row) in a.iter().enumerate() {
        entries.extend(row.iter().enumerate().filter(|(_, x)| **x != 0.0).map(|(j, &x)| (i, j, x)));
    }
    let starts = |major: fn(&(usize, usize, f64)) -> usize, count: usize| -> Vec<i32> {
        (0..=count).map(|k| entries.iter().filter(|entry| major(entry) < k).count() as i32).collect()
    };
    let (nz, p, i) = match storage {
        Storage::Rows => (-2, starts(|e| e.0, rows), entries.iter().map(|e| e.1 as i32).collect()),
        Storage::Columns => {
            entries.sort_by_key(|e| (e.1, e.0));
            let starts: Vec<i32> =
                (0..=columns).map(|k| entries.iter().filter(|e| e.1 < k).count() as i32).collect();
            (-1, starts, entries.iter().map(|e| e.0 as i32).collect::<Vec<_>>())
        }
        Storage::Triplets | Storage::SwappedTriplets => {
            let (row, column, value) = entries.pop().unwrap();
            entries.extend([(row, column, 0.25 * value), (row, column, 0.75 * value)]);
            let rows: Vec<i32> = entries.iter().map(|e| e.0 as i32).collect();
            let columns: Vec<i32> = entries.iter().map(|e| e.1 as i32).collect();
            let swapped = matches!(storage, Storage::SwappedTriplets);
            let (p, i) = if swapped { (rows, columns) } else { (columns, rows) };
            (entries.len() as i32, p, i)
        }
    };
    let values: Vec<f64> = entries.iter().map(|e| e.2).collect();
    let mut part = group.create_group(name);
    for (field, value) in
        [("m", rows as i32), ("n", columns as i32), ("nz", nz), ("nzmax", values.len() as i32)]
    {
        part.create_dataset(field).with_i32_data(&[value]);
    }
    part.create_dataset("p").with_i32_data(&p);
    part.create_dataset("i").with_i32_data(&i);
    part.create_dataset("x").with_f64_data(&values);
    group.add_group(part.finish());
}

/// Writes a problem of form `name` and reads it.
fn through_file(
    name: &str,
    matrices: &[(&str, &Dense)],
    vectors: &[(&str, &[f64])],
    storage: Storage,
) -> ProblemFile {
    let mut builder = FileBuilder::new();
    let mut group = builder.create_group(name);
    group.create_dataset("spacedim").with_i32_data(&[3]);
    for (name, matrix) in matrices {
        add_matrix(&mut group, name, matrix, storage);
    }
    let mut part = group.create_group("vectors");
    for (name, vector) in vectors {
        part.create_dataset(name).with_f64_data(vector);
    }
    group.add_group(part.finish());
    builder.add_group(group.finish());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("problem.hdf5");
    builder.write(&path).unwrap();
    problem_file::read(&path).unwrap()
}

/// u = N g + r of a problem.
pub(crate) fn velocity(file: &ProblemFile, g: &[f64]) -> Vec<f64> {
    let delassus = &file.problem.delassus;
    let mut u = vec![0.0; g.len()];
    delassus.multiply(g, &mut u, &mut delassus.work());
    u.iter().zip(&file.problem.r).map(|(u, r)| u + r).collect()
}

pub(crate) fn assert_close(a: &[f64], b: &[f64], tolerance: f64) {
    let scale = b.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() <= tolerance * scale, "{a} {b}");
    }
}

pub(crate) const MU: [f64; 2] = [0.3, 0.8];

#[test]
fn local_form_means_u_is_w_r_plus_q_in_every_storage() {
    let (w, q) = (positive_definite(6, 1), random(1, 6, 2).remove(0));
    let g = random(1, 6, 3).remove(0);
    let expected: Vec<f64> = w.iter().zip(&q).map(|(row, q)| dot(row, &g) + q).collect();
    for storage in [Storage::Columns, Storage::Rows, Storage::Triplets, Storage::SwappedTriplets] {
        let file = through_file("fclib_local", &[("W", &w)], &[("q", &q), ("mu", &MU)], storage);
        assert_eq!((file.form, &file.problem.friction[..]), (Form::Local, &MU[..]));
        assert_close(&velocity(&file, &g), &expected, 1e-14);
    }
}

#[test]
fn local_equality_constraints_are_eliminated() {
    let (w, v, q, s) = (positive_definite(6, 1), random(6, 2, 4), random(1, 6, 2).remove(0), [0.4, -0.7]);
    let g = random(1, 6, 3).remove(0);
    for sign in [1.0, -1.0] {
        let r: Dense =
            positive_definite(2, 5).iter().map(|row| row.iter().map(|x| sign * x).collect()).collect();
        // R lambda = -(V^T g + s), u = W g + V lambda + q.
        let right: Vec<f64> = transposed(&v).iter().zip(&s).map(|(column, s)| -dot(column, &g) - s).collect();
        let lambda = solve(&r, &right);
        let expected: Vec<f64> = (0..6).map(|k| dot(&w[k], &g) + dot(&v[k], &lambda) + q[k]).collect();
        let file = through_file(
            "fclib_local",
            &[("W", &w), ("V", &v), ("R", &r)],
            &[("q", &q), ("s", &s), ("mu", &MU)],
            Storage::Triplets,
        );
        assert_close(&velocity(&file, &g), &expected, 1e-13);
    }
}

/// u of a global problem for impulses g, by one dense solve of [M -G; G^T 0].
fn global_velocity(m: &Dense, h: &Dense, gm: &Dense, f: &[f64], b: &[f64], w: &[f64], g: &[f64]) -> Vec<f64> {
    let (n, p) = (f.len(), b.len());
    let mut a = vec![vec![0.0; n + p]; n + p];
    let mut right = vec![0.0; n + p];
    for i in 0..n {
        a[i][..n].copy_from_slice(&m[i]);
        right[i] = dot(&h[i], g) + f[i];
        for k in 0..p {
            a[i][n + k] = -gm[i][k];
            a[n + k][i] = gm[i][k];
        }
    }
    for k in 0..p {
        right[n + k] = -b[k];
    }
    let v = solve(&a, &right);
    transposed(h).iter().zip(w).map(|(column, w)| dot(column, &v[..n]) + w).collect()
}

#[test]
fn global_form_is_condensed_with_and_without_equality_constraints() {
    let (m, h, gm) = (positive_definite(8, 6), random(8, 6, 7), random(8, 2, 8));
    let (f, w, b, g) =
        (random(1, 8, 9).remove(0), random(1, 6, 10).remove(0), [0.3, -0.2], random(1, 6, 11).remove(0));
    for storage in [Storage::Columns, Storage::Rows, Storage::Triplets, Storage::SwappedTriplets] {
        let vectors: [(&str, &[f64]); 4] = [("f", &f), ("w", &w), ("b", &b), ("mu", &MU)];
        let free = through_file("fclib_global", &[("M", &m), ("H", &h)], &vectors, storage);
        assert_eq!((free.form, free.bodies), (Form::Condensed, 1));
        let none = vec![Vec::new(); 8];
        assert_close(&velocity(&free, &g), &global_velocity(&m, &h, &none, &f, &[], &w, &g), 1e-12);
        let bound = through_file("fclib_global", &[("M", &m), ("H", &h), ("G", &gm)], &vectors, storage);
        assert_close(&velocity(&bound, &g), &global_velocity(&m, &h, &gm, &f, &b, &w, &g), 1e-12);
    }
}

/// Rotation about an axis (Rodrigues), by rows.
fn rotation(axis: [f64; 3], angle: f64) -> [[f64; 3]; 3] {
    let length = dot(&axis, &axis).sqrt();
    let [x, y, z] = axis.map(|a| a / length);
    let (s, c) = angle.sin_cos();
    let k = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let square: f64 = (0..3).map(|l| k[i][l] * k[l][j]).sum();
            f64::from(u8::from(i == j)) + s * k[i][j] + (1.0 - c) * square
        })
    })
}

#[test]
fn rigid_bodies_are_recognised_with_angular_velocities_in_world_and_in_body_axes() {
    let mut next = signed(12);
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let attitudes: Vec<[[f64; 3]; 3]> =
        (0..3).map(|_| rotation([next(), next(), next()], 3.0 * next())).collect();
    for body_axes in [false, true] {
        // Contacts 0-1 (twice), 1-2, 2 alone, 0-2.
        let pairs = [(0, Some(1)), (1, Some(0)), (1, Some(2)), (2, None), (0, Some(2))];
        let contacts = pairs.len();
        let mut h = vec![vec![0.0; 3 * contacts]; 18];
        for (i, &(a, b)) in pairs.iter().enumerate() {
            let frame = rotation([next(), next(), next()], 3.0 * next());
            let sides = [(Some(a), 1.0, [next(), next(), next()]), (b, -1.0, [next(), next(), next()])];
            for (body, sign, arm) in sides {
                let Some(body) = body else { continue };
                let attitude = &attitudes[body];
                for (k, axis) in frame.iter().enumerate() {
                    let moment = cross(arm, *axis);
                    for l in 0..3 {
                        h[6 * body + l][3 * i + k] = sign * axis[l];
                        h[6 * body + 3 + l][3 * i + k] = sign
                            * if body_axes {
                                (0..3).map(|c| attitude[c][l] * moment[c]).sum()
                            } else {
                                moment[l]
                            };
                    }
                }
            }
        }
        let mut m = vec![vec![0.0; 18]; 18];
        for body in 0..3 {
            let inertia = positive_definite(3, 20 + body as u8);
            for k in 0..3 {
                m[6 * body + k][6 * body + k] = 1.5 + body as f64;
                m[6 * body + 3 + k][6 * body + 3..6 * body + 6].copy_from_slice(&inertia[k]);
            }
        }
        let (f, w) = (random(1, 18, 13).remove(0), random(1, 3 * contacts, 14).remove(0));
        let mu = vec![0.4; contacts];
        let file = through_file(
            "fclib_global",
            &[("M", &m), ("H", &h)],
            &[("f", &f), ("w", &w), ("mu", &mu)],
            Storage::Triplets,
        );
        assert_eq!((file.form, file.bodies), (Form::RigidBodies, 3), "body axes: {body_axes}");
        let g = random(1, 3 * contacts, 15).remove(0);
        let none = vec![Vec::new(); 18];
        assert_close(&velocity(&file, &g), &global_velocity(&m, &h, &none, &f, &[], &w, &g), 1e-12);
    }
}
