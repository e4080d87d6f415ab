//! A network that maps observations to a distribution on the simplex, with any [head](SimplexHead).
//!
//! | tensor | shape |
//! |---|---|
//! | outputs, parameters | `[batch, OUTPUTS_PER_SHARE * n_shares]` |
//! | targets, draws, centres | `[batch, n_shares]` |
//! | loss | `[1]` |

use super::{Progress, RegressionLoss, examples};
use crate::shared::{
    allocation,
    checkpoint::{self, finite},
    scaling::{ObservationScaling, Scaling},
    seat,
};
use burn::{module::Module, tensor::Tensor};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    network::{Activation, Mlp, device, matrix, values},
    optimizer::{Adam, TrainedNetwork},
    policy_file::{Head, Policy},
    tensor_file::TensorFile,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{fmt::Debug, marker::PhantomData, path::Path};

/// Distribution on the simplex that is parameterised by the outputs of a network.
pub trait SimplexHead: Debug + Send + 'static {
    /// Name under which the agent is registered.
    const NAME: &'static str;
    /// Activations of the three hidden layers.
    const LAYERS: [Activation; 3];
    /// Number of outputs of the network per share.
    const OUTPUTS_PER_SHARE: usize;
    /// Head by which an exported policy computes its shares.
    const EXPORTED: Head;

    /// Parameters of the distribution from the network's outputs, after `n_examples` examples.
    ///
    /// # Errors
    /// [`Error::NotFinite`] where a parameter is not finite.
    fn parameters(outputs: Tensor<2>, n_examples: u64) -> Result<Tensor<2>, Error>;

    /// One draw per row, with shares that sum to 1; gradients flow into the parameters.
    fn sample(parameters: Tensor<2>, rng: &mut Rng) -> Tensor<2>;

    /// Representative point of the distribution in each row, up to a positive factor.
    fn centre(parameters: Tensor<2>) -> Tensor<2>;

    /// Loss `[1]` of parameters and targets with one row per example.
    fn loss(loss: RegressionLoss, parameters: Tensor<2>, targets: Tensor<2>, rng: &mut Rng) -> Tensor<1>;
}

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, section 3.4.3: 0.01 and 0.1"))]
    pub learning_rate: f64,
    /// Minimised loss.
    pub loss: RegressionLoss,
    /// Units of each of the three hidden layers.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "thesis, section 3.4.3"))]
    pub width: usize,
    /// Scaling of observations for the networks.
    pub observation_scaling: ObservationScaling,
}

impl Default for Config {
    fn default() -> Self {
        let loss = RegressionLoss::ExpectedError;
        Self {
            learning_rate: 0.01,
            loss,
            width: 64,
            observation_scaling: ObservationScaling::None,
        }
    }
}

impl contract::Config for Config {}

/// Agent that predicts shares with the head `H`.
#[derive(Debug)]
pub struct SimplexRegression<H> {
    loss: RegressionLoss,
    scaling: Scaling,
    shares: Vec<String>,
    network: TrainedNetwork<Mlp>,
    progress: Progress,
    head: PhantomData<H>,
}

/// Registers the agent with a head.
pub fn register<H: SimplexHead>(registry: &mut Registry, version: u32, about: &'static str) {
    let traits = AgentTraits::learner([Feed::Examples], metrics());
    registry.agent(H::NAME, version, about, traits, build::<H>);
}

/// Builds the agent for one seat that acts on a simplex, in an environment whose state is the target.
///
/// # Errors
/// [`Error::Mismatch`] for any other environment.
fn build<H: SimplexHead>(
    config: Config,
    interface: &Interface,
    rng: &mut Rng,
) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(SimplexRegression::<H>::new(&config, interface, rng)?))
}

/// Metrics that [`SimplexRegression::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![Metric::new("loss", "", "what the regression minimises").lower_is_better()]
}

impl<H: SimplexHead> SimplexRegression<H> {
    fn new(config: &Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = seat::only_seat(H::NAME, interface)?;
        let shares = seat::simplex(H::NAME, seat)?.to_vec();
        seat::state_of_length(H::NAME, interface, shares.len())?;
        let scaling = Scaling::new(config.observation_scaling, seat::observed(H::NAME, seat)?);
        let sizes = [
            scaling.n_channels(),
            config.width,
            config.width,
            config.width,
            H::OUTPUTS_PER_SHARE * shares.len(),
        ];
        let network = Mlp::new(&sizes, &H::LAYERS, 1.0, rng, &device().autodiff());
        let network = TrainedNetwork::new(network, Adam::new(config.learning_rate, None));
        Ok(Self {
            loss: config.loss,
            scaling,
            shares,
            network,
            progress: Progress::default(),
            head: PhantomData,
        })
    }

    fn parameters(&self, network: &Mlp, observations: Tensor<2>) -> Result<Tensor<2>, Error> {
        H::parameters(network.forward(observations), self.progress.n_examples)
    }
}

impl<H: SimplexHead> Agent for SimplexRegression<H> {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let scaled = observations
            .iter()
            .flat_map(|observation| self.scaling.apply(&observation.seats[0]))
            .collect();
        let scaled = matrix(scaled, self.scaling.n_channels());
        let parameters = self.parameters(&self.network.network().valid(), scaled)?;
        let weights = match mode {
            Mode::Train => H::sample(parameters, rng),
            Mode::Evaluate => H::centre(parameters),
        };
        allocation::actions(&values(weights), self.shares.len(), self.progress.n_examples)
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        self.progress.n_examples += transitions.len() as u64;
        let (observations, targets) = examples(transitions, &self.scaling);
        let parameters = self.parameters(self.network.network(), observations)?;
        let loss = H::loss(self.loss, parameters, targets, rng);
        record.mean(
            "loss",
            finite("loss", self.progress.n_examples, values(loss.clone())[0])?,
        );
        self.network.descend(&loss);
        self.progress.n_updates += 1;
        Ok(())
    }

    fn reads_state(&self) -> bool {
        true
    }

    fn updates(&self) -> Option<Updates> {
        Some(self.progress.updates())
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        self.network.store("network", &mut file);
        checkpoint::write(H::NAME, dir, file, &self.progress)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, progress) = checkpoint::read(H::NAME, dir)?;
        self.network
            .restore("network", &file)
            .map_err(checkpoint::error_of(H::NAME))?;
        self.progress = progress;
        Ok(())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let ports = self.scaling.ports(&self.shares);
        let policy = Policy::new(self.network.network(), ports, H::EXPORTED);
        policy.write(dir).map_err(checkpoint::error_of(H::NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let ports = self.scaling.ports(&self.shares);
        checkpoint::import_policy(H::NAME, &mut self.network, dir, &ports, H::EXPORTED)?;
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        dirichlet_regression::Dirichlet, gaussian_softmax_regression::GaussianSoftmax, shared::bandit,
    };
    use contract::random::stream;

    fn config(loss: RegressionLoss) -> Config {
        Config {
            loss,
            width: 16,
            ..Config::default()
        }
    }

    fn agent<H: SimplexHead>(loss: RegressionLoss) -> SimplexRegression<H> {
        let mut rng = stream(&["regression"]);
        SimplexRegression::new(&config(loss), &bandit::interface(), &mut rng).unwrap()
    }

    fn finds_the_target<H: SimplexHead>() {
        for loss in [RegressionLoss::ExpectedError, RegressionLoss::LogLikelihood] {
            let (mut agent, mut rng) = (agent::<H>(loss), stream(&["find"]));
            let before = bandit::error(&mut agent, &mut rng);
            bandit::train(&mut agent, 400, &mut rng);
            let after = bandit::error(&mut agent, &mut rng);
            assert!(before > 0.2 && after < 0.06, "{loss:?} {before} {after}");
        }
    }

    fn is_kept<H: SimplexHead>() {
        bandit::assert_continues(|rng| build::<H>(Config::default(), &bandit::interface(), rng).unwrap());
        bandit::assert_declared(&mut agent::<H>(RegressionLoss::ExpectedError), &metrics());
        bandit::assert_exports(&mut agent::<H>(RegressionLoss::ExpectedError));
        let made = |interface: &Interface, rng: &mut Rng| {
            build::<H>(config(RegressionLoss::ExpectedError), interface, rng)
        };
        bandit::assert_imports(|interface, rng| made(interface, rng).unwrap());
    }

    fn refuses_a_state_that_is_no_target<H: SimplexHead>() {
        let interface = crate::shared::seat::tests::allocation(&["x"], &["best_1"], 3);
        let built = build::<H>(Config::default(), &interface, &mut stream(&["x"]));
        assert!(matches!(built, Err(Error::Mismatch { .. })));
    }

    #[test]
    fn both_losses_find_the_target_with_either_head() {
        finds_the_target::<Dirichlet>();
        finds_the_target::<GaussianSoftmax>();
    }

    #[test]
    fn a_saved_agent_continues_and_an_exported_policy_acts() {
        is_kept::<Dirichlet>();
        is_kept::<GaussianSoftmax>();
    }

    #[test]
    fn a_state_that_is_no_target_is_refused() {
        refuses_a_state_that_is_no_target::<Dirichlet>();
        refuses_a_state_that_is_no_target::<GaussianSoftmax>();
    }
}
