//! Bias and activation of a layer as one autodiff operation: one pass over the numbers forward, one backward, in place.
//!
//! `y = f(x + b)`, with `x` `[rows, columns]` and `b` `[columns]`. Composed of a tensor library's operations, adding the bias
//! and a leaky rectifier take eight passes forward and backward, and the hyperbolic tangent of the C library costs as much as
//! a layer's matrix product. The backward pass needs the output `y` alone: the slope is `y > 0 ? 1 : s` for rectifiers and
//! `1 - y^2` for the tangent.

use burn::Tensor;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use serde::{Deserialize, Serialize};

/// Slope of the leaky rectifier below zero (Maas et al. 2013).
pub const LEAKY_SLOPE: f64 = 0.01;

/// The non-linearity after a hidden layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// `max(x, 0)`.
    Relu,
    /// `x` above zero, `0.01 x` below.
    LeakyRelu,
    /// Hyperbolic tangent.
    Tanh,
}

impl Activation {
    /// `f(x + bias)` of `f32` tensors `[rows, columns]` and `[columns]`.
    ///
    /// # Panics
    /// Where the bias has another length than the rows of `x`.
    #[must_use]
    pub fn apply(self, x: Tensor<2>, bias: Tensor<1>) -> Tensor<2> {
        assert_eq!(x.dims()[1], bias.dims()[0], "one bias per column");
        Tensor::from_dispatch(<Dispatch as ActivationOperation>::activate(x.into_dispatch(), bias.into_dispatch(), self))
    }

    /// What keeps the variance of a layer's output at that of its input.
    #[must_use]
    pub fn gain(self) -> f64 {
        match self {
            Activation::Relu => std::f64::consts::SQRT_2,
            Activation::LeakyRelu => (2.0 / (1.0 + LEAKY_SLOPE * LEAKY_SLOPE)).sqrt(),
            Activation::Tanh => 5.0 / 3.0,
        }
    }

    fn forward(self, x: &mut [f32], bias: &[f32]) {
        for row in x.chunks_exact_mut(bias.len()) {
            row.iter_mut().zip(bias).for_each(|(x, b)| *x += b);
        }
        match self {
            Activation::Relu => x.iter_mut().for_each(|x| *x = rectified(*x, 0.0)),
            Activation::LeakyRelu => x.iter_mut().for_each(|x| *x = rectified(*x, LEAKY)),
            Activation::Tanh => x.iter_mut().for_each(|x| *x = tanh(*x)),
        }
    }

    /// Multiplies the gradient in the output `y` by the slope.
    fn backward(self, y: &[f32], gradient: &mut [f32]) {
        let pairs = gradient.iter_mut().zip(y);
        match self {
            Activation::Relu => pairs.for_each(|(g, y)| *g *= slope(*y, 0.0)),
            Activation::LeakyRelu => pairs.for_each(|(g, y)| *g *= slope(*y, LEAKY)),
            Activation::Tanh => pairs.for_each(|(g, y)| *g *= 1.0 - y * y),
        }
    }
}

#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
const LEAKY: f32 = LEAKY_SLOPE as f32;

/// Written so that a NaN stays one.
fn rectified(x: f32, below: f32) -> f32 {
    if x <= 0.0 { below * x } else { x }
}

fn slope(y: f32, below: f32) -> f32 {
    if y > 0.0 { 1.0 } else { below }
}

/// Hyperbolic tangent as a quotient of polynomials in `x^2` on the range where it differs from 1 in `f32`.
///
/// The coefficients are the minimax ones in wide use since Eigen 3.3; the error is below 4e-7 (tested over the whole range).
fn tanh(x: f32) -> f32 {
    const P: [f32; 7] =
        [-2.760_768_5e-16, 2.000_187_9e-13, -8.604_672e-11, 5.122_297_1e-8, 1.485_722_4e-5, 6.372_619e-4, 4.893_524_6e-3];
    const Q: [f32; 4] = [1.198_258_4e-6, 1.185_347e-4, 2.268_434_6e-3, 4.893_525e-3];
    let x = x.clamp(-7.905_311, 7.905_311);
    let square = x * x;
    let p = P.iter().fold(0.0, |sum, c| sum * square + c);
    let q = Q.iter().fold(0.0, |sum, c| sum * square + c);
    x * p / q
}

/// The operation on the tensors of one backend.
#[backend_extension(Flex, Autodiff)]
trait ActivationOperation: Backend {
    /// Adds the bias and applies the activation.
    fn activate(x: FloatTensor<Self>, bias: FloatTensor<Self>, activation: Activation) -> FloatTensor<Self>;
}

/// The two passes over plain tensors. A further backend implements them and is named as a selector above.
trait ActivationPasses: Backend {
    /// The output of the input.
    fn forward(x: FloatTensor<Self>, bias: FloatTensor<Self>, activation: Activation) -> FloatTensor<Self>;

    /// The gradient in `x + bias`, from the output and the gradient in it.
    fn backward(y: FloatTensor<Self>, gradient: FloatTensor<Self>, activation: Activation) -> FloatTensor<Self>;
}

impl ActivationPasses for Flex {
    fn forward(x: FloatTensor<Self>, bias: FloatTensor<Self>, activation: Activation) -> FloatTensor<Self> {
        let (mut x, bias) = (x.to_contiguous(), bias.to_contiguous());
        activation.forward(x.storage_mut::<f32>(), bias.storage::<f32>());
        x
    }

    fn backward(y: FloatTensor<Self>, gradient: FloatTensor<Self>, activation: Activation) -> FloatTensor<Self> {
        let (y, mut gradient) = (y.to_contiguous(), gradient.to_contiguous());
        activation.backward(y.storage::<f32>(), gradient.storage_mut::<f32>());
        gradient
    }
}

impl ActivationOperation for Flex {
    fn activate(x: FloatTensor<Self>, bias: FloatTensor<Self>, activation: Activation) -> FloatTensor<Self> {
        Self::forward(x, bias, activation)
    }
}

impl<B: ActivationPasses, C: CheckpointStrategy> ActivationOperation for Autodiff<B, C> {
    fn activate(x: FloatTensor<Self>, bias: FloatTensor<Self>, activation: Activation) -> FloatTensor<Self> {
        let nodes = [x.node(), bias.node()];
        let y = B::forward(x.into_primitive(), bias.into_primitive(), activation);
        match ActivationBackward::<B>::default().prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(operation) => operation.finish((y.clone(), activation), y),
            OpsKind::UnTracked(operation) => operation.finish(y),
        }
    }
}

/// The backward step; its state is the output.
#[derive(Debug)]
struct ActivationBackward<B>(std::marker::PhantomData<fn() -> B>);

impl<B> Default for ActivationBackward<B> {
    fn default() -> Self {
        Self(std::marker::PhantomData)
    }
}

impl<B: ActivationPasses> Backward<B, 2> for ActivationBackward<B> {
    type State = (FloatTensor<B>, Activation);

    fn backward(self, operation: Ops<Self::State, 2>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (y, activation) = operation.state;
        let [x_node, bias_node] = operation.parents;
        let upstream = gradients.consume::<B>(&operation.node);
        let gradient = B::backward(y, upstream, activation);
        if let Some(node) = bias_node {
            gradients.register::<B>(node.id, B::linear_bias_backward(gradient.clone()));
        }
        if let Some(node) = x_node {
            gradients.register::<B>(node.id, gradient);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{device, matrix, values};

    #[test]
    fn the_tangent_is_accurate_over_its_range() {
        for i in -200_000..=200_000 {
            #[allow(clippy::cast_precision_loss, reason = "a small integer")]
            let x = i as f32 * 1e-4;
            let exact = f64::from(x).tanh();
            assert!((f64::from(tanh(x)) - exact).abs() < 4e-7, "{x}: {} {exact}", tanh(x));
        }
        assert!(tanh(f32::NAN).is_nan() && tanh(1e30) <= 1.0 && tanh(0.0) == 0.0);
        let small = f64::from(tanh(1e-4));
        assert!((small / 1e-4f64.tanh() - 1.0).abs() < 1e-6);
    }

    fn no_bias(columns: usize) -> Tensor<1> {
        Tensor::zeros([columns], &device())
    }

    #[test]
    fn values_and_slopes_by_hand() {
        for (activation, y, slopes) in
            [(Activation::Relu, [0.0, 0.0, 3.0], [0.0, 0.0, 2.0]), (Activation::LeakyRelu, [-0.02, 0.0, 3.0], [0.02, 0.02, 2.0])]
        {
            let x = Tensor::<2>::from_inner(matrix(vec![-2.5, -0.5, 2.5], 3)).require_grad();
            let bias = Tensor::<1>::from_data([0.5, 0.5, 0.5], &device().autodiff()).require_grad();
            let out = activation.apply(x.clone(), bias.clone());
            let gradients = (out.clone() * 2.0).sum().backward();
            assert_eq!((values(out), values(x.grad(&gradients).unwrap())), (y.to_vec(), slopes.to_vec()));
            assert_eq!(values(bias.grad(&gradients).unwrap()), slopes);
        }
        assert!(values(Activation::Relu.apply(matrix(vec![f32::NAN], 1), no_bias(1)))[0].is_nan());
    }

    #[test]
    fn the_gradient_in_the_bias_is_summed_over_rows() {
        let x = matrix(vec![1.0, -1.0, 2.0, 3.0, -4.0, 0.5], 2);
        let bias = Tensor::<1>::from_data([0.0, 0.0], &device().autodiff()).require_grad();
        let gradients = Activation::LeakyRelu.apply(x, bias.clone()).sum().backward();
        // Columns (1, 2, -4) and (-1, 3, 0.5).
        assert_eq!(values(bias.grad(&gradients).unwrap()), [2.01, 2.01]);
    }

    #[test]
    fn an_input_that_is_used_again_stays_as_it_was() {
        let x = matrix(vec![-2.0, 1.0], 2);
        let y = Activation::Relu.apply(x.clone(), no_bias(2));
        assert_eq!((values(x), values(y)), (vec![-2.0, 1.0], vec![0.0, 1.0]));
        let x = Tensor::<2>::from_data([[-1.0, 0.5], [2.0, -3.0]], &device().autodiff()).require_grad();
        // A transposed view is not laid out row by row.
        let gradients = (Activation::Tanh.apply(x.clone().transpose(), no_bias(2)) + x.clone()).sum().backward();
        let expected: Vec<f64> = [-1.0f64, 0.5, 2.0, -3.0].iter().map(|x| 2.0 - x.tanh().powi(2)).collect();
        let gradient = values(x.grad(&gradients).unwrap());
        assert!(gradient.iter().zip(expected).all(|(g, e)| (f64::from(*g) - e).abs() < 1e-5), "{gradient:?}");
    }
}
