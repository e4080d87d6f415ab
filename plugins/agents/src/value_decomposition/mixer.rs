//! The mixing network of QMIX: one value of the team that increases with the value of every seat.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | Q_1, .., Q_n | `values` | `[batch, n_seats]` |
//! | s | `state` | `[batch, n_state]` |
//! | W_1, b_1 | `first_weights` (in absolute value), `first_bias` of s | `[batch, n_seats width]`, `[batch, width]` |
//! | W_2, b_2 | `second_weights` (in absolute value), `second_bias` of s | `[batch, width]`, `[batch, 1]` |
//!
//! `Q_tot = elu(Q |W_1(s)| + b_1(s)) |W_2(s)| + b_2(s)`; the three first are affine in s, the last has a hidden layer
//! (Rashid et al. 2018, section 4 and figure 2).

use numerics::activation::Activation;
use numerics::equations::network::Network;
use plan::{Expression, State};
use rand::RngCore;

/// Networks that compute the weights of the mixing network from the state.
#[derive(Debug, Clone)]
pub struct MonotonicMixer {
    first_weights: Network,
    first_bias: Network,
    second_weights: Network,
    second_bias: Network,
}

impl MonotonicMixer {
    /// Describes the networks, and adds their parameters.
    pub fn new(
        [n_state, n_seats, width]: [usize; 3],
        parameters: &mut State<f32>,
        rng: &mut impl RngCore,
    ) -> Self {
        let mut network = |name: &str, sizes: &[usize], activations: &[Activation]| {
            let network = Network::new(format!("mixer.{name}"), sizes, activations);
            network.initialise(1.0, parameters, rng);
            network
        };
        Self {
            first_weights: network("first_weights", &[n_state, n_seats * width], &[]),
            first_bias: network("first_bias", &[n_state, width], &[]),
            second_weights: network("second_weights", &[n_state, width], &[]),
            second_bias: network("second_bias", &[n_state, width, 1], &[Activation::Relu]),
        }
    }

    /// The networks with new names by the function `renamed`.
    #[must_use]
    pub fn map(&self, mut renamed: impl FnMut(&Network) -> Network) -> Self {
        Self {
            first_weights: renamed(&self.first_weights),
            first_bias: renamed(&self.first_bias),
            second_weights: renamed(&self.second_weights),
            second_bias: renamed(&self.second_bias),
        }
    }

    /// All networks.
    #[must_use]
    pub fn networks(&self) -> [&Network; 4] {
        [
            &self.first_weights,
            &self.first_bias,
            &self.second_weights,
            &self.second_bias,
        ]
    }

    /// Value of the team Q_tot, `[batch, 1]`.
    #[must_use]
    pub fn apply<'e>(&self, values: Expression<'e>, state: Expression<'e>) -> Expression<'e> {
        let bias = self.first_bias.apply(state);
        let (weights, width) = (self.first_weights.apply(state).abs(), bias.n_columns());
        let weighted =
            |seat: usize| values.columns(seat..seat + 1) * weights.columns(seat * width..(seat + 1) * width);
        let hidden = elu((0..values.n_columns()).map(weighted).fold(bias, |sum, x| sum + x));
        let weights = self.second_weights.apply(state).abs();
        (hidden * weights).sum_columns() + self.second_bias.apply(state)
    }
}

/// Exponential linear unit: `x` above 0, `e^x - 1` below.
fn elu(x: Expression<'_>) -> Expression<'_> {
    x.relu() + x.clamp(f64::NEG_INFINITY, 0.0).exp() - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random::stream;
    use plan::{Equations, Processor, differences::largest_error};
    use proptest::prelude::*;

    fn mixer(sizes: [usize; 3], seed: &str) -> (MonotonicMixer, State<f32>) {
        let mut parameters = State::default();
        let mixer = MonotonicMixer::new(sizes, &mut parameters, &mut stream(&[seed]));
        (mixer, parameters)
    }

    /// Mixed values of rows of seats' values and of states.
    fn mixed(mixer: &MonotonicMixer, parameters: &mut State<f32>, q: &[&[f32]], state: &[f32]) -> Vec<f32> {
        let equations = Equations::new();
        let rows = q.len();
        let (values, all) = (
            equations.input("values", [rows, q[0].len()]),
            equations.input("state", [rows, state.len()]),
        );
        equations.routine("mix");
        equations.output("mixed", mixer.apply(values, all));
        let mut processor = Processor::<f32>::new(equations.into_graph());
        processor.write("values", &q.concat());
        processor.write("state", &state.repeat(rows));
        processor.run("mix", parameters);
        processor.entries("mixed").to_vec()
    }

    proptest! {
        #[test]
        fn the_value_of_the_team_never_falls_with_that_of_a_seat(
            seed in 0u32..1000,
            q in prop::array::uniform3(-20.0f32..20.0),
            state in prop::array::uniform2(-3.0f32..3.0),
            seat in 0usize..3,
            gain in 0.01f32..10.0,
        ) {
            let (mixer, mut parameters) = mixer([2, 3, 4], &seed.to_string());
            let mut more = q;
            more[seat] += gain;
            let found = mixed(&mixer, &mut parameters, &[&q, &more], &state);
            let (before, after) = (found[0], found[1]);
            // The values are equal where a weight is 0 or the exponential is flat.
            prop_assert!(after >= before - 1e-4 * before.abs().max(1.0), "{before} {after}");
        }
    }

    #[test]
    fn a_mixture_by_hand() {
        let (mixer, mut parameters) = mixer([1, 2, 1], "hand");
        // Weights and biases in the order of the fields: W_1 = s (2, -3) + (0, 0), b_1 = -1, W_2 = -2, b_2 =
        // relu(s) 5 + 7.
        let set: [&[f32]; 10] = [
            &[2.0, -3.0],
            &[0.0, 0.0],
            &[0.0],
            &[-1.0],
            &[0.0],
            &[-2.0],
            &[1.0],
            &[0.0],
            &[5.0],
            &[7.0],
        ];
        let names = mixer.networks().map(Network::parameter_names).concat();
        assert_eq!(names.len(), set.len());
        for (name, set) in names.iter().zip(set) {
            parameters.entries_mut(name).copy_from_slice(set);
        }
        let found = mixed(&mixer, &mut parameters, &[&[1.0, 2.0], &[-1.0, 0.0]], &[1.0]);
        // elu(2 + 3 * 2 - 1) * 2 + 12, and elu(-2 - 1) * 2 + 12.
        assert!((found[0] - 26.0).abs() < 1e-5);
        assert!((found[1] - (2.0 * ((-3.0f32).exp() - 1.0) + 12.0)).abs() < 1e-5);
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let (mixer, parameters) = mixer([2, 3, 4], "gradients");
        let equations = Equations::new();
        let values = equations.constant([2, 3], &[0.5, -1.0, 0.3, -0.4, 0.8, 1.1]);
        let state = equations.constant([2, 2], &[0.7, -0.2, -0.9, 0.4]);
        equations.routine("loss");
        equations.output("loss", mixer.apply(values, state).square().sum());
        let names = mixer.networks().map(Network::parameter_names).concat();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let graph = equations.into_graph();
        let error = largest_error(graph, ["loss", "loss"], &names, &parameters.widened(), &[], 0);
        assert!(error < 1e-6, "{error:e}");
    }
}
