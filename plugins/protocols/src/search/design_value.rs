//! The value by which designs are compared: the return, or a metric of the environment.

use super::candidates::Candidate;
use contract::{Better, Error, Metric, design::Observed};
use document::diagnostic::suggest;
use std::cmp::Ordering;

/// The value by which designs are ranked.
pub(super) enum DesignValue {
    /// The sum of the rewards.
    Return,
    /// A metric of the environment, by its position.
    Metric { at: usize, metric: Metric },
}

impl DesignValue {
    /// The metric with this name among the environment's; the return if no name is given.
    ///
    /// # Errors
    /// [`Error::Config`] for a metric that the environment does not have.
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

    /// Compares two designs; the greater one is better.
    pub(super) fn compare(&self, one: &Candidate, other: &Candidate) -> Ordering {
        let ascending = self.of(one).total_cmp(&self.of(other));
        match self {
            Self::Metric { metric, .. } if metric.better == Better::Lower => ascending.reverse(),
            _ => ascending,
        }
    }

    /// Metric and value of a chosen design, for readers of the choice; `None` if the return decided.
    pub(super) fn observed(&self, candidate: &Candidate) -> Option<Observed> {
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
