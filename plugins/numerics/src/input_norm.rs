//! Batch normalisation of a network's inputs; forward and backward are one autodiff operation.
//!
//! Ioffe and Szegedy 2015, "Batch normalization", arXiv:1502.03167, algorithm 1, on the inputs alone; scale
//! and shift are learned.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | x, y | input, output | `[rows, columns]` |
//! | mu_B, sigma_B^2 | mean and biased variance of each column | `[columns]` |
//! | gamma, beta | `weight` (starts at 1), `bias` (starts at 0) | `[columns]` |
//! | epsilon | [`EPSILON`] | scalar |
//!
//! `y = gamma (x - mu_B) / sqrt(sigma_B^2 + epsilon) + beta`. Backward, with `n` rows and `h` the
//! standardised input: `dgamma = sum(dy h)`, `dbeta = sum(dy)`, `dx = gamma (n dy - dbeta - h dgamma) / (n
//! sqrt(sigma_B^2 + epsilon))`.
//!
//! Where single rows are evaluated (a policy that acts), [`RunningMoments`] replace those of the batch.

use crate::dense::{add_rows, row_by_row};
use crate::network::{Activation, Mlp, device, values};
use crate::tensor_file::{HostTensor, TensorFile, TensorFileError};
use burn::Tensor;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::module::{Module, Param};
use burn::tensor::{Device, TensorData};
use std::marker::PhantomData;

/// Summand that prevents division by zero for a constant column (PyTorch's default).
pub const EPSILON: f32 = 1e-5;
/// Weight of a new batch in the running moments (PyTorch's default).
pub const MOMENTUM: f32 = 0.1;

/// Learned scale and shift of each input.
#[derive(Module, Debug)]
pub struct InputNorm {
    weight: Param<Tensor<1>>,
    bias: Param<Tensor<1>>,
}

/// A fully connected network whose inputs may be normalised. A default one is a placeholder.
#[derive(Module, Debug, Default)]
pub struct NormalisedMlp {
    norm: Option<InputNorm>,
    mlp: Mlp,
}

/// Running mean and unbiased variance of each input.
#[derive(Debug, Clone, PartialEq)]
pub struct RunningMoments {
    mean: Vec<f32>,
    variance: Vec<f32>,
}

impl InputNorm {
    /// Creates scale 1 and shift 0 for each of `n_inputs`.
    #[must_use]
    pub fn new(n_inputs: usize, device: &Device) -> Self {
        let parameter = |value| {
            Param::from_tensor(Tensor::from_data(
                TensorData::new(vec![value; n_inputs], [n_inputs]),
                device,
            ))
        };
        Self {
            weight: parameter(1.0f32),
            bias: parameter(0.0),
        }
    }

    /// Inputs `[rows, inputs]` normalised by their own moments.
    #[must_use]
    pub fn by_batch(&self, input: Tensor<2>) -> Tensor<2> {
        let parts = (
            input.into_dispatch(),
            self.weight.val().into_dispatch(),
            self.bias.val().into_dispatch(),
        );
        Tensor::from_dispatch(<Dispatch as NormOperation>::normalised(parts.0, parts.1, parts.2))
    }

    /// Inputs `[rows, inputs]` normalised by running moments.
    #[must_use]
    pub fn by_moments(&self, input: Tensor<2>, moments: &RunningMoments) -> Tensor<2> {
        let row = |numbers: Vec<f32>| {
            Tensor::<2>::from_data(TensorData::new(numbers, [1, moments.mean.len()]), &device())
        };
        let inverse_sd = row(moments
            .variance
            .iter()
            .map(|variance| 1.0 / (variance + EPSILON).sqrt())
            .collect());
        (input - row(moments.mean.clone())) * (inverse_sd * self.weight.val().unsqueeze())
            + self.bias.val().unsqueeze()
    }
}

impl NormalisedMlp {
    /// Creates a network; its inputs are normalised where `norm` is given.
    #[must_use]
    pub fn new(norm: Option<InputNorm>, mlp: Mlp) -> Self {
        Self { norm, mlp }
    }

    /// Outputs `[rows, outputs]`; the inputs `[rows, inputs]` are normalised by their own moments.
    #[must_use]
    pub fn by_batch(&self, input: Tensor<2>) -> Tensor<2> {
        self.mlp.forward(match &self.norm {
            Some(norm) => norm.by_batch(input),
            None => input,
        })
    }

    /// Outputs `[rows, outputs]`; the inputs `[rows, inputs]` are normalised by running moments.
    #[must_use]
    pub fn by_moments(&self, input: Tensor<2>, moments: &RunningMoments) -> Tensor<2> {
        self.mlp.forward(match &self.norm {
            Some(norm) => norm.by_moments(input, moments),
            None => input,
        })
    }

    /// Whether inputs are normalised.
    #[must_use]
    pub fn normalises(&self) -> bool {
        self.norm.is_some()
    }

    /// Layer sizes, input first.
    #[must_use]
    pub fn sizes(&self) -> Vec<usize> {
        self.mlp.sizes()
    }

    /// Activation of each hidden layer.
    #[must_use]
    pub fn activations(&self) -> &[Activation] {
        self.mlp.activations()
    }
}

impl RunningMoments {
    /// Moments with mean 0 and variance 1, before the first batch.
    #[must_use]
    pub fn new(n_inputs: usize) -> Self {
        Self {
            mean: vec![0.0; n_inputs],
            variance: vec![1.0; n_inputs],
        }
    }

    /// Moves towards the moments of a batch `[rows, inputs]`, with its unbiased variance.
    #[allow(clippy::cast_precision_loss, reason = "a batch has far fewer than 2^24 rows")]
    pub fn absorb(&mut self, batch: &Tensor<2>) {
        let [n_rows, n_inputs] = batch.dims();
        let (mean, variance) = moments(&values(batch.clone()), n_inputs);
        let unbiased = n_rows as f32 / (n_rows as f32 - 1.0).max(1.0);
        let follow = |running: &mut f32, new: f32| *running += MOMENTUM * (new - *running);
        self.mean
            .iter_mut()
            .zip(mean)
            .for_each(|(running, new)| follow(running, new));
        self.variance
            .iter_mut()
            .zip(variance)
            .for_each(|(running, new)| follow(running, new * unbiased));
    }

    /// Stores the moments under `prefix` in a file.
    pub fn store(&self, prefix: &str, file: &mut TensorFile) {
        file.insert_vector(format!("{prefix}.running_mean"), self.mean.clone());
        file.insert_vector(format!("{prefix}.running_variance"), self.variance.clone());
    }

    /// Restores the moments that [`RunningMoments::store`] wrote under `prefix`.
    ///
    /// # Errors
    /// [`TensorFileError`] where they are missing or of another number of inputs.
    pub fn restore(&mut self, prefix: &str, file: &TensorFile) -> Result<(), TensorFileError> {
        let read = |name: &str| {
            let HostTensor { shape, values } = file.get(&format!("{prefix}.{name}"))?;
            if values.len() == self.mean.len() {
                return Ok(values.clone());
            }
            Err(TensorFileError::Shape {
                expected: format!("{} moments", self.mean.len()),
                found: format!("{shape:?}"),
            })
        };
        (self.mean, self.variance) = (read("running_mean")?, read("running_variance")?);
        Ok(())
    }
}

/// Mean and biased variance of each column.
#[allow(clippy::cast_precision_loss, reason = "a batch has far fewer than 2^24 rows")]
fn moments(rows: &[f32], n_columns: usize) -> (Vec<f32>, Vec<f32>) {
    let n_rows = (rows.len() / n_columns) as f32;
    let mut mean = add_rows(rows, n_columns);
    mean.iter_mut().for_each(|sum| *sum /= n_rows);
    let mut variance = vec![0.0; n_columns];
    for row in rows.chunks_exact(n_columns) {
        variance
            .iter_mut()
            .zip(row)
            .zip(&mean)
            .for_each(|((sum, x), mean)| *sum += (x - mean) * (x - mean));
    }
    variance.iter_mut().for_each(|sum| *sum /= n_rows);
    (mean, variance)
}

/// The operation on the tensors of one backend.
#[backend_extension(Flex, Autodiff)]
trait NormOperation: Backend {
    /// Output `y` from `x`, `gamma` and `beta`.
    fn normalised(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
    ) -> FloatTensor<Self>;
}

/// State that the backward step needs: the standardised input, `gamma` and `1 / sqrt(sigma_B^2 + epsilon)`.
#[derive(Debug, Clone)]
struct State<B: Backend> {
    standardised: FloatTensor<B>,
    weight: FloatTensor<B>,
    inverse_sd: Vec<f32>,
}

/// Passes over plain tensors. A further backend implements them and is named as a selector above.
trait NormPasses: Backend {
    /// Output `y` with the state that the backward step needs.
    fn forward(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
    ) -> (FloatTensor<Self>, State<Self>);

    /// Gradients `dgamma` and `dbeta`, and `dx` where its parent is tracked.
    fn gradients(
        state: State<Self>,
        upstream: FloatTensor<Self>,
        input: bool,
    ) -> ([FloatTensor<Self>; 2], Option<FloatTensor<Self>>);
}

impl NormPasses for Flex {
    fn forward(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
    ) -> (FloatTensor<Self>, State<Self>) {
        let [n_rows, n_columns] = input.layout().shape().dims();
        let mut standardised = row_by_row(input);
        let (mean, variance) = moments(standardised.storage::<f32>(), n_columns);
        let inverse_sd: Vec<f32> = variance
            .iter()
            .map(|variance| 1.0 / (variance + EPSILON).sqrt())
            .collect();
        let (scale, shift) = (row_by_row(weight.clone()), row_by_row(bias));
        let (scale, shift) = (scale.storage::<f32>(), shift.storage::<f32>());
        let mut output = vec![0.0; n_rows * n_columns];
        let rows = standardised
            .storage_mut::<f32>()
            .chunks_exact_mut(n_columns)
            .zip(output.chunks_exact_mut(n_columns));
        for (x, y) in rows {
            x.iter_mut()
                .zip(&mean)
                .zip(&inverse_sd)
                .for_each(|((x, mean), inverse)| *x = (*x - mean) * inverse);
            y.iter_mut()
                .zip(&*x)
                .zip(scale)
                .zip(shift)
                .for_each(|(((y, x), scale), shift)| *y = scale * x + shift);
        }
        let output = FloatTensor::<Self>::from_data(TensorData::new(output, [n_rows, n_columns]));
        (
            output,
            State {
                standardised,
                weight,
                inverse_sd,
            },
        )
    }

    fn gradients(
        state: State<Self>,
        upstream: FloatTensor<Self>,
        input: bool,
    ) -> ([FloatTensor<Self>; 2], Option<FloatTensor<Self>>) {
        let [n_rows, n_columns] = upstream.layout().shape().dims();
        let mut gradient = row_by_row(upstream);
        let standardised = state.standardised.storage::<f32>();
        let shift = add_rows(gradient.storage::<f32>(), n_columns);
        let mut scale = vec![0.0; n_columns];
        for (dy, h) in gradient
            .storage::<f32>()
            .chunks_exact(n_columns)
            .zip(standardised.chunks_exact(n_columns))
        {
            scale
                .iter_mut()
                .zip(dy)
                .zip(h)
                .for_each(|((sum, dy), h)| *sum += dy * h);
        }
        if input {
            let weight = row_by_row(state.weight);
            let factor: Vec<f32> = weight
                .storage::<f32>()
                .iter()
                .zip(&state.inverse_sd)
                .map(|(w, i)| w * i)
                .collect();
            let rows = gradient
                .storage_mut::<f32>()
                .chunks_exact_mut(n_columns)
                .zip(standardised.chunks_exact(n_columns));
            rows.for_each(|(dy, h)| input_gradient(dy, h, [&factor, &shift, &scale], n_rows));
        }
        let vector = |sums| FloatTensor::<Self>::from_data(TensorData::new(sums, [n_columns]));
        ([vector(scale), vector(shift)], input.then_some(gradient))
    }
}

/// Replaces one row of `dy` by one of `dx`.
#[allow(clippy::cast_precision_loss, reason = "a batch has far fewer than 2^24 rows")]
fn input_gradient(dy: &mut [f32], standardised: &[f32], [factor, shift, scale]: [&[f32]; 3], n_rows: usize) {
    let share = 1.0 / n_rows as f32;
    let columns = dy
        .iter_mut()
        .zip(standardised)
        .zip(factor)
        .zip(shift.iter().zip(scale));
    columns
        .for_each(|(((dy, h), factor), (shift, scale))| *dy = factor * (*dy - share * (shift + h * scale)));
}

impl NormOperation for Flex {
    fn normalised(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        Self::forward(input, weight, bias).0
    }
}

impl<B: NormPasses, C: CheckpointStrategy> NormOperation for Autodiff<B, C> {
    fn normalised(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        let nodes = [input.node(), weight.node(), bias.node()];
        let (output, state) = B::forward(
            input.into_primitive(),
            weight.into_primitive(),
            bias.into_primitive(),
        );
        match NormBackward::<B>(PhantomData)
            .prepare::<C>(nodes)
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(operation) => operation.finish(state, output),
            OpsKind::UnTracked(operation) => operation.finish(output),
        }
    }
}

/// The backward step.
#[derive(Debug)]
struct NormBackward<B>(PhantomData<fn() -> B>);

impl<B: NormPasses> Backward<B, 3> for NormBackward<B> {
    type State = State<B>;

    fn backward(self, operation: Ops<Self::State, 3>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let Ops {
            parents: [input, weight, bias],
            node,
            state,
        } = operation;
        let ([scale, shift], dx) = B::gradients(state, gradients.consume::<B>(&node), input.is_some());
        for (node, gradient) in [(weight, scale), (bias, shift)] {
            if let Some(node) = node {
                gradients.register::<B>(node.id, gradient);
            }
        }
        if let (Some(node), Some(gradient)) = (input, dx) {
            gradients.register::<B>(node.id, gradient);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::matrix;
    use crate::parameters::{parameters, with_parameters};

    const ROWS: [f32; 12] = [0.5, -1.0, 3.0, 1.5, 0.25, -2.0, 0.0, 0.75, 3.5, -0.5, 2.0, 1.0];

    fn norm(device: &Device) -> InputNorm {
        let norm = InputNorm::new(3, device);
        let mut numbers = parameters(&norm);
        (numbers[0].values, numbers[1].values) = (vec![2.0, -1.0, 0.5], vec![0.1, 0.0, -3.0]);
        with_parameters(norm, &numbers).unwrap()
    }

    /// Weighted sum of squares, so that no gradient is zero by the symmetry of the normalisation.
    fn loss(norm: &InputNorm, input: Tensor<2>) -> Tensor<1> {
        let weights = matrix((0..12u8).map(|i| f32::from(i * 5 % 7) - 2.0).collect(), 3);
        (norm.by_batch(input).powf_scalar(2.0) * weights).sum()
    }

    #[test]
    fn a_column_by_hand() {
        // The column (1, 3) has mean 2 and variance 1; the constant column is centred and divided by
        // sqrt(epsilon).
        let y = values(InputNorm::new(2, &device()).by_batch(matrix(vec![1.0, 4.0, 3.0, 4.0], 2)));
        assert!(
            (y[0] + 1.0).abs() < 1e-4 && (y[2] - 1.0).abs() < 1e-4 && y[1] == 0.0 && y[3] == 0.0,
            "{y:?}"
        );
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let tracked = norm(&device().autodiff());
        let input = Tensor::<2>::from_inner(matrix(ROWS.to_vec(), 3)).require_grad();
        let mut gradients = loss(&tracked, input.clone()).backward();
        let of_input = values(input.grad(&gradients).unwrap());
        let of_parameters = crate::optimizer::gradients(&tracked, &mut gradients);
        let plain = norm(&device());
        let close = |above: f32, below: f32, gradient: f32| {
            let difference = (above - below) / 0.02;
            assert!(
                (difference - gradient).abs() < 0.02 * (1.0 + gradient.abs()),
                "{difference} {gradient}"
            );
        };
        for i in 0..12 {
            let at = |step: f32| {
                let mut moved = ROWS.to_vec();
                moved[i] += step;
                values(loss(&plain, matrix(moved, 3)))[0]
            };
            close(at(0.01), at(-0.01), of_input[i]);
        }
        let numbers = parameters(&plain);
        for (p, i) in (0..6).map(|at| (at / 3, at % 3)) {
            let at = |step: f32| {
                let mut moved = numbers.clone();
                moved[p].values[i] += step;
                values(loss(
                    &with_parameters(plain.clone(), &moved).unwrap(),
                    matrix(ROWS.to_vec(), 3),
                ))[0]
            };
            close(at(0.01), at(-0.01), of_parameters[p][i]);
        }
    }

    #[test]
    fn a_plain_norm_passes_the_gradient_of_a_tracked_one() {
        let gradient = |norm: &InputNorm| {
            let input = Tensor::<2>::from_inner(matrix(ROWS.to_vec(), 3)).require_grad();
            values(input.grad(&loss(norm, input.clone()).backward()).unwrap())
        };
        assert_eq!(gradient(&norm(&device())), gradient(&norm(&device().autodiff())));
    }

    #[test]
    fn running_moments_reach_those_of_the_batches() {
        let (batch, norm) = (matrix(ROWS.to_vec(), 3), norm(&device()));
        let mut running = RunningMoments::new(3);
        running.absorb(&batch);
        // The first column (0.5, 1.5, 0, -0.5) has mean 0.375 and unbiased variance 2.1875 / 3.
        assert!((running.mean[0] - 0.0375).abs() < 1e-6);
        assert!(
            (running.variance[0] - (0.9 + 0.1 * 2.1875 / 3.0)).abs() < 1e-6,
            "{running:?}"
        );
        (0..200).for_each(|_| running.absorb(&batch));
        let (of_batch, of_moments) = (
            values(norm.by_batch(batch.clone())),
            values(norm.by_moments(batch, &running)),
        );
        let shrink = (3.0f32 / 4.0).sqrt();
        for (at, (a, b)) in of_batch.iter().zip(&of_moments).enumerate() {
            let shift = [0.1, 0.0, -3.0][at % 3];
            assert!(((a - shift) * shrink - (b - shift)).abs() < 1e-4, "{a} {b}");
        }
    }

    #[test]
    fn moments_are_stored_with_their_length() {
        let mut one = RunningMoments::new(3);
        one.absorb(&matrix(ROWS.to_vec(), 3));
        let mut file = TensorFile::default();
        one.store("policy", &mut file);
        let mut two = RunningMoments::new(3);
        two.restore("policy", &file).unwrap();
        assert_eq!(one, two);
        assert!(RunningMoments::new(2).restore("policy", &file).is_err());
    }
}
