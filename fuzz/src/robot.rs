//! Robots: URDF files, with the mesh that they name.

use crate::bundle;
use crate::packing::build;

/// Reads the first file as a robot that is held, then as one that falls.
pub fn run(input: &[u8]) -> bool {
    let parts = bundle::parts(input);
    let sound = parts.iter().filter(|part| bundle::is_plain(part.name));
    let files: Vec<(&str, &[u8])> = sound.map(|part| (part.name, part.content)).collect();
    let Some((name, _)) = files.first() else { return false };
    let scene = |keys: &str| {
        format!(
            "[time]\nstep = 0.01\nsteps = 1\n[contact]\nallowed_overlap = 1e300\n[robot.r]\nfile = '{name}'\n{keys}\n\
             [body.ball]\nshape = {{ sphere = {{ radius = 0.5 }} }}\n"
        )
    };
    let ways =
        ["fixed = true", "fixed = false\ninertia = 'mended'\nshapes = 'visual'\nself_collision = true"];
    let read: Vec<bool> = ways.iter().map(|keys| build(&scene(keys), &files)).collect();
    read.contains(&true)
}

/// An arm with every kind of joint, and a hull.
pub fn seeds() -> Vec<Vec<u8>> {
    let arm = include_bytes!("../../crates/graintrain-io/tests/all/robots/arm.urdf");
    let stone = "<robot name='s'><link name='a'><inertial><mass value='2'/><inertia ixx='1' iyy='1' izz='1'/></inertial>\
                 <collision><geometry><mesh filename='package://p/a.obj' scale='1 -2 1'/></geometry></collision>\
                 <visual><origin xyz='0 0 1' rpy='1 0 2'/><geometry><sphere radius='1'/></geometry></visual></link></robot>";
    let object = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    let stone = [("s.urdf", stone.as_bytes()), ("a.obj", object.as_bytes())];
    vec![bundle::input([("arm.urdf", &arm[..])]), bundle::input(stone)]
}
