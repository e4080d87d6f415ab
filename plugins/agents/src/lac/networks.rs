//! Networks of the Lyapunov actor-critics, and the meaning of their outputs.

use super::config::Config;
use contract::Rng;
use numerics::equations::{
    network::Network,
    squashed::{Correction, Draw, log_sd, mean, sample},
};
use plan::{Expression, State};

/// Adds a policy network: mean and ln sd of each entry of an action.
pub fn policy(
    config: &Config,
    n_observed: usize,
    n_acted: usize,
    state: &mut State<f32>,
    rng: &mut Rng,
) -> Network {
    let network = described("policy", config, n_observed, Some(2 * n_acted));
    network.initialise_glorot(state, rng);
    network
}

/// Adds a Lyapunov network, which ends in its last hidden layer.
pub fn lyapunov(
    config: &Config,
    n_observed: usize,
    n_acted: usize,
    state: &mut State<f32>,
    rng: &mut Rng,
) -> Network {
    let network = described("lyapunov", config, n_observed + n_acted, None);
    network.initialise_glorot(state, rng);
    network
}

fn described(name: &str, config: &Config, inputs: usize, outputs: Option<usize>) -> Network {
    let hidden = vec![config.width; config.hidden_layers];
    let sizes: Vec<usize> = [inputs].into_iter().chain(hidden).chain(outputs).collect();
    Network::new(name, &sizes, &vec![config.activation; config.hidden_layers])
}

/// `L(s, a)` `[batch, 1]`: the sum of the squares of the last hidden layer.
#[must_use]
pub fn value<'e>(
    lyapunov: &Network,
    observations: Expression<'e>,
    actions: Expression<'e>,
) -> Expression<'e> {
    let last = lyapunov.apply(observations.equations().join(&[observations, actions]));
    last.square().sum_columns()
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
    pub fn head<'e>(self, policy: &Network, observations: Expression<'e>) -> Expression<'e> {
        let head = policy.apply(observations);
        let held = log_sd(head).clamp(self.low, self.high);
        head.equations().join(&[mean(head), held])
    }

    /// A sample of the policy's actions.
    #[must_use]
    pub fn draw<'e>(self, policy: &Network, observations: Expression<'e>) -> Draw<'e> {
        sample(self.head(policy, observations), Correction::Exact)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random::stream;
    use plan::{Equations, Processor};

    fn config() -> Config {
        Config {
            width: 24,
            ..Config::default()
        }
    }

    /// Entries of expressions of inputs without a pattern, with these numbers of columns and 8 rows.
    fn computed<const N: usize, const M: usize>(
        state: &mut State<f32>,
        columns: [usize; N],
        write: impl for<'e> FnOnce(&'e Equations, [Expression<'e>; N]) -> [Expression<'e>; M],
    ) -> [Vec<f32>; M] {
        let equations = Equations::new();
        let inputs = columns.map(|columns| {
            let entries: Vec<f64> = (0..8 * columns).map(|i| (i as f64 * 12.9898).sin()).collect();
            equations.constant([8, columns], &entries)
        });
        equations.routine("compute");
        for (at, found) in write(&equations, inputs).into_iter().enumerate() {
            equations.output(&at.to_string(), found);
        }
        let mut plan = Processor::<f32>::new(equations.into_graph());
        plan.run("compute", state);
        std::array::from_fn(|at| plan.entries(&at.to_string()).to_vec())
    }

    #[test]
    fn the_value_is_the_sum_of_squares_of_the_last_hidden_layer() {
        let mut state = State::default();
        let lyapunov = lyapunov(&config(), 2, 1, &mut state, &mut stream(&["lyapunov"]));
        assert_eq!(lyapunov.sizes(), [3, 24, 24]);
        let [last, values] = computed(&mut state, [2, 1], |equations, [seen, done]| {
            let last = lyapunov.apply(equations.join(&[seen, done]));
            [last, value(&lyapunov, seen, done)]
        });
        for (row, found) in last.chunks(24).zip(values) {
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
        let mut state = State::default();
        let policy = policy(&config(), 2, 3, &mut state, &mut stream(&["policy"]));
        let limits = Limits {
            low: -0.1,
            high: 0.05,
        };
        let [head, free] = computed(&mut state, [2], |_, [seen]| {
            [limits.head(&policy, seen), policy.apply(seen)]
        });
        for (held, free) in head.chunks(6).zip(free.chunks(6)) {
            assert_eq!(held[..3], free[..3]);
            let clamped: Vec<f32> = free[3..].iter().map(|x| x.clamp(-0.1, 0.05)).collect();
            assert_eq!(held[3..], clamped);
        }
        assert!(head.contains(&-0.1) && head.contains(&0.05));
    }
}
