//! Comparisons: a metric of agents, environments and settings, side by side or relative to one agent.

mod along;
mod build;
mod check;
mod measure;
mod written;

pub use along::Along;
pub use build::compare;
pub(super) use build::summarise;

use super::{Grid, NumberFormat, Table};
use crate::{
    kinds::Contradiction,
    request::{Names, Place},
};
use analysis::results::Results;
use contract::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use written::Written;

/// The name of what no sweep varies, beside settings that one does.
const AS_GIVEN: &str = "as given";

/// Rows, columns and the value of a comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "Written", into = "Written")]
pub struct Comparison {
    /// What the rows are.
    pub rows: Along,
    /// What the columns are; where absent, the first of agent, environment and setting that varies and is no
    /// row, or none. Has no effect where the columns are steps.
    pub columns: Option<Along>,
    /// The metric.
    pub value: String,
    /// Which measurements of a trial become its number.
    pub taken: Taken,
    /// How the seeds become one number.
    pub statistic: Statistic,
    /// Take the seeds with success alone.
    pub given_success: bool,
    /// Print the environment steps and updates of each agent beside its name.
    pub budgets: bool,
    /// The agent that the others are compared with.
    pub relative_to: Option<String>,
    /// How the comparison is written.
    pub form: Option<Form>,
    /// Which agents, in this order; all where empty.
    pub agents: Vec<String>,
    /// Which environments, in this order; all where empty.
    pub environments: Vec<String>,
    /// How numbers are written; as they need where absent.
    pub format: Option<NumberFormat>,
    /// Names to print instead of the study's own.
    pub labels: BTreeMap<String, String>,
}

/// Which measurements of a trial become its number. Agents that do not learn have a final measurement alone,
/// which is taken.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Taken {
    /// The final measurement.
    #[default]
    Final,
    /// The root of the mean square over the episodes of the final measurement.
    RootMeanSquare,
    /// The mean of the last so many measurements during learning.
    Last(u64),
    /// The environment steps until the moving average of the measurements during learning is above a level.
    StepsUntilAbove {
        /// The level, in the unit of the metric.
        level: f64,
        /// Weight of the past in the moving average.
        smooth: f64,
    },
    /// What was measured during learning at each of these environment steps, which become the columns.
    AtSteps {
        /// The steps, rising.
        steps: Vec<u64>,
        /// Which measurements up to a step.
        of: AtStep,
    },
}

/// Which measurements up to a step become a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AtStep {
    /// Their moving average with this weight of the past; the last one where it is 0.
    Average(f64),
    /// The mean of the last so many.
    Last(u64),
}

impl Default for Comparison {
    fn default() -> Self {
        Self {
            rows: Axis::Agent.into(),
            columns: None,
            value: "return".into(),
            taken: Taken::Final,
            statistic: Statistic::Mean,
            given_success: false,
            budgets: false,
            relative_to: None,
            form: None,
            agents: Vec::new(),
            environments: Vec::new(),
            format: None,
            labels: BTreeMap::new(),
        }
    }
}

impl Comparison {
    /// How values are written: as given, else as a percentage where they are compared with an agent.
    #[must_use]
    pub fn resolved_form(&self) -> Form {
        self.form.unwrap_or(if self.relative_to.is_some() {
            Form::PercentChange
        } else {
            Form::Value
        })
    }

    /// The steps that are the columns; none where the columns are something else.
    #[must_use]
    pub fn steps(&self) -> &[u64] {
        if let Taken::AtSteps { steps, .. } = &self.taken {
            steps
        } else {
            &[]
        }
    }
}

impl Table for Comparison {
    fn example() -> &'static str {
        "{ rows: agent, value: return, agents: [learner, rule], environments: [short] }"
    }

    fn contradiction(value: &Value) -> Option<Contradiction> {
        Written::deserialize(value).ok()?.contradiction()
    }

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
        let counts_steps = matches!(self.taken, Taken::StepsUntilAbove { .. });
        let has_unit = !counts_steps && matches!(self.resolved_form(), Form::Value | Form::Difference);
        has_unit.then_some(&self.value)
    }

    fn no_means(&self) -> Option<&'static str> {
        (self.statistic != Statistic::Mean).then(|| self.statistic.name())
    }

    fn shows_shares(&self) -> bool {
        build::is_share(self)
    }

    fn measurements_by_step(&self) -> Option<u64> {
        match &self.taken {
            Taken::AtSteps { of, .. } if self.rows == Axis::Agent.into() => match of {
                AtStep::Last(last) => Some(*last),
                AtStep::Average(_) => Some(1),
            },
            _ => None,
        }
    }
}

/// A comparison with one of the agents.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Improvement(pub Comparison);

impl Table for Improvement {
    fn example() -> &'static str {
        "{ rows: environment, value: return, relative_to: rule, agents: [learner, rule] }"
    }

    fn contradiction(value: &Value) -> Option<Contradiction> {
        Comparison::contradiction(value)
    }

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

/// What trials differ by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// The study's agents.
    Agent,
    /// The study's environments.
    Environment,
    /// The points of the sweep.
    Setting,
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
    /// The statistic's name in words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Statistic::Mean => "mean",
            Statistic::Median => "median",
            Statistic::Iqm => "interquartile mean",
        }
    }
}

/// How a comparison with `relative_to` is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// The value itself.
    Value,
    /// Value minus the other's value, seed by seed.
    Difference,
    /// Value over the other's value, seed by seed.
    Ratio,
    /// 100 (value / other - 1), seed by seed.
    PercentChange,
}
