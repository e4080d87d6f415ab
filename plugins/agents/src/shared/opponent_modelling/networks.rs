//! The two kinds of network: Gaussians squashed by tanh (policies, opponent models, priors) and critics of
//! joint actions.
//!
//! Both have two hidden layers. Gaussians start with Kaiming-uniform weights of gain sqrt 2 in every layer
//! and biases of 0, critics as PyTorch's linear layers start. Where inputs are normalised, networks that are
//! trained or differentiated use the moments of the batch; a Gaussian that acts uses running ones, into which
//! every batch it sees in an update enters.

use super::Settings;
use numerics::equations::input_norm::{NormalisedNetwork, RunningMoments};
use numerics::tensor_file::{TensorFile, TensorFileError};
use plan::{Descent, Equations, Expression, State};
use rand::RngCore;

/// A network whose output is the head of a squashed Gaussian ([`numerics::equations::squashed`]).
#[derive(Debug, Clone)]
pub struct GaussianNetwork {
    network: NormalisedNetwork,
    moments: RunningMoments,
    /// Whether the gradient of the latest step is kept, as `latest.NAME` for each parameter.
    keeps_latest: bool,
}

/// Value of joint observations and joint actions for one seat, with its target network.
#[derive(Debug, Clone)]
pub struct Critic {
    network: NormalisedNetwork,
    target: NormalisedNetwork,
}

impl Settings {
    fn network(&self, name: &str, n_inputs: usize, n_outputs: usize) -> NormalisedNetwork {
        let sizes = [n_inputs, self.width, self.width, n_outputs];
        NormalisedNetwork::new(name, &sizes, &[self.activation; 2], self.input_normalisation)
    }

    fn descend(&self, loss: Expression<'_>, parameters: &[Expression<'_>]) {
        loss.equations().descend(loss, parameters, &self.adam());
    }

    fn adam(&self) -> Descent<'_> {
        Descent::adam("learning_rate", self.learning_rate, self.gradient_clip)
    }
}

impl GaussianNetwork {
    /// Adds a network from `n_inputs` to the head of an action with `n_actions` entries to a state.
    pub fn new(
        name: &str,
        n_inputs: usize,
        n_actions: usize,
        settings: &Settings,
        state: &mut State<f32>,
        rng: &mut impl RngCore,
    ) -> Self {
        let network = settings.network(name, n_inputs, 2 * n_actions);
        network.initialise(std::f64::consts::SQRT_2, state, rng);
        Self {
            moments: RunningMoments::new(&network, state),
            network,
            keeps_latest: false,
        }
    }

    /// Makes the network keep the gradient of its latest step for [`GaussianNetwork::step_again`].
    #[must_use]
    pub fn keeping_latest(self, state: &mut State<f32>) -> Self {
        for name in self.network.parameter_names() {
            let entries = state.entries(&name).len();
            // The network has just added its parameters.
            let shape = state.tensor(&name).map_or([1, entries], |(shape, _)| shape);
            state.insert(latest(&name), shape, vec![0.0; entries]);
        }
        Self {
            keeps_latest: true,
            ..self
        }
    }

    /// Heads of a batch `[batch, inputs]` in an update.
    #[must_use]
    pub fn head<'e>(&self, input: Expression<'e>) -> Expression<'e> {
        self.network.by_batch_absorbed(input, &self.moments)
    }

    /// Heads of single rows `[rows, inputs]` where the network acts; a row does not depend on the other rows.
    #[must_use]
    pub fn acting_head<'e>(&self, input: Expression<'e>) -> Expression<'e> {
        self.network.by_moments(input, &self.moments)
    }

    /// Takes one step against the gradient of a loss `[1, 1]`.
    pub fn descend(&self, loss: Expression<'_>, settings: &Settings) {
        let equations = loss.equations();
        let parameters = self.network.parameters(equations);
        if !self.keeps_latest {
            return settings.descend(loss, &parameters);
        }
        let gradients = equations.gradients(loss, &parameters);
        for (kept, gradient) in self.latest(equations).into_iter().zip(&gradients) {
            equations.assign(kept, *gradient);
        }
        equations.step_against(&gradients, &parameters, &settings.adam());
    }

    /// Takes one more step along the gradient of the latest one, where it is kept.
    pub fn step_again(&self, equations: &Equations, settings: &Settings) {
        if self.keeps_latest {
            let parameters = self.network.parameters(equations);
            equations.step_against(&self.latest(equations), &parameters, &settings.adam());
        }
    }

    fn latest<'e>(&self, equations: &'e Equations) -> Vec<Expression<'e>> {
        let of = |(name, parameter): (String, Expression<'e>)| {
            equations.parameter(&latest(&name), parameter.shape())
        };
        let names = self.network.parameter_names().into_iter();
        names.zip(self.network.parameters(equations)).map(of).collect()
    }

    /// Whether the network has made a step.
    #[must_use]
    pub fn has_stepped(&self, state: &State<f32>) -> bool {
        self.network
            .parameter_names()
            .iter()
            .any(|name| state.steps(name) > 0)
    }

    /// Network without its running moments.
    #[must_use]
    pub fn network(&self) -> &NormalisedNetwork {
        &self.network
    }

    /// Stores the parts needed to act in a policy file: the network and its moments.
    pub fn store(&self, state: &State<f32>, file: &mut TensorFile) {
        self.network.store(state, file);
        self.moments.store(state, file);
    }

    /// Restores the parts needed to act that [`GaussianNetwork::store`] wrote.
    ///
    /// # Errors
    /// [`TensorFileError`] where the file does not fit.
    pub fn restore(&self, state: &mut State<f32>, file: &TensorFile) -> Result<(), TensorFileError> {
        self.network.restore(state, file)?;
        self.moments.restore(state, file)
    }
}

/// Name of the latest gradient of a parameter.
fn latest(parameter: &str) -> String {
    format!("latest.{parameter}")
}

impl Critic {
    /// Adds a critic of `n_observed` joint observations and `n_acted` entries of joint actions, and its target, to a
    /// state.
    pub fn new(
        [name, target]: [&str; 2],
        n_observed: usize,
        n_acted: usize,
        settings: &Settings,
        state: &mut State<f32>,
        rng: &mut impl RngCore,
    ) -> Self {
        let network = settings.network(name, n_observed + n_acted, 1);
        network.initialise_uniform(state, rng);
        Self {
            target: network.copied(target, state),
            network,
        }
    }

    /// Values `[batch, 1]`.
    #[must_use]
    pub fn value<'e>(&self, observations: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
        self.network.by_batch(input(observations, actions))
    }

    /// Values `[batch, 1]` of the target network.
    #[must_use]
    pub fn target_value<'e>(&self, observations: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
        self.target.by_batch(input(observations, actions))
    }

    /// Takes one step against the gradient of a loss `[1, 1]`.
    pub fn descend(&self, loss: Expression<'_>, settings: &Settings) {
        settings.descend(loss, &self.network.parameters(loss.equations()));
    }

    /// Moves the target network towards the critic.
    pub fn follow(&self, equations: &Equations, target_smoothing: f64) {
        let [target, source] = [&self.target, &self.network].map(|it| it.parameters(equations));
        equations.follow(&target, &source, target_smoothing);
    }

    /// Network without its target.
    #[must_use]
    pub fn network(&self) -> &NormalisedNetwork {
        &self.network
    }
}

fn input<'e>(observations: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
    observations.equations().join(&[actions, observations])
}
