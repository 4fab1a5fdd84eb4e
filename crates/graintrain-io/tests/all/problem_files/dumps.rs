//! What is written can be read: by this program exactly, by others as FCLIB.

use graintrain_ccp::{BodyInverseMass, Ccp, Delassus, FIXED, RigidContact, RigidDelassus};
use graintrain_io::problem_file::{self, Form};

/// Three bodies: free, with prescribed axes (a press that moves along z and turns about z), and prescribed.
fn problem() -> Ccp {
    let (s, c) = (0.6, 0.8);
    let frame = [[s, c, 0.0], [-c, s, 0.0], [0.0, 0.0, 1.0]];
    let contacts = vec![
        RigidContact { body_a: 0, body_b: 1, frame, arm_a: [0.1, 0.2, -0.3], arm_b: [0.4, -0.5, 0.1] },
        RigidContact { body_a: 1, body_b: FIXED, frame, arm_a: [0.3, -0.1, 0.7], arm_b: [0.0; 3] },
        RigidContact { body_a: 2, body_b: 0, frame, arm_a: [0.2, 0.2, 0.2], arm_b: [-0.1, 0.3, 0.6] },
    ];
    let angular = [2.0, 0.5, 0.0, 0.5, 3.0, 0.25, 0.0, 0.25, 1.0];
    let bodies = vec![
        BodyInverseMass { linear: [0.7; 3], angular },
        BodyInverseMass { linear: [0.0, 0.0, 0.3], angular: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.7] },
        BodyInverseMass { linear: [0.0; 3], angular: [0.0; 9] },
    ];
    let r = (0..9).map(|k| 0.1 * f64::from(k) - 0.37).collect();
    let mut problem =
        Ccp::new(Delassus::Rigid(RigidDelassus::new(contacts, bodies)), r, vec![0.1, 0.2, 0.0]).unwrap();
    problem.velocity_scale = Some(0.245);
    problem.points = vec![[0.1, 0.2, 0.3], [1.0, 2.0, 3.0], [-1.0, 0.0, 0.5]];
    problem.identity = vec![7, u64::MAX, 42];
    problem
}

fn assembled(problem: &Ccp) -> Vec<f64> {
    let matrix = problem.delassus.assemble();
    let contacts = problem.num_contacts();
    (0..contacts).flat_map(|i| (0..contacts).flat_map(|j| matrix.get(i, j)).collect::<Vec<_>>()).collect()
}

#[test]
fn a_dump_of_bodies_comes_back_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dump.hdf5");
    let problem = problem();
    problem_file::write(&path, &problem, "three bodies").unwrap();
    let back = problem_file::read(&path).unwrap();
    assert_eq!((back.form, back.bodies, back.title.as_str()), (Form::RigidBodies, 3, "three bodies"));
    let (Delassus::Rigid(a), Delassus::Rigid(b)) = (&*problem.delassus, &*back.problem.delassus) else {
        panic!("bodies expected");
    };
    assert_eq!((a.contacts(), a.inverse_mass()), (b.contacts(), b.inverse_mass()));
    let parts =
        |p: &Ccp| (p.r.clone(), p.friction.clone(), p.velocity_scale, p.points.clone(), p.identity.clone());
    assert_eq!(parts(&problem), parts(&back.problem));
}

#[test]
fn a_dump_of_bodies_says_the_same_in_its_fclib_part_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dump.hdf5");
    let problem = problem();
    problem_file::write(&path, &problem, "").unwrap();
    let file = hdf5_pure::File::open_rw(&path).unwrap();
    file.root().delete("graintrain").unwrap();
    file.commit().unwrap();
    drop(file);
    let back = problem_file::read(&path).unwrap();
    assert_eq!(back.problem.r, problem.r);
    for (a, b) in assembled(&back.problem).iter().zip(assembled(&problem)) {
        assert!((a - b).abs() < 1e-14, "{a} {b}");
    }
}

#[test]
fn a_dump_of_a_symmetric_matrix_comes_back_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dump.hdf5");
    let mut problem = problem();
    problem.delassus = Delassus::Sparse(problem.delassus.assemble()).into();
    problem_file::write(&path, &problem, "").unwrap();
    let back = problem_file::read(&path).unwrap();
    assert_eq!(back.form, Form::Local);
    assert_eq!(back.problem.velocity_scale, problem.velocity_scale);
    // N as assembled is symmetric to rounding only; what was read is symmetric.
    for (a, b) in assembled(&back.problem).iter().zip(assembled(&problem)) {
        assert!((a - b).abs() < 1e-15, "{a} {b}");
    }
    problem_file::write(&path, &back.problem, "").unwrap();
    let again = problem_file::read(&path).unwrap();
    assert_eq!(assembled(&again.problem), assembled(&back.problem));
}

#[test]
fn a_problem_without_contacts_can_be_dumped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dump.hdf5");
    let body = BodyInverseMass { linear: [1.0; 3], angular: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };
    let empty = Ccp::new(Delassus::Rigid(RigidDelassus::new(vec![], vec![body])), vec![], vec![]).unwrap();
    problem_file::write(&path, &empty, "").unwrap();
    assert_eq!(problem_file::read(&path).unwrap().problem.num_contacts(), 0);
}
