//! Contact problems: the text of Siconos, NumPy's archives, MatrixMarket files side by side.

use crate::bundle;
use flate2::write::DeflateEncoder;
use flate2::{Compression, Crc};
use graintrain_ccp::FrictionModel;
use graintrain_io::problem_file;
use std::io::Write;

/// Reads the problem of which the first file is a part, and multiplies by its matrix. Files `NAME.npy` are
/// put into an archive, so that its check sums are right whatever stands in them.
pub fn run(input: &[u8]) -> bool {
    let parts = bundle::parts(input);
    if parts.is_empty() || !parts.iter().all(|part| bundle::is_plain(part.name)) {
        return false;
    }
    let folder = tempfile::tempdir().expect("temporary folders can be made");
    let write = |name: &str, content: &[u8]| {
        std::fs::write(folder.path().join(name), content).expect("temporary files can be written");
    };
    parts.iter().for_each(|part| write(part.name, part.content));
    let mut first = parts[0].name;
    if first.ends_with(".npy") {
        let members: Vec<Member> =
            parts.iter().map(|part| (part.name.to_string(), part.content.to_vec())).collect();
        first = "a.npz";
        write(first, &zip(&members, false));
    }
    match problem_file::read(&folder.path().join(first)) {
        Ok(file) => {
            let _ = file.notes();
            let problem = file.posed(FrictionModel::Coulomb);
            let delassus = &problem.delassus;
            let mut velocity = vec![0.0; problem.r.len()];
            delassus.multiply(&vec![1.0; problem.r.len()], &mut velocity, &mut delassus.work());
            true
        }
        Err(error) => {
            assert!(!error.to_string().is_empty() && !error.remedy().is_empty());
            false
        }
    }
}

/// What the text formats have words for.
pub fn words() -> Vec<Vec<u8>> {
    let words = [
        "col 0 : locations 0 to 1",
        "row 1 : locations 1 to 2",
        "triplet",
        ":",
        "3",
        "5",
        "symmetric",
        "array",
        "coordinate",
    ];
    words.map(|word| word.as_bytes().to_vec()).to_vec()
}

/// Three rows of one contact, dense; then with rolling friction, in blocks, in triplets, in columns, and a
/// block on a floor in global form.
const TEXTS: &[&str] = &[
    "3\n1\n0\n3\n3\n3\t3\n 2. 0. 0. 0. 2. 0. 0. 0. 2.\n-1. 0. 0.\n0.5\n",
    "5\n1\n0\n5\n5\n5\t5\n2 0 0 0 0\n0 2 0 0 0\n0 0 2 0 0\n0 0 0 50 0\n0 0 0 0 50\n-1 0.5 0 1 0\n0.5\n0.01\n",
    "3\n2\n1\n6\n6\n3\n2\n2\n3\t6\n3\t6\n3\n3\n0\t1\t3\n0\t0\t1\n0\n2 0 0 0 2 0 0 0 2\n1\n0 0 0 0 0 0 0 0 0\n2\n3 0 0 0 3 0 0 0 3\n-1 0 0 -1 0 \
     0\n0.5 0.25\n",
    "3\n1\n2\n3\n3\n0\nCSparse Version 3.1.4\ntriplet: 3-by-3, nzmax: 3 nnz: 3\n0 0 : 2\n1 1 : 2\n2 2 : 2\n-1 0 0\n0.5\n",
    "3\n1\n2\n3\n3\n1\nCSparse Version 3.1.4\n3-by-3, nzmax: 3 nnz: 3, 1-norm: 2\ncol 0 : locations 0 to 0\n0 : 2\ncol 1 : locations 1 to \
     1\n1 : 2\ncol 2 : locations 2 to 2\n2 : 2\n-1 0 0\n0.5\n",
    "3\n1\n0\n6\n6\n6 6\n2 0 0 0 0 0\n0 2 0 0 0 0\n0 0 2 0 0 0\n0 0 0 1 0 0\n0 0 0 0 1 0\n0 0 0 0 0 1\n0\n6\n3\n6 3\n1 0 0 0 0 0\n0 1 0 0 0 \
     1\n0 0 1 0 -1 0\n0 0 0 0 0 0\n-0.1 0 0\n0.3\n",
];

/// Problems in every format.
pub fn seeds() -> Vec<Vec<u8>> {
    let w = "%%MatrixMarket matrix coordinate real symmetric\n% W\n3 3 3\n1 1 0.5\n2 2 0.5\n3 3 0.5\n";
    let q = "%%MatrixMarket matrix array real general\n3 1\n-0.1\n0.02\n0\n";
    let mu = "%%MatrixMarket matrix array real general\n1 1\n0.3\n";
    let m = "%%MatrixMarket matrix array real symmetric\n3 3\n2\n0\n0\n2\n0\n2\n";
    let h = "%%MatrixMarket matrix coordinate integer general\n3 3 3\n1 1 1\n2 2 1\n3 3 1\n";
    let zero = "%%MatrixMarket matrix array real general\n3 1\n0\n0\n0\n";
    let local = [("a_W.mtx", w), ("a_q.mtx", q), ("a_mu.mtx", mu)];
    let global = [("M.mtx", m), ("H.mtx", h), ("f.mtx", zero), ("w.mtx", q), ("mu.mtx", mu)];
    let bytes = |(name, text): (&'static str, &'static str)| (name, text.as_bytes());
    let mut seeds = vec![bundle::input(local.map(bytes)), bundle::input(global.map(bytes))];
    seeds.extend(TEXTS.iter().map(|text| bundle::input([("a.dat", text.as_bytes())])));
    for members in archives() {
        seeds
            .extend([false, true].map(|is_packed| bundle::input([("a.npz", &zip(&members, is_packed)[..])])));
        seeds.push(bundle::input(members.iter().map(|(name, content)| (name.as_str(), &content[..]))));
    }
    seeds
}

/// Local with a dense W, global with compressed rows and columns, and with `Minv`.
fn archives() -> [Vec<Member>; 3] {
    let unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let (mu, q) = (floats("mu", &[1], &[0.3]), floats("q", &[3], &[-0.1, 0.02, 0.0]));
    let sparse = |name: &str| {
        let part = |field: &str| format!("{name}_{field}");
        vec![
            floats(&part("data"), &[3], &[2.0, 2.0, 2.0]),
            integers(&part("indices"), &[0, 1, 2]),
            integers(&part("indptr"), &[0, 1, 2, 3]),
            integers(&part("shape"), &[3, 3]),
        ]
    };
    let (format, f) = (npy("M_format", "|S3", "", b"csr"), floats("f", &[3], &[0.0; 3]));
    let w = floats("w", &[3], &[-0.1, 0.0, 0.0]);
    let p = (String::from("p.npy"), q.1.clone());
    [
        vec![floats("W", &[3, 3], &unit), q, mu.clone()],
        [sparse("M"), sparse("H"), vec![format, f, w, mu.clone()]].concat(),
        vec![floats("Minv", &[3], &[0.5; 3]), floats("D", &[3, 3], &unit), p, mu],
    ]
}

/// A member of an archive: its name and bytes.
type Member = (String, Vec<u8>);

fn floats(name: &str, shape: &[usize], values: &[f64]) -> Member {
    let shape: String = shape.iter().map(|n| format!("{n},")).collect();
    npy(name, "<f8", &shape, &values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())
}

fn integers(name: &str, values: &[i32]) -> Member {
    let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    npy(name, "<i4", &format!("{},", values.len()), &bytes)
}

fn npy(name: &str, kind: &str, shape: &str, data: &[u8]) -> Member {
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}\n");
    let length = (header.len() as u16).to_le_bytes();
    (format!("{name}.npy"), [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat())
}

/// A ZIP archive of these members.
fn zip(members: &[Member], is_packed: bool) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in members {
        let mut sum = Crc::new();
        sum.update(content);
        let mut packer = DeflateEncoder::new(Vec::new(), Compression::default());
        packer.write_all(content).expect("memory takes it");
        let packed = if is_packed { packer.finish().expect("memory takes it") } else { content.clone() };
        let method: u16 = if is_packed { 8 } else { 0 };
        // What both headers have: version, flags, method, time, date, check sum, sizes, lengths of name and
        // extra field.
        let mut common = [20_u16, 0, method, 0, 0].map(u16::to_le_bytes).concat();
        common.extend([sum.sum(), packed.len() as u32, content.len() as u32].map(u32::to_le_bytes).concat());
        common.extend([name.len() as u16, 0].map(u16::to_le_bytes).concat());
        directory.extend(
            [
                b"PK\x01\x02\x14\0",
                &common[..],
                &[0; 10],
                &(bytes.len() as u32).to_le_bytes(),
                name.as_bytes(),
            ]
            .concat(),
        );
        bytes.extend([b"PK\x03\x04", &common[..], name.as_bytes(), &packed].concat());
    }
    let count = (members.len() as u16).to_le_bytes();
    let sizes = [directory.len() as u32, bytes.len() as u32].map(u32::to_le_bytes).concat();
    bytes.extend([&directory[..], b"PK\x05\x06\0\0\0\0", &count, &count, &sizes, &[0; 2]].concat());
    bytes
}
