//! Tables: what a study asks for, and how it is computed from the results.

mod aggregate;
mod build;
mod comma_separated;
mod cross_play;
mod grid;
mod html;
mod latex;
mod markdown;
pub(crate) mod prose;
mod published;
mod seeds;
mod terminal;
#[cfg(test)]
mod tests;

pub use aggregate::{Aggregate, Normalise, SUITE_MEAN};
pub use build::{build, compare};
pub use comma_separated::{csv, write as write_csv};
pub use cross_play::{CrossPlayTable, MEAN};
pub use grid::{Cell, Grid, Heading, NumberFormat, Part};
pub use html::{escape as escape_html, html, word as verdict_word};
pub use latex::latex;
pub use markdown::{escape as escape_markdown, markdown, row as markdown_row};
pub use published::{Margin, Published, PublishedCell, PublishedValue, StatedMargin};
pub use seeds::Scope;
pub use terminal::{terminal, wrap};

use crate::published_curve::PublishedCurve;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The kinds of tables, each a key of [`TableSpec`].
pub const KINDS: [&str; 4] = ["improvement", "comparison", "cross_play", "aggregate"];

/// One table of a study. Exactly one of the [`KINDS`] is given.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TableSpec {
    /// What the table shows, in one sentence.
    pub caption: String,
    /// How much better agents are than one of them (`relative_to`), as a percentage unless `as` says otherwise.
    pub improvement: Option<Comparison>,
    /// A metric of agents and environments side by side.
    pub comparison: Option<Comparison>,
    /// A metric of a play, by who plays one role along the rows and who another along the columns, with both means.
    pub cross_play: Option<CrossPlayTable>,
    /// Aggregates of normalised scores over several environments, one row per agent.
    pub aggregate: Option<Aggregate>,
    /// Published values by row, or by row and column.
    pub published: BTreeMap<String, Published>,
    /// Published curves. Each is compared with the row of its agent at every one of `at_steps`, over as many measurements up to there
    /// (`last`, 1 where absent) as ours; several runs count as an uncertain value.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub published_curves: Vec<PublishedCurve>,
    /// How far a reproduced value may lie from the published one: a number in the unit of the cell, or one of `absolute`, `percent`
    /// and `ratio` with a reason, `why`; 5 % of the published value if absent.
    pub margin: Option<Margin>,
    /// What was chosen with the published values in view; agreement with them then says nothing, and their verdict is CALIBRATED.
    pub calibrated_on: Option<String>,
    /// True where the comparison was thought of after results were seen; its verdicts are counted apart.
    pub exploratory: bool,
    /// Sentences under the table: departures, sources.
    pub notes: Vec<String>,
}

/// Rows, columns and the value of a comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Comparison {
    /// What the rows are.
    pub rows: Axis,
    /// What the columns are; where absent, the first of agent, environment and setting that varies and is no row, or none.
    pub columns: Option<Axis>,
    /// The metric.
    pub value: String,
    /// How the seeds become one number.
    pub statistic: Statistic,
    /// Take the mean of the last so many measurements during learning (up to each of `at_steps`) in place of the final one.
    #[schemars(range(min = 1))]
    pub last: Option<u64>,
    /// Take the environment steps until the moving average of the measurements during learning is above this value.
    pub steps_until_above: Option<f64>,
    /// Make these environment steps the columns: what was measured there during learning, the final measurement of agents that do
    /// not learn. A column that no trial trains for is empty.
    pub at_steps: Vec<u64>,
    /// Weight of the past in the moving average of `steps_until_above`, 0.9 where absent, and of `at_steps`, 0 where absent.
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
    /// Names to print instead of the study's own.
    pub labels: BTreeMap<String, String>,
}

impl Default for Comparison {
    fn default() -> Self {
        Self {
            rows: Axis::Agent,
            columns: None,
            value: "return".into(),
            statistic: Statistic::Mean,
            last: None,
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
            labels: BTreeMap::new(),
        }
    }
}

/// What varies along a table's rows or columns.
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
