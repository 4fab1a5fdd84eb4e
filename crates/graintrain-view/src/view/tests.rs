use super::pack::{Frame, Ranges};
use super::*;
use base64::Engine;
use flate2::read::GzDecoder;
use graintrain::assemble::OverlapCorrection;
use graintrain::handle::BodyId;
use graintrain::material::Materials;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::{Geometry, Part, Shape, Sphere};
use graintrain::stepper::{SolverChoice, StepSettings};
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel;
use graintrain_io::output::OutputSettings;
use graintrain_io::output::folder;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::RunStatus;
use graintrain_io::output::vtp::Precision;
use graintrain_io::run::{Run, RunSettings, RunTotals};
use graintrain_io::stage::Stage;
use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Grains of three forms that fall on a plane beside a turning blade.
fn world() -> World {
    let mut materials = Materials::default();
    let stone = materials.add("stone", 2000.0).unwrap();
    materials.set_pair(stone, stone, 0.3, 0.0).unwrap();
    let mut world = World::new(Vec3::new(0.0, 0.0, -9.81), materials).unwrap();
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    let ground = world.add_geometry(Geometry::plane());
    world
        .add_body(Body { name: "ground".into(), motion: fixed, ..Body::new(ground, stone, Vec3::ZERO) })
        .unwrap();
    let turning = Motion::rotating(Vec3::new(1.0, 0.0, 0.2), Vec3::Z, Profile::Constant(2.0));
    let turning = world.add_motion(turning).unwrap();
    let blade = world.add_geometry(Geometry::cuboid(Vec3::new(0.3, 0.02, 0.1)).unwrap());
    let at = Vec3::new(1.0, 0.0, 0.2);
    world
        .add_body(Body { name: "blade <1>".into(), motion: turning, ..Body::new(blade, stone, at) })
        .unwrap();
    let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
    let rod = world.add_geometry(Geometry::capsule(0.1, 0.05).unwrap());
    let sphere = |x: f64| Part {
        shape: Shape::Sphere(Sphere { radius: 0.06 }),
        position: Vec3::new(x, 0.0, 0.0),
        orientation: Quat::IDENTITY,
    };
    let pair = world.add_geometry(Geometry::compound(vec![sphere(-0.05), sphere(0.07)]).unwrap().0);
    for (k, geometry) in [ball, rod, pair, ball].into_iter().enumerate() {
        let position = Vec3::new(0.3 * k as f64 - 0.6, 0.05, 0.13 + 0.02 * k as f64);
        let orientation = Quat::from_rotation_y(0.4 * k as f64);
        world.add_body(Body { orientation, ..Body::new(geometry, stone, position) }).unwrap();
    }
    world
}

/// Runs the world for some steps, and returns the states after each step, the initial one included.
fn run_into(folder: &std::path::Path, steps: u64) -> Vec<World> {
    run_in_stages(folder, steps, Vec::new())
}

fn run_in_stages(folder: &std::path::Path, steps: u64, stages: Vec<Stage>) -> Vec<World> {
    struct Keep(Vec<World>);
    impl graintrain_io::run::Observer for Keep {
        fn observe(
            &mut self,
            step: graintrain_io::run::StepView<'_>,
        ) -> Result<(), graintrain_io::files::OutputError> {
            self.0.push(step.world.clone());
            Ok(())
        }
    }
    let settings = RunSettings {
        scene: "a <b> & c".into(),
        stepping: StepSettings {
            step: 0.01,
            envelope: 0.02,
            overlap: OverlapCorrection::Position,
            solver: SolverChoice {
                name: "apgd".parse().unwrap(),
                tolerance: 1e-6,
                criterion: graintrain_ccp::Criterion::Mixed,
                max_iterations: None,
                friction: FrictionModel::Relaxed,
            },
        },
        steps,
        stages,
        measures: Vec::new(),
        open_boundaries: Default::default(),
        dump_problem_every: None,
        output: OutputSettings {
            every: 1,
            bodies: true,
            contacts: true,
            precision: Precision::Single,
            checkpoint_every: 100,
        },
    };
    let mut recorder =
        Recorder::begin(folder::RunFolder::create(folder, false).unwrap(), &settings, &world(), "").unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let mut run = Run::new(world(), settings, RunTotals::default(), stop).unwrap();
    let mut keep = Keep(vec![world()]);
    run.advance(&mut [&mut recorder, &mut keep]).unwrap();
    recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished).unwrap();
    keep.0
}

/// Replays what was run in the folder and compares it with the states that the run went through; returned is
/// how many contacts they had.
fn compare(folder: &std::path::Path, truth: &[World]) -> usize {
    let run = RunFolder::open(folder).unwrap();
    assert_eq!(run.times().len(), truth.len());
    let mut loaded = 0;
    for (k, expected) in truth.iter().enumerate() {
        let world = run.world(k).unwrap();
        assert!((world.time - expected.time).abs() < 1e-12);
        for body in 0..expected.bodies.len() {
            let near = |a: Vec3, b: Vec3| assert!(a.distance(b) < 2e-6, "step {k}, body {body}: {a} and {b}");
            near(world.bodies.position[body], expected.bodies.position[body]);
            let (a, b) = (world.bodies.orientation[body], expected.bodies.orientation[body]);
            assert!(a.dot(b).abs() > 1.0 - 1e-6, "step {k}, body {body}: {a} and {b}");
            if expected.free_degrees(body).contains(&true) {
                near(world.bodies.velocity[body], expected.bodies.velocity[body]);
            }
        }
        assert_eq!(world.contacts.contacts.len(), expected.contacts.contacts.len());
        for (a, b) in world.contacts.contacts.iter().zip(&expected.contacts.contacts) {
            assert_eq!((a.body_a, a.body_b), (b.body_a, b.body_b));
            assert!(a.point.distance(b.point) < 1e-6 && a.normal.distance(b.normal) < 1e-6);
            loaded += 1;
        }
        for (a, b) in world.contacts.impulse.iter().zip(&expected.contacts.impulse) {
            assert!(a.distance(*b) < 1e-6 * (1.0 + b.length()));
        }
    }
    loaded
}

/// The blade stands, falls freely and stands again: a body that is fixed in some stages only is in every
/// frame where it was. (Its surface was listed among those that never move, in a file that was not written.)
#[test]
fn bodies_that_are_fixed_in_some_stages_only_read_back() {
    let stage = |name: &str, motion: Option<Motion>| Stage {
        name: name.into(),
        most: Some(4),
        least: 0,
        kinetic_energy: None,
        unbalanced_force: None,
        filled: false,
        steady: None,
        growth: None,
        gravity: None,
        materials: None,
        motions: vec![(BodyId::from_index(1), motion)],
        cell: None,
        loads: None,
    };
    let fixed = || Some(Motion::fixed());
    for motions in [[fixed(), None, fixed()], [None, fixed(), None]] {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().join("run");
        let stages = motions.into_iter().map(|motion| stage("part", motion)).collect();
        let truth = run_in_stages(&folder, 12, stages);
        assert!(compare(&folder, &truth) > 20, "the scene has contacts");
    }
}

#[test]
fn frames_read_back_as_the_worlds_that_were_written() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("run");
    let truth = run_into(&folder, 12);
    assert!(compare(&folder, &truth) > 20, "the scene has contacts");
    let run = RunFolder::open(&folder).unwrap();
    let turned = run.world(12).unwrap().bodies.orientation[1].angle_between(Quat::IDENTITY);
    assert!((turned - 2.0 * 0.12).abs() < 1e-5, "the blade has turned by {turned}");
}

/// The text of an element of the page.
fn between<'a>(page: &'a str, start: &str, end: &str) -> &'a str {
    let from = page.find(start).expect("the element") + start.len();
    &page[from..from + page[from..].find(end).expect("its end")]
}

/// Unpacks frames by the layout that the documentation of [`pack`] states.
fn unpack(text: &str, bodies: usize, oriented: usize, contacts: &[usize], ranges: &Ranges) -> Vec<Frame> {
    let packed = base64::engine::general_purpose::STANDARD.decode(text).unwrap();
    let mut bytes = Vec::new();
    GzDecoder::new(packed.as_slice()).read_to_end(&mut bytes).unwrap();
    let mut rest = bytes.as_slice();
    let mut words = |count: usize| -> Vec<u16> {
        let (now, later) = rest.split_at(2 * count);
        rest = later;
        now.as_chunks::<2>().0.iter().map(|&pair| u16::from_le_bytes(pair)).collect()
    };
    let place = |axis: usize, word: u16| {
        ranges.low[axis] + (ranges.high[axis] - ranges.low[axis]) * f32::from(word) / 65535.0
    };
    let mut previous = vec![0_u16; 3 * bodies];
    let mut frames = Vec::new();
    for &count in contacts {
        let change = words(3 * bodies);
        previous.iter_mut().zip(change).for_each(|(word, change)| *word = word.wrapping_add(change));
        let position = (0..bodies).map(|i| [0, 1, 2].map(|k| place(k, previous[k * bodies + i]))).collect();
        let turns = words(4 * oriented);
        let orientation =
            turns.chunks_exact(4).map(|q| [0, 1, 2, 3].map(|k| f32::from(q[k] as i16) / 32767.0)).collect();
        let mut field = |most: f32| words(bodies).iter().map(|&w| f32::from(w) / 65535.0 * most).collect();
        let fields = ranges.fields.iter().map(|&most| field(most)).collect();
        let pairs = words(4 * count);
        let body = |k: usize| u32::from(pairs[2 * k]) | u32::from(pairs[2 * k + 1]) << 16;
        let spots = words(3 * count);
        let loads = words(count);
        let contacts = (0..count)
            .map(|i| {
                let point = [0, 1, 2].map(|k| place(k, spots[3 * i + k]));
                (body(i), body(count + i), point, f32::from(loads[i]) / 65535.0 * ranges.force)
            })
            .collect();
        frames.push(Frame { time: 0.0, position, orientation, fields, size: Vec::new(), contacts });
    }
    assert!(rest.is_empty(), "{} bytes are left over", rest.len());
    frames
}

#[test]
fn the_page_holds_the_frames() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("run");
    let truth = run_into(&folder, 20);
    let page =
        page(&RunFolder::open(&folder).unwrap(), &ViewSettings { max_frames: 7, ..ViewSettings::default() });
    let page = page.unwrap();
    assert!(page.contains("<title>a &lt;b&gt; &amp; c</title>") && !page.contains("{{"));
    assert!(!page.contains("http://") && !page.contains("https://"), "the page needs no network");
    let header: serde_json::Value =
        serde_json::from_str(between(&page, "<script id=\"header\" type=\"application/json\">", "</script>"))
            .unwrap();
    let packed = &header["chunk"]["ranges"];
    let numbers = |name: &str| -> Vec<f32> {
        packed[name].as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32).collect()
    };
    let corner = |name: &str| -> [f32; 3] { std::array::from_fn(|k| numbers(name)[k]) };
    let ranges = Ranges {
        low: corner("low"),
        high: corner("high"),
        fields: numbers("fields"),
        force: packed["force"].as_f64().unwrap() as f32,
        size: packed["size"].as_f64().unwrap() as f32,
    };
    let frames = header["chunk"]["frames"].as_array().unwrap();
    let shown: Vec<usize> = [2, 5, 8, 11, 14, 17, 20].to_vec();
    assert_eq!(frames.len(), shown.len());
    let contacts: Vec<usize> = frames.iter().map(|f| f["contacts"].as_u64().unwrap() as usize).collect();
    let oriented = the_page_holds_the_model(&page, &header, &truth[0]);
    assert_eq!(oriented, [0, 1, 3, 4], "all but the balls");
    let data = between(&page, "<script id=\"data\" type=\"text/plain\">", "</script>");
    let decoded = unpack(data, truth[0].bodies.len(), oriented.len(), &contacts, &ranges);
    let resolution = (0..3).map(|k| ranges.high[k] - ranges.low[k]).fold(0.0, f32::max) / 65535.0;
    assert!(contacts.iter().sum::<usize>() > 5);
    for (frame, &k) in decoded.iter().zip(&shown) {
        for body in 0..truth[k].bodies.len() {
            let expected = truth[k].bodies.position[body].as_vec3().to_array();
            for axis in 0..3 {
                assert!((frame.position[body][axis] - expected[axis]).abs() <= resolution);
            }
            let speed = truth[k].bodies.velocity[body].length() as f32;
            assert!(
                (frame.fields[0][body] - speed).abs() <= ranges.fields[0] / 60000.0
                    || truth[k].is_prescribed(body)
            );
            let touching = |c: &&graintrain::contact::Contact| [c.body_a, c.body_b].contains(&(body as u32));
            let loaded = truth[k].contacts.contacts.iter().zip(&truth[k].contacts.impulse);
            let loaded = loaded.filter(|(c, p)| p.dot(c.normal) > 0.0).map(|(c, _)| c);
            let expected = loaded.filter(touching).count() as f32;
            assert!((frame.fields[3][body] - expected).abs() < 1e-3, "step {k}, body {body}");
        }
        for contact in &frame.contacts {
            let near = |other: &graintrain::contact::Contact| {
                other.body_a == contact.0
                    && other.body_b == contact.1
                    && Vec3::from(contact.2.map(f64::from)).distance(other.point)
                        < 2.0 * f64::from(resolution)
            };
            let found = truth[k].contacts.contacts.iter().position(near).expect("the contact exists");
            let exact = truth[k].contacts.impulse[found].dot(truth[k].contacts.contacts[found].normal) / 0.01;
            assert!((f64::from(contact.3) - exact).abs() < 1e-4 * f64::from(ranges.force));
        }
    }
    let charts = header["charts"].as_array().unwrap();
    let titles: Vec<&str> = charts.iter().map(|chart| chart["title"].as_str().unwrap()).collect();
    assert!(titles.contains(&"Kinetic energy") && titles.contains(&"force on blade <1>"), "{titles:?}");
    for chart in charts {
        let lengths = [&chart["points"], &chart["series"][0]["x"], &chart["series"][0]["y"]];
        assert_eq!(lengths.map(|list| list.as_array().unwrap().len()), [20; 3]);
    }
}

/// Checks the block of what does not change, by the layout that [`pack`] states; returned is which bodies are
/// oriented.
fn the_page_holds_the_model(page: &str, header: &serde_json::Value, world: &World) -> Vec<u32> {
    let text = between(page, "<script id=\"model\" type=\"text/plain\">", "</script>");
    let packed = base64::engine::general_purpose::STANDARD.decode(text).unwrap();
    let mut bytes = Vec::new();
    GzDecoder::new(packed.as_slice()).read_to_end(&mut bytes).unwrap();
    let mut rest = bytes.as_slice();
    let mut take = |count: u64| {
        let (now, later) = rest.split_at(count as usize);
        rest = later;
        now.to_vec()
    };
    let index = |bytes: Vec<u8>| -> Vec<u32> {
        bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
    };
    let count = |value: &serde_json::Value| value.as_u64().unwrap();
    let bodies = count(&header["bodies"]);
    assert_eq!(bodies, world.bodies.len() as u64);
    assert_eq!(take(bodies), [0, 0, 1, 1, 1, 1], "grains");
    assert_eq!(take(2 * bodies), [0; 12], "materials");
    assert_eq!(index(take(4 * count(&header["balls"]))), [2, 5]);
    let radii = index(take(8));
    assert_eq!(radii.into_iter().map(f32::from_bits).collect::<Vec<f32>>(), [0.1, 0.1]);
    let oriented = index(take(4 * count(&header["oriented"])));
    for group in header["groups"].as_array().unwrap() {
        let (bodies, triangles) =
            (index(take(4 * count(&group["bodies"]))), take(36 * count(&group["triangles"])));
        assert_eq!((bodies.len(), triangles.is_empty()), (1, false));
        let far = index(triangles)
            .as_chunks::<3>()
            .0
            .iter()
            .map(|corner| Vec3::from_array(corner.map(|word| f64::from(f32::from_bits(word)))).length())
            .fold(0.0, f64::max);
        let body = bodies[0] as usize;
        let geometry = &world.geometries[world.bodies.geometry[body].index()];
        if body > 0 {
            assert!((far / geometry.bounding_radius() - 1.0).abs() < 0.02, "body {body}: {far}");
        }
    }
    assert!(rest.is_empty(), "{} bytes are left over", rest.len());
    oriented
}

#[test]
fn damaged_runs_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    assert!(matches!(RunFolder::open(&empty), Err(ViewError::Checkpoint(_))));
    let run_folder = folder.path().join("run");
    run_into(&run_folder, 2);
    let run = RunFolder::open(&run_folder).unwrap();
    let frame = run_folder.join("frames/bodies_00000001.vtp");
    let text = std::fs::read_to_string(&frame).unwrap();
    std::fs::write(&frame, text.replace("Name=\"omega\"", "Name=\"other\"")).unwrap();
    assert!(run.world(1).unwrap_err().to_string().contains("no array omega"));
    std::fs::write(&frame, &text[..text.len() / 2]).unwrap();
    assert!(matches!(run.world(1), Err(ViewError::Malformed { .. })));
    std::fs::remove_file(&frame).unwrap();
    assert!(matches!(page(&run, &ViewSettings::default()), Err(ViewError::Read { .. })));
    std::fs::remove_file(run_folder.join("bodies.pvd")).unwrap();
    let run = RunFolder::open(&run_folder).unwrap();
    assert!(matches!(page(&run, &ViewSettings::default()), Err(ViewError::NoFrames { .. })));
}

/// Runs a scene into a folder.
fn run_scene(text: &str, folder: &std::path::Path) -> World {
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    let scene = graintrain_io::scene::Scene::load(&path.to_string_lossy(), &[]).unwrap();
    let simulation = scene.build().unwrap();
    let settings = RunSettings::new(&simulation, None);
    let taken = folder::RunFolder::create(&folder.join("run"), false).unwrap();
    let mut recorder = Recorder::begin(taken, &settings, &simulation.world, "").unwrap();
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), Arc::default()).unwrap();
    run.advance(&mut [&mut recorder]).unwrap();
    recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished).unwrap();
    run.world
}

/// Two forms that grow, and one that comes from a stream meanwhile: every frame has the sizes of its time, in
/// pictures and in the page.
#[test]
fn growing_bodies_have_the_size_of_the_frame() {
    let text = r#"
gravity = [0, 0, 0]
[time]
step = "10 ms"
end = "0.2 s"
[output]
every = "0.1 s"
precision = "single"
[packing.balls]
radius = 0.02
lattice = { counts = [2, 1, 1], pitch = 0.2, origin = [-0.2, 0, 0] }
[packing.boxes]
shape = { box = { size = [0.02, 0.03, 0.04] } }
lattice = { counts = [1, 2, 1], pitch = 0.2, origin = [0.2, -0.2, 0] }
[stream.late]
radius = 0.01
count = 2
start = "0.05 s"
region = { box = { min = [-0.4, -0.4, 0.3], max = [0.4, 0.4, 0.4] } }
[[stage]]
name = "grow"
growth = { rate = "3/s", porosity = 0.3, region = { box = { min = [-0.5, -0.5, -0.5], max = [0.5, 0.5, 0.5] } } }
"#;
    let folder = tempfile::tempdir().unwrap();
    let last = run_scene(text, folder.path());
    let radius =
        |world: &World, body: usize| world.geometries[world.bodies.geometry[body].index()].bounding_radius();
    assert!(radius(&last, 0) > 0.024, "{}", radius(&last, 0));
    let run = RunFolder::open(&folder.path().join("run")).unwrap();
    let first = run.world(0).unwrap();
    assert!((radius(&first, 0) - 0.02).abs() < 1e-8, "{}", radius(&first, 0));
    let half = Vec3::new(0.01, 0.015, 0.02).length();
    assert!((radius(&first, 2) / half - 1.0).abs() < 1e-6, "{}", radius(&first, 2));
    assert!(
        (first.bodies.mass[0] / last.bodies.mass[0] / (0.02 / radius(&last, 0)).powi(3) - 1.0).abs() < 1e-5
    );
    let end = run.times().len() - 1;
    let shown = run.world(end).unwrap();
    for body in 0..last.bodies.len() {
        assert!((radius(&shown, body) / radius(&last, body) - 1.0).abs() < 1e-6, "{body}");
    }
    let html = page(&run, &ViewSettings::default()).unwrap();
    let grown = radius(&last, 0) / 0.02;
    let begin = html.find("\"size\":").unwrap() + 7;
    let found: f64 = html[begin..].split('}').next().unwrap().parse().unwrap();
    assert!((found / grown - 1.0).abs() < 1e-5, "{found} {grown}");
}

/// A damaged frame of a run whose bodies come and go is reported where it is asked for; the others are drawn.
#[test]
fn one_damaged_frame_spares_the_others() {
    let text = "[time]\nstep = \"10 ms\"\nend = \"0.2 s\"\n[output]\nevery = \"50 ms\"\n[stream.rain]\nradius = 0.05\ncount = 3\n\
                region = { box = { min = [0, 0, 1], max = [1, 1, 2] } }\n";
    let folder = tempfile::tempdir().unwrap();
    run_scene(text, folder.path());
    let path = folder.path().join("run");
    let bytes = std::fs::read(path.join("frames/bodies_00000005.vtp")).unwrap();
    std::fs::write(path.join("frames/bodies_00000005.vtp"), &bytes[..bytes.len() / 2]).unwrap();
    let run = RunFolder::open(&path).unwrap();
    assert!(run.world(1).is_err());
    assert_eq!(run.world(2).unwrap().bodies.len(), 3);
}

/// The cell of a periodic run comes back from its frames.
#[test]
fn frames_hold_the_periodic_cell() {
    let text = "gravity = [0, 0, 0]\n[time]\nstep = \"10 ms\"\nsteps = 10\n[output]\nevery = \"50 ms\"\n[periodic]\nmin = [0, 0, -1]\nmax = [1, 2, 1]\n\
                rate = { xy = 0.5, zz = -0.2 }\n[packing.a]\nradius = 0.05\nlattice = { counts = [1, 1, 1], pitch = 1, origin = [0.5, 0.5, 0] }\n";
    let folder = tempfile::tempdir().unwrap();
    let last = run_scene(text, folder.path());
    let run = RunFolder::open(&folder.path().join("run")).unwrap();
    let [first, end] = [0, 2].map(|index| run.snapshot(index).unwrap().cell.unwrap());
    assert_eq!(first.vectors, [Vec3::X, 2.0 * Vec3::Y, 2.0 * Vec3::Z]);
    assert_eq!((first.origin, first.periodic), (Vec3::new(0.0, 0.0, -1.0), [true; 3]));
    let cell = last.cell().unwrap();
    assert_eq!(end.vectors[1], Vec3::new(cell.tilt[0], cell.size.y, 0.0));
    assert!(end.vectors[1].x > 0.05 && end.vectors[2].z < 1.99, "{end:?}");
}

/// What the server of a run answers to a request, until it says no more or `enough` of it has come.
fn ask(url: &str, request: &str, enough: &str) -> String {
    use std::io::Write;
    let address = url.trim_start_matches("http://").trim_end_matches('/');
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(std::time::Duration::from_secs(10))).unwrap();
    stream.write_all(request.replace("HOST", address).as_bytes()).unwrap();
    let (mut answer, mut bytes) = (Vec::new(), [0; 4096]);
    while let Ok(count @ 1..) = stream.read(&mut bytes) {
        answer.extend(&bytes[..count]);
        if !enough.is_empty() && String::from_utf8_lossy(&answer).contains(enough) {
            break;
        }
    }
    String::from_utf8_lossy(&answer).into_owned()
}

/// The page, its frames and its buttons; nothing for pages of other sites.
#[test]
fn a_run_under_way_is_shown_and_stopped_to_its_own_page_alone() {
    use std::sync::atomic::Ordering;
    let stopped = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stopped);
    let stop = move || flag.store(true, Ordering::Relaxed);
    let live = live::Live::serve(&world(), "under way", 0.01, 10, None, 0, stop).unwrap();
    let url = live.url();
    let page = ask(&url, "GET / HTTP/1.1\r\nHost: HOST\r\n\r\n", "");
    assert!(page.starts_with("HTTP/1.1 200 OK") && page.contains("<title>under way</title>"));
    assert!(page.contains("\"live\":1") && !page.contains("{{"));
    let events = ask(&url, "GET /events?generation=1 HTTP/1.1\r\nHost: HOST\r\n\r\n", "event: state");
    assert!(events.contains("event: frame") && !events.contains("event: bodies"), "{events}");
    let events = ask(&url, "GET /events?generation=0 HTTP/1.1\r\nHost: HOST\r\n\r\n", "event: frame");
    assert!(events.contains("event: bodies"), "a page that knows other bodies is sent these");
    for request in [
        "GET / HTTP/1.1\r\nHost: example.org\r\n\r\n",
        "GET / HTTP/1.1\r\n\r\n",
        "POST /stop HTTP/1.1\r\nHost: HOST\r\nOrigin: http://example.org\r\n\r\n",
    ] {
        assert!(ask(&url, request, "").starts_with("HTTP/1.1 403"), "{request}");
    }
    assert!(!stopped.load(Ordering::Relaxed));
    assert!(ask(&url, "GET /stop HTTP/1.1\r\nHost: HOST\r\n\r\n", "").starts_with("HTTP/1.1 404"));
    let own = "POST /stop HTTP/1.1\r\nHost: HOST\r\nOrigin: http://HOST\r\n\r\n";
    assert!(ask(&url, own, "").starts_with("HTTP/1.1 204"));
    assert!(stopped.load(Ordering::Relaxed));
    live.end("over");
}

/// A film of 0.12 s in 13 frames at half the speed has 50 pictures a second, all seen by one camera; faster
/// than screens it has fewer.
#[test]
fn films_have_the_frames_of_the_run_at_their_speed() {
    use crate::film::{Film, FilmError};
    use crate::render::RenderSettings;
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("run");
    run_into(&folder, 12);
    let settings = RenderSettings { width: 96, height: 72, ..RenderSettings::default() };
    let film = |speed: f64| Film::new(RunFolder::open(&folder).unwrap(), &settings, speed);
    let slow = film(0.5).unwrap();
    assert_eq!(slow.pictures(), 13);
    assert!((slow.rate - 50.0).abs() < 1e-6 && (slow.speed - 0.5).abs() < 1e-9, "{}", slow.rate);
    let (first, last) = (slow.picture(0).unwrap(), slow.picture(12).unwrap());
    assert!(first.pixels != last.pixels);
    let fast = film(2.0).unwrap();
    assert_eq!(fast.pictures(), 4);
    assert!((fast.rate - 50.0).abs() < 1e-6 && (fast.speed - 2.0).abs() < 1e-9, "{}", fast.rate);
    assert!(matches!(film(0.0), Err(FilmError::Speed(_))));
}

/// The numbers of an attribute's samples: `code: [numbers]`, line by line.
fn usd_samples(layer: &str, prim: &str, attribute: &str) -> Vec<(f64, Vec<f64>)> {
    let prim = layer.split(&format!("def PointInstancer \"{prim}\"")).nth(1).unwrap();
    let lines = between(prim, &format!("{attribute}.timeSamples = {{\n"), "        }\n");
    let number = |word: &str| word.trim().parse().unwrap();
    let sample = |line: &str| {
        let (code, values) = line.trim().trim_end_matches("],").split_once(": [").unwrap();
        let plain = values.replace(['(', ')'], "");
        (number(code), plain.split(',').filter(|word| !word.trim().is_empty()).map(number).collect())
    };
    lines.lines().map(sample).collect()
}

#[test]
fn usd_layers_hold_the_frames() {
    let folder = tempfile::tempdir().unwrap();
    let truth = run_into(folder.path(), 12);
    let run = RunFolder::open(folder.path()).unwrap();
    let count = run.times().len();
    let layer = usd(&run, &(0..count).collect::<Vec<_>>()).unwrap();
    for [open, close] in [["{", "}"], ["[", "]"], ["(", ")"]] {
        assert_eq!(layer.matches(open).count(), layer.matches(close).count());
    }
    let (balls, rods) = ([2, 5], [3]);
    for (prim, bodies) in [("balls", &balls[..]), ("grains_2", &rods[..])] {
        let samples = usd_samples(&layer, prim, "positions");
        assert_eq!(samples.len(), count);
        for (k, (code, values)) in samples.iter().enumerate() {
            assert!((code - k as f64).abs() < 0.01 || k + 1 == count);
            let world = truth.iter().find(|world| (world.time - run.times()[k]).abs() < 1e-9).unwrap();
            for (slot, &body) in bodies.iter().enumerate() {
                let place = Vec3::new(values[3 * slot], values[3 * slot + 1], values[3 * slot + 2]);
                assert!((place - world.bodies.position[body]).length() < 1e-6, "{prim}, frame {k}");
            }
        }
    }
    // Real part first.
    let [first, ..] = &usd_samples(&layer, "grains_2", "orientations")[..] else { panic!("no samples") };
    let turn = Quat::from_xyzw(first.1[1], first.1[2], first.1[3], first.1[0]);
    assert!(turn.dot(truth[0].bodies.orientation[3]).abs() > 1.0 - 1e-6);
    assert!(
        layer.contains("upAxis = \"Z\"")
            && layer.contains("float3[] scales = [(0.1, 0.1, 0.1), (0.1, 0.1, 0.1)]")
    );
    assert!(matches!(usd(&run, &[]), Err(ViewError::NoFrames { .. })));
}
