//! A comparison as studies write it: one flat mapping, in which some options exclude each other.

use super::{Along, AtStep, Comparison, Form, Statistic, Taken};
use crate::{kinds::Contradiction, table::NumberFormat};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Weight of the past in the moving average of `steps_until_above`, where a study gives none.
const WEIGHT_UNTIL_ABOVE: f64 = 0.9;
/// Weight of the past in the moving average of `at_steps`, where a study gives none.
const WEIGHT_AT_STEPS: f64 = 0.0;

/// Rows, columns and the value of a comparison.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Written {
    /// What the rows are: `agent`, `environment`, `setting`, or a swept key.
    rows: Along,
    /// What the columns are; where absent, the first of agent, environment and setting that varies and is no
    /// row, or none.
    columns: Option<Along>,
    /// The metric.
    value: String,
    /// How the seeds become one number.
    statistic: Statistic,
    /// Take the mean of the last so many measurements during learning (up to each of `at_steps`) in place of
    /// the final one.
    #[schemars(range(min = 1))]
    last: Option<u64>,
    /// Take the root of the mean square over the episodes of the final measurement in place of their mean, as for
    /// errors that are roots of mean squares themselves.
    root_mean_square: bool,
    /// Take the environment steps until the moving average of the measurements during learning is above this
    /// value.
    steps_until_above: Option<f64>,
    /// Make these environment steps the columns: what was measured there during learning, the final
    /// measurement of agents that do not learn. A column that no trial trains for is empty.
    at_steps: Vec<u64>,
    /// Weight of the past in the moving average of `steps_until_above`, 0.9 where absent, and of `at_steps`,
    /// 0 where absent.
    #[schemars(range(min = 0.0, max = 0.999))]
    smooth: Option<f64>,
    /// Take the seeds with success alone, where the study says what success is.
    given_success: bool,
    /// Print the environment steps and updates of each agent beside its name.
    budgets: bool,
    /// The agent that the others are compared with.
    relative_to: Option<String>,
    /// How the comparison is written.
    #[serde(rename = "as")]
    form: Option<Form>,
    /// Which agents, in this order; all where empty.
    agents: Vec<String>,
    /// Which environments, in this order; all where empty.
    environments: Vec<String>,
    /// Digits after the decimal point.
    #[schemars(range(max = 9))]
    decimals: Option<usize>,
    /// Digits of every number, which has a power of ten: for values of many sizes.
    #[schemars(range(min = 1, max = 10))]
    significant_digits: Option<usize>,
    /// Names to print instead of the study's own.
    labels: BTreeMap<String, String>,
}

impl Written {
    /// An option that another one excludes, as the first to be removed.
    pub(super) fn contradiction(&self) -> Option<Contradiction> {
        let (over_steps, until) = (!self.at_steps.is_empty(), self.steps_until_above.is_some());
        let found = |key, message: String, help| {
            Some(Contradiction {
                at: vec![key],
                message,
                help,
            })
        };
        if self.smooth.is_some() && !until && !over_steps {
            return found(
                "smooth",
                "`smooth` has no effect without `steps_until_above` or `at_steps`".into(),
                "",
            );
        }
        let kinds = [
            ("at_steps", over_steps && until),
            ("smooth", over_steps && self.smooth.is_some() && !until),
            ("steps_until_above", until),
            ("last", self.last.is_some()),
            ("root_mean_square", self.root_mean_square),
        ];
        let given: Vec<&'static str> = kinds
            .into_iter()
            .filter(|(_, given)| *given)
            .map(|(kind, _)| kind)
            .collect();
        match given.as_slice() {
            _ if self.decimals.is_some() && self.significant_digits.is_some() => found(
                "significant_digits",
                "`significant_digits` and `decimals` are two ways to write a number".into(),
                "remove one of the two",
            ),
            [first, .., last] => found(
                last,
                format!("`{last}` and `{first}` are two different values"),
                "remove one of the two",
            ),
            _ if over_steps && self.columns.is_some() => found(
                "columns",
                "the steps of `at_steps` are the columns".into(),
                "remove one of the two",
            ),
            _ => None,
        }
    }

    fn taken(&self) -> Taken {
        let weight = |usual| self.smooth.unwrap_or(usual);
        match (self.steps_until_above, self.last) {
            _ if self.root_mean_square => Taken::RootMeanSquare,
            (Some(level), _) => Taken::StepsUntilAbove {
                level,
                smooth: weight(WEIGHT_UNTIL_ABOVE),
            },
            (None, last) if !self.at_steps.is_empty() => {
                let of = last.map_or(AtStep::Average(weight(WEIGHT_AT_STEPS)), AtStep::Last);
                Taken::AtSteps {
                    steps: self.at_steps.clone(),
                    of,
                }
            }
            (None, Some(last)) => Taken::Last(last),
            (None, None) => Taken::Final,
        }
    }

    /// The same with the options of one of the ways in which measurements are taken. A usual weight is left
    /// out.
    fn taking(self, taken: Taken) -> Self {
        let weight = |smooth: f64, usual: f64| Some(smooth).filter(|smooth| *smooth != usual);
        match taken {
            Taken::Final => self,
            Taken::RootMeanSquare => Self {
                root_mean_square: true,
                ..self
            },
            Taken::Last(last) => Self {
                last: Some(last),
                ..self
            },
            Taken::StepsUntilAbove { level, smooth } => Self {
                steps_until_above: Some(level),
                smooth: weight(smooth, WEIGHT_UNTIL_ABOVE),
                ..self
            },
            Taken::AtSteps {
                steps,
                of: AtStep::Last(last),
            } => Self {
                at_steps: steps,
                last: Some(last),
                ..self
            },
            Taken::AtSteps {
                steps,
                of: AtStep::Average(smooth),
            } => Self {
                at_steps: steps,
                smooth: weight(smooth, WEIGHT_AT_STEPS),
                ..self
            },
        }
    }
}

impl Default for Written {
    fn default() -> Self {
        Comparison::default().into()
    }
}

impl TryFrom<Written> for Comparison {
    type Error = Contradiction;

    fn try_from(written: Written) -> Result<Self, Contradiction> {
        if let Some(contradiction) = written.contradiction() {
            return Err(contradiction);
        }
        Ok(Self {
            taken: written.taken(),
            rows: written.rows,
            columns: written.columns,
            value: written.value,
            statistic: written.statistic,
            given_success: written.given_success,
            budgets: written.budgets,
            relative_to: written.relative_to,
            form: written.form,
            agents: written.agents,
            environments: written.environments,
            format: match (written.decimals, written.significant_digits) {
                (Some(decimals), _) => Some(NumberFormat::Fixed(decimals)),
                (None, digits) => digits.map(|digits| NumberFormat::Scientific(digits.saturating_sub(1))),
            },
            labels: written.labels,
        })
    }
}

impl From<Comparison> for Written {
    fn from(comparison: Comparison) -> Self {
        let plain = Self {
            rows: comparison.rows,
            columns: comparison.columns,
            value: comparison.value,
            statistic: comparison.statistic,
            last: None,
            root_mean_square: false,
            steps_until_above: None,
            at_steps: Vec::new(),
            smooth: None,
            given_success: comparison.given_success,
            budgets: comparison.budgets,
            relative_to: comparison.relative_to,
            form: comparison.form,
            agents: comparison.agents,
            environments: comparison.environments,
            decimals: match comparison.format {
                Some(NumberFormat::Fixed(decimals)) => Some(decimals),
                _ => None,
            },
            significant_digits: match comparison.format {
                Some(NumberFormat::Scientific(decimals)) => Some(decimals + 1),
                _ => None,
            },
            labels: comparison.labels,
        };
        plain.taking(comparison.taken)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(options: serde_json::Value) -> Result<Comparison, String> {
        serde_json::from_value(options).map_err(|error| error.to_string())
    }

    #[test]
    fn options_become_one_way_to_take_measurements_and_back() {
        let cases = [
            (json!({}), Taken::Final),
            (json!({"last": 5}), Taken::Last(5)),
            (json!({"root_mean_square": true}), Taken::RootMeanSquare),
            (
                json!({"steps_until_above": 3.0}),
                Taken::StepsUntilAbove {
                    level: 3.0,
                    smooth: 0.9,
                },
            ),
            (
                json!({"steps_until_above": 3.0, "smooth": 0.5}),
                Taken::StepsUntilAbove {
                    level: 3.0,
                    smooth: 0.5,
                },
            ),
            (
                json!({"at_steps": [1, 2]}),
                Taken::AtSteps {
                    steps: vec![1, 2],
                    of: AtStep::Average(0.0),
                },
            ),
            (
                json!({"at_steps": [1], "smooth": 0.5}),
                Taken::AtSteps {
                    steps: vec![1],
                    of: AtStep::Average(0.5),
                },
            ),
            (
                json!({"at_steps": [1], "last": 2}),
                Taken::AtSteps {
                    steps: vec![1],
                    of: AtStep::Last(2),
                },
            ),
        ];
        for (options, taken) in cases {
            let comparison = read(options.clone()).unwrap();
            assert_eq!(comparison.taken, taken);
            let written = json!(comparison);
            assert!(
                options
                    .as_object()
                    .unwrap()
                    .iter()
                    .all(|(key, value)| written[key] == *value),
                "{written}"
            );
            assert_eq!(read(written).unwrap(), comparison);
        }
    }

    #[test]
    fn options_that_exclude_each_other_are_refused_with_both_names() {
        let message = |options| read(options).unwrap_err();
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
