//! The JSON Schema of a study, including the parameters of all registered plugins. Editors use it for completion and
//! `check` validates studies by it, so the two cannot differ.

use super::sections::StudyText;
use contract::{Registry, cast, plugin::About};
use document::{
    Node,
    diagnostic::{Diagnostic, Sources, Span},
    schema_check::{At, Checker, NAME, View},
};
use presentation::{kinds, request::Kinds};
use schemars::SchemaGenerator;
use serde_json::{Map, Value, json};

/// JSON Schema (draft 2020-12) of a study: that of its sections, with the plugins' own schemas inserted.
#[must_use]
pub fn json_schema(registry: &Registry) -> Value {
    let mut generator = SchemaGenerator::default();
    let kinds = Kinds::of(registry);
    let tables = kinds::properties(&kinds.of_tables(), &mut generator);
    let figures = kinds::properties(&kinds.of_figures(), &mut generator);
    let mut schema = generator.into_root_schema_for::<StudyText>().to_value();
    let mut definitions = match schema["$defs"].take() {
        Value::Object(definitions) => definitions,
        _ => Map::new(),
    };
    for (spec, kinds) in [("TableSpec", tables), ("FigureSpec", figures)] {
        for (name, kind) in kinds {
            definitions[spec]["properties"][name] = kind;
        }
    }
    let environments = registry
        .environments
        .iter()
        .map(|(name, entry)| (*name, &entry.about));
    let environment = choice(
        "environment plugin",
        environments,
        "environment",
        &mut definitions,
    );
    let agent = choice("agent plugin", cast::agents(registry), "agent", &mut definitions);
    let protocols = registry
        .protocols
        .iter()
        .map(|(name, entry)| (*name, &entry.about));
    let protocol = choice("protocol plugin", protocols, "protocol", &mut definitions);
    let chosen = [
        ("prepare", prepare(&environment, &agent, &protocol)),
        (
            "environments",
            named("Environments by name, one plugin each.", environment),
        ),
        ("agents", named("Agents by name, one plugin each.", agent)),
        ("protocol", described("How each trial runs.", protocol)),
    ];
    for (section, value) in chosen {
        schema["properties"][section] = value;
    }
    schema["required"] = json!(["study", "environments", "agents", "protocol"]);
    schema["$defs"] = Value::Object(definitions);
    schema
}

fn described(description: &str, mut schema: Value) -> Value {
    schema["description"] = description.into();
    schema
}

fn named(description: &str, value: Value) -> Value {
    json!({
        "description": description, "type": "object", "minProperties": 1, "additionalProperties": value,
        "propertyNames": { "pattern": NAME },
        "x-kind": "entry",
    })
}

/// A mapping with exactly one key, the plugin, over the plugin's config.
fn choice<'a>(
    kind: &str,
    plugins: impl Iterator<Item = (&'static str, &'a About)>,
    prefix: &str,
    definitions: &mut Map<String, Value>,
) -> Value {
    let properties: Map<String, Value> = plugins
        .map(|(name, about)| {
            let schema = with_presets(about);
            (
                name.to_string(),
                embed(schema, &format!("{prefix}.{name}"), definitions),
            )
        })
        .collect();
    json!({
        "type": "object", "properties": properties, "additionalProperties": false,
        "minProperties": 1, "maxProperties": 1, "x-kind": kind,
    })
}

/// A plugin's schema with the key `preset`, if it has presets.
pub(super) fn with_presets(about: &About) -> Value {
    let mut schema = about.schema.clone().to_value();
    if !schema["properties"].is_object() {
        schema["properties"] = json!({});
    }
    // A plugin that accepts any key declares so in its schema.
    if !schema["additionalProperties"].is_object() {
        schema["additionalProperties"] = false.into();
    }
    schema["description"] = about.about.into();
    if !about.presets.is_empty() {
        let names: Vec<&str> = about.presets.iter().map(|preset| preset.name).collect();
        let description = "Named setting to begin from; keys given beside it win.";
        schema["properties"]["preset"] =
            json!({ "description": description, "enum": names, "x-kind": "preset" });
    }
    schema
}

/// Validates a study by the schema.
pub(super) fn check_structure(root: &Node, schema: &Value, sources: &Sources) -> Vec<Diagnostic> {
    let mut checker = Checker::new(sources);
    let start = Span {
        length: 1,
        ..root.span
    };
    checker.check(
        root,
        &At {
            key: start,
            name: String::new(),
            path: String::new(),
        },
        &View::new(schema, schema),
    );
    checker.found
}

/// Moves a schema with its own definitions under `prefix`, and returns a reference to it.
fn embed(mut schema: Value, prefix: &str, definitions: &mut Map<String, Value>) -> Value {
    let own = schema.as_object_mut().and_then(|map| map.remove("$defs"));
    if let Some(map) = schema.as_object_mut() {
        map.remove("$schema");
    }
    if let Some(Value::Object(own)) = own {
        for (name, mut definition) in own {
            rename(&mut definition, prefix);
            definitions.insert(format!("{prefix}.{name}"), definition);
        }
    }
    rename(&mut schema, prefix);
    definitions.insert(prefix.into(), schema);
    json!({ "$ref": format!("#/$defs/{prefix}") })
}

fn rename(schema: &mut Value, prefix: &str) {
    match schema {
        Value::Object(map) => {
            for (key, value) in map {
                match value {
                    Value::String(target) if key == "$ref" && target == "#" => {
                        *target = format!("#/$defs/{prefix}");
                    }
                    Value::String(target) if key == "$ref" => {
                        *target = target.replace("#/$defs/", &format!("#/$defs/{prefix}."));
                    }
                    other => rename(other, prefix),
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(|item| rename(item, prefix)),
        _ => {}
    }
}

fn prepare(environment: &Value, agent: &Value, protocol: &Value) -> Value {
    let either = |what: &str, own: &Value| {
        let description = format!("The {what}: a name of the study, or one that is written here.");
        json!({ "description": description, "anyOf": [{ "type": "string" }, own] })
    };
    json!({
        "description": "Trials that leave something for others, by name: `{ from: NAME }` takes \
                        it.", "type": "object",
        "propertyNames": { "pattern": NAME },
        "additionalProperties": {
            "type": "object", "additionalProperties": false, "required": ["environment", "agent"],
            "properties": {
                "environment": either("environment", environment),
                "agent": either("agent", agent),
                "protocol": described("How it runs; as the study's trials where absent.", protocol.clone()),
            },
        },
    })
}
