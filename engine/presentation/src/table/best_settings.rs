//! The settings that a search tried, from the best to the worst.

use super::{Cell, Grid, Heading, NumberFormat, Quantity, Scope, Table, problem};
use crate::kinds::KindSpec;
use crate::names::{Names, Place};
use crate::vocabulary::KnownSearch;
use analysis::{
    results::{Results, SearchResult, TriedSetting},
    search::Method,
};
use contract::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The column with the value of the chosen setting on seeds that the search has not seen.
const FRESH: &str = "fresh";

/// The best settings of a search, one row each, and beside the chosen one its value on seeds that the search has not
/// seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BestSettings {
    /// The search.
    pub search: String,
    /// Number of settings that are shown.
    #[serde(default = "five")]
    #[schemars(range(min = 1, max = 10_000))]
    pub best: usize,
    /// Digits after the decimal point; enough to distinguish the values where absent.
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

impl KindSpec for BestSettings {
    fn name() -> &'static str {
        "best_settings"
    }

    fn about() -> &'static str {
        "The settings that a search tried, the best ones first."
    }

    fn example() -> &'static str {
        "{ search: learner_rates, best: 3 }"
    }
}

impl Table for BestSettings {
    fn check(
        &self,
        names: &mut Names<'_>,
        at: &Place<'_>,
        _: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>) {
        let Some(KnownSearch { metric: by, .. }) = names.search(&self.search, at) else {
            return (Vec::new(), Vec::new());
        };
        names.labels(at, &[], std::slice::from_ref(by));
        (Vec::new(), vec![by.clone()])
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

impl BestSettings {
    /// The table of a search with all options absent.
    #[must_use]
    pub fn of(search: &str) -> Self {
        Self {
            search: search.into(),
            best: five(),
            decimals: None,
            labels: BTreeMap::new(),
        }
    }

    fn grid(&self, it: &SearchResult, results: &Results) -> Grid {
        let label = |name: &str| {
            self.labels
                .get(name)
                .map_or(name, String::as_str)
                .replace('_', " ")
        };
        let ended = it.ranked();
        let shown = &ended[..self.best.min(ended.len())];
        let heading = |tried: &&TriedSetting| Heading::of(&tried.setting, tried.setting.as_str());
        let by = label(&it.search.metric);
        let mut columns = vec![Heading::of(&it.search.metric, format!("{by} in the search"))];
        let fresh = fresh(it, results);
        columns.extend(
            fresh
                .as_ref()
                .map(|_| Heading::of(FRESH, format!("{by} on fresh seeds"))),
        );
        let cells = |tried: &&TriedSetting| {
            let is_chosen = it
                .chosen
                .is_some_and(|place| std::ptr::eq(&raw const it.tried[place], *tried));
            let beside = fresh
                .as_ref()
                .map(|fresh| if is_chosen { fresh.clone() } else { Cell::default() });
            std::iter::once(cell(tried, it, results)).chain(beside).collect()
        };
        Grid {
            quantity: Quantity::plain(format!("{by}, {}", number_tried(it, ended.len()))),
            row_axis: "setting".into(),
            rows: shown.iter().map(heading).collect(),
            columns,
            cells: shown.iter().map(cells).collect(),
            format: self.decimals.map_or_else(|| fitting(shown), NumberFormat::Fixed),
            notes: vec![
                "In the search values are means over its own seeds; the best of many looks better there than it is, so \
                 its value on fresh seeds counts."
                    .into(),
            ],
            ..Grid::default()
        }
    }
}

/// The number of tried settings, as text. Halving sets most of them aside before their ends.
fn number_tried(it: &SearchResult, ended: usize) -> String {
    let has_begun =
        |tried: &&TriedSetting| !tried.at_pauses.is_empty() || !tried.values.is_empty() || tried.failed > 0;
    let begun = it.tried.iter().filter(has_begun).count();
    if matches!(it.search.method, Method::Halving(_)) && begun > ended {
        format!("{begun} settings were tried, {ended} of them to their ends")
    } else {
        format!("{ended} settings were tried")
    }
}

/// The format with enough digits to distinguish the settings.
fn fitting(shown: &[&TriedSetting]) -> NumberFormat {
    NumberFormat::fitting(shown.iter().filter_map(|tried| tried.value()))
}

/// The value of the chosen setting on seeds that the search has not seen; `None` before it is chosen.
fn fresh(it: &SearchResult, results: &Results) -> Option<Cell> {
    let trials = it.fresh_trials(&results.trials);
    let scope = Scope { trials };
    let cell = Cell {
        planned: scope.planned(),
        failed: scope.failed(),
        ..Cell::resting_on(&scope.trials, results)
    };
    (!scope.trials.is_empty()).then(|| cell.with_mean(scope.finals(&it.search.metric)))
}

fn cell(tried: &TriedSetting, it: &SearchResult, results: &Results) -> Cell {
    let cell = Cell {
        planned: it.search.seeds.len(),
        failed: tried.failed,
        ..Cell::resting_on(&[], results)
    };
    cell.with_mean(tried.values.clone())
}

#[cfg(test)]
mod tests {
    use super::*;
    use analysis::search::{Direction, Failed, Halving, NoOptions, Search};

    /// Ten settings of one seed each, the last two to their ends and the others to a pause at step 100.
    fn searched(method: Method) -> SearchResult {
        let search = Search {
            name: "rates".into(),
            environment: "e".into(),
            agent: "a".into(),
            plugin: "a".into(),
            keys: Vec::new(),
            metric: "return".into(),
            direction: Direction::Maximize,
            settings: 10,
            seeds: vec![0],
            method,
            failed: Failed::Wait,
        };
        let tried = |index: u32| {
            let (value, ends) = (f64::from(index), index >= 8);
            TriedSetting {
                setting: format!("rate={index}"),
                stop: (!ends).then_some(100),
                at_pauses: BTreeMap::from([(100, BTreeMap::from([(0, Some(value))]))]),
                values: ends.then_some((0, value)).into_iter().collect(),
                missing: usize::from(!ends),
                ..TriedSetting::default()
            }
        };
        SearchResult {
            search,
            tried: (0..10).map(tried).collect(),
            chosen: Some(9),
        }
    }

    fn quantity(method: Method) -> String {
        let results = Results {
            searches: vec![searched(method)],
            ..Results::of(Vec::new())
        };
        BestSettings::of("rates").build(&results).unwrap().quantity.value
    }

    #[test]
    fn settings_that_halving_set_aside_count_as_tried() {
        let halving = Method::Halving(Halving {
            pauses: vec![100],
            keep: 0.2,
            brackets: 1,
        });
        assert_eq!(
            quantity(halving),
            "return, 10 settings were tried, 2 of them to their ends"
        );
        assert_eq!(
            quantity(Method::Random(NoOptions {})),
            "return, 2 settings were tried"
        );
    }
}
