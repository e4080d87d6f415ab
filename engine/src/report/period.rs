//! When the trials of a study ended.

/// The first and the last of some dates.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Period {
    /// When the first trial ended, in UTC as RFC 3339 writes it.
    pub first: String,
    /// When the last one ended.
    pub last: String,
    /// Trials whose date is known.
    pub dated: usize,
    /// All trials.
    pub trials: usize,
}

impl Period {
    /// The period of one date per trial, `None` for a trial without; `None` where no date is known.
    #[must_use]
    pub fn of(dates: impl Iterator<Item = Option<String>>) -> Option<Self> {
        let all: Vec<Option<String>> = dates.collect();
        let mut known: Vec<&String> = all.iter().flatten().collect();
        // Dates of this form are in the order of their texts.
        known.sort_unstable();
        let (first, last) = (known.first()?.to_string(), known.last()?.to_string());
        Some(Self {
            first,
            last,
            dated: known.len(),
            trials: all.len(),
        })
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
        let dates = ["2025-01-03T10:00:00Z", "2024-12-31T23:59:59Z"].map(|date| Some(date.to_owned()));
        let period = Period::of(dates.clone().into_iter()).unwrap();
        assert_eq!(
            period.sentence(),
            "the first 2024-12-31T23:59:59Z, the last 2025-01-03T10:00:00Z"
        );
        let period = Period::of([dates[0].clone(), None].into_iter()).unwrap();
        assert_eq!(period.sentence(), "2025-01-03T10:00:00Z (known of 1 of 2 trials)");
        assert_eq!(Period::of([None, None].into_iter()), None);
    }
}
