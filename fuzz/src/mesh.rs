//! Meshes: STL, OBJ, COLLADA and tables of triangles, as a boundary, as a solid and as the hull of their
//! corners.

use crate::bundle;
use crate::packing::build;

/// Reads one mesh in the ways in which scenes take it.
pub fn run(input: &[u8]) -> bool {
    let parts = bundle::parts(input);
    let Some(part) = parts.first().filter(|part| bundle::is_plain(part.name)) else { return false };
    let ways = [
        format!("mesh = {{ file = '{}' }}", part.name),
        format!("mesh = {{ file = '{}', solid = true, scale = 0.5 }}", part.name),
        format!("hull = {{ file = '{}' }}", part.name),
        format!("hull = {{ file = '{}', corners = 4, scale = [-1, 2, 1] }}", part.name),
    ];
    // The ball is where meshes are, so that their collisions are looked for.
    let scene = |shape: &String| {
        format!(
            "[time]\nstep = 0.01\nsteps = 1\n[contact]\nallowed_overlap = 1e300\nenvelope = 0.1\n[body.m]\nshape = {{ {shape} }}\n\
             [body.ball]\nshape = {{ sphere = {{ radius = 0.5 }} }}\n"
        )
    };
    let read: Vec<bool> = ways.iter().map(|way| build(&scene(way), &[(part.name, part.content)])).collect();
    read.contains(&true)
}

/// A tetrahedron in every format, and a plate.
pub fn seeds() -> Vec<Vec<u8>> {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let triangles =
        [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|triangle| triangle.map(|k: usize| corners[k]));
    let mut ascii = "solid a\n".to_string();
    let mut binary = [&[0; 80][..], &4_u32.to_le_bytes()].concat();
    let mut table = "vertex1_X[m] vertex1_Y[m] vertex1_Z[m] vertex2_X[m] vertex2_Y[m] vertex2_Z[m] vertex3_X[m] vertex3_Y[m] \
                     vertex3_Z[m]\n"
        .to_string();
    for triangle in triangles {
        ascii += "facet normal 0 0 1\nouter loop\n";
        binary.extend([0; 12]);
        for corner in triangle {
            let [x, y, z] = corner;
            ascii += &format!("vertex {x:?} {y:?} {z:?}\n");
            table += &format!("{x} {y} {z} ");
            binary.extend(corner.iter().flat_map(|&x| (x as f32).to_le_bytes()));
        }
        ascii += "endloop\nendfacet\n";
        binary.extend([0; 2]);
        table += "\n";
    }
    ascii += "endsolid a\n";
    let object = "# a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1/1 3/2 2\nf 1 2 -1\nf 1 4 3\nf 2 3 4\n";
    let plate = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n";
    let collada = "<COLLADA><asset><unit meter='0.5'/></asset><geometry id='g'><mesh><source id='s'>\
                   <float_array>0 0 0 1 0 0 0 1 0 0 0 1</float_array><technique_common><accessor stride='3'/></technique_common></source>\
                   <vertices id='v'><input semantic='POSITION' source='#s'/></vertices><polylist><input semantic='VERTEX' offset='0' source='#v'/>\
                   <vcount>3 3 3 3</vcount><p>0 2 1 0 1 3 0 3 2 1 2 3</p></polylist></mesh></geometry><visual_scene><node><translate>1 0 0</translate>\
                   <matrix>1 0 0 0 0 1 0 0 0 0 1 2 0 0 0 1</matrix><instance_geometry url='#g'/></node></visual_scene></COLLADA>";
    let files: [(&str, &[u8]); 6] = [
        ("a.dae", collada.as_bytes()),
        ("a.stl", ascii.as_bytes()),
        ("b.stl", &binary),
        ("a.obj", object.as_bytes()),
        ("b.obj", plate.as_bytes()),
        ("a.txt", table.as_bytes()),
    ];
    files.map(|file| bundle::input([file])).to_vec()
}
