//! `docs/scenes.md` documents every key of the schema and no other, and its examples are accepted.

use graintrain_io::scene::schema::{Key, Kind, Range, SCENE, Table};
use std::fmt::Write;

const BEGIN: &str = "<!-- reference: written by the test scene_docs with GRAINTRAIN_WRITE_DOCS=1 -->\n";

fn kind(kind: Kind) -> String {
    let unit = |unit: String| if unit.is_empty() { "number".to_string() } else { unit };
    match kind {
        Kind::Quantity(dimension) => unit(dimension.unit()),
        Kind::Vector(dimension) => format!("3 x {}", unit(dimension.unit())),
        Kind::Direction => "3 x number".into(),
        Kind::VectorOrQuantity(dimension) => {
            let unit = unit(dimension.unit());
            format!("{unit}, or 3 x {unit}")
        }
        Kind::List(dimension) => format!("list of {}", unit(dimension.unit())),
        Kind::RatioOrLength => "number or m".into(),
        Kind::Count => "whole number".into(),
        Kind::Counts => "3 x whole number".into(),
        Kind::Text => "text".into(),
        Kind::Texts => "list of texts".into(),
        Kind::Flag => "flag".into(),
        Kind::Table(_) => "table".into(),
        Kind::Named(_) => "named tables".into(),
        Kind::Tables(_) => "list of tables".into(),
        Kind::QuantityOr(dimension, _) => format!("{} or table", unit(dimension.unit())),
        Kind::Function(dimension, _) => format!("{}, text with t, or table", unit(dimension.unit())),
        Kind::Functions(dimension, _) => format!("3 x ({}, text with t, or table)", unit(dimension.unit())),
        Kind::TextOr(_) => "text or table".into(),
        Kind::Free => "names and values".into(),
        Kind::Rows => "rows of 3 numbers".into(),
    }
}

/// What the key holds, with the range of its numbers.
fn holds(key: &Key) -> String {
    let range = match (key.range, key.kind) {
        (Range::Any, _) => "",
        (Range::Positive, Kind::Count | Kind::Counts) => ", >= 1",
        (Range::Positive, _) => ", > 0",
        (Range::NotNegative, _) => ", >= 0",
        (Range::ZeroToOne, _) => ", 0 to 1",
    };
    kind(key.kind) + range
}

/// Whether both tables have the same keys with the same meanings, for other units.
fn are_alike(first: &Table, second: &Table) -> bool {
    let said = |table: &Table| table.keys.iter().map(|key| (key.name, key.about)).collect::<Vec<_>>();
    said(first) == said(second)
}

fn reference() -> String {
    let mut text = String::from(BEGIN);
    let tables = SCENE.all();
    for (k, table) in tables.iter().enumerate() {
        if tables[..k].iter().any(|other| are_alike(other, table)) {
            continue;
        }
        let Table { heading, keys, alternatives } = table;
        write!(text, "\n### {heading}\n\n").unwrap();
        let alike: Vec<&str> = tables[k + 1..]
            .iter()
            .filter(|other| are_alike(other, table))
            .map(|other| other.heading)
            .collect();
        if !alike.is_empty() {
            write!(text, "The same keys, with other units: {}.\n\n", alike.join(", ")).unwrap();
        }
        text.push_str("| key | holds | default | example | meaning |\n|---|---|---|---|---|\n");
        for key in *keys {
            let (name, default, example, about) = (key.name, key.default, key.example, key.meaning());
            writeln!(text, "| `{name}` | {} | {default} | `{example}` | {about} |", holds(key)).unwrap();
        }
        for group in *alternatives {
            writeln!(text, "\nAt most one of: {}.", group.join(", ")).unwrap();
        }
    }
    text
}

#[test]
fn the_page_documents_exactly_the_keys_of_the_schema() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/scenes.md");
    // The packed crate comes without the pages of the repository.
    if !std::path::Path::new(path).exists() {
        eprintln!("skipped: no {path}");
        return;
    }
    let page = std::fs::read_to_string(path).unwrap();
    let start = page.find(BEGIN).expect("the page has the line that begins the reference");
    if std::env::var_os("GRAINTRAIN_WRITE_DOCS").is_some() {
        std::fs::write(path, page[..start].to_string() + &reference()).unwrap();
        return;
    }
    assert!(page[start..] == reference(), "docs/scenes.md is out of date: run with GRAINTRAIN_WRITE_DOCS=1");
}

#[test]
fn every_example_is_toml() {
    for table in SCENE.all() {
        for key in table.keys {
            let line = format!("{} = {}", key.name, key.example);
            assert!(toml::from_str::<toml::Table>(&line).is_ok(), "{}: {line}", table.heading);
        }
    }
}
