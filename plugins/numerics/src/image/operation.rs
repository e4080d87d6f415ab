//! Frame of the operations on images: one node of the autodiff graph whose two passes run on the host.
//!
//! An [`Operation`] computes its output and the gradients of its inputs; this module puts it into the graph.
//! It is registered for the CPU backend and panics on a device of another backend.

use burn::Tensor;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::TensorData;
use std::fmt::Debug;
use std::marker::PhantomData;
use std::sync::Arc;

/// A tensor without gradients in the processor's memory.
pub(super) type PlainTensor = FloatTensor<Flex>;

/// Forward and backward pass over plain tensors.
pub(super) trait Operation: Debug + Send + Sync {
    /// Output for inputs that lie row by row, and the tensors that the backward pass needs.
    fn forward(&self, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>);

    /// Gradient in each wanted input, from the kept tensors and the gradient in the output.
    fn backward(
        &self,
        kept: &[PlainTensor],
        upstream: &PlainTensor,
        wanted: &[bool],
    ) -> Vec<Option<PlainTensor>>;
}

/// Applies an operation to one tensor.
pub(super) fn of_one<const D: usize>(input: Tensor<D>, operation: Arc<dyn Operation>) -> Tensor<D> {
    Tensor::from_dispatch(<Dispatch as HostOperation>::of_one(
        input.into_dispatch(),
        operation,
    ))
}

/// Applies an operation to an image with a weight and a bias.
pub(super) fn of_three<const D: usize>(
    image: Tensor<4>,
    weight: Tensor<D>,
    bias: Tensor<1>,
    operation: Arc<dyn Operation>,
) -> Tensor<4> {
    let (image, weight, bias) = (
        image.into_dispatch(),
        weight.into_dispatch(),
        bias.into_dispatch(),
    );
    Tensor::from_dispatch(<Dispatch as HostOperation>::of_three(
        image, weight, bias, operation,
    ))
}

/// Tensor of numbers with a shape.
pub(super) fn host<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> PlainTensor {
    PlainTensor::from_data(TensorData::new(values, shape))
}

/// Shape `[batch, height, width, channels]` of an image.
pub(super) fn shape(image: &PlainTensor) -> [usize; 4] {
    image.layout().shape().dims()
}

/// The operation on the tensors of one backend.
#[backend_extension(Flex, Autodiff)]
trait HostOperation: Backend {
    /// The free function of this name on tensors of the backend.
    fn of_one(input: FloatTensor<Self>, operation: Arc<dyn Operation>) -> FloatTensor<Self>;

    /// The free function of this name on tensors of the backend.
    fn of_three(
        image: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        operation: Arc<dyn Operation>,
    ) -> FloatTensor<Self>;
}

/// Backends whose tensors are in the processor's memory.
trait HostBackend: Backend {
    /// Runs [`Operation::forward`].
    fn forward(
        operation: &dyn Operation,
        inputs: Vec<FloatTensor<Self>>,
    ) -> (FloatTensor<Self>, Vec<FloatTensor<Self>>);

    /// Runs [`Operation::backward`].
    fn backward(
        operation: &dyn Operation,
        kept: &[FloatTensor<Self>],
        upstream: FloatTensor<Self>,
        wanted: &[bool],
    ) -> Vec<Option<FloatTensor<Self>>>;
}

impl HostBackend for Flex {
    fn forward(operation: &dyn Operation, inputs: Vec<PlainTensor>) -> (PlainTensor, Vec<PlainTensor>) {
        operation.forward(inputs.iter().map(PlainTensor::to_contiguous).collect())
    }

    fn backward(
        operation: &dyn Operation,
        kept: &[PlainTensor],
        upstream: PlainTensor,
        wanted: &[bool],
    ) -> Vec<Option<PlainTensor>> {
        operation.backward(kept, &upstream.to_contiguous(), wanted)
    }
}

impl HostOperation for Flex {
    fn of_one(input: PlainTensor, operation: Arc<dyn Operation>) -> PlainTensor {
        Self::forward(&*operation, vec![input]).0
    }

    fn of_three(
        image: PlainTensor,
        weight: PlainTensor,
        bias: PlainTensor,
        operation: Arc<dyn Operation>,
    ) -> PlainTensor {
        Self::forward(&*operation, vec![image, weight, bias]).0
    }
}

impl<B: HostBackend, C: CheckpointStrategy> HostOperation for Autodiff<B, C> {
    fn of_one(input: FloatTensor<Self>, operation: Arc<dyn Operation>) -> FloatTensor<Self> {
        in_the_graph::<B, C, 1>([input], operation)
    }

    fn of_three(
        image: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        operation: Arc<dyn Operation>,
    ) -> FloatTensor<Self> {
        in_the_graph::<B, C, 3>([image, weight, bias], operation)
    }
}

fn in_the_graph<B: HostBackend, C: CheckpointStrategy, const N: usize>(
    inputs: [FloatTensor<Autodiff<B, C>>; N],
    operation: Arc<dyn Operation>,
) -> FloatTensor<Autodiff<B, C>> {
    let nodes = inputs.each_ref().map(FloatTensor::<Autodiff<B, C>>::node);
    let inputs = inputs.map(FloatTensor::<Autodiff<B, C>>::into_primitive).into();
    let (output, kept) = B::forward(&*operation, inputs);
    match HostBackward::<B, N>(PhantomData)
        .prepare::<C>(nodes)
        .compute_bound()
        .stateful()
    {
        OpsKind::Tracked(node) => node.finish(State { operation, kept }, output),
        OpsKind::UnTracked(node) => node.finish(output),
    }
}

/// Backward step of an operation on `N` tensors.
#[derive(Debug)]
struct HostBackward<B, const N: usize>(PhantomData<fn() -> B>);

/// An operation with the tensors that it kept.
#[derive(Debug, Clone)]
struct State<B: Backend> {
    operation: Arc<dyn Operation>,
    kept: Vec<FloatTensor<B>>,
}

impl<B: HostBackend, const N: usize> Backward<B, N> for HostBackward<B, N> {
    type State = State<B>;

    fn backward(self, step: Ops<Self::State, N>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let Ops { parents, node, state } = step;
        let wanted = parents.each_ref().map(Option::is_some);
        let upstream = gradients.consume::<B>(&node);
        let found = B::backward(&*state.operation, &state.kept, upstream, &wanted);
        for (parent, gradient) in parents.into_iter().zip(found) {
            if let (Some(parent), Some(gradient)) = (parent, gradient) {
                gradients.register::<B>(parent.id, gradient);
            }
        }
    }
}
