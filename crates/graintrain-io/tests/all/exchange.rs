//! Formats of other programs: what is written is read again; mutated files give messages, never a panic.

use graintrain::math::Vec3;
use graintrain_ccp::FrictionModel;
use graintrain_io::output::exchange::{Array, Snapshot};
use graintrain_io::problem_file;
use graintrain_io::scene::Scene;
use std::path::Path;

fn snapshot(count: usize, time: f64) -> Snapshot {
    let number = |k: usize, j: usize| ((7 * k + 3 * j) % 11) as f64 * 0.37 + 1e-3 * k as f64;
    let array = |name, components, is_whole| Array {
        name,
        components,
        is_whole,
        values: (0..count * components)
            .map(|i| if is_whole { (i % 5) as f64 } else { 0.1 + number(i / components, i % components) })
            .collect(),
    };
    Snapshot {
        time,
        step: (1e3 * time) as u64,
        position: (0..count).map(|k| Vec3::new(k as f64 * 9.0, number(k, 1), -number(k, 2))).collect(),
        arrays: vec![
            Array { values: (0..count).map(|k| k as f64).collect(), ..array("id", 1, true) },
            array("type", 1, true),
            array("contacts", 1, true),
            array("radius", 1, false),
            array("mass", 1, false),
            array("v", 3, false),
            array("omega", 3, false),
            array("quat", 4, false),
            array("f", 3, false),
        ],
        cell: None,
    }
}

/// The files of two frames, with the keys of the packing that reads them.
fn files() -> [(&'static str, Vec<u8>, &'static str); 5] {
    let frames = [snapshot(3, 0.0), snapshot(5, 0.25)];
    let [mut lammps, mut xyz, mut yade] = [const { Vec::new() }; 3];
    for frame in &frames {
        frame.write_lammps(&mut lammps).unwrap();
        frame.write_xyz(&mut xyz).unwrap();
    }
    frames[1].write_yade(&mut yade).unwrap();
    let mut mercury = String::new();
    for frame in &frames {
        let radius = &frame.array("radius").unwrap().values;
        let v = &frame.array("v").unwrap().values;
        mercury += &format!("{} {} 0 0 0 1 1 1\n", frame.position.len(), frame.time);
        for (k, p) in frame.position.iter().enumerate() {
            mercury += &format!(
                "{:?} {:?} {:?} {:?} {:?} {:?} ",
                p.x,
                p.y,
                p.z,
                v[3 * k],
                v[3 * k + 1],
                v[3 * k + 2]
            );
            mercury += &format!("{:?} 0 0 0 0 0 0 0\n", radius[k]);
        }
    }
    let restart = "restart_version 1.0\nParticles 2\nSphericalParticle id 0 position 0 0 0 velocity 0 0 0 radius 1\nSphericalParticle \
                   id 1 position 9 0 0 velocity 1 2 3 radius 2\n";
    [
        ("a.dump", lammps, ""),
        ("a.xyz", xyz, ""),
        ("a.txt", yade, ", format = \"yade\""),
        ("a.data", mercury.into_bytes(), ""),
        ("a.restart", restart.into(), ""),
    ]
}

fn build(folder: &Path, name: &str, keys: &str) -> Result<graintrain::world::World, String> {
    let path = folder.join(name);
    let text = format!("[time]\nstep = 0.01\nsteps = 1\n[packing.p]\nfile = {{ path = {path:?}{keys} }}\n");
    let scene = Scene::parse("a", "a.toml", &text, Path::new(""), &[]).map_err(|error| error.to_string())?;
    Ok(scene.build().map_err(|error| error.to_string())?.world)
}

#[test]
fn what_is_written_is_read_again_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, keys) in files() {
        std::fs::write(folder.path().join(name), &bytes).unwrap();
        let world = build(folder.path(), name, keys).unwrap();
        if name == "a.restart" {
            assert_eq!(world.bodies.velocity[1], Vec3::new(1.0, 2.0, 3.0));
            continue;
        }
        let frame = snapshot(5, 0.25);
        assert_eq!(world.bodies.position, frame.position, "{name}");
        let radius = &frame.array("radius").unwrap().values;
        for (body, radius) in radius.iter().enumerate() {
            let geometry = &world.geometries[world.bodies.geometry[body].index()];
            assert_eq!(geometry.bounding_radius(), *radius, "{name}");
        }
        if name != "a.txt" {
            let v = &frame.array("v").unwrap().values;
            assert_eq!(world.bodies.velocity[4], Vec3::from_slice(&v[12..]), "{name}");
            let first = build(folder.path(), name, ", frame = 0").unwrap();
            assert_eq!(first.bodies.position, snapshot(3, 0.0).position, "{name}");
            let error = build(folder.path(), name, ", frame = 2").unwrap_err();
            assert!(error.contains("no frame 2"), "{error}");
        }
    }
    let error = build(folder.path(), "a.txt", ", frame = 0").unwrap_err();
    assert!(error.contains("several frames"), "{error}");
}

/// Numbers of this test: always the same.
struct Draw(u64);

impl Draw {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % n.max(1)
    }

    fn mutate(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut altered = bytes.to_vec();
        for _ in 0..=self.below(3) {
            let at = self.below(altered.len());
            match self.below(5) {
                0 => altered.truncate(at),
                1 if at < altered.len() => altered[at] ^= 1 << self.below(8),
                2 if at < altered.len() => altered[at] = b"09-eE. \n:#\xff\0"[self.below(12)],
                3 if at < altered.len() => {
                    altered.remove(at);
                }
                _ => altered.splice(at..at, *b"99999999999").for_each(drop),
            }
        }
        altered
    }
}

#[test]
fn mutated_files_of_spheres_give_messages() {
    let folder = tempfile::tempdir().unwrap();
    let mut draw = Draw(5);
    for (name, bytes, keys) in files() {
        let mut refused = 0;
        for _ in 0..5000 {
            std::fs::write(folder.path().join(name), draw.mutate(&bytes)).unwrap();
            if let Err(error) = build(folder.path(), name, keys) {
                refused += 1;
                let reported = [name, "overlap", "the radius of a sphere"];
                assert!(reported.iter().any(|what| error.contains(what)), "{error}");
            }
        }
        assert!(refused > 1000, "{name} {refused}");
    }
}

/// A block of 2 kg on a floor, three ways: W; M, H, f, w; and the same in matrices side by side.
fn block() -> [(&'static str, Vec<(&'static str, &'static str)>); 2] {
    let w = "%%MatrixMarket matrix coordinate real symmetric\n% W\n3 3 3\n1 1 0.5\n2 2 0.5\n3 3 0.5\n";
    let q = "%%MatrixMarket matrix array real general\n3 1\n-0.1\n0.02\n0\n";
    let mu = "%%MatrixMarket matrix array real general\n1 1\n0.3\n";
    let m = "%%MatrixMarket matrix coordinate real general\n3 3 3\n1 1 2\n2 2 2\n3 3 2\n";
    let h = "%%MatrixMarket matrix array real general\n3 3\n1\n0\n0\n0\n1\n0\n0\n0\n1\n";
    let zero = "%%MatrixMarket matrix array real general\n3 1\n0\n0\n0\n";
    [
        ("a_W.mtx", vec![("a_W.mtx", w), ("a_q.mtx", q), ("a_mu.mtx", mu)]),
        ("M.mtx", vec![("M.mtx", m), ("H.mtx", h), ("f.mtx", zero), ("w.mtx", q), ("mu.mtx", mu)]),
    ]
}

/// W = M^-1, given the one way and the other: exact friction takes it as it is, the relaxation its symmetric
/// part, and both say so.
#[test]
fn an_asymmetric_matrix_is_taken_alike_as_w_and_as_m() {
    let folder = tempfile::tempdir().unwrap();
    // By columns.
    let w = [2.0, 0.1, 0.0, 0.3, 1.0, -0.2, 0.0, 0.0, 1.5];
    let inverse = {
        // By cofactors.
        let at = |i: usize, j: usize| w[3 * (j % 3) + i % 3];
        let minor =
            |i: usize, j: usize| at(i + 1, j + 1) * at(i + 2, j + 2) - at(i + 1, j + 2) * at(i + 2, j + 1);
        let determinant: f64 = (0..3).map(|j| at(0, j) * minor(0, j)).sum();
        // Entry (i, j), by columns.
        std::array::from_fn(|k| minor(k / 3, k % 3) / determinant)
    };
    let (f, free) = ([0.3, -0.4, 0.5], [-0.1, 0.02, 0.05]);
    let q: [f64; 3] = std::array::from_fn(|i| free[i] + (0..3).map(|j| w[3 * j + i] * f[j]).sum::<f64>());
    let unit: [f64; 9] = std::array::from_fn(|k| if k % 4 == 0 { 1.0 } else { 0.0 });
    let write = |name: &str, values: &[f64]| {
        let mut text = format!("%%MatrixMarket matrix array real general\n3 {}\n", values.len() / 3);
        values.iter().for_each(|value| text += &format!("{value:e}\n"));
        std::fs::write(folder.path().join(format!("{name}.mtx")), text).unwrap();
    };
    for (name, values) in [("a_W", &w), ("M", &inverse), ("H", &unit)] {
        write(name, values);
    }
    for (name, values) in [("a_q", q), ("f", f), ("w", free)] {
        write(name, &values);
    }
    for name in ["a_mu.mtx", "mu.mtx"] {
        let text = "%%MatrixMarket matrix array real general\n1 1\n0.3\n";
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    for name in ["a_W.mtx", "M.mtx"] {
        let file = problem_file::read(&folder.path().join(name)).unwrap();
        assert!(file.notes().iter().any(|note| note.contains("exact friction takes it as it is")), "{name}");
        for friction in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
            let problem = file.posed(friction);
            for j in 0..3 {
                let mut column = [0.0; 3];
                let delassus = &problem.delassus;
                delassus.multiply(&unit[3 * j..3 * j + 3], &mut column, &mut delassus.work());
                for i in 0..3 {
                    let expected = match friction {
                        FrictionModel::Relaxed => 0.5 * (w[3 * j + i] + w[3 * i + j]),
                        FrictionModel::Coulomb => w[3 * j + i],
                    };
                    assert!((column[i] - expected).abs() < 1e-14, "{name} {friction}: {i} {j}");
                }
            }
            assert!(problem.r.iter().zip(&q).all(|(r, q)| (r - q).abs() < 1e-14), "{name} {friction}");
        }
    }
}

#[test]
fn matrix_market_files_pose_the_problem_that_they_hold() {
    let folder = tempfile::tempdir().unwrap();
    for (name, files) in block() {
        files.iter().for_each(|(name, text)| std::fs::write(folder.path().join(name), text).unwrap());
        let read = problem_file::read(&folder.path().join(name)).unwrap();
        assert_eq!((read.problem.num_contacts(), read.problem.friction[0]), (1, 0.3));
        assert_eq!(read.problem.r, [-0.1, 0.02, 0.0]);
        let mut product = vec![0.0; 3];
        let delassus = &read.problem.delassus;
        delassus.multiply(&[1.0, 2.0, 4.0], &mut product, &mut delassus.work());
        let close = |(a, b): (&f64, f64)| (a - b).abs() < 1e-14;
        assert!(product.iter().zip([0.5, 1.0, 2.0]).all(close), "{name} {product:?}");
    }
    std::fs::remove_file(folder.path().join("a_q.mtx")).unwrap();
    let error = problem_file::read(&folder.path().join("a_W.mtx")).unwrap_err().to_string();
    assert!(error.contains("a_q.mtx"), "{error}");
    let mut draw = Draw(7);
    let (name, files) = block().into_iter().next().unwrap();
    for (altered, text) in &files {
        for _ in 0..2000 {
            for (name, text) in &files {
                std::fs::write(folder.path().join(name), text).unwrap();
            }
            std::fs::write(folder.path().join(altered), draw.mutate(text.as_bytes())).unwrap();
            let _ = problem_file::read(&folder.path().join(name));
        }
    }
}

#[test]
fn archives_of_numpy_pose_the_problem_of_the_text_file() {
    let Some(data) = graintrain_testdata::public_data("ccp") else { return };
    let read = |name: &str| problem_file::read(&data.join(name)).unwrap().problem;
    let (text, archive) = (read("sed729.dat"), read("sed729.npz"));
    assert_eq!(text.friction, archive.friction);
    let close = |a: &[f64], b: &[f64]| {
        let scale = a.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-9 * scale)
    };
    assert!(close(&text.r, &archive.r));
    let x: Vec<f64> = (0..text.r.len()).map(|k| ((k * 37) % 19) as f64 - 9.0).collect();
    let product = |problem: &graintrain::ccp::Ccp| {
        let mut y = vec![0.0; x.len()];
        problem.delassus.multiply(&x, &mut y, &mut problem.delassus.work());
        y
    };
    assert!(close(&product(&text), &product(&archive)));
    let bytes = std::fs::read(data.join("sed729.npz")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let mut draw = Draw(11);
    for _ in 0..300 {
        std::fs::write(&path, draw.mutate(&bytes)).unwrap();
        let _ = problem_file::read(&path);
    }
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let error = problem_file::read(&path).unwrap_err().to_string();
    assert!(error.contains("cut short"), "{error}");
}
