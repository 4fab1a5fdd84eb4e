//! Films of runs, and runs that are looked at while they compute.
#![cfg(unix)]

use crate::runs::{ended, folder, graintrain};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::Stdio;

/// Number of pictures of an animated PNG: the first number of its chunk `acTL` (W3C, "Portable Network
/// Graphics", third edition, 11.3.6).
fn pictures(path: &Path) -> u32 {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n");
    let at = bytes.windows(4).position(|chunk| chunk == b"acTL").expect("it is animated");
    u32::from_be_bytes(bytes[at + 4..at + 8].try_into().unwrap())
}

#[test]
fn a_film_needs_no_ffmpeg() {
    let folder = folder();
    let run = ["run", "balls.toml", "--out", "made", "--steps", "20", "--quiet"];
    ended(graintrain(folder.path(), &run), 0);
    let small = ["render", "made", "--size", "128x96", "--film"];
    let film = |name: &'static str| {
        let mut command = graintrain(folder.path(), &[&small[..], &[name]].concat());
        command.env("FFMPEG", "/nonexistent/ffmpeg");
        command
    };
    let (out, _) = ended(film("film.png"), 0);
    let made = pictures(&folder.path().join("film.png"));
    assert!(made >= 2 && out.contains(&format!("{made} pictures")), "{made} {out}");
    let (_, err) = ended(film("film.mp4"), 0);
    assert!(err.contains("ffmpeg -framerate"), "{err}");
    let single = std::fs::read_dir(folder.path().join("film.pictures")).unwrap().count();
    assert_eq!(single as u32, made);
    let (_, err) = ended(film("film.doc"), 2);
    assert!(err.contains(".mp4"), "{err}");
    // No picture is shown for longer than a second: the film says that it is faster than asked.
    let mut slow = film("film.png");
    slow.args(["--speed", "1e-9"]);
    let (_, err) = ended(slow, 0);
    assert!(err.contains("not 0.000000001 times") && err.contains("output.every"), "{err}");
    for (range, expected) in [("nan,1", "range NaN"), ("0,inf", "range inf"), ("2,1", "range 1")] {
        let mut wrong = film("film.png");
        wrong.args(["--range", range]);
        let still = ["render", "made", "--range", range];
        for command in [wrong, graintrain(folder.path(), &still)] {
            let (_, err) = ended(command, 2);
            assert!(err.contains(expected), "{range}: {err}");
        }
    }
}

/// What a run under way answers to a request for this path.
fn answer(address: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "POST {path} HTTP/1.1\r\nHost: {address}\r\nContent-Length: 0\r\n\r\n").unwrap();
    let mut text = String::new();
    // The run may end, and its server with it, before the answer is whole.
    let _ = stream.read_to_string(&mut text);
    text
}

#[test]
fn a_run_under_way_stops_from_its_page() {
    let folder = folder();
    let run = ["run", "balls.toml", "--out", "live", "--steps", "100000000", "--live"];
    let mut child =
        graintrain(folder.path(), &run).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let line = lines.by_ref().map(Result::unwrap).find(|line| line.contains("http://")).unwrap();
    let url = line.split_whitespace().next().unwrap().to_string();
    let address = url.trim_start_matches("http://").trim_end_matches('/');
    assert!(address.starts_with("127.0.0.1:"), "{address}");
    let refused = {
        let mut stream = TcpStream::connect(address).unwrap();
        write!(stream, "POST /stop HTTP/1.1\r\nHost: elsewhere.example\r\nContent-Length: 0\r\n\r\n")
            .unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    };
    assert!(refused.starts_with("HTTP/1.1 403"), "{refused}");
    assert!(child.try_wait().unwrap().is_none(), "another site stops nothing");
    answer(address, "/stop");
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{rest:?}");
    assert!(folder.path().join("live/summary.json").exists());
}
