//! Saved trains come back bit for bit; damaged files are named, never a panic.

use graintrain_tt::toolbox::{Stored, read_mat, read_sdv, write_sdv};
use graintrain_tt::{TtError, TtMatrix, TtVector};

#[test]
fn trains_survive_a_file_and_serde() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("train.tt");
    let x = TtVector::random(&[3, 2, 5, 2], 4, 1).unwrap();
    x.save(&file).unwrap();
    assert_eq!(TtVector::load(&file).unwrap(), x);
    assert!(matches!(TtMatrix::load(&file), Err(TtError::Format { .. })));
    let a = TtMatrix::random(&[3, 2, 5], &[2, 2, 4], 4, 1).unwrap();
    a.save(&file).unwrap();
    assert_eq!(TtMatrix::load(&file).unwrap(), a);
    let text = serde_json::to_string(&a).unwrap();
    // (The reader of decimal numbers may be off by a rounding.)
    assert!(serde_json::from_str::<TtMatrix>(&text).unwrap().relative_distance(&a).unwrap() < 1e-14);
    // Serde checks the shapes on the way in.
    assert!(serde_json::from_str::<TtMatrix>(&text.replacen("\"left\":1", "\"left\":2", 1)).is_err());
}

#[test]
fn damaged_files_are_errors_that_say_where() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("train.tt");
    let x = TtVector::random(&[3, 2, 5, 2], 4, 1).unwrap();
    x.save(&file).unwrap();
    let bytes = std::fs::read(&file).unwrap();
    for length in [0, 5, 8, 20, 60, bytes.len() - 3] {
        std::fs::write(&file, &bytes[..length]).unwrap();
        let error = TtVector::load(&file).unwrap_err();
        assert!(error.to_string().contains("train.tt") && error.to_string().contains("byte"), "{error}");
    }
    // Header: groups, cores, four modes, five ranks.
    for place in (8..96).step_by(8) {
        let mut damaged = bytes.clone();
        damaged[place + 4] = 0xFF;
        std::fs::write(&file, &damaged).unwrap();
        assert!(TtVector::load(&file).is_err(), "byte {place}");
    }
    assert!(matches!(TtVector::load(&folder.path().join("absent")), Err(TtError::File { .. })));
    // Something behind the train, and a number that is none: both were once read without a word.
    std::fs::write(&file, [&bytes[..], &[0]].concat()).unwrap();
    let error = TtVector::load(&file).unwrap_err().to_string();
    assert!(error.contains("after the last core") && error.contains("train.tt"), "{error}");
    for number in [f64::NAN, f64::INFINITY] {
        let end = bytes.len() - 8;
        std::fs::write(&file, [&bytes[..end], &number.to_le_bytes()].concat()).unwrap();
        let error = TtVector::load(&file).unwrap_err().to_string();
        assert!(error.contains("core 4 holds") && error.contains("train.tt"), "{error}");
    }
}

/// The bytes of an SDV file put together by hand from the layout in tt-fort's `ttio.f90`.
fn sdv(modes: &[i32], ranks: &[i32], numbers: &[u8]) -> Vec<u8> {
    let d = modes.len() as i32;
    let mut bytes = b"TT      ".to_vec();
    let mut put = |list: &[i32]| list.iter().for_each(|n| bytes.extend(n.to_le_bytes()));
    put(&[1, 0, 2047, 0, 0, 0]);
    put(&[0x2020_2020; 16]);
    put(&[1, d, 0, 0, 0, 0, 0, 0, 1, d]);
    put(modes);
    put(ranks);
    bytes.extend(numbers);
    bytes
}

#[test]
fn trains_of_the_fortran_library_are_read_and_written() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("train.sdv");
    // x(i, j) = 10 i + j as a train of rank 2: [10 i, 1] [1; j].
    let cores: [f64; 10] = [0.0, 10.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 2.0];
    let wide: Vec<u8> = cores.iter().flat_map(|x| x.to_le_bytes()).collect();
    std::fs::write(&file, sdv(&[2, 3], &[1, 2, 1], &wide)).unwrap();
    let x = read_sdv(&file).unwrap();
    assert_eq!(x.to_full().unwrap(), [0.0, 10.0, 1.0, 11.0, 2.0, 12.0]);
    let back = folder.path().join("back.sdv");
    write_sdv(&x, &back).unwrap();
    assert_eq!(read_sdv(&back).unwrap(), x);
    // All that a reader looks at is where the Fortran program has it.
    let (ours, theirs) = (std::fs::read(&back).unwrap(), sdv(&[2, 3], &[1, 2, 1], &wide));
    assert_eq!(
        (&ours[..16], &ours[96..104], &ours[128..]),
        (&theirs[..16], &theirs[96..104], &theirs[128..])
    );
    let complex: Vec<u8> = wide.iter().chain(&wide).copied().collect();
    let wrong = [
        (sdv(&[2, 3], &[1, 2, 1], &complex), "complex"),
        (sdv(&[2, 3], &[1, 2, 1], &wide[..72]), "72 bytes for 10 numbers"),
        (sdv(&[2, -3], &[1, 2, 1], &wide), "a mode is -3"),
        (sdv(&[i32::MAX; 2], &[1, i32::MAX, 1], &wide), "bytes for"),
        (wide.clone(), "expected the bytes TT"),
    ];
    for (bytes, expected) in wrong {
        std::fs::write(&file, bytes).unwrap();
        let error = read_sdv(&file).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    }
    let bytes = sdv(&[2, 3], &[1, 2, 1], &wide);
    for length in 0..bytes.len() {
        std::fs::write(&file, &bytes[..length]).unwrap();
        assert!(read_sdv(&file).is_err(), "{length}");
    }
}

/// A data element of a MATLAB file.
fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// An array of numbers, as MATLAB writes whole numbers: in the smallest type that holds them.
fn array(class: u32, rows: usize, name: &str, rest: &[Vec<u8>]) -> Vec<u8> {
    let size = |n: usize| (n as i32).to_le_bytes();
    let mut data = element(6, &[class.to_le_bytes(), [0; 4]].concat());
    data.extend(element(5, &[size(rows), size(1)].concat()));
    data.extend(element(1, name.as_bytes()));
    rest.iter().for_each(|part| data.extend(part));
    element(14, &data)
}

fn numbers(values: &[f64]) -> Vec<u8> {
    let stored = if values.iter().all(|x| x.fract() == 0.0 && (-128.0..128.0).contains(x)) {
        element(1, &values.iter().map(|&x| x as i8 as u8).collect::<Vec<_>>())
    } else {
        element(9, &values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>())
    };
    array(6, values.len(), "", &[stored])
}

/// A structure (2) or an object (3) with fields.
fn fields(class: u32, name: &str, list: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut parts = if class == 3 { vec![element(1, b"tt_tensor")] } else { Vec::new() };
    parts.push(element(5, &8i32.to_le_bytes()));
    let names = list.iter().flat_map(|(name, _)| {
        let mut name = name.as_bytes().to_vec();
        name.resize(8, 0);
        name
    });
    parts.push(element(1, &names.collect::<Vec<_>>()));
    parts.extend(list.iter().map(|(_, value)| value.clone()));
    array(class, 1, name, &parts)
}

fn tt_tensor(class: u32, name: &str, x: &TtVector) -> Vec<u8> {
    let list = |sizes: &[usize]| numbers(&sizes.iter().map(|&n| n as f64).collect::<Vec<_>>());
    let mut starts = vec![1];
    x.cores().iter().for_each(|core| starts.push(starts[starts.len() - 1] + core.data().len()));
    let data: Vec<f64> = x.cores().iter().flat_map(|core| core.data().to_vec()).collect();
    let (modes, ranks) = (list(&x.modes()), list(&x.ranks()));
    let all = [
        ("d", list(&[x.num_cores()])),
        ("r", ranks),
        ("n", modes),
        ("core", numbers(&data)),
        ("ps", list(&starts)),
        ("over", numbers(&[0.0])),
    ];
    fields(class, name, &all)
}

#[test]
fn trains_of_matlab_files_are_read_and_the_rest_is_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("system.mat");
    let (x, a) =
        (TtVector::random(&[3, 2, 5], 3, 1).unwrap(), TtMatrix::random(&[2, 3], &[3, 2], 2, 2).unwrap());
    let list = |sizes: &[usize]| numbers(&sizes.iter().map(|&n| n as f64).collect::<Vec<_>>());
    let matrix = fields(
        3,
        "A",
        &[("n", list(a.row_modes())), ("m", list(a.column_modes())), ("tt", tt_tensor(3, "", a.as_vector()))],
    );
    let compressed = |bytes: &[u8]| {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        std::io::Write::write_all(&mut encoder, bytes).unwrap();
        let data = encoder.finish().unwrap();
        [&15u32.to_le_bytes()[..], &(data.len() as u32).to_le_bytes(), &data].concat()
    };
    let mut bytes = b"MATLAB 5.0 MAT-file, written by a test".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M']);
    bytes.extend(compressed(&tt_tensor(3, "x", &x)));
    bytes.extend(array(6, 2, "unrelated", &[element(9, &[0; 16])]));
    bytes.extend(compressed(&matrix));
    bytes.extend(tt_tensor(2, "plain", &x));
    bytes.extend(array(1, 2, "cells", &[]));
    std::fs::write(&file, &bytes).unwrap();
    let expected = [
        ("x".to_string(), Stored::Vector(x.clone())),
        ("A".to_string(), Stored::Matrix(a)),
        ("plain".to_string(), Stored::Vector(x.clone())),
    ];
    assert_eq!(read_mat(&file).unwrap(), expected);
    // Whatever one byte is changed to and wherever the file ends: an answer or an error, never a panic.
    for place in (0..bytes.len()).step_by(5) {
        let mut damaged = bytes.clone();
        damaged[place] ^= [0x01, 0x80, 0xFF][place / 5 % 3];
        std::fs::write(&file, &damaged).unwrap();
        if let Err(error) = read_mat(&file) {
            assert!(matches!(error, TtError::Format { .. }), "{error}");
        }
        std::fs::write(&file, &bytes[..place]).unwrap();
        assert!(
            read_mat(&file).map_or(true, |found| found.len() < 3 || place > bytes.len() - 100),
            "{place}"
        );
    }
    // A train that contradicts itself is named.
    let mut wrong = tt_tensor(2, "crooked", &x);
    let place = wrong.windows(3).position(|list| list == [3, 2, 5]).unwrap();
    wrong[place] = 4;
    std::fs::write(&file, [&bytes[..128], &wrong].concat()).unwrap();
    assert!(read_mat(&file).unwrap_err().to_string().contains("crooked"));
    std::fs::write(&file, b"MATLAB 7.3 MAT-file").unwrap();
    assert!(read_mat(&file).is_err());
}
