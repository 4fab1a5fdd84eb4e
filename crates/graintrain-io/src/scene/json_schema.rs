//! The keys of scenes as a JSON Schema (draft 7), for editors that complete and check TOML. Made from
//! [`schema`](super::schema) alone.
//!
//! Every table is a definition. A number may be a text, since scenes calculate: its unit and dimension are
//! checked when the scene is read, as is everything that concerns several tables.

use super::schema::{Key, Kind, REQUIRED, Range, SCENE, Table};
use serde_json::{Map, Value, json};

/// A default that says that one of several keys has to be given: those after it, or where it stands alone all
/// that have it.
const ONE_OF: &str = "one of";
/// What stands in texts for the value of a parameter.
const PARAMETER: &str = r"\$\{";

/// The JSON Schema of scene files.
pub fn json_schema() -> Value {
    let definitions: Map<String, Value> =
        SCENE.all().into_iter().skip(1).map(|table| (definition(table), of_table(table))).collect();
    let mut schema = of_table(&SCENE);
    schema["$schema"] = json!("http://json-schema.org/draft-07/schema#");
    schema["title"] = json!("graintrain scene");
    schema["definitions"] = Value::Object(definitions);
    schema
}

/// Name of a table's definition: its heading in plain characters.
fn definition(table: &Table) -> String {
    let plain: String = table
        .heading
        .chars()
        .map(|c| if c.is_alphanumeric() || "._".contains(c) { c } else { ' ' })
        .collect();
    plain.split_whitespace().collect::<Vec<_>>().join("-")
}

fn reference(table: &Table) -> Value {
    json!({ "$ref": format!("#/definitions/{}", definition(table)) })
}

fn of_table(table: &Table) -> Value {
    let properties: Map<String, Value> =
        table.keys.iter().map(|key| (key.name.to_string(), of_key(key))).collect();
    let mut schema = json!({ "type": "object", "additionalProperties": false, "properties": properties });
    let required: Vec<&str> =
        table.keys.iter().filter(|key| key.default == REQUIRED).map(|key| key.name).collect();
    if !required.is_empty() {
        schema["required"] = json!(required);
    }
    let mut rules: Vec<Value> = needed(table)
        .into_iter()
        .map(|group| {
            let any: Vec<Value> = group.into_iter().map(|name| json!({ "required": [name] })).collect();
            json!({ "anyOf": any })
        })
        .collect();
    for group in table.alternatives {
        for (k, first) in group.iter().enumerate() {
            rules.extend(
                group[k + 1..].iter().map(|second| json!({ "not": { "required": [first, second] } })),
            );
        }
    }
    if !rules.is_empty() {
        schema["allOf"] = json!(rules);
    }
    schema
}

/// Groups of keys of which at least one has to be given, each group once.
fn needed(table: &Table) -> Vec<Vec<&'static str>> {
    let mut groups: Vec<Vec<&'static str>> = Vec::new();
    for key in table.keys {
        let Some(rest) = key.default.strip_prefix(ONE_OF) else { continue };
        let group: Vec<&'static str> = match rest.trim() {
            "" => table.keys.iter().filter(|other| other.default == ONE_OF).map(|other| other.name).collect(),
            names => names.split(", ").collect(),
        };
        // A default with more to say, such as that of a file, leaves the key out at times.
        let holds = |name: &&str| table.key(name).is_some_and(|other| other.default == key.default);
        if group.iter().all(holds) && !groups.contains(&group) {
            groups.push(group);
        }
    }
    groups
}

fn of_key(key: &Key) -> Value {
    let mut schema = of_kind(key);
    let mut about = key.meaning();
    let unit = key.kind.unit();
    if !unit.is_empty() {
        about += &format!(". In {unit}, or a text with a unit");
    }
    let default = toml_value(key.default);
    // Rules say which keys exclude each other.
    if default.is_none() && ![REQUIRED, ONE_OF].contains(&key.default) {
        about += &format!(". Default: {}", key.default);
    }
    schema["description"] = json!(about);
    if let Some(default) = default {
        schema["default"] = default;
    }
    if let Some(example) = toml_value(key.example) {
        schema["examples"] = json!([example]);
    }
    schema
}

/// What a text in TOML stands for; `None` for a sentence.
fn toml_value(text: &str) -> Option<Value> {
    let table: toml::Table = toml::from_str(&format!("value = {text}")).ok()?;
    serde_json::to_value(table.get("value")?).ok()
}

fn of_kind(key: &Key) -> Value {
    let number = || number("number", key.range);
    let three = |item: Value| json!({ "type": "array", "items": item, "minItems": 3, "maxItems": 3 });
    let list = |item: Value| json!({ "type": "array", "items": item });
    let or = |first: Value, second: Value| json!({ "anyOf": [first, second] });
    match key.kind {
        Kind::Quantity(_) | Kind::RatioOrLength => number(),
        Kind::Vector(_) | Kind::Direction => three(number()),
        Kind::VectorOrQuantity(_) => or(number(), three(number())),
        Kind::List(_) => list(number()),
        Kind::Count => self::number("integer", count_range(key)),
        Kind::Counts => three(self::number("integer", count_range(key))),
        Kind::Text => text(key),
        Kind::Texts => list(text(key)),
        Kind::Flag => json!({ "type": "boolean" }),
        Kind::Table(table) => json!({ "allOf": [reference(table)] }),
        Kind::Named(table) => json!({ "type": "object", "additionalProperties": reference(table) }),
        Kind::Tables(table) => list(reference(table)),
        Kind::QuantityOr(_, table) | Kind::Function(_, table) => or(number(), reference(table)),
        Kind::Functions(_, table) => three(or(number(), reference(table))),
        Kind::TextOr(table) => or(text(key), reference(table)),
        Kind::Free => json!({ "type": "object" }),
        Kind::Rows => list(three(self::number("number", Range::Any))),
    }
}

/// Whole numbers are never negative.
fn count_range(key: &Key) -> Range {
    if key.range == Range::Any { Range::NotNegative } else { key.range }
}

/// A number in SI units, or a text that evaluates to one.
fn number(kind: &str, range: Range) -> Value {
    let mut number = json!({ "type": kind });
    match range {
        Range::Any => {}
        Range::Positive => number["exclusiveMinimum"] = json!(0),
        Range::NotNegative => number["minimum"] = json!(0),
        Range::ZeroToOne => {
            number["minimum"] = json!(0);
            number["maximum"] = json!(1);
        }
    }
    json!({ "anyOf": [number, { "type": "string", "minLength": 1 }] })
}

/// A text: one of the choices, where there are any, or one that a parameter completes.
fn text(key: &Key) -> Value {
    let choices = (key.choices)();
    if choices.is_empty() {
        return json!({ "type": "string" });
    }
    json!({ "anyOf": [{ "type": "string", "enum": choices }, { "type": "string", "pattern": PARAMETER }] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_table_has_a_definition_of_its_own() {
        let tables = SCENE.all();
        let names: BTreeSet<String> = tables.iter().map(|table| definition(table)).collect();
        assert_eq!(names.len(), tables.len());
        let schema = json_schema();
        assert_eq!(schema["definitions"].as_object().unwrap().len(), tables.len() - 1);
    }

    #[test]
    fn keys_carry_what_the_tables_say() {
        let schema = json_schema();
        let time = &schema["definitions"]["time"];
        assert_eq!(time["required"], json!(["step"]));
        assert_eq!(
            time["properties"]["step"]["anyOf"][0],
            json!({ "type": "number", "exclusiveMinimum": 0 })
        );
        assert_eq!(time["properties"]["step"]["examples"], json!(["25 ms"]));
        assert_eq!(time["properties"]["step"]["description"], "Time step. In s, or a text with a unit");
        let one = json!({ "anyOf": [{ "required": ["end"] }, { "required": ["steps"] }] });
        assert_eq!(time["allOf"], json!([one, { "not": { "required": ["end", "steps"] } }]));
        let contact = &schema["definitions"]["contact"]["properties"];
        assert_eq!(contact["overlap"]["default"], "position");
        assert_eq!(contact["overlap"]["anyOf"][0]["enum"], json!(["position", "velocity"]));
        assert_eq!(
            schema["definitions"]["material.NAME"]["properties"]["restitution"]["anyOf"][0]["maximum"],
            1
        );
    }
}
