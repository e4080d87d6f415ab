//! A custom autodiff operation: a value computed outside the tensor library, with a known derivative.
//!
//! Densities and draws of the Dirichlet distribution need ln Gamma, digamma, trigamma and the implicit
//! derivative of a gamma draw. burn has none of them, and `f32` is too coarse for their sums. They are
//! computed on the host in `f64` and enter the graph here as one node: forward it returns the given value,
//! backward it multiplies by the given derivative.
//!
//! The operation is registered for the Flex backend; on a device of another backend it panics. A further
//! backend is one more selector in `backend_extension` and one empty `impl`.

use burn::Tensor;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind, unary};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};

/// The tensor `value` `[batch, m]` with a gradient in `input` `[batch, n]`: the upstream gradient times
/// `derivative` `[batch, n]`.
///
/// `m` is `n` (an element-wise function) or 1 (a function of each row). `value` and `derivative` are
/// constants of the graph.
#[must_use]
pub fn linearised(input: Tensor<2>, value: Tensor<2>, derivative: Tensor<2>) -> Tensor<2> {
    let output = <Dispatch as LinearisedOperation>::linearised(
        input.into_dispatch(),
        value.into_dispatch(),
        derivative.into_dispatch(),
    );
    Tensor::from_dispatch(output)
}

/// Operation on the tensors of one backend; without autodiff it returns the value.
#[backend_extension(Flex, Autodiff)]
trait LinearisedOperation: Backend {
    /// The free function of this name on tensors of the backend.
    fn linearised(
        input: FloatTensor<Self>,
        value: FloatTensor<Self>,
        derivative: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        let _ = (input, derivative);
        value
    }
}

impl LinearisedOperation for Flex {}

impl<B: Backend, C: CheckpointStrategy> LinearisedOperation for Autodiff<B, C> {
    fn linearised(
        input: FloatTensor<Self>,
        value: FloatTensor<Self>,
        derivative: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        let value = value.into_primitive();
        match MultiplyBackward
            .prepare::<C>([input.node()])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(operation) => operation.finish(derivative.into_primitive(), value),
            OpsKind::UnTracked(operation) => operation.finish(value),
        }
    }
}

/// The backward step; its state is the derivative.
#[derive(Debug)]
struct MultiplyBackward;

impl<B: Backend> Backward<B, 1> for MultiplyBackward {
    type State = FloatTensor<B>;

    fn backward(self, operation: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let derivative = operation.state;
        unary::<B, _>(operation.parents, operation.node, gradients, |upstream| {
            B::float_mul(upstream, derivative)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    fn gradient_of(value: [[f32; 2]; 2]) -> Vec<f32> {
        let device = Device::default().autodiff();
        let input = Tensor::<2>::from_data([[1.0, 2.0], [3.0, 4.0]], &device).require_grad();
        let derivative = Tensor::from_data([[10.0, 20.0], [30.0, 40.0]], &device);
        let output = linearised(input.clone() * 2.0, Tensor::from_data(value, &device), derivative);
        assert_eq!(
            output.clone().inner().into_data(),
            burn::tensor::TensorData::from(value)
        );
        let loss = (output * Tensor::from_data([[1.0, 2.0], [3.0, -1.0]], &device)).sum();
        input
            .grad(&loss.backward())
            .unwrap()
            .into_data()
            .iter::<f32>()
            .collect()
    }

    #[test]
    fn element_wise_derivative_multiplies_the_upstream_gradient() {
        assert_eq!(gradient_of([[7.0, 8.0], [9.0, 10.0]]), [20.0, 80.0, 180.0, -80.0]);
    }

    #[test]
    fn derivative_of_a_row_is_spread_over_it() {
        let device = Device::default().autodiff();
        let input = Tensor::<2>::from_data([[1.0, 2.0], [3.0, 4.0]], &device).require_grad();
        let derivative = Tensor::from_data([[10.0, 20.0], [30.0, 40.0]], &device);
        let output = linearised(
            input.clone(),
            Tensor::from_data([[5.0], [6.0]], &device),
            derivative,
        );
        let loss = (output * Tensor::from_data([[1.0], [2.0]], &device)).sum();
        let gradient = input.grad(&loss.backward()).unwrap();
        assert_eq!(
            gradient.into_data(),
            burn::tensor::TensorData::from([[10.0_f32, 20.0], [60.0, 80.0]])
        );
    }

    #[test]
    fn plain_tensors_pass_the_value_on() {
        let device = Device::default();
        let ones = Tensor::<2>::ones([1, 2], &device);
        let output = linearised(ones.clone(), ones.clone() * 3.0, ones);
        assert!(!output.is_autodiff());
        assert_eq!(
            output.into_data(),
            burn::tensor::TensorData::from([[3.0_f32, 3.0]])
        );
    }
}
