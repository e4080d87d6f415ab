//! Axes of a table: agents, environments, settings, or the values of one swept key.

use super::{Axis, Comparison};
use crate::table::{Scope, seeds::listed_first};
use contract::{
    sweep_point::{last_word, word},
    trial::TrialCell,
    trial_result::TrialResult,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{borrow::Cow, collections::HashMap, sync::Arc};

/// Axis of a table's rows or columns.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum TableAxis {
    /// Agents, environments, or settings as a whole.
    Axis(Axis),
    /// The values of a swept key, named as in `sweep` or by its last word.
    Key(String),
}

impl TableAxis {
    /// Name of the axis.
    #[must_use]
    pub fn name(&self) -> Cow<'static, str> {
        match self {
            TableAxis::Axis(axis) => axis.name().into(),
            TableAxis::Key(key) => last_word(key).to_owned().into(),
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
}

impl From<Axis> for TableAxis {
    fn from(axis: Axis) -> Self {
        TableAxis::Axis(axis)
    }
}

/// The axes of a comparison, and the places of its trials on them. Where keys are rows or columns, the remaining keys
/// make the setting.
///
/// A study may have a million trials in few cells. So the axes hold cells, each with its places, and take the trials
/// from them at the end.
pub(super) struct Axes<'a, 'r> {
    comparison: &'a Comparison,
    apart: Vec<&'a str>,
    cells: Vec<CellOfTrials<'r>>,
}

/// The trials of a cell by their places in the plan, and the cell's places along the axes.
struct CellOfTrials<'r> {
    trials: Vec<(usize, &'r TrialResult)>,
    places: Vec<(TableAxis, String)>,
}

/// Some of the cells of a comparison, by their numbers.
pub(super) type Cells = Vec<usize>;

impl<'a, 'r> Axes<'a, 'r> {
    pub(super) fn of(comparison: &'a Comparison, scope: &Scope<'r>) -> Self {
        let both = || std::iter::once(&comparison.rows).chain(&comparison.columns);
        let mut axes = Self {
            comparison,
            apart: both().filter_map(TableAxis::key).collect(),
            cells: Vec::new(),
        };
        let mut alongs: Vec<TableAxis> = Axis::ALL.into_iter().map(TableAxis::from).collect();
        alongs.extend(both().filter(|along| along.key().is_some()).cloned());
        let mut known: HashMap<*const TrialCell, usize> = HashMap::new();
        for (position, trial) in scope.trials.iter().copied().enumerate() {
            let cell = *known.entry(Arc::as_ptr(&trial.trial.cell)).or_insert_with(|| {
                let at = |along: &TableAxis| (along.clone(), axes.place(along, trial).into_owned());
                let (trials, places) = (Vec::new(), alongs.iter().map(at).collect());
                axes.cells.push(CellOfTrials { trials, places });
                axes.cells.len() - 1
            });
            axes.cells[cell].trials.push((position, trial));
        }
        axes
    }

    /// A trial's place along an axis; empty where the trial's setting lacks the key.
    fn place<'t>(&self, along: &TableAxis, trial: &'t TrialResult) -> Cow<'t, str> {
        let point = &trial.trial.cell.point;
        match along {
            TableAxis::Axis(Axis::Setting) if !self.apart.is_empty() => {
                let rest = self
                    .apart
                    .iter()
                    .fold(point.clone(), |rest, key| rest.without(key));
                rest.to_string().into()
            }
            TableAxis::Axis(axis) => axis.of(trial).into(),
            TableAxis::Key(key) => point.get(key).map(word).unwrap_or_default().into(),
        }
    }

    fn place_of(&self, cell: usize, along: &TableAxis) -> &str {
        let places = &self.cells[cell].places;
        let place = places.iter().find(|(known, _)| known == along);
        place.map_or("", |(_, name)| name)
    }

    /// The numbers of all cells.
    pub(super) fn all(&self) -> Cells {
        (0..self.cells.len()).collect()
    }

    /// The cells of `some` that lie at all of these places.
    pub(super) fn at(&self, some: &[usize], places: &[(TableAxis, String)]) -> Cells {
        let is_at = |cell: &usize| {
            places
                .iter()
                .all(|(along, name)| self.place_of(*cell, along) == name)
        };
        some.iter().copied().filter(is_at).collect()
    }

    /// The trials of some cells, in the order of the plan.
    pub(super) fn scope(&self, some: &[usize]) -> Scope<'r> {
        let trials = some.iter().flat_map(|cell| &self.cells[*cell].trials);
        let mut trials: Vec<_> = trials.copied().collect();
        trials.sort_unstable_by_key(|(position, _)| *position);
        Scope {
            trials: trials.into_iter().map(|(_, trial)| trial).collect(),
        }
    }

    /// The places of some cells along an axis: first in the order that the study lists, then in the order of the
    /// plan.
    pub(super) fn names(&self, some: &[usize], along: &TableAxis) -> Vec<String> {
        let listed: &[String] = match along {
            TableAxis::Axis(Axis::Agent) => &self.comparison.agents,
            TableAxis::Axis(Axis::Environment) => &self.comparison.environments,
            _ => &[],
        };
        listed_first(listed, some.iter().map(|cell| self.place_of(*cell, along)))
    }

    /// Whether cells differ along an axis.
    pub(super) fn vary(&self, along: &TableAxis) -> bool {
        self.names(&self.all(), along).len() > 1
    }
}
