//! Normalised scores: a seed's value in one environment, scaled so that 0 and 1 stand for a floor and a
//! ceiling of that environment, as Agarwal et al. 2021, arXiv:2108.13264, pool runs of several environments.
//!
//! Floor and ceiling are numbers, or agents of the study whose means over seeds are used and held fixed.

mod check;

pub(crate) use check::{PoolWording, normalised, plays_everywhere};

use super::{Axis, NumberFormat, Scope};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::estimators::mean;
use std::collections::BTreeMap;

/// Meaning of the scores 0 and 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, deny_unknown_fields)]
pub enum Normalisation {
    /// Two agents, whose means in an environment become 0 and 1.
    Agents {
        /// The agent of score 0.
        low: String,
        /// The agent of score 1.
        high: String,
    },
    /// Floor and ceiling by environment, each a number or an agent.
    ByEnvironment(BTreeMap<String, [Bound; 2]>),
}

/// Meaning of one of the scores 0 and 1 in an environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Bound {
    /// A value of the metric.
    Number(f64),
    /// The mean of this agent.
    Agent(String),
}

impl Bound {
    fn agent(&self) -> Option<&str> {
        match self {
            Self::Number(_) => None,
            Self::Agent(name) => Some(name),
        }
    }
}

impl Normalisation {
    /// Agents that stand for 0 or for 1 in every environment, with that score.
    #[must_use]
    pub fn fixed(&self) -> Vec<(&str, u8)> {
        match self {
            Self::Agents { low, high } => vec![(low, 0), (high, 1)],
            Self::ByEnvironment(bounds) => [0, 1]
                .into_iter()
                .filter_map(|end: u8| Some((everywhere(bounds, usize::from(end))?, end)))
                .collect(),
        }
    }

    /// Agents that stand for 0 or 1 in any environment.
    #[must_use]
    pub fn agents(&self) -> Vec<&str> {
        match self {
            Self::Agents { low, high } => vec![low, high],
            Self::ByEnvironment(bounds) => bounds.values().flatten().filter_map(Bound::agent).collect(),
        }
    }

    fn bounds(&self, environment: &str) -> Option<[Bound; 2]> {
        match self {
            Self::Agents { low, high } => Some([low, high].map(|name| Bound::Agent(name.clone()))),
            Self::ByEnvironment(bounds) => bounds.get(environment).cloned(),
        }
    }
}

/// The only agent that is an end of every environment.
fn everywhere(bounds: &BTreeMap<String, [Bound; 2]>, end: usize) -> Option<&str> {
    let mut agents = bounds.values().map(|ends| ends[end].agent());
    let first = agents.next()??;
    agents.all(|agent| agent == Some(first)).then_some(first)
}

/// An environment with the values that its scores 0 and 1 stand for.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoreScale {
    /// Name of the environment.
    pub environment: String,
    /// Values of the scores 0 and 1; `None` if an agent that stands for one of them has no value.
    pub ends: Option<[f64; 2]>,
}

impl ScoreScale {
    /// The scale of an environment; `all` holds the trials of all agents.
    #[must_use]
    pub fn of(normalise: &Normalisation, metric: &str, environment: String, all: &Scope<'_>) -> Self {
        let value = |bound: &Bound| match bound {
            Bound::Number(number) => Some(*number),
            Bound::Agent(agent) => {
                let scope = all.at(Axis::Agent, agent).at(Axis::Environment, &environment);
                let values: Vec<f64> = scope.finals(metric).into_values().collect();
                (!values.is_empty()).then(|| mean(&values))
            }
        };
        let ends = normalise
            .bounds(&environment)
            .and_then(|[low, high]| Some([value(&low)?, value(&high)?]));
        Self { environment, ends }
    }

    /// The score of a value; `None` if the scale has no extent or no ends.
    #[must_use]
    pub fn score(&self, value: f64) -> Option<f64> {
        self.ends
            .filter(|[low, high]| low != high)
            .map(|[low, high]| (value - low) / (high - low))
    }
}

/// A sentence on the values of the scores 0 and 1 in each environment.
#[must_use]
pub fn ends_in_words(scales: &[ScoreScale], label: impl Fn(&str) -> String) -> String {
    let of = |scale: &ScoreScale| {
        let label = label(&scale.environment);
        let Some([low, high]) = scale.ends else {
            return format!("{label}: not known yet");
        };
        let format = NumberFormat::fitting([low, high].into_iter());
        format!("{label}: {} and {}", format.write(low), format.write(high))
    };
    format!(
        "The scores 0 and 1: {}.",
        scales.iter().map(of).collect::<Vec<_>>().join("; ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use testing::synthetic::study;

    fn read(value: serde_json::Value) -> Normalisation {
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn ends_are_agents_numbers_or_one_of_each() {
        let results = study();
        let all = Scope::of(&results, &[], &[]);
        let ends = |normalise: &Normalisation| {
            ScoreScale::of(normalise, "cycle_length", "four_cells".into(), &all)
                .ends
                .unwrap()
        };
        let agents = ends(&read(json!({"low": "equal", "high": "bound"})));
        let mixed = read(json!({"four_cells": ["equal", 20.0], "eight_cells": ["equal", "bound"]}));
        assert_eq!(ends(&mixed), [agents[0], 20.0]);
        assert_eq!(
            (mixed.fixed(), mixed.agents()),
            (vec![("equal", 0)], vec!["equal", "bound", "equal"])
        );
        let scale = ScoreScale::of(&mixed, "cycle_length", "four_cells".into(), &all);
        assert_eq!(
            (scale.score(agents[0]), scale.score(20.0)),
            (Some(0.0), Some(1.0))
        );
        let unknown = ScoreScale::of(&mixed, "cycle_length", "nine_cells".into(), &all);
        assert_eq!((unknown.ends, unknown.score(1.0)), (None, None));
    }
}
