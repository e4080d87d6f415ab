//! Period in which the trials of a study ended.

use serde::{Deserialize, Serialize};

/// The first and the last of some dates.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Period {
    /// End of the first trial, in UTC by RFC 3339.
    pub first: String,
    /// End of the last trial, in the same form.
    pub last: String,
    /// Number of trials with a known date.
    pub dated: usize,
    /// Number of all trials.
    pub trials: usize,
}

impl Period {
    /// The period of the known dates among `trials` trials; `None` without a known date.
    #[cfg(test)]
    pub(crate) fn of(dates: impl Iterator<Item = String>, trials: usize) -> Option<Self> {
        dates.fold(None, |period, date| Some(Self::with(period, date, trials)))
    }

    /// The period with one more date among `trials` trials.
    #[must_use]
    pub fn with(period: Option<Self>, date: String, trials: usize) -> Self {
        let Some(Self {
            first, last, dated, ..
        }) = period
        else {
            return Self {
                first: date.clone(),
                last: date,
                dated: 1,
                trials,
            };
        };
        // Dates of this form sort as their texts.
        Self {
            first: first.min(date.clone()),
            last: last.max(date),
            dated: dated + 1,
            trials,
        }
    }

    /// The period in words.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Self {
            first,
            last,
            dated,
            trials,
        } = self;
        let part = if dated < trials {
            format!(" (known of {dated} of {trials} trials)")
        } else {
            String::new()
        };
        if first == last {
            format!("{first}{part}")
        } else {
            format!("the first {first}, the last {last}{part}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_and_the_last_date_count_and_unknown_ones_are_told() {
        let dates = ["2025-01-03T10:00:00Z", "2024-12-31T23:59:59Z"].map(str::to_owned);
        let period = Period::of(dates.clone().into_iter(), 2).unwrap();
        assert_eq!(
            period.sentence(),
            "the first 2024-12-31T23:59:59Z, the last 2025-01-03T10:00:00Z"
        );
        let period = Period::of(dates.into_iter().take(1), 2).unwrap();
        assert_eq!(period.sentence(), "2025-01-03T10:00:00Z (known of 1 of 2 trials)");
        assert_eq!(Period::of(std::iter::empty(), 2), None);
    }
}
