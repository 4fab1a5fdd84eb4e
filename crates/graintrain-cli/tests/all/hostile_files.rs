//! Files that somebody else made, as commands meet them: nothing outside of the folder is read or written,
//! and whatever is in them, there is an answer soon and in little memory.
#![cfg(unix)]

use crate::runs::{folder, graintrain, read};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// As [`crate::runs::ended`], with messages as they are before they are broken into lines.
fn ended(command: Command, code: i32) -> (String, String) {
    let (out, err) = crate::runs::ended(command, code);
    (out, err.split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" "))
}

/// A short run of a scene that has a measurement.
fn made(folder: &Path) {
    let arguments = ["run", "balls.toml", "--out", "made", "--steps", "20", "--quiet"];
    ended(graintrain(folder, &arguments), 0);
}

#[test]
fn lists_of_frames_lead_nowhere_else() {
    let folder = folder();
    made(folder.path());
    let list = folder.path().join("made/bodies.pvd");
    let whole = read(&list);
    std::fs::copy(folder.path().join("made/frames/bodies_00000010.vtp"), folder.path().join("other.vtp"))
        .unwrap();
    let absolute = folder.path().join("other.vtp").display().to_string();
    for elsewhere in ["../other.vtp", "frames/../../other.vtp", &absolute] {
        std::fs::write(&list, whole.replace("frames/bodies_00000010.vtp", elsewhere)).unwrap();
        for arguments in [&["export", "made", "--to", "xyz"][..], &["view", "made"], &["render", "made"]] {
            let (_, err) = ended(graintrain(folder.path(), arguments), 2);
            assert!(err.contains("no file of the run"), "{arguments:?}: {err}");
        }
    }
    for left in ["frames.xyz", "replay.html", "picture.png"] {
        assert!(!folder.path().join("made").join(left).exists(), "{left}");
    }
    let columns = r#"{"measures/../../evil.csv": [{"name": "step"}, {"name": "time"}, {"name": "x"}]}"#;
    std::fs::write(folder.path().join("made/columns.json"), columns).unwrap();
    std::fs::write(folder.path().join("evil.csv"), "step,time,x\n1,1,1\n").unwrap();
    let (_, err) = ended(graintrain(folder.path(), &["plot", "made"]), 2);
    assert!(err.contains("no file of the run"), "{err}");
}

/// A folder of somebody else's may hold links: what a command writes stays in it.
#[test]
fn links_in_a_folder_are_not_written_through() {
    let folder = folder();
    made(folder.path());
    let (run, mine) = (folder.path().join("made"), folder.path().join("mine"));
    std::fs::create_dir(&mine).unwrap();
    std::fs::write(mine.join("letter.vtp"), "dear").unwrap();
    let swap = |name: &str| {
        std::fs::rename(run.join(name), folder.path().join(name)).unwrap();
        symlink(&mine, run.join(name)).unwrap();
    };
    let restore = |name: &str| {
        std::fs::remove_file(run.join(name)).unwrap();
        std::fs::rename(folder.path().join(name), run.join(name)).unwrap();
    };
    swap("frames");
    let commands: [(&[&str], i32); 2] = [
        (&["resume", "made", "--steps", "40"], 1),
        (&["run", "balls.toml", "--out", "made", "--force", "--steps", "3"], 2),
    ];
    for (arguments, code) in commands {
        let (_, err) = ended(graintrain(folder.path(), arguments), code);
        assert!(err.contains("it is a link"), "{err}");
    }
    restore("frames");
    symlink(&mine, run.join("plots")).unwrap();
    let (_, err) = ended(graintrain(folder.path(), &["plot", "made"]), 1);
    assert!(err.contains("it is a link"), "{err}");
    for (name, arguments) in [
        ("replay.html", &["view", "made"][..]),
        ("frames.xyz", &["export", "made", "--to", "xyz"]),
        ("picture.png", &["render", "made", "--size", "80x64"]),
    ] {
        for ending in ["", ".part"] {
            symlink(mine.join("letter.vtp"), run.join(format!("{name}{ending}"))).unwrap();
        }
        ended(graintrain(folder.path(), arguments), 0);
    }
    assert_eq!(read(&mine.join("letter.vtp")), "dear");
    assert_eq!(std::fs::read_dir(&mine).unwrap().count(), 1);
}

/// A command that may take 200 MB of memory, and ten times the second that the released program takes.
fn in_little_memory(folder: &Path, arguments: &str, code: i32) -> (String, String) {
    let line = format!("ulimit -d 200000; exec '{}' {arguments}", env!("CARGO_BIN_EXE_graintrain"));
    let mut command = Command::new("sh");
    command.current_dir(folder).args(["-c", &line]);
    let start = Instant::now();
    let answer = ended(command, code);
    assert!(start.elapsed() < Duration::from_secs(10), "{arguments}: {:?}", start.elapsed());
    answer
}

#[test]
fn scenes_of_bodies_in_one_place_are_refused_at_once() {
    let folder = folder();
    for name in ["memory_hang_periodic", "memory_passive_wall", "memory_shear_box"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/failing/{name}.toml"));
        let (_, err) = in_little_memory(folder.path(), &format!("check '{}'", path.display()), 2);
        assert!(err.contains("so that they overlap"), "{name}: {err}");
    }
    // Which bodies overlap, and how deep, needs no list of all that do.
    let places = "1 2 3 0.1\n".repeat(5_000);
    std::fs::write(folder.path().join("points.dat"), format!("x y z r\n{places}")).unwrap();
    let scene =
        "[time]\nstep = 1e-3\nend = 1\n[packing.a]\nfile = { path = \"points.dat\", format = \"table\" }\n";
    std::fs::write(folder.path().join("points.toml"), scene).unwrap();
    let (_, err) = in_little_memory(folder.path(), "check points.toml", 2);
    assert!(err.contains("overlap"), "{err}");
}

#[test]
fn tables_with_extreme_numbers_are_drawn() {
    let folder = folder();
    made(folder.path());
    let path = folder.path().join("made/steps.csv");
    let table = read(&path);
    let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let extreme = ["1e-320", "0.0", "1.7e308", "-1.7e308", "5e-324", "1e-12", "inf", "NaN", "1"];
    let rows = (0..40).map(|row| {
        let cell = |(k, name): (usize, &&str)| match *name {
            "step" | "time" => row.to_string(),
            "solver" => "auto".to_string(),
            _ => extreme[(row * 7 + k) % extreme.len()].to_string(),
        };
        header.iter().enumerate().map(cell).collect::<Vec<_>>().join(",")
    });
    let rows: Vec<String> = rows.collect();
    std::fs::write(&path, format!("{}\n{}\n", header.join(","), rows.join("\n"))).unwrap();
    in_little_memory(folder.path(), "plot made", 0);
    let residual = read(&folder.path().join("made/plots/residual.svg"));
    assert!(residual.len() < 200_000 && !residual.contains("NaN") && !residual.contains("inf"));
}
