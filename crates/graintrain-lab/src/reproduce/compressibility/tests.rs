use super::drop::of_density;
use super::record::Recorded;
use super::table::Count;
use super::*;
use graintrain_ccp::Ccp;
use graintrain_linalg::dense::{Matrix, thin_svd};
use std::path::Path;

fn never() -> Arc<AtomicBool> {
    Arc::new(AtomicBool::new(false))
}

/// 27 spheres at rest: some 60 contacts.
fn problem(folder: &Path) -> Ccp {
    let drop = Drop::new(1, folder);
    drop.prepare(Phase::Settled, &never(), |_, _| {}).unwrap();
    drop.problem(Phase::Settled, 0.03, 1000.0, &never()).unwrap().unwrap()
}

/// Its bed and a system of the paper's solve.
fn bed_and_system(folder: &Path, iteration: usize) -> (Bed, System, Vec<Recorded>) {
    let problem = problem(folder);
    let path = follow(&problem, Start::Paper, LONGEST, |_| true, &never()).unwrap();
    let mut bed = Bed::new(&problem);
    let chosen = path.systems.iter().find(|system| system.iteration == iteration).unwrap();
    let system = bed.system(chosen).unwrap();
    (bed, system, path.systems)
}

fn settings(out: &Path) -> Settings {
    Settings {
        n: 1,
        envelopes: vec![0.3],
        densities: vec![1000.0],
        phases: vec![Phase::Settled],
        every: 1000,
        newton: 1,
        caps: vec![10],
        readings: true,
        limit: Duration::from_secs(20),
        out: out.to_path_buf(),
    }
}

/// Rows without their seconds.
fn timeless(measured: &Measured) -> Vec<Row> {
    let mut rows = measured.rows.clone();
    rows.iter_mut().for_each(|row| row.figures.seconds = None);
    rows
}

#[test]
fn the_smallest_experiment_is_whole_and_goes_on_where_it_was_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    let expected = reproduce(&settings(&whole), &never(), &mut |_| {}).unwrap();
    let text = std::fs::read_to_string(&expected.table).unwrap();
    let columns = COLUMNS.split(',').count();
    assert!(text.starts_with(COLUMNS) && text.lines().all(|line| line.split(',').count() == columns));
    assert_eq!(text.lines().count(), expected.rows.len() + 1);
    assert_eq!(expected.new, expected.rows.len());
    for start in ["paper", "ours"] {
        let rows: Vec<&Row> = expected.rows.iter().filter(|row| row.case.start == start).collect();
        for reading in std::iter::once(&BASE).chain(&READINGS) {
            let of_reading = rows.iter().filter(|row| row.key.reading == reading.name);
            assert!(of_reading.clone().any(|row| row.figures.rank.is_some()), "{start} {}", reading.name);
        }
        assert!(rows.iter().any(|row| row.key.method == "cross" && row.figures.unscaled.is_some()));
        assert!(rows.iter().any(|row| row.key.method == "ic" && row.figures.bicgstab.is_some()));
    }

    // A stop in the middle keeps what there is; the same call ends with the same rows.
    let stop = never();
    let mut reported = 0;
    let stopped = reproduce(&settings(&broken), &stop, &mut |progress| {
        reported += usize::from(progress.label.contains("iteration"));
        stop.store(reported > 5, Ordering::Relaxed);
    });
    assert!(matches!(stopped, Err(ReproduceError::Stopped)));
    let before = std::fs::read_to_string(broken.join("cells.jsonl")).unwrap();
    assert!(before.lines().count() > 3);
    let resumed = reproduce(&settings(&broken), &never(), &mut |_| {}).unwrap();
    assert!(resumed.new < expected.new);
    assert_eq!(timeless(&resumed), timeless(&expected));
    let again = reproduce(&settings(&broken), &never(), &mut |_| {}).unwrap();
    assert_eq!((again.new, again.rows), (0, resumed.rows));
}

/// f_1 = (g_t^2 - mu^2 g_n^2) / 2, f_2 = -g_n at g = (1, 0, 0) N s with lambda = -1/f: H = diag(3, 2/mu^2,
/// 2/mu^2).
#[test]
fn the_papers_start_has_equal_barrier_blocks() {
    let folder = tempfile::tempdir().unwrap();
    let systems = bed_and_system(folder.path(), 0).2;
    for block in &systems[0].added {
        for (e, &value) in block.iter().enumerate() {
            let expected = [3.0, 0.0, 0.0, 0.0, 32.0, 0.0, 0.0, 0.0, 32.0][e];
            assert!((value - expected).abs() < 1e-9, "{block:?}");
        }
    }
    assert!(systems.windows(2).all(|pair| pair[1].iteration == pair[0].iteration + 1));
}

#[test]
fn heavier_grains_divide_the_matrix_alone() {
    let folder = tempfile::tempdir().unwrap();
    let light = problem(folder.path());
    let heavy = of_density(&light, 8.0);
    let (light_n, heavy_n) = (light.delassus.assemble(), heavy.delassus.assemble());
    for (a, b) in light_n.blocks().as_flattened().iter().zip(heavy_n.blocks().as_flattened()) {
        assert!((a - 8.0 * b).abs() <= 1e-12 * a.abs());
    }
    assert_eq!(light.r, heavy.r);
}

/// The error of the exact pass lies between the largest and the root sum of squares of what the best matrix
/// of the same rank leaves of every unfolding, from dense decompositions.
#[test]
fn errors_of_the_exact_pass_are_those_of_dense_unfoldings() {
    let folder = tempfile::tempdir().unwrap();
    let (bed, system, _) = bed_and_system(folder.path(), 3);
    let slots = bed.slots(system::LEAF, graintrain_ccp::paper::tensor_train::tree::Split::Uniform);
    let quadtree = system.quadtree(false, &slots, 1.0).unwrap();
    let (train, report) = quadtree.to_train(&Truncation::capped(1e-2, 6)).unwrap();
    let (whole, _) = quadtree.to_train(&Truncation::to(1e-13)).unwrap();
    let (modes, ranks) = (quadtree.modes(), train.ranks());
    let full = whole.as_vector().to_full().unwrap();
    let (mut worst, mut sum, mut rows) = (0.0_f64, 0.0, 1);
    for bond in 1..modes.len() {
        rows *= modes[bond - 1] * modes[bond - 1];
        let unfolding = Matrix::from_vec(rows, full.len() / rows, full.clone());
        let values = thin_svd(unfolding.view()).unwrap().s;
        let tail: f64 = values.iter().skip(ranks[bond]).map(|s| s * s).sum();
        worst = worst.max(tail);
        sum += tail;
    }
    let found = report.error * quadtree.norm();
    assert!(worst.sqrt() <= found * (1.0 + 1e-9) && found <= sum.sqrt() * (1.0 + 1e-9), "{found}");

    // The scaled error against all entries of both matrices; random signs leave some scatter.
    let estimate = system.scaled_error(&train, false, &slots).unwrap().unwrap();
    let n = system.unknowns();
    let met = train.to_full().unwrap();
    let position = |i: usize| 3 * slots.place[i / 3] + i % 3;
    let (mut error, mut norm) = (0.0, 0.0);
    for j in 0..n {
        let mut column: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i == j))).collect();
        system.jacobi.solve_upper(&mut column);
        let mut image = vec![0.0; n];
        system.matrix.multiply(&column, &mut image);
        let size = image.clone();
        for (k, c) in column.iter().enumerate().filter(|(_, c)| **c != 0.0) {
            (0..n).for_each(|i| image[i] -= met[(position(i), position(k))] * c);
        }
        for (mut v, total) in [(image, &mut error), (size, &mut norm)] {
            system.jacobi.solve_lower(&mut v);
            *total += v.iter().map(|x| x * x).sum::<f64>();
        }
    }
    let exact = (error / norm).sqrt();
    assert!((estimate / exact - 1.0).abs() < 0.3, "{estimate} for {exact}");
}

/// Whole inverses solve at once: of S, of the scaled matrix, and by their factors.
#[test]
fn untruncated_inverses_solve_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let (bed, system, _) = bed_and_system(folder.path(), 2);
    let quiet = Patience::new(None, None);
    for (name, kind) in [
        ("base", Kind::Truncated),
        ("scaled", Kind::Shifted),
        ("scaled", Kind::Factor),
        ("base", Kind::Factor),
    ] {
        let reading = Reading::find(name).unwrap();
        let slots = bed.slots(reading.leaf, reading.split);
        let scaled = reading.form == Form::Scaled;
        let quadtree = system.quadtree(scaled, &slots, 1.0).unwrap();
        let train = quadtree.to_train(&Truncation::to(1e-12)).unwrap().0;
        let exact = Exact::new(reading.matrix(&system)).unwrap();
        let wanted = Wanted { kind, scaled, truncation: Truncation::to(1e-12) };
        let mut x = Approximate::new(wanted, exact.as_ref(), &train, &slots, &|| false).unwrap().unwrap();
        assert!(x.definite, "{name} {kind:?}");
        let steps = system.refinement(|r, z| x.apply(&system, &slots, r, z), 1e-6, &quiet);
        assert_eq!(steps, Some(Count::Reached(1)), "{name} {kind:?}");
        let iterations = system.bicgstab(|r, z| x.apply(&system, &slots, r, z), 1e-6, &quiet);
        assert_eq!(iterations, Some(Count::Reached(1)), "{name} {kind:?}");
    }
}

/// x^T S x does not depend on the axes of x, and a shift adds its multiple of |x|^2.
#[test]
fn other_axes_and_shifts_keep_the_quadratic_form() {
    let folder = tempfile::tempdir().unwrap();
    let (bed, system, _) = bed_and_system(folder.path(), 1);
    let (world, shifted) = (system.in_world_axes(bed.frames()).unwrap(), system.shifted(0.5).unwrap());
    let x: Vec<f64> = (0..system.unknowns()).map(|k| (0.7 * k as f64).sin()).collect();
    let own: Vec<f64> = x
        .chunks_exact(3)
        .zip(bed.frames())
        .flat_map(|(x, f)| (0..3).map(move |r| (0..3).map(|c| f[3 * r + c] * x[c]).sum::<f64>()))
        .collect();
    let form = |system: &System, x: &[f64]| {
        let mut y = vec![0.0; x.len()];
        system.matrix.multiply(x, &mut y);
        let along: f64 = system.rhs.iter().zip(x).map(|(b, x)| b * x).sum();
        (x.iter().zip(&y).map(|(x, y)| x * y).sum::<f64>(), along)
    };
    let (a, b, c) = (form(&world, &x), form(&system, &own), form(&shifted, &own));
    let square: f64 = own.iter().map(|x| x * x).sum();
    assert!((a.0 - b.0).abs() < 1e-10 * a.0 && (a.1 - b.1).abs() < 1e-10 * b.1.abs().max(1.0));
    assert!((c.0 - b.0 - 0.5 * square).abs() < 1e-10 * c.0);
}

#[test]
fn marks_are_the_first_the_tenth_and_the_last() {
    assert_eq!((marked(69), marked(5), marked(1)), ([0, 9, 68], [0, 2, 4], [0, 0, 0]));
    assert_eq!(measured(30, 69), [0, 9, 30, 60, 68]);
    assert_eq!(measured(1, 0), [0_usize; 0]);
}
