//! Adam for the parameters of any `burn` module, and for a single number.
//!
//! Kingma and Ba 2015, "Adam: a method for stochastic optimization", arXiv:1412.6980, algorithm 1:
//!
//! `m <- b1 m + (1 - b1) g`, `v <- b2 v + (1 - b2) g^2`,
//! `x <- x - rate (m / (1 - b1^t)) / (sqrt(v / (1 - b2^t)) + epsilon)`.
//!
//! `b1 = 0.9`, `b2 = 0.999` by default, `epsilon = 1e-8`, as in the paper. `burn`'s own optimiser clips the
//! gradient of each parameter separately; the algorithms here clip by the Euclidean norm over all parameters
//! of a network. Moments below the smallest normal number are set to zero here. One pass over each parameter
//! on the host does the whole step. A restored state continues to the same bits.

use crate::parameters::map_values;
use crate::tensor_file::{TensorFile, TensorFileError};
use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor};
use serde::{Deserialize, Serialize};

const BETA_1: f64 = 0.9;
const BETA_2: f64 = 0.999;
const EPSILON: f64 = 1e-8;

/// Adam over all parameters of one module.
#[derive(Debug, Clone, PartialEq)]
pub struct Adam {
    learning_rate: f64,
    largest_norm: Option<f64>,
    betas: [f64; 2],
    n_steps: u64,
    first: Vec<Vec<f32>>,
    second: Vec<Vec<f32>>,
}

impl Adam {
    /// Creates Adam with a learning rate. Where `largest_norm` is given, gradients are scaled down to that
    /// Euclidean norm over all parameters.
    #[must_use]
    pub fn new(learning_rate: f64, largest_norm: Option<f64>) -> Self {
        Self {
            learning_rate,
            largest_norm,
            betas: [BETA_1, BETA_2],
            n_steps: 0,
            first: Vec::new(),
            second: Vec::new(),
        }
    }

    /// Creates Adam with a learning rate and other decay rates `[b1, b2]` of the two moments.
    #[must_use]
    pub fn with_betas(learning_rate: f64, betas: [f64; 2]) -> Self {
        Self {
            betas,
            ..Self::new(learning_rate, None)
        }
    }

    /// Changes the learning rate from the next step on; the moments stay.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.learning_rate = learning_rate;
    }

    /// Module after one step against the gradients of a loss; parameters that the loss does not reach stay.
    pub fn step<M: Module>(&mut self, module: M, loss_gradients: Gradients) -> M {
        let gradients = self.clipped(&module, loss_gradients);
        self.step_against(module, &gradients)
    }

    /// Gradients of a module's parameters, scaled down to the largest norm.
    fn clipped<M: Module>(&self, module: &M, mut loss_gradients: Gradients) -> Vec<Vec<f32>> {
        let mut gradients = gradients(module, &mut loss_gradients);
        if let Some(largest) = self.largest_norm {
            clip(&mut gradients, largest);
        }
        gradients
    }

    /// Module after one step against `gradients`, one vector per parameter in the order of its fields; a
    /// parameter with an empty vector stays.
    pub fn step_against<M: Module>(&mut self, module: M, gradients: &[Vec<f32>]) -> M {
        self.n_steps += 1;
        self.first.resize_with(gradients.len(), Vec::new);
        self.second.resize_with(gradients.len(), Vec::new);
        let rates = Rates::at(self.n_steps, self.learning_rate, self.betas);
        let mut at = 0;
        map_values(module, &mut |values| {
            if !gradients[at].is_empty() {
                descend(
                    &rates,
                    values,
                    &gradients[at],
                    &mut self.first[at],
                    &mut self.second[at],
                );
            }
            at += 1;
        })
    }

    /// Stores the state under `prefix` in a file and its header.
    pub fn store(&self, prefix: &str, file: &mut TensorFile) {
        for (at, (first, second)) in self.first.iter().zip(&self.second).enumerate() {
            file.insert_vector(format!("{prefix}.first.{at}"), first.clone());
            file.insert_vector(format!("{prefix}.second.{at}"), second.clone());
        }
        file.header[prefix] = serde_json::json!({ "n_steps": self.n_steps, "n_tensors": self.first.len() });
    }

    /// Restores the state that [`Adam::store`] wrote under `prefix`.
    ///
    /// # Errors
    /// [`TensorFileError::Missing`] where the file holds no such state.
    pub fn restore(&mut self, prefix: &str, file: &TensorFile) -> Result<(), TensorFileError> {
        let count = |key: &str| file.header[prefix][key].as_u64();
        let (Some(n_steps), Some(n_tensors)) = (count("n_steps"), count("n_tensors")) else {
            return Err(TensorFileError::Missing { name: prefix.into() });
        };
        let read = |moment: &str| {
            let vector = |at| Ok(file.get(&format!("{prefix}.{moment}.{at}"))?.values.clone());
            (0..n_tensors)
                .map(vector)
                .collect::<Result<Vec<_>, TensorFileError>>()
        };
        (self.first, self.second, self.n_steps) = (read("first")?, read("second")?, n_steps);
        Ok(())
    }
}

/// A network with its optimiser.
#[derive(Debug, Clone)]
pub struct TrainedNetwork<M> {
    network: M,
    adam: Adam,
}

impl<M: Module + Default> TrainedNetwork<M> {
    /// Combines a network (on a device with autodiff) with the optimiser `adam`.
    #[must_use]
    pub fn new(network: M, adam: Adam) -> Self {
        Self { network, adam }
    }

    /// Network with tracked parameters, whose losses can be descended.
    #[must_use]
    pub fn network(&self) -> &M {
        &self.network
    }

    /// Replaces the network by another one of the same shape; the optimiser stays as it is.
    pub fn set_network(&mut self, network: M) {
        self.network = network;
    }

    /// Changes the learning rate from the next step on.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.adam.set_learning_rate(learning_rate);
    }

    /// Takes one step against the gradient of a loss of shape `[1]`.
    pub fn descend(&mut self, loss: &Tensor<1>) {
        self.descend_along(loss);
    }

    /// Steps as [`TrainedNetwork::descend`] does; returns the gradient of the step, scaled down to the largest norm.
    pub fn descend_along(&mut self, loss: &Tensor<1>) -> Vec<Vec<f32>> {
        let gradients = self.adam.clipped(&self.network, loss.backward());
        self.step_against(&gradients);
        gradients
    }

    /// Takes one step against given gradients, one vector per parameter in the order of the module's fields.
    pub fn step_against(&mut self, gradients: &[Vec<f32>]) {
        // The network owns its numbers alone once it is taken out of its field, so they are changed without a
        // copy.
        let network = std::mem::take(&mut self.network);
        self.network = self.adam.step_against(network, gradients);
    }

    /// Stores network and optimiser under `prefix` in a file.
    pub fn store(&self, prefix: &str, file: &mut TensorFile) {
        crate::parameters::store(&self.network, prefix, file);
        self.adam.store(&format!("{prefix}.adam"), file);
    }

    /// Restores the network alone from the tensors under `prefix`; the optimiser stays as it is.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file does not fit.
    pub fn restore_network(&mut self, prefix: &str, file: &TensorFile) -> Result<(), TensorFileError> {
        self.network = crate::parameters::restore(self.network.clone(), prefix, file)?;
        Ok(())
    }

    /// Restores the state that [`TrainedNetwork::store`] wrote under `prefix`.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file does not fit.
    pub fn restore(&mut self, prefix: &str, file: &TensorFile) -> Result<(), TensorFileError> {
        self.restore_network(prefix, file)?;
        self.adam.restore(&format!("{prefix}.adam"), file)
    }
}

/// Gradient of each parameter on the host, in the order of the module's fields; empty for a parameter without
/// one.
pub fn gradients<M: Module>(module: &M, loss_gradients: &mut Gradients) -> Vec<Vec<f32>> {
    let mut collector = GradientCollector {
        gradients: loss_gradients,
        found: Vec::new(),
    };
    module.visit(&mut collector);
    collector.found
}

/// Scales gradients down to a Euclidean norm of at most `largest` over all parameters; returns their norm.
#[allow(clippy::cast_possible_truncation, reason = "gradients are f32")]
pub fn clip(gradients: &mut [Vec<f32>], largest: f64) -> f64 {
    let norm = gradients
        .iter()
        .flatten()
        .map(|g| f64::from(*g) * f64::from(*g))
        .sum::<f64>()
        .sqrt();
    if norm > largest {
        let scale = (largest / norm) as f32;
        // One loop per vector is vectorised; a flattened one is not.
        gradients
            .iter_mut()
            .for_each(|vector| vector.iter_mut().for_each(|g| *g *= scale));
    }
    norm
}

/// Step size, and the correction of the second moment after `t` steps.
struct Rates {
    step: f32,
    root_correction: f32,
    betas: [f32; 2],
}

impl Rates {
    #[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
    fn at(t: u64, learning_rate: f64, betas: [f64; 2]) -> Self {
        let (bias_1, bias_2) = bias_corrections(t, betas);
        Self {
            step: (learning_rate / bias_1) as f32,
            root_correction: (1.0 / bias_2.sqrt()) as f32,
            betas: betas.map(|beta| beta as f32),
        }
    }
}

/// Corrections `1 - b1^t` and `1 - b2^t`.
#[allow(clippy::cast_precision_loss, reason = "a number of steps is far below 2^52")]
fn bias_corrections(t: u64, [b1, b2]: [f64; 2]) -> (f64, f64) {
    (1.0 - b1.powf(t as f64), 1.0 - b2.powf(t as f64))
}

#[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
fn descend(rates: &Rates, x: &mut [f32], gradient: &[f32], first: &mut Vec<f32>, second: &mut Vec<f32>) {
    let ([b1, b2], epsilon) = (rates.betas, EPSILON as f32);
    first.resize(x.len(), 0.0);
    second.resize(x.len(), 0.0);
    for (((x, g), m), v) in x.iter_mut().zip(gradient).zip(first).zip(second) {
        *m = normal_or_zero(b1 * *m + (1.0 - b1) * g);
        *v = normal_or_zero(b2 * *v + (1.0 - b2) * g * g);
        *x -= rates.step * *m / (v.sqrt() * rates.root_correction + epsilon);
    }
}

/// Zero for a number below the smallest normal one. The moments of a unit that becomes inactive fade to
/// denormals and stay there: 0.9 times a few of the smallest numbers is rounded to the same number. A
/// processor takes some thirty times as long for each of them (23 against 0.7 ns). With the epsilon in the
/// denominator none of them moves a parameter that is larger than 1e-22.
fn normal_or_zero(moment: f32) -> f32 {
    if moment.abs() < f32::MIN_POSITIVE {
        0.0
    } else {
        moment
    }
}

struct GradientCollector<'a> {
    gradients: &'a mut Gradients,
    found: Vec<Vec<f32>>,
}

impl ModuleVisitor for GradientCollector<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let gradient = param.val().grad_remove(self.gradients);
        self.found
            .push(gradient.map(crate::network::values).unwrap_or_default());
    }
}

/// Adam for one number, such as the logarithm of a temperature.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScalarAdam {
    learning_rate: f64,
    n_steps: u64,
    first: f64,
    second: f64,
}

impl ScalarAdam {
    /// Creates Adam with a learning rate.
    #[must_use]
    pub fn new(learning_rate: f64) -> Self {
        Self {
            learning_rate,
            n_steps: 0,
            first: 0.0,
            second: 0.0,
        }
    }

    /// Changes the learning rate from the next step on; the moments stay.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.learning_rate = learning_rate;
    }

    /// Number after one step against a gradient.
    #[must_use]
    pub fn step(&mut self, x: f64, gradient: f64) -> f64 {
        self.n_steps += 1;
        self.first = BETA_1 * self.first + (1.0 - BETA_1) * gradient;
        self.second = BETA_2 * self.second + (1.0 - BETA_2) * gradient * gradient;
        let (bias_1, bias_2) = bias_corrections(self.n_steps, [BETA_1, BETA_2]);
        x - self.learning_rate * (self.first / bias_1) / ((self.second / bias_2).sqrt() + EPSILON)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{Activation, Mlp, device, matrix};
    use crate::parameters::parameters;
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    /// Gradients end after 50 steps, as those of a unit that becomes inactive; every third one goes on.
    #[test]
    fn moments_that_fade_are_zero_and_move_no_parameter() {
        let gradient = |step: usize, at: usize| {
            let ends = step >= 50 && !at.is_multiple_of(3);
            if ends {
                0.0
            } else {
                1e-3 * ((at + step) % 7) as f32 - 2e-3
            }
        };
        let [mut x, mut by_hand] = [(); 2].map(|()| (0..9).map(|at| 0.01 * at as f32).collect::<Vec<f32>>());
        let (mut first, mut second) = (Vec::new(), Vec::new());
        let (mut m, mut v) = ([0.0f32; 9], [0.0f32; 9]);
        for step in 0..2000 {
            let rates = Rates::at(step as u64 + 1, 1e-2, [BETA_1, BETA_2]);
            let gradients: Vec<f32> = (0..9).map(|at| gradient(step, at)).collect();
            descend(&rates, &mut x, &gradients, &mut first, &mut second);
            let [b1, b2] = rates.betas;
            for (at, g) in gradients.into_iter().enumerate() {
                m[at] = b1 * m[at] + (1.0 - b1) * g;
                v[at] = b2 * v[at] + (1.0 - b2) * g * g;
                by_hand[at] -= rates.step * m[at] / (v[at].sqrt() * rates.root_correction + 1e-8);
            }
        }
        assert_eq!(x, by_hand);
        assert!(
            m.iter().any(|it| it.is_subnormal()),
            "they stay without it: {m:?}"
        );
        assert!(first.iter().chain(&second).all(|it| !it.is_subnormal()));
        assert_eq!(first[1], 0.0);
    }

    fn network() -> Mlp {
        Mlp::new(
            &[2, 4, 1],
            &[Activation::LeakyRelu],
            1.0,
            &mut ChaCha8Rng::seed_from_u64(3),
            &device().autodiff(),
        )
    }

    fn step(network: Mlp, adam: &mut Adam) -> Mlp {
        let loss = network
            .forward(matrix(vec![0.5, -1.0, 2.0, 0.1], 2))
            .powf_scalar(2.0)
            .mean();
        adam.step(network, loss.backward())
    }

    #[test]
    fn two_steps_by_hand() {
        // g = 1, then g = -2 at rate 0.1: m = 0.1, v = 0.001 -> step 0.1 (1 / (1 + 1e-8)).
        // Then m = -0.11, v = 0.004999; corrected -0.11 / 0.19 and 0.004999 / 0.001999.
        let mut adam = ScalarAdam::new(0.1);
        let x1 = adam.step(1.0, 1.0);
        assert!((x1 - 0.9).abs() < 1e-8);
        let x2 = adam.step(x1, -2.0);
        let expected = x1 + 0.1 * (0.11 / 0.19) / ((0.004_999f64 / 0.001_999).sqrt() + 1e-8);
        assert!((x2 - expected).abs() < 1e-12);
    }

    #[test]
    fn a_new_learning_rate_scales_the_next_step() {
        let moved = |rate: f64| {
            let mut adam = Adam::new(0.01, None);
            adam.set_learning_rate(rate);
            let before = parameters(&network())[0].values.clone();
            let after = parameters(&step(network(), &mut adam))[0].values.clone();
            before.iter().zip(after).map(|(b, a)| a - b).collect::<Vec<f32>>()
        };
        assert!(moved(0.0).iter().all(|change| *change == 0.0));
        let (one, two) = (moved(0.01), moved(0.02));
        assert!(
            one.iter()
                .zip(&two)
                .all(|(one, two)| (2.0 * one - two).abs() < 1e-6)
        );
        assert!(one.iter().any(|change| change.abs() > 1e-3));
        let mut scalar = ScalarAdam::new(0.1);
        scalar.set_learning_rate(0.05);
        assert!((scalar.step(1.0, 3.0) - 0.95).abs() < 1e-8);
    }

    #[test]
    fn without_a_first_moment_a_step_follows_the_last_gradient() {
        // b1 = 0, b2 = 0.9: the first step is the rate against the sign of each gradient; in the second v is
        // 0.09 g1^2 + 0.1 g2^2, divided by 0.19.
        let (rate, before) = (0.01, network());
        let mut adam = Adam::with_betas(rate, [0.0, 0.9]);
        let against = |g: f32| {
            parameters(&before)
                .iter()
                .map(|p| vec![g; p.values.len()])
                .collect::<Vec<_>>()
        };
        let first = adam.step_against(before.clone(), &against(2.0));
        let second = adam.step_against(first.clone(), &against(-1.0));
        let entry = |network: &Mlp| f64::from(parameters(network)[0].values[3]);
        assert!((entry(&first) - entry(&before) + rate).abs() < 1e-7);
        let expected = rate / ((0.09 * 4.0 + 0.1) / 0.19f64).sqrt();
        assert!((entry(&second) - entry(&first) - expected).abs() < 1e-7);
    }

    #[test]
    fn the_module_and_the_scalar_form_agree() {
        let network = network();
        let mut scalar = ScalarAdam::new(0.01);
        let mut adam = Adam::new(0.01, None);
        let loss = network
            .forward(matrix(vec![0.5, -1.0, 2.0, 0.1], 2))
            .powf_scalar(2.0)
            .mean();
        let gradient = f64::from(gradients(&network, &mut loss.backward())[3][0]);
        let before = f64::from(parameters(&network)[3].values[0]);
        let after = f64::from(parameters(&step(network, &mut adam))[3].values[0]);
        assert!((after - scalar.step(before, gradient)).abs() < 1e-6);
    }

    #[test]
    fn a_loss_falls() {
        let (mut network, mut adam) = (network(), Adam::new(0.01, Some(1.0)));
        let loss = |network: &Mlp| {
            crate::network::values(
                network
                    .forward(matrix(vec![0.5, -1.0, 2.0, 0.1], 2))
                    .powf_scalar(2.0)
                    .mean(),
            )[0]
        };
        let before = loss(&network);
        for _ in 0..200 {
            network = step(network, &mut adam);
        }
        assert!(loss(&network) < 1e-3 * before, "{} {before}", loss(&network));
    }

    #[test]
    fn clipping_keeps_the_direction() {
        let mut gradients = vec![vec![3.0], vec![0.0, 4.0]];
        assert!((clip(&mut gradients, 1.0) - 5.0).abs() < 1e-12);
        assert!((gradients[0][0] - 0.6).abs() < 1e-6 && (gradients[1][1] - 0.8).abs() < 1e-6);
        assert!((clip(&mut gradients, 2.0) - 1.0).abs() < 1e-6);
        assert!((gradients[0][0] - 0.6).abs() < 1e-6);
    }

    #[test]
    fn a_stored_network_and_optimiser_take_the_same_next_step() {
        let mut one = TrainedNetwork::new(network(), Adam::new(0.01, None));
        let improve = |trained: &mut TrainedNetwork<Mlp>| {
            let loss = trained
                .network()
                .forward(matrix(vec![0.5, -1.0, 2.0, 0.1], 2))
                .powf_scalar(2.0)
                .mean();
            trained.descend(&loss);
        };
        (0..5).for_each(|_| improve(&mut one));
        let mut file = TensorFile::default();
        one.store("policy", &mut file);
        let dir = tempfile::tempdir().unwrap();
        file.write(&dir.path().join("state.safetensors")).unwrap();
        let file = TensorFile::read(&dir.path().join("state.safetensors")).unwrap();
        let mut two = TrainedNetwork::new(network(), Adam::new(0.01, None));
        two.restore("policy", &file).unwrap();
        improve(&mut one);
        improve(&mut two);
        assert_eq!(parameters(one.network()), parameters(two.network()));
        assert_eq!(one.adam, two.adam);
        assert!(two.restore("critic", &file).is_err());
    }
}
