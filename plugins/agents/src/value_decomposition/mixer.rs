//! The mixing network of QMIX: one value of the team that increases with the value of every seat.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | Q_1, .., Q_n | `values` | `[batch, n_seats]` |
//! | s | `state` | `[batch, n_state]` |
//! | W_1, b_1 | `first_weights` (in absolute value), `first_bias` of s | `[batch, n_seats, width]`, `[batch, width]` |
//! | W_2, b_2 | `second_weights` (in absolute value), `second_bias` of s | `[batch, width]`, `[batch, 1]` |
//!
//! `Q_tot = elu(Q |W_1(s)| + b_1(s)) |W_2(s)| + b_2(s)`; the three first are affine in s, the last has a hidden layer
//! (Rashid et al. 2018, section 4 and figure 2).

use burn::{module::Module, tensor::Tensor};
use numerics::network::{Activation, Mlp, device};
use rand::RngCore;

/// Networks that compute the weights of the mixing network from the state.
#[derive(Module, Debug, Default)]
pub struct MonotonicMixer {
    first_weights: Mlp,
    first_bias: Mlp,
    second_weights: Mlp,
    second_bias: Mlp,
    #[module(skip)]
    width: usize,
}

impl MonotonicMixer {
    /// Creates the networks.
    pub fn new(n_state: usize, n_seats: usize, width: usize, rng: &mut impl RngCore) -> Self {
        let device = device().autodiff();
        let mut affine = |outputs: usize| Mlp::new(&[n_state, outputs], &[], 1.0, rng, &device);
        let (first_weights, first_bias, second_weights) =
            (affine(n_seats * width), affine(width), affine(width));
        Self {
            first_weights,
            first_bias,
            second_weights,
            second_bias: Mlp::new(&[n_state, width, 1], &[Activation::Relu], 1.0, rng, &device),
            width,
        }
    }

    /// Value of the team Q_tot, `[batch, 1]`.
    #[must_use]
    pub fn forward(&self, values: Tensor<2>, state: &Tensor<2>) -> Tensor<2> {
        let [batch, n_seats] = values.dims();
        let weights = self.first_weights.forward(state.clone()).abs();
        let weighted = values.unsqueeze_dim::<3>(2) * weights.reshape([batch, n_seats, self.width]);
        let sum = weighted.sum_dim(1).reshape([batch, self.width]);
        let hidden = elu(sum + self.first_bias.forward(state.clone()));
        let weights = self.second_weights.forward(state.clone()).abs();
        (hidden * weights).sum_dim(1) + self.second_bias.forward(state.clone())
    }
}

/// Exponential linear unit: `x` above 0, `e^x - 1` below.
fn elu(x: Tensor<2>) -> Tensor<2> {
    x.clone().clamp_min(0.0) + x.clamp_max(0.0).exp() - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random::stream;
    use numerics::{
        network::{matrix, values},
        optimizer::gradients,
        parameters::{parameters, with_parameters},
    };
    use proptest::prelude::*;

    fn mixer(seed: &str) -> MonotonicMixer {
        MonotonicMixer::new(2, 3, 4, &mut stream(&[seed]))
    }

    fn mixed(mixer: &MonotonicMixer, q: [f32; 3], state: [f32; 2]) -> f32 {
        values(
            mixer
                .valid()
                .forward(matrix(q.to_vec(), 3), &matrix(state.to_vec(), 2)),
        )[0]
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
            let mixer = mixer(&seed.to_string());
            let mut more = q;
            more[seat] += gain;
            let (before, after) = (mixed(&mixer, q, state), mixed(&mixer, more, state));
            // The values are equal where a weight is 0 or the exponential is flat.
            prop_assert!(after >= before - 1e-4 * before.abs().max(1.0), "{before} {after}");
        }
    }

    #[test]
    fn a_mixture_by_hand() {
        let mixer = MonotonicMixer::new(1, 2, 1, &mut stream(&["hand"]));
        let mut numbers = parameters(&mixer);
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
        assert_eq!(numbers.len(), set.len());
        numbers
            .iter_mut()
            .zip(set)
            .for_each(|(parameter, set)| parameter.values = set.to_vec());
        let mixer = with_parameters(mixer, &numbers).unwrap();
        let of = |q: [f32; 2]| {
            values(
                mixer
                    .valid()
                    .forward(matrix(q.to_vec(), 2), &matrix(vec![1.0], 1)),
            )[0]
        };
        // elu(2 + 3 * 2 - 1) * 2 + 12, and elu(-2 - 1) * 2 + 12.
        assert!((of([1.0, 2.0]) - 26.0).abs() < 1e-5);
        assert!((of([-1.0, 0.0]) - (2.0 * ((-3.0f32).exp() - 1.0) + 12.0)).abs() < 1e-5);
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let mixer = mixer("gradients");
        let (q, state) = (
            matrix(vec![0.5, -1.0, 0.3, -0.4, 0.8, 1.1], 3),
            matrix(vec![0.7, -0.2, -0.9, 0.4], 2),
        );
        let loss = |mixer: &MonotonicMixer| mixer.forward(q.clone(), &state).powf_scalar(2.0).sum();
        let analytic = gradients(&mixer, &mut loss(&mixer).backward());
        let numbers = parameters(&mixer);
        let mut largest = 0.0f64;
        for (p, parameter) in numbers.iter().enumerate() {
            assert_eq!(analytic[p].len(), parameter.values.len(), "{}", parameter.name);
            for (i, gradient) in analytic[p].iter().map(|g| f64::from(*g)).enumerate() {
                let at = |step: f32| {
                    let mut moved = numbers.clone();
                    moved[p].values[i] += step;
                    f64::from(values(loss(&with_parameters(mixer.clone(), &moved).unwrap()))[0])
                };
                let difference = (at(2e-3) - at(-2e-3)) / 4e-3;
                assert!(
                    (difference - gradient).abs() < 2e-2 * (1.0 + gradient.abs()),
                    "{} {i}: {difference} {gradient}",
                    parameter.name
                );
                largest = largest.max(gradient.abs());
            }
        }
        assert!(largest > 0.1, "{largest}");
    }
}
