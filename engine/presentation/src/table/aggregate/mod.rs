//! One row per agent over several environments: aggregates of normalised scores, as Agarwal et al. 2021,
//! "Deep reinforcement learning at the edge of the statistical precipice", arXiv:2108.13264, define them.
//!
//! A score is a seed's value in one environment, scaled so that 0 and 1 stand for two agents or two numbers of that
//! environment. Intervals are those of a stratified bootstrap: seeds are resampled within each environment, and the two
//! ends of the scale are held fixed. An agent without a score in one of the environments has no aggregate, since a
//! different set of environments would be another suite.

mod check;

use super::{
    Axis, Cell, Direction, FixedReason, Grid, Heading, MissingReason, MissingSeeds, Normalisation,
    NumberFormat, Quantity, Reduction, Scope, ScoreScale, Table, normalised_scores::ends_in_words, problem,
};
use crate::kinds::KindSpec;
use crate::names::{Names, Place};
use analysis::results::Results;
use contract::{Error, trial_result::TrialResult};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{
    Bootstrap, Interval,
    comparison::{probability_of_improvement, probability_of_improvement_interval},
    estimators::{suite_iqm, suite_mean, suite_median, suite_optimality_gap, suite_share_above},
};
use std::collections::{BTreeMap, BTreeSet};

/// Name of the column of means, the only one that is a mean over seeds.
pub const SUITE_MEAN: &str = "mean";

/// Aggregates of a metric over environments, one row per agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Aggregate {
    /// The metric.
    #[serde(default = "default_metric")]
    pub value: String,
    /// Meaning of the scores 0 and 1 in each environment: the means of two agents, or two numbers.
    pub normalise: Normalisation,
    /// The agent over which the probability of improvement is shown; no such column where absent.
    #[serde(default)]
    pub relative_to: Option<String>,
    /// Scores at which the performance profile is shown: the share of seeds above each, with environments weighted
    /// equally.
    #[serde(default)]
    pub profile_at: Vec<f64>,
    /// Agents to show, in this order; all where empty.
    #[serde(default)]
    pub agents: Vec<String>,
    /// Environments to pool; all where empty.
    #[serde(default)]
    pub environments: Vec<String>,
    /// Digits after the decimal point.
    #[serde(default)]
    #[schemars(range(max = 9))]
    pub decimals: Option<usize>,
    /// Names to print instead of the study's own.
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
}

fn default_metric() -> String {
    "return".into()
}

impl Aggregate {
    /// Agents whose scores are fixed by construction, with the score.
    #[must_use]
    pub fn fixed(&self) -> Vec<(&str, u8)> {
        self.normalise.fixed()
    }

    /// Names of the columns, in their order.
    #[must_use]
    pub fn columns(&self) -> Vec<String> {
        Column::all(self).iter().map(Column::name).collect()
    }

    fn label<'a>(&'a self, name: &'a str) -> &'a str {
        self.labels.get(name).map_or(name, String::as_str)
    }
}

impl KindSpec for Aggregate {
    fn name() -> &'static str {
        "aggregate"
    }

    fn about() -> &'static str {
        "Aggregates of normalised scores over several environments, one row per agent."
    }

    fn example() -> &'static str {
        "{ value: return, normalise: { low: rule, high: learner }, agents: [learner, rule], environments: \
         [short, long] }"
    }
}

impl Table for Aggregate {
    fn check(
        &self,
        names: &mut Names<'_>,
        at: &Place<'_>,
        published: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>) {
        check::aggregate(self, names, at, published)
    }

    fn build(&self, results: &Results) -> Result<Grid, Error> {
        build(self, results)
    }

    fn better(&self, column: &str) -> Option<Direction> {
        Some(if column == Column::OptimalityGap.name() {
            Direction::Lower
        } else {
            Direction::Higher
        })
    }
}

/// Computes the aggregates.
///
/// # Errors
/// [`Error::Render`] if fewer than two environments have trials, or agents of several settings would be pooled.
fn build(spec: &Aggregate, results: &Results) -> Result<Grid, Error> {
    let all = Scope::of(results, &[], &spec.environments);
    let scope = Scope::of(results, &spec.agents, &spec.environments);
    let environments = scope.names(Axis::Environment, &spec.environments);
    if environments.len() < 2 {
        return Err(problem("an aggregate needs trials in at least two environments"));
    }
    if scope.varies(Axis::Setting) {
        return Err(problem("an aggregate pools no settings of a sweep"));
    }
    let suite = Suite::of(spec, &environments, &all);
    let (rows, left_out): (Vec<_>, Vec<_>) = scope
        .names(Axis::Agent, &spec.agents)
        .into_iter()
        .partition(|agent| suite.is_played_by(agent, &scope));
    let relative = spec.relative_to.as_ref().map(|agent| suite.scores(agent, &all));
    let columns = Column::all(spec);
    let cells = rows.iter().map(|agent| {
        let scores = suite.scores(agent, &scope);
        let cell = |column: &Column| {
            let behind = suite.trials_behind(agent, column, &all);
            let behind = Cell::resting_on(&behind, results);
            let is_looked_at = *column == Column::Mean && behind.looks.design.is_some();
            let as_of = match is_looked_at {
                true => suite.means_as_of(agent, &behind.looks.limits(), &all),
                false => BTreeMap::new(),
            };
            let behind = Cell { as_of, ..behind };
            suite.cell(agent, &scores, column, relative.as_ref(), behind)
        };
        columns.iter().map(cell).collect()
    });
    Ok(Grid {
        quantity: Quantity::plain(suite.quantity()),
        one_number: Reduction::Aggregates,
        row_axis: Axis::Agent.name().into(),
        cells: cells.collect(),
        rows: rows.iter().map(|agent| suite.heading(agent)).collect(),
        columns: columns.iter().map(|column| column.heading(spec)).collect(),
        format: NumberFormat::Fixed(spec.decimals.unwrap_or(3)),
        notes: suite.notes(&all, &left_out),
        ..Grid::default()
    })
}

/// Statistic in a column.
#[derive(Debug, Clone, PartialEq)]
enum Column {
    Iqm,
    Median,
    Mean,
    OptimalityGap,
    Improvement(String),
    Above(f64),
}

impl Column {
    fn all(spec: &Aggregate) -> Vec<Self> {
        let mut all = vec![Self::Iqm, Self::Median, Self::Mean, Self::OptimalityGap];
        all.extend(spec.relative_to.clone().map(Self::Improvement));
        all.extend(spec.profile_at.iter().copied().map(Self::Above));
        all
    }

    fn name(&self) -> String {
        match self {
            Self::Iqm => "iqm".into(),
            Self::Median => "median".into(),
            Self::Mean => SUITE_MEAN.into(),
            Self::OptimalityGap => "optimality_gap".into(),
            Self::Improvement(_) => "probability_of_improvement".into(),
            Self::Above(score) => format!("above_{score}"),
        }
    }

    fn heading(&self, spec: &Aggregate) -> Heading {
        let name = self.name();
        let plain = match self {
            Self::Iqm => "interquartile mean".into(),
            Self::Median | Self::Mean => name.clone(),
            Self::OptimalityGap => "optimality gap".into(),
            Self::Improvement(agent) => format!("better than {}", spec.label(agent)),
            Self::Above(score) => format!("above {score}"),
        };
        Heading::of(&name, spec.labels.get(&name).cloned().unwrap_or(plain))
    }

    /// The value of some scores `[environment][seed]`; `others` are the scores of the agent to improve on.
    fn of(&self, tasks: &[Vec<f64>], others: &[Vec<f64>]) -> f64 {
        match self {
            Self::Iqm => suite_iqm(tasks),
            Self::Median => suite_median(tasks),
            Self::Mean => suite_mean(tasks),
            Self::OptimalityGap => suite_optimality_gap(tasks, 1.0),
            Self::Improvement(_) => probability_of_improvement(tasks, others),
            Self::Above(score) => suite_share_above(tasks, *score),
        }
    }

    fn interval(&self, tasks: &[Vec<f64>], others: &[Vec<f64>]) -> Option<Interval> {
        match self {
            Self::Improvement(_) => probability_of_improvement_interval(tasks, others, Bootstrap::TABLE),
            _ => Bootstrap::TABLE.stratified(tasks, |tasks| self.of(tasks, others)),
        }
    }

    /// Whether agents at the ends of the scale have fixed values in this column, independent of their seeds.
    fn is_fixed_by_scale(&self) -> bool {
        matches!(self, Self::Median | Self::Mean)
    }
}

/// The scores of one agent in the environments of the suite.
struct Scores {
    /// Scores by seed, one map per environment in the order of the suite.
    by_environment: Vec<BTreeMap<u64, f64>>,
    planned: usize,
    failed: usize,
    missing: Vec<MissingSeeds>,
}

impl Scores {
    /// Seeds by environment; `None` if an environment has none.
    fn tasks(&self) -> Option<Vec<Vec<f64>>> {
        let tasks: Vec<Vec<f64>> = self
            .by_environment
            .iter()
            .map(|seeds| seeds.values().copied().collect())
            .collect();
        tasks.iter().all(|seeds| !seeds.is_empty()).then_some(tasks)
    }

    /// Each seed that has a score in every environment, with these scores `[environment][seed]`.
    fn complete_seeds(&self) -> Vec<(u64, Vec<Vec<f64>>)> {
        let of = |seed: &u64| {
            self.by_environment
                .iter()
                .map(|seeds| Some(vec![*seeds.get(seed)?]))
                .collect::<Option<_>>()
        };
        let seeds: BTreeSet<u64> = self
            .by_environment
            .iter()
            .flat_map(BTreeMap::keys)
            .copied()
            .collect();
        seeds
            .into_iter()
            .filter_map(|seed| Some((seed, of(&seed)?)))
            .collect()
    }
}

/// The value of each seed that has a score in every environment, from its scores alone.
fn seeds(scores: &Scores, column: &Column, others: &[Vec<f64>]) -> Vec<(u64, f64)> {
    let complete = scores.complete_seeds();
    let value = |(seed, tasks): &(u64, Vec<Vec<f64>>)| (*seed, column.of(tasks, others));
    complete.iter().map(value).collect()
}

struct Suite<'a> {
    spec: &'a Aggregate,
    scales: Vec<ScoreScale>,
}

impl<'s> Suite<'s> {
    /// The suite with the scales that some trials determine.
    fn of(spec: &'s Aggregate, environments: &[String], all: &Scope<'_>) -> Self {
        let scale = |name: &String| ScoreScale::of(&spec.normalise, &spec.value, name.clone(), all);
        Self {
            spec,
            scales: environments.iter().map(scale).collect(),
        }
    }

    /// The mean of each seed of an agent, by limit, computed from the seeds below the limit alone: later seeds of the
    /// agents that stand for 0 and 1 move the scale. Only means may be published.
    fn means_as_of(&self, agent: &str, limits: &[u64], all: &Scope<'_>) -> BTreeMap<u64, Vec<(u64, f64)>> {
        let environments: Vec<String> = self.scales.iter().map(|it| it.environment.clone()).collect();
        let at = |limit: &u64| {
            let all = all.until(*limit);
            let suite = Self::of(self.spec, &environments, &all);
            (*limit, seeds(&suite.scores(agent, &all), &Column::Mean, &[]))
        };
        limits.iter().map(at).collect()
    }

    fn is_played_by(&self, agent: &str, scope: &Scope<'_>) -> bool {
        let scope = scope.at(Axis::Agent, agent);
        self.scales
            .iter()
            .all(|scale| !scope.at(Axis::Environment, &scale.environment).trials.is_empty())
    }

    fn scores(&self, agent: &str, scope: &Scope<'_>) -> Scores {
        let scope = scope.at(Axis::Agent, agent);
        let mut scores = Scores {
            by_environment: Vec::new(),
            planned: scope.planned(),
            failed: scope.failed(),
            missing: Vec::new(),
        };
        for scale in &self.scales {
            let here = scope.at(Axis::Environment, &scale.environment);
            let label = self.spec.label(&scale.environment);
            scores
                .missing
                .extend(here.absences().into_iter().map(|absence| absence.within(label)));
            let raw = here.finals(&self.spec.value);
            let scaled: BTreeMap<u64, f64> = raw
                .iter()
                .filter_map(|(seed, value)| Some((*seed, scale.score(*value)?)))
                .collect();
            if scaled.len() < raw.len() {
                scores
                    .missing
                    .push(MissingSeeds::of(MissingReason::NoScale).within(label));
            }
            scores.by_environment.push(scaled);
        }
        scores
    }

    /// The trials that the value depends on: those of the agent, of the agents that stand for 0 and 1, and of the one
    /// to improve on.
    fn trials_behind<'r>(&self, agent: &str, column: &Column, all: &Scope<'r>) -> Vec<&'r TrialResult> {
        let mut agents: BTreeSet<&str> = self.spec.normalise.agents().into_iter().chain([agent]).collect();
        if let Column::Improvement(other) = column {
            agents.insert(other);
        }
        let in_suite = |trial: &&TrialResult| {
            self.scales
                .iter()
                .any(|scale| scale.environment == trial.trial.cell.environment)
        };
        let behind = all
            .trials
            .iter()
            .copied()
            .filter(|trial| agents.contains(trial.trial.cell.agent.as_str()));
        behind.filter(in_suite).collect()
    }

    fn cell(
        &self,
        agent: &str,
        scores: &Scores,
        column: &Column,
        relative: Option<&Scores>,
        behind: Cell,
    ) -> Cell {
        if matches!(column, Column::Improvement(other) if other == agent) {
            return Cell::default();
        }
        let cell = Cell {
            planned: scores.planned,
            failed: scores.failed,
            missing: scores.missing.clone(),
            ..behind
        };
        let others = match (column, relative) {
            (Column::Improvement(_), Some(relative)) => relative.tasks(),
            _ => Some(Vec::new()),
        };
        let (Some(tasks), Some(others)) = (scores.tasks(), others) else {
            return cell;
        };
        let seeds = seeds(scores, column, &others);
        let fixed = self
            .spec
            .fixed()
            .into_iter()
            .find(|(name, _)| column.is_fixed_by_scale() && *name == agent);
        if let Some((_, score)) = fixed {
            let fixed = Some(FixedReason::Scale);
            return Cell {
                seeds,
                estimate: Some(f64::from(score)),
                fixed,
                ..cell
            };
        }
        let interval = column
            .interval(&tasks, &others)
            .map(|interval| (interval.low, interval.high));
        Cell {
            seeds,
            estimate: Some(column.of(&tasks, &others)),
            interval,
            ..cell
        }
    }

    fn heading(&self, agent: &str) -> Heading {
        let label = self.spec.label(agent);
        let label = match self.spec.fixed().iter().find(|(name, _)| *name == agent) {
            Some((_, score)) => format!("{label} ({score} by construction)"),
            None => label.into(),
        };
        Heading::of(agent, label)
    }

    fn quantity(&self) -> String {
        let value = self
            .spec
            .labels
            .get(&self.spec.value)
            .cloned()
            .unwrap_or_else(|| self.spec.value.replace('_', " "));
        let ends = match &self.spec.normalise {
            Normalisation::Agents { low, high } => {
                format!(
                    "0 stands for the mean of {} and 1 for that of {}",
                    self.spec.label(low),
                    self.spec.label(high)
                )
            }
            Normalisation::ByEnvironment(_) => "scaled".into(),
        };
        format!("{value}, {ends} in each of {} environments", self.scales.len())
    }

    fn notes(&self, all: &Scope<'_>, left_out: &[String]) -> Vec<String> {
        let mut notes = vec![
            "Intervals draw the seeds of each environment anew (stratified bootstrap); what stands for 0 \
             and 1 is held fixed."
                .into(),
            ends_in_words(&self.scales, |name| self.spec.label(name).into()),
        ];
        if !self.spec.fixed().is_empty() {
            notes.push(
                "Rows that are 0 or 1 by construction show how far their seeds spread; nothing is \
                        tested on them."
                    .into(),
            );
        }
        for (agent, score) in self.spec.fixed() {
            if all
                .at(Axis::Agent, agent)
                .trials
                .iter()
                .any(|trial| !trial.is_ok())
            {
                let label = self.spec.label(agent);
                notes.push(format!(
                    "Trials of {label}, which stands for {score}, are missing: scores will move with them."
                ));
            }
        }
        for agent in left_out {
            notes.push(format!(
                "{} is left out: it has no trials in some of the environments.",
                self.spec.label(agent)
            ));
        }
        notes
    }
}

#[cfg(test)]
mod tests;
