//! Reading the public contact problems: sizes, symmetry and form against the reference computed independently
//! of this program.

mod by_hand;
mod damage;
mod dumps;
mod exact;
mod rolling;
mod unusual;

use graintrain_io::problem_file::{self, Form};
use graintrain_testdata::public_data;
use std::path::PathBuf;

/// The folder of public data.
fn data() -> Option<PathBuf> {
    public_data("")
}

/// A line of the reference.
struct Reference {
    path: PathBuf,
    contacts: usize,
    nonzeros: usize,
    asymmetry: f64,
}

fn references() -> Vec<Reference> {
    let Some(data) = data() else { return Vec::new() };
    let text = std::fs::read_to_string(data.join("ccp/reference.csv")).unwrap();
    text.lines()
        .skip(1)
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            let folder = if fields[0].starts_with("sed") { "ccp" } else { "fclib" };
            Reference {
                path: data.join(folder).join(fields[0]),
                contacts: fields[1].parse().unwrap(),
                nonzeros: fields[3].parse().unwrap(),
                asymmetry: fields[6].parse().unwrap(),
            }
        })
        .collect()
}

#[test]
fn sizes_and_symmetry_agree_with_the_reference() {
    for reference in references() {
        let name = reference.path.file_name().unwrap().to_string_lossy().into_owned();
        let file = problem_file::read(&reference.path).unwrap();
        let assembled = file.problem.delassus.assemble();
        let largest = assembled.blocks().iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
        let nonzeros = assembled.blocks().iter().flatten().filter(|x| **x != 0.0).count();
        println!(
            "{name}: {} contacts, {:?}, {} bodies, {nonzeros} nonzeros (reference {}), largest {largest:.3e}, \
             asymmetry {:.2e} (reference {:.1e}), title '{}', {} points",
            file.problem.num_contacts(),
            file.form,
            file.bodies,
            reference.nonzeros,
            file.asymmetry,
            reference.asymmetry,
            file.title,
            file.problem.points.len(),
        );
        assert_eq!(file.problem.num_contacts(), reference.contacts, "{name}");
        assert!(assembled.asymmetry() < 1e-15, "{name}");
        if file.form == Form::Local {
            assert_eq!(nonzeros, reference.nonzeros, "{name}");
            let rounded = format!("{:.1e}", file.asymmetry).parse::<f64>().unwrap();
            assert!((rounded - reference.asymmetry).abs() <= 0.11 * reference.asymmetry.max(1e-12), "{name}");
        } else {
            // The frames in the sphere stack are not orthonormal (tangents off by up to 0.56): no rigid
            // bodies.
            let condensed = name.starts_with("Spheres-i099");
            let expected = if condensed { Form::Condensed } else { Form::RigidBodies };
            assert_eq!(file.form, expected, "{name}");
            // Entries that are zero but for rounding may differ.
            assert!(nonzeros.abs_diff(reference.nonzeros) * 50 < reference.nonzeros, "{name}");
        }
    }
}
