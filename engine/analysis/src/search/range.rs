//! The values that a key may take, and their places on a line from 0 to 1.
//!
//! A *share* is a place on that line. Every value owns a stretch of it (its cell): a listed value or an integer owns a
//! stretch of some width, any other number a point.

use contract::sweep_point::word;
use serde_json::{Value, json};

/// The values of a searched key.
#[derive(Debug, Clone, PartialEq)]
pub enum Range {
    /// Numbers between two limits.
    Numbers(Numbers),
    /// Listed values, in no order.
    Choice(Vec<Value>),
}

impl Range {
    /// The value at a share.
    #[must_use]
    pub fn at(&self, share: f64) -> Value {
        match self {
            Self::Numbers(numbers) => numbers.at(share),
            Self::Choice(values) => values[option(share, values.len())].clone(),
        }
    }

    /// Place of a value between the ends of the range, from 0 to 1. A listed value is placed by its index in the list.
    /// `None` for a value outside the range.
    #[must_use]
    pub fn share_of(&self, value: &Value) -> Option<f64> {
        match self {
            Self::Numbers(numbers) => Some(numbers.share(value.as_f64()?, numbers.low, numbers.high)),
            Self::Choice(values) => {
                let place = values.iter().position(|listed| listed == value)?;
                #[allow(clippy::cast_precision_loss, reason = "a number of options")]
                Some(place as f64 / (values.len() - 1).max(1) as f64)
            }
        }
    }

    /// The ends as text, the lower one first, or all listed values.
    #[must_use]
    pub fn in_words(&self) -> String {
        match self {
            Self::Numbers(numbers) => format!("{} to {}", numbers.low, numbers.high),
            Self::Choice(values) => values.iter().map(word).collect::<Vec<_>>().join(", "),
        }
    }

    /// The number of different values; `None` for a continuum.
    #[must_use]
    pub fn count(&self) -> Option<usize> {
        match self {
            Self::Numbers(numbers) => numbers.count(),
            Self::Choice(values) => Some(values.len()),
        }
    }
}

/// The index of the option at a share.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a share of a count of options is an index"
)]
pub(super) fn option(share: f64, n_options: usize) -> usize {
    ((share * n_options as f64).floor() as usize).min(n_options - 1)
}

/// Numbers between two limits, both included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Numbers {
    /// Smallest value of the range.
    pub low: f64,
    /// Largest value of the range.
    pub high: f64,
    /// Whether the logarithm is spread evenly.
    pub log: bool,
    /// Whether the values are whole numbers.
    pub integer: bool,
}

impl Numbers {
    /// The value at a share of the range, rounded to six digits so that a person can read and retype it.
    #[must_use]
    pub fn at(&self, share: f64) -> Value {
        if self.integer {
            let (low, high) = (self.low.ceil(), self.high.floor());
            let value = self.between(share, low, high + 1.0);
            #[allow(
                clippy::cast_possible_truncation,
                reason = "limits of an integer key are integers of moderate size"
            )]
            return json!(value.floor().clamp(low, high) as i64);
        }
        self.nearest(self.between(share, self.low, self.high))
    }

    /// The value next to a number: within the limits, and rounded as [`at`](Self::at) rounds.
    #[must_use]
    pub fn nearest(&self, value: f64) -> Value {
        if self.integer {
            let value = value.round().clamp(self.low.ceil(), self.high.floor());
            #[allow(
                clippy::cast_possible_truncation,
                reason = "limits of an integer key are integers of moderate size"
            )]
            return json!(value as i64);
        }
        let rounded = format!("{value:.5e}").parse().unwrap_or(value);
        json!(f64::clamp(rounded, self.low, self.high))
    }

    /// The stretch of shares that a value owns.
    #[must_use]
    pub fn cell(&self, value: f64) -> (f64, f64) {
        if self.integer {
            let (low, high) = (self.low.ceil(), self.high.floor() + 1.0);
            return (self.share(value, low, high), self.share(value + 1.0, low, high));
        }
        let share = self.share(value, self.low, self.high);
        (share, share)
    }

    fn count(&self) -> Option<usize> {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "limits of an integer key are integers of moderate size"
        )]
        self.integer
            .then(|| (self.high.floor() - self.low.ceil()) as usize + 1)
    }

    fn between(&self, share: f64, low: f64, high: f64) -> f64 {
        if self.log {
            (low.ln() + share * (high.ln() - low.ln())).exp()
        } else {
            low + share * (high - low)
        }
    }

    fn share(&self, value: f64, low: f64, high: f64) -> f64 {
        let share = if self.log {
            (value.ln() - low.ln()) / (high.ln() - low.ln())
        } else {
            (value - low) / (high - low)
        };
        share.clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn integers() -> Numbers {
        Numbers {
            low: 2.0,
            high: 4.0,
            log: false,
            integer: true,
        }
    }

    #[test]
    fn ranges_are_kept_and_integers_reach_both_ends() {
        assert_eq!(
            [0.0, 0.34, 0.999_999].map(|share| integers().at(share)),
            [json!(2), json!(3), json!(4)]
        );
        let log = Numbers {
            low: 1e-5,
            high: 1e-1,
            log: true,
            integer: false,
        };
        assert_eq!(log.at(0.5), json!(1e-3));
        assert_eq!(log.at(0.0), json!(1e-5));
    }

    #[test]
    fn values_lie_between_the_ends() {
        let choice = Range::Choice(vec![json!("a"), json!(2), json!(true)]);
        assert_eq!(
            [json!("a"), json!(2), json!(true), json!("b")].map(|it| choice.share_of(&it)),
            [Some(0.0), Some(0.5), Some(1.0), None]
        );
        let log = Range::Numbers(Numbers {
            low: 1e-4,
            high: 1.0,
            log: true,
            integer: false,
        });
        assert!(
            (log.share_of(&json!(0.01)).unwrap() - 0.5).abs() < 1e-12 && log.share_of(&json!("a")).is_none()
        );
        assert_eq!(
            (log.in_words(), choice.in_words()),
            ("0.0001 to 1".into(), "a, 2, true".into())
        );
    }

    #[test]
    fn listed_values_share_the_line_evenly() {
        let choice = Range::Choice(vec![json!("a"), json!(2), json!(true)]);
        assert_eq!(
            [0.0, 0.34, 1.0].map(|share| choice.at(share)),
            [json!("a"), json!(2), json!(true)]
        );
        assert_eq!(
            (choice.count(), Range::Numbers(integers()).count()),
            (Some(3), Some(3))
        );
    }

    proptest::proptest! {
        #[test]
        fn samples_stay_inside(low in 1e-9f64..10.0, width in 1e-9f64..10.0, share in 0.0f64..1.0, log: bool,
            integer: bool) {
            let range = Numbers { low: low.ceil(), high: low.ceil() + width.ceil(), log, integer };
            let value = range.at(share).as_f64().unwrap();
            proptest::prop_assert!(value >= range.low && value <= range.high);
        }

        #[test]
        fn a_value_lies_in_its_cell(share in 0.0f64..1.0, log: bool, integer: bool) {
            let range = Numbers { low: 1.0, high: 9.0, log, integer };
            let (from, to) = range.cell(range.at(share).as_f64().unwrap());
            // Numbers of a continuum are rounded to six digits.
            proptest::prop_assert!(from - 1e-5 <= share && share <= to + 1e-5, "{from} {share} {to}");
        }
    }
}
