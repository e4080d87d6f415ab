//! Several metrics side by side: one row each, agents along the columns, and the correlation of two agents' rankings.

use super::{
    Axis, Cell, Grid, Heading, NumberFormat, Quantity, Scope, Statistic, Table, comparison::summarise,
    problem,
};
use crate::kinds::KindSpec;
use crate::names::{Names, Picked, Place};
use analysis::results::Results;
use contract::{Error, standard_metrics::SUCCESS};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::rank_correlation;
use std::collections::{BTreeMap, BTreeSet};

/// The row with rank correlations.
const RANKS: &str = "rank_correlation";

/// Several metrics of agents in one environment.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Metrics {
    /// The metrics, a row each.
    pub values: Vec<String>,
    /// Beginning of the names of further metrics, as `influence_` of the protocol `attribution`.
    pub starting_with: String,
    /// The environment; the only one where absent.
    pub environment: String,
    /// Agents to show, in this order; all where empty.
    pub agents: Vec<String>,
    /// An agent whose ranking of the metrics by value is compared with those of the others, seed by seed, in an extra
    /// row. It ranks the metrics of `starting_with`, or all metrics where that is absent.
    pub ranked_against: String,
    /// Digits after the decimal point.
    #[schemars(range(max = 9))]
    pub decimals: Option<usize>,
    /// Names to print instead of the study's own.
    pub labels: BTreeMap<String, String>,
}

impl KindSpec for Metrics {
    fn name() -> &'static str {
        "metrics"
    }

    fn about() -> &'static str {
        "Several metrics of agents in one environment, one row each, and how agents rank them."
    }

    fn example() -> &'static str {
        "{ values: [return, length], environment: short, agents: [rule, learner], ranked_against: rule }"
    }
}

impl Table for Metrics {
    fn check(
        &self,
        names: &mut Names<'_>,
        at: &Place<'_>,
        _: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>) {
        let picked = names.pick(at);
        let agents: Vec<String> = picked
            .agents
            .iter()
            .map(|index| names.vocabulary.agents[*index].clone())
            .collect();
        let mut rows = [self.values.clone(), self.further(names, at, &picked)].concat();
        self.refuse(names, at, &picked, &agents);
        if !self.ranked_against.is_empty() {
            rows.push(RANKS.to_owned());
        }
        names.labels(at, &rows, &agents);
        (rows, agents)
    }

    fn build(&self, results: &Results) -> Result<Grid, Error> {
        let environments: Vec<String> = [self.environment.clone()]
            .into_iter()
            .filter(|name| !name.is_empty())
            .collect();
        let all = Scope::of(results, &self.agents, &environments);
        let agents = all.names(Axis::Agent, &self.agents);
        let metrics = self.metrics(&all);
        if metrics.is_empty() {
            return Err(problem("nothing of these metrics is recorded"));
        }
        let of = |agent: &str| all.at(Axis::Agent, agent);
        let row = |name: &str, values: &dyn Fn(&str) -> BTreeMap<u64, f64>| -> Vec<Cell> {
            let cells = agents
                .iter()
                .map(|agent| cell(&of(agent), (name, values(agent)), results));
            cells.collect()
        };
        let mut rows = metrics.clone();
        let mut cells: Vec<Vec<Cell>> = metrics
            .iter()
            .map(|metric| row(metric, &|agent| of(agent).finals(metric)))
            .collect();
        if !self.ranked_against.is_empty() {
            let (compared, against) = (self.compared(&metrics), of(&self.ranked_against));
            rows.push(RANKS.to_owned());
            let others =
                |agent: &str| (agent != self.ranked_against).then(|| ranked(compared, &of(agent), &against));
            cells.push(row(RANKS, &|agent| others(agent).unwrap_or_default()));
        }
        Ok(Grid {
            quantity: Quantity::plain(self.quantity()),
            row_axis: "metric".into(),
            rows: rows.iter().map(|name| self.heading(name)).collect(),
            columns: agents
                .iter()
                .map(|name| Heading::of(name, self.label(name)))
                .collect(),
            cells,
            format: NumberFormat::Fixed(self.decimals.unwrap_or(2)),
            notes: self.notes(),
            ..Grid::default()
        })
    }
}

impl Metrics {
    /// Checks the named metrics, and returns the recorded ones that begin with the given words.
    fn further(&self, names: &mut Names<'_>, at: &Place<'_>, picked: &Picked) -> Vec<String> {
        for value in &self.values {
            names.metric(value, at, "values", picked);
        }
        let recorded = names.recorded(picked);
        let known = names.vocabulary.metrics.iter().map(|metric| metric.name.clone());
        let further: Vec<String> = known
            .filter(|name| self.begins(name) && recorded.contains(name))
            .collect();
        if further.is_empty() && !self.starting_with.is_empty() && !recorded.is_empty() {
            let begin = &self.starting_with;
            let message = format!("no trial records a metric that begins with `{begin}`");
            names.say(at.value("starting_with"), message, "");
        }
        further
    }

    /// Reports options that make no table of metrics.
    fn refuse(&self, names: &mut Names<'_>, at: &Place<'_>, picked: &Picked, agents: &[String]) {
        let place = || (at.key, at.at.clone());
        if self.values.is_empty() && self.starting_with.is_empty() {
            let help = "write `values` or `starting_with`";
            names.say(place(), "it names no metric", help);
        }
        if picked.environments.len() > 1 {
            let message = "several environments cannot stand in one table of metrics";
            names.say(place(), message, "write `environment`");
        }
        if names.vocabulary.settings.len() > 1 && names.vocabulary.sweeps_any(&picked.agents) {
            let message = "several settings of an agent cannot stand in one table of metrics";
            let help = "leave the sweep out, or compare one metric with `comparison`";
            names.say(place(), message, help);
        }
        if !self.ranked_against.is_empty() && !agents.contains(&self.ranked_against) {
            let help = document::diagnostic::suggest(&self.ranked_against, agents.iter().map(String::as_str));
            let message = format!("`{}` is none of the agents of the table", self.ranked_against);
            names.say(at.value("ranked_against"), message, help);
        }
    }

    fn begins(&self, name: &str) -> bool {
        !self.starting_with.is_empty() && name.starts_with(&self.starting_with)
    }

    /// Names of the rows, as trials recorded them.
    fn metrics(&self, all: &Scope<'_>) -> Vec<String> {
        let mut metrics = self.values.clone();
        for name in all
            .trials
            .iter()
            .flat_map(|trial| trial.names.iter().filter(|name| self.begins(name)))
        {
            if !metrics.contains(name) {
                metrics.push(name.clone());
            }
        }
        metrics
    }

    /// The rows whose ranks are compared.
    fn compared<'a>(&self, metrics: &'a [String]) -> &'a [String] {
        let further = &metrics[self.values.len()..];
        if further.is_empty() { metrics } else { further }
    }

    fn quantity(&self) -> String {
        if self.starting_with.is_empty() {
            return "metrics".into();
        }
        self.starting_with.trim_end_matches('_').replace('_', " ")
    }

    fn heading(&self, name: &str) -> Heading {
        let plain = match name {
            RANKS => format!("rank correlation with {}", self.label(&self.ranked_against)),
            _ => name
                .strip_prefix(&self.starting_with)
                .unwrap_or(name)
                .replace('_', " "),
        };
        Heading::of(name, self.labels.get(name).cloned().unwrap_or(plain))
    }

    fn label<'a>(&'a self, name: &'a str) -> &'a str {
        self.labels.get(name).map_or(name, String::as_str)
    }

    /// The metrics that are not ranked, as a phrase.
    fn left_out(&self) -> String {
        if self.starting_with.is_empty() || self.values.is_empty() {
            return String::new();
        }
        let names: Vec<String> = self.values.iter().map(|name| self.heading(name).label).collect();
        format!(" but {}", names.join(", "))
    }

    fn notes(&self) -> Vec<String> {
        if self.ranked_against.is_empty() {
            return Vec::new();
        }
        vec![format!(
            "The last row is Spearman's rank correlation of the rows above{} with those of {}, seed by seed.",
            self.left_out(),
            self.label(&self.ranked_against)
        )]
    }
}

/// The mean over seeds, or their share for the metric of success; empty for a ranking against itself or of metrics that
/// are all equal.
fn cell(behind: &Scope<'_>, (row, seeds): (&str, BTreeMap<u64, f64>), results: &Results) -> Cell {
    let is_none = seeds.is_empty() && behind.trials.iter().any(|trial| trial.is_ok());
    let cell = Cell {
        planned: if is_none { 0 } else { behind.planned() },
        failed: behind.failed(),
        missing: behind.absences(),
        is_share: row == SUCCESS,
        ..Cell::resting_on(&behind.trials, results)
    };
    if cell.is_share {
        // The interval of a mean may leave the range of shares, and has no width if all seeds agree.
        return summarise(seeds.into_iter().collect(), Statistic::Mean, cell);
    }
    cell.with_mean(seeds)
}

/// The rank correlation of an agent's metrics with those of another agent, by seed.
fn ranked(metrics: &[String], own: &Scope<'_>, against: &Scope<'_>) -> BTreeMap<u64, f64> {
    let values = |scope: &Scope<'_>| -> Vec<BTreeMap<u64, f64>> {
        metrics.iter().map(|metric| scope.finals(metric)).collect()
    };
    let (own, against) = (values(own), values(against));
    let seeds: BTreeSet<u64> = own.iter().flat_map(BTreeMap::keys).copied().collect();
    let of_seed = |seed: u64| {
        let pairs = own.iter().zip(&against);
        let pairs = pairs.filter_map(|(one, other)| Some((*one.get(&seed)?, *other.get(&seed)?)));
        Some((seed, rank_correlation(&pairs.collect::<Vec<_>>())?))
    };
    seeds.into_iter().filter_map(of_seed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::Phase;

    fn results() -> Results {
        let trial = |agent: &str, seed: u64, values: [f64; 3]| {
            let names = ["influence_a", "influence_b", "influence_c"];
            let rows: testing::synthetic::Rows = names
                .into_iter()
                .zip(values)
                .map(|(name, value)| (Phase::Final, 0, 0, name, value))
                .collect();
            testing::synthetic::trial("cells", agent, "", seed, &rows)
        };
        Results::of(vec![
            trial("learned", 0, [0.1, 0.2, 0.3]),
            trial("learned", 1, [0.3, 0.2, 0.7]),
            trial("untrained", 0, [0.3, 0.2, 0.1]),
            trial("untrained", 1, [0.5, 0.1, 0.9]),
        ])
    }

    fn table() -> Metrics {
        Metrics {
            starting_with: "influence_".into(),
            ranked_against: "untrained".into(),
            ..Metrics::default()
        }
    }

    #[test]
    fn metrics_stand_in_rows_and_two_agents_rank_them() {
        let grid = table().build(&results()).unwrap();
        let labels: Vec<&str> = grid.rows.iter().map(|row| row.label.as_str()).collect();
        assert_eq!(labels, ["a", "b", "c", "rank correlation with untrained"]);
        let learned = &grid.cells[2][0];
        assert!((learned.estimate.unwrap() - 0.5).abs() < 1e-12);
        // The rankings are opposite at the first seed and the same at the second.
        assert_eq!(grid.cells[3][0].seeds, [(0, -1.0), (1, 1.0)]);
        assert_eq!((grid.cells[3][1].estimate, grid.cells[3][1].planned), (None, 0));
    }

    #[test]
    fn listed_metrics_stand_first_and_are_not_ranked_with_the_others() {
        let listed = Metrics {
            values: vec!["influence_c".into()],
            ..table()
        };
        let grid = listed.build(&results()).unwrap();
        assert_eq!(grid.rows[0].name, "influence_c");
        // The two other metrics are ranked opposite at one seed and the same at the other.
        assert_eq!(grid.cells[3][0].seeds, [(0, -1.0), (1, 1.0)]);
        assert!(
            grid.notes[0].contains("above but c with those of untrained"),
            "{:?}",
            grid.notes
        );
    }

    #[test]
    fn shares_of_success_have_the_interval_that_a_comparison_prints() {
        let trial = |seed: u64| {
            let rows = vec![
                (Phase::Final, 0, 0, SUCCESS, if seed == 0 { 0.0 } else { 1.0 }),
                (Phase::Final, 0, 0, "return", 1.0),
            ];
            testing::synthetic::trial("cells", "learned", "", seed, &rows)
        };
        let results = Results::of((0..6).map(trial).collect());
        let table = Metrics {
            values: vec![SUCCESS.into(), "return".into()],
            ..Metrics::default()
        };
        let compared = crate::table::Comparison {
            value: SUCCESS.into(),
            ..crate::table::Comparison::default()
        };
        let (grid, compared) = (table.build(&results).unwrap(), compared.build(&results).unwrap());
        assert_eq!(grid.cells[0][0].interval, compared.cells[0][0].interval);
        let (low, high) = grid.cells[0][0].interval.unwrap();
        assert!(
            (low - 0.359).abs() < 5e-4 && (high - 0.996).abs() < 5e-4,
            "{low} {high}"
        );
        assert!(!grid.cells[1][0].is_share);
    }

    #[test]
    fn what_nothing_records_is_said() {
        let nothing = Metrics {
            starting_with: "weight_".into(),
            ..Metrics::default()
        };
        let said = nothing.build(&results()).unwrap_err().to_string();
        assert!(said.contains("nothing of these metrics is recorded"), "{said}");
    }
}
