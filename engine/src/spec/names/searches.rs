//! The table and the figures of a search that a report has where the study asks for none.

use super::Asked;
use crate::{
    figure::{BestSoFar, FigureKind, FigureSpec, ParallelCoordinates},
    table::{BestSettings, TableKind, TableSpec},
};

impl Asked {
    /// Adds the best settings of a search, the way to them and their values, each where the study has no such table or
    /// figure.
    pub(super) fn show_search(&mut self, search: &str) {
        let is_best = |kind: &TableKind| matches!(kind, TableKind::BestSettings(it) if it.search == search);
        self.add_table(
            format!("{search}-best-settings"),
            is_best,
            BestSettings::of(search).into(),
        );
        let is_way = |kind: &FigureKind| matches!(kind, FigureKind::BestSoFar(it) if it.search == search);
        let way = BestSoFar {
            search: search.into(),
        };
        self.add_figure(format!("{search}-best-so-far"), is_way, way.into());
        let is_values =
            |kind: &FigureKind| matches!(kind, FigureKind::ParallelCoordinates(it) if it.search == search);
        let values = ParallelCoordinates {
            search: search.into(),
            best: None,
        };
        self.add_figure(format!("{search}-settings"), is_values, values.into());
    }

    fn add_table(&mut self, name: String, is_same: impl Fn(&TableKind) -> bool, kind: TableKind) {
        let is_there = self
            .tables
            .iter()
            .any(|(other, spec)| *other == name || is_same(&spec.kind));
        if !is_there {
            self.tables.push((name, TableSpec::of(kind)));
        }
    }

    fn add_figure(&mut self, name: String, is_same: impl Fn(&FigureKind) -> bool, kind: FigureKind) {
        let is_there = self
            .figures
            .iter()
            .any(|(other, spec)| *other == name || is_same(&spec.kind));
        if !is_there {
            self.figures.push((name, FigureSpec::of(kind)));
        }
    }
}
