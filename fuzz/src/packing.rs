//! Files of spheres in every format that scenes take packings from.

use crate::bundle;
use graintrain::math::Vec3;
use graintrain_io::output::exchange::{Array, Snapshot};
use graintrain_io::scene::Scene;

/// Reads one file, whose name is followed by `|` and more keys of `file`, as a packing.
pub fn run(input: &[u8]) -> bool {
    let parts = bundle::parts(input);
    let Some(part) = parts.first() else { return false };
    let (name, keys) = part.name.split_once('|').unwrap_or((part.name, ""));
    let scene = format!(
        "[time]\nstep = 0.01\nsteps = 1\n[contact]\nallowed_overlap = 1e300\n[packing.p]\nfile = {{ path = '{name}'{keys} }}\n"
    );
    bundle::is_plain(name) && build(&scene, &[(name, part.content)])
}

/// Builds a scene in a folder with these files; errors are put into words, as for people.
pub(crate) fn build(scene: &str, files: &[(&str, &[u8])]) -> bool {
    let folder = tempfile::tempdir().expect("temporary folders can be made");
    for (name, content) in files {
        std::fs::write(folder.path().join(name), content).expect("temporary files can be written");
    }
    let built = Scene::parse("a", "a.toml", scene, folder.path(), &[]).and_then(|scene| scene.build());
    match built {
        Ok(simulation) => {
            simulation.world.state_hash();
            true
        }
        Err(error) => {
            assert!(!error.to_string().is_empty());
            let _ = (error.help(), error.location.map(|location| location.line_column()));
            false
        }
    }
}

/// A frame of some spheres.
fn snapshot(count: usize, time: f64) -> Snapshot {
    let array = |name, components, is_whole| Array {
        name,
        components,
        is_whole,
        values: (0..count * components)
            .map(|k| if is_whole { k as f64 } else { 0.1 + 0.25 * (k % 7) as f64 })
            .collect(),
    };
    Snapshot {
        time,
        step: (1e3 * time) as u64,
        position: (0..count).map(|k| Vec3::new(9.0 * k as f64, 0.125, -0.5)).collect(),
        arrays: vec![
            array("id", 1, true),
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

/// A few spheres in every format.
pub fn seeds() -> Vec<Vec<u8>> {
    let [mut dump, mut xyz, mut yade] = [const { Vec::new() }; 3];
    for frame in [snapshot(3, 0.0), snapshot(5, 0.25)] {
        frame.write_lammps(&mut dump).expect("memory takes it");
        frame.write_xyz(&mut xyz).expect("memory takes it");
    }
    snapshot(5, 0.0).write_yade(&mut yade).expect("memory takes it");
    let texts = [
        ("a.csv", "x,y,z,radius\n1,2,3,0.1\n4,5,6,0.1\n"),
        (
            "b.csv|, scale = 0.5, keep_min = [-9, -9, -9], radius_max = 2",
            "\"id\",X,y,z,\"Diameter\",vx,vy,vz\n7,1,2,3,1,5,6,7\n",
        ),
        ("a.txt|, skip_last = 1", "Radius[mm] PosX[m] PosY[cm] PosZ[m]\n100 1 2 3\n100 4 5 6\n0 0.1\n"),
        ("b.txt|, format = 'table'", "x y z r\n1 2 3 0.5\n4 5 6 0.5\n"),
        (
            "b.dump|, frame = 0",
            "ITEM: TIMESTEP\n9\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp ff ff\n1 2\n0 2\n0 4\nITEM: ATOMS id xs ys zs vx vy vz \
             diameter\n2 0.5 0.25 0.5 1 2 3 0.4\n7 0 0 0 0 0 0 0.2\n",
        ),
        (
            "a.data|, frame = 1",
            "1 0 0 0 0 1 1 1\n9 9 9 0 0 0 1 0 0 0 0 0 0 0\n2 0.5 0 0 0 1 1 1\n0.1 0.2 0.3 1 2 3 0.05 0 0 0 0 0 0 0\n0.5 0.5 0.5 0 0 \
             0 0.1 0 0 0 0 0 0 0\n",
        ),
        (
            "a.restart",
            "restart_version 1.0\nParticles 2\nSphericalParticle id 0 position 0 0 0 velocity 0 0 0 radius 1\nSphericalParticle id 1 \
             position 9 0 0 velocity 1 2 3 radius 2\n",
        ),
        ("a.vtu", include_str!("../seeds/ascii.vtu")),
        ("a.vtp", include_str!("../seeds/inline.vtp")),
        ("b.vtp", include_str!("../seeds/compressed.vtp")),
        ("c.vtp", include_str!("../seeds/appended.vtp")),
    ];
    let made: [(&str, &[u8]); 3] = [("a.dump", &dump), ("a.xyz", &xyz), ("c.txt|, format = 'yade'", &yade)];
    let texts = texts.iter().map(|(name, text)| (*name, text.as_bytes()));
    texts.chain(made).map(|file| bundle::input([file])).collect()
}
