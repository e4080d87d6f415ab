//! A fully connected layer with its activation as one autodiff operation.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | input | `[rows, inputs]` |
//! | W | weight | `[inputs, outputs]` |
//! | b | bias | `[outputs]` |
//! | y = f(z), z = x W + b | output | `[rows, outputs]` |
//!
//! Forward: one matrix product, then bias and activation in one pass over its result. Backward, from the gradient `dy`:
//! `dz = dy f'(z)`, with the slope taken from `y`, and `db`, its sum over the rows, in one pass; then `dx = dz W^T` and
//! `dW = x^T dz`, whose transposed factors are read with other strides instead of being copied. Only what some parent asks
//! for is computed. Sums run over the rows in their order, and a row of the output depends on its row of the input alone.

use crate::activation::Activation;
use burn::Tensor;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::TensorData;
use std::marker::PhantomData;

/// Outputs `[rows, outputs]` of the layer with `weight` `[inputs, outputs]` and `bias` `[outputs]` for `input`
/// `[rows, inputs]`; without an activation the layer is affine. All tensors are `f32`.
///
/// # Panics
/// Where the shapes do not fit or a tensor is not `f32`.
#[must_use]
pub fn dense(input: Tensor<2>, weight: Tensor<2>, bias: Tensor<1>, activation: Option<Activation>) -> Tensor<2> {
    assert_eq!([input.dims()[1]], [weight.dims()[0]], "an input of {:?} for weights {:?}", input.dims(), weight.dims());
    assert_eq!(bias.dims(), [weight.dims()[1]], "one bias per output");
    let (input, weight, bias) = (input.into_dispatch(), weight.into_dispatch(), bias.into_dispatch());
    Tensor::from_dispatch(<Dispatch as DenseOperation>::dense(input, weight, bias, activation))
}

/// The operation on the tensors of one backend.
#[backend_extension(Flex, Autodiff)]
trait DenseOperation: Backend {
    /// See the free function of this name.
    fn dense(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        activation: Option<Activation>,
    ) -> FloatTensor<Self>;
}

/// What the layer with an activation kept of its output.
type Output<B> = Option<(FloatTensor<B>, Activation)>;

/// The passes over plain tensors. A further backend implements them and is named as a selector above.
trait DensePasses: Backend {
    /// `f(z + b)` from the product `z`.
    fn add_bias(product: FloatTensor<Self>, bias: FloatTensor<Self>, activation: Option<Activation>) -> FloatTensor<Self>;

    /// `dz` from `y` and `dy`, and, where it is asked for, `db`.
    fn gradients(output: Output<Self>, upstream: FloatTensor<Self>, bias: bool)
    -> (FloatTensor<Self>, Option<FloatTensor<Self>>);
}

/// The tensor with its rows one after the other, filling their buffer. No copy where it already is so: the second handle to
/// the buffer that `to_contiguous` returns then outlives the first, and what is written goes to its place.
fn row_by_row(tensor: FloatTensor<Flex>) -> FloatTensor<Flex> {
    tensor.to_contiguous()
}

fn add_rows(rows: &[f32], n_columns: usize) -> Vec<f32> {
    let mut sums = vec![0.0; n_columns];
    for row in rows.chunks_exact(n_columns) {
        sums.iter_mut().zip(row).for_each(|(sum, entry)| *sum += entry);
    }
    sums
}

impl DensePasses for Flex {
    fn add_bias(product: FloatTensor<Self>, bias: FloatTensor<Self>, activation: Option<Activation>) -> FloatTensor<Self> {
        let (mut output, bias) = (row_by_row(product), row_by_row(bias));
        let bias = bias.storage::<f32>();
        output.storage_mut::<f32>().chunks_exact_mut(bias.len()).for_each(|row| match activation {
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
        let kept = (input_kept.then(|| input.clone()), weight_kept.then(|| weight.clone()));
        let output = forward::<B>(input, weight, bias.into_primitive(), activation);
        match DenseBackward::<B>(PhantomData).prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(operation) => {
                let state = State { input: kept.0, weight: kept.1, output: activation.map(|f| (output.clone(), f)) };
                operation.finish(state, output)
            }
            OpsKind::UnTracked(operation) => operation.finish(output),
        }
    }
}

/// The backward step.
#[derive(Debug)]
struct DenseBackward<B>(PhantomData<fn() -> B>);

/// What the backward step needs of the forward one.
#[derive(Debug, Clone)]
struct State<B: Backend> {
    input: Option<FloatTensor<B>>,
    weight: Option<FloatTensor<B>>,
    output: Output<B>,
}

impl<B: DensePasses> Backward<B, 3> for DenseBackward<B> {
    type State = State<B>;

    fn backward(self, operation: Ops<Self::State, 3>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let Ops { parents: [input_node, weight_node, bias_node], node, state } = operation;
        let (gradient, bias) = B::gradients(state.output, gradients.consume::<B>(&node), bias_node.is_some());
        if let (Some(node), Some(bias)) = (bias_node, bias) {
            gradients.register::<B>(node.id, bias);
        }
        if let (Some(node), Some(input)) = (weight_node, state.input) {
            gradients.register::<B>(node.id, B::float_matmul(B::float_transpose(input), gradient.clone()));
        }
        if let (Some(node), Some(weight)) = (input_node, state.weight) {
            gradients.register::<B>(node.id, B::float_matmul(gradient, B::float_transpose(weight)));
        }
    }
}
