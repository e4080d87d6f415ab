//! Fully connected networks, initialised from a given random stream.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | W_k | `NAME.layers.k.weight` of the state, a layer computes `x W + b` | `[inputs, outputs]` |
//! | b_k | `NAME.layers.k.bias` of the state | `[1, outputs]` |

use crate::activation::Activation;
use plan::{Equations, Expression, State};
use rand::{Rng, RngCore};

/// Name, layer sizes and activations of a network. Its parameters are in a state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Network {
    name: String,
    sizes: Vec<usize>,
    activations: Vec<Activation>,
}

impl Network {
    /// Describes a network with layer sizes `sizes` (input first, output last) and one activation per hidden layer, or
    /// per layer.
    ///
    /// # Panics
    /// If the number of activations is neither that of the layers nor that of the hidden ones.
    #[must_use]
    pub fn new(name: impl Into<String>, sizes: &[usize], activations: &[Activation]) -> Self {
        assert!(
            [1, 2].contains(&(sizes.len() - activations.len())),
            "one activation per layer of {sizes:?}, or per hidden layer, got {activations:?}"
        );
        Self {
            name: name.into(),
            sizes: sizes.to_vec(),
            activations: activations.to_vec(),
        }
    }

    /// Adds weights after He et al. 2015 ("Delving deep into rectifiers", eq. 10 and 14) in the uniform form: bound
    /// `gain sqrt(3 / inputs)` with the gain of the activation that follows; biases start at 0. `output_gain` scales
    /// the weights of a last layer without activation: 1 keeps the variance, a small value starts near zero.
    pub fn initialise(&self, output_gain: f64, state: &mut State<f32>, rng: &mut impl RngCore) {
        let gain = |layer: usize| self.activations.get(layer).map_or(output_gain, |it| it.gain());
        let bound = |layer: usize, [inputs, _]: [usize; 2]| gain(layer) * (3.0 / inputs as f64).sqrt();
        self.fill(bound, |_| 0.0, state, rng);
    }

    /// Adds weights uniform in `+-sqrt(6 / (inputs + outputs))` (Glorot and Bengio 2010, "Understanding the difficulty
    /// of training deep feedforward neural networks", eq. 16) and biases of 0.
    pub fn initialise_glorot(&self, state: &mut State<f32>, rng: &mut impl RngCore) {
        let bound = |_, [inputs, outputs]: [usize; 2]| (6.0 / (inputs + outputs) as f64).sqrt();
        self.fill(bound, |_| 0.0, state, rng);
    }

    /// Adds weights and biases uniform in `+-1 / sqrt(inputs)`, as PyTorch starts its linear layers.
    pub fn initialise_uniform(&self, state: &mut State<f32>, rng: &mut impl RngCore) {
        let bound = |[inputs, _]: [usize; 2]| 1.0 / (inputs as f64).sqrt();
        self.fill(|_, sizes| bound(sizes), bound, state, rng);
    }

    fn fill(
        &self,
        weight_bound: impl Fn(usize, [usize; 2]) -> f64,
        bias_bound: impl Fn([usize; 2]) -> f64,
        state: &mut State<f32>,
        rng: &mut impl RngCore,
    ) {
        for (layer, sizes) in self.layers() {
            let [inputs, outputs] = sizes;
            let weight = uniform(inputs * outputs, weight_bound(layer, sizes), rng);
            state.insert(self.parameter(layer, "weight"), sizes, weight);
            let bias = uniform(outputs, bias_bound(sizes), rng);
            state.insert(self.parameter(layer, "bias"), [1, outputs], bias);
        }
    }

    /// A network of the same shape under another name.
    #[must_use]
    pub fn renamed(&self, name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            ..self.clone()
        }
    }

    /// Adds a copy of the parameters under another name, and describes it.
    #[must_use]
    pub fn copied(&self, name: impl Into<String>, state: &mut State<f32>) -> Self {
        let copy = self.renamed(name);
        state.copy(&self.name, &copy.name);
        copy
    }

    /// Outputs `[rows, outputs]` of inputs `[rows, inputs]`.
    #[must_use]
    pub fn apply<'e>(&self, x: Expression<'e>) -> Expression<'e> {
        let parameters = self.parameters(x.equations());
        let layers = parameters.chunks_exact(2).enumerate();
        layers.fold(x, |x, (layer, parameters)| {
            let activation = self.activations.get(layer).map(|it| (*it).into());
            x.dense(parameters[0], parameters[1], activation.unwrap_or_default())
        })
    }

    /// Weight and bias of each layer.
    #[must_use]
    pub fn parameters<'e>(&self, equations: &'e Equations) -> Vec<Expression<'e>> {
        let of_layer = |(layer, sizes): (usize, [usize; 2])| {
            [
                equations.parameter(&self.parameter(layer, "weight"), sizes),
                equations.parameter(&self.parameter(layer, "bias"), [1, sizes[1]]),
            ]
        };
        self.layers().flat_map(of_layer).collect()
    }

    /// Names of the parameters in the state, weight and bias of each layer.
    #[must_use]
    pub fn parameter_names(&self) -> Vec<String> {
        let of_layer = |(layer, _)| ["weight", "bias"].map(|part| self.parameter(layer, part));
        self.layers().flat_map(of_layer).collect()
    }

    fn parameter(&self, layer: usize, part: &str) -> String {
        format!("{}.layers.{layer}.{part}", self.name)
    }

    fn layers(&self) -> impl Iterator<Item = (usize, [usize; 2])> {
        self.sizes.windows(2).map(|pair| [pair[0], pair[1]]).enumerate()
    }

    /// Name of the network, the beginning of the names of its parameters.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Layer sizes, input first.
    #[must_use]
    pub fn sizes(&self) -> &[usize] {
        &self.sizes
    }

    /// Activation of each hidden layer, and of the last layer if it has one.
    #[must_use]
    pub fn activations(&self) -> &[Activation] {
        &self.activations
    }
}

impl From<Activation> for plan::Activation {
    fn from(activation: Activation) -> Self {
        match activation {
            Activation::Relu => plan::Activation::Relu,
            Activation::LeakyRelu => plan::Activation::LeakyRelu,
            Activation::Tanh => plan::Activation::Tanh,
        }
    }
}

/// Parameters of several networks, one after the other.
#[must_use]
pub fn parameters<'e>(networks: &[Network], equations: &'e Equations) -> Vec<Expression<'e>> {
    let of_each = networks.iter().map(|network| network.parameters(equations));
    of_each.collect::<Vec<_>>().concat()
}

/// The lower of two critics' values.
#[must_use]
pub fn lower<'e>([first, second]: &[Network; 2], x: Expression<'e>) -> Expression<'e> {
    first.apply(x).min(second.apply(x))
}

/// Numbers drawn uniformly between minus `bound` and `bound`; zeros, without a draw, for a bound of 0.
#[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
fn uniform(count: usize, bound: f64, rng: &mut impl RngCore) -> Vec<f32> {
    if bound == 0.0 {
        return vec![0.0; count];
    }
    (0..count)
        .map(|_| ((2.0 * rng.random::<f64>() - 1.0) * bound) as f32)
        .collect()
}
