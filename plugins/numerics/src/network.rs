//! Fully connected networks on `burn`, initialised from a given random stream.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | W_k | weight of layer k | `[inputs, outputs]`, a layer computes `x W + b` |
//! | b_k | bias of layer k | `[outputs]` |
//!
//! Weights follow He et al. 2015 ("Delving deep into rectifiers", eq. 10 and 14) in the uniform form: bound
//! `gain sqrt(3 / inputs)` with the gain of the activation that follows; biases start at 0.
//!
//! A network on a device with autodiff (`device().autodiff()`) is trained; `burn`'s `valid()` returns a plain
//! copy of it that shares the numbers. A plain network applied to a tracked input passes gradients to that
//! input and has none in its own weights: a policy is thus improved through a critic.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor, TensorData, activation};

pub use crate::activation::Activation;
use crate::dense::dense;
use rand::{Rng, RngCore};

/// Processor without gradients. Every tensor with data starts on this device.
#[must_use]
pub fn device() -> Device {
    Device::flex()
}

/// Softplus `ln(1 + e^x)`, without overflow for any `x`.
#[must_use]
pub fn softplus(x: Tensor<2>) -> Tensor<2> {
    activation::log_sigmoid(x.neg()).neg()
}

/// Plain tensor `[rows, columns]` from values row by row.
///
/// # Panics
/// Where the number of values is no multiple of `columns`.
#[must_use]
pub fn matrix(values: Vec<f32>, columns: usize) -> Tensor<2> {
    assert_eq!(
        values.len() % columns,
        0,
        "{} values are no rows of {columns}",
        values.len()
    );
    let rows = values.len() / columns;
    Tensor::from_data(TensorData::new(values, [rows, columns]), &device())
}

/// Entries of a tensor on the host, row by row.
///
/// # Panics
/// Never for tensors of this crate: they are all `f32` and in the processor's memory.
#[must_use]
pub fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    let tensor = if tensor.is_autodiff() {
        tensor.inner()
    } else {
        tensor
    };
    // Reading f32 from a device that lives in the processor's own memory cannot fail.
    tensor
        .into_data()
        .try_into_vec::<f32>()
        .expect("f32 in the processor's memory")
}

/// A layer `x W + b`.
#[derive(Module, Debug)]
struct Linear {
    weight: Param<Tensor<2>>,
    bias: Param<Tensor<1>>,
}

/// A fully connected network. A default one has no layers and is a placeholder.
#[derive(Module, Debug, Default)]
pub struct Mlp {
    layers: Vec<Linear>,
    #[module(skip)]
    activations: Vec<Activation>,
}

impl Mlp {
    /// Creates a network with layer sizes `sizes` (input first, output last) and one activation per hidden
    /// layer.
    ///
    /// `output_gain` scales the weights of the last layer: 1 keeps the variance, a small value starts near
    /// zero.
    ///
    /// # Panics
    /// Where the number of activations is not the number of hidden layers.
    pub fn new(
        sizes: &[usize],
        activations: &[Activation],
        output_gain: f64,
        rng: &mut impl RngCore,
        device: &Device,
    ) -> Self {
        assert_eq!(
            activations.len() + 2,
            sizes.len(),
            "one activation per hidden layer of {sizes:?}, got {activations:?}"
        );
        let gains = activations
            .iter()
            .map(|activation| activation.gain())
            .chain([output_gain]);
        let layers = sizes
            .windows(2)
            .zip(gains)
            .map(|(pair, gain)| kaiming(pair[0], pair[1], gain, rng, device))
            .collect();
        Self {
            layers,
            activations: activations.to_vec(),
        }
    }

    /// Creates a network with weights uniform in `+-sqrt(6 / (inputs + outputs))` (Glorot and Bengio 2010,
    /// "Understanding the difficulty of training deep feedforward neural networks", eq. 16) and biases of 0.
    /// With one activation per layer the last layer has one too: the outputs are those of a hidden layer.
    ///
    /// # Panics
    /// Where the number of activations is neither that of the layers nor that of the hidden ones.
    pub fn glorot(
        sizes: &[usize],
        activations: &[Activation],
        rng: &mut impl RngCore,
        device: &Device,
    ) -> Self {
        assert!(
            [1, 2].contains(&(sizes.len() - activations.len())),
            "one activation per layer of {sizes:?}, or per hidden layer, got {activations:?}"
        );
        let layers = sizes.windows(2).map(|pair| {
            let [inputs, outputs] = [pair[0], pair[1]];
            #[allow(clippy::cast_precision_loss, reason = "a layer size is far below 2^52")]
            let bound = (6.0 / (inputs + outputs) as f64).sqrt();
            let weight = uniform(inputs * outputs, bound, rng);
            linear(weight, vec![0.0; outputs], inputs, device)
        });
        Self {
            layers: layers.collect(),
            activations: activations.to_vec(),
        }
    }

    /// Creates a network with weights and biases uniform in `+-1 / sqrt(inputs)`, as PyTorch starts its
    /// linear layers.
    ///
    /// # Panics
    /// Where the number of activations is not the number of hidden layers.
    pub fn uniform(
        sizes: &[usize],
        activations: &[Activation],
        rng: &mut impl RngCore,
        device: &Device,
    ) -> Self {
        assert_eq!(
            activations.len() + 2,
            sizes.len(),
            "one activation per hidden layer of {sizes:?}, got {activations:?}"
        );
        let layers = sizes.windows(2).map(|pair| {
            let [inputs, outputs] = [pair[0], pair[1]];
            #[allow(clippy::cast_precision_loss, reason = "a layer size is far below 2^52")]
            let bound = 1.0 / (inputs as f64).sqrt();
            let (weight, bias) = (
                uniform(inputs * outputs, bound, rng),
                uniform(outputs, bound, rng),
            );
            linear(weight, bias, inputs, device)
        });
        Self {
            layers: layers.collect(),
            activations: activations.to_vec(),
        }
    }

    /// Outputs `[rows, outputs]` of inputs `[rows, inputs]`.
    #[must_use]
    pub fn forward(&self, mut x: Tensor<2>) -> Tensor<2> {
        let activations = self.activations.iter().copied().map(Some).chain([None]);
        for (layer, activation) in self.layers.iter().zip(activations) {
            x = dense(x, layer.weight.val(), layer.bias.val(), activation);
        }
        x
    }

    /// Layer sizes, input first.
    #[must_use]
    pub fn sizes(&self) -> Vec<usize> {
        let inputs = self.layers.iter().map(|layer| layer.weight.dims()[0]);
        inputs
            .chain(self.layers.last().map(|layer| layer.weight.dims()[1]))
            .collect()
    }

    /// Activation of each hidden layer, and of the last layer where it has one.
    #[must_use]
    pub fn activations(&self) -> &[Activation] {
        &self.activations
    }
}

fn kaiming(inputs: usize, outputs: usize, gain: f64, rng: &mut impl RngCore, device: &Device) -> Linear {
    #[allow(clippy::cast_precision_loss, reason = "a layer size is far below 2^52")]
    let bound = gain * (3.0 / inputs as f64).sqrt();
    linear(
        uniform(inputs * outputs, bound, rng),
        vec![0.0; outputs],
        inputs,
        device,
    )
}

/// Numbers drawn uniformly between minus `bound` and `bound`.
#[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
fn uniform(count: usize, bound: f64, rng: &mut impl RngCore) -> Vec<f32> {
    (0..count)
        .map(|_| ((2.0 * rng.random::<f64>() - 1.0) * bound) as f32)
        .collect()
}

fn linear(weight: Vec<f32>, bias: Vec<f32>, inputs: usize, device: &Device) -> Linear {
    let outputs = bias.len();
    let weight = Tensor::<2>::from_data(TensorData::new(weight, [inputs, outputs]), device);
    let bias = Tensor::<1>::from_data(TensorData::new(bias, [outputs]), device);
    Linear {
        weight: Param::from_tensor(weight),
        bias: Param::from_tensor(bias),
    }
}

/// Two networks of one shape with their own parameters, such as the two critics of clipped double Q-learning.
///
/// They are evaluated one after the other: stacked as one batched product they took the same time (within 4 %
/// on one thread at 256 units, batch 256).
#[derive(Module, Debug, Default)]
pub struct TwinMlp {
    /// First network.
    pub first: Mlp,
    /// Second network.
    pub second: Mlp,
}

impl TwinMlp {
    /// Creates both networks by [`Mlp::new`].
    pub fn new(
        sizes: &[usize],
        activations: &[Activation],
        output_gain: f64,
        rng: &mut impl RngCore,
        device: &Device,
    ) -> Self {
        let mut network = || Mlp::new(sizes, activations, output_gain, rng, device);
        Self {
            first: network(),
            second: network(),
        }
    }

    /// Outputs of both networks for the same input.
    #[must_use]
    pub fn forward(&self, x: Tensor<2>) -> (Tensor<2>, Tensor<2>) {
        (self.first.forward(x.clone()), self.second.forward(x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::{parameters, with_parameters};
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    fn rng() -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(7)
    }

    #[test]
    fn two_layers_by_hand() {
        let network = Mlp::new(&[2, 2, 1], &[Activation::LeakyRelu], 1.0, &mut rng(), &device());
        let mut numbers = parameters(&network);
        let by_name = [
            vec![1.0, -1.0, 2.0, 0.5],
            vec![0.5, -3.0],
            vec![2.0, 10.0],
            vec![0.25],
        ];
        for (parameter, values) in numbers.iter_mut().zip(by_name) {
            parameter.values = values;
        }
        let network = with_parameters(network, &numbers).unwrap();
        // Hidden: (1 + 4 + 0.5, -1 + 1 - 3) = (5.5, -3) -> (5.5, -0.03); output 11 - 0.3 + 0.25.
        let out = values(network.forward(matrix(vec![1.0, 2.0], 2)));
        assert!((out[0] - 10.95).abs() < 1e-5, "{out:?}");
        assert_eq!(network.sizes(), [2, 2, 1]);
    }

    #[test]
    fn weights_after_glorot_have_the_variance_of_their_bound() {
        let network = Mlp::glorot(&[50, 400, 1], &[Activation::Relu], &mut rng(), &device());
        let numbers = parameters(&network);
        let weight = &numbers[0].values;
        assert!(weight.iter().all(|w| w.abs() <= (6.0f32 / 450.0).sqrt()));
        let variance = weight.iter().map(|w| w * w).sum::<f32>() / weight.len() as f32;
        assert!((variance / (2.0 / 450.0) - 1.0).abs() < 0.03, "{variance}");
        assert!(numbers[1].values.iter().all(|bias| *bias == 0.0));
    }

    #[test]
    fn the_last_layer_can_have_an_activation() {
        let network = |activations: &[Activation]| {
            let network = Mlp::glorot(&[2, 3, 8], activations, &mut rng(), &device());
            values(network.forward(matrix(vec![1.0, 2.0, -0.5, 0.3], 2)))
        };
        let before = network(&[Activation::Tanh]);
        let rectified = network(&[Activation::Tanh, Activation::Relu]);
        assert!(before.iter().any(|z| *z < 0.0) && before.iter().any(|z| *z > 0.0));
        assert_eq!(rectified, before.iter().map(|z| z.max(0.0)).collect::<Vec<_>>());
    }

    #[test]
    fn weights_stay_inside_the_bound_and_have_its_variance() {
        let network = Mlp::new(&[50, 400, 1], &[Activation::Relu], 1.0, &mut rng(), &device());
        let weight = &parameters(&network)[0].values;
        let bound = (6.0f32 / 50.0).sqrt();
        assert!(weight.iter().all(|w| w.abs() <= bound));
        let variance = weight.iter().map(|w| w * w).sum::<f32>() / weight.len() as f32;
        assert!((variance / (2.0 / 50.0) - 1.0).abs() < 0.03, "{variance}");
    }

    #[test]
    fn uniform_weights_and_biases_have_the_variance_of_their_bound() {
        let network = Mlp::uniform(&[50, 400, 1], &[Activation::Relu], &mut rng(), &device());
        for numbers in &parameters(&network)[..2] {
            assert!(
                numbers.values.iter().all(|x| x.abs() <= (1.0f32 / 50.0).sqrt()),
                "{}",
                numbers.name
            );
            let variance = numbers.values.iter().map(|x| x * x).sum::<f32>() / numbers.values.len() as f32;
            assert!(
                (variance / (1.0 / 150.0) - 1.0).abs() < 0.15,
                "{} {variance}",
                numbers.name
            );
        }
    }

    #[test]
    fn the_stream_alone_decides_the_weights() {
        let make = || {
            parameters(&Mlp::new(
                &[3, 8, 2],
                &[Activation::Tanh],
                1.0,
                &mut rng(),
                &device(),
            ))
        };
        assert_eq!(make(), make());
    }

    fn loss(network: &Mlp, x: &Tensor<2>) -> Tensor<1> {
        network.forward(x.clone()).powf_scalar(2.0).sum()
    }

    #[test]
    fn gradients_of_every_activation_agree_with_finite_differences() {
        let activations = [Activation::LeakyRelu, Activation::Tanh, Activation::Relu];
        let network = Mlp::new(
            &[3, 5, 5, 5, 2],
            &activations,
            1.0,
            &mut rng(),
            &device().autodiff(),
        );
        let x = matrix(vec![0.3, -1.2, 0.7, 0.9, 0.1, -0.4], 3);
        let mut gradients = loss(&network, &x).backward();
        let analytic = crate::optimizer::gradients(&network, &mut gradients);
        let plain = network.valid();
        let numbers = parameters(&plain);
        for (p, parameter) in numbers.iter().enumerate() {
            for i in (0..parameter.values.len()).step_by(3) {
                let at = |step: f32| {
                    let mut moved = numbers.clone();
                    moved[p].values[i] += step;
                    f64::from(values(loss(&with_parameters(plain.clone(), &moved).unwrap(), &x))[0])
                };
                let difference = (at(1e-2) - at(-1e-2)) / 2e-2;
                let gradient = f64::from(analytic[p][i]);
                assert!(
                    (difference - gradient).abs() < 2e-2 * (1.0 + gradient.abs()),
                    "{} {i}: {difference} {gradient}",
                    parameter.name
                );
            }
        }
    }

    #[test]
    fn a_plain_network_passes_gradients_to_a_tracked_input() {
        let critic = Mlp::new(
            &[2, 4, 1],
            &[Activation::LeakyRelu],
            1.0,
            &mut rng(),
            &device().autodiff(),
        );
        let input = || Tensor::<2>::from_inner(matrix(vec![0.4, -0.3], 2)).require_grad();
        let (through_plain, through_tracked) = (input(), input());
        let plain = critic.valid().forward(through_plain.clone()).sum().backward();
        let tracked = critic.forward(through_tracked.clone()).sum().backward();
        let (plain, tracked) = (
            through_plain.grad(&plain).unwrap(),
            through_tracked.grad(&tracked).unwrap(),
        );
        let (plain, tracked) = (values(plain), values(tracked));
        assert_eq!(plain, tracked);
        assert!(plain.iter().any(|g| g.abs() > 1e-3));
    }

    #[test]
    fn twins_differ() {
        let twins = TwinMlp::new(&[2, 4, 1], &[Activation::Relu], 1.0, &mut rng(), &device());
        let (first, second) = twins.forward(matrix(vec![0.4, -0.3], 2));
        assert_ne!(values(first), values(second));
    }
}
