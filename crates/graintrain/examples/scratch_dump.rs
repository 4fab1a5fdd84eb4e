#![allow(missing_docs)]
use graintrain::ccp::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    for f in &a[2..] {
        let p = match graintrain::problem_file::read(std::path::Path::new(f)) {
            Ok(p) => p.problem,
            Err(e) => {
                println!("{f}: {e}");
                continue;
            }
        };
        let mut o: Vec<f64> = vec![];
        match &p.delassus {
            Delassus::Rigid(r) => {
                o.extend([0.0, r.num_contacts() as f64, r.num_bodies() as f64]);
                for c in r.contacts() {
                    o.extend([f64::from(c.body_a), f64::from(c.body_b)]);
                    o.extend(c.frame.as_flattened());
                    o.extend(c.arm_a);
                    o.extend(c.arm_b);
                }
                for m in r.inverse_mass() {
                    o.extend(m.linear);
                    o.extend(m.angular);
                }
            }
            Delassus::Sparse(m) => {
                o.extend([1.0, m.num_rows() as f64, m.num_blocks() as f64]);
                o.extend(m.row_starts().iter().map(|&x| x as f64));
                o.extend(m.columns().iter().map(|&x| f64::from(x)));
                o.extend(m.blocks().as_flattened());
            }
        }
        o.extend(&p.r);
        o.extend(&p.friction);
        o.push(p.impulse_scale.unwrap_or(-1.0));
        o.push(p.points.len() as f64);
        o.extend(p.points.as_flattened());
        let bytes: Vec<u8> = o.iter().flat_map(|x| x.to_le_bytes()).collect();
        let name = std::path::Path::new(f).file_stem().unwrap().to_string_lossy().into_owned();
        println!("{name} {}", p.num_contacts());
        std::fs::write(format!("{}/{name}.bin", a[1]), bytes).unwrap();
    }
}
