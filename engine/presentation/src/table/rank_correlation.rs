//! Rank correlations between environments: Spearman's correlation of a metric over agents and settings.
//!
//! A point is an agent with a setting of the sweep; its value in an environment is the mean over seeds. The interval
//! comes from a bootstrap over the points, since another experiment would have other points. The correlation of each
//! single seed is kept beside it.

use super::{Axis, Cell, Grid, Heading, NumberFormat, Quantity, Reduction, Scope, Table, problem};
use crate::kinds::KindSpec;
use crate::names::{Names, Place};
use analysis::results::Results;
use contract::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{estimators::mean, rank_correlation, rank_correlation_interval};
use std::collections::{BTreeMap, BTreeSet};

const COLUMN: &str = "rank_correlation";

/// Rank correlations of a metric between environments, one row per environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RankCorrelation {
    /// The metric.
    pub value: String,
    /// The environment whose ranking the others are compared with.
    pub against: String,
    /// Environments to compare with it, in this order; all others where empty.
    #[serde(default)]
    pub environments: Vec<String>,
    /// Agents to rank; all where empty.
    #[serde(default)]
    pub agents: Vec<String>,
    /// Digits after the decimal point.
    #[serde(default)]
    #[schemars(range(max = 9))]
    pub decimals: Option<usize>,
    /// Names to print instead of the study's own.
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
}

impl KindSpec for RankCorrelation {
    fn name() -> &'static str {
        "rank_correlation"
    }

    fn about() -> &'static str {
        "How well environments rank agents and settings as one of them (`against`) does, by a metric."
    }

    fn example() -> &'static str {
        "{ value: return, against: long, environments: [short], agents: [rule, other, learner] }"
    }
}

impl Table for RankCorrelation {
    fn check(
        &self,
        names: &mut Names<'_>,
        at: &Place<'_>,
        _: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>) {
        let picked = names.pick(at);
        names.metric(&self.value, at, "value", &picked);
        let all = names.vocabulary.environments.clone();
        if !all.contains(&self.against) {
            let help = document::diagnostic::suggest(&self.against, all.iter().map(String::as_str));
            names.say(
                at.value("against"),
                format!("no environment is named `{}`", self.against),
                help,
            );
        }
        let settings = names.vocabulary.settings.len().max(1);
        if picked.agents.len() * settings < 3 {
            let message = "a ranking of fewer than three agents and settings says nothing";
            names.say(
                (at.key, at.at.clone()),
                message,
                "name more agents, or sweep a setting",
            );
        }
        let listed = |index: &usize| names.vocabulary.environments[*index].clone();
        let rows: Vec<String> = picked
            .environments
            .iter()
            .map(listed)
            .filter(|name| *name != self.against)
            .collect();
        let columns = vec![COLUMN.to_owned()];
        let shown = [columns.clone(), vec![self.against.clone(), self.value.clone()]].concat();
        names.labels(at, &rows, &shown);
        (rows, columns)
    }

    fn no_means(&self) -> Option<&'static str> {
        Some("rank correlation of means")
    }

    fn build(&self, results: &Results) -> Result<Grid, Error> {
        build(self, results)
    }
}

fn build(spec: &RankCorrelation, results: &Results) -> Result<Grid, Error> {
    let all = Scope::of(results, &spec.agents, &[]);
    let against = points(&all.at(Axis::Environment, &spec.against), &spec.value);
    if against.is_empty() {
        let nothing = format!("`{}` has no value to rank by", spec.against);
        return Err(problem(&nothing));
    }
    let wanted = |name: &String| {
        *name != spec.against && (spec.environments.is_empty() || spec.environments.contains(name))
    };
    let rows: Vec<String> = all
        .names(Axis::Environment, &spec.environments)
        .into_iter()
        .filter(wanted)
        .collect();
    let cells = rows
        .iter()
        .map(|name| vec![cell(spec, name, &all, &against, results)]);
    let label = |name: &str| spec.labels.get(name).map_or(name, String::as_str).to_owned();
    Ok(Grid {
        quantity: Quantity::plain(format!(
            "{} ranked against {}, {} points",
            label(&spec.value).replace('_', " "),
            label(&spec.against),
            against.len()
        )),
        one_number: Reduction::RankCorrelation,
        row_axis: Axis::Environment.name().into(),
        cells: cells.collect(),
        rows: rows.iter().map(|name| Heading::of(name, label(name))).collect(),
        columns: vec![Heading::of(
            COLUMN,
            spec.labels.get(COLUMN).map_or("rank correlation", String::as_str),
        )],
        format: NumberFormat::Fixed(spec.decimals.unwrap_or(2)),
        notes: vec![
            "Spearman's rank correlation; intervals are those of a bootstrap over the points.".into(),
        ],
        ..Grid::default()
    })
}

/// The values of seeds by agent and setting.
type Points = BTreeMap<(String, String), BTreeMap<u64, f64>>;

fn points(scope: &Scope<'_>, metric: &str) -> Points {
    let mut points = Points::new();
    for agent in scope.names(Axis::Agent, &[]) {
        let of_agent = scope.at(Axis::Agent, &agent);
        for setting in of_agent.names(Axis::Setting, &[]) {
            let values = of_agent.at(Axis::Setting, &setting).finals(metric);
            if !values.is_empty() {
                points.insert((agent.clone(), setting), values);
            }
        }
    }
    points
}

fn cell(spec: &RankCorrelation, name: &str, all: &Scope<'_>, against: &Points, results: &Results) -> Cell {
    let here = all.at(Axis::Environment, name);
    let there = all.at(Axis::Environment, &spec.against);
    let behind: Vec<_> = here.trials.iter().chain(&there.trials).copied().collect();
    let own = points(&here, &spec.value);
    let both = || {
        own.iter()
            .filter_map(|(point, values)| Some((values, against.get(point)?)))
    };
    let of_means = |values: &BTreeMap<u64, f64>| mean(&values.values().copied().collect::<Vec<_>>());
    let pairs: Vec<(f64, f64)> = both()
        .map(|(one, other)| (of_means(one), of_means(other)))
        .collect();
    let seeds: BTreeSet<u64> = own.values().flat_map(BTreeMap::keys).copied().collect();
    let of_seed = |seed: &u64| {
        let pairs: Vec<(f64, f64)> = both()
            .filter_map(|(one, other)| Some((*one.get(seed)?, *other.get(seed)?)))
            .collect();
        Some((*seed, rank_correlation(&pairs)?))
    };
    Cell {
        seeds: seeds.iter().filter_map(of_seed).collect(),
        planned: here.planned(),
        failed: here.failed(),
        estimate: rank_correlation(&pairs),
        interval: rank_correlation_interval(&pairs).map(|interval| (interval.low, interval.high)),
        missing: here.absences(),
        ..Cell::resting_on(&behind, results)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::Phase;

    /// Twelve agents with the same values in both environments, except that every second pair is swapped.
    fn results() -> Results {
        let mut trials = Vec::new();
        for agent in 0..12u32 {
            for seed in 0..2u64 {
                let there = f64::from(agent);
                let here = f64::from(if agent % 4 < 2 { agent ^ 1 } else { agent });
                for (environment, value) in [("there", there), ("here", here), ("against", -here)] {
                    let rows: testing::synthetic::Rows = vec![(Phase::Final, 10, 0, "score", value * 2.0)];
                    trials.push(testing::synthetic::trial(
                        environment,
                        &format!("agent_{agent}"),
                        "",
                        seed,
                        &rows,
                    ));
                }
            }
        }
        Results::of(trials)
    }

    fn table(environments: &[&str]) -> RankCorrelation {
        RankCorrelation {
            value: "score".into(),
            against: "there".into(),
            environments: environments.iter().map(ToString::to_string).collect(),
            agents: Vec::new(),
            decimals: None,
            labels: BTreeMap::new(),
        }
    }

    #[test]
    fn rankings_are_held_against_one() {
        let grid = build(&table(&[]), &results()).unwrap();
        let names: Vec<&str> = grid.rows.iter().map(|row| row.name.as_str()).collect();
        assert_eq!(names, ["here", "against"]);
        // Six agents off by one rank: 1 - 6 * 6 / (12 * 143).
        let expected = 1.0 - 36.0 / (12.0 * 143.0);
        let here = &grid.cells[0][0];
        assert!((here.estimate.unwrap() - expected).abs() < 1e-12, "{here:?}");
        assert_eq!(here.seeds.len(), 2);
        assert!((grid.cells[1][0].estimate.unwrap() + expected).abs() < 1e-12);
        let (low, high) = here.interval.unwrap();
        assert!(low > 0.7 && low <= here.estimate.unwrap() && high <= 1.0);
        assert!(grid.quantity.value.contains("12 points"), "{:?}", grid.quantity);
    }

    #[test]
    fn without_a_ranking_there_is_nothing_to_hold_against() {
        let absent = RankCorrelation {
            against: "nowhere".into(),
            ..table(&["here"])
        };
        assert!(
            build(&absent, &results())
                .unwrap_err()
                .to_string()
                .contains("`nowhere` has no value")
        );
    }
}
