//! Positions of numbers in the vector that a step of all environments returns.

use std::ops::Range;

/// State of an episode after a call, as a number.
pub mod standing {
    /// The episode goes on.
    pub const GOES_ON: f64 = 0.0;
    /// The episode reached a terminal state.
    pub const TERMINATED: f64 = 1.0;
    /// The episode was cut off.
    pub const TRUNCATED: f64 = 2.0;
    /// The episode began in this call, without a step.
    pub const BEGAN: f64 = 3.0;
}

/// Consecutive sections, each with a row per environment: observations (seat after seat), rewards (one per
/// seat), metrics, state of the episode, and, where an episode may end and begin in one call, last
/// observations.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Number of environments side by side.
    pub places: usize,
    /// Number of observed values of one environment, all seats together.
    pub observed: usize,
    /// Number of seats of an environment.
    pub seats: usize,
    /// Number of metrics of an environment.
    pub metrics: usize,
    /// Whether there is a section for last observations.
    pub keeps_last: bool,
}

impl Layout {
    /// Columns of each section, in order.
    #[must_use]
    pub fn columns(&self) -> [usize; 5] {
        let last = if self.keeps_last { self.observed } else { 0 };
        [self.observed, self.seats, self.metrics, 1, last]
    }

    /// Numbers of the whole vector.
    #[must_use]
    pub fn total(&self) -> usize {
        self.places * self.columns().iter().sum::<usize>()
    }

    fn row(&self, section: usize, place: usize) -> Range<usize> {
        let columns = self.columns();
        let before: usize = columns[..section].iter().sum();
        let start = self.places * before + place * columns[section];
        start..start + columns[section]
    }

    /// Observations of all seats of an environment.
    #[must_use]
    pub fn observations(&self, place: usize) -> Range<usize> {
        self.row(0, place)
    }

    /// Rewards, one per seat.
    #[must_use]
    pub fn rewards(&self, place: usize) -> Range<usize> {
        self.row(1, place)
    }

    /// Metrics of an environment.
    #[must_use]
    pub fn metrics(&self, place: usize) -> Range<usize> {
        self.row(2, place)
    }

    /// State of the episode, one of [`standing`].
    #[must_use]
    pub fn standing(&self, place: usize) -> usize {
        self.row(3, place).start
    }

    /// Last observations of an ended episode; empty where they are not kept.
    #[must_use]
    pub fn last_observations(&self, place: usize) -> Range<usize> {
        self.row(4, place)
    }
}
