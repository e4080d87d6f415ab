//! What every operation here shares: one node of the autodiff graph whose two passes run on the host.
//!
//! An [`Operation`] says how its output is made and what it sends back; this file puts it into the graph. It
//! is registered for the CPU back end; on a device of another one it panics.

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

/// A plain tensor in the processor's memory.
pub(super) type Host = FloatTensor<Flex>;

/// Two passes over plain tensors.
pub(super) trait Operation: Debug + Send + Sync {
    /// The output of the inputs, which lie row by row, and what the backward pass needs.
    fn forward(&self, inputs: Vec<Host>) -> (Host, Vec<Host>);

    /// The gradient in each input that wants one, from what was kept and the gradient in the output.
    fn backward(&self, kept: &[Host], upstream: &Host, wanted: &[bool]) -> Vec<Option<Host>>;
}

/// An operation on one tensor.
pub(super) fn of_one<const D: usize>(input: Tensor<D>, operation: Arc<dyn Operation>) -> Tensor<D> {
    Tensor::from_dispatch(<Dispatch as HostOperation>::of_one(
        input.into_dispatch(),
        operation,
    ))
}

/// An operation on an image with a weight and a bias.
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

/// A tensor of numbers with a shape.
pub(super) fn host<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> Host {
    Host::from_data(TensorData::new(values, shape))
}

/// `[batch, height, width, channels]` of an image.
pub(super) fn shape(image: &Host) -> [usize; 4] {
    image.layout().shape().dims()
}

/// The operation on the tensors of one backend.
#[backend_extension(Flex, Autodiff)]
trait HostOperation: Backend {
    /// See the free function of this name.
    fn of_one(input: FloatTensor<Self>, operation: Arc<dyn Operation>) -> FloatTensor<Self>;

    /// See the free function of this name.
    fn of_three(
        image: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        operation: Arc<dyn Operation>,
    ) -> FloatTensor<Self>;
}

/// The backends whose tensors are in the processor's memory.
trait HostBackend: Backend {
    /// [`Operation::forward`].
    fn forward(
        operation: &dyn Operation,
        inputs: Vec<FloatTensor<Self>>,
    ) -> (FloatTensor<Self>, Vec<FloatTensor<Self>>);

    /// [`Operation::backward`].
    fn backward(
        operation: &dyn Operation,
        kept: &[FloatTensor<Self>],
        upstream: FloatTensor<Self>,
        wanted: &[bool],
    ) -> Vec<Option<FloatTensor<Self>>>;
}

impl HostBackend for Flex {
    fn forward(operation: &dyn Operation, inputs: Vec<Host>) -> (Host, Vec<Host>) {
        operation.forward(inputs.iter().map(Host::to_contiguous).collect())
    }

    fn backward(
        operation: &dyn Operation,
        kept: &[Host],
        upstream: Host,
        wanted: &[bool],
    ) -> Vec<Option<Host>> {
        operation.backward(kept, &upstream.to_contiguous(), wanted)
    }
}

impl HostOperation for Flex {
    fn of_one(input: Host, operation: Arc<dyn Operation>) -> Host {
        Self::forward(&*operation, vec![input]).0
    }

    fn of_three(image: Host, weight: Host, bias: Host, operation: Arc<dyn Operation>) -> Host {
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

/// The backward step of an operation on `N` tensors.
#[derive(Debug)]
struct HostBackward<B, const N: usize>(PhantomData<fn() -> B>);

/// The operation and what it kept.
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
