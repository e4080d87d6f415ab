//! The trials of one combination of parts that a store holds.

use contract::trial::TrialKey;
use std::collections::BTreeSet;

/// A stored combination of parts.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredCell {
    /// Key of one of its trials.
    pub key: TrialKey,
    /// The seeds of all of them.
    pub seeds: BTreeSet<u64>,
    /// How long those took that ended well.
    pub took: Took,
}

/// How long some trials took.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Took {
    /// How many.
    pub trials: u32,
    /// Their seconds, in sum.
    pub wall_s: f64,
}

impl Took {
    /// One trial that took this many seconds.
    #[must_use]
    pub fn once(wall_s: f64) -> Self {
        Self { trials: 1, wall_s }
    }

    /// Adds others.
    pub fn add(&mut self, others: Self) {
        self.trials += others.trials;
        self.wall_s += others.wall_s;
    }

    /// Seconds of one trial in the mean; `None` where there is none.
    #[must_use]
    pub fn mean_s(self) -> Option<f64> {
        (self.trials > 0).then(|| self.wall_s / f64::from(self.trials))
    }
}
