//! Replay buffer: the latest transitions of all seats (Lin 1992; Mnih et al. 2015). An environment of one
//! seat is a game with one player.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | s, a, s' | `observations`, `actions`, `next_observations`, all seats in order | `[batch, ..]` |
//! | r | `rewards` | `[batch, n_seats]` |
//! | 1 - d | `continues`: 0 where s' is terminal, 1 elsewhere, also where an episode was only cut off | `[batch, 1]` |
//! | mu_i, sigma_i | [`Replay::reward_moments`], over everything that is stored | scalars |

use super::batch::{Batch, BatchWidths};
use super::joint::JointLayout;
use super::ring::Ring;
use super::scaling::Scaling;
use contract::{End, Observation, Transition};
use numerics::tensor_file::{TensorFile, TensorFileError};
use rand::{Rng, RngCore};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;

/// Smallest standard deviation by which rewards are divided; below it they count as equal.
const SMALLEST_SD: f64 = 1e-8;

/// A ring of transitions, each one row of `f32`: observation, action, rewards, next observation, continues.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    n_observed: usize,
    n_acted: usize,
    rows: Ring,
    sums: Vec<RewardSums>,
}

/// Running sums of one seat's rewards, as differences from the first reward so that no digits cancel.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
struct RewardSums {
    origin: f64,
    sum: f64,
    sum_of_squares: f64,
}

impl Replay {
    /// Creates an empty buffer for `capacity` transitions of `n_seats` seats with `n_observed` entries of the
    /// joint observation and `n_acted` of the joint action.
    #[must_use]
    pub fn new(capacity: usize, n_observed: usize, n_acted: usize, n_seats: usize) -> Self {
        let sums = vec![RewardSums::default(); n_seats];
        Self {
            n_observed,
            n_acted,
            rows: Ring::new(capacity, 2 * n_observed + n_acted + n_seats + 1),
            sums,
        }
    }

    /// Creates an empty buffer for `capacity` transitions of the seats of a layout.
    #[must_use]
    pub fn of_seats(capacity: usize, layout: &JointLayout) -> Self {
        Self::new(capacity, layout.n_observed(), layout.n_acted(), layout.n_seats())
    }

    /// Number of stored transitions.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether no transition is stored.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Adds one step of all seats, with observations as they are; replaces the oldest transition where the
    /// buffer is full.
    ///
    /// # Panics
    /// Where the observations, the actions and the rewards do not have the lengths of the buffer.
    pub fn push(&mut self, transition: &Transition) {
        self.insert(transition, |observation| {
            single(observation.seats.iter().flatten()).collect()
        });
    }

    /// Adds one step of an environment with one seat, with scaled observations; otherwise as
    /// [`Replay::push`].
    ///
    /// # Panics
    /// Where the observation, the action and the reward do not have the lengths of the buffer.
    pub fn push_scaled(&mut self, transition: &Transition, scaling: &Scaling) {
        self.insert(transition, |observation| {
            scaling.apply(&observation.seats[0]).collect()
        });
    }

    fn insert(&mut self, transition: &Transition, seen: impl Fn(&Observation) -> Vec<f32>) {
        let row = row(transition, seen);
        assert_eq!(
            transition.rewards.len(),
            self.n_seats(),
            "rewards of a transition"
        );
        if self.is_empty() {
            self.start_sums(&row);
        }
        match self.rows.push(&row) {
            None => self.add_to_sums(&row, 1.0),
            Some(left) => {
                self.add_to_sums(&left, -1.0);
                self.add_to_sums(&row, 1.0);
                if self.rows.oldest() == 0 {
                    self.recompute_sums();
                }
            }
        }
    }

    /// `n` transitions drawn uniformly with replacement.
    ///
    /// # Panics
    /// Where the buffer is empty.
    pub fn draw(&self, n: usize, rng: &mut impl RngCore) -> Batch {
        let picked: Vec<usize> = (0..n).map(|_| rng.random_range(0..self.len())).collect();
        self.picked(&picked)
    }

    /// `n` different transitions, drawn uniformly.
    ///
    /// # Panics
    /// Where the buffer holds fewer than `n` transitions.
    pub fn draw_distinct(&self, n: usize, rng: &mut impl RngCore) -> Batch {
        assert!(n <= self.len(), "{n} transitions of {}", self.len());
        self.picked(&distinct(n, self.len(), rng))
    }

    /// The `n` latest transitions, the oldest of them first; all of them where fewer are stored.
    #[must_use]
    pub fn latest(&self, n: usize) -> Batch {
        let (stored, n) = (self.len(), n.min(self.len()));
        let places = (stored - n..stored).map(|age| (self.rows.oldest() + age) % stored);
        self.picked(&places.collect::<Vec<_>>())
    }

    /// Numbers of entries of the joint observation, of the joint action, and of seats.
    #[must_use]
    pub fn widths(&self) -> BatchWidths {
        BatchWidths {
            observed: self.n_observed,
            acted: self.n_acted,
            seats: self.n_seats(),
        }
    }

    /// Replaces the rewards of each seat by their distance from the mean of all that are stored, in units of their
    /// standard deviation (1 where they are equal).
    pub fn standardise_rewards(&self, batch: &mut Batch) {
        let moments: Vec<_> = (0..self.n_seats())
            .map(|seat| self.reward_moments(seat))
            .collect();
        for row in batch.rewards.chunks_exact_mut(moments.len()) {
            for (reward, (mean, sd)) in row.iter_mut().zip(&moments) {
                let spread = if *sd > SMALLEST_SD { *sd } else { 1.0 };
                #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
                let standardised = ((f64::from(*reward) - mean) / spread) as f32;
                *reward = standardised;
            }
        }
    }

    /// Mean and population standard deviation of a seat's rewards over all stored transitions; zeros for an
    /// empty buffer.
    #[must_use]
    #[allow(
        clippy::cast_precision_loss,
        reason = "a number of transitions is far below 2^52"
    )]
    pub fn reward_moments(&self, seat: usize) -> (f64, f64) {
        let RewardSums {
            origin,
            sum,
            sum_of_squares,
        } = self.sums[seat];
        let n = self.len().max(1) as f64;
        let shift = sum / n;
        (
            origin + shift,
            (sum_of_squares / n - shift * shift).max(0.0).sqrt(),
        )
    }

    /// Stores the buffer in a file.
    pub fn store(&self, file: &mut TensorFile) {
        self.rows.store("replay", file);
        file.header["replay"]["reward_sums"] = serde_json::json!(self.sums);
    }

    /// Restores the buffer that [`Replay::store`] wrote.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file holds no buffer or one of another shape.
    pub fn restore(&mut self, file: &TensorFile) -> Result<(), TensorFileError> {
        let sums = &file.header["replay"]["reward_sums"];
        let sums = Vec::<RewardSums>::deserialize(sums).map_err(|_| TensorFileError::Missing {
            name: "replay.reward_sums".into(),
        })?;
        if sums.len() != self.n_seats() {
            return Err(TensorFileError::Shape {
                expected: format!("transitions of {} seats", self.n_seats()),
                found: format!("those of {}", sums.len()),
            });
        }
        self.rows.restore("replay", file)?;
        self.sums = sums;
        Ok(())
    }

    fn picked(&self, picked: &[usize]) -> Batch {
        let columns = |from: usize, count: usize| {
            let mut values = Vec::with_capacity(picked.len() * count);
            for at in picked {
                values.extend_from_slice(&self.rows.row(*at)[from..from + count]);
            }
            values
        };
        let (observed, acted, seats) = (self.n_observed, self.n_acted, self.n_seats());
        Batch {
            n_rows: picked.len(),
            observations: columns(0, observed),
            actions: columns(observed, acted),
            rewards: columns(observed + acted, seats),
            next_observations: columns(observed + acted + seats, observed),
            continues: columns(self.rows.width() - 1, 1),
        }
    }

    fn start_sums(&mut self, row: &[f32]) {
        let first = self.n_observed + self.n_acted;
        for (sums, reward) in self.sums.iter_mut().zip(&row[first..]) {
            *sums = RewardSums {
                origin: f64::from(*reward),
                ..RewardSums::default()
            };
        }
    }

    fn add_to_sums(&mut self, row: &[f32], sign: f64) {
        let first = self.n_observed + self.n_acted;
        for (sums, reward) in self.sums.iter_mut().zip(&row[first..]) {
            let distance = f64::from(*reward) - sums.origin;
            sums.sum += sign * distance;
            sums.sum_of_squares += sign * distance * distance;
        }
    }

    /// Recomputes the sums once per turn of the ring, so that the rounding of additions and subtractions does
    /// not accumulate.
    fn recompute_sums(&mut self) {
        for sums in &mut self.sums {
            (sums.sum, sums.sum_of_squares) = (0.0, 0.0);
        }
        for at in 0..self.rows.len() {
            let row = self.rows.row(at).to_vec();
            self.add_to_sums(&row, 1.0);
        }
    }

    fn n_seats(&self) -> usize {
        self.sums.len()
    }
}

/// `n` different numbers below `total`, every subset with the same probability (Floyd; Bentley 1987,
/// Communications of the ACM 30).
fn distinct(n: usize, total: usize, rng: &mut impl RngCore) -> Vec<usize> {
    let mut taken = HashSet::with_capacity(n);
    let mut draw = |last: usize| {
        let at = rng.random_range(0..=last);
        let at = if taken.contains(&at) { last } else { at };
        taken.insert(at);
        at
    };
    (total - n..total).map(&mut draw).collect()
}

fn row(transition: &Transition, seen: impl Fn(&Observation) -> Vec<f32>) -> Vec<f32> {
    let Transition {
        observation,
        action,
        rewards,
        next_observation,
        end,
    } = transition;
    let mut row = seen(observation);
    row.extend(single(action.iter().flatten().chain(rewards)));
    row.extend(seen(next_observation));
    row.push(f32::from(u8::from(*end != Some(End::Terminated))));
    row
}

/// Numbers in the precision of networks.
#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
fn single<'a>(entries: impl Iterator<Item = &'a f64>) -> impl Iterator<Item = f32> {
    entries.map(|entry| *entry as f32)
}

#[cfg(test)]
mod tests {
    use super::super::scaling::ObservationScaling;
    use super::*;
    use contract::{Channel, random::stream};

    /// Buffer for two seats with 2 and 1 observed entries, and 1 and 2 entries of the action.
    fn replay(capacity: usize) -> Replay {
        Replay::new(capacity, 3, 3, 2)
    }

    fn push(replay: &mut Replay, x: f64) {
        let observe = |x: f64| Observation {
            seats: vec![vec![x, -x], vec![x + 0.5]],
            state: vec![7.0],
        };
        replay.push(&Transition {
            observation: observe(x),
            action: vec![vec![x / 2.0], vec![x / 4.0, -x / 4.0]],
            rewards: vec![x * 10.0, -x],
            next_observation: observe(x + 1.0),
            end: if x == 3.0 {
                Some(End::Terminated)
            } else {
                Some(End::Truncated)
            },
        });
    }

    fn filled(capacity: usize, n: u8) -> Replay {
        let mut replay = replay(capacity);
        (1..=n).for_each(|x| push(&mut replay, f64::from(x)));
        replay
    }

    #[test]
    fn the_oldest_gives_way_and_rows_stay_together() {
        let batch = filled(3, 5).draw_distinct(3, &mut stream(&["replay"]));
        let (seen, done) = (batch.observations, batch.actions);
        let (rewards, next, continues) = (batch.rewards, batch.next_observations, batch.continues);
        let mut drawn: Vec<f32> = (0..3).map(|i| seen[3 * i]).collect();
        for i in 0..3 {
            let x = seen[3 * i];
            assert_eq!(seen[3 * i..3 * i + 3], [x, -x, x + 0.5]);
            assert_eq!(done[3 * i..3 * i + 3], [x / 2.0, x / 4.0, -x / 4.0]);
            assert_eq!((rewards[2 * i], rewards[2 * i + 1]), (10.0 * x, -x));
            assert_eq!(
                (next[3 * i], continues[i]),
                (x + 1.0, f32::from(u8::from(x != 3.0)))
            );
        }
        // Three distinct draws of three rows are all rows.
        drawn.sort_by(f32::total_cmp);
        assert_eq!(drawn, [3.0, 4.0, 5.0]);
    }

    #[test]
    fn draws_are_uniform_and_distinct() {
        let (replay, mut rng) = (filled(20, 10), stream(&["uniform"]));
        let mut counts = [0; 10];
        for _ in 0..2_000 {
            let mut seen = replay
                .draw_distinct(4, &mut rng)
                .rewards
                .into_iter()
                .step_by(2)
                .collect::<Vec<_>>();
            seen.sort_by(f32::total_cmp);
            assert!(seen.windows(2).all(|pair| pair[0] < pair[1]));
            seen.iter()
                .for_each(|reward| counts[(reward / 10.0) as usize - 1] += 1);
        }
        // Each of ten rows is expected in 800 of 2000 draws of four, with a deviation of sqrt(2000 * 0.4 *
        // 0.6) = 22.
        assert!(
            counts.iter().all(|count| (710..890).contains(count)),
            "{counts:?}"
        );
    }

    #[test]
    fn with_replacement_draws_are_uniform_and_repeat() {
        let (replay, mut rng) = (filled(20, 4), stream(&["replaced"]));
        let rewards = replay.draw(4_000, &mut rng).rewards;
        for x in 1..=4u8 {
            // Each row is expected 1000 times, with a deviation of sqrt(4000 * 0.25 * 0.75) = 27.
            let count = rewards
                .iter()
                .filter(|reward| **reward == 10.0 * f32::from(x))
                .count();
            assert!((890..1110).contains(&count), "{x}: {count}");
        }
    }

    #[test]
    fn observations_of_one_seat_are_scaled() {
        let channels = [Channel::new("x", "").typical(1.0, 2.0), Channel::new("y", "")];
        let scaling = Scaling::new(ObservationScaling::Typical, &channels);
        let mut replay = Replay::new(2, 2, 1, 1);
        let observe = |x: f64| Observation {
            seats: vec![vec![x, -x]],
            state: Vec::new(),
        };
        replay.push_scaled(
            &Transition {
                observation: observe(3.0),
                action: vec![vec![0.5]],
                rewards: vec![7.0],
                next_observation: observe(5.0),
                end: Some(End::Terminated),
            },
            &scaling,
        );
        let batch = replay.latest(1);
        assert_eq!((batch.observations, batch.actions), (vec![1.0, -3.0], vec![0.5]));
        assert_eq!(
            (batch.next_observations, batch.rewards),
            (vec![2.0, -5.0], vec![7.0])
        );
        assert_eq!(batch.continues, [0.0]);
    }

    #[test]
    fn the_latest_come_in_their_order() {
        let first = |batch: Batch| batch.observations.into_iter().step_by(3).collect::<Vec<_>>();
        assert_eq!(first(filled(3, 5).latest(2)), [4.0, 5.0]);
        assert_eq!(first(filled(3, 5).latest(9)), [3.0, 4.0, 5.0]);
        assert_eq!(first(filled(9, 5).latest(2)), [4.0, 5.0]);
    }

    #[test]
    fn moments_are_those_of_the_stored_rewards() {
        assert_eq!(replay(3).reward_moments(0), (0.0, 0.0));
        assert_eq!(filled(3, 1).reward_moments(0), (10.0, 0.0));
        // 3, 4, 5: mean 4, variance 2/3.
        for n in [5, 6, 7] {
            let (mean, sd) = filled(3, n).reward_moments(0);
            assert!(
                (mean - 10.0 * f64::from(n - 1)).abs() < 1e-12
                    && (sd - 10.0 * (2.0f64 / 3.0).sqrt()).abs() < 1e-12
            );
        }
        let (mean, sd) = filled(3, 5).reward_moments(1);
        assert!((mean + 4.0).abs() < 1e-12 && (sd - (2.0f64 / 3.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn rewards_are_standardised_by_seat() {
        let replay = filled(9, 4);
        let mut batch = replay.latest(4);
        let second = |batch: &Batch| {
            batch
                .rewards
                .iter()
                .skip(1)
                .step_by(2)
                .copied()
                .collect::<Vec<f32>>()
        };
        assert_eq!(second(&batch), [-1.0, -2.0, -3.0, -4.0]);
        // Mean -2.5 and variance 1.25.
        let by_hand: Vec<f32> = [1.5f32, 0.5, -0.5, -1.5]
            .iter()
            .map(|x| x / 1.25f32.sqrt())
            .collect();
        replay.standardise_rewards(&mut batch);
        let standardised = second(&batch);
        assert!(
            standardised
                .iter()
                .zip(&by_hand)
                .all(|(a, b)| (a - b).abs() < 1e-6),
            "{standardised:?}"
        );
        let alone = filled(9, 1);
        let mut only = alone.latest(1);
        alone.standardise_rewards(&mut only);
        assert_eq!(only.rewards, [0.0, 0.0]);
    }

    #[test]
    fn a_stored_buffer_continues() {
        let mut one = filled(3, 4);
        let mut file = TensorFile::default();
        one.store(&mut file);
        let mut two = replay(3);
        two.restore(&file).unwrap();
        assert_eq!(one, two);
        push(&mut one, 9.1);
        push(&mut two, 9.1);
        assert_eq!(one, two);
        assert!(replay(2).restore(&file).is_err());
        assert!(Replay::new(3, 3, 3, 1).restore(&file).is_err());
        assert!(replay(3).restore(&TensorFile::default()).is_err());
    }
}
