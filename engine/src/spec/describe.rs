//! Plugins described for people: parameters with type, range, unit, default, source and meaning; presets.

use crate::{Registry, cast, registry::About, schema_check::View};
use serde_json::Value;
use std::fmt::Write;

/// Describes the environment, agent or protocol of this name; all of them where several kinds share it.
///
/// # Errors
/// Where no plugin has the name: the nearest one.
pub fn describe(registry: &Registry, name: &str) -> Result<String, String> {
    let environments = registry.environments.iter().map(|(name, entry)| ("environment", *name, &entry.about));
    let agents = cast::agents(registry).map(|(name, about)| ("agent", name, about));
    let protocols = registry.protocols.iter().map(|(name, entry)| ("protocol", *name, &entry.about));
    let all: Vec<_> = environments.chain(agents).chain(protocols).collect();
    let found: Vec<String> =
        all.iter().filter(|(_, known, _)| *known == name).map(|(kind, name, about)| plugin(kind, name, about)).collect();
    if found.is_empty() {
        let known = all.iter().map(|(_, known, _)| *known);
        return Err(format!("no plugin is named `{name}`; {}", crate::diagnostic::suggest(name, known)));
    }
    Ok(found.join("\n"))
}

fn plugin(kind: &str, name: &str, about: &About) -> String {
    let mut out = String::new();
    let schema = about.schema.as_value();
    line(&mut out, 0, &format!("{name} ({kind}, version {})", about.version));
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
        let Some(property) = schema.property(name) else { continue };
        let default = defaults.get(name).unwrap_or(&Value::Null);
        line(out, level, &format!("{name}: {}", kind(&property, default)));
        let description = property.get("description").and_then(Value::as_str).unwrap_or_default();
        description.lines().filter(|text| !text.trim().is_empty()).for_each(|text| line(out, level + 1, text.trim()));
        if let Some(source) = property.get("x-source").and_then(Value::as_str) {
            line(out, level + 1, &format!("source: {source}"));
        }
        if let Some(fields) = property.as_struct().filter(|fields| !fields.property_names().is_empty()) {
            parameters(out, level + 1, &fields, default);
        }
    }
}

/// Type, range, unit and default in one line.
fn kind(property: &View<'_>, default: &Value) -> String {
    let places = property.alternatives();
    let range = places.iter().map(View::range).find(|range| !range.is_empty());
    let unit = property.get("x-unit").and_then(Value::as_str).filter(|unit| !unit.is_empty());
    let default = match default {
        Value::Object(_) => None,
        Value::Null => Some("default none".to_string()),
        value => Some(format!("default {value}")),
    };
    let expected = [Some(property.expected()), range].into_iter().flatten().collect::<Vec<_>>().join(" ");
    [Some(expected), unit.map(|unit| format!("in {unit}")), default].into_iter().flatten().collect::<Vec<_>>().join(", ")
}

fn line(out: &mut String, level: usize, text: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(out, "{}", format!("{}{text}", "  ".repeat(level)).trim_end());
}
