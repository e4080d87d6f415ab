//! The JSON Schema of a study, the parameters of all registered plugins included. Editors complete by it and `check` holds
//! studies against it, so the two cannot differ.

use super::{claims::ClaimSpec, cross_play::EPISODES, seeds};
use crate::{
    Registry, cast,
    figure::FigureSpec,
    limits::Limits,
    registry::About,
    results::Success,
    schema_check::{NAME, SLUG},
    table::TableSpec,
};
use serde_json::{Map, Value, json};

/// JSON Schema (draft 2020-12) of a study.
#[must_use]
pub fn json_schema(registry: &Registry) -> Value {
    let mut definitions = Map::new();
    let environments = registry.environments.iter().map(|(name, entry)| (*name, &entry.about));
    let environment = choice("environment plugin", environments, "environment", &mut definitions);
    let agent = choice("agent plugin", cast::agents(registry), "agent", &mut definitions);
    let protocols = registry.protocols.iter().map(|(name, entry)| (*name, &entry.about));
    let protocol = choice("protocol plugin", protocols, "protocol", &mut definitions);
    let table = embed(schemars::schema_for!(TableSpec).to_value(), "table", &mut definitions);
    let figure = embed(schemars::schema_for!(FigureSpec).to_value(), "figure", &mut definitions);
    let success = embed(schemars::schema_for!(Success).to_value(), "success", &mut definitions);
    let claim = embed(schemars::schema_for!(ClaimSpec).to_value(), "claim", &mut definitions);
    let limits = embed(schemars::schema_for!(Limits).to_value(), "limits", &mut definitions);
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A study",
        "description": "Environments, agents, seeds and sweeps, and the tables, figures and claims made of their trials.",
        "type": "object",
        "additionalProperties": false,
        "required": ["study", "environments", "agents", "protocol"],
        "properties": {
            "study": { "description": "Name of the study and of its folder of results.", "type": "string", "pattern": SLUG },
            "title": text("What the study is about, as a heading."),
            "source": text("Where the published numbers come from."),
            "departures": { "description": "What differs from the source, one sentence each.", "type": "array", "items": { "type": "string" } },
            "environments": named("Environments by name, one plugin each.", environment.clone(), NAME),
            "agents": named("Agents by name, one plugin each.", agent.clone(), NAME),
            "protocol": described("How each trial runs.", protocol.clone()),
            "seeds": seeds::schema(),
            "success": described("What counts as a success of a seed; adds the metric `success`.", success),
            "sweep": sweep(),
            "profiles": profiles(),
            "exclude": exclude(),
            "prepare": prepare(&environment, &agent, &protocol),
            "cross_play": cross_play(),
            "overrides": overrides(),
            "tables": { "description": "Tables by name.", "type": "object", "additionalProperties": table, "propertyNames": { "pattern": SLUG } },
            "figures": { "description": "Figures by name.", "type": "object", "additionalProperties": figure, "propertyNames": { "pattern": SLUG } },
            "claims": claims(claim),
            "limits": described("What one trial may use, and what is tried again; no trial's numbers depend on it.", limits),
        },
        "$defs": definitions,
    })
}

fn text(description: &str) -> Value {
    json!({ "description": description, "type": "string" })
}

fn described(description: &str, mut schema: Value) -> Value {
    schema["description"] = description.into();
    schema
}

fn named(description: &str, value: Value, pattern: &str) -> Value {
    json!({
        "description": description, "type": "object", "minProperties": 1, "additionalProperties": value,
        "propertyNames": { "pattern": pattern },
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
            (name.to_string(), embed(schema, &format!("{prefix}.{name}"), definitions))
        })
        .collect();
    json!({
        "type": "object", "properties": properties, "additionalProperties": false,
        "minProperties": 1, "maxProperties": 1, "x-kind": kind,
    })
}

/// A plugin's schema with the key `preset`, where it has presets.
pub(super) fn with_presets(about: &About) -> Value {
    let mut schema = about.schema.clone().to_value();
    if !schema["properties"].is_object() {
        schema["properties"] = json!({});
    }
    schema["additionalProperties"] = false.into();
    schema["description"] = about.about.into();
    if !about.presets.is_empty() {
        let names: Vec<&str> = about.presets.iter().map(|preset| preset.name).collect();
        let description = "Named setting to begin from; keys given beside it win.";
        schema["properties"]["preset"] = json!({ "description": description, "enum": names, "x-kind": "preset" });
    }
    schema
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
                    Value::String(target) if key == "$ref" && target == "#" => *target = format!("#/$defs/{prefix}"),
                    Value::String(target) if key == "$ref" => *target = target.replace("#/$defs/", &format!("#/$defs/{prefix}.")),
                    other => rename(other, prefix),
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(|item| rename(item, prefix)),
        _ => {}
    }
}

fn sweep() -> Value {
    let values = |description: &str| json!({ "description": description, "type": "array", "minItems": 1 });
    let generators = [
        ("grid", values("Values of which every combination is tried.")),
        ("zip", values("Values that go together with those of the other `zip` keys, one by one.")),
        ("random", samples("Samples spread evenly between two limits.", false)),
        ("log_uniform", samples("Samples whose logarithm is spread evenly between two limits.", false)),
        ("latin_hypercube", samples("Samples with one in each of equally likely slices.", true)),
    ];
    let generators: Vec<Value> = generators
        .into_iter()
        .map(|(name, schema)| {
            json!({ "type": "object", "properties": { name: schema }, "required": [name], "additionalProperties": false })
        })
        .collect();
    json!({
        "description": "Swept keys, each with the way its values are made.", "type": "object",
        "additionalProperties": { "oneOf": generators },
    })
}

fn samples(description: &str, has_log: bool) -> Value {
    let mut schema = json!({
        "description": description, "type": "object", "additionalProperties": false, "required": ["low", "high", "samples"],
        "properties": {
            "low": { "description": "Smallest value.", "type": "number" },
            "high": { "description": "Largest value.", "type": "number" },
            "samples": { "description": "Number of samples.", "type": "integer", "minimum": 1, "maximum": 100_000 },
        },
    });
    if has_log {
        schema["properties"]["log"] =
            json!({ "description": "Spread the logarithm evenly.", "type": "boolean", "default": false });
    }
    schema
}

fn profiles() -> Value {
    json!({
        "description": "Named budgets of the study: values that replace others, by dotted path.", "type": "object",
        "additionalProperties": { "type": "object" }, "propertyNames": { "pattern": NAME },
    })
}

fn exclude() -> Value {
    json!({
        "description": "Combinations that are left out.", "type": "array",
        "items": {
            "type": "object", "additionalProperties": false, "minProperties": 1, "x-kind": "environment or agent",
            "properties": { "environment": text("The environment; all where absent."), "agent": text("The agent; all where absent.") },
        },
    })
}

fn prepare(environment: &Value, agent: &Value, protocol: &Value) -> Value {
    let either = |what: &str, own: &Value| json!({ "description": format!("The {what}: a name of the study, or one that is written here."), "anyOf": [{ "type": "string" }, own] });
    json!({
        "description": "Trials that leave something for others, by name: `{ from: NAME }` takes it.", "type": "object",
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

fn cross_play() -> Value {
    let name = json!({ "type": "string" });
    let seats = json!({ "description": "Names of the role's seats.", "type": "array", "minItems": 1, "items": name });
    let roles = json!({
        "description": "Seats by role, at least two roles; every seat of the environment has one.", "type": "object",
        "additionalProperties": seats, "propertyNames": { "pattern": NAME },
    });
    let agents =
        "Agents of the study, those that learn with the policy of their final training step; all that learn where absent.";
    json!({
        "description": "Plays by name: agents that meet after they were trained, in every combination over roles.", "type": "object",
        "propertyNames": { "pattern": NAME },
        "additionalProperties": {
            "type": "object", "additionalProperties": false, "required": ["environment", "roles"],
            "properties": {
                "environment": text("The environment in which the agents were trained."),
                "roles": roles,
                "agents": { "description": agents, "type": "array", "minItems": 1, "items": name },
                "episodes": {
                    "description": "Episodes of each combination and seed.", "type": "integer", "minimum": 1, "maximum": 1_000_000_000,
                    "default": EPISODES,
                },
                "environment_config": { "description": "Keys of the environment that differ from the training.", "type": "object" },
            },
        },
    })
}

fn overrides() -> Value {
    json!({
        "description": "Values for some combinations only.", "type": "array",
        "items": {
            "type": "object", "additionalProperties": false, "required": ["set"],
            "properties": {
                "environment": text("The environment; all where absent."),
                "agent": text("The agent; all where absent."),
                "set": { "description": "Values by dotted path.", "type": "object" },
            },
        },
    })
}

fn claims(long: Value) -> Value {
    json!({
        "description": "Comparisons that the results support, refute or leave open.", "type": "array",
        "items": { "anyOf": [{ "type": "string" }, long] },
    })
}
