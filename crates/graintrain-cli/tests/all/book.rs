//! The book in `docs/book`: its commands run, its links lead somewhere, its programs are built by cargo.
//!
//! Code blocks, by what follows the three backticks:
//!
//! | block | here |
//! |---|---|
//! | `sh` | runs in the chapter's folder, after the blocks before it; has to end with exit code 0 |
//! | `sh,exit=2` | the same with another exit code |
//! | `sh,ignore` | needs cargo, data from elsewhere or a long time: counted, not run |
//! | `toml,file=NAME` | becomes the file NAME in the chapter's folder |
//! | `rust` | one `{{#include}}` of an example that cargo builds |
#![cfg(unix)]

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Most words before the appendix.
const WORDS: usize = 15_000;

/// Folder of the book's sources; the packed crate comes without it.
fn sources() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/book/src");
    if !folder.exists() {
        eprintln!("skipped: no {}", folder.display());
        return None;
    }
    Some(folder)
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Targets of the links and pictures of a page outside of its code blocks.
fn links(page: &str) -> Vec<String> {
    let prose = blocks(page).into_iter().fold(page.to_string(), |text, block| text.replace(&block.body, ""));
    let mut targets = Vec::new();
    let mut rest = prose.as_str();
    while let Some(start) = rest.find("](") {
        rest = &rest[start + 2..];
        if let Some(end) = rest.find(')') {
            targets.push(rest[..end].to_string());
        }
    }
    targets
}

struct Block {
    kind: String,
    body: String,
}

impl Block {
    fn language(&self) -> &str {
        self.kind.split(',').next().unwrap_or("")
    }

    fn option(&self, name: &str) -> Option<&str> {
        self.kind.split(',').find_map(|part| part.strip_prefix(name)?.strip_prefix('='))
    }

    fn is(&self, word: &str) -> bool {
        self.kind.split(',').any(|part| part == word)
    }
}

fn blocks(page: &str) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut open: Option<Block> = None;
    for line in page.lines() {
        match (&mut open, line.strip_prefix("```")) {
            (Some(_), Some(_)) => blocks.extend(open.take()),
            (Some(block), None) => writeln!(block.body, "{line}").unwrap(),
            (None, Some(kind)) => open = Some(Block { kind: kind.to_string(), body: String::new() }),
            (None, None) => {}
        }
    }
    assert!(open.is_none(), "a code block that does not end");
    blocks
}

/// Chapters in the order of the summary, relative to the sources.
fn chapters(sources: &Path) -> Vec<String> {
    links(&read(&sources.join("SUMMARY.md")))
}

fn is_appendix(chapter: &str) -> bool {
    chapter.starts_with("notebook/")
}

#[test]
fn the_book_is_whole() {
    let Some(sources) = sources() else { return };
    let chapters = chapters(&sources);
    let mut files: Vec<String> = Vec::new();
    for folder in ["", "notebook/"] {
        for entry in std::fs::read_dir(sources.join(folder)).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            if name.ends_with(".md") && name != "SUMMARY.md" {
                files.push(format!("{folder}{name}"));
            }
        }
    }
    files.sort();
    let mut listed = chapters.clone();
    listed.sort();
    assert_eq!(listed, files, "SUMMARY.md names every page once");

    let mut words = 0;
    for chapter in &chapters {
        let path = sources.join(chapter);
        let page = read(&path);
        for line in page.lines() {
            let Some(include) = line.trim().strip_prefix("{{#include ") else { continue };
            let included = path.with_file_name(include.trim_end_matches("}}"));
            assert!(included.exists(), "{chapter}: no {}", included.display());
        }
        if is_appendix(chapter) {
            continue;
        }
        // The bars of tables and the signs of formulas are no words.
        let is_word = |text: &&str| text.chars().any(char::is_alphanumeric);
        let own = page.split_whitespace().filter(is_word).count();
        println!("{chapter}: {own} words");
        words += own;
        for target in links(&page) {
            let file = target.split('#').next().unwrap_or("");
            if target.starts_with("http") || file.is_empty() {
                continue;
            }
            let linked = path.with_file_name(file);
            let size = std::fs::metadata(&linked).map(|file| file.len());
            assert!(size.is_ok(), "{chapter}: a link to {target}");
            assert!(
                !file.ends_with(".png") || size.is_ok_and(|size| size < 100_000),
                "{chapter}: {target} is large"
            );
        }
        for block in blocks(&page).iter().filter(|block| block.language() == "rust") {
            let example = block.body.contains("{{#include ") && block.body.contains("/examples/");
            assert!(
                example && block.body.lines().count() == 1,
                "{chapter}: a program that cargo does not build"
            );
        }
    }
    println!("{words} words");
    assert!(words <= WORDS, "{words} words");
}

/// The program is called as a reader calls it: by name.
fn shell(folder: &Path, script: &str) -> std::process::Output {
    let program = Path::new(env!("CARGO_BIN_EXE_graintrain")).parent().unwrap();
    let mut path = vec![program.to_path_buf()];
    path.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()));
    Command::new("sh")
        .args(["-e", "-c", script])
        .current_dir(folder)
        .env("PATH", std::env::join_paths(path).unwrap())
        .output()
        .unwrap()
}

/// Runs the commands of a chapter in a folder of its own; returns how many blocks ran and how many did not.
fn run_chapter(sources: &Path, chapter: &str) -> (usize, usize) {
    let (mut run, mut ignored) = (0, 0);
    let folder = tempfile::tempdir().unwrap();
    for block in blocks(&read(&sources.join(chapter))) {
        if let Some(name) = block.option("file") {
            std::fs::write(folder.path().join(name), &block.body).unwrap();
        }
        match block.language() {
            "sh" if block.is("ignore") => ignored += 1,
            "sh" => {
                let code: i32 = block.option("exit").map_or(0, |code| code.parse().unwrap());
                let output = shell(folder.path(), &block.body);
                let reported = String::from_utf8_lossy(&output.stderr);
                assert_eq!(output.status.code(), Some(code), "{chapter}: {}\n{reported}", block.body);
                run += 1;
            }
            "console" | "bash" => panic!("{chapter}: commands stand in blocks marked sh"),
            _ => {}
        }
    }
    (run, ignored)
}

#[test]
fn the_commands_of_the_book_run() {
    let Some(sources) = sources() else { return };
    let chapters = chapters(&sources);
    let counts: Vec<(usize, usize)> = std::thread::scope(|scope| {
        let own = chapters.iter().filter(|chapter| !is_appendix(chapter));
        let running: Vec<_> = own.map(|chapter| scope.spawn(|| run_chapter(&sources, chapter))).collect();
        running.into_iter().map(|chapter| chapter.join().expect("a chapter whose commands run")).collect()
    });
    let run: usize = counts.iter().map(|count| count.0).sum();
    let ignored: usize = counts.iter().map(|count| count.1).sum();
    println!("{run} blocks of commands run, {ignored} not: they need cargo, data or a long time");
    assert!(run >= 20, "{run} blocks");
}

#[test]
fn the_page_on_outputs_names_every_table_and_key_of_the_summary() {
    let Some(sources) = sources() else { return };
    let page = read(&sources.join("../../output.md"));
    let folder = tempfile::tempdir().unwrap();
    let output = shell(folder.path(), "graintrain run stack --steps 2 --out run --quiet");
    assert!(output.status.success());
    let json = |name: &str| -> serde_json::Value {
        serde_json::from_str(&read(&folder.path().join("run").join(name))).unwrap()
    };
    let summary = json("summary.json");
    let names = summary.as_object().unwrap().keys();
    for file in json("columns.json").as_object().unwrap().keys() {
        assert!(page.contains(file.as_str()), "{file}");
    }
    let missing: Vec<&String> = names.filter(|name| !page.contains(&format!("`{name}`"))).collect();
    assert!(missing.is_empty(), "{missing:?}");
}
