//! A fully connected layer with its activation as one autodiff operation.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | input | `[rows, inputs]` |
//! | W | weight | `[inputs, outputs]` |
//! | b | bias | `[outputs]` |
//! | y = f(z), z = x W + b | output | `[rows, outputs]` |
//!
//! Forward: one matrix product, then bias and activation in one pass over its result. Backward, from the
//! gradient `dy`: `dz = dy f'(z)`, with the slope taken from `y`, and `db`, its sum over the rows, in one
//! pass; then `dx = dz W^T` and `dW = x^T dz`, whose transposed factors are read with other strides instead
//! of being copied. Only the gradients of tracked parents are computed, and rows without a gradient are left
//! out of `dx`: of two critics, the gradient of the lower value reaches each in about half of the rows. Sums
//! run over the rows in their order, and a row of the output depends on its row of the input alone.

use crate::activation::Activation;
use burn::Tensor;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::TensorData;
use std::marker::PhantomData;

/// Outputs `[rows, outputs]` of the layer with `weight` `[inputs, outputs]` and `bias` `[outputs]` for
/// `input` `[rows, inputs]`; without an activation the layer is affine. All tensors are `f32`.
///
/// # Panics
/// Where the shapes do not fit or a tensor is not `f32`.
#[must_use]
pub fn dense(
    input: Tensor<2>,
    weight: Tensor<2>,
    bias: Tensor<1>,
    activation: Option<Activation>,
) -> Tensor<2> {
    assert_eq!(
        [input.dims()[1]],
        [weight.dims()[0]],
        "an input of {:?} for weights {:?}",
        input.dims(),
        weight.dims()
    );
    assert_eq!(bias.dims(), [weight.dims()[1]], "one bias per output");
    let (input, weight, bias) = (
        input.into_dispatch(),
        weight.into_dispatch(),
        bias.into_dispatch(),
    );
    Tensor::from_dispatch(<Dispatch as DenseOperation>::dense(
        input, weight, bias, activation,
    ))
}

/// The operation on the tensors of one backend.
#[backend_extension(Flex, Autodiff)]
trait DenseOperation: Backend {
    /// The free function of this name on tensors of the backend.
    fn dense(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        activation: Option<Activation>,
    ) -> FloatTensor<Self>;
}

/// Output that the layer keeps for the slope of its activation.
type Output<B> = Option<(FloatTensor<B>, Activation)>;

/// Passes over plain tensors. A further backend implements them and is named as a selector above.
trait DensePasses: Backend {
    /// `f(z + b)` from the product `z`.
    fn add_bias(
        product: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        activation: Option<Activation>,
    ) -> FloatTensor<Self>;

    /// `dz` from `y` and `dy`, and `db` where its parent is tracked.
    fn gradients(
        output: Output<Self>,
        upstream: FloatTensor<Self>,
        bias: bool,
    ) -> (FloatTensor<Self>, Option<FloatTensor<Self>>);

    /// `dx` from `dz` and `W`.
    fn input_gradient(gradient: FloatTensor<Self>, weight: FloatTensor<Self>) -> FloatTensor<Self>;
}

/// Tensor whose rows fill its buffer in order. There is no copy where they already do: the second handle to
/// the buffer that `to_contiguous` returns then outlives the first, and writes go to the same place.
pub(crate) fn row_by_row(tensor: FloatTensor<Flex>) -> FloatTensor<Flex> {
    tensor.to_contiguous()
}

/// Sum of each column over the rows.
pub(crate) fn add_rows(rows: &[f32], n_columns: usize) -> Vec<f32> {
    let mut sums = vec![0.0; n_columns];
    for row in rows.chunks_exact(n_columns) {
        sums.iter_mut().zip(row).for_each(|(sum, entry)| *sum += entry);
    }
    sums
}

impl DensePasses for Flex {
    fn add_bias(
        product: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        activation: Option<Activation>,
    ) -> FloatTensor<Self> {
        let (mut output, bias) = (row_by_row(product), row_by_row(bias));
        let bias = bias.storage::<f32>();
        output
            .storage_mut::<f32>()
            .chunks_exact_mut(bias.len())
            .for_each(|row| match activation {
                Some(activation) => activation.forward(row, bias),
                None => row.iter_mut().zip(bias).for_each(|(z, b)| *z += b),
            });
        output
    }

    fn gradients(
        output: Output<Self>,
        upstream: FloatTensor<Self>,
        bias: bool,
    ) -> (FloatTensor<Self>, Option<FloatTensor<Self>>) {
        let n_outputs = upstream.layout().shape()[1];
        let mut gradient = row_by_row(upstream);
        if let Some((output, activation)) = output {
            activation.backward(row_by_row(output).storage::<f32>(), gradient.storage_mut::<f32>());
        }
        let bias = bias.then(|| {
            let sums = add_rows(gradient.storage::<f32>(), n_outputs);
            FloatTensor::<Self>::from_data(TensorData::new(sums, [n_outputs]))
        });
        (gradient, bias)
    }

    fn input_gradient(gradient: FloatTensor<Self>, weight: FloatTensor<Self>) -> FloatTensor<Self> {
        let ([n_rows, n_outputs], n_inputs) = (gradient.layout().shape().dims(), weight.layout().shape()[0]);
        let transposed = Self::float_transpose(weight);
        let gradient = row_by_row(gradient);
        let rows = gradient.storage::<f32>().chunks_exact(n_outputs);
        let reached: Vec<usize> = (0..n_rows)
            .zip(rows)
            .filter(|(_, row)| !all_zero(row))
            .map(|(at, _)| at)
            .collect();
        // Moving the rows costs less than a quarter of the product.
        if reached.len() * 4 > n_rows * 3 {
            return Self::float_matmul(gradient, transposed);
        }
        let mut sums = vec![0.0; n_rows * n_inputs];
        if !reached.is_empty() {
            let gathered = gather(gradient.storage(), n_outputs, &reached);
            let gathered =
                FloatTensor::<Self>::from_data(TensorData::new(gathered, [reached.len(), n_outputs]));
            let product = Self::float_matmul(gathered, transposed);
            for (at, row) in reached
                .iter()
                .zip(product.storage::<f32>().chunks_exact(n_inputs))
            {
                sums[at * n_inputs..][..n_inputs].copy_from_slice(row);
            }
        }
        FloatTensor::<Self>::from_data(TensorData::new(sums, [n_rows, n_inputs]))
    }
}

/// Whether all entries are zero, in one pass without an early end, which is vectorised; the shift drops the
/// sign of a zero.
fn all_zero(row: &[f32]) -> bool {
    row.iter().fold(0, |bits, entry| bits | entry.to_bits() << 1) == 0
}

fn gather(rows: &[f32], n_columns: usize, chosen: &[usize]) -> Vec<f32> {
    let mut gathered = Vec::with_capacity(chosen.len() * n_columns);
    chosen
        .iter()
        .for_each(|at| gathered.extend_from_slice(&rows[at * n_columns..][..n_columns]));
    gathered
}

impl DenseOperation for Flex {
    fn dense(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        activation: Option<Activation>,
    ) -> FloatTensor<Self> {
        forward::<Self>(input, weight, bias, activation)
    }
}

fn forward<B: DensePasses>(
    input: FloatTensor<B>,
    weight: FloatTensor<B>,
    bias: FloatTensor<B>,
    activation: Option<Activation>,
) -> FloatTensor<B> {
    B::add_bias(B::float_matmul(input, weight), bias, activation)
}

impl<B: DensePasses, C: CheckpointStrategy> DenseOperation for Autodiff<B, C> {
    fn dense(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        activation: Option<Activation>,
    ) -> FloatTensor<Self> {
        // Each factor is kept for the gradient of the other one.
        let (input_kept, weight_kept) = (weight.is_tracked(), input.is_tracked());
        let nodes = [input.node(), weight.node(), bias.node()];
        let (input, weight) = (input.into_primitive(), weight.into_primitive());
        let kept = (
            input_kept.then(|| input.clone()),
            weight_kept.then(|| weight.clone()),
        );
        let output = forward::<B>(input, weight, bias.into_primitive(), activation);
        match DenseBackward::<B>(PhantomData)
            .prepare::<C>(nodes)
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(operation) => {
                let state = State {
                    input: kept.0,
                    weight: kept.1,
                    output: activation.map(|f| (output.clone(), f)),
                };
                operation.finish(state, output)
            }
            OpsKind::UnTracked(operation) => operation.finish(output),
        }
    }
}

/// The backward step.
#[derive(Debug)]
struct DenseBackward<B>(PhantomData<fn() -> B>);

/// State that the backward step takes from the forward pass.
#[derive(Debug, Clone)]
struct State<B: Backend> {
    input: Option<FloatTensor<B>>,
    weight: Option<FloatTensor<B>>,
    output: Output<B>,
}

impl<B: DensePasses> Backward<B, 3> for DenseBackward<B> {
    type State = State<B>;

    fn backward(self, operation: Ops<Self::State, 3>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let Ops {
            parents: [input_node, weight_node, bias_node],
            node,
            state,
        } = operation;
        let (gradient, bias) = B::gradients(state.output, gradients.consume::<B>(&node), bias_node.is_some());
        if let (Some(node), Some(bias)) = (bias_node, bias) {
            gradients.register::<B>(node.id, bias);
        }
        if let (Some(node), Some(input)) = (weight_node, state.input) {
            gradients.register::<B>(
                node.id,
                B::float_matmul(B::float_transpose(input), gradient.clone()),
            );
        }
        if let (Some(node), Some(weight)) = (input_node, state.weight) {
            gradients.register::<B>(node.id, B::input_gradient(gradient, weight));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{matrix, values};
    use burn::tensor::{Gradients, activation};

    const ACTIVATIONS: [Option<Activation>; 4] = [
        None,
        Some(Activation::Relu),
        Some(Activation::LeakyRelu),
        Some(Activation::Tanh),
    ];
    const SHAPE: [usize; 3] = [5, 4, 3];

    /// Numbers without a pattern between -1 and 1.
    fn numbers(count: usize, seed: f32) -> Vec<f32> {
        (0..count).map(|i| ((i as f32 + seed) * 12.9898).sin()).collect()
    }

    /// Input, weight and bias, tracked as `tracked` says.
    fn parents(tracked: [bool; 3]) -> (Tensor<2>, Tensor<2>, Tensor<1>) {
        let [rows, inputs, outputs] = SHAPE;
        let place = |x: Tensor<2>, tracked| {
            if tracked {
                Tensor::from_inner(x).require_grad()
            } else {
                x
            }
        };
        let bias: Tensor<1> = matrix(numbers(outputs, 0.7), outputs).flatten(0, 1);
        (
            place(matrix(numbers(rows * inputs, 0.1), inputs), tracked[0]),
            place(matrix(numbers(inputs * outputs, 0.4), outputs), tracked[1]),
            if tracked[2] {
                Tensor::from_inner(bias).require_grad()
            } else {
                bias
            },
        )
    }

    /// The same layer composed of the tensor library's own operations.
    fn composed((x, w, b): (Tensor<2>, Tensor<2>, Tensor<1>), f: Option<Activation>) -> Tensor<2> {
        let z = x.matmul(w) + b.unsqueeze();
        match f {
            None => z,
            Some(Activation::Relu) => activation::relu(z),
            Some(Activation::LeakyRelu) => activation::leaky_relu(z, crate::activation::LEAKY_SLOPE),
            Some(Activation::Tanh) => z.tanh(),
        }
    }

    /// Gradients of a weighted sum, so that every entry has a different upstream gradient.
    fn gradients(output: Tensor<2>) -> Gradients {
        let upstream = matrix(numbers(SHAPE[0] * SHAPE[2], 0.9), SHAPE[2]);
        (output * Tensor::from_inner(upstream)).sum().backward()
    }

    fn assert_close(actual: &[f32], expected: &[f32], what: &str) {
        assert_eq!(actual.len(), expected.len(), "{what}");
        let close = actual.iter().zip(expected).all(|(a, e)| (a - e).abs() < 2e-6);
        assert!(close, "{what}: {actual:?} {expected:?}");
    }

    #[test]
    fn agrees_with_the_composed_layer_for_all_tracked_parents() {
        for f in ACTIVATIONS {
            let all = parents([true; 3]);
            let reference = composed(all.clone(), f);
            let of_all = gradients(reference.clone());
            let expected = [all.0.grad(&of_all), all.1.grad(&of_all)].map(|g| values(g.unwrap()));
            for pattern in 0..8 {
                let tracked = [0, 1, 2].map(|bit| pattern >> bit & 1 == 1);
                let (x, w, b) = parents(tracked);
                let output = dense(x.clone(), w.clone(), b.clone(), f);
                let what = format!("{f:?} {tracked:?}");
                assert_close(&values(output.clone()), &values(reference.clone()), &what);
                assert_eq!(output.is_tracked(), pattern > 0, "{what}");
                if pattern == 0 {
                    continue;
                }
                let found = gradients(output);
                for (at, parent) in [x, w].into_iter().enumerate().filter(|(at, _)| tracked[*at]) {
                    assert_close(&values(parent.grad(&found).unwrap()), &expected[at], &what);
                }
                if tracked[2] {
                    assert_close(
                        &values(b.grad(&found).unwrap()),
                        &values(all.2.grad(&of_all).unwrap()),
                        &what,
                    );
                }
            }
        }
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        let step = 1e-2;
        for f in ACTIVATIONS {
            let (x, w, b) = parents([true; 3]);
            let analytic = values(
                w.grad(&gradients(dense(x.clone(), w.clone(), b.clone(), f)))
                    .unwrap(),
            );
            let (x, w, b) = (x.inner(), values(w), b.inner());
            let upstream = matrix(numbers(SHAPE[0] * SHAPE[2], 0.9), SHAPE[2]);
            for i in 0..w.len() {
                let at = |step: f32| {
                    let mut moved = w.clone();
                    moved[i] += step;
                    values((dense(x.clone(), matrix(moved, SHAPE[2]), b.clone(), f) * upstream.clone()).sum())
                        [0]
                };
                let difference = (at(step) - at(-step)) / (2.0 * step);
                assert!(
                    (difference - analytic[i]).abs() < 1e-2,
                    "{f:?} {i}: {difference} {}",
                    analytic[i]
                );
            }
        }
    }

    #[test]
    fn rows_without_a_gradient_change_nothing_for_the_others() {
        for reached in [vec![], vec![3], vec![0, 2, 4], vec![0, 1, 2, 4]] {
            let rows: Vec<_> = (0..SHAPE[0])
                .map(|row| if reached.contains(&row) { 1.0 } else { 0.0 })
                .collect();
            let input_gradient = |layer: &dyn Fn((Tensor<2>, Tensor<2>, Tensor<1>)) -> Tensor<2>| {
                let parents = parents([true, false, false]);
                let loss = layer(parents.clone()) * Tensor::from_inner(matrix(rows.clone(), 1));
                values(parents.0.grad(&loss.sum().backward()).unwrap())
            };
            let expected = input_gradient(&|parents| composed(parents, Some(Activation::Tanh)));
            let found = input_gradient(&|(x, w, b)| dense(x, w, b, Some(Activation::Tanh)));
            assert_close(&found, &expected, &format!("{reached:?}"));
            assert!((0..SHAPE[0]).all(|row| (found[row * SHAPE[1]] == 0.0) != reached.contains(&row)));
        }
    }

    #[test]
    fn parents_that_are_used_again_are_unchanged() {
        let (x, w, b) = parents([false; 3]);
        let before = [values(x.clone()), values(w.clone())];
        let first = values(dense(x.clone(), w.clone(), b.clone(), Some(Activation::Tanh)));
        let second = values(dense(x.clone(), w.clone(), b, Some(Activation::Tanh)));
        assert_eq!((first, before), (second, [values(x), values(w)]));
    }

    #[test]
    fn views_are_read_in_their_order() {
        let (x, w, b) = parents([true; 3]);
        let transposed =
            |x: &Tensor<2>| Tensor::from_inner(matrix(values(x.clone().transpose()), x.dims()[0]));
        let view = dense(
            transposed(&x).transpose(),
            transposed(&w).transpose(),
            b.clone(),
            Some(Activation::Tanh),
        );
        // The upstream gradient is a transposed view, and the output is sliced.
        let loss = |y: Tensor<2>| (y.clone().transpose() * 2.0).sum() + y.slice([1..3, 0..2]).sum();
        let plain = dense(x.clone(), w, b.clone(), Some(Activation::Tanh));
        assert_eq!(values(view), values(plain.clone()));
        let reference = parents([true; 3]);
        let expected = loss(composed(reference.clone(), Some(Activation::Tanh))).backward();
        let found = loss(plain).backward();
        assert_close(
            &values(x.grad(&found).unwrap()),
            &values(reference.0.grad(&expected).unwrap()),
            "input",
        );
        assert_close(
            &values(b.grad(&found).unwrap()),
            &values(reference.2.grad(&expected).unwrap()),
            "bias",
        );
    }

    #[test]
    fn a_row_does_not_depend_on_the_others() {
        let (w, b) = (
            matrix(numbers(40 * 50, 0.2), 50),
            matrix(numbers(50, 0.3), 50).flatten(0, 1),
        );
        let rows = numbers(33 * 40, 0.5);
        let together = values(dense(
            matrix(rows.clone(), 40),
            w.clone(),
            b.clone(),
            Some(Activation::Tanh),
        ));
        let reversed: Vec<f32> = rows.chunks(40).rev().flatten().copied().collect();
        let reversed = values(dense(matrix(reversed, 40), w, b, Some(Activation::Tanh)));
        assert!(together.chunks(50).eq(reversed.chunks(50).rev()));
    }

    #[test]
    #[should_panic(expected = "one bias per output")]
    fn a_bias_of_another_length_is_refused() {
        let (x, w, _) = parents([false; 3]);
        let _ = dense(x, w, matrix(vec![0.0; 2], 2).flatten(0, 1), None);
    }
}
