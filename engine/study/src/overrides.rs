//! `overrides` and `exclude`: values for some combinations of environment and agent, and combinations that are left
//! out.

use super::{
    path::{self, KeyPath},
    sweep::Dimension,
    written::{Selection, Target, Written},
};
use document::{
    FittingItems, Node,
    diagnostic::{Diagnostic, Sources},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// A combination that is left out.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields, extend("minProperties" = 1, "x-kind" = "environment or agent"))]
pub struct ExcludeText {
    /// The environment; all where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String", extend("default" = ""))]
    environment: Option<String>,
    /// The agent; all where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String", extend("default" = ""))]
    agent: Option<String>,
}

/// Values for a combination.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OverrideText {
    /// The environment; all where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String", extend("default" = ""))]
    environment: Option<String>,
    /// The agent; all where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String", extend("default" = ""))]
    agent: Option<String>,
    /// Values by dotted path.
    set: Map<String, Value>,
}

impl OverrideText {
    /// The override with those of its values that are in `kept`, as later stages read it.
    pub fn kept(&self, kept: &Override<'_>) -> Self {
        let mut text = self.clone();
        text.set
            .retain(|key, _| kept.set.iter().any(|(known, ..)| known == key));
        text
    }
}

/// Values that hold for the combinations of a selection.
#[derive(Debug, Clone)]
pub struct Override<'a> {
    /// The combinations.
    pub selection: Selection,
    /// The keys as written and as resolved, with their values.
    pub set: Vec<(String, KeyPath<'a>, Node)>,
}

impl Override<'_> {
    /// Whether a value belongs to this target.
    #[must_use]
    pub fn concerns(&self, target: Target) -> bool {
        self.set.iter().any(|(_, path, _)| path.target == target)
    }
}

/// Reads the section `overrides`; keys that a profile or `--set` fixed are left out.
///
/// # Errors
/// Unknown names and paths, values that do not fit, and values that apply nowhere or that a sweep sets as well.
pub fn read<'a>(
    root: &Node,
    texts: &FittingItems<OverrideText>,
    written: &Written,
    schema: &'a Value,
    sources: &Sources,
    (fixed, dimensions): (&[KeyPath<'_>], &[Dimension<'_>]),
) -> Result<Vec<Override<'a>>, Vec<Diagnostic>> {
    let (mut overrides, mut found) = (Vec::new(), Vec::new());
    for (index, text, item) in texts.located(root.get("overrides")) {
        let at = format!("overrides[{index}]");
        let names = [&text.environment, &text.agent];
        let selection = Selection::of(names, item, &at, written, sources).unwrap_or_else(|errors| {
            found.extend(errors);
            Selection::default()
        });
        let mut set = Vec::new();
        for entry in item.get("set").map_or(&[][..], Node::entries) {
            let at = format!("{at}.set.{}", entry.key);
            match path::find(&entry.key, entry.key_span, &at, written, schema, sources) {
                Ok(path) if fixed.iter().any(|fixed| fixed.overlaps(&path)) => {}
                Ok(path) => {
                    found.extend(path.check(&entry.value, &at, sources));
                    found.extend(useless(&path, &selection, &entry.key, &at, dimensions, sources));
                    set.push((entry.key.clone(), path, entry.value.clone()));
                }
                Err(errors) => found.extend(errors),
            }
        }
        overrides.push(Override { selection, set });
    }
    if found.is_empty() {
        Ok(overrides)
    } else {
        Err(found)
    }
}

fn useless(
    path: &KeyPath<'_>,
    selection: &Selection,
    text: &str,
    at: &str,
    dimensions: &[Dimension<'_>],
    sources: &Sources,
) -> Option<Diagnostic> {
    let error = |message: String| sources.error(path.span, at, message);
    let elsewhere = match path.target {
        Target::Environment(index) => selection.environment.is_some_and(|it| it != index),
        Target::Agent(index) => selection.agent.is_some_and(|it| it != index),
        Target::Protocol => false,
        Target::Play(_) => {
            return Some(error(
                "a play is no part of these combinations, so an override cannot set it".into(),
            ));
        }
        Target::Search(_) => {
            return Some(error(
                "a search is no part of these combinations, so an override cannot set it".into(),
            ));
        }
        Target::Prepared(..) => {
            let message =
                "an entry of `prepare` is no part of these combinations, so an override cannot set it";
            return Some(error(message.into()).help("write the value into the entry"));
        }
        Target::Seeds => {
            return Some(error(
                "seeds are the same for all combinations, so an override cannot set them".into(),
            ));
        }
    };
    if elsewhere {
        return Some(error(format!(
            "`{text}` belongs to another part than this override selects, so it would never apply"
        )));
    }
    if path.is_preset() {
        let help = "give the preset a name of its own under `environments` or `agents`";
        return Some(error("an override cannot choose a preset".into()).help(help));
    }
    let mut swept = dimensions.iter().flat_map(|dimension| &dimension.keys);
    let other = swept.find(|key| key.path.overlaps(path))?;
    let error = error(format!("`{text}` is overridden and swept"));
    Some(
        error
            .note("it is swept here", sources.place(other.path.span))
            .help("leave one of the two out"),
    )
}

/// Reads the section `exclude`.
///
/// # Errors
/// Unknown names, and sections that leave no combination.
pub fn read_exclude(
    root: &Node,
    texts: &FittingItems<ExcludeText>,
    written: &Written,
    sources: &Sources,
) -> Result<Vec<Selection>, Vec<Diagnostic>> {
    let (mut selections, mut found) = (Vec::new(), Vec::new());
    let section = root.entry("exclude");
    for (index, text, item) in texts.located(root.get("exclude")) {
        let (names, at) = ([&text.environment, &text.agent], format!("exclude[{index}]"));
        match Selection::of(names, item, &at, written, sources) {
            Ok(selection) => selections.push(selection),
            Err(errors) => found.extend(errors),
        }
    }
    let left_out = |environment, agent| {
        selections
            .iter()
            .any(|it: &Selection| it.matches(environment, agent))
    };
    let (environments, agents) = (written.environments.len(), written.agents.len());
    let nothing = (0..environments).all(|environment| (0..agents).all(|agent| left_out(environment, agent)));
    if let Some(entry) = section.filter(|_| nothing && found.is_empty() && environments * agents > 0) {
        found.push(sources.error(
            entry.key_span,
            "exclude",
            "every combination is left out, so there is no trial",
        ));
    }
    if found.is_empty() {
        Ok(selections)
    } else {
        Err(found)
    }
}
