//! Replay buffer of the Lyapunov actor-critics: transitions with their costs and, on request, the observation
//! before each.
//!
//! The observation before a transition lies behind the action in a row of the buffer, so that a draw keeps
//! them together. The first transition of an episode has none and is not stored then.

use crate::shared::{
    batch::{Batch, BatchInputs, BatchWidths},
    replay::Replay,
    scaling::Scaling,
};
use contract::{End, Rng, Transition};
use numerics::tensor_file::{TensorFile, TensorFileError};
use plan::Expression;

/// The buffer, and the latest observation of each environment.
#[derive(Debug, Clone, PartialEq)]
pub struct Memory {
    replay: Replay,
    options: MemoryOptions,
    before: PreviousObservations,
}

/// Options of the buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryOptions {
    /// Whether the observation before a transition is stored with it.
    pub before: bool,
    /// Whether a value still follows a transition whose episode was cut off.
    pub bootstrap_at_time_limit: bool,
}

/// Scaled observation before the next transition of each environment; `None` where an episode begins.
pub type PreviousObservations = Vec<Option<Vec<f64>>>;

/// A batch in equations.
#[derive(Debug, Clone, Copy)]
pub struct MemoryInputs<'e> {
    /// Observations s, `[batch, observed]`.
    pub observations: Expression<'e>,
    /// Actions a, `[batch, n]`.
    pub actions: Expression<'e>,
    /// Costs c, `[batch, 1]`.
    pub costs: Expression<'e>,
    /// Next observations s', `[batch, observed]`.
    pub next_observations: Expression<'e>,
    /// 1 where a value follows, else 0, `[batch, 1]`.
    pub continues: Expression<'e>,
    /// Observations before s, `[batch, observed]`, where they are stored.
    pub before: Option<Expression<'e>>,
}

impl<'e> MemoryInputs<'e> {
    /// The parts of a batch with actions of `n_acted` entries.
    #[must_use]
    pub fn of(batch: BatchInputs<'e>, n_acted: usize) -> Self {
        let before = n_acted..batch.actions.n_columns();
        Self {
            observations: batch.observations,
            actions: batch.actions.columns(0..n_acted),
            costs: -batch.rewards,
            next_observations: batch.next_observations,
            continues: batch.continues,
            before: (!before.is_empty()).then(|| batch.actions.columns(before)),
        }
    }
}

impl Memory {
    /// Creates an empty buffer for `capacity` transitions with `n_observed` and `n_acted` entries.
    #[must_use]
    pub fn new(capacity: usize, n_observed: usize, n_acted: usize, options: MemoryOptions) -> Self {
        let beside = if options.before { n_observed } else { 0 };
        Self {
            replay: Replay::new(capacity, n_observed, n_acted + beside, 1),
            options,
            before: Vec::new(),
        }
    }

    /// Whether no transition is stored.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.replay.is_empty()
    }

    /// Adds one step of every environment, always in the same order.
    pub fn push(&mut self, transitions: &[Transition], scaling: &Scaling) {
        self.before.resize(transitions.len(), None);
        for (at, transition) in transitions.iter().enumerate() {
            let mut stored = transition.clone();
            if stored.end == Some(End::Truncated) && !self.options.bootstrap_at_time_limit {
                stored.end = Some(End::Terminated);
            }
            if self.options.before {
                let seen = || scaling.apply(&transition.observation.seats[0]).map(f64::from);
                let now = transition.end.is_none().then(|| seen().collect());
                let Some(before) = std::mem::replace(&mut self.before[at], now) else {
                    // The first step of an episode has no predecessor.
                    continue;
                };
                stored.action.push(before);
            }
            self.replay.push_scaled(&stored, scaling);
        }
    }

    /// Draws at most `n` different transitions uniformly; an action is followed by the observation before it where
    /// that is stored.
    pub fn sample(&self, n: usize, rng: &mut Rng) -> Batch {
        self.replay.draw_distinct(n.min(self.replay.len()), rng)
    }

    /// Numbers of entries of a sample.
    #[must_use]
    pub fn widths(&self) -> BatchWidths {
        self.replay.widths()
    }

    /// Latest observations, which a checkpoint keeps beside [`Memory::store`].
    #[must_use]
    pub fn before(&self) -> &PreviousObservations {
        &self.before
    }

    /// Stores the buffer in a file.
    pub fn store(&self, file: &mut TensorFile) {
        self.replay.store(file);
    }

    /// Restores the buffer that [`Memory::store`] wrote, with the latest observations.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file holds no buffer or one of another shape.
    pub fn restore(
        &mut self,
        file: &TensorFile,
        before: PreviousObservations,
    ) -> Result<(), TensorFileError> {
        self.replay.restore(file)?;
        self.before = before;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::scaling::ObservationScaling;
    use contract::{Channel, Observation, random::stream};

    fn memory(before: bool, bootstrap_at_time_limit: bool) -> Memory {
        let options = MemoryOptions {
            before,
            bootstrap_at_time_limit,
        };
        Memory::new(16, 1, 2, options)
    }

    /// One step from `x` to `x + 1` with cost `10 x`.
    fn transition(x: f64, end: Option<End>) -> Transition {
        let observe = |x: f64| Observation {
            seats: vec![vec![x]],
            state: Vec::new(),
        };
        Transition {
            observation: observe(x),
            action: vec![vec![x / 2.0, -x]],
            rewards: vec![-10.0 * x],
            next_observation: observe(x + 1.0),
            end,
        }
    }

    /// Scaling that halves observations.
    fn scaling() -> Scaling {
        Scaling::new(
            ObservationScaling::Typical,
            &[Channel::new("x", "").typical(0.0, 2.0)],
        )
    }

    /// Columns of all stored transitions, sorted by observation.
    fn rows(memory: &Memory) -> Vec<[f32; 6]> {
        let drawn = memory.sample(99, &mut stream(&["memory"]));
        let width = memory.widths().acted;
        let row = |at: usize| {
            let done = &drawn.actions[at * width..(at + 1) * width];
            [
                done.get(2).copied().unwrap_or(f32::NAN),
                drawn.observations[at],
                done[0],
                -drawn.rewards[at],
                drawn.next_observations[at],
                drawn.continues[at],
            ]
        };
        let mut rows: Vec<_> = (0..drawn.n_rows).map(row).collect();
        rows.sort_by(|a, b| a[1].total_cmp(&b[1]));
        rows
    }

    /// Buffer after the steps of two environments: one goes from 1 to 4, the other is cut off after 11 and
    /// starts again at 14.
    fn filled(mut memory: Memory) -> Memory {
        let ends = [None, Some(End::Truncated), None, None];
        let others = [10.0, 11.0, 14.0, 15.0];
        for ((x, end), other) in [1.0, 2.0, 3.0, 4.0].into_iter().zip(ends).zip(others) {
            memory.push(&[transition(x, None), transition(other, end)], &scaling());
        }
        memory
    }

    #[test]
    fn the_observation_before_stays_with_its_transition_and_episode() {
        let found = rows(&filled(memory(true, true)));
        // The first steps of episodes, from 1, 10 and 14, are missing.
        let row = |x: f32| [(x - 1.0) / 2.0, x / 2.0, x / 2.0, 10.0 * x, (x + 1.0) / 2.0, 1.0];
        assert_eq!(found, [2.0, 3.0, 4.0, 11.0, 15.0].map(row));
    }

    #[test]
    fn without_it_every_transition_is_stored() {
        let found = rows(&filled(memory(false, true)));
        assert_eq!(found.len(), 8);
        assert!(found.iter().all(|row| row[0].is_nan() && row[2] == row[1]));
    }

    #[test]
    fn a_time_limit_ends_the_value_without_bootstrapping() {
        for (bootstrap, expected) in [(true, 1.0), (false, 0.0)] {
            let mut memory = memory(false, bootstrap);
            memory.push(&[transition(1.0, Some(End::Truncated))], &scaling());
            memory.push(&[transition(2.0, None)], &scaling());
            memory.push(&[transition(3.0, Some(End::Terminated))], &scaling());
            let goes_on: Vec<f32> = rows(&memory).iter().map(|row| row[5]).collect();
            assert_eq!(goes_on, [expected, 1.0, 0.0]);
        }
    }
}
