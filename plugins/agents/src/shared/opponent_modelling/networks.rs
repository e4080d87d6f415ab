//! The two kinds of network: Gaussians squashed by tanh (policies, opponent models, priors) and critics of
//! joint actions.
//!
//! Both have two hidden layers. Gaussians start with Kaiming-uniform weights of gain sqrt 2 in every layer
//! and biases of 0, critics as PyTorch's linear layers start. Where inputs are normalised, networks that are
//! trained or differentiated use the moments of the batch; a Gaussian that acts uses running ones, into which
//! every batch it sees in an update enters.

use super::Settings;
use burn::module::Module;
use burn::tensor::Tensor;
use numerics::input_norm::{InputNorm, NormalisedMlp, RunningMoments};
use numerics::network::{Mlp, device};
use numerics::optimizer::{Adam, TrainedNetwork};
use numerics::parameters::{restore, soft_update, store};
use numerics::tensor_file::{TensorFile, TensorFileError};
use rand::RngCore;

/// A network whose output is the head of a squashed Gaussian ([`numerics::squashed`]).
#[derive(Debug, Clone)]
pub struct GaussianNetwork {
    trained: TrainedNetwork<NormalisedMlp>,
    moments: RunningMoments,
    /// Gradient of the latest step; empty before the first step and where it is not kept.
    latest: Vec<Vec<f32>>,
    keeps_latest: bool,
}

/// Value of joint observations and joint actions for one seat, with its target network.
#[derive(Debug, Clone)]
pub struct Critic {
    trained: TrainedNetwork<NormalisedMlp>,
    target: NormalisedMlp,
}

fn norm(n_inputs: usize, settings: &Settings) -> Option<InputNorm> {
    settings
        .input_normalisation
        .then(|| InputNorm::new(n_inputs, &device().autodiff()))
}

fn adam(settings: &Settings) -> Adam {
    Adam::new(settings.learning_rate, settings.gradient_clip)
}

impl GaussianNetwork {
    /// Builds a network from `n_inputs` to the head of an action with `n_actions` entries.
    pub fn new(n_inputs: usize, n_actions: usize, settings: &Settings, rng: &mut impl RngCore) -> Self {
        let (width, activation) = (settings.width, settings.activation);
        let sizes = [n_inputs, width, width, 2 * n_actions];
        let mlp = Mlp::new(
            &sizes,
            &[activation; 2],
            std::f64::consts::SQRT_2,
            rng,
            &device().autodiff(),
        );
        Self {
            trained: TrainedNetwork::new(NormalisedMlp::new(norm(n_inputs, settings), mlp), adam(settings)),
            moments: RunningMoments::new(n_inputs),
            latest: Vec::new(),
            keeps_latest: false,
        }
    }

    /// Makes the network keep the gradient of its latest step for [`GaussianNetwork::step_again`], or not.
    #[must_use]
    pub fn keeping_latest(self, keeps_latest: bool) -> Self {
        Self { keeps_latest, ..self }
    }

    /// Heads of a batch `[batch, inputs]`; a loss has gradients in this network's parameters.
    pub fn tracked_head(&mut self, input: Tensor<2>) -> Tensor<2> {
        self.absorb(&input);
        self.trained.network().by_batch(input)
    }

    /// Heads of a batch `[batch, inputs]`; a loss has gradients in the input alone.
    pub fn plain_head(&mut self, input: Tensor<2>) -> Tensor<2> {
        self.absorb(&input);
        self.trained.network().valid().by_batch(input)
    }

    /// Heads of single rows `[rows, inputs]` where the network acts; a row does not depend on the other rows.
    #[must_use]
    pub fn acting_head(&self, input: Tensor<2>) -> Tensor<2> {
        self.trained.network().valid().by_moments(input, &self.moments)
    }

    /// Takes one step against the gradient of a loss of shape `[1]`.
    pub fn descend(&mut self, loss: &Tensor<1>) {
        let gradient = self.trained.descend_along(loss);
        if self.keeps_latest {
            self.latest = gradient;
        }
    }

    /// Takes one more step along the gradient of the latest one; does nothing before the first.
    pub fn step_again(&mut self) {
        if !self.latest.is_empty() {
            self.trained.step_against(&self.latest);
        }
    }

    /// Network without its optimiser.
    #[must_use]
    pub fn network(&self) -> &NormalisedMlp {
        self.trained.network()
    }

    /// Stores network, optimiser, moments and the latest gradient under `prefix` in a file.
    pub fn store(&self, prefix: &str, file: &mut TensorFile) {
        self.trained.store(prefix, file);
        self.moments.store(prefix, file);
        file.header[format!("{prefix}.latest")] = self.latest.len().into();
        for (at, gradient) in self.latest.iter().enumerate() {
            file.insert_vector(format!("{prefix}.latest.{at}"), gradient.clone());
        }
    }

    /// Restores the state that [`GaussianNetwork::store`] wrote under `prefix`.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file does not fit.
    pub fn restore(&mut self, prefix: &str, file: &TensorFile) -> Result<(), TensorFileError> {
        self.trained.restore(prefix, file)?;
        self.moments.restore(prefix, file)?;
        let count = file.header[format!("{prefix}.latest")].as_u64();
        let count = count.ok_or_else(|| TensorFileError::Missing {
            name: format!("{prefix}.latest"),
        })?;
        let gradient = |at| Ok(file.get(&format!("{prefix}.latest.{at}"))?.values.clone());
        self.latest = (0..count).map(gradient).collect::<Result<_, TensorFileError>>()?;
        Ok(())
    }

    /// Stores the parts needed to act under `prefix` in a file: the network and its moments.
    pub fn store_acting(&self, prefix: &str, file: &mut TensorFile) {
        store(&self.trained.network().valid(), prefix, file);
        self.moments.store(prefix, file);
    }

    /// Restores the parts needed to act that [`GaussianNetwork::store_acting`] wrote under `prefix`.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file does not fit.
    pub fn restore_acting(&mut self, prefix: &str, file: &TensorFile) -> Result<(), TensorFileError> {
        self.trained.restore_network(prefix, file)?;
        self.moments.restore(prefix, file)
    }

    /// Replaces the parameters, for tests.
    #[cfg(test)]
    pub(crate) fn set_network(&mut self, network: NormalisedMlp) {
        self.trained = TrainedNetwork::new(network, Adam::new(0.0, None));
    }

    fn absorb(&mut self, input: &Tensor<2>) {
        if self.trained.network().normalises() {
            self.moments.absorb(input);
        }
    }
}

impl Critic {
    /// Builds a critic of `n_observed` joint observations and `n_acted` entries of joint actions.
    pub fn new(n_observed: usize, n_acted: usize, settings: &Settings, rng: &mut impl RngCore) -> Self {
        let (inputs, width) = (n_observed + n_acted, settings.width);
        let mlp = Mlp::uniform(
            &[inputs, width, width, 1],
            &[settings.activation; 2],
            rng,
            &device().autodiff(),
        );
        let network = NormalisedMlp::new(norm(inputs, settings), mlp);
        Self {
            target: network.valid(),
            trained: TrainedNetwork::new(network, adam(settings)),
        }
    }

    /// Values `[batch, 1]`; a loss has gradients in the critic's parameters.
    #[must_use]
    pub fn tracked_value(&self, observations: &Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        self.trained.network().by_batch(input(observations, actions))
    }

    /// Values `[batch, 1]`; a loss has gradients in the actions alone.
    #[must_use]
    pub fn value(&self, observations: &Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        self.trained
            .network()
            .valid()
            .by_batch(input(observations, actions))
    }

    /// Values `[batch, 1]` of the target network.
    #[must_use]
    pub fn target_value(&self, observations: &Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
        self.target.by_batch(input(observations, actions))
    }

    /// Takes one step against the gradient of a loss of shape `[1]`.
    pub fn descend(&mut self, loss: &Tensor<1>) {
        self.trained.descend(loss);
    }

    /// Moves the target network towards the critic.
    pub fn follow(&mut self, target_smoothing: f64) {
        self.target = soft_update(
            std::mem::take(&mut self.target),
            self.trained.network(),
            target_smoothing,
        );
    }

    /// Network without its optimiser and target.
    #[must_use]
    pub fn network(&self) -> &NormalisedMlp {
        self.trained.network()
    }

    /// Stores critic, optimiser and target network under `prefix` in a file.
    pub fn store(&self, prefix: &str, file: &mut TensorFile) {
        self.trained.store(prefix, file);
        store(&self.target, &format!("{prefix}.target"), file);
    }

    /// Restores the state that [`Critic::store`] wrote under `prefix`.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file does not fit.
    pub fn restore(&mut self, prefix: &str, file: &TensorFile) -> Result<(), TensorFileError> {
        self.trained.restore(prefix, file)?;
        self.target = restore(self.target.clone(), &format!("{prefix}.target"), file)?;
        Ok(())
    }

    /// Replaces the parameters, for tests.
    #[cfg(test)]
    pub(crate) fn set_network(&mut self, network: NormalisedMlp, settings: &Settings) {
        self.target = network.valid();
        self.trained = TrainedNetwork::new(network, adam(settings));
    }
}

fn input(observations: &Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
    Tensor::cat(vec![actions, observations.clone()], 1)
}
