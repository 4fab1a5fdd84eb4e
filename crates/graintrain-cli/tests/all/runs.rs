//! `run` and `resume` as a user meets them: results, interruptions, failures, exit codes.
#![cfg(unix)]

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const SCENE: &str = r#"
[time]
step = "5 ms"
steps = 60
[solver]
name = "apgd"
tolerance = 1e-5
[output]
every = "50 ms"
checkpoint_every = "50 ms"
[body.ground]
shape = { plane = { normal = [0, 0, 1] } }
motion = "fixed"
[packing.balls]
radius = "5 cm"
lattice = { counts = [4, 4, 4], pitch = "11 cm", jitter = "4 mm", origin = [0, 0, "2 cm"] }
"#;

pub fn graintrain(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_graintrain"));
    command.current_dir(folder).args(arguments);
    command
}

pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("balls.toml"), SCENE).unwrap();
    folder
}

pub fn ended(mut command: Command, code: i32) -> (String, String) {
    reported(command.output().unwrap(), code)
}

pub fn reported(output: Output, code: i32) -> (String, String) {
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let (out, err) = (text(output.stdout), text(output.stderr));
    assert_eq!(output.status.code(), Some(code), "stdout: {out}\nstderr: {err}");
    assert!(!err.contains("panicked"), "{err}");
    (out, err)
}

pub fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

pub fn hash(folder: &Path) -> String {
    let summary: serde_json::Value = serde_json::from_str(&read(&folder.join("summary.json"))).unwrap();
    summary["state_hash"].as_str().unwrap().to_string()
}

/// Starts a run that does not end by itself and waits until some steps are recorded.
fn long_run(folder: &Path) -> Child {
    let child =
        graintrain(folder, &["run", "balls.toml", "--out", "cut", "--steps", "1000000", "--threads", "1"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
    let table = folder.join("cut/steps.csv");
    let start = Instant::now();
    while std::fs::read_to_string(&table).map_or(0, |text| text.lines().count()) < 15 {
        assert!(start.elapsed() < Duration::from_secs(60), "no steps are recorded");
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

pub fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

#[test]
fn a_run_leaves_its_files_and_says_what_it_did() {
    let folder = folder();
    let (out, err) = ended(graintrain(folder.path(), &["run", "balls.toml", "--threads", "2"]), 0);
    assert!(out.contains("is done: 60 steps") && out.contains("graintrain view out/balls"), "{out}");
    assert_eq!(err, "");
    let run = folder.path().join("out/balls");
    for file in
        ["all.pvd", "bodies.pvd", "contacts.pvd", "surfaces.pvd", "wrench.csv", "summary.json", "scene.toml"]
    {
        assert!(run.join(file).exists(), "{file}");
    }
    assert_eq!(read(&run.join("steps.csv")).lines().count(), 61);
    // A second run gets a folder of its own, has the same bits with another number of threads, and can be
    // quiet.
    let (out, err) = ended(graintrain(folder.path(), &["run", "balls.toml", "--threads", "1", "--quiet"]), 0);
    assert_eq!((out.as_str(), err.as_str()), ("", ""));
    assert_eq!(hash(&run), hash(&folder.path().join("out/balls-2")));
    // The resolved scene is a scene, and gives the same run.
    let arguments = ["run", "out/balls/scene.toml", "--out", "again", "--quiet"];
    let _ = ended(graintrain(folder.path(), &arguments), 0);
    assert_eq!(hash(&run), hash(&folder.path().join("again")));
    // There is nothing to resume, but the run can go further.
    let (out, _) = ended(graintrain(folder.path(), &["resume", "out/balls"]), 0);
    assert!(out.contains("nothing to do"), "{out}");
    let _ = ended(graintrain(folder.path(), &["resume", "out/balls", "--steps", "70", "--quiet"]), 0);
    assert_eq!(read(&run.join("steps.csv")).lines().count(), 71);
    let _ = ended(graintrain(folder.path(), &["resume", "out/balls", "--until", "0.375 s", "--quiet"]), 0);
    assert_eq!(read(&run.join("steps.csv")).lines().count(), 76);
    let (out, _) = ended(graintrain(folder.path(), &["render", "out/balls", "--size", "80x64"]), 0);
    assert!(out.contains("out/balls/picture.png") && run.join("picture.png").exists(), "{out}");
}

#[test]
fn options_override_the_scene() {
    let folder = folder();
    let arguments = [
        "run",
        "balls.toml",
        "--out",
        "a",
        "--until",
        "20 ms",
        "--solver",
        "pgs",
        "--friction",
        "coulomb",
        "--tolerance",
        "1e-3",
        "--dump-problem",
        "every=2",
        "--quiet",
    ];
    let _ = ended(graintrain(folder.path(), &arguments), 0);
    let summary: serde_json::Value =
        serde_json::from_str(&read(&folder.path().join("a/summary.json"))).unwrap();
    assert_eq!(summary["steps"], 4);
    assert_eq!(summary["solver"], "pgs");
    assert_eq!(summary["friction"], "coulomb");
    assert!(folder.path().join("a/problems/step_00000004.hdf5").exists());
    assert!(!folder.path().join("a/problems/step_00000003.hdf5").exists());
}

/// Whether this process, and so those that it starts, ignores SIGHUP (bit 0 of SigIgn), as under nohup.
fn hang_up_is_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask & 1 == 1)
}

#[test]
fn a_run_stopped_by_a_signal_resumes_to_the_same_bits() {
    for (name, code) in [("TERM", 143), ("INT", 130), ("HUP", 129)] {
        if name == "HUP" && hang_up_is_ignored() {
            eprintln!("skipped: under nohup a run goes on after SIGHUP");
            continue;
        }
        let folder = folder();
        let child = long_run(folder.path());
        signal(&child, name);
        let (out, _) = reported(child.wait_with_output().unwrap(), code);
        assert!(out.contains("graintrain resume cut"), "{out}");
        let steps = read(&folder.path().join("cut/steps.csv")).lines().count() - 1;
        let summary: serde_json::Value =
            serde_json::from_str(&read(&folder.path().join("cut/summary.json"))).unwrap();
        assert_eq!(
            (summary["status"].as_str(), summary["steps"].as_u64()),
            (Some("stopped"), Some(steps as u64))
        );
        let end = (steps + 100).to_string();
        let _ = ended(graintrain(folder.path(), &["resume", "cut", "--steps", &end, "--quiet"]), 0);
        let whole = ["run", "balls.toml", "--out", "whole", "--steps", &end, "--quiet"];
        let _ = ended(graintrain(folder.path(), &whole), 0);
        assert_eq!(hash(&folder.path().join("cut")), hash(&folder.path().join("whole")));
    }
}

/// While a run writes, its folder belongs to it; a checkpoint can be asked for; wall clock can be limited.
#[test]
fn a_folder_belongs_to_one_run_at_a_time() {
    let folder = folder();
    let mut child = long_run(folder.path());
    for arguments in
        [&["resume", "cut"][..], &["run", "balls.toml", "--out", "cut", "--force", "--steps", "3"][..]]
    {
        let output = graintrain(folder.path(), arguments).output().unwrap();
        let err = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && err.contains("another process"), "{arguments:?}: {err}");
    }
    let checkpoints = || {
        let names = std::fs::read_dir(folder.path().join("cut/checkpoints")).unwrap();
        let mut names: Vec<_> = names.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let before = checkpoints();
    signal(&child, "USR1");
    let start = Instant::now();
    while checkpoints() == before {
        assert!(start.elapsed() < Duration::from_secs(60), "no checkpoint is written");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(child.try_wait().unwrap().is_none(), "the run goes on");
    child.kill().unwrap();
    let _ = child.wait_with_output().unwrap();
    let limited = ["resume", "cut", "--steps", "100000000", "--max-seconds", "0.3"];
    let (out, _) = ended(graintrain(folder.path(), &limited), 3);
    assert!(out.contains("was stopped") && out.contains("graintrain resume cut"), "{out}");
}

/// `nohup` starts a program with SIGHUP ignored: it goes on when the terminal is gone.
#[test]
#[cfg(target_os = "linux")]
fn a_run_under_nohup_outlives_its_terminal() {
    let folder = folder();
    let program = env!("CARGO_BIN_EXE_graintrain");
    let script =
        format!("trap '' HUP; exec '{program}' run balls.toml --out cut --steps 1000000 --threads 1 --quiet");
    let mut child = Command::new("sh").args(["-c", &script]).current_dir(folder.path()).spawn().unwrap();
    let table = folder.path().join("cut/steps.csv");
    let steps = || std::fs::read_to_string(&table).map_or(0, |text| text.lines().count());
    let wait_for = |more: usize| {
        let start = Instant::now();
        while steps() < more {
            assert!(start.elapsed() < Duration::from_secs(60), "no steps are recorded");
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    wait_for(15);
    signal(&child, "HUP");
    wait_for(steps() + 20);
    assert!(child.try_wait().unwrap().is_none());
    child.kill().unwrap();
    child.wait().unwrap();
}

/// A folder of somebody else's is refused as it is.
#[test]
fn a_refused_folder_is_left_untouched() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("mine")).unwrap();
    std::fs::write(folder.path().join("mine/letter.txt"), "dear").unwrap();
    let (_, err) = ended(graintrain(folder.path(), &["run", "balls.toml", "--out", "mine"]), 2);
    assert!(err.contains("not empty"), "{err}");
    assert_eq!(std::fs::read_dir(folder.path().join("mine")).unwrap().count(), 1);
}

#[test]
fn a_killed_run_resumes_to_the_same_bits_even_past_a_damaged_checkpoint() {
    let folder = folder();
    let mut child = long_run(folder.path());
    signal(&child, "KILL");
    let _ = child.wait().unwrap();
    let checkpoints = folder.path().join("cut/checkpoints");
    let mut files: Vec<_> = std::fs::read_dir(&checkpoints)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "ckpt"))
        .collect();
    files.sort();
    let last = files.last().unwrap();
    let bytes = std::fs::read(last).unwrap();
    std::fs::write(last, &bytes[..bytes.len() / 2]).unwrap();
    let end = (read(&folder.path().join("cut/steps.csv")).lines().count() + 100).to_string();
    let (_, err) = ended(graintrain(folder.path(), &["resume", "cut", "--steps", &end, "--quiet"]), 0);
    assert!(err.contains("is cut short") && err.contains("an earlier checkpoint is used"), "{err}");
    let whole = ["run", "balls.toml", "--out", "whole", "--steps", &end, "--quiet"];
    let _ = ended(graintrain(folder.path(), &whole), 0);
    assert_eq!(hash(&folder.path().join("cut")), hash(&folder.path().join("whole")));
    let wrench = |run: &str| read(&folder.path().join(run).join("wrench.csv"));
    assert_eq!(wrench("cut"), wrench("whole"));
}

#[test]
fn bad_input_is_reported_in_one_message() {
    let folder = folder();
    std::fs::write(folder.path().join("file"), "").unwrap();
    std::fs::create_dir(folder.path().join("mine")).unwrap();
    std::fs::write(folder.path().join("mine/thesis.txt"), "").unwrap();
    let cases: &[(&[&str], &str)] = &[
        (&["run", "missing.toml"], "missing.toml"),
        (&["run", "sedimentatoin"], "sedimentation"),
        (&["run", "balls.toml", "--set", "time.stp=1"], "stp"),
        (&["run", "balls.toml", "--solver", "apdg"], "apdg"),
        (&["run", "balls.toml", "--tolerance=-1"], "tolerance"),
        (&["run", "balls.toml", "--out", "file/deeper"], "file/deeper"),
        (&["run", "balls.toml", "--out", "/proc/graintrain"], "/proc/graintrain"),
        (&["run", "balls.toml", "--out", "mine"], "is not empty"),
        (&["run", "balls.toml", "--dump-problem", "5"], "every=K"),
        (&["check", "mine"], "not of a folder"),
        (&["view", "none"], "no file or folder `none`"),
        (&["plot", "none"], "no file or folder `none`"),
        (&["plot", "mine"], "mine holds no tables"),
        (&["view", "mine", "--frames", "0"], "--frames"),
        (&["render", "mine", "--speed", "0", "--film", "a.gif"], "a positive number"),
        (&["resume", "mine"], "no checkpoint"),
        (&["resume", "mine", "--until", "2 kg"], "expected a time"),
        (&["run", "balls.toml", "--out", "b", "--threads", "100000"], "threads help nobody"),
    ];
    for (arguments, part) in cases {
        let (_, err) = ended(graintrain(folder.path(), arguments), 2);
        assert!(err.contains(part), "{arguments:?}: {err}");
    }
    assert!(folder.path().join("mine/thesis.txt").exists());
    assert!(!folder.path().join("b").exists(), "refused before anything was written");
}

#[test]
fn a_full_disk_is_reported_and_what_was_written_stays_readable() {
    let folder = folder();
    // The shell lets no file grow beyond 64 blocks of 512 bytes and turns the signal into an error of the
    // write.
    let line = format!(
        "trap '' XFSZ; ulimit -f 64; exec '{}' run balls.toml --out full --steps 2000 --quiet --threads 1",
        env!("CARGO_BIN_EXE_graintrain")
    );
    let mut command = Command::new("sh");
    command.current_dir(folder.path()).args(["-c", &line]);
    let (_, err) = ended(command, 1);
    assert!(err.contains("steps.csv") && err.contains("would exceed"), "{err}");
    let table = read(&folder.path().join("full/steps.csv"));
    let columns = table.lines().next().unwrap().split(',').count();
    assert!(table.ends_with('\n') && table.lines().all(|line| line.split(',').count() == columns));
    assert!(table.lines().count() > 50);
    let (_, err) = ended(graintrain(folder.path(), &["resume", "full", "--steps", "500", "--quiet"]), 0);
    assert_eq!(err, "");
}

#[test]
fn completions_and_manual_pages_name_every_command() {
    let folder = folder();
    let (help, _) = ended(graintrain(folder.path(), &["--help"]), 0);
    let commands: Vec<&str> = help
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    assert!(commands.contains(&"run") && commands.contains(&"resume"), "{help}");
    for shell in ["bash", "zsh", "fish"] {
        let (script, _) = ended(graintrain(folder.path(), &["completions", shell]), 0);
        assert!(commands.iter().all(|command| script.contains(command)), "{script}");
    }
    let (page, _) = ended(graintrain(folder.path(), &["man"]), 0);
    assert!(page.contains(".TH graintrain"), "{page}");
    let _ = ended(graintrain(folder.path(), &["man", "man1"]), 0);
    for command in commands.iter().filter(|command| **command != "help") {
        assert!(folder.path().join(format!("man1/graintrain-{command}.1")).exists(), "{command}");
    }
}

#[test]
fn strict_runs_fail_where_a_tolerance_is_not_reached() {
    let folder = folder();
    let hard = ["--set", "solver.max_iterations=2", "--tolerance", "1e-9", "--quiet"];
    let mut arguments = vec!["run", "balls.toml", "--out", "a"];
    arguments.extend(hard);
    let (_, err) = ended(graintrain(folder.path(), &arguments), 0);
    assert!(err.contains("did not reach the tolerance"), "{err}");
    arguments.extend(["--strict", "--force"]);
    let (_, err) = ended(graintrain(folder.path(), &arguments), 1);
    assert!(err.contains("above the tolerance") && err.contains("graintrain resume a"), "{err}");
}

/// Runs ask for the root mean square and bound the worst contact; `--strict-max` asks for the worst contact,
/// and so does a run that is resumed with it. What was asked for is in the resolved scene and the summary.
#[test]
fn the_tolerance_is_of_the_mean_or_of_the_worst_contact() {
    let folder = folder();
    let asked = |out: &str, is_strict: bool| {
        let path = folder.path().join(out);
        let summary: serde_json::Value = serde_json::from_str(&read(&path.join("summary.json"))).unwrap();
        assert_eq!(summary["strict_max"], is_strict);
        assert_eq!(summary["unconverged_steps"], 0);
        let number = |key: &str| summary[key].as_f64().unwrap();
        let (rms, max) = (number("residual_rms_max"), number("residual_max"));
        assert!(rms <= 1e-5 && max <= if is_strict { 1e-5 } else { 20e-5 }, "{summary}");
        max
    };
    ended(graintrain(folder.path(), &["run", "balls.toml", "--out", "mean", "--quiet"]), 0);
    assert!(asked("mean", false) > 1e-5, "the mean would not differ from the worst");
    assert!(read(&folder.path().join("mean/scene.toml")).contains("strict_max = false"));
    let strict = ["run", "balls.toml", "--out", "worst", "--quiet", "--strict-max"];
    ended(graintrain(folder.path(), &strict), 0);
    asked("worst", true);
    assert!(read(&folder.path().join("worst/scene.toml")).contains("strict_max = true"));
    ended(graintrain(folder.path(), &["run", "balls.toml", "--out", "later", "--steps", "1", "--quiet"]), 0);
    ended(graintrain(folder.path(), &["resume", "later", "--steps", "60", "--strict-max", "--quiet"]), 0);
    asked("later", true);
}

/// A run whose output nobody reads any more (`| head -1`, a closed terminal) goes on to its end, as does one
/// that warns; commands that only print stop without a word.
#[test]
fn a_closed_pipe_ends_no_run() {
    let folder = folder();
    let commands: &[(&[&str], i32)] = &[
        (&["run", "balls.toml", "--out", "a", "--steps", "20"], 0),
        (&["run", "balls.toml", "--out", "b", "--set", "solver.max_iterations=2", "--tolerance", "1e-9"], 0),
        (&["resume", "a", "--steps", "25"], 0),
        (&["resume", "a"], 0),
        (&["check", "balls.toml"], 0),
        (&["scenes"], 0),
        (&["schema"], 0),
        (&["solvers"], 0),
        (&["man"], 0),
        (&["completions", "bash"], 0),
        (&["view", "a"], 0),
        (&["render", "a", "--size", "80x64"], 0),
        (&["--help"], 0),
        (&["run", "missing.toml"], 2),
    ];
    for (arguments, code) in commands {
        let [out, err] = [(), ()].map(|()| {
            let (reader, writer) = std::io::pipe().unwrap();
            drop(reader);
            writer
        });
        let status = graintrain(folder.path(), arguments).stdout(out).stderr(err).status().unwrap();
        assert_eq!(status.code(), Some(*code), "{arguments:?}");
    }
    let finished = |run: &str, steps: usize| {
        assert_eq!(read(&folder.path().join(run).join("steps.csv")).lines().count(), 1 + steps);
        assert!(read(&folder.path().join(run).join("summary.json")).contains("\"finished\""));
    };
    finished("a", 25);
    finished("b", 60);
}

/// Where what a command was called for cannot be kept, it says so.
#[test]
#[cfg(target_os = "linux")]
fn an_answer_that_cannot_be_written_is_a_failure() {
    let folder = folder();
    let mut command = graintrain(folder.path(), &["check", "balls.toml"]);
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let child = command.stdout(full).stderr(Stdio::piped()).spawn().unwrap();
    let (_, err) = reported(child.wait_with_output().unwrap(), 1);
    assert!(err.contains("cannot write to stdout"), "{err}");
}

/// What is no mistake and yet seldom meant is reported before a run, and what did not come about after it.
#[test]
fn what_is_seldom_meant_is_reported() {
    let folder = folder();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write(
        "rough.toml",
        "[time]\nstep = 0.2\nend = 1\n[solver]\ntolerance = 1e-13\nfriction = \"relaxed\"\n[material.m]\nfriction = 1.5\n[body.b]\nshape = { sphere = { radius = 0.1 } }\n",
    );
    let (reported, _) = ended(graintrain(folder.path(), &["check", "rough.toml"]), 0);
    for doubt in ["friction 1.5 with the relaxed model", "a shorter time.step", "below what rounding allows"]
    {
        assert!(reported.contains(doubt), "{doubt}: {reported}");
    }
    // Steps are solved to 1e-2 whatever is asked, and the summary says to what.
    let loose = ["--set", "solver.tolerance=0.1", "--set", "n=1"];
    let (reported, _) =
        ended(graintrain(folder.path(), &[&["check", "sedimentation"], &loose[..]].concat()), 0);
    assert!(reported.contains("auto to 1e-2") && reported.contains("1e-1 saves nothing"), "{reported}");
    let run = ["run", "sedimentation", "--steps", "2", "--out", "loose", "--quiet"];
    ended(graintrain(folder.path(), &[&run, &loose[..]].concat()), 0);
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("loose/summary.json")).unwrap()).unwrap();
    assert_eq!(summary["tolerance"], 0.01);
    write(
        "full.toml",
        "[time]\nstep = 0.001\nend = 0.01\n[material.m]\n[body.block]\nshape = { box = { size = [1, 1, 1] } }\nmotion = \"fixed\"\n\
         [stream.rain]\nradius = 0.05\ncount = 5\nregion = { box = { min = [-0.2, -0.2, -0.2], max = [0.2, 0.2, 0.2] } }\n\
         [[stage]]\nname = \"fill\"\nfilled = true\n[[stage]]\nname = \"rest\"\n",
    );
    let (reported, warned) =
        ended(graintrain(folder.path(), &["run", "full.toml", "--out", "full", "--details"]), 0);
    assert!(
        warned.contains("stage `fill` had not ended") && warned.contains("`rest` never began"),
        "{warned}"
    );
    assert!(
        warned.contains("stream `rain` gave 0 bodies") && reported.contains("no free place"),
        "{warned}{reported}"
    );
}

/// Both treatments of overlap are reported before a run, remembered by it, and differ; what a run found is in
/// its summary.
#[test]
fn overlap_is_removed_as_the_scene_says() {
    let folder = folder();
    let (reported, _) = ended(graintrain(folder.path(), &["check", "balls.toml"]), 0);
    assert!(reported.contains("removed by positions"), "{reported}");
    let summary = |out: &str, settings: &[&str]| -> serde_json::Value {
        let mut arguments = vec!["run", "balls.toml", "--out", out, "--quiet"];
        arguments.extend(settings);
        ended(graintrain(folder.path(), &arguments), 0);
        serde_json::from_str(&read(&folder.path().join(out).join("summary.json"))).unwrap()
    };
    let position = summary("position", &[]);
    let velocity = summary("velocity", &["--set", "contact.overlap=velocity"]);
    assert_eq!((&position["overlap"], &velocity["overlap"]), (&"position".into(), &"velocity".into()));
    assert_eq!(velocity["correction_energy"], 0.0);
    assert!(read(&folder.path().join("velocity/scene.toml")).contains("overlap = \"velocity\""));
    for summary in [&position, &velocity] {
        let number = |key: &str| summary[key].as_f64().unwrap_or_else(|| panic!("{key}: {summary}"));
        // The tolerance of 1e-5 is relative to 0.05 m/s, and 20 times as much for the worst contact.
        assert!((0.0..1e-4).contains(&number("velocity_error_max")), "{summary}");
        assert!(number("overlap_per_step_max_over_radius") < 1e-5, "{summary}");
        assert!(number("parts_max") >= 1.0 && number("friction_error_max") >= 0.0, "{summary}");
        assert!(number("slip_angle_max") < 1.0, "{summary}");
        assert_eq!((number("impacts"), number("contacts_missed")), (0.0, 0.0), "{summary}");
        assert!(summary["contacts_missed_first_step"].is_null(), "{summary}");
    }
}

/// Bars that turn by several radians in a step do not get into each other; summary, table and warnings agree
/// on it. (The words for those that do are tested beside them, in `progress.rs`.)
#[test]
fn bars_that_turn_by_radians_in_a_step_do_not_pass_each_other() {
    let folder = folder();
    for seed in [3, 5, 7, 9, 11] {
        let mut scene = "[time]\nstep = \"50 ms\"\nsteps = 20\n".to_string();
        for k in 0..12_i32 {
            let turn = |factor: i32| (factor * (k + seed)) % 181 - 90;
            scene += &format!(
                "[body.b{k}]\nshape = {{ box = {{ size = [1, 0.02, 0.02] }} }}\nposition = [{}, {}, {}]\n\
                 angular_velocity = [{}, {}, {}]\n",
                f64::from((7 * k) % 11) * 0.1 - 0.5,
                f64::from((5 * k) % 11) * 0.1 - 0.5,
                f64::from(k) * 0.06,
                turn(37),
                turn(59),
                turn(83)
            );
        }
        std::fs::write(folder.path().join("bars.toml"), scene).unwrap();
        let arguments = ["run", "bars.toml", "--out", "bars", "--quiet", "--force"];
        let (_, err) = ended(graintrain(folder.path(), &arguments), 0);
        let summary: serde_json::Value =
            serde_json::from_str(&read(&folder.path().join("bars/summary.json"))).unwrap();
        let missed = summary["contacts_missed"].as_u64().unwrap();
        let table = read(&folder.path().join("bars/steps.csv"));
        let column =
            table.lines().next().unwrap().split(',').position(|name| name == "contacts_missed").unwrap();
        let counts: Vec<u64> =
            table.lines().skip(1).map(|line| line.split(',').nth(column).unwrap().parse().unwrap()).collect();
        assert_eq!(counts.iter().sum::<u64>(), missed);
        let first = counts.iter().position(|count| *count > 0).map(|row| row as u64 + 1);
        assert_eq!(summary["contacts_missed_first_step"].as_u64(), first);
        assert_eq!(err.contains("passed into or through each other"), missed > 0, "{err}");
        assert!(
            summary["contacts_added_after_solve"].as_u64().unwrap() > 0,
            "no bar was in the way of another: {summary}"
        );
        assert_eq!(missed, 0, "{summary}");
        assert!(summary["penetration_max_over_radius"].as_f64().unwrap() < 0.05, "{summary}");
    }
}

/// A grain that falls past the edge of one blade onto the turning face of another: the contact found on its
/// way has the normal of an earlier moment than the one at which the grain, deflected by the edge, arrives.
/// Within 2 % of a grain's radius otherwise.
#[test]
fn a_deflected_grain_does_not_enter_the_face_that_turns_towards_it() {
    let folder = folder();
    let arguments = ["run", "sedimentation", "--set", "n=6", "--steps", "12", "--out", "mixer", "--quiet"];
    ended(graintrain(folder.path(), &arguments), 0);
    let summary: serde_json::Value =
        serde_json::from_str(&read(&folder.path().join("mixer/summary.json"))).unwrap();
    assert!(summary["penetration_max_over_radius"].as_f64().unwrap() < 6e-3, "{summary}");
}
