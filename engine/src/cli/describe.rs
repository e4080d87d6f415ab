//! `list`, `describe` and `schema`: what is registered, for people and for editors.

use super::{BAD_SPEC, Common, Failure, Format, OK, say};
use crate::{Registry, spec};
use clap::ValueEnum;
use serde_json::json;

/// What can be listed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Kind {
    /// Simulated systems.
    Environments,
    /// Algorithms, rules and bounds.
    Agents,
    /// Ways to run a trial.
    Protocols,
    /// Kinds of tables.
    Tables,
    /// Kinds of figures.
    Figures,
}

const TABLES: [(&str, &str); 2] = [
    ("improvement", "how much better agents are than one of them"),
    ("comparison", "a metric of agents and environments side by side"),
];

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

fn entries(registry: &Registry, kind: Kind) -> Vec<(&'static str, &'static str)> {
    match kind {
        Kind::Environments => registry.environments.iter().map(|(name, entry)| (*name, entry.about.about)).collect(),
        Kind::Agents => registry.agents.iter().map(|(name, entry)| (*name, entry.about.about)).collect(),
        Kind::Protocols => registry.protocols.iter().map(|(name, entry)| (*name, entry.about.about)).collect(),
        Kind::Tables => TABLES.to_vec(),
        Kind::Figures => FIGURES.to_vec(),
    }
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
