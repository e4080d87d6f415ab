//! `list`, `describe` and `schema`: what is registered, for people and for editors.

use super::{BAD_SPEC, Common, Failure, Format, OK, say};
use crate::{
    Registry, executor,
    figure::{self, FigureSpec},
    spec,
    table::{self, TableSpec},
};
use clap::ValueEnum;
use schemars::{JsonSchema, schema_for};
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
    /// What runs trials, or takes them.
    Executors,
}

/// Lists names with a line each.
pub(super) fn list(registry: &Registry, kind: Option<Kind>, common: &Common) -> Result<u8, Failure> {
    let kinds = kind.map_or_else(|| Kind::value_variants().to_vec(), |kind| vec![kind]);
    let lists: Vec<_> = kinds.into_iter().map(|kind| (word(kind), entries(registry, kind))).collect();
    if common.format == Format::Json {
        let object = lists.iter().map(|(word, entries)| {
            let entries = entries.iter().map(|(name, about)| json!({"name": name, "about": about})).collect();
            (word.clone(), Value::Array(entries))
        });
        say(&Value::Object(object.collect()).to_string());
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
        Kind::Tables => kinds::<TableSpec>(&table::KINDS),
        Kind::Figures => kinds::<FigureSpec>(&figure::KINDS),
        Kind::Executors => executor::all().iter().map(|kind| own((kind.name, kind.about))).collect(),
    }
}

/// Kinds of tables or figures, each with what its key says of it.
fn kinds<Spec: JsonSchema>(kinds: &[&'static str]) -> Vec<(&'static str, String)> {
    let schema = schema_for!(Spec).to_value();
    let about = |kind: &str| schema["properties"][kind]["description"].as_str().unwrap_or_default().replace('\n', " ");
    kinds.iter().map(|kind| (*kind, about(kind))).collect()
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

    /// Every key that `is_kind` knows by its schema is listed, with a sentence.
    fn assert_listed<Spec: JsonSchema>(named: &[&'static str], is_kind: impl Fn(&Value) -> bool) {
        let schema = schema_for!(Spec).to_value();
        let definition = |property: &Value| {
            let name = property["anyOf"][0]["$ref"].as_str().and_then(|place| place.strip_prefix("#/$defs/"))?;
            Some(schema["$defs"][name].clone())
        };
        let properties = schema["properties"].as_object().unwrap().iter();
        let mut keys: Vec<&str> =
            properties.filter(|(_, it)| definition(it).is_some_and(|it| is_kind(&it))).map(|(key, _)| key.as_str()).collect();
        let listed = kinds::<Spec>(named);
        let mut names: Vec<&str> = listed.iter().map(|(name, _)| *name).collect();
        keys.sort_unstable();
        names.sort_unstable();
        assert_eq!(names, keys);
        assert!(listed.iter().all(|(_, about)| about.len() > 20), "{listed:?}");
    }

    #[test]
    fn every_kind_of_table_is_listed_with_a_sentence() {
        // A margin is a mapping too, and has no labels.
        assert_listed::<TableSpec>(&table::KINDS, |definition| definition["properties"]["labels"].is_object());
    }

    #[test]
    fn every_kind_of_figure_is_listed_with_a_sentence() {
        assert_listed::<FigureSpec>(&figure::KINDS, |definition| definition["properties"].is_object());
    }
}
