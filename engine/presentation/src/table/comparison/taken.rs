//! The choice of measurements for a trial's number in a comparison, and the options that exclude each other.

use super::Comparison;
use crate::kinds::Contradiction;

/// Weight of the past in the moving average of `steps_until_above`, if a study gives none.
const WEIGHT_UNTIL_ABOVE: f64 = 0.9;
/// Weight of the past in the moving average of `at_steps`, if a study gives none.
const WEIGHT_AT_STEPS: f64 = 0.0;

/// Choice of the measurements that give a trial its number. Agents that do not learn have only a final measurement,
/// which is used instead.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) enum MeasurementChoice {
    /// The final measurement.
    #[default]
    Final,
    /// The root of the mean square over the episodes of the final measurement.
    RootMeanSquare,
    /// The mean of this many last measurements during learning.
    Last(u64),
    /// The environment steps until the moving average of the measurements during learning is above a level.
    StepsUntilAbove {
        /// The level, in the unit of the metric.
        level: f64,
        /// Weight of the past in the moving average.
        smooth: f64,
    },
    /// The measurements during learning at each of these environment steps, which become the columns.
    AtSteps {
        /// The steps, rising.
        steps: Vec<u64>,
        /// Choice among the measurements up to a step.
        of: StepMeasurement,
    },
}

/// Choice among the measurements up to a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum StepMeasurement {
    /// Their moving average with this weight of the past; the last one if the weight is 0.
    Average(f64),
    /// The mean of this many last measurements.
    Last(u64),
}

impl Comparison {
    /// The choice of measurements that the options state.
    pub(super) fn taken(&self) -> MeasurementChoice {
        let weight = |usual| self.smooth.unwrap_or(usual);
        match (self.steps_until_above, self.last) {
            _ if self.root_mean_square => MeasurementChoice::RootMeanSquare,
            (Some(level), _) => MeasurementChoice::StepsUntilAbove {
                level,
                smooth: weight(WEIGHT_UNTIL_ABOVE),
            },
            (None, last) if !self.at_steps.is_empty() => {
                let of = last.map_or(
                    StepMeasurement::Average(weight(WEIGHT_AT_STEPS)),
                    StepMeasurement::Last,
                );
                MeasurementChoice::AtSteps {
                    steps: self.at_steps.clone(),
                    of,
                }
            }
            (None, Some(last)) => MeasurementChoice::Last(last),
            (None, None) => MeasurementChoice::Final,
        }
    }
}

impl MeasurementChoice {
    /// The quantity that a metric becomes, as a phrase.
    pub(super) fn phrase(&self, value: &str) -> String {
        match self {
            MeasurementChoice::Final => value.into(),
            MeasurementChoice::RootMeanSquare => format!("{value}, root of the mean square over episodes"),
            MeasurementChoice::Last(last) => format!("{value}, mean of the last {last} measurements"),
            MeasurementChoice::StepsUntilAbove { level, smooth } => {
                format!(
                    "environment steps until the moving average (weight {smooth}) of {value} is above {level}"
                )
            }
            MeasurementChoice::AtSteps {
                of: StepMeasurement::Last(last),
                ..
            } => {
                format!(
                    "{value}, mean of the last {last} measurements until the environment steps of each column"
                )
            }
            MeasurementChoice::AtSteps {
                of: StepMeasurement::Average(smooth),
                ..
            } if *smooth == 0.0 => {
                format!("{value} after the environment steps of each column")
            }
            MeasurementChoice::AtSteps {
                of: StepMeasurement::Average(smooth),
                ..
            } => {
                format!(
                    "{value}, moving average (weight {smooth}) after the environment steps of each column"
                )
            }
        }
    }
}

/// An option that another one excludes; of several, the first to be removed.
pub(super) fn contradiction(of: &Comparison) -> Option<Contradiction> {
    let (over_steps, until) = (!of.at_steps.is_empty(), of.steps_until_above.is_some());
    let found = |key, message: String, help| {
        Some(Contradiction {
            at: vec![key],
            message,
            help,
        })
    };
    if of.smooth.is_some() && !until && !over_steps {
        return found(
            "smooth",
            "`smooth` has no effect without `steps_until_above` or `at_steps`".into(),
            "",
        );
    }
    let kinds = [
        ("at_steps", over_steps && until),
        ("smooth", over_steps && of.smooth.is_some() && !until),
        ("steps_until_above", until),
        ("last", of.last.is_some()),
        ("root_mean_square", of.root_mean_square),
    ];
    let given: Vec<&'static str> = kinds
        .into_iter()
        .filter(|(_, given)| *given)
        .map(|(kind, _)| kind)
        .collect();
    match given.as_slice() {
        _ if of.decimals.is_some() && of.significant_digits.is_some() => found(
            "significant_digits",
            "`significant_digits` and `decimals` are two ways to write a number".into(),
            "remove one of the two",
        ),
        [first, .., last] => found(
            last,
            format!("`{last}` and `{first}` are two different values"),
            "remove one of the two",
        ),
        _ if over_steps && of.columns.is_some() => found(
            "columns",
            "the steps of `at_steps` are the columns".into(),
            "remove one of the two",
        ),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(options: serde_json::Value) -> Comparison {
        serde_json::from_value(options).unwrap()
    }

    #[test]
    fn options_become_one_way_to_take_measurements() {
        let cases = [
            (json!({}), MeasurementChoice::Final),
            (json!({"last": 5}), MeasurementChoice::Last(5)),
            (
                json!({"root_mean_square": true}),
                MeasurementChoice::RootMeanSquare,
            ),
            (
                json!({"steps_until_above": 3.0}),
                MeasurementChoice::StepsUntilAbove {
                    level: 3.0,
                    smooth: 0.9,
                },
            ),
            (
                json!({"steps_until_above": 3.0, "smooth": 0.5}),
                MeasurementChoice::StepsUntilAbove {
                    level: 3.0,
                    smooth: 0.5,
                },
            ),
            (
                json!({"at_steps": [1, 2]}),
                MeasurementChoice::AtSteps {
                    steps: vec![1, 2],
                    of: StepMeasurement::Average(0.0),
                },
            ),
            (
                json!({"at_steps": [1], "smooth": 0.5}),
                MeasurementChoice::AtSteps {
                    steps: vec![1],
                    of: StepMeasurement::Average(0.5),
                },
            ),
            (
                json!({"at_steps": [1], "last": 2}),
                MeasurementChoice::AtSteps {
                    steps: vec![1],
                    of: StepMeasurement::Last(2),
                },
            ),
        ];
        for (options, taken) in cases {
            let comparison = read(options);
            assert_eq!(comparison.taken(), taken);
            assert_eq!(read(json!(comparison)), comparison);
        }
    }

    #[test]
    fn options_that_exclude_each_other_are_refused_with_both_names() {
        let message = |options| contradiction(&read(options)).unwrap().message;
        assert_eq!(
            message(json!({"last": 5, "steps_until_above": 3})),
            "`last` and `steps_until_above` are two different values"
        );
        assert_eq!(
            message(json!({"at_steps": [1], "smooth": 0.5, "last": 2})),
            "`last` and `smooth` are two different values"
        );
        assert_eq!(
            message(json!({"at_steps": [1], "steps_until_above": 2})),
            "`steps_until_above` and `at_steps` are two different values"
        );
        assert_eq!(
            message(json!({"last": 5, "root_mean_square": true})),
            "`root_mean_square` and `last` are two different values"
        );
        assert!(message(json!({"smooth": 0.5})).starts_with("`smooth` has no effect without"));
        assert_eq!(
            message(json!({"at_steps": [1], "columns": "agent"})),
            "the steps of `at_steps` are the columns"
        );
    }
}
