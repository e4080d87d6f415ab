//! `list`, `describe` and `schema`: what is registered, for people and for editors.

use super::{BAD_SPEC, Common, Failure, Format, OK, say};
use crate::{
    Registry, spec,
    table::{KINDS, TableSpec},
};
use clap::ValueEnum;
use serde_json::json;

/// What can be listed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Kind {
    /// Simulated systems.
    Environments,
    /// Algorithms, rules and reference controllers.
    Agents,
    /// Ways to run a trial.
    Protocols,
    /// Kinds of tables.
    Tables,
    /// Kinds of figures.
    Figures,
}

const FIGURES: [(&str, &str); 6] = [
    ("learning_curve", "a metric against training steps, with its seeds or a band over them"),
    ("trajectory", "step-by-step values of one recorded episode"),
    ("bars", "a metric by groups of bars"),
    ("grouped_lines", "a metric against a swept key"),
    ("scatter", "one metric against another"),
    ("contour", "a surface with a path over it"),
];

/// Lists names with a line each.
pub(super) fn list(registry: &Registry, kind: Option<Kind>, common: &Common) -> Result<u8, Failure> {
    let kinds = kind.map_or_else(|| Kind::value_variants().to_vec(), |kind| vec![kind]);
    let lists: Vec<_> = kinds.into_iter().map(|kind| (word(kind), entries(registry, kind))).collect();
    if common.format == Format::Json {
        let object = lists.iter().map(|(word, entries)| {
            let entries = entries.iter().map(|(name, about)| json!({"name": name, "about": about})).collect();
            (word.clone(), serde_json::Value::Array(entries))
        });
        say(&serde_json::Value::Object(object.collect()).to_string());
        return Ok(OK);
    }
    for (word, entries) in lists {
        let width = entries.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
        let lines = entries.iter().map(|(name, about)| format!("  {name:<width$}  {about}")).collect::<Vec<_>>().join("\n");
        say(&format!("{word}\n{lines}"));
    }
    Ok(OK)
}

fn word(kind: Kind) -> String {
    format!("{kind:?}").to_lowercase()
}

fn entries(registry: &Registry, kind: Kind) -> Vec<(&'static str, String)> {
    let own = |(name, about): (&'static str, &str)| (name, about.to_owned());
    match kind {
        Kind::Environments => registry.environments.iter().map(|(name, entry)| own((name, entry.about.about))).collect(),
        Kind::Agents => registry.agents.iter().map(|(name, entry)| own((name, entry.about.about))).collect(),
        Kind::Protocols => registry.protocols.iter().map(|(name, entry)| own((name, entry.about.about))).collect(),
        Kind::Tables => tables(),
        Kind::Figures => FIGURES.into_iter().map(own).collect(),
    }
}

/// The kinds of tables, each with what its key says of it.
fn tables() -> Vec<(&'static str, String)> {
    let schema = schemars::schema_for!(TableSpec).to_value();
    let about = |kind: &str| schema["properties"][kind]["description"].as_str().unwrap_or_default().replace('\n', " ");
    KINDS.into_iter().map(|kind| (kind, about(kind))).collect()
}

/// Prints one plugin's parameters.
pub(super) fn describe(registry: &Registry, name: &str) -> Result<u8, Failure> {
    let text = spec::describe(registry, name).map_err(|text| Failure { code: BAD_SPEC, text })?;
    say(&text);
    Ok(OK)
}

/// Prints the JSON Schema of a study.
pub(super) fn schema(registry: &Registry) -> Result<u8, Failure> {
    say(&format!("{:#}", spec::json_schema(registry)));
    Ok(OK)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every key of a table that takes a mapping of its own is a kind: none is left out of the list.
    #[test]
    fn every_kind_of_table_is_listed_with_a_sentence() {
        let schema = schemars::schema_for!(TableSpec).to_value();
        let takes_mapping = |property: &serde_json::Value| {
            let place = property["anyOf"][0]["$ref"].as_str().and_then(|place| place.strip_prefix("#/$defs/"));
            place.is_some_and(|name| schema["$defs"][name]["properties"]["labels"].is_object())
        };
        let properties = schema["properties"].as_object().unwrap();
        let mut kinds: Vec<&str> = properties.iter().filter(|(_, it)| takes_mapping(it)).map(|(key, _)| key.as_str()).collect();
        let listed = tables();
        let mut names: Vec<&str> = listed.iter().map(|(name, _)| *name).collect();
        kinds.sort_unstable();
        names.sort_unstable();
        assert_eq!(names, kinds);
        assert!(listed.iter().all(|(_, about)| about.len() > 20), "{listed:?}");
    }
}
