//! Writes contact problems as FCLIB files that other programs read, and reads back exactly what FCLIB cannot
//! say.
//!
//! A problem over rigid bodies becomes the global form: M block diagonal, H = D, f = 0 and w = r, so that W =
//! H^T M^-1 H = N and q = w + H^T M^-1 f = r. A prescribed degree of freedom has no finite mass: its row of H
//! is set to zero and its mass to 1, which leaves N what it is. Any other problem becomes the local form, W =
//! N, q = r (joints are eliminated in it); with rolling friction the local form of five rows per contact,
//! `fclib_local_rolling`.
//!
//! Beside the FCLIB group stands the group `graintrain`, which FCLIB readers ignore:
//!
//! | data set | holds |
//! |---|---|
//! | `version` | 1 |
//! | `velocity_scale` | V of the residual, m/s (absent where not known) |
//! | `points` | contact points, 3 per contact, m (absent where not known) |
//! | `identity` | a number per contact that persists from step to step (absent where not known) |
//! | `body_a`, `body_b` | body of each side, -1 for an immovable one |
//! | `frame` | n, t1, t2 in world axes, 9 per contact |
//! | `arm_a`, `arm_b` | contact point minus centre of mass, 3 per contact, m |
//! | `inverse_mass`, `inverse_inertia` | 3 per body, 1/kg, and 9 per body, 1/(kg m^2), world axes |
//!
//! The bodies are taken from there only where they reproduce the M and H of the FCLIB group: a file whose
//! FCLIB part was edited is read as edited.

use super::error::{COPY_AGAIN, Defect, ProblemFileError};
use super::fclib::Group;
use super::matrix::{Entry, Matrix};
use super::raw::{Extras, GlobalForm, RawProblem};
use super::rigid::invert;
use super::rolling;
use crate::files::write_atomically;
use graintrain_ccp::{BodyInverseMass, Ccp, Delassus, FIXED, RigidContact, RigidDelassus};
use hdf5_pure::{File, FileBuilder, FormatError};
use std::path::Path;

/// Name of the group of our own.
const GROUP: &str = "graintrain";
/// Version of its contents.
const VERSION: i32 = 1;

/// Writes a problem as an FCLIB file; the file appears whole or not at all.
///
/// # Errors
/// [`ProblemFileError::Io`], or [`ProblemFileError::Unsupported`] for more than 2^31 entries.
pub fn write(path: &Path, problem: &Ccp, title: &str) -> Result<(), ProblemFileError> {
    let bytes = encode(problem, title).map_err(|defect| defect.in_file(path))?;
    write_atomically(path, &bytes)
        .map_err(|error| ProblemFileError::Io { path: path.to_path_buf(), source: error.into_source() })
}

fn encode(problem: &Ccp, title: &str) -> Result<Vec<u8>, Defect> {
    let rolling = if problem.turning.is_empty() { None } else { Some(rolling::gather(problem)?) };
    let refused =
        |error: FormatError| Defect::unsupported(error.to_string(), "give the problem another title");
    let mut builder = FileBuilder::new();
    let forms = match &*problem.delassus {
        Delassus::Rigid(rigid) if rolling.is_none() && rigid.is_plain() => mass_and_jacobian(rigid),
        _ => None,
    };
    let mut group = builder.create_group(match (&forms, &rolling) {
        (Some(_), _) => "fclib_global",
        (None, None) => "fclib_local",
        (None, Some(_)) => "fclib_local_rolling",
    });
    group.create_dataset("spacedim").with_i32_data(&[if rolling.is_some() { 5 } else { 3 }]);
    let mut info = group.create_group("info");
    let ascii: String = title.chars().filter(|c| (' '..='~').contains(c)).collect();
    let texts = [("title", ascii.as_str()), ("description", "written by graintrain"), ("math_info", "")];
    for (name, text) in texts {
        // One byte more: readers in C expect the closing zero.
        let width = u32::try_from(text.len() + 1).unwrap_or(u32::MAX);
        info.create_dataset(name).with_ascii_strings_sized(&[text], width).map_err(refused)?.with_shape(&[]);
    }
    group.add_group(info.finish());
    let mut vectors = group.create_group("vectors");
    vectors.create_dataset("mu").with_f64_data(&problem.friction);
    match (&forms, &rolling) {
        (None, Some(rolling)) => {
            vectors.create_dataset("mu_r").with_f64_data(&rolling.mu_r);
            vectors.create_dataset("q").with_f64_data(&rolling.q);
            add_triplets(&mut group, "W", &rolling.w)?;
        }
        (Some((m, h)), _) => {
            vectors.create_dataset("f").with_f64_data(&vec![0.0; m.rows]);
            vectors.create_dataset("w").with_f64_data(&problem.r);
            add_triplets(&mut group, "M", m)?;
            add_triplets(&mut group, "H", h)?;
        }
        (None, None) => {
            vectors.create_dataset("q").with_f64_data(&problem.r);
            add_triplets(&mut group, "W", &scalar_entries(problem)?)?;
        }
    }
    group.add_group(vectors.finish());
    builder.add_group(group.finish());

    let mut own = builder.create_group(GROUP);
    own.create_dataset("version").with_i32_data(&[VERSION]);
    if let Some(scale) = problem.velocity_scale {
        own.create_dataset("velocity_scale").with_f64_data(&[scale]);
    }
    if !problem.points.is_empty() {
        own.create_dataset("points").with_f64_data(problem.points.as_flattened());
    }
    if !problem.identity.is_empty() {
        own.create_dataset("identity").with_u64_data(&problem.identity);
    }
    if let (Delassus::Rigid(rigid), Some(_)) = (&*problem.delassus, &forms) {
        let contacts = rigid.contacts();
        let body = |body: u32| if body == FIXED { -1 } else { i64::from(body) };
        let numbers =
            |of: fn(&RigidContact) -> &[f64]| contacts.iter().flat_map(of).copied().collect::<Vec<f64>>();
        let side = |of: fn(&RigidContact) -> u32| contacts.iter().map(|c| body(of(c))).collect::<Vec<i64>>();
        own.create_dataset("body_a").with_i64_data(&side(|c| c.body_a));
        own.create_dataset("body_b").with_i64_data(&side(|c| c.body_b));
        own.create_dataset("frame").with_f64_data(&numbers(|c| c.frame.as_flattened()));
        own.create_dataset("arm_a").with_f64_data(&numbers(|c| &c.arm_a));
        own.create_dataset("arm_b").with_f64_data(&numbers(|c| &c.arm_b));
        let inverse = rigid.inverse_mass();
        let linear: Vec<f64> = inverse.iter().flat_map(|body| body.linear).collect();
        let angular: Vec<f64> = inverse.iter().flat_map(|body| body.angular).collect();
        own.create_dataset("inverse_mass").with_f64_data(&linear);
        own.create_dataset("inverse_inertia").with_f64_data(&angular);
    }
    builder.add_group(own.finish());
    builder.finish().map_err(|error| {
        Defect::unsupported(
            format!("the problem cannot be written as HDF5: {error}"),
            "write a smaller problem",
        )
    })
}

/// N as scalar entries.
fn scalar_entries(problem: &Ccp) -> Result<Matrix, Defect> {
    let matrix = problem.delassus.assemble();
    let mut entries = Vec::with_capacity(9 * matrix.num_blocks());
    for i in 0..matrix.num_rows() {
        let (columns, blocks) = matrix.row(i);
        for (&j, block) in columns.iter().zip(blocks) {
            entries.extend((0..9).map(|k| Entry {
                row: 3 * i + k / 3,
                column: 3 * j as usize + k % 3,
                value: block[k],
            }));
        }
    }
    Matrix::new("N", 3 * matrix.num_rows(), 3 * matrix.num_rows(), entries)
}

/// Adds a matrix as triplets: `i` rows, `p` columns.
fn add_triplets(group: &mut hdf5_pure::GroupBuilder, name: &str, matrix: &Matrix) -> Result<(), Defect> {
    let int = |value: usize| {
        i32::try_from(value).map_err(|_| {
            let what = format!("matrix {name} has a size or an index of {value}, FCLIB holds at most 2^31");
            Defect::unsupported(what, "write a smaller problem")
        })
    };
    let indices = |of: fn(&Entry) -> usize| {
        matrix.entries.iter().map(|entry| int(of(entry))).collect::<Result<Vec<i32>, Defect>>()
    };
    let count = int(matrix.entries.len())?;
    let values: Vec<f64> = matrix.entries.iter().map(|entry| entry.value).collect();
    let mut part = group.create_group(name);
    let sizes = [("nzmax", count), ("m", int(matrix.rows)?), ("n", int(matrix.columns)?), ("nz", count)];
    for (field, value) in sizes {
        part.create_dataset(field).with_i32_data(&[value]);
    }
    part.create_dataset("p").with_i32_data(&indices(|entry| entry.column)?);
    part.create_dataset("i").with_i32_data(&indices(|entry| entry.row)?);
    part.create_dataset("x").with_f64_data(&values);
    group.add_group(part.finish());
    Ok(())
}

/// M and H = D of rigid bodies; `None` where an inverse inertia is singular other than by prescribed world
/// axes.
fn mass_and_jacobian(rigid: &RigidDelassus) -> Option<(Matrix, Matrix)> {
    let freedoms = 6 * rigid.num_bodies();
    let mut moves = vec![true; freedoms];
    let mut mass = Vec::new();
    for (body, inverse) in rigid.inverse_mass().iter().enumerate() {
        let first = 6 * body;
        for axis in 0..3 {
            moves[first + axis] = inverse.linear[axis] != 0.0;
            let value = if moves[first + axis] { 1.0 / inverse.linear[axis] } else { 1.0 };
            mass.push(Entry { row: first + axis, column: first + axis, value });
        }
        let mut angular = [[0.0; 3]; 3];
        for i in 0..3 {
            angular[i].copy_from_slice(&inverse.angular[3 * i..3 * i + 3]);
        }
        for axis in 0..3 {
            moves[first + 3 + axis] = (0..3).any(|k| angular[axis][k] != 0.0);
            if !moves[first + 3 + axis] {
                angular[axis][axis] = 1.0;
            }
        }
        let inertia = invert(&angular)?;
        for (i, row) in inertia.iter().enumerate() {
            for (j, &value) in row.iter().enumerate() {
                mass.push(Entry { row: first + 3 + i, column: first + 3 + j, value });
            }
        }
    }
    let mut jacobian = Vec::new();
    for (i, contact) in rigid.contacts().iter().enumerate() {
        for (body, sign, arm) in [(contact.body_a, 1.0, contact.arm_a), (contact.body_b, -1.0, contact.arm_b)]
        {
            if body == FIXED {
                continue;
            }
            for (k, axis) in contact.frame.iter().enumerate() {
                let moment = [
                    arm[1] * axis[2] - arm[2] * axis[1],
                    arm[2] * axis[0] - arm[0] * axis[2],
                    arm[0] * axis[1] - arm[1] * axis[0],
                ];
                for (offset, value) in axis.iter().chain(&moment).enumerate() {
                    let row = 6 * body as usize + offset;
                    if moves[row] {
                        jacobian.push(Entry { row, column: 3 * i + k, value: sign * value });
                    }
                }
            }
        }
    }
    let m = Matrix::new("M", freedoms, freedoms, mass).ok()?;
    let h = Matrix::new("H", freedoms, 3 * rigid.num_contacts(), jacobian).ok()?;
    Some((m, h))
}

/// Reads the group of our own, where there is one.
pub(super) fn read_extras(file: &File, problem: &RawProblem) -> Result<Extras, Defect> {
    let has_group = file.root().groups().is_ok_and(|groups| groups.iter().any(|name| name == GROUP));
    if !has_group {
        return Ok(Extras::default());
    }
    let group = Group { file, path: GROUP };
    let version = group.integers("version")?.first().copied();
    if version != Some(i64::from(VERSION)) {
        let what = format!("a dump of version {version:?}");
        return Err(Defect::unsupported(what, "read it with the version of graintrain that wrote it"));
    }
    let names = file.group(GROUP).and_then(|group| group.datasets()).unwrap_or_default();
    let has = |name: &str| names.iter().any(|other| other == name);
    let numbers = |name: &str| if has(name) { group.numbers(name) } else { Ok(Vec::new()) };
    let identity = if has("identity") {
        let data = file.dataset(&format!("{GROUP}/identity")).and_then(|dataset| dataset.read_u64());
        data.map_err(|error| super::fclib::damaged("graintrain/identity", &error))?
    } else {
        Vec::new()
    };
    let points = triples(&numbers("points")?);
    let velocity_scale = numbers("velocity_scale")?.first().copied();
    if points.iter().flatten().chain(&velocity_scale).any(|x| !x.is_finite()) {
        return Err(Defect::damaged("graintrain", "holds numbers that are not finite", COPY_AGAIN));
    }
    let contacts = match problem {
        RawProblem::Local(local) => local.friction.len(),
        RawProblem::Global(global) => global.friction.len(),
    };
    let counts = [(has("points"), points.len()), (has("identity"), identity.len())];
    let bodies = match problem {
        RawProblem::Global(global) if has("body_a") => read_bodies(&group, global)?,
        _ => None,
    };
    let has_bodies = has("body_a");
    if let Some((_, count)) = counts.into_iter().find(|&(is_given, count)| is_given && count != contacts) {
        let remark = format!(
            "the group {GROUP} tells of {count} contacts, the problem has {contacts}: taken as edited, without that group"
        );
        return Ok(Extras { velocity_scale, remark: Some(remark), ..Extras::default() });
    }
    let remark = (has_bodies && bodies.is_none())
        .then(|| format!("the bodies of the group {GROUP} do not reproduce the problem: taken as edited"));
    Ok(Extras { velocity_scale, points, identity, bodies, remark })
}

/// The bodies, where they reproduce the FCLIB part.
fn read_bodies(group: &Group<'_>, global: &GlobalForm) -> Result<Option<RigidDelassus>, Defect> {
    let (body_a, body_b) = (group.integers("body_a")?, group.integers("body_b")?);
    let (frame, arm_a, arm_b) =
        (group.numbers("frame")?, triples(&group.numbers("arm_a")?), triples(&group.numbers("arm_b")?));
    let linear = triples(&group.numbers("inverse_mass")?);
    let angular = group.numbers("inverse_inertia")?;
    let (contacts, bodies) = (body_a.len(), linear.len());
    let body_exists = |&body: &i64| body == -1 || (0..bodies as i64).contains(&body);
    let sound = [body_b.len(), arm_a.len(), arm_b.len()].iter().all(|&n| n == contacts)
        && frame.len() == 9 * contacts
        && angular.len() == 9 * bodies
        && body_a.iter().chain(&body_b).all(body_exists)
        && frame.iter().chain(&angular).all(|x| x.is_finite())
        && arm_a.iter().chain(&arm_b).chain(&linear).flatten().all(|x| x.is_finite());
    if !sound {
        return Err(Defect::damaged(GROUP, "its data sets do not fit each other", COPY_AGAIN));
    }
    if contacts != global.friction.len() {
        return Ok(None);
    }
    let body = |body: i64| u32::try_from(body).unwrap_or(FIXED);
    let contacts = (0..contacts)
        .map(|i| {
            let row = |k: usize| std::array::from_fn(|axis| frame[9 * i + 3 * k + axis]);
            RigidContact {
                body_a: body(body_a[i]),
                body_b: body(body_b[i]),
                frame: [row(0), row(1), row(2)],
                arm_a: arm_a[i],
                arm_b: arm_b[i],
            }
        })
        .collect();
    let inverse = linear
        .iter()
        .enumerate()
        .map(|(b, &linear)| BodyInverseMass { linear, angular: std::array::from_fn(|k| angular[9 * b + k]) })
        .collect();
    let rigid = RigidDelassus::new(contacts, inverse);
    let same = mass_and_jacobian(&rigid).is_some_and(|(m, h)| m == global.m && h == global.h);
    Ok((same && global.f.iter().all(|&f| f == 0.0)).then_some(rigid))
}

fn triples(numbers: &[f64]) -> Vec<[f64; 3]> {
    numbers.chunks_exact(3).map(|x| [x[0], x[1], x[2]]).collect()
}
