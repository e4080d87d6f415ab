//! The controller: an LSTM that decides one choice after the other, each given the earlier ones.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x | embedding of the latest option; zeros before the first one | `[1, width]` |
//! | h, c | output and cell state of the LSTM | `[1, width]` each |
//! | i, f, g, o | gates, the four parts of `x W + h U + b` | `[1, width]` each |
//! | z | outputs of a choice, `h V + d` | `[1, options]` |
//!
//! `c' = sigmoid(f) c + sigmoid(i) tanh(g)`, `h' = sigmoid(o) tanh(c')`. All parameters are uniform in -0.1..0.1, as
//! in the released code; the biases too.

use burn::module::{Module, Param};
use burn::tensor::activation::{log_softmax, sigmoid};
use burn::tensor::{Tensor, TensorData};
use numerics::network::{device, values};
use rand::{Rng, RngCore};

/// Bound of the uniform distribution of initial parameters.
const BOUND: f32 = 0.1;

/// An affine layer, `x W + b`.
#[derive(Module, Debug)]
struct AffineLayer {
    weight: Param<Tensor<2>>,
    bias: Param<Tensor<2>>,
}

impl AffineLayer {
    fn new(inputs: usize, outputs: usize, rng: &mut impl RngCore) -> Self {
        Self {
            weight: uniform([inputs, outputs], rng),
            bias: uniform([1, outputs], rng),
        }
    }

    fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        x.matmul(self.weight.val()) + self.bias.val()
    }
}

/// The controller. A default one is a placeholder without choices.
#[derive(Module, Debug, Default)]
pub(super) struct Controller {
    /// One row per option of every choice, `[options, width]`.
    embedding: Vec<Param<Tensor<2>>>,
    /// Gates `[width, 4 width]`: one layer for the input, one for the state.
    gates: Vec<AffineLayer>,
    /// Output layers, one per choice.
    outputs: Vec<AffineLayer>,
    #[module(skip)]
    sizes: Vec<usize>,
    #[module(skip)]
    width: usize,
}

/// State of the LSTM between two choices.
struct DecisionState {
    input: Tensor<2>,
    hidden: Tensor<2>,
    cell: Tensor<2>,
}

impl Controller {
    /// Creates a controller for choices with these numbers of options.
    pub(super) fn new(sizes: &[usize], width: usize, rng: &mut impl RngCore) -> Self {
        Self {
            embedding: vec![uniform([sizes.iter().sum(), width], rng)],
            gates: (0..2).map(|_| AffineLayer::new(width, 4 * width, rng)).collect(),
            outputs: sizes
                .iter()
                .map(|size| AffineLayer::new(width, *size, rng))
                .collect(),
            sizes: sizes.to_vec(),
            width,
        }
    }

    /// Options of the next step of a design; `pick` selects each from its probabilities.
    pub(super) fn decide(&self, so_far: &[Vec<usize>], pick: &mut dyn FnMut(&[f32]) -> usize) -> Vec<usize> {
        let plain = self.valid();
        let mut place = plain.start();
        for step in so_far {
            for (choice, taken) in step.iter().enumerate() {
                place = plain.advance(place, choice).0;
                place.input = plain.embedded(choice, *taken);
            }
        }
        let mut decide = |choice: usize| {
            let (next, log_probabilities) = plain.advance(
                DecisionState {
                    input: place.input.clone(),
                    hidden: place.hidden.clone(),
                    cell: place.cell.clone(),
                },
                choice,
            );
            let taken = pick(&values(log_probabilities.exp()));
            place = next;
            place.input = plain.embedded(choice, taken);
            taken
        };
        (0..self.sizes.len()).map(&mut decide).collect()
    }

    /// Log probability of the options in the last step of a design, given the earlier steps, and the sum of
    /// the entropies of their distributions; `[1]` each.
    pub(super) fn judged(&self, design: &[Vec<usize>]) -> (Tensor<1>, Tensor<1>) {
        let zero = || Tensor::<1>::from_inner(Tensor::zeros([1], &device()));
        let (mut log_probability, mut entropy) = (zero(), zero());
        let mut place = self.start();
        for (step, options) in design.iter().enumerate() {
            for (choice, taken) in options.iter().enumerate() {
                let (next, logs) = self.advance(place, choice);
                if step + 1 == design.len() {
                    log_probability = log_probability + logs.clone().slice([0..1, *taken..taken + 1]).sum();
                    entropy = entropy - (logs.clone().exp() * logs).sum();
                }
                place = next;
                place.input = self.embedded(choice, *taken);
            }
        }
        (log_probability, entropy)
    }

    fn start(&self) -> DecisionState {
        let zeros = || {
            let zeros = Tensor::<2>::zeros([1, self.width], &device());
            if self.embedding[0].val().is_autodiff() {
                Tensor::from_inner(zeros)
            } else {
                zeros
            }
        };
        DecisionState {
            input: zeros(),
            hidden: zeros(),
            cell: zeros(),
        }
    }

    /// State after a choice, and the log probabilities of its options.
    fn advance(&self, place: DecisionState, choice: usize) -> (DecisionState, Tensor<2>) {
        let sum = self.gates[0].forward(place.input.clone()) + self.gates[1].forward(place.hidden);
        let gate = |at: usize| sum.clone().slice([0..1, at * self.width..(at + 1) * self.width]);
        let cell = sigmoid(gate(1)) * place.cell + sigmoid(gate(0)) * gate(2).tanh();
        let hidden = sigmoid(gate(3)) * cell.clone().tanh();
        let logs = log_softmax(self.outputs[choice].forward(hidden.clone()), 1);
        let next = DecisionState {
            input: place.input,
            hidden,
            cell,
        };
        (next, logs)
    }

    fn embedded(&self, choice: usize, taken: usize) -> Tensor<2> {
        let row = self.sizes[..choice].iter().sum::<usize>() + taken;
        self.embedding[0].val().slice([row..row + 1, 0..self.width])
    }
}

fn uniform(shape: [usize; 2], rng: &mut impl RngCore) -> Param<Tensor<2>> {
    let numbers: Vec<f32> = (0..shape[0] * shape[1])
        .map(|_| rng.random_range(-BOUND..BOUND))
        .collect();
    let tensor = Tensor::<2>::from_data(TensorData::new(numbers, shape), &device().autodiff());
    Param::from_tensor(tensor)
}
