//! Repetition: whether a program that trains itself gives the same values again with the same seed.

use crate::{Phase, recorder::Row};
use document::count::count;
use serde::{Deserialize, Serialize};

/// Comparison of the values of two runs with one seed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Repeats {
    /// Every bit of this number of values is the same.
    ToTheBit(usize),
    /// They differ by less than ten to this power, relative to the larger value.
    Within(i32),
    /// They differ by more, or were recorded at other steps.
    Not,
    /// The reason why the result is unknown.
    Unknown(String),
}

/// The rows of a run with the names of their metrics.
#[derive(Debug, Clone, Copy)]
pub struct Recorded<'a> {
    /// Names to which the rows refer by index.
    pub names: &'a [String],
    /// Rows of the run.
    pub rows: &'a [Row],
}

/// Largest power of ten for which a relative difference may come from the order of sums alone.
const LARGEST_POWER: i32 = -3;

impl Repeats {
    /// Compares two runs up to a step, without the measurements at their ends. One of them may have gone further, and
    /// metrics that only one of them has are skipped.
    #[must_use]
    pub fn of(one: Recorded<'_>, other: Recorded<'_>, until: Option<u64>) -> Self {
        let (one, other) = (one.until(until, other.names), other.until(until, one.names));
        if one.len() != other.len() {
            return Self::Not;
        }
        let mut largest: f64 = 0.0;
        let mut same_bits = true;
        for ((place, first), (other_place, second)) in one.iter().zip(&other) {
            if place != other_place {
                return Self::Not;
            }
            same_bits &= first.to_bits() == second.to_bits();
            let scale = first.abs().max(second.abs());
            largest = largest.max(if scale > 0.0 {
                (first - second).abs() / scale
            } else {
                0.0
            });
        }
        match power_above(largest) {
            _ if same_bits => Self::ToTheBit(one.len()),
            power if power <= LARGEST_POWER => Self::Within(power),
            _ => Self::Not,
        }
    }

    /// The result as text, such as `repeats to the bit (34 values)`.
    #[must_use]
    pub fn in_words(&self) -> String {
        match self {
            Self::ToTheBit(values) => format!("repeats to the bit ({})", count(*values, "value")),
            Self::Within(power) => format!("repeats to 1e{power}"),
            Self::Not => "does not repeat".into(),
            Self::Unknown(problem) => format!("was not computed twice: {problem}"),
        }
    }
}

/// Key of a value: its phase, step, number at that step and metric.
type ValueKey<'a> = (Phase, u64, u64, &'a str);

impl<'a> Recorded<'a> {
    /// The values up to a step of metrics that both runs have, each with its place.
    fn until(self, until: Option<u64>, known: &[String]) -> Vec<(ValueKey<'a>, f64)> {
        let name = |row: &Row| self.names.get(usize::from(row.metric)).map_or("", String::as_str);
        let counts = |row: &&Row| row.phase != Phase::Final && until.is_none_or(|until| row.step <= until);
        let rows = self.rows.iter().filter(counts);
        rows.map(|row| ((row.phase, row.step, row.episode, name(row)), row.value))
            .filter(|((.., name), _)| known.iter().any(|it| it == name))
            .collect()
    }
}

/// The smallest power of ten that is at least a difference, and at least the resolution of numbers.
#[allow(
    clippy::cast_possible_truncation,
    reason = "a logarithm of a number between 1e-15 and 2"
)]
fn power_above(difference: f64) -> i32 {
    difference.max(1e-15).log10().ceil() as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(values: &[f64]) -> Vec<Row> {
        let row = |(step, value): (u64, &f64)| Row {
            phase: Phase::Evaluate,
            step,
            episode: 0,
            seat: 0,
            metric: 0,
            value: *value,
        };
        (1..).zip(values).map(row).collect()
    }

    fn compared(one: &[Row], other: &[Row]) -> Repeats {
        let names = &["return".to_owned()];
        let [one, other] = [one, other].map(|rows| Recorded { names, rows });
        Repeats::of(one, other, None)
    }

    #[test]
    fn the_words_are_those_of_the_largest_difference() {
        let words = |other: &[f64]| compared(&rows(&[1.0, -200.0]), &rows(other)).in_words();
        assert_eq!(words(&[1.0, -200.0]), "repeats to the bit (2 values)");
        assert_eq!(words(&[1.0, -200.000_1]), "repeats to 1e-6");
        assert_eq!(words(&[1.000_000_01, -200.000_1]), "repeats to 1e-6");
        assert_eq!(words(&[1.000_5, -200.0]), "repeats to 1e-3");
        assert_eq!(words(&[1.01, -200.0]), "does not repeat");
        assert_eq!(words(&[1.0]), "does not repeat");
        assert_eq!(compared(&rows(&[0.0]), &rows(&[-0.0])), Repeats::Within(-15));
    }

    #[test]
    fn values_at_other_steps_do_not_repeat_and_those_beyond_the_step_count_no_more() {
        let (one, mut other) = (rows(&[1.0]), rows(&[1.0, 5.0]));
        let names = &["return".to_owned()];
        let of = |rows| Recorded { names, rows };
        assert_eq!(Repeats::of(of(&one), of(&other), Some(1)), Repeats::ToTheBit(1));
        assert_eq!(Repeats::of(of(&one), of(&other), None), Repeats::Not);
        other[0].step = 7;
        assert_eq!(compared(&one, &other[..1]), Repeats::Not);
    }

    #[test]
    fn a_metric_that_one_of_them_lacks_is_passed_over() {
        let (mut more, less) = (rows(&[1.0, 2.0]), rows(&[1.0]));
        more[1].metric = 1;
        let names = ["return".to_owned(), "cost".to_owned()];
        let more = Recorded {
            names: &names,
            rows: &more,
        };
        let less = Recorded {
            names: &names[..1],
            rows: &less,
        };
        assert_eq!(Repeats::of(more, less, None), Repeats::ToTheBit(1));
    }
}
