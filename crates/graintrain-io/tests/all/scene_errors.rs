//! What is said about scenes that cannot be used: the exact words of the important messages, and never a
//! panic.

use graintrain_io::scene::{Scene, SceneError, Simulation, builtin, setting};
use proptest::prelude::*;
use std::path::Path;

const BALL: &str =
    "[time]\nstep = \"1 ms\"\nend = 1\n[body.ball]\nshape = { sphere = { radius = \"1 cm\" } }\n";

fn load(text: &str, settings: &[&str]) -> Result<Simulation, SceneError> {
    let settings = settings.iter().map(|text| setting(text)).collect::<Result<Vec<_>, _>>()?;
    Scene::parse("a", "a.toml", text, Path::new("/nowhere"), &settings)?.build()
}

fn fails(text: &str, settings: &[&str]) -> (String, String) {
    let error = load(text, settings).err().unwrap_or_else(|| panic!("no error for {settings:?} {text}"));
    (error.to_string(), error.help().unwrap_or_default())
}

/// The ball's scene with something more.
fn ball_and(text: &str) -> String {
    format!("{BALL}{text}")
}

#[test]
fn typos_name_place_and_closest_key() {
    assert_eq!(
        fails("[time]\nstp = 1\n", &[]),
        (
            "a.toml:2:1: unknown key `stp` in `time`".into(),
            "did you mean `step`? Known here: step, end, steps".into()
        )
    );
    assert_eq!(fails(&ball_and("mas = 3\n"), &[]).0, "a.toml:6:1: unknown key `mas` in `body.ball`");
    assert_eq!(
        fails(BALL, &["solver.tolerence=1e-5"]),
        (
            "--set:1:8: unknown key `tolerence` in `solver`".into(),
            "did you mean `tolerance`? Known here: name, tolerance, strict_max, max_iterations, friction"
                .into()
        )
    );
    let (message, help) = fails(BALL, &["nn=3"]);
    assert_eq!(message, "--set:1:1: unknown key `nn` in the scene and its parameters");
    assert!(help.starts_with("known here: title"), "{help}");
    let (message, help) = fails(&format!("parameters = {{ radius = 1 }}\n{BALL}"), &["raduis=3"]);
    assert_eq!(message, "--set:1:1: unknown key `raduis` in the scene and its parameters");
    assert!(help.starts_with("did you mean `radius`?"), "{help}");
    // A key of a table that is somewhere in the scene.
    let (message, help) = fails("[material.glass]\ndensity = 2000\n", &["density=2500"]);
    assert_eq!(message, "--set:1:1: unknown key `density` in the scene and its parameters");
    assert!(help.starts_with("did you mean `material.glass.density`?"), "{help}");
    assert_eq!(fails(BALL, &["banana"]).0, "--set:1:1: `banana` is not of the form KEY=VALUE");
    assert_eq!(fails(BALL, &["time.step.x=1"]).0, "--set:1:11: `time.step` holds a value, not a table");
}

#[test]
fn wrong_units_say_what_was_expected() {
    assert_eq!(
        fails("[time]\nstep = \"1 mm\"\nend = 1\n", &[]),
        (
            "a.toml:2:8: `time.step` must be a time (s), got a length (m)".into(),
            "write such a unit after the number, \"3 s\"; plain numbers are SI: m, kg, s, rad".into()
        )
    );
    let help = fails(BALL, &["body.ball.density=2500 kg"]).1;
    assert!(help.contains("\"3 kg/m^3\""), "{help}");
    let cases = [
        ("body.ball.shape.sphere.radius=30 deg", "must be a length (m), got an angle (rad)"),
        (
            "body.ball.velocity=[0, 0, \"3 m\"]",
            "`body.ball.velocity.2` must be a speed (m/s), got a length (m)",
        ),
        ("gravity=[0, 0, \"9.81 m/s\"]", "must be an acceleration (m/s^2), got a speed (m/s)"),
        ("time.step=1 + 1 s", "cannot add a number without unit and a time (s)"),
        ("time.step=1 sec", "`sec` is neither a unit nor a parameter"),
        ("time.step=1 s2", "`s2` is no unit; write the power as `s^2`"),
        ("time.step=(1 s", "this parenthesis is not closed"),
        ("time.step=1 s 2", "an operator is missing before this number"),
        ("time.step=1/0", "division by zero"),
        ("time.step=", "cannot evaluate ``: it is empty"),
        ("solver.max_iterations=2.5", "must be a whole number, zero or positive, got 2.5"),
        ("output.bodies=1", "`output.bodies` must be true or false, e.g. false, got 1"),
    ];
    for (setting, expected) in cases {
        let message = fails(BALL, &[setting]).0;
        assert!(message.contains(expected), "{setting}: {message}");
    }
    // The place is that of the use; the parameters that it names are reported, as they are written.
    let scene = "[parameters]\nrate = \"5 kg\"\n[time]\nstep = \"2 * rate\"\nend = 1\n";
    let message = "a.toml:4:8: `time.step` must be a time (s), got a mass (kg), with `rate` = 5 kg";
    assert_eq!(fails(scene, &[]).0, message);
    let message = "a.toml:4:8: `time.step` must be positive, got -2 s, with `rate` = -1 s";
    assert_eq!(fails(scene, &["rate=-1 s"]).0, message);
}

#[test]
fn values_out_of_range_are_refused() {
    let cases = [
        ("body.ball.mass=-3", "`body.ball.mass` must be positive, got -3 kg"),
        ("body.ball.shape.sphere.radius=0", "must be positive, got 0 m"),
        ("body.ball.density=-1 kg/m^3", "must be positive, got -1 kg/m^3"),
        ("time.step=nan", "`time.step` must be finite, got NaN"),
        ("time.end=inf", "`time.end` must be finite, got inf"),
        ("time.step=-1 ms", "must be positive, got -0.001 s"),
        ("time.steps=0", "`time.steps` must be at least 1, got 0"),
        ("material.glass.restitution=1.5", "must be between 0 and 1, got 1.5"),
        ("material.glass.friction=-0.1", "must be zero or positive, got -0.1"),
        ("solver.name=apdg", "`solver.name` names the solver `apdg`, which does not exist"),
        ("solver.friction=colomb", "names the choice `colomb`, which does not exist"),
        ("body.ball.material=glas", "names the material `glas`, which does not exist"),
        ("body.ball.motion.free=[\"q\"]", "names the degree of freedom `q`, which does not exist"),
        ("body.ball.rotation.axis=[0, 0, 0]", "must be a direction of any length but zero"),
        ("body.ball.position=[1, 2]", "must be three times a length (m), e.g."),
        ("body.ball.shape=3", "`body.ball.shape` must be a table, got 3"),
    ];
    for (setting, expected) in cases {
        let message = fails(BALL, &[setting]).0;
        assert!(message.contains(expected), "{setting}: {message}");
    }
    assert_eq!(fails(BALL, &["solver.name=apdg"]).1[..23], *"did you mean `apgd`? Kn");
}

#[test]
fn missing_and_contradicting_keys() {
    assert_eq!(fails("title = 'x'\n", &[]).0, "a.toml:1:1: the scene lacks `time`");
    assert_eq!(
        fails("[time]\nend = 1\n", &[]),
        ("a.toml:1:1: `time` lacks `step`".into(), "add `step = ...`: a time (s), e.g. \"25 ms\"".into())
    );
    assert_eq!(
        fails("[time]\nstep = 1\nend = 1\nsteps = 3\n", &[]).0,
        "a.toml:1:1: `time` needs exactly one of end, steps, got end and steps"
    );
    let cases = [
        ("[body.b]\n", "`body.b` needs exactly one of shape, parts, got none"),
        ("[body.b]\nshape = { sphere = { radius = 1 }, box = { size = [1, 1, 1] } }\n", "got sphere and box"),
        ("[body.b]\nmotion = 'free'\nshape = { plane = {} }\n", "`body.b` has no mass"),
        ("[material.a]\n[material.b]\n", "`body.ball` lacks `material`"),
        ("[packing.p]\nlattice = { counts = [1, 1, 1], pitch = 1 }\n", "`packing.p` lacks `radius`"),
        ("[packing.p]\nradius = 1\nlattice = { counts = [1, 0, 1], pitch = 1 }\n", "must be at least 1 each"),
        (
            "[packing.p]\nradius = 1\nlattice = { counts = [1e6, 1e6, 1e6], pitch = 3 }\n",
            "packing `p` asks for more than 100000000 bodies",
        ),
        (
            "[measure.m]\nmotion = true\npackings = []\n",
            "`measure.m.packings` must be at least one packing, or left out, got none",
        ),
        (
            "[joint.j]\nkind = 'gear'\njoints = []\nratio = 1\n",
            "`joint.j.joints` must be at least one joint above this one, or left out, got none",
        ),
    ];
    for (text, expected) in cases {
        let message = fails(&ball_and(text), &[]).0;
        assert!(message.contains(expected), "{text}: {message}");
    }
    assert_eq!(fails("[time\n", &[]).0[..30], *"a.toml:1:6: not valid TOML: un");
}

#[test]
fn setting_one_of_several_keys_unsets_the_others() {
    assert_eq!(load(BALL, &["time.steps=7"]).unwrap().steps, 7);
    assert_eq!(load(BALL, &["time.steps=7", "time.end=2"]).unwrap().steps, 2000);
    let boxed = load(BALL, &["body.ball.shape.box.size=[1, 1, 1]", "body.ball.mass=3"]).unwrap();
    assert!((boxed.world.bodies.mass[0] - 3.0).abs() < 1e-15);
    assert!((boxed.world.bodies.inertia[0].x_axis.x - 0.5).abs() < 1e-12, "m (a^2 + b^2) / 12");
}

#[test]
fn parameters_refer_to_each_other_but_not_in_circles() {
    let text = format!("parameters = {{ a = \"2*b\", b = \"3 ms\", n = 2, d = \"x\" }}\n{BALL}");
    let simulation = load(&text, &["time.step=a", "time.steps=2*n+1"]).unwrap();
    assert_eq!((simulation.settings.step, simulation.steps), (0.006, 5));
    assert_eq!(load(&text, &["b=1 ms", "time.step=a"]).unwrap().settings.step, 0.002);
    let message = fails(&text, &["b=a", "time.step=a"]).0;
    assert!(message.contains("the parameter is defined by itself"), "{message}");
    assert!(fails(&text, &["time.step=d"]).0.contains("`x` is neither a unit nor a parameter"));
    let message = fails(&format!("parameters = {{ m = 3 }}\n{BALL}"), &[]).0;
    assert!(message.starts_with("a.toml:1:16: the parameter `m` already means a unit"), "{message}");
}

#[test]
fn overlap_and_emptiness_are_reported() {
    let overlapping =
        ball_and("[body.other]\nposition = [\"19 mm\", 0, 0]\nshape = { sphere = { radius = \"1 cm\" } }\n");
    let (message, help) = fails(&overlapping, &[]);
    assert!(message.contains("overlap at the start: deepest pair `"), "{message}");
    assert!(message.contains("by 1.000e-3 m, more than the allowed 1.000e-4 m"), "{message}");
    assert!(help.contains("contact.allowed_overlap = \"1.01e-3 m\""), "{help}");
    assert!(load(&overlapping, &["contact.allowed_overlap=1.01e-3 m"]).is_ok());
    assert_eq!(fails("time = { step = 1, end = 1 }\n", &[]).0, "the scene has no bodies");
    assert_eq!(
        fails(BALL, &["body.ball.motion=fixed"]).0,
        "no body of the scene is free to move: nothing would happen"
    );
    let full = ball_and(
        "[packing.p]\nradius = 0.1\ndrop = { count = 100, box = { min = [1, 1, 1], max = [1.5, 1.5, 1.5] } }\n",
    );
    let (message, help) = fails(&full, &[]);
    assert!(message.contains("packing `p`: only ") && message.contains(" of 100 bodies fit"), "{message}");
    assert!(help.starts_with("enlarge the region"));
}

#[test]
fn files_that_are_missing_or_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pile.vtu");
    let text = ball_and(&format!("[packing.p]\nfile = {{ path = '{}' }}\n", path.display()));
    assert!(fails(&text, &[]).0.contains("pile.vtu`: No such file"), "{:?}", fails(&text, &[]));
    let xml = "<VTKFile type=\"UnstructuredGrid\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"1\">\n<Points>\
               <DataArray type=\"Float32\" NumberOfComponents=\"3\">5 5 5</DataArray></Points>\n<PointData>\
               <DataArray type=\"Float32\" Name=\"radius\">1</DataArray></PointData></Piece>\n\
               </UnstructuredGrid></VTKFile>";
    std::fs::write(&path, xml).unwrap();
    assert_eq!(load(&text, &[]).unwrap().world.bodies.len(), 2);
    for end in 0..xml.len() {
        std::fs::write(&path, &xml[..end]).unwrap();
        let message = fails(&text, &[]).0;
        assert!(message.contains("pile.vtu`"), "{message}");
    }
    std::fs::write(&path, xml.replace("Points=\"1\"", "Points=\"2\"")).unwrap();
    assert!(fails(&text, &[]).0.contains("line 3: NumberOfPoints announces 2, but there are 1 points"));
    std::fs::write(&path, xml.replace(">1<", ">-1<")).unwrap();
    assert!(fails(&text, &[]).0.contains("sphere 1 has the radius -1; radii must be positive"));
    std::fs::write(&path, xml.replace(">1<", ">nan<")).unwrap();
    assert!(fails(&text, &[]).0.contains("sphere 1 has the radius NaN"));
    let error = Scene::load("sedimentaton", &[]).unwrap_err();
    assert_eq!(error.to_string(), "no scene file and no built-in scene is called `sedimentaton`");
    assert!(error.help().unwrap().starts_with("did you mean `sedimentation`?"));
    let missing = Scene::load("missing.toml", &[]).unwrap_err().to_string();
    assert!(missing.starts_with("cannot read `missing.toml`: No such file"), "{missing}");
}

/// A text with some bytes replaced, and cut short.
fn damaged(text: &str, edits: &[(usize, char)], end: usize) -> String {
    let mut characters: Vec<char> = text.chars().collect();
    for &(place, character) in edits {
        let place = place % characters.len();
        characters[place] = character;
    }
    characters.truncate(end % (characters.len() + 1));
    characters.into_iter().collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn damaged_scenes_never_panic(
        which in 0..builtin::SCENES.len(),
        edits in prop::collection::vec((any::<usize>(), prop_oneof![any::<char>(), proptest::char::range(' ', '~')]), 0..6),
        end in prop_oneof![Just(usize::MAX / 2), any::<usize>()],
    ) {
        let text = damaged(builtin::SCENES[which].text, &edits, end);
        // Reading only: a mutated count may ask for more bodies than a test should make.
        if let Err(error) = Scene::parse("a", "a.toml", &text, Path::new(""), &[]) {
            prop_assert!(!error.to_string().is_empty());
            let _ = (error.help(), error.location.map(|location| location.line_column()));
        }
    }

    #[test]
    fn damaged_packing_files_never_panic(
        form in 0..5_usize,
        edits in prop::collection::vec((any::<usize>(), proptest::char::range(' ', '~')), 0..4),
        end in prop_oneof![Just(usize::MAX / 2), any::<usize>()],
    ) {
        let (ending, content) = [
            ("csv", "x,y,z,radius\n1,2,3,0.1\n4,5,6,0.1\n".to_string()),
            ("txt", "Radius[m] PosX[mm] PosY[m] PosZ[m]\n0.1 1 2 3\n0.1 4 5 6\n".to_string()),
            ("vtp", "<VTKFile header_type=\"UInt64\"><PolyData><Piece NumberOfPoints=\"1\"><Points><DataArray type=\"Float64\" format=\"binary\">GAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=</DataArray></Points><PointData><DataArray Name=\"radius\" format=\"ascii\">1</DataArray></PointData></Piece></PolyData></VTKFile>".to_string()),
            ("stl", "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n".to_string()),
            ("obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/2 -1\n".to_string()),
        ][form].clone();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("a.{ending}"));
        std::fs::write(&path, damaged(&content, &edits, end)).unwrap();
        let place = path.display();
        let text = if form < 3 {
            format!("[time]\nstep = 1\nend = 1\n[packing.p]\nfile = {{ path = '{place}' }}\n")
        } else {
            format!("{BALL}position = [0, 0, 9]\n[body.m]\nshape = {{ mesh = {{ file = '{place}' }} }}\n")
        };
        match load(&text, &[]) {
            Ok(simulation) => prop_assert!(!simulation.world.bodies.is_empty()),
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
    }
}
