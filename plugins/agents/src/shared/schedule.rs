//! Update schedule of an off-policy agent: a number of updates per environment step, after a first stretch
//! without updates.

use contract::Updates;
use serde::{Deserialize, Serialize};

/// Counter of environment steps that tells how many updates are due.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct UpdateSchedule {
    n_steps: u64,
    n_updates: u64,
    updates_due: f64,
}

impl UpdateSchedule {
    /// Creates a schedule before the first step.
    #[must_use]
    pub fn new() -> Self {
        Self {
            n_steps: 0,
            n_updates: 0,
            updates_due: 0.0,
        }
    }

    /// Number of environment steps so far, over all environments.
    #[must_use]
    pub fn n_steps(&self) -> u64 {
        self.n_steps
    }

    /// Number of updates so far.
    #[must_use]
    pub fn n_updates(&self) -> u64 {
        self.n_updates
    }

    /// Counts one update.
    pub fn count_update(&mut self) {
        self.n_updates += 1;
    }

    /// Declared updates of an agent that follows this schedule. None is due before the declared step, for any
    /// number of parallel environments.
    #[must_use]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "saturates where there is never an update"
    )]
    pub fn updates(&self, learning_starts: u64, updates_per_step: f64) -> Updates {
        Updates {
            made: self.n_updates,
            first_after: learning_starts.max((1.0 / updates_per_step).ceil() as u64),
        }
    }

    /// Adds `n_new` environment steps; returns the number of updates that are due and carries the fraction.
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "small counts"
    )]
    pub fn advance(&mut self, n_new: usize, learning_starts: u64, updates_per_step: f64) -> u64 {
        self.n_steps += n_new as u64;
        if self.n_steps < learning_starts {
            return 0;
        }
        self.updates_due += updates_per_step * n_new as f64;
        let due = self.updates_due.floor();
        self.updates_due -= due;
        due as u64
    }
}

impl Default for UpdateSchedule {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_are_carried_and_the_first_stretch_is_free() {
        let mut schedule = UpdateSchedule::new();
        let due: Vec<u64> = (0..6).map(|_| schedule.advance(10, 30, 0.0625)).collect();
        // 0.625 per call from the third on: 0.625, 1.25, 1.875, 2.5.
        assert_eq!(due, [0, 0, 0, 1, 0, 1]);
        assert_eq!(schedule.n_steps(), 60);
    }

    #[test]
    fn no_update_is_due_before_the_declared_step() {
        for (together, starts, per_step) in [
            (1, 100, 1.0),
            (64, 128, 0.0625),
            (10, 30, 0.01),
            (7, 5, 3.0),
            (1, 1, 0.3),
        ] {
            let mut schedule = UpdateSchedule::new();
            let told = schedule.updates(starts, per_step).first_after;
            while schedule.advance(together, starts, per_step) == 0 {}
            assert!(
                schedule.n_steps() >= told && told >= starts,
                "{together} {starts} {per_step}: {told}"
            );
        }
        assert_eq!(UpdateSchedule::new().updates(30, 0.0).first_after, u64::MAX);
    }

    #[test]
    fn updates_are_counted_as_they_are_made() {
        let mut schedule = UpdateSchedule::new();
        (0..3).for_each(|_| schedule.count_update());
        assert_eq!(
            schedule.updates(30, 1.0),
            Updates {
                made: 3,
                first_after: 30
            }
        );
    }
}
