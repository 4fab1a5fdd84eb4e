//! A build without the feature `fclib` knows an HDF5 file when it sees one and says what it takes to read it.

use graintrain_ccp::{BodyInverseMass, Ccp, Delassus, RigidDelassus};
use graintrain_io::problem_file;

#[test]
fn hdf5_files_are_refused_by_the_name_of_the_feature() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("problem.hdf5");
    for userblock in [0, 512, 2048] {
        let mut bytes = vec![b' '; userblock];
        bytes.extend(b"\x89HDF\r\n\x1a\n and more");
        std::fs::write(&path, bytes).unwrap();
        let error = problem_file::read(&path).unwrap_err();
        assert!(error.to_string().contains("feature `fclib`"), "{error}");
        assert!(error.remedy().contains("feature `fclib`"), "{}", error.remedy());
    }
    let body = BodyInverseMass { linear: [1.0; 3], angular: [0.0; 9] };
    let problem =
        Ccp::new(Delassus::Rigid(RigidDelassus::new(Vec::new(), vec![body])), Vec::new(), Vec::new())
            .unwrap();
    let error = problem_file::write(&path, &problem, "").unwrap_err();
    assert!(error.to_string().contains("feature `fclib`"), "{error}");
}
