//! `list`, `describe` and `schema`: what is registered, for people and for editors.

use super::{BAD_SPEC, Common, Failure, Format, OK, say};
use crate::{
    Registry, cast, executor, figure::FigureKind, kinds, spec, statistics::Aggregate, table::TableKind,
};
use clap::ValueEnum;
use serde_json::{Value, json};

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
    /// How a trial's measurements become one number in a claim.
    Aggregates,
    /// What runs trials, or takes them.
    Executors,
}

/// Lists names with a line each.
pub(super) fn list(registry: &Registry, kind: Option<Kind>, common: &Common) -> Result<u8, Failure> {
    let kinds = kind.map_or_else(|| Kind::value_variants().to_vec(), |kind| vec![kind]);
    let lists: Vec<_> = kinds
        .into_iter()
        .map(|kind| (word(kind), entries(registry, kind)))
        .collect();
    if common.format == Format::Json {
        let object = lists.iter().map(|(word, entries)| {
            let entries = entries
                .iter()
                .map(|(name, about)| json!({"name": name, "about": about}))
                .collect();
            (word.clone(), Value::Array(entries))
        });
        say(&Value::Object(object.collect()).to_string());
        return Ok(OK);
    }
    for (word, entries) in lists {
        let width = entries.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
        let lines = entries
            .iter()
            .map(|(name, about)| format!("  {name:<width$}  {about}"))
            .collect::<Vec<_>>()
            .join("\n");
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
        Kind::Environments => registry
            .environments
            .iter()
            .map(|(name, entry)| own((name, entry.about.about)))
            .collect(),
        Kind::Agents => cast::agents(registry)
            .map(|(name, about)| own((name, about.about)))
            .collect(),
        Kind::Protocols => registry
            .protocols
            .iter()
            .map(|(name, entry)| own((name, entry.about.about)))
            .collect(),
        Kind::Tables => kinds(TableKind::ALL),
        Kind::Figures => kinds(FigureKind::ALL),
        Kind::Aggregates => Aggregate::ALL.map(|it| own((it.name(), it.about()))).into(),
        Kind::Executors => executor::all()
            .iter()
            .map(|kind| own((kind.name, kind.about)))
            .collect(),
    }
}

fn kinds(kinds: &[kinds::Kind]) -> Vec<(&'static str, String)> {
    kinds
        .iter()
        .map(|kind| (kind.name, kind.about.to_owned()))
        .collect()
}

/// Prints the keys of a plugin, or of a kind of table or figure.
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
