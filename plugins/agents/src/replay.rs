//! Replay buffer: the last transitions, sampled uniformly with replacement (Lin 1992; Mnih et al. 2015).
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | s, a, r, s' | `observations`, `actions`, `rewards`, `next_observations` | `[batch, ..]`, rewards `[batch, 1]` |
//! | 1 - d | `continues`: 0 where s' is terminal, 1 elsewhere, also where an episode was only cut off | `[batch, 1]` |

use crate::scaling::Scaling;
use burn::tensor::Tensor;
use engine::{End, Transition};
use numerics::network::matrix;
use numerics::tensor_file::{HostTensor, TensorFile, TensorFileError};
use rand::{Rng, RngCore};

/// A ring of transitions, each one row of `f32`: observation, action, reward, next observation, continues.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    capacity: usize,
    n_observed: usize,
    n_actions: usize,
    rows: Vec<f32>,
    oldest: usize,
}

/// Transitions as plain tensors.
#[derive(Debug, Clone)]
pub struct Batch {
    /// What was seen, `[batch, observed]`.
    pub observations: Tensor<2>,
    /// What was done, `[batch, actions]`.
    pub actions: Tensor<2>,
    /// What was earned, `[batch, 1]`.
    pub rewards: Tensor<2>,
    /// What was seen next, `[batch, observed]`.
    pub next_observations: Tensor<2>,
    /// 0 after a terminal step, else 1, `[batch, 1]`.
    pub continues: Tensor<2>,
}

impl Replay {
    /// An empty buffer for `capacity` transitions.
    #[must_use]
    pub fn new(capacity: usize, n_observed: usize, n_actions: usize) -> Self {
        Self { capacity: capacity.max(1), n_observed, n_actions, rows: Vec::new(), oldest: 0 }
    }

    /// Number of transitions that are stored.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len() / self.row_length()
    }

    /// True before the first transition.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Adds what one seat went through; the oldest transition gives way where the buffer is full.
    ///
    /// # Panics
    /// Where the observations and the action do not have the lengths of the buffer.
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    pub fn push(&mut self, transition: &Transition, seat: usize, scaling: &Scaling) {
        let action = transition.action[seat].iter().map(|a| *a as f32);
        let seen = scaling.apply(&transition.observation.seats[seat]);
        let next = scaling.apply(&transition.next_observation.seats[seat]);
        let continues = f32::from(u8::from(transition.end != Some(End::Terminated)));
        let row = seen.chain(action).chain([transition.rewards[seat] as f32]).chain(next).chain([continues]);
        let row: Vec<f32> = row.collect();
        assert_eq!(row.len(), self.row_length(), "entries of a transition");
        if self.len() < self.capacity {
            self.rows.extend(row);
            return;
        }
        let start = self.oldest * row.len();
        self.rows[start..start + row.len()].copy_from_slice(&row);
        self.oldest = (self.oldest + 1) % self.capacity;
    }

    /// `n` transitions drawn uniformly with replacement.
    ///
    /// # Panics
    /// Where the buffer is empty.
    pub fn sample(&self, n: usize, rng: &mut impl RngCore) -> Batch {
        let picked: Vec<usize> = (0..n).map(|_| rng.random_range(0..self.len())).collect();
        let (observed, actions, row) = (self.n_observed, self.n_actions, self.row_length());
        let columns = |from: usize, count: usize| {
            let values = picked.iter().flat_map(|at| &self.rows[at * row + from..at * row + from + count]);
            matrix(values.copied().collect(), count)
        };
        Batch {
            observations: columns(0, observed),
            actions: columns(observed, actions),
            rewards: columns(observed + actions, 1),
            next_observations: columns(observed + actions + 1, observed),
            continues: columns(row - 1, 1),
        }
    }

    /// Puts the buffer into a file.
    pub fn store(&self, file: &mut TensorFile) {
        let shape = vec![self.len(), self.row_length()];
        file.insert("replay", HostTensor { shape, values: self.rows.clone() });
        file.header["replay"] = serde_json::json!({ "oldest": self.oldest });
    }

    /// Continues from what [`Replay::store`] put into a file.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file holds no buffer or one of another shape.
    pub fn restore(&mut self, file: &TensorFile) -> Result<(), TensorFileError> {
        let stored = file.get("replay")?;
        let oldest = file.header["replay"]["oldest"].as_u64().and_then(|oldest| usize::try_from(oldest).ok());
        let oldest = oldest.ok_or_else(|| TensorFileError::Missing { name: "replay.oldest".into() })?;
        let fits = stored.shape.len() == 2 && stored.shape[1] == self.row_length() && stored.shape[0] <= self.capacity;
        if !fits || oldest >= self.capacity {
            let expected = format!("at most {} transitions of {} numbers", self.capacity, self.row_length());
            return Err(TensorFileError::Shape { expected, found: format!("{:?}", stored.shape) });
        }
        (self.rows, self.oldest) = (stored.values.clone(), oldest);
        Ok(())
    }

    fn row_length(&self) -> usize {
        2 * self.n_observed + self.n_actions + 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scaling::ObservationScaling;
    use engine::{Channel, Observation};
    use numerics::network::values;

    fn push(replay: &mut Replay, x: f64) {
        let channels = [Channel::new("x", ""), Channel::new("y", "")];
        let observe = |x: f64| Observation { seats: vec![vec![x, -x]], state: Vec::new() };
        let transition = Transition {
            observation: observe(x),
            action: vec![vec![x / 2.0]],
            rewards: vec![x * 10.0],
            next_observation: observe(x + 1.0),
            end: if x == 3.0 { Some(End::Terminated) } else { Some(End::Truncated) },
        };
        replay.push(&transition, 0, &Scaling::new(ObservationScaling::None, &channels));
    }

    #[test]
    fn the_oldest_gives_way_and_rows_stay_together() {
        let mut replay = Replay::new(3, 2, 1);
        (1..=5u8).for_each(|x| push(&mut replay, f64::from(x)));
        assert_eq!(replay.len(), 3);
        let batch = replay.sample(200, &mut engine::random::stream(&["replay"]));
        let (seen, done) = (values(batch.observations), values(batch.actions));
        let (rewards, next, continues) = (values(batch.rewards), values(batch.next_observations), values(batch.continues));
        for i in 0..200 {
            let x = seen[2 * i];
            assert!([3.0, 4.0, 5.0].contains(&x));
            assert_eq!((seen[2 * i + 1], done[i], rewards[i]), (-x, x / 2.0, 10.0 * x));
            assert_eq!((next[2 * i], continues[i]), (x + 1.0, f32::from(u8::from(x != 3.0))));
        }
        assert!([3.0, 4.0, 5.0].iter().all(|x| seen.contains(x)));
    }

    #[test]
    fn a_stored_buffer_continues() {
        let mut one = Replay::new(3, 2, 1);
        (1..=4u8).for_each(|x| push(&mut one, f64::from(x)));
        let mut file = TensorFile::default();
        one.store(&mut file);
        let mut two = Replay::new(3, 2, 1);
        two.restore(&file).unwrap();
        push(&mut one, 9.0);
        push(&mut two, 9.0);
        assert_eq!(one, two);
        assert!(Replay::new(2, 2, 1).restore(&file).is_err());
        assert!(Replay::new(3, 1, 1).restore(&file).is_err());
    }
}
