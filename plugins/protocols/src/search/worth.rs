//! What makes one design better than another: its return, or a metric of its environment.

use super::candidates::Candidate;
use contract::{Better, Error, Metric, design::Observed};
use document::diagnostic::suggest;
use std::cmp::Ordering;

/// What designs are ranked by.
pub(super) enum Worth {
    /// The sum of what was earned.
    Return,
    /// A metric of the environment, by its number.
    Metric { at: usize, metric: Metric },
}

impl Worth {
    /// The metric of this name among the environment's; the return where none is named.
    ///
    /// # Errors
    /// [`Error::Config`] for a name that the environment does not have.
    pub(super) fn named(by: Option<&str>, metrics: &[Metric]) -> Result<Self, Error> {
        let Some(by) = by else {
            return Ok(Self::Return);
        };
        let found = metrics.iter().position(|metric| metric.name == by);
        found
            .map(|at| Self::Metric {
                at,
                metric: metrics[at].clone(),
            })
            .ok_or_else(|| Error::config("by", unknown(by, metrics)))
    }

    /// How two designs compare; the greater one is the better one.
    pub(super) fn compare(&self, one: &Candidate, other: &Candidate) -> Ordering {
        let ascending = self.of(one).total_cmp(&self.of(other));
        match self {
            Self::Metric { metric, .. } if metric.better == Better::Lower => ascending.reverse(),
            _ => ascending,
        }
    }

    /// What others are told that a design was chosen by; nothing where that is the return.
    pub(super) fn told(&self, candidate: &Candidate) -> Option<Observed> {
        match self {
            Self::Return => None,
            Self::Metric { metric, .. } => Some(Observed {
                metric: metric.name.clone(),
                value: self.of(candidate),
            }),
        }
    }

    fn of(&self, candidate: &Candidate) -> f64 {
        match self {
            Self::Return => candidate.observed_return,
            Self::Metric { at, .. } => candidate.metrics[*at],
        }
    }
}

fn unknown(by: &str, metrics: &[Metric]) -> String {
    let advice = suggest(by, metrics.iter().map(|metric| metric.name.as_str()));
    format!("the environment has no metric `{by}` ({advice}); without this key the return decides")
}
