//! Dotted paths such as `dsac.actor_learning_rate` or `protocol.steps`: what they name and whether it exists.

use super::written::Written;
use crate::{
    diagnostic::{Diagnostic, Sources, Span, suggest},
    document::Node,
    schema_check::{At, Checker, View},
};
use serde_json::Value;

/// What a path begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Target {
    /// The environment with this index.
    Environment(usize),
    /// The agent with this index.
    Agent(usize),
    /// The protocol.
    Protocol,
    /// The seeds.
    Seeds,
}

/// A path that exists.
#[derive(Debug, Clone)]
pub struct KeyPath<'a> {
    /// Whose config.
    pub target: Target,
    /// Keys inside the plugin's config.
    pub keys: Vec<String>,
    /// What a value there must fit.
    pub schema: View<'a>,
    /// Where the path is written.
    pub span: Span,
}

/// Finds the key that `text` names.
///
/// # Errors
/// Where it does not exist: the part that is unknown, with the nearest known one.
pub fn find<'a>(
    text: &str,
    span: Span,
    at: &str,
    written: &Written,
    schema: &'a Value,
    sources: &Sources,
) -> Result<KeyPath<'a>, Diagnostic> {
    let words: Vec<&str> = text.split('.').collect();
    let study = View::new(schema, schema);
    let fail = |index: usize, message: String, known: Vec<&str>| {
        let before: usize = words[..index].iter().map(|word| word.chars().count() + 1).sum();
        let span = Span { column: span.column + before, length: words[index].chars().count(), ..span };
        Err(sources.error(span, at, message).help(suggest(words[index], known)))
    };
    if text == "seeds" {
        return Ok(KeyPath { target: Target::Seeds, keys: vec![], schema: study.property("seeds").unwrap_or(study), span });
    }
    let Some((target, used)) = begin(&words, written) else {
        let index = usize::from(words.len() > 1 && ["environments", "agents"].contains(&words[0]));
        let known = written.names().into_iter().chain(["protocol", "seeds"]);
        return fail(index, format!("no environment or agent is named `{}`", words[index]), known.collect());
    };
    let plugin = written.plugin(target);
    let Some(config) = config_schema(study, target, plugin) else {
        return Err(sources.error(span, at, format!("`{plugin}` is no known plugin, so it has no keys")));
    };
    let named_twice = words.get(used) == Some(&plugin) && config.property(plugin).is_none();
    let first = used + usize::from(named_twice);
    let keys: Vec<String> = words[first..].iter().map(ToString::to_string).collect();
    if keys.is_empty() {
        let example = format!("{}.{}", words[used - 1], config.property_names().first().unwrap_or(&"key"));
        return Err(sources
            .error(span, at, format!("`{text}` names no key"))
            .help(format!("write a key behind it: `{example}`")));
    }
    match config.descend(&keys) {
        Ok(schema) => Ok(KeyPath { target, keys, schema, span }),
        Err((index, known)) if index == 0 => fail(first, format!("`{plugin}` has no key `{}`", keys[0]), known),
        Err((index, known)) => {
            let owner = keys[..index].join(".");
            fail(first + index, format!("`{owner}` of `{plugin}` has no key `{}`", keys[index]), known)
        }
    }
}

/// What the first words name, and how many they are.
fn begin(words: &[&str], written: &Written) -> Option<(Target, usize)> {
    let environment = |name: &str| written.environments.iter().position(|it| it.name == name).map(Target::Environment);
    let agent = |name: &str| written.agents.iter().position(|it| it.name == name).map(Target::Agent);
    match words {
        ["protocol", ..] => Some((Target::Protocol, 1)),
        ["environments", name, ..] => environment(name).map(|target| (target, 2)),
        ["agents", name, ..] => agent(name).map(|target| (target, 2)),
        [name, ..] => environment(name).or_else(|| agent(name)).map(|target| (target, 1)),
        [] => None,
    }
}

fn config_schema<'a>(study: View<'a>, target: Target, plugin: &str) -> Option<View<'a>> {
    match target {
        Target::Environment(_) => study.property("environments")?.property("any")?.property(plugin),
        Target::Agent(_) => study.property("agents")?.property("any")?.property(plugin),
        Target::Protocol => study.property("protocol")?.property(plugin),
        Target::Seeds => None,
    }
}

impl KeyPath<'_> {
    /// Checks a value for this key.
    #[must_use]
    pub fn check(&self, value: &Node, at: &str, sources: &Sources) -> Vec<Diagnostic> {
        let mut checker = Checker::new(sources);
        checker.check(value, &At { key: self.span, path: at.into() }, &self.schema);
        checker.found
    }

    /// True for the key `preset`, which is no key of the config itself.
    #[must_use]
    pub fn is_preset(&self) -> bool {
        self.keys == ["preset"]
    }

    /// True where both name the same key, or one a key inside the other.
    #[must_use]
    pub fn overlaps(&self, other: &KeyPath<'_>) -> bool {
        self.target == other.target && self.keys.iter().zip(&other.keys).all(|(mine, theirs)| mine == theirs)
    }
}
