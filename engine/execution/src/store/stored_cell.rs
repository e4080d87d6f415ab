//! The trials of one combination of parts that a store holds, device by device.

use contract::trial::TrialKey;
use std::collections::BTreeSet;

/// A stored combination of parts.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredCell {
    /// Key of one of its trials.
    pub key: TrialKey,
    /// The seeds of all these trials.
    pub seeds: BTreeSet<u64>,
    /// Device of the runs that computed them; `None` for processors alone.
    pub device: Option<String>,
    /// Time of the trials that ended successfully.
    pub took: Took,
}

/// Computing time of some trials.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Took {
    /// Number of trials.
    pub trials: u32,
    /// Sum of their seconds.
    pub wall_s: f64,
}

impl Took {
    /// The time of one trial, in seconds.
    #[must_use]
    pub fn once(wall_s: f64) -> Self {
        Self { trials: 1, wall_s }
    }

    /// Adds the time of other trials.
    pub fn add(&mut self, others: Self) {
        self.trials += others.trials;
        self.wall_s += others.wall_s;
    }

    /// Mean seconds of a trial; `None` if there is none.
    #[must_use]
    pub fn mean_s(self) -> Option<f64> {
        (self.trials > 0).then(|| self.wall_s / f64::from(self.trials))
    }
}
