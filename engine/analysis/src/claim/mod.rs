//! Claims: sentences about a study's agents that its seeds support, refute or leave open.
//!
//! ```text
//! claim       = quantity relation quantity [ "in" ENVIRONMENT ]
//!             | quantity "in" ENVIRONMENT relation quantity "in" ENVIRONMENT
//! quantity    = NUMBER | operand | NUMBER "*" operand | operand "*" NUMBER
//! operand     = agent "." METRIC | aggregate "(" agent "." METRIC ")" | PLAY "." ROLE "." AGENT "." METRIC
//! agent       = AGENT [ "[" KEY "=" VALUE { "," KEY "=" VALUE } "]" ]
//! aggregate   = "final" | "auc" | "max" | "min" | "given_success" | "rms"
//! relation    = ">" | ">=" | "<" | "<=" | "~" | "within" NUMBER [ "%" ] "of"
//! ```
//!
//! `dsac.cycle_length >= 1.15 * equal.cycle_length in four_cells` compares the final measurements; `~` is `within 5 %
//! of`; `auc` is the mean of the learning curve, `max` and `min` its largest and smallest point; `given_success` is the
//! final measurement of only the seeds with success, if the study defines success. `AGENT.success` is their share.
//! Names are made of letters, digits, `_` and `-`; a name does not start with `-`. `pursuit.prey.tdom_ac.score` is the
//! mean score of the play `pursuit` over all trained opponents with `tdom_ac` as the prey. `dsac[discount=0.9].return`
//! is that of the trials with this value of a swept key (a value with quotes or brackets is JSON: `dsac[kind="a,
//! b"].return`); an agent with several settings that the claim does not distinguish is compared setting by setting.
//! `dsac.return in worn > 0.9 * dsac.return in new` compares two environments, seed by seed.

mod evaluate;
pub mod forms;
mod parse;

pub use evaluate::{ClaimOutcome, ClaimVerdict, NumberOrigin, evaluate};
pub use parse::{is_name_character, parse};

use contract::{
    recorder::Phase,
    sweep_point::{SweepPoint, as_word, word},
    trial_result::TrialResult,
};
use serde::{Deserialize, Serialize};
use statistics::estimators::mean;
use std::fmt;

/// Reason why a claim cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message} (at byte {position})")]
pub struct ClaimError {
    /// Position in the text, in bytes from its start; always at the boundary of a character, and at most the text's
    /// length.
    pub position: usize,
    /// The mistake, and what to write instead.
    pub message: String,
}

/// Reduction of the measurements of one trial to one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aggregate {
    /// Mean of the final measurement.
    #[default]
    Final,
    /// Mean over the points of the learning curve (the area under it, per point).
    Auc,
    /// The largest point of the learning curve.
    Max,
    /// The smallest point of the learning curve.
    Min,
    /// Mean of the final measurement, of seeds with success only.
    GivenSuccess,
    /// Root of the mean square over the episodes of the final measurement.
    Rms,
}

impl Aggregate {
    /// All aggregates, in the order of the documentation.
    pub const ALL: [Aggregate; 6] = [
        Aggregate::Final,
        Aggregate::Auc,
        Aggregate::Max,
        Aggregate::Min,
        Aggregate::GivenSuccess,
        Aggregate::Rms,
    ];

    /// Name of the aggregate in a claim.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Aggregate::Final => "final",
            Aggregate::Auc => "auc",
            Aggregate::Max => "max",
            Aggregate::Min => "min",
            Aggregate::GivenSuccess => "given_success",
            Aggregate::Rms => "rms",
        }
    }

    /// Meaning of the aggregate, in a sentence.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            Aggregate::Final => "Mean of the final measurement; a metric alone stands for it.",
            Aggregate::Auc => "Mean over the points of the learning curve (the area under it, per point).",
            Aggregate::Max => "The largest point of the learning curve.",
            Aggregate::Min => "The smallest point of the learning curve.",
            Aggregate::GivenSuccess => "Mean of the final measurement, of the seeds with success alone.",
            Aggregate::Rms => "Root of the mean square over the episodes of the final measurement.",
        }
    }

    /// The number of one trial, from its final measurement or from its learning curve; `None` if there is no row of the
    /// metric.
    #[must_use]
    pub fn of_trial(self, trial: &TrialResult, metric: &str) -> Option<f64> {
        let points: Vec<f64> = trial
            .while_learning(metric)
            .into_iter()
            .map(|(_, value)| value)
            .collect();
        match self {
            Aggregate::Final => trial.mean(Phase::Final, metric),
            Aggregate::Auc => (!points.is_empty()).then(|| mean(&points)),
            Aggregate::Max => points.into_iter().reduce(f64::max),
            Aggregate::Min => points.into_iter().reduce(f64::min),
            Aggregate::GivenSuccess => trial
                .mean(Phase::Final, metric)
                .filter(|_| trial.succeeded() == Some(true)),
            Aggregate::Rms => trial.root_mean_square(Phase::Final, metric),
        }
    }
}

/// One agent's metric, one number per seed.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Operand {
    /// Reduction of a trial's measurements to one number.
    pub aggregate: Aggregate,
    /// The role of a play in which the agent was measured; `None` if it was measured in its own trial.
    pub within: Option<Within>,
    /// The agent's name in the study.
    pub agent: String,
    /// Values of swept keys that its trials have, as words or JSON; empty if any will do.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub setting: Vec<(String, String)>,
    /// Name of the metric.
    pub metric: String,
    /// Environment in which it was measured, if the two sides of the claim differ in it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub environment: Option<String>,
}

/// A role of a play.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Within {
    /// The play's name in the study.
    pub play: String,
    /// Name of the role.
    pub role: String,
}

impl Operand {
    /// The names joined with dots, as written.
    #[must_use]
    pub fn path(&self) -> String {
        let within = self
            .within
            .as_ref()
            .map_or_else(String::new, |Within { play, role }| format!("{play}.{role}."));
        let values: Vec<String> = self
            .setting
            .iter()
            .map(|(key, value)| format!("{key}={value}"))
            .collect();
        let setting = if values.is_empty() {
            String::new()
        } else {
            format!("[{}]", values.join(", "))
        };
        format!("{within}{}{setting}.{}", self.agent, self.metric)
    }

    /// Whether a trial has the operand's values of swept keys.
    #[must_use]
    pub fn is_at(&self, point: &SweepPoint) -> bool {
        let is_there = |(key, value): &(String, String)| point.get(key).map(word) == Some(as_word(value));
        self.setting.iter().all(is_there)
    }
}

impl fmt::Display for Operand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.aggregate {
            Aggregate::Final => write!(f, "{}", self.path()),
            aggregate => write!(f, "{}({})", aggregate.name(), self.path()),
        }
    }
}

/// One side of a claim.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// A number that does not depend on seeds.
    Number(f64),
    /// A factor times an agent's metric.
    Measured {
        /// The factor; 1 if none is written.
        factor: f64,
        /// The agent's metric.
        operand: Operand,
    },
}

impl Quantity {
    fn operand(&self) -> Option<&Operand> {
        match self {
            Quantity::Number(_) => None,
            Quantity::Measured { operand, .. } => Some(operand),
        }
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Quantity::Number(number) => write!(f, "{number}"),
            Quantity::Measured { factor, operand } => {
                // The metric `5` of the agent `1` would read as a number.
                let alone = *factor == 1.0 && operand.to_string().parse::<f64>().is_err();
                if !alone {
                    write!(f, "{factor} * ")?;
                }
                write!(f, "{operand}")?;
                let environment = operand.environment.iter();
                environment
                    .into_iter()
                    .try_for_each(|environment| write!(f, " in {environment}"))
            }
        }
    }
}

/// The relation of a claim's left and right side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Relation {
    /// `>`
    Greater,
    /// `>=`
    GreaterOrEqual,
    /// `<`
    Less,
    /// `<=`
    LessOrEqual,
    /// `within N % of` the size of the right side's mean, or `~` for 5 %.
    WithinPercent(f64),
    /// `within N of` the right side, in its unit.
    Within(f64),
}

impl Relation {
    /// Whether one side is claimed to be ahead.
    #[must_use]
    pub fn is_direction(self) -> bool {
        !matches!(self, Relation::Within(_) | Relation::WithinPercent(_))
    }
}

impl fmt::Display for Relation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Relation::Greater => f.write_str(">"),
            Relation::GreaterOrEqual => f.write_str(">="),
            Relation::Less => f.write_str("<"),
            Relation::LessOrEqual => f.write_str("<="),
            Relation::WithinPercent(percent) => write!(f, "within {percent} % of"),
            Relation::Within(distance) => write!(f, "within {distance} of"),
        }
    }
}

/// A claim that has been read. Its display is the claim in a canonical form that reads back to the same
/// claim.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// Left side.
    pub left: Quantity,
    /// Relation of the two sides.
    pub relation: Relation,
    /// Right side.
    pub right: Quantity,
    /// The only environment that it is about; all of the study, one by one, if absent.
    pub environment: Option<String>,
}

impl Claim {
    /// The environments of its two sides, if they differ.
    #[must_use]
    pub fn environments_of_sides(&self) -> Option<[&str; 2]> {
        let [left, right] = [&self.left, &self.right].map(|side| side.operand()?.environment.as_deref());
        Some([left?, right?])
    }

    /// The agents' metrics that it compares: one or two.
    #[must_use]
    pub fn operands(&self) -> Vec<&Operand> {
        [&self.left, &self.right]
            .into_iter()
            .filter_map(Quantity::operand)
            .collect()
    }
}

impl fmt::Display for Claim {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {}", self.left, self.relation, self.right)?;
        self.environment
            .iter()
            .try_for_each(|environment| write!(f, " in {environment}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::{
        cast::Actors,
        part::Part,
        recorder::Row,
        trial::{Trial, TrialCell, TrialKey},
    };

    fn trial(rows: &[(Phase, u64, f64)]) -> TrialResult {
        let part = || Part::new("x", 1, serde_json::Value::Null);
        let (environment, agent, protocol) = (part(), part(), part());
        let agent = Actors::Agent(agent);
        let key = TrialKey {
            environment: environment.into(),
            agent: agent.into(),
            protocol: protocol.into(),
            seed: 0,
            numerics: 1,
        };
        let trial = Trial {
            id: key.id(),
            cell: TrialCell::of("e", "a").into(),
            key,
        };
        let row = |&(phase, step, value): &(Phase, u64, f64)| Row {
            phase,
            step,
            episode: 0,
            seat: 0,
            metric: 0,
            value,
        };
        TrialResult {
            trial: trial.into(),
            end: None,
            names: vec!["return".into()].into(),
            rows: rows.iter().map(row).collect(),
        }
    }

    #[test]
    fn one_number_per_trial() {
        use Phase::{Evaluate, Final, Train};
        // Two episodes at step 10 are one point of the curve, at 3.
        let rows = [
            (Evaluate, 0, 1.0),
            (Evaluate, 10, 2.0),
            (Evaluate, 10, 4.0),
            (Evaluate, 20, 2.0),
            (Train, 5, 99.0),
        ];
        let trial = trial(&[&rows[..], &[(Final, 20, 7.0), (Final, 20, 8.0)]].concat());
        let numbers = Aggregate::ALL.map(|aggregate| aggregate.of_trial(&trial, "return"));
        let rms = Some(f64::sqrt((49.0 + 64.0) / 2.0));
        assert_eq!(numbers, [Some(7.5), Some(2.0), Some(3.0), Some(1.0), None, rms]);
        assert_eq!(
            Aggregate::ALL.map(|aggregate| aggregate.of_trial(&trial, "cost")),
            [None; 6]
        );
    }
}
