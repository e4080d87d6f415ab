//! Exploration noise of a deterministic policy: independent, or correlated from step to step.
//!
//! | symbol | here |
//! |---|---|
//! | x_t | state of the Ornstein-Uhlenbeck process, one number per row and entry of the action |
//! | theta | rate of return, 0.15 (Lillicrap et al. 2015, arXiv:1509.02971, section 7) |
//!
//! `x_(t+1) = (1 - theta) x_t + sqrt(theta (2 - theta)) n_t` with standard normal `n_t` and a standard normal
//! first state, so that every `x_t` has a deviation of 1 for either kind of noise; the caller scales it.

use numerics::gaussian::standard_normal;
use rand::RngCore;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const RATE: f64 = 0.15;

/// Kind of noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Noise {
    /// Independent from step to step.
    #[default]
    Gaussian,
    /// A discrete Ornstein-Uhlenbeck process that starts anew with every episode.
    OrnsteinUhlenbeck,
}

/// Noise of several parallel environments, one row each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Exploration {
    noise: Noise,
    n_entries: usize,
    /// State per environment; empty where the next draw restarts the process.
    states: Vec<Vec<f32>>,
}

impl Exploration {
    /// Creates the noise for actions of `n_entries` entries.
    #[must_use]
    pub fn new(noise: Noise, n_entries: usize) -> Self {
        Self {
            noise,
            n_entries,
            states: Vec::new(),
        }
    }

    /// Draws the next noise of `n_rows` environments, `[n_rows, n_entries]`, each entry with a deviation of
    /// 1.
    pub fn draw(&mut self, n_rows: usize, rng: &mut impl RngCore) -> Vec<f32> {
        self.states.resize_with(n_rows, Vec::new);
        let (noise, n_entries) = (self.noise, self.n_entries);
        self.states
            .iter_mut()
            .flat_map(|state| advance(noise, n_entries, state, rng))
            .collect()
    }

    /// Restarts the process of one environment, as at the end of an episode.
    pub fn restart(&mut self, row: usize) {
        if let Some(state) = self.states.get_mut(row) {
            state.clear();
        }
    }
}

#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
fn advance(noise: Noise, n_entries: usize, state: &mut Vec<f32>, rng: &mut impl RngCore) -> Vec<f32> {
    let mut fresh = || standard_normal(rng);
    match noise {
        Noise::Gaussian => (0..n_entries).map(|_| fresh() as f32).collect(),
        Noise::OrnsteinUhlenbeck if state.is_empty() => {
            *state = (0..n_entries).map(|_| fresh() as f32).collect();
            state.clone()
        }
        Noise::OrnsteinUhlenbeck => {
            let scale = (RATE * (2.0 - RATE)).sqrt();
            state
                .iter_mut()
                .for_each(|x| *x = ((1.0 - RATE) * f64::from(*x) + scale * fresh()) as f32);
            state.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random::stream;

    /// Variance, and correlation from step to step, over many steps.
    fn moments(noise: Noise) -> (f64, f64) {
        let (mut exploration, mut rng) = (Exploration::new(noise, 2), stream(&["exploration"]));
        let drawn: Vec<f64> = (0..40_000)
            .map(|_| f64::from(exploration.draw(1, &mut rng)[0]))
            .collect();
        let variance = drawn.iter().map(|x| x * x).sum::<f64>() / 40_000.0;
        let product = drawn.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / 39_999.0;
        (variance, product / variance)
    }

    #[test]
    fn both_kinds_have_a_deviation_of_one() {
        let (variance, correlation) = moments(Noise::Gaussian);
        assert!(
            (variance - 1.0).abs() < 0.03 && correlation.abs() < 0.02,
            "{variance} {correlation}"
        );
        // About 40000 (1 - 0.85^2) / (1 + 0.85^2) = 6400 independent squares, each with a variance of 2.
        let (variance, correlation) = moments(Noise::OrnsteinUhlenbeck);
        assert!(
            (variance - 1.0).abs() < 0.07 && (correlation - 0.85).abs() < 0.02,
            "{variance} {correlation}"
        );
    }

    #[test]
    fn a_row_starts_anew_alone() {
        let mut exploration = Exploration::new(Noise::OrnsteinUhlenbeck, 1);
        exploration.draw(2, &mut stream(&["start"]));
        let mut restarted = exploration.clone();
        restarted.restart(1);
        let (one, two) = (
            exploration.draw(2, &mut stream(&["next"])),
            restarted.draw(2, &mut stream(&["next"])),
        );
        assert_eq!(one[0], two[0]);
        assert_ne!(one[1], two[1]);
    }
}
