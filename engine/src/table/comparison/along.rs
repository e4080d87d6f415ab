//! What varies along rows and columns: agents, environments, settings, or the values of one swept key.

use super::{Axis, Comparison};
use crate::{results::TrialResult, setting::word, table::Scope};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// What varies along a table's rows or columns.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Along {
    /// Agents, environments, or settings as a whole.
    Axis(Axis),
    /// The values of a swept key, named as in `sweep` or by its last word.
    Key(String),
}

impl Along {
    /// The word for what varies.
    #[must_use]
    pub fn name(&self) -> Cow<'static, str> {
        match self {
            Along::Axis(axis) => axis.name().into(),
            Along::Key(key) => key.rsplit('.').next().unwrap_or_default().to_owned().into(),
        }
    }

    /// The swept key.
    #[must_use]
    pub fn key(&self) -> Option<&str> {
        match self {
            Along::Axis(_) => None,
            Along::Key(key) => Some(key),
        }
    }
}

impl From<Axis> for Along {
    fn from(axis: Axis) -> Self {
        Along::Axis(axis)
    }
}

/// The axes of a comparison. Where keys are rows or columns, what is left of a setting is the setting.
pub(super) struct Axes<'a> {
    comparison: &'a Comparison,
    apart: Vec<&'a str>,
}

impl<'a> Axes<'a> {
    pub(super) fn of(comparison: &'a Comparison) -> Self {
        let both = std::iter::once(&comparison.rows).chain(&comparison.columns);
        Self {
            comparison,
            apart: both.filter_map(Along::key).collect(),
        }
    }

    /// A trial's place along one of them; empty where the key is none of its setting's.
    fn place<'t>(&self, along: &Along, trial: &'t TrialResult) -> Cow<'t, str> {
        let point = &trial.trial.point;
        match along {
            Along::Axis(Axis::Setting) if !self.apart.is_empty() => {
                let rest = self
                    .apart
                    .iter()
                    .fold(point.clone(), |rest, key| rest.without(key));
                rest.to_string().into()
            }
            Along::Axis(axis) => axis.of(trial).into(),
            Along::Key(key) => point.get(key).map(word).unwrap_or_default().into(),
        }
    }

    /// The trials at one place.
    pub(super) fn at<'r>(&self, scope: &Scope<'r>, along: &Along, name: &str) -> Scope<'r> {
        let trials = scope.trials.iter().copied();
        Scope {
            trials: trials.filter(|trial| self.place(along, trial) == name).collect(),
        }
    }

    /// The places, as a study lists them and then in the order of the plan.
    pub(super) fn names(&self, scope: &Scope<'_>, along: &Along) -> Vec<String> {
        match along {
            Along::Axis(Axis::Agent) => scope.names(Axis::Agent, &self.comparison.agents),
            Along::Axis(Axis::Environment) => scope.names(Axis::Environment, &self.comparison.environments),
            along => {
                let mut names: Vec<String> = Vec::new();
                for trial in &scope.trials {
                    let name = self.place(along, trial);
                    if !names.iter().any(|known| *known == name) {
                        names.push(name.into_owned());
                    }
                }
                names
            }
        }
    }

    /// True where trials differ along it.
    pub(super) fn vary(&self, scope: &Scope<'_>, along: &Along) -> bool {
        self.names(scope, along).len() > 1
    }
}
