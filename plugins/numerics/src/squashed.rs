//! Gaussian policies squashed by tanh, with mean and standard deviation from a head
//! ([`crate::gaussian_head`]).
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | mu, ln sigma | the two halves of `head` | `[rows, n]` each |
//! | epsilon | noise from the caller's stream | `[rows, n]` |
//! | x = mu + sigma epsilon | `candidate` | `[rows, n]` |
//! | a = tanh x | `action` | `[rows, n]` |
//! | ln pi(a) = ln N(x; mu, sigma) - sum ln(1 - a^2 + 1e-6) | `log_density` | `[rows, 1]` |
//!
//! The small number keeps the density of a saturated action finite, as public code of soft actor-critic has
//! it (Haarnoja et al. 2018); [`sample_exact`] has the density without it, in a form that needs none. Apart
//! from that, a draw and a density are one autodiff operation each, with the gradients by hand: with `c = 2 a
//! (1 - a^2) / (1 - a^2 + 1e-6)` the density of a draw has `d/dmu = c` and `d/dln sigma = c sigma epsilon -
//! 1`; that of a given candidate, with `z = (x - mu) / sigma`, has `d/dmu = z / sigma`, `d/dln sigma = z^2 -
//! 1` and `d/dx = c - z / sigma`. Where ln sigma is held, it has no gradient.

use crate::activation::tanh;
use crate::dense::row_by_row;
use crate::gaussian::{HALF_LN_TWO_PI, standard_normal};
use crate::gaussian_head::{LOG_SD_LIMITS, candidate, mean, mean_and_log_sd};
use crate::network::{matrix, values};
use burn::Tensor;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind, unary};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::{TensorData, activation::softplus};
use rand::RngCore;
use std::marker::PhantomData;

const SMALL: f32 = 1e-6;
/// Factor of a stored action before the inverse of tanh, so that an action on the boundary has a finite
/// candidate.
const INSIDE: f64 = 0.9999;

/// A reparameterised draw; gradients flow to its head.
#[derive(Debug, Clone)]
pub struct Draw {
    /// Action `tanh(candidate)` `[rows, n]`.
    pub action: Tensor<2>,
    /// Point before the tangent `[rows, n]`.
    pub candidate: Tensor<2>,
    /// Log density of the action `[rows, 1]`.
    pub log_density: Tensor<2>,
}

/// Draws one action per row of `head` `[rows, 2 n]`.
pub fn sample(head: Tensor<2>, rng: &mut impl RngCore) -> Draw {
    let [n_rows, n_columns] = head.dims();
    let n = n_columns / 2;
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    let noise = matrix((0..n_rows * n).map(|_| standard_normal(rng) as f32).collect(), n);
    let parts = Tensor::<2>::from_dispatch(<Dispatch as SquashedOperation>::draw(
        head.into_dispatch(),
        noise.into_dispatch(),
    ));
    let columns = |from: usize, to: usize| parts.clone().slice([0..n_rows, from..to]);
    Draw {
        action: columns(0, n),
        candidate: columns(n, 2 * n),
        log_density: columns(2 * n, 2 * n + 1),
    }
}

/// Draws as [`sample`] does from the same stream, with the exact log density `ln N(x; mu, sigma) - sum ln(1 -
/// a^2)` on the cube.
pub fn sample_exact(head: Tensor<2>, rng: &mut impl RngCore) -> Draw {
    let (mean, log_sd) = mean_and_log_sd(head);
    let (candidate, log_density) = candidate(mean, log_sd, rng);
    // ln(1 - tanh(x)^2) = 2 (ln 2 - x - softplus(-2 x)) stays finite where tanh rounds to one.
    let log_derivative =
        (candidate.clone() + softplus(candidate.clone() * -2.0, 1.0) - std::f64::consts::LN_2) * -2.0;
    Draw {
        action: candidate.clone().tanh(),
        candidate,
        log_density: log_density - log_derivative.sum_dim(1),
    }
}

/// Log density `[rows, 1]` of given candidates `[rows, n]`; gradients flow to the head `[rows, 2 n]` and to
/// the candidates.
#[must_use]
pub fn log_density(head: Tensor<2>, candidate: Tensor<2>) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as SquashedOperation>::density(
        head.into_dispatch(),
        candidate.into_dispatch(),
    ))
}

/// Action `tanh mu` `[rows, n]` of each row of `head`.
#[must_use]
pub fn mean_action(head: Tensor<2>) -> Tensor<2> {
    mean(head).tanh()
}

/// Candidates `atanh(0.9999 a)` of stored actions, a plain tensor.
#[must_use]
pub fn candidate_of(action: Tensor<2>) -> Tensor<2> {
    let columns = action.dims()[1];
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    let unsquashed = values(action)
        .into_iter()
        .map(|action| (INSIDE * f64::from(action)).atanh() as f32);
    matrix(unsquashed.collect(), columns)
}

/// The operations on the tensors of one backend.
#[backend_extension(Flex, Autodiff)]
trait SquashedOperation: Backend {
    /// Action, candidate and log density `[rows, 2 n + 1]` from head and noise.
    fn draw(head: FloatTensor<Self>, noise: FloatTensor<Self>) -> FloatTensor<Self>;

    /// Log density `[rows, 1]` from head and candidates.
    fn density(head: FloatTensor<Self>, candidate: FloatTensor<Self>) -> FloatTensor<Self>;
}

/// Backward passes over plain tensors. A further backend implements them and is named as a selector above.
trait SquashedPasses: SquashedOperation {
    /// Gradient in the head from the head, the draw and the upstream gradient.
    fn draw_gradient(
        head: FloatTensor<Self>,
        drawn: FloatTensor<Self>,
        upstream: FloatTensor<Self>,
    ) -> FloatTensor<Self>;

    /// Gradients in the head and in the candidates.
    fn density_gradients(
        head: FloatTensor<Self>,
        candidate: FloatTensor<Self>,
        upstream: FloatTensor<Self>,
    ) -> [FloatTensor<Self>; 2];
}

/// Clamped ln sigma, and its derivative: 1 within the limits, else 0.
fn clamped(log_sd: f32) -> (f32, f32) {
    let [low, high] = LOG_SD_LIMITS;
    // The comparisons leave a NaN as it is.
    let value = if log_sd < low { low } else { log_sd };
    let value = if value > high { high } else { value };
    (value, if log_sd < low || log_sd > high { 0.0 } else { 1.0 })
}

/// `1 - tanh(x)^2` by way of `e^(-2 |x|)`: the difference from a rounded tangent near one would have no
/// digits left.
fn rest(x: f32) -> f32 {
    let e = (-2.0 * x.abs()).exp();
    4.0 * e / ((1.0 + e) * (1.0 + e))
}

/// Derivative in x of `-ln(1 - a^2 + 1e-6)`, the number c of the header.
fn correction_slope(x: f32) -> f32 {
    let rest = rest(x);
    2.0 * tanh(x) * rest / (rest + SMALL)
}

/// Term of one entry in ln pi, from z, ln sigma and x.
#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
fn log_term(z: f32, log_sd: f32, x: f32) -> f32 {
    -0.5 * z * z - log_sd - HALF_LN_TWO_PI as f32 - (rest(x) + SMALL).ln()
}

fn tensor(values: Vec<f32>, n_columns: usize) -> FloatTensor<Flex> {
    let n_rows = values.len() / n_columns;
    FloatTensor::<Flex>::from_data(TensorData::new(values, [n_rows, n_columns]))
}

impl SquashedOperation for Flex {
    fn draw(head: FloatTensor<Self>, noise: FloatTensor<Self>) -> FloatTensor<Self> {
        let n = noise.layout().shape()[1];
        let (head, noise) = (row_by_row(head), row_by_row(noise));
        let mut drawn = Vec::with_capacity(noise.storage::<f32>().len() / n * (2 * n + 1));
        for (head, noise) in head
            .storage::<f32>()
            .chunks_exact(2 * n)
            .zip(noise.storage::<f32>().chunks_exact(n))
        {
            let candidate = |i: usize| head[i] + clamped(head[n + i]).0.exp() * noise[i];
            let start = drawn.len();
            drawn.extend((0..n).map(|i| tanh(candidate(i))));
            drawn.extend((0..n).map(candidate));
            let density = (0..n)
                .map(|i| log_term(noise[i], clamped(head[n + i]).0, drawn[start + n + i]))
                .sum();
            drawn.push(density);
        }
        tensor(drawn, 2 * n + 1)
    }

    fn density(head: FloatTensor<Self>, candidate: FloatTensor<Self>) -> FloatTensor<Self> {
        let n = candidate.layout().shape()[1];
        let (head, candidate) = (row_by_row(head), row_by_row(candidate));
        let rows = head
            .storage::<f32>()
            .chunks_exact(2 * n)
            .zip(candidate.storage::<f32>().chunks_exact(n));
        let density = rows.map(|(head, x)| {
            let term = |i: usize| {
                let log_sd = clamped(head[n + i]).0;
                log_term((x[i] - head[i]) * (-log_sd).exp(), log_sd, x[i])
            };
            (0..n).map(term).sum()
        });
        tensor(density.collect(), 1)
    }
}

impl SquashedPasses for Flex {
    fn draw_gradient(
        head: FloatTensor<Self>,
        drawn: FloatTensor<Self>,
        upstream: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        let n = head.layout().shape()[1] / 2;
        let (head, drawn, upstream) = (row_by_row(head), row_by_row(drawn), row_by_row(upstream));
        let rows = drawn
            .storage::<f32>()
            .chunks_exact(2 * n + 1)
            .zip(upstream.storage::<f32>().chunks_exact(2 * n + 1));
        let mut gradient = vec![0.0; head.storage::<f32>().len()];
        for ((out, head), (drawn, up)) in gradient
            .chunks_exact_mut(2 * n)
            .zip(head.storage::<f32>().chunks_exact(2 * n))
            .zip(rows)
        {
            for i in 0..n {
                let candidate = drawn[n + i];
                // Along the draw, x moves by 1 with mu and by sigma epsilon = x - mu with ln sigma.
                let in_x = up[i] * rest(candidate) + up[n + i] + up[2 * n] * correction_slope(candidate);
                out[i] = in_x;
                out[n + i] = (in_x * (candidate - head[i]) - up[2 * n]) * clamped(head[n + i]).1;
            }
        }
        tensor(gradient, 2 * n)
    }

    fn density_gradients(
        head: FloatTensor<Self>,
        candidate: FloatTensor<Self>,
        upstream: FloatTensor<Self>,
    ) -> [FloatTensor<Self>; 2] {
        let n = candidate.layout().shape()[1];
        let (head, candidate, upstream) = (row_by_row(head), row_by_row(candidate), row_by_row(upstream));
        let (x, upstream) = (candidate.storage::<f32>(), upstream.storage::<f32>());
        let (mut in_head, mut in_candidate) = (vec![0.0; 2 * x.len()], vec![0.0; x.len()]);
        for (row, (head, up)) in head
            .storage::<f32>()
            .chunks_exact(2 * n)
            .zip(upstream)
            .enumerate()
        {
            for i in 0..n {
                let x = x[row * n + i];
                let (log_sd, free) = clamped(head[n + i]);
                let inverse_sd = (-log_sd).exp();
                let z = (x - head[i]) * inverse_sd;
                in_head[row * 2 * n + i] = up * z * inverse_sd;
                in_head[row * 2 * n + n + i] = up * (z * z - 1.0) * free;
                in_candidate[row * n + i] = up * (correction_slope(x) - z * inverse_sd);
            }
        }
        [tensor(in_head, 2 * n), tensor(in_candidate, n)]
    }
}

impl<B: SquashedPasses, C: CheckpointStrategy> SquashedOperation for Autodiff<B, C> {
    fn draw(head: FloatTensor<Self>, noise: FloatTensor<Self>) -> FloatTensor<Self> {
        let (node, head) = (head.node(), head.into_primitive());
        let drawn = B::draw(head.clone(), noise.into_primitive());
        match DrawBackward::<B>(PhantomData)
            .prepare::<C>([node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(operation) => operation.finish((head, drawn.clone()), drawn),
            OpsKind::UnTracked(operation) => operation.finish(drawn),
        }
    }

    fn density(head: FloatTensor<Self>, candidate: FloatTensor<Self>) -> FloatTensor<Self> {
        let nodes = [head.node(), candidate.node()];
        let (head, candidate) = (head.into_primitive(), candidate.into_primitive());
        let density = B::density(head.clone(), candidate.clone());
        match DensityBackward::<B>(PhantomData)
            .prepare::<C>(nodes)
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(operation) => operation.finish((head, candidate), density),
            OpsKind::UnTracked(operation) => operation.finish(density),
        }
    }
}

/// Backward step of a draw; its state is the head and the draw.
#[derive(Debug)]
struct DrawBackward<B>(PhantomData<fn() -> B>);

impl<B: SquashedPasses> Backward<B, 1> for DrawBackward<B> {
    type State = (FloatTensor<B>, FloatTensor<B>);

    fn backward(self, operation: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (head, drawn) = operation.state;
        unary::<B, _>(operation.parents, operation.node, gradients, |upstream| {
            B::draw_gradient(head, drawn, upstream)
        });
    }
}

/// Backward step of a density; its state is the head and the candidates.
#[derive(Debug)]
struct DensityBackward<B>(PhantomData<fn() -> B>);

impl<B: SquashedPasses> Backward<B, 2> for DensityBackward<B> {
    type State = (FloatTensor<B>, FloatTensor<B>);

    fn backward(self, operation: Ops<Self::State, 2>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (head, candidate) = operation.state;
        let found = B::density_gradients(head, candidate, gradients.consume::<B>(&operation.node));
        for (node, gradient) in operation.parents.into_iter().zip(found) {
            if let Some(node) = node {
                gradients.register::<B>(node.id, gradient);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussian;
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    /// Two rows of two actions; the last ln sigma is above its limit.
    const HEAD: [f32; 8] = [0.3, -0.8, -0.5, 0.2, 1.1, 0.1, -1.0, 2.5];
    const CANDIDATES: [f32; 4] = [0.4, -1.2, 0.9, 0.05];

    fn rng() -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(12)
    }

    fn tracked(values: &[f32], columns: usize) -> Tensor<2> {
        Tensor::<2>::from_inner(matrix(values.to_vec(), columns)).require_grad()
    }

    /// Sum with a different weight for every entry of action, candidate and density.
    fn drawn_loss(draw: Draw) -> Tensor<1> {
        let weights = |from: f32| matrix((0..4u8).map(|i| from - 0.7 * f32::from(i)).collect(), 2);
        (draw.action * weights(1.0)).sum()
            + (draw.candidate * weights(0.3)).sum()
            + (draw.log_density * matrix(vec![1.5, -0.5], 1)).sum()
    }

    fn density_loss(head: Tensor<2>, candidate: Tensor<2>) -> Tensor<1> {
        (log_density(head, candidate) * matrix(vec![1.5, -0.5], 1)).sum()
    }

    fn assert_differences(
        numbers: &[f32],
        columns: usize,
        gradient: &[f32],
        loss: impl Fn(Tensor<2>) -> Tensor<1>,
    ) {
        for (i, gradient) in gradient.iter().enumerate() {
            let at = |step: f32| {
                let mut moved = numbers.to_vec();
                moved[i] += step;
                values(loss(matrix(moved, columns)))[0]
            };
            let difference = (at(0.01) - at(-0.01)) / 0.02;
            assert!(
                (difference - gradient).abs() < 5e-3 * (1.0 + gradient.abs()),
                "{i}: {difference} {gradient}"
            );
        }
    }

    #[test]
    fn the_gradients_of_draws_agree_with_finite_differences() {
        let draws: [fn(Tensor<2>) -> Draw; 2] = [
            |head| sample(head, &mut rng()),
            |head| sample_exact(head, &mut rng()),
        ];
        for draw in draws {
            let head = tracked(&HEAD, 4);
            let gradient = values(head.grad(&drawn_loss(draw(head.clone())).backward()).unwrap());
            assert_differences(&HEAD, 4, &gradient, |head| drawn_loss(draw(head)));
            assert_eq!(gradient[7], 0.0);
        }
    }

    #[test]
    fn the_gradients_of_a_density_agree_with_finite_differences() {
        let (head, candidate) = (tracked(&HEAD, 4), tracked(&CANDIDATES, 2));
        let gradients = density_loss(head.clone(), candidate.clone()).backward();
        let (in_head, in_candidate) = (
            values(head.grad(&gradients).unwrap()),
            values(candidate.grad(&gradients).unwrap()),
        );
        let plain = |values: &[f32], columns| matrix(values.to_vec(), columns);
        assert_differences(&HEAD, 4, &in_head, |head| {
            density_loss(head, plain(&CANDIDATES, 2))
        });
        assert_differences(&CANDIDATES, 2, &in_candidate, |candidate| {
            density_loss(plain(&HEAD, 4), candidate)
        });
    }

    #[test]
    fn a_draw_has_the_density_of_its_candidate_and_that_of_the_exact_form() {
        let numbers = [0.3, -0.8, -0.5, 0.2, 1.1, 0.1, -1.0, 1.5];
        let head = matrix(numbers.to_vec(), 4);
        let (draw, exact) = (
            sample(head.clone(), &mut rng()),
            sample_exact(head.clone(), &mut rng()),
        );
        let close =
            |a: Tensor<2>, b: Tensor<2>| values(a).iter().zip(values(b)).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(close(
            draw.log_density.clone(),
            log_density(head, draw.candidate.clone())
        ));
        assert!(close(draw.action, exact.action) && close(draw.candidate, exact.candidate));
        assert!(close(draw.log_density, exact.log_density));
    }

    #[test]
    fn the_exact_density_is_that_of_the_host() {
        let mut rng = rng();
        let got = values(sample_exact(matrix(HEAD.to_vec(), 4), &mut rng.clone()).log_density);
        for (head, got) in HEAD.chunks(4).zip(got) {
            let held = |x: &f32| f64::from(x.min(LOG_SD_LIMITS[1]));
            let (mean, log_sd) = ([0, 1].map(|i| f64::from(head[i])), [2, 3].map(|i| held(&head[i])));
            let candidate = gaussian::sample(&mean, &log_sd, &mut rng);
            let want = gaussian::squashed_log_density(&mean, &log_sd, &candidate);
            assert!(
                (f64::from(got) - want).abs() < 1e-5 * want.abs().max(1.0),
                "{got} {want}"
            );
        }
    }

    #[test]
    fn saturated_actions_keep_a_density_and_a_candidate() {
        let draw = sample(matrix(vec![40.0, -3.0], 2), &mut rng());
        assert!(values(draw.action.clone()) == [1.0] && values(draw.log_density)[0].is_finite());
        assert!((values(candidate_of(draw.action))[0] - 4.9517).abs() < 1e-3);
        let exact = sample_exact(matrix(vec![60.0, -60.0, -3.0, -3.0], 4), &mut rng());
        assert!(values(exact.log_density)[0].is_finite());
    }
}
