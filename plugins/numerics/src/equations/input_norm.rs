//! Batch normalisation of a network's inputs.
//!
//! Ioffe and Szegedy 2015, "Batch normalization", arXiv:1502.03167, algorithm 1, applied only to the inputs; scale and
//! shift are learned.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | x, y | inputs, normalised inputs | `[rows, columns]` |
//! | mu_B, sigma_B^2 | `Moments`, the variance is the biased one | `[1, columns]` |
//! | gamma, beta | `NAME.norm.weight` (starts at 1), `NAME.norm.bias` (starts at 0) of the state | `[1, columns]` |
//! | epsilon | [`EPSILON`] | scalar |
//!
//! `y = gamma (x - mu_B) / sqrt(sigma_B^2 + epsilon) + beta`; gradients also flow through the moments. If single rows
//! are evaluated (a policy that acts), [`RunningMoments`] replace those of the batch: `NAME.running_mean` and
//! `NAME.running_variance` of the state, which are changed by `RunningMoments::absorb` and by no optimiser.

use super::network::Network;
use super::state_file::{restore_network, restore_vector, store_network, store_vector};
use crate::activation::Activation;
use crate::tensor_file::{TensorFile, TensorFileError};
use plan::{Equations, Expression, State};
use rand::RngCore;

/// Summand that prevents division by zero for a constant column (PyTorch's default).
pub const EPSILON: f32 = 1e-5;
/// Weight of a new batch in the running moments (PyTorch's default).
const MOMENTUM: f64 = 0.1;

/// A network whose inputs may be normalised.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NormalisedNetwork {
    name: String,
    network: Network,
    normalises: bool,
}

/// Running mean and unbiased variance of each input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunningMoments {
    name: String,
    n_inputs: usize,
}

/// Moments of the columns of a batch.
#[derive(Debug, Clone, Copy)]
struct Moments<'e> {
    mean: Expression<'e>,
    /// Inputs minus their mean.
    centred: Expression<'e>,
    /// Biased variance.
    variance: Expression<'e>,
}

impl<'e> Moments<'e> {
    fn of(x: Expression<'e>) -> Self {
        let mean = x.mean_rows();
        let centred = x - mean;
        Self {
            mean,
            centred,
            variance: centred.square().mean_rows(),
        }
    }
}

/// `1 / sqrt(variance + epsilon)`.
fn inverse_sd(variance: Expression<'_>) -> Expression<'_> {
    1.0 / (variance + f64::from(EPSILON)).sqrt()
}

impl NormalisedNetwork {
    /// Describes a network with layer sizes `sizes` (input first, output last), the parameters `NAME.mlp`, and, if it
    /// normalises its inputs, `NAME.norm`.
    ///
    /// # Panics
    /// In the cases of [`Network::new`].
    #[must_use]
    pub fn new(name: &str, sizes: &[usize], activations: &[Activation], normalises: bool) -> Self {
        Self {
            network: Network::new(format!("{name}.mlp"), sizes, activations),
            name: name.to_owned(),
            normalises,
        }
    }

    /// Adds weights as [`Network::initialise`] does, scale 1 and shift 0.
    pub fn initialise(&self, output_gain: f64, state: &mut State<f32>, rng: &mut impl RngCore) {
        self.network.initialise(output_gain, state, rng);
        self.initialise_norm(state);
    }

    /// Adds weights as [`Network::initialise_uniform`] does, scale 1 and shift 0.
    pub fn initialise_uniform(&self, state: &mut State<f32>, rng: &mut impl RngCore) {
        self.network.initialise_uniform(state, rng);
        self.initialise_norm(state);
    }

    fn initialise_norm(&self, state: &mut State<f32>) {
        for (name, entry) in self.norm_names().into_iter().zip([1.0, 0.0]) {
            state.insert(name, [1, self.n_inputs()], vec![entry; self.n_inputs()]);
        }
    }

    /// Adds a copy of the parameters under another name, and describes it.
    #[must_use]
    pub fn copied(&self, name: &str, state: &mut State<f32>) -> Self {
        state.copy(&self.name, name);
        Self {
            network: self.network.renamed(format!("{name}.mlp")),
            name: name.to_owned(),
            normalises: self.normalises,
        }
    }

    /// Outputs `[rows, outputs]` of inputs `[rows, inputs]`, normalised by their own moments.
    #[must_use]
    pub fn by_batch<'e>(&self, x: Expression<'e>) -> Expression<'e> {
        self.network.apply(if self.normalises {
            self.normalised_by_batch(Moments::of(x))
        } else {
            x
        })
    }

    /// Outputs like those of [`NormalisedNetwork::by_batch`]; the running moments move towards those of the inputs.
    #[must_use]
    pub fn by_batch_absorbed<'e>(&self, x: Expression<'e>, running: &RunningMoments) -> Expression<'e> {
        if !self.normalises {
            return self.network.apply(x);
        }
        let moments = Moments::of(x);
        running.absorb(moments);
        self.network.apply(self.normalised_by_batch(moments))
    }

    /// Outputs `[rows, outputs]` of inputs `[rows, inputs]`, normalised by running moments; a row does not
    /// depend on the others.
    #[must_use]
    pub fn by_moments<'e>(&self, x: Expression<'e>, running: &RunningMoments) -> Expression<'e> {
        self.network.apply(if self.normalises {
            let [mean, variance] = running.parameters(x.equations());
            self.scaled(x - mean, variance)
        } else {
            x
        })
    }

    fn normalised_by_batch<'e>(&self, moments: Moments<'e>) -> Expression<'e> {
        self.scaled(moments.centred, moments.variance)
    }

    fn scaled<'e>(&self, centred: Expression<'e>, variance: Expression<'e>) -> Expression<'e> {
        let equations = centred.equations();
        let parameter = |name: &String| equations.parameter(name, [1, self.n_inputs()]);
        let names = self.norm_names();
        centred * (inverse_sd(variance) * parameter(&names[0])) + parameter(&names[1])
    }

    /// Names of scale and shift; none if inputs are not normalised.
    fn norm_names(&self) -> Vec<String> {
        let parts = ["weight", "bias"].into_iter().filter(|_| self.normalises);
        parts.map(|part| format!("{}.norm.{part}", self.name)).collect()
    }

    /// Scale and shift, then weight and bias of each layer.
    #[must_use]
    pub fn parameters<'e>(&self, equations: &'e Equations) -> Vec<Expression<'e>> {
        let names = self.norm_names();
        let norm = names
            .iter()
            .map(|name| equations.parameter(name, [1, self.n_inputs()]));
        norm.chain(self.network.parameters(equations)).collect()
    }

    /// Names of the parameters in the state, in their order.
    #[must_use]
    pub fn parameter_names(&self) -> Vec<String> {
        [self.norm_names(), self.network.parameter_names()].concat()
    }

    /// Name of the network, the beginning of the names of its parameters.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Layer sizes, input first.
    #[must_use]
    pub fn sizes(&self) -> &[usize] {
        self.network.sizes()
    }

    fn n_inputs(&self) -> usize {
        self.sizes()[0]
    }

    /// Stores the parameters in a policy file, under their names.
    ///
    /// # Panics
    /// If the state lacks a parameter.
    pub fn store(&self, state: &State<f32>, file: &mut TensorFile) {
        store_network(&self.network, self.network.name(), state, file);
        for name in self.norm_names() {
            store_vector(&name, state, file);
        }
    }

    /// Restores the parameters that [`NormalisedNetwork::store`] wrote; the optimiser is not changed.
    ///
    /// # Errors
    /// [`TensorFileError`] if a parameter is missing or has another shape.
    pub fn restore(&self, state: &mut State<f32>, file: &TensorFile) -> Result<(), TensorFileError> {
        let mut norm = self.norm_names().into_iter();
        norm.try_for_each(|name| restore_vector(&name, self.n_inputs(), state, file))?;
        restore_network(&self.network, self.network.name(), state, file)
    }
}

impl RunningMoments {
    /// Adds the moments of the inputs of a network, mean 0 and variance 1 before the first batch.
    pub fn new(network: &NormalisedNetwork, state: &mut State<f32>) -> Self {
        let moments = Self {
            name: network.name.clone(),
            n_inputs: network.n_inputs(),
        };
        for (name, entry) in moments.names().into_iter().zip([0.0, 1.0]) {
            state.insert(name, [1, moments.n_inputs], vec![entry; moments.n_inputs]);
        }
        moments
    }

    /// Names of mean and variance in the state.
    #[must_use]
    pub fn names(&self) -> [String; 2] {
        ["mean", "variance"].map(|part| format!("{}.running_{part}", self.name))
    }

    fn parameters<'e>(&self, equations: &'e Equations) -> [Expression<'e>; 2] {
        let parameter = |name: String| equations.parameter(&name, [1, self.n_inputs]);
        self.names().map(parameter)
    }

    /// Moves towards the moments of a batch, with its unbiased variance.
    #[allow(clippy::cast_precision_loss, reason = "a batch has far fewer than 2^52 rows")]
    fn absorb(&self, batch: Moments<'_>) {
        let n_rows = batch.centred.n_rows() as f64;
        let unbiased = batch.variance * (n_rows / (n_rows - 1.0).max(1.0));
        let equations = batch.mean.equations();
        equations.follow(&self.parameters(equations), &[batch.mean, unbiased], MOMENTUM);
    }

    /// Stores the moments in a policy file, under their names.
    ///
    /// # Panics
    /// If the state lacks them.
    pub fn store(&self, state: &State<f32>, file: &mut TensorFile) {
        self.names()
            .iter()
            .for_each(|name| store_vector(name, state, file));
    }

    /// Restores the moments that [`RunningMoments::store`] wrote.
    ///
    /// # Errors
    /// [`TensorFileError`] if they are missing or of another number of inputs.
    pub fn restore(&self, state: &mut State<f32>, file: &TensorFile) -> Result<(), TensorFileError> {
        let mut names = self.names().into_iter();
        names.try_for_each(|name| restore_vector(&name, self.n_inputs, state, file))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::{Processor, differences::largest_error};
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    const ROWS: [f32; 12] = [0.5, -1.0, 3.0, 1.5, 0.25, -2.0, 0.0, 0.75, 3.5, -0.5, 2.0, 1.0];

    /// A network of one layer that passes its three normalised inputs on, with scale and shift.
    fn passing(normalises: bool) -> (NormalisedNetwork, RunningMoments, State<f32>) {
        let network = NormalisedNetwork::new("net", &[3, 3], &[], normalises);
        let mut state = State::default();
        network.initialise(1.0, &mut state, &mut ChaCha8Rng::seed_from_u64(1));
        let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        state
            .entries_mut("net.mlp.layers.0.weight")
            .copy_from_slice(&identity);
        if normalises {
            state
                .entries_mut("net.norm.weight")
                .copy_from_slice(&[2.0, -1.0, 0.5]);
            state
                .entries_mut("net.norm.bias")
                .copy_from_slice(&[0.1, 0.0, -3.0]);
        }
        let running = RunningMoments::new(&network, &mut state);
        (network, running, state)
    }

    /// Outputs of a routine for [`ROWS`], run a number of times.
    fn run(
        state: &mut State<f32>,
        times: usize,
        write: impl Fn(Expression<'_>) -> Expression<'_>,
    ) -> Vec<f32> {
        let equations = Equations::new();
        let x = equations.input("x", [4, 3]);
        equations.routine("run");
        equations.output("y", write(x) * 1.0);
        let mut processor = Processor::<f32>::new(equations.into_graph());
        processor.write("x", &ROWS);
        (0..times).for_each(|_| processor.run("run", state));
        processor.entries("y").to_vec()
    }

    #[test]
    fn a_column_by_hand() {
        // The column (1, 3) has mean 2 and variance 1; the constant column is centred and divided by sqrt(epsilon).
        let equations = Equations::new();
        let network = NormalisedNetwork::new("net", &[2, 2], &[], true);
        let mut state = State::default();
        network.initialise(1.0, &mut state, &mut ChaCha8Rng::seed_from_u64(1));
        state
            .entries_mut("net.mlp.layers.0.weight")
            .copy_from_slice(&[1.0, 0.0, 0.0, 1.0]);
        let x = equations.constant([2, 2], &[1.0, 4.0, 3.0, 4.0]);
        equations.routine("run");
        equations.output("y", network.by_batch(x));
        let mut processor = Processor::<f32>::new(equations.into_graph());
        processor.run("run", &mut state);
        let y = processor.entries("y");
        assert!(
            (y[0] + 1.0).abs() < 1e-4 && (y[2] - 1.0).abs() < 1e-4 && y[1] == 0.0 && y[3] == 0.0,
            "{y:?}"
        );
    }

    /// Gradients with respect to scale, shift and the inputs, which are a parameter here.
    #[test]
    fn gradients_agree_with_finite_differences() {
        let (network, running, mut state) = passing(true);
        state.insert("x", [4, 3], ROWS.to_vec());
        let weights: Vec<f64> = (0..12u8).map(|i| f64::from(i * 5 % 7) - 2.0).collect();
        let error = |write: &dyn Fn(Expression<'_>)| {
            let equations = Equations::new();
            let x = equations.parameter("x", [4, 3]);
            equations.routine("loss");
            write(x);
            let names = ["net.norm.weight", "net.norm.bias", "x"];
            let graph = equations.into_graph();
            largest_error(graph, ["loss", "loss"], &names, &state.widened(), &[], 1)
        };
        // Weighted, so that no gradient is zero by the symmetry of the normalisation.
        let loss = |y: Expression<'_>| {
            let equations = y.equations();
            equations.output("loss", (y.square() * equations.constant([4, 3], &weights)).sum());
        };
        assert!(error(&|x| loss(network.by_batch(x))) < 1e-6);
        assert!(error(&|x| loss(network.by_batch_absorbed(x, &running))) < 1e-6);
        assert!(error(&|x| loss(network.by_moments(x, &running))) < 1e-6);
    }

    #[test]
    fn running_moments_reach_those_of_the_batches() {
        let (network, running, mut state) = passing(true);
        let absorbed =
            |state: &mut State<f32>, times| run(state, times, |x| network.by_batch_absorbed(x, &running));
        absorbed(&mut state, 1);
        // The first column (0.5, 1.5, 0, -0.5) has mean 0.375 and unbiased variance 2.1875 / 3.
        let [mean, variance] = running.names().map(|name| state.entries(&name)[0]);
        assert!((mean - 0.0375).abs() < 1e-6);
        assert!((variance - (0.9 + 0.1 * 2.1875 / 3.0)).abs() < 1e-6, "{variance}");
        let of_batch = absorbed(&mut state, 200);
        assert_eq!(of_batch, run(&mut state, 1, |x| network.by_batch(x)));
        let of_moments = run(&mut state, 1, |x| network.by_moments(x, &running));
        let shrink = (3.0f32 / 4.0).sqrt();
        for (at, (a, b)) in of_batch.iter().zip(&of_moments).enumerate() {
            let shift = [0.1, 0.0, -3.0][at % 3];
            assert!(((a - shift) * shrink - (b - shift)).abs() < 1e-4, "{a} {b}");
        }
    }

    #[test]
    fn inputs_may_pass_as_they_are() {
        let (network, running, mut state) = passing(false);
        let before = state.clone();
        for y in [
            run(&mut state, 1, |x| network.by_batch(x)),
            run(&mut state, 1, |x| network.by_batch_absorbed(x, &running)),
            run(&mut state, 1, |x| network.by_moments(x, &running)),
        ] {
            assert_eq!(y, ROWS);
        }
        assert!(state.tensors().eq(before.tensors()) && network.parameter_names().len() == 2);
    }

    #[test]
    fn parameters_and_moments_are_stored_with_their_length() {
        let (network, running, mut one) = passing(true);
        run(&mut one, 1, |x| network.by_batch_absorbed(x, &running));
        let mut file = TensorFile::default();
        network.store(&one, &mut file);
        running.store(&one, &mut file);
        assert_eq!(file.get("net.norm.weight").unwrap().shape, [3]);
        let mut two = State::default();
        network.initialise(1.0, &mut two, &mut ChaCha8Rng::seed_from_u64(2));
        RunningMoments::new(&network, &mut two);
        network.restore(&mut two, &file).unwrap();
        running.restore(&mut two, &file).unwrap();
        assert!(
            one.tensors()
                .all(|(name, shape, entries)| two.tensor(name) == Some((shape, entries)))
        );
        let other = NormalisedNetwork::new("net", &[2, 3], &[], true);
        let mut three = State::default();
        other.initialise(1.0, &mut three, &mut ChaCha8Rng::seed_from_u64(2));
        let moments = RunningMoments::new(&other, &mut three);
        assert!(other.restore(&mut three, &file).is_err() && moments.restore(&mut three, &file).is_err());
    }
}
