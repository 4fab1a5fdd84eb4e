//! `docs/scenes.md` documents every key of the schema and no other, and its examples are accepted.

use graintrain_io::scene::schema::{Kind, SCENE, Table};
use std::fmt::Write;

const BEGIN: &str = "<!-- reference: written by the test scene_docs with GRAINTRAIN_WRITE_DOCS=1 -->\n";

fn kind(kind: Kind) -> String {
    let unit = |unit: String| if unit.is_empty() { "number".to_string() } else { unit };
    match kind {
        Kind::Quantity(dimension) => unit(dimension.unit()),
        Kind::Vector(dimension) => format!("3 x {}", unit(dimension.unit())),
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

fn reference() -> String {
    let mut text = String::from(BEGIN);
    for table in SCENE.all() {
        let Table { heading, keys, alternatives } = table;
        write!(
            text,
            "\n### {heading}\n\n| key | holds | default | example | meaning |\n|---|---|---|---|---|\n"
        )
        .unwrap();
        for key in *keys {
            let (name, default, example, about) = (key.name, key.default, key.example, key.about);
            writeln!(text, "| `{name}` | {} | {default} | `{example}` | {about} |", kind(key.kind)).unwrap();
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
