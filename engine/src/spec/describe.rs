//! Plugins and kinds of tables and figures described for people: keys with type, range, unit, default, source
//! and meaning; presets.

use crate::{
    Better, Metric, Registry, cast, figure::FigureKind, kinds::Kind, registry::About, schema_check::View,
    statistics::Aggregate, table::TableKind,
};
use schemars::SchemaGenerator;
use serde_json::{Map, Value, json};
use std::fmt::Write;

/// Describes the environment, agent, protocol or kind of table or figure of this name; all of them where
/// several share it.
///
/// # Errors
/// Where nothing has the name: the nearest one.
pub fn describe(registry: &Registry, name: &str) -> Result<String, String> {
    let environments = registry
        .environments
        .iter()
        .map(|(name, entry)| ("environment", *name, &entry.about));
    let agents = cast::agents(registry).map(|(name, about)| ("agent", name, about));
    let protocols = registry
        .protocols
        .iter()
        .map(|(name, entry)| ("protocol", *name, &entry.about));
    let plugins = environments.chain(agents).chain(protocols);
    let plugins = plugins.map(|(kind, known, about)| {
        let text = if known == name {
            plugin(kind, known, about) + &recorded(registry, kind, known)
        } else {
            String::new()
        };
        (known, text)
    });
    let tables = TableKind::ALL.iter().map(|it| (it.name, asked_for("table", it)));
    let figures = FigureKind::ALL
        .iter()
        .map(|it| (it.name, asked_for("figure", it)));
    let aggregates = Aggregate::ALL.into_iter().map(|it| (it.name(), aggregate(it)));
    let all: Vec<(&str, String)> = plugins.chain(tables).chain(figures).chain(aggregates).collect();
    let found: Vec<&str> = all
        .iter()
        .filter(|(known, _)| *known == name)
        .map(|(_, text)| text.as_str())
        .collect();
    if found.is_empty() {
        let known = all.iter().map(|(known, _)| *known);
        return Err(format!(
            "nothing is named `{name}`; {}",
            crate::diagnostic::suggest(name, known)
        ));
    }
    Ok(found.join("\n"))
}

/// What an environment or protocol with its defaults, or an agent, records; nothing where it records nothing.
fn recorded(registry: &Registry, kind: &str, name: &str) -> String {
    let metrics: Vec<Metric> = match kind {
        "environment" => {
            let entry = &registry.environments[name];
            (entry.build)(&entry.about.defaults).map_or_else(|_| Vec::new(), |built| built.metrics().to_vec())
        }
        "protocol" => {
            let entry = &registry.protocols[name];
            (entry.build)(&entry.about.defaults).map_or_else(|_| Vec::new(), |built| built.metrics())
        }
        _ => registry
            .agents
            .get(name)
            .map_or_else(Vec::new, |entry| entry.metrics.clone()),
    };
    let mut out = String::new();
    if !metrics.is_empty() {
        line(&mut out, 0, "");
        line(&mut out, 0, "Records");
    }
    for Metric {
        name,
        unit,
        about,
        better,
        ..
    } in &metrics
    {
        let unit = if unit.is_empty() {
            String::new()
        } else {
            format!(" [{unit}]")
        };
        let direction = if *better == Better::Lower {
            "; less is better"
        } else {
            ""
        };
        line(&mut out, 1, &format!("{name}{unit}: {about}{direction}"));
    }
    out
}

/// A kind of table or figure.
fn asked_for(what: &str, kind: &Kind) -> String {
    let mut out = String::new();
    let mut generator = SchemaGenerator::default();
    let mut schema = (kind.schema)(&mut generator).to_value();
    schema["$defs"] = Value::Object(generator.take_definitions(true));
    let view = View::new(&schema, &schema);
    line(&mut out, 0, &format!("{} ({what})", kind.name));
    line(&mut out, 0, kind.about);
    line(&mut out, 0, "");
    line(&mut out, 0, "Keys");
    parameters(&mut out, 1, &view, &defaults(&view));
    out
}

/// The defaults that a schema says, by key.
fn defaults(schema: &View<'_>) -> Value {
    let default = |name: &str| Some((name.to_owned(), schema.property(name)?.get("default")?.clone()));
    Value::Object(
        schema
            .property_names()
            .into_iter()
            .filter_map(default)
            .collect::<Map<_, _>>(),
    )
}

fn aggregate(aggregate: Aggregate) -> String {
    format!(
        "{} (one number of a trial, in a claim)\n{}\n",
        aggregate.name(),
        aggregate.about()
    )
}

fn plugin(kind: &str, name: &str, about: &About) -> String {
    let mut out = String::new();
    let schema = about.schema.as_value();
    line(
        &mut out,
        0,
        &format!("{name} ({kind}, version {})", about.version),
    );
    line(&mut out, 0, about.about);
    line(&mut out, 0, "");
    line(&mut out, 0, "Parameters");
    parameters(&mut out, 1, &View::new(schema, schema), &about.defaults);
    if !about.presets.is_empty() {
        line(&mut out, 0, "");
        line(&mut out, 0, "Presets");
        for preset in &about.presets {
            line(&mut out, 1, &format!("{}: {}", preset.name, preset.about));
            for (key, value) in preset.values.as_object().into_iter().flatten() {
                line(&mut out, 2, &format!("{key}: {value}"));
            }
        }
    }
    out
}

fn parameters(out: &mut String, level: usize, schema: &View<'_>, defaults: &Value) {
    let names = schema.property_names();
    if names.is_empty() {
        line(out, level, "none");
    }
    for name in names {
        let Some(property) = schema.property(name) else {
            continue;
        };
        let default = defaults.get(name).unwrap_or(&Value::Null);
        let required = schema
            .get("required")
            .and_then(Value::as_array)
            .is_some_and(|keys| keys.contains(&json!(name)));
        line(
            out,
            level,
            &format!("{name}: {}", kind(&property, default, required)),
        );
        let description = property
            .get("description")
            .and_then(Value::as_str)
            .unwrap_or_default();
        description
            .lines()
            .filter(|text| !text.trim().is_empty())
            .for_each(|text| line(out, level + 1, text.trim()));
        if let Some(source) = property.get("x-source").and_then(Value::as_str) {
            line(out, level + 1, &format!("source: {source}"));
        }
        if let Some(fields) = property
            .as_struct()
            .filter(|fields| !fields.property_names().is_empty())
        {
            parameters(out, level + 1, &fields, default);
        }
    }
}

/// Type, range, unit and default in one line.
fn kind(property: &View<'_>, default: &Value, required: bool) -> String {
    let places = property.alternatives();
    let range = places.iter().map(View::range).find(|range| !range.is_empty());
    let unit = property
        .get("x-unit")
        .and_then(Value::as_str)
        .filter(|unit| !unit.is_empty());
    let default = match default {
        Value::Object(_) => None,
        Value::Null if required => Some("required".into()),
        Value::Null => Some("default none".to_string()),
        value => Some(format!("default {value}")),
    };
    let expected = [Some(property.expected()), range]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(" ");
    [Some(expected), unit.map(|unit| format!("in {unit}")), default]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(", ")
}

fn line(out: &mut String, level: usize, text: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(out, "{}", format!("{}{text}", "  ".repeat(level)).trim_end());
}
