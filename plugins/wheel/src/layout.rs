//! Where numbers stand in the vector that a step of all environments comes to.

use std::ops::Range;

/// How an episode stands after a call, as a number.
pub mod standing {
    /// It goes on.
    pub const GOES_ON: f64 = 0.0;
    /// It reached a terminal state.
    pub const TERMINATED: f64 = 1.0;
    /// It was cut off.
    pub const TRUNCATED: f64 = 2.0;
    /// It began in this call, without a step.
    pub const BEGAN: f64 = 3.0;
}

/// Sections one after the other, each with a row per environment: observations (seat after seat), rewards (one per
/// seat), metrics, how the episode stands, and, where episodes end and begin in one call, last observations.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Environments side by side.
    pub places: usize,
    /// Numbers that all seats of an environment observe.
    pub observed: usize,
    /// Seats of an environment.
    pub seats: usize,
    /// Metrics of an environment.
    pub metrics: usize,
    /// Whether last observations have a section.
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

    /// What the seats of an environment observe.
    #[must_use]
    pub fn observations(&self, place: usize) -> Range<usize> {
        self.row(0, place)
    }

    /// What they earned.
    #[must_use]
    pub fn rewards(&self, place: usize) -> Range<usize> {
        self.row(1, place)
    }

    /// Its metrics.
    #[must_use]
    pub fn metrics(&self, place: usize) -> Range<usize> {
        self.row(2, place)
    }

    /// How its episode stands.
    #[must_use]
    pub fn standing(&self, place: usize) -> usize {
        self.row(3, place).start
    }

    /// What its seats observed last, of an episode that ended; empty where that is not kept.
    #[must_use]
    pub fn last_observations(&self, place: usize) -> Range<usize> {
        self.row(4, place)
    }
}
