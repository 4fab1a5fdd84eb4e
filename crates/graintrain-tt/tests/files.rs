//! Saved trains come back bit for bit; damaged files are named, never a panic.

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
}
