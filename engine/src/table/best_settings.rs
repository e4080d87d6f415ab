//! The settings that a search tried, from the best to the worst.

use super::{Cell, Grid, Heading, NumberFormat, Quantity, Table, problem};
use crate::{
    Error,
    diagnostic::suggest,
    results::{Results, SearchResult, TriedSetting},
    spec::names::{Names, Place},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The best settings of a search, one row each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BestSettings {
    /// The search.
    pub search: String,
    /// How many settings are shown.
    #[serde(default = "five")]
    #[schemars(range(min = 1, max = 10_000))]
    pub best: usize,
    /// Digits after the decimal point.
    #[serde(default)]
    #[schemars(range(max = 9))]
    pub decimals: Option<usize>,
    /// Names to print instead of the study's own.
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
}

fn five() -> usize {
    5
}

impl Table for BestSettings {
    fn example() -> &'static str {
        "{ search: learner_rates, best: 3 }"
    }

    fn check(
        &self,
        names: &mut Names<'_>,
        at: &Place<'_>,
        _: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>) {
        let Some(by) = metric_of_search(&self.search, names, at) else {
            return (Vec::new(), Vec::new());
        };
        names.labels(at, &[], std::slice::from_ref(&by));
        (Vec::new(), vec![by])
    }

    fn build(&self, results: &Results) -> Result<Grid, Error> {
        let found = results.searches.iter().find(|it| it.search.name == self.search);
        let found = found.ok_or_else(|| problem(&format!("there is no search `{}`", self.search)))?;
        Ok(self.grid(found, results))
    }

    fn metric_of_unit(&self) -> Option<&str> {
        None
    }
}

/// The metric of a search; says so where no search has the name.
pub(crate) fn metric_of_search(search: &str, names: &mut Names<'_>, at: &Place<'_>) -> Option<String> {
    let known = names.world.searches.clone();
    let found = known.iter().find(|(name, _)| name == search);
    if found.is_none() {
        let help = suggest(search, known.iter().map(|(name, _)| name.as_str()));
        names.say(at.value("search"), format!("no search is named `{search}`"), help);
    }
    found.map(|(_, by)| by.clone())
}

impl BestSettings {
    fn grid(&self, it: &SearchResult, results: &Results) -> Grid {
        let label = |name: &str| {
            self.labels
                .get(name)
                .map_or(name, String::as_str)
                .replace('_', " ")
        };
        let ended = it.ranked();
        let shown = &ended[..self.best.min(ended.len())];
        let heading = |tried: &&TriedSetting| Heading {
            name: tried.setting.clone(),
            label: tried.setting.clone(),
        };
        Grid {
            quantity: Quantity::plain(format!("{}, {} settings were tried", label(&it.search.by), ended.len())),
            row_axis: "setting".into(),
            rows: shown.iter().map(heading).collect(),
            columns: vec![Heading {
                name: it.search.by.clone(),
                label: label(&it.search.by),
            }],
            cells: shown.iter().map(|tried| vec![cell(tried, it, results)]).collect(),
            format: NumberFormat::Fixed(self.decimals.unwrap_or(2)),
            notes: vec![
                "Means over the seeds of the search; the best of many looks better than it is, so its value on fresh seeds \
                 counts."
                    .into(),
            ],
            ..Grid::default()
        }
    }
}

fn cell(tried: &TriedSetting, it: &SearchResult, results: &Results) -> Cell {
    let cell = Cell {
        planned: it.search.seeds.len(),
        failed: tried.failed,
        ..Cell::resting_on(&[], results)
    };
    cell.with_mean(tried.values.clone())
}
