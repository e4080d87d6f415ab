//! Comparisons: a metric of agents, environments and settings, side by side or relative to one agent.

mod along;
mod build;
mod check;
mod measure;
mod taken;
#[cfg(test)]
mod tests;

pub use build::compare;
pub(super) use build::summarise;

use super::{Grid, NumberFormat, Table};
use crate::{
    axis::{Axis, TableAxis},
    kinds::{Contradiction, KindSpec},
    names::{Names, Place},
};
use analysis::results::Results;
use contract::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use taken::{MeasurementChoice, StepMeasurement};

/// Rows, columns and the value of a comparison. Some options exclude each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Comparison {
    /// Axis of the rows: `agent`, `environment`, `setting`, or a swept key.
    pub rows: TableAxis,
    /// Axis of the columns; where absent, the first of agent, environment and setting that varies and is no row, or
    /// none.
    pub columns: Option<TableAxis>,
    /// The metric.
    pub value: String,
    /// How the seeds become one number.
    pub statistic: Statistic,
    /// Take the mean of the last so many measurements during learning (up to each of `at_steps`) in place of
    /// the final one.
    #[schemars(range(min = 1))]
    pub last: Option<u64>,
    /// Take the root of the mean square over the episodes of the final measurement in place of their mean, as for
    /// errors that are roots of mean squares themselves.
    pub root_mean_square: bool,
    /// Take the environment steps until the moving average of the measurements during learning is above this
    /// value.
    pub steps_until_above: Option<f64>,
    /// Make these environment steps the columns: what was measured there during learning, the final
    /// measurement of agents that do not learn. A column that no trial trains for is empty.
    pub at_steps: Vec<u64>,
    /// Weight of the past in the moving average of `steps_until_above`, 0.9 where absent, and of `at_steps`,
    /// 0 where absent.
    #[schemars(range(min = 0.0, max = 0.999))]
    pub smooth: Option<f64>,
    /// Take the seeds with success alone, where the study says what success is.
    pub given_success: bool,
    /// Print the environment steps and updates of each agent beside its name.
    pub budgets: bool,
    /// The agent that the others are compared with.
    pub relative_to: Option<String>,
    /// How the comparison is written.
    #[serde(rename = "as")]
    pub form: Option<Form>,
    /// Which agents, in this order; all where empty.
    pub agents: Vec<String>,
    /// Which environments, in this order; all where empty.
    pub environments: Vec<String>,
    /// Digits after the decimal point.
    #[schemars(range(max = 9))]
    pub decimals: Option<usize>,
    /// Digits of every number, which has a power of ten: for values of many sizes.
    #[schemars(range(min = 1, max = 10))]
    pub significant_digits: Option<usize>,
    /// Names to print instead of the study's own.
    pub labels: BTreeMap<String, String>,
}

impl Default for Comparison {
    fn default() -> Self {
        Self {
            rows: Axis::Agent.into(),
            columns: None,
            value: "return".into(),
            statistic: Statistic::Mean,
            last: None,
            root_mean_square: false,
            steps_until_above: None,
            at_steps: Vec::new(),
            smooth: None,
            given_success: false,
            budgets: false,
            relative_to: None,
            form: None,
            agents: Vec::new(),
            environments: Vec::new(),
            decimals: None,
            significant_digits: None,
            labels: BTreeMap::new(),
        }
    }
}

impl Comparison {
    /// The form of the values: the given one, or else a percentage if they are compared with an agent.
    #[must_use]
    pub fn resolved_form(&self) -> Form {
        self.form.unwrap_or(if self.relative_to.is_some() {
            Form::PercentChange
        } else {
            Form::Value
        })
    }

    /// The given format of numbers; `None` for a format that fits the values.
    fn format(&self) -> Option<NumberFormat> {
        let scientific = |digits: usize| NumberFormat::Scientific(digits.saturating_sub(1));
        self.decimals
            .map(NumberFormat::Fixed)
            .or_else(|| self.significant_digits.map(scientific))
    }
}

impl KindSpec for Comparison {
    fn name() -> &'static str {
        "comparison"
    }

    fn about() -> &'static str {
        "A metric of agents and environments side by side."
    }

    fn example() -> &'static str {
        "{ rows: agent, value: return, agents: [learner, rule], environments: [short] }"
    }

    fn contradiction(value: &Value) -> Option<Contradiction> {
        taken::contradiction(&Self::deserialize(value).ok()?)
    }
}

impl Table for Comparison {
    fn check(
        &self,
        names: &mut Names<'_>,
        at: &Place<'_>,
        _: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>) {
        check::comparison(self, names, at)
    }

    fn build(&self, results: &Results) -> Result<Grid, Error> {
        compare(self, results)
    }

    fn baselines(&self, results: &Results) -> Vec<String> {
        build::baselines(self, results)
    }

    fn metric_of_unit(&self) -> Option<&str> {
        let has_unit = self.steps_until_above.is_none()
            && matches!(self.resolved_form(), Form::Value | Form::Difference);
        has_unit.then_some(&self.value)
    }

    fn no_means(&self) -> Option<&'static str> {
        (self.statistic != Statistic::Mean).then(|| self.statistic.name())
    }

    fn shows_shares(&self) -> bool {
        build::is_share(self)
    }

    fn measurements_by_step(&self) -> Option<u64> {
        match self.taken() {
            MeasurementChoice::AtSteps { of, .. } if self.rows == Axis::Agent.into() => match of {
                StepMeasurement::Last(last) => Some(last),
                StepMeasurement::Average(_) => Some(1),
            },
            _ => None,
        }
    }
}

/// A comparison with one of the agents.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Improvement(pub Comparison);

impl KindSpec for Improvement {
    fn name() -> &'static str {
        "improvement"
    }

    fn about() -> &'static str {
        "How much better agents are than one of them (`relative_to`), as a percentage unless `as` says \
             otherwise."
    }

    fn example() -> &'static str {
        "{ rows: environment, value: return, relative_to: rule, agents: [learner, rule] }"
    }

    fn contradiction(value: &Value) -> Option<Contradiction> {
        Comparison::contradiction(value)
    }
}

impl Table for Improvement {
    fn check(
        &self,
        names: &mut Names<'_>,
        at: &Place<'_>,
        _: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>) {
        if self.0.relative_to.is_none() && !check::is_relative(&self.0) {
            check::without_reference(names, at);
        }
        check::comparison(&self.0, names, at)
    }

    fn build(&self, results: &Results) -> Result<Grid, Error> {
        compare(&self.0, results)
    }

    fn baselines(&self, results: &Results) -> Vec<String> {
        build::baselines(&self.0, results)
    }

    fn metric_of_unit(&self) -> Option<&str> {
        self.0.metric_of_unit()
    }

    fn no_means(&self) -> Option<&'static str> {
        self.0.no_means()
    }

    fn shows_shares(&self) -> bool {
        self.0.shows_shares()
    }
}

/// How the seeds become one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Statistic {
    /// Arithmetic mean.
    #[default]
    Mean,
    /// Median.
    Median,
    /// Interquartile mean.
    Iqm,
}

impl Statistic {
    /// The statistic's name as text.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Statistic::Mean => "mean",
            Statistic::Median => "median",
            Statistic::Iqm => "interquartile mean",
        }
    }
}

/// Form in which a comparison with `relative_to` is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// The value itself.
    Value,
    /// Value minus the other's value, seed by seed.
    Difference,
    /// Value over the other's value, seed by seed.
    Ratio,
    /// 100 (value - other) / |other|, seed by seed: a larger value is a positive change.
    PercentChange,
}
