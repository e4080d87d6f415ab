//! Axes of tables and figures: agents, environments, settings, or the values of one swept key.

use crate::names::{Names, Picked, Place};
use contract::{
    sweep_point::{last_word, word},
    trial_result::TrialResult,
};
use document::diagnostic::{Span, suggest};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{borrow::Cow, collections::HashSet};

/// Name of the setting of agents that no sweep varies, shown beside swept settings.
pub(crate) const AS_GIVEN: &str = "as given";

/// Axis along which trials differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// The study's agents.
    Agent,
    /// The study's environments.
    Environment,
    /// The points of the sweep.
    Setting,
}

impl Axis {
    /// All axes, in the order in which columns are chosen.
    pub const ALL: [Axis; 3] = [Axis::Agent, Axis::Environment, Axis::Setting];

    /// Name of the axis.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Axis::Agent => "agent",
            Axis::Environment => "environment",
            Axis::Setting => "setting",
        }
    }

    /// A trial's place on the axis.
    #[must_use]
    pub fn of(self, trial: &TrialResult) -> &str {
        match self {
            Axis::Agent => &trial.trial.cell.agent,
            Axis::Environment => &trial.trial.cell.environment,
            Axis::Setting => trial.trial.cell.point.words(),
        }
    }
}

/// Axis of a table's rows or columns.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum TableAxis {
    /// Agents, environments, or settings as a whole.
    Axis(Axis),
    /// The values of a swept key, named as in `sweep` or by its last word.
    Key(String),
}

impl From<Axis> for TableAxis {
    fn from(axis: Axis) -> Self {
        TableAxis::Axis(axis)
    }
}

impl TableAxis {
    /// Name of the axis as it is printed.
    #[must_use]
    pub fn title(&self) -> String {
        match self {
            TableAxis::Axis(axis) => axis.name().into(),
            TableAxis::Key(key) => last_word(key).replace('_', " "),
        }
    }

    /// The swept key; `None` for another axis.
    #[must_use]
    pub fn key(&self) -> Option<&str> {
        match self {
            TableAxis::Axis(_) => None,
            TableAxis::Key(key) => Some(key),
        }
    }

    /// The value of the swept key in a trial's setting; `None` for another axis, or if the setting lacks the key.
    #[must_use]
    pub fn value<'t>(&self, trial: &'t TrialResult) -> Option<&'t Value> {
        trial.trial.cell.point.get(self.key()?)
    }

    /// A trial's place on the axis; empty if its setting lacks the key. The keys in `apart` have axes of their own and
    /// are left out of a setting.
    #[must_use]
    pub fn place<'t>(&self, trial: &'t TrialResult, apart: &[&str]) -> Cow<'t, str> {
        match self {
            TableAxis::Axis(Axis::Setting) => trial.trial.cell.point.without(apart).to_string().into(),
            TableAxis::Axis(axis) => axis.of(trial).into(),
            TableAxis::Key(_) => self.value(trial).map(word).unwrap_or_default().into(),
        }
    }

    /// Reports an axis under `key` that names no swept key, or an axis of settings in a study without a sweep.
    pub(crate) fn check(&self, key: &str, names: &mut Names<'_>, place: &Place<'_>) {
        match self {
            TableAxis::Key(word) => {
                let unknown = format!("`{key}` is `{word}`, which no sweep varies");
                check_key(word, unknown, &Axis::ALL.map(Axis::name), names, place.value(key));
            }
            TableAxis::Axis(Axis::Setting) if !names.vocabulary.has_sweep() => {
                let message = format!("`{key}` are settings, but the study has no `sweep`");
                names.say(place.value(key), message, "");
            }
            TableAxis::Axis(_) => {}
        }
    }

    /// The places on the axis that trials of these agents and environments may have.
    pub(crate) fn places(&self, names: &Names<'_>, picked: &Picked) -> Vec<String> {
        let vocabulary = names.vocabulary;
        let of = |known: &[String], some: &[usize]| some.iter().map(|index| known[*index].clone()).collect();
        match self {
            TableAxis::Key(key) => vocabulary.swept_values(key, None),
            TableAxis::Axis(Axis::Agent) => of(&vocabulary.agents, &picked.agents),
            TableAxis::Axis(Axis::Environment) => of(&vocabulary.environments, &picked.environments),
            TableAxis::Axis(Axis::Setting) => settings_of(names, picked),
        }
    }
}

/// The names in `present`, each once: first those in `listed`, in that order, then the others in their own order.
pub(crate) fn listed_first<'n>(listed: &[String], present: impl Iterator<Item = &'n str>) -> Vec<String> {
    let mut seen = HashSet::new();
    let present: Vec<&str> = present.filter(|name| seen.insert(*name)).collect();
    let is_listed = |name: &&str| listed.iter().any(|known| known == name);
    let first = listed.iter().filter(|name| seen.contains(name.as_str())).cloned();
    let rest = present
        .into_iter()
        .filter(|name| !is_listed(name))
        .map(str::to_owned);
    first.chain(rest).collect()
}

/// Reports a name that matches no swept key, in the words of `unknown`, or several keys of one setting. The names in
/// `beside` are also valid there.
pub(crate) fn check_key(
    name: &str,
    unknown: String,
    beside: &[&str],
    names: &mut Names<'_>,
    at: (Span, String),
) {
    let known = names.vocabulary.swept_names();
    if let Some(message) = names.vocabulary.ambiguity(name) {
        names.say(at, message, "");
    } else if !known.contains(&name) {
        names.say(at, unknown, suggest(name, beside.iter().copied().chain(known)));
    }
}

/// The settings of some agents, in order, preceded by that of an agent that no sweep varies; empty if no sweep varies
/// any of them.
fn settings_of(names: &Names<'_>, picked: &Picked) -> Vec<String> {
    let vocabulary = names.vocabulary;
    let varies = |index: &usize| {
        let mut keys = vocabulary.swept.iter();
        keys.any(|key| key.agent.is_none_or(|agent| agent == *index))
    };
    if !picked.agents.iter().any(varies) {
        return Vec::new();
    }
    let first = (!picked.agents.iter().all(varies)).then(|| AS_GIVEN.to_owned());
    let settings = vocabulary.settings.iter().filter(|setting| !setting.is_empty());
    first
        .into_iter()
        .chain(settings.map(ToString::to_string))
        .collect()
}
