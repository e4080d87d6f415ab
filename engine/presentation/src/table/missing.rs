//! Reasons why seeds have no number.

use contract::trial_end::EndState;
use std::fmt;

/// Seeds without a number, with the reason.
#[derive(Debug, Clone, PartialEq)]
pub struct MissingSeeds {
    /// The environment, if a cell covers several.
    pub within: Option<String>,
    /// Reason, common to all of these seeds.
    pub why: MissingReason,
}

/// Reason why seeds have no number.
#[derive(Debug, Clone, PartialEq)]
pub enum MissingReason {
    /// This many trials have not run.
    NotRun(usize),
    /// This many trials ended in this state.
    Ended(usize, EndState),
    /// The moving average of a seed was never above the level.
    NeverAbove {
        /// Seed of the trial.
        seed: u64,
        /// Level that the study sets, in the unit of the metric.
        level: f64,
    },
    /// A seed was not measured until the step.
    NotMeasured {
        /// Seed of the trial.
        seed: u64,
        /// Environment step of the column.
        until: u64,
    },
    /// A seed has no final measurement of the metric.
    NotRecorded {
        /// Seed of the trial.
        seed: u64,
        /// Metric of the table.
        metric: String,
        /// Whether it was recorded during learning, from where `last` takes its values.
        while_learning: bool,
    },
    /// The agent that a seed is compared with has no trial with this seed.
    NoCounterpart {
        /// Seed of the trial.
        seed: u64,
        /// Agent of the comparison.
        agent: String,
    },
    /// The other agent's trial has no result.
    CounterpartFailed {
        /// Seed of the trial.
        seed: u64,
        /// Agent of the comparison.
        agent: String,
    },
    /// The other agent's value is zero.
    DivisionByZero {
        /// Seed of the trial.
        seed: u64,
        /// Agent of the comparison.
        agent: String,
        /// Metric of the table.
        metric: String,
    },
    /// All cells have the same mean, so the scale has no extent.
    AllAlike,
    /// The ends of the scale are equal or unknown.
    NoScale,
}

impl MissingSeeds {
    /// Seeds of the cell's only environment, or of all its environments.
    #[must_use]
    pub fn of(why: MissingReason) -> Self {
        Self { within: None, why }
    }

    /// The same for one environment.
    #[must_use]
    pub fn within(self, environment: &str) -> Self {
        Self {
            within: Some(environment.into()),
            ..self
        }
    }

    /// Whether the trials have not run.
    #[must_use]
    pub fn is_not_run(&self) -> bool {
        matches!(self.why, MissingReason::NotRun(_))
    }
}

impl fmt::Display for MissingSeeds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(environment) = &self.within {
            write!(f, "{environment}: ")?;
        }
        self.why.fmt(f)
    }
}

impl fmt::Display for MissingReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotRun(count) => write!(f, "{count} not run"),
            Self::Ended(count, EndState::Failed) => write!(f, "{count} failed"),
            Self::Ended(count, state) => write!(f, "{count} failed: {}", state.name()),
            Self::NeverAbove { seed, level } => write!(f, "seed {seed}: never above {level}"),
            Self::NotMeasured { seed, until } => write!(f, "seed {seed}: not measured until {until}"),
            Self::NotRecorded {
                seed,
                metric,
                while_learning: false,
            } => write!(f, "seed {seed}: no `{metric}` recorded"),
            Self::NotRecorded { seed, metric, .. } => write!(
                f,
                "seed {seed}: `{metric}` was recorded while learning and not at the end, so that `last: 1` has it"
            ),
            Self::NoCounterpart { seed, agent } => {
                write!(f, "seed {seed}: no trial of `{agent}` to compare with")
            }
            Self::CounterpartFailed { seed, agent } => write!(f, "seed {seed}: `{agent}` has no result"),
            Self::DivisionByZero { seed, agent, metric } => {
                write!(f, "seed {seed}: `{metric}` of `{agent}` is zero")
            }
            Self::AllAlike => f.write_str("no two cells differ, so nothing can be normalised"),
            Self::NoScale => f.write_str("nothing tells the scores 0 and 1 apart"),
        }
    }
}
