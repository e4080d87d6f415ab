//! The table and the figures of a search in a report whose study asks for none.

use super::Request;
use crate::{
    figure::{BestSoFar, FigureSpec, ParallelCoordinates},
    table::{BestSettings, TableSpec},
};

impl Request {
    /// Adds the best settings of a search, its progress and its values. Each is added only if the study has no such
    /// table or figure, and its name is free.
    pub(super) fn show_search(&mut self, search: &str) {
        let is_best = |spec: &TableSpec| {
            let best = spec.kind.downcast::<BestSettings>();
            best.is_some_and(|it| it.search == search)
        };
        let name = format!("{search}-best-settings");
        if !self
            .tables
            .iter()
            .any(|(other, spec)| *other == name || is_best(spec))
        {
            let best = TableSpec {
                caption: format!("The best settings of the search {search}"),
                ..TableSpec::of(BestSettings::of(search))
            };
            self.tables.push((name, best));
        }
        let way = BestSoFar {
            search: search.into(),
            log_y: false,
        };
        let is_way = |spec: &FigureSpec| {
            let way = spec.kind.downcast::<BestSoFar>();
            way.is_some_and(|it| it.search == search)
        };
        self.show(format!("{search}-best-so-far"), is_way, || FigureSpec {
            caption: format!("The best so far of the search {search}"),
            ..FigureSpec::of(way)
        });
        let values = ParallelCoordinates {
            search: search.into(),
            best: None,
        };
        let is_values = |spec: &FigureSpec| {
            let values = spec.kind.downcast::<ParallelCoordinates>();
            values.is_some_and(|it| it.search == search)
        };
        self.show(format!("{search}-settings"), is_values, || FigureSpec {
            caption: format!("The settings of the search {search}"),
            ..FigureSpec::of(values)
        });
    }

    fn show(
        &mut self,
        name: String,
        is_same: impl Fn(&FigureSpec) -> bool,
        figure: impl FnOnce() -> FigureSpec,
    ) {
        if !self
            .figures
            .iter()
            .any(|(other, spec)| *other == name || is_same(spec))
        {
            self.figures.push((name, figure()));
        }
    }
}
