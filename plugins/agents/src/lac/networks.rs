//! Networks of the Lyapunov actor-critics, and the meaning of their outputs.

use super::config::Config;
use burn::tensor::Tensor;
use contract::Rng;
use numerics::{
    gaussian_head::mean_and_log_sd,
    network::{Mlp, device},
    squashed::{Draw, sample_exact},
};

/// Creates a policy network: mean and ln sd of each entry of an action.
pub fn policy(config: &Config, n_observed: usize, n_acted: usize, rng: &mut Rng) -> Mlp {
    network(config, n_observed, Some(2 * n_acted), rng)
}

/// Creates a Lyapunov network, which ends in its last hidden layer.
pub fn lyapunov(config: &Config, n_observed: usize, n_acted: usize, rng: &mut Rng) -> Mlp {
    network(config, n_observed + n_acted, None, rng)
}

fn network(config: &Config, inputs: usize, outputs: Option<usize>, rng: &mut Rng) -> Mlp {
    let hidden = vec![config.width; config.hidden_layers];
    let sizes: Vec<usize> = [inputs].into_iter().chain(hidden).chain(outputs).collect();
    let activations = vec![config.activation; config.hidden_layers];
    Mlp::glorot(&sizes, &activations, rng, &device().autodiff())
}

/// `L(s, a)` `[batch, 1]`: the sum of the squares of the last hidden layer.
#[must_use]
pub fn value(lyapunov: &Mlp, observations: &Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
    let last = lyapunov.forward(Tensor::cat(vec![observations.clone(), actions], 1));
    last.square().sum_dim(1)
}

/// Limits of ln sd.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Smallest value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
}

impl Limits {
    /// Outputs of a policy with ln sd clamped to the limits.
    #[must_use]
    pub fn head(self, policy: &Mlp, observations: &Tensor<2>) -> Tensor<2> {
        let (mean, log_sd) = mean_and_log_sd(policy.forward(observations.clone()));
        Tensor::cat(vec![mean, log_sd.clamp(self.low, self.high)], 1)
    }

    /// A sample of the policy's actions.
    pub fn draw(self, policy: &Mlp, observations: &Tensor<2>, rng: &mut Rng) -> Draw {
        sample_exact(self.head(policy, observations), rng)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random::stream;
    use numerics::network::{matrix, values};

    fn config() -> Config {
        Config {
            width: 24,
            ..Config::default()
        }
    }

    fn rows(n: usize, columns: usize) -> Tensor<2> {
        matrix(
            (0..n * columns).map(|i| (i as f32 * 12.9898).sin()).collect(),
            columns,
        )
    }

    #[test]
    fn the_value_is_the_sum_of_squares_of_the_last_hidden_layer() {
        let lyapunov = lyapunov(&config(), 2, 1, &mut stream(&["lyapunov"]));
        assert_eq!(lyapunov.sizes(), [3, 24, 24]);
        let (seen, done) = (rows(8, 2), rows(8, 1));
        let last = values(lyapunov.forward(Tensor::cat(vec![seen.clone(), done.clone()], 1)));
        for (row, found) in last.chunks(24).zip(values(value(&lyapunov, &seen, done))) {
            let expected: f32 = row.iter().map(|h| h * h).sum();
            assert!((found - expected).abs() < 1e-5 * (1.0 + expected) && found > 0.0);
        }
        // Leaky rectifiers follow the last layer, too.
        let (above, below) = last.iter().partition::<Vec<f32>, _>(|h| **h > 0.0);
        let largest = |entries: &[f32]| entries.iter().fold(0.0f32, |most, h| most.max(h.abs()));
        assert!(largest(&below) < 0.1 * largest(&above));
    }

    #[test]
    fn deviations_stay_within_their_limits() {
        let policy = policy(&config(), 2, 3, &mut stream(&["policy"]));
        let limits = Limits {
            low: -0.1,
            high: 0.05,
        };
        let head = values(limits.head(&policy, &rows(8, 2)));
        let free = values(policy.forward(rows(8, 2)));
        for (held, free) in head.chunks(6).zip(free.chunks(6)) {
            assert_eq!(held[..3], free[..3]);
            let clamped: Vec<f32> = free[3..].iter().map(|x| x.clamp(-0.1, 0.05)).collect();
            assert_eq!(held[3..], clamped);
        }
        assert!(head.contains(&-0.1) && head.contains(&0.05));
    }
}
