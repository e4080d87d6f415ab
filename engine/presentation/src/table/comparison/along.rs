//! The cells of a comparison by their places along its axes.

use super::{Axis, Comparison, TableAxis};
use crate::{axis::listed_first, table::Scope};
use contract::{trial::TrialCell, trial_result::TrialResult};
use std::{collections::HashMap, sync::Arc};

/// The axes of a comparison, and the places of its trials on them. If keys are rows or columns, the remaining keys form
/// the setting.
///
/// A study may have a million trials in few cells. Therefore the axes hold cells, each with its places, and take the
/// trials from them at the end.
pub(super) struct Axes<'a, 'r> {
    comparison: &'a Comparison,
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
        let apart: Vec<&str> = both().filter_map(TableAxis::key).collect();
        let mut alongs: Vec<TableAxis> = Axis::ALL.into_iter().map(TableAxis::from).collect();
        alongs.extend(both().filter(|along| along.key().is_some()).cloned());
        let mut axes = Self {
            comparison,
            cells: Vec::new(),
        };
        let mut known: HashMap<*const TrialCell, usize> = HashMap::new();
        for (position, trial) in scope.trials.iter().copied().enumerate() {
            let cell = *known.entry(Arc::as_ptr(&trial.trial.cell)).or_insert_with(|| {
                let at = |along: &TableAxis| (along.clone(), along.place(trial, &apart).into_owned());
                let (trials, places) = (Vec::new(), alongs.iter().map(at).collect());
                axes.cells.push(CellOfTrials { trials, places });
                axes.cells.len() - 1
            });
            axes.cells[cell].trials.push((position, trial));
        }
        axes
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

    /// The places of some cells along an axis: first those that the study lists, in its order, then the others in the
    /// order of the plan.
    pub(super) fn names(&self, some: &[usize], along: &TableAxis) -> Vec<String> {
        let listed: &[String] = match along {
            TableAxis::Axis(Axis::Agent) => &self.comparison.agents,
            TableAxis::Axis(Axis::Environment) => &self.comparison.environments,
            _ => &[],
        };
        listed_first(listed, some.iter().map(|cell| self.place_of(*cell, along)))
    }

    /// The number that one axis has at the places of a row or column; `None` if several axes have a place, or if the
    /// value there is no number.
    pub(super) fn number(&self, places: &[(TableAxis, String)]) -> Option<f64> {
        let mut named = places.iter().filter(|(_, name)| !name.is_empty());
        let (Some((along, name)), None) = (named.next(), named.next()) else {
            return None;
        };
        let cell = *self.at(&self.all(), &[(along.clone(), name.clone())]).first()?;
        along.value(self.cells[cell].trials.first()?.1)?.as_f64()
    }

    /// Whether cells differ along an axis.
    pub(super) fn vary(&self, along: &TableAxis) -> bool {
        self.names(&self.all(), along).len() > 1
    }
}
