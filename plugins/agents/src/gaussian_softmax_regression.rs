//! Regression onto a simplex with a Gaussian-softmax distribution: the other side of the thesis' numerical
//! experiment (section 3.4.3, fig. 3.2).
//!
//! A network maps what is observed to mean and deviation of a Gaussian candidate; softmax makes it a point of
//! the simplex.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s | `observations` | `[batch, observed]` |
//! | mu, sigma | `mean`, `exp(log_sd)` | `[batch, n_shares]` each |
//! | a | `softmax(u)`, `u ~ N(mu, sigma)` | `[batch, n_shares]` |
//! | target | `targets`, rows sum to 1 | `[batch, n_shares]` |
//!
//! Departures from the thesis, which names the error but not the loss
//! - `expected_error`: mean absolute error of a reparameterised draw, so that the policy is trained as it
//!   acts.
//! - `log_likelihood`: minus the log density of a candidate of the target, `ln target` (its softmax is the
//!   target); as ordinary code has it, the density on the simplex itself is not formed.
//! - `ln sd` is clamped to [-20, 2], as in the usual soft actor-critic.
//!
//! It samples in training and takes `softmax(mean)` where it is scored. Metric: `loss`, mean over the calls
//! since the last measurement.

use crate::shared::{
    allocation,
    checkpoint::{self, finite},
    scaling::{ObservationScaling, Scaling},
    seat,
    simplex_regression::{Progress, RegressionLoss, examples, excess_error, log_shares, mean_absolute_error},
};
use burn::{
    module::Module,
    tensor::{Tensor, activation::softmax},
};
use contract::{
    Action, Agent, AgentTraits, Error, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    gaussian::HALF_LN_TWO_PI,
    gaussian_head::mean_and_log_sd,
    gaussian_softmax::gaussian_softmax_sample,
    network::{Activation, Mlp, device, matrix, values},
    optimizer::{Adam, Trained},
    policy_file::{Head, Policy},
    tensor_file::TensorFile,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "gaussian_softmax_regression";
const LAYERS: [Activation; 3] = [Activation::LeakyRelu; 3];

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, section 3.4.3: 0.01 and 0.1"))]
    pub learning_rate: f64,
    /// What is minimised.
    pub loss: RegressionLoss,
    /// Units of each of the three hidden layers.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "thesis, section 3.4.3"))]
    pub width: usize,
    /// How observations reach the network.
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

/// The agent.
#[derive(Debug, Clone)]
pub struct GaussianSoftmaxRegression {
    loss: RegressionLoss,
    scaling: Scaling,
    shares: Vec<String>,
    network: Trained<Mlp>,
    progress: Progress,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "regression onto a simplex with a Gaussian-softmax distribution";
    let traits = AgentTraits {
        learns: true,
        metrics: metrics(),
        learns_from_examples: true,
        ..AgentTraits::default()
    };
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that acts on a simplex, in an environment whose state is the target.
///
/// # Errors
/// [`Error::Mismatch`] for any other environment.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(GaussianSoftmaxRegression::new(&config, interface, rng)?))
}

/// What [`GaussianSoftmaxRegression::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![Metric::new("loss", "", "what the regression minimises").lower_is_better()]
}

impl GaussianSoftmaxRegression {
    fn new(config: &Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = seat::only_seat(NAME, interface)?;
        let shares = seat::simplex(NAME, seat)?.to_vec();
        seat::state_of_length(NAME, interface, shares.len())?;
        let scaling = Scaling::new(config.observation_scaling, seat::observed(NAME, seat)?);
        let sizes = [
            scaling.n_channels(),
            config.width,
            config.width,
            config.width,
            2 * shares.len(),
        ];
        let network = Mlp::new(&sizes, &LAYERS, 1.0, rng, &device().autodiff());
        let network = Trained::new(network, Adam::new(config.learning_rate, None));
        Ok(Self {
            loss: config.loss,
            scaling,
            shares,
            network,
            progress: Progress::default(),
        })
    }

    fn loss(&self, observations: Tensor<2>, targets: Tensor<2>, rng: &mut Rng) -> Tensor<1> {
        let (mean, log_sd) = mean_and_log_sd(self.network.network().forward(observations));
        match self.loss {
            RegressionLoss::ExpectedError => {
                mean_absolute_error(gaussian_softmax_sample(mean, log_sd, rng).action, targets)
            }
            RegressionLoss::LogLikelihood => log_density(mean, log_sd, log_shares(targets)).mean().neg(),
            RegressionLoss::ScoreFunction => {
                let drawn = gaussian_softmax_sample(mean.clone().inner(), log_sd.clone().inner(), rng);
                let density = log_density(mean, log_sd, Tensor::from_inner(drawn.candidate));
                (density * Tensor::from_inner(excess_error(drawn.action, targets))).mean()
            }
        }
    }
}

/// `ln N(u; mean, sd)`, `[batch, 1]`.
fn log_density(mean: Tensor<2>, log_sd: Tensor<2>, candidate: Tensor<2>) -> Tensor<2> {
    let residual = (candidate - mean) / log_sd.clone().exp();
    (residual.powf_scalar(2.0) * -0.5 - log_sd - HALF_LN_TWO_PI).sum_dim(1)
}

impl Agent for GaussianSoftmaxRegression {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let scaled = observations
            .iter()
            .flat_map(|observation| self.scaling.apply(&observation.seats[0]))
            .collect();
        let scaled = matrix(scaled, self.scaling.n_channels());
        let (mean, log_sd) = mean_and_log_sd(self.network.network().valid().forward(scaled));
        let shares = match mode {
            Mode::Train => gaussian_softmax_sample(mean, log_sd, rng).action,
            Mode::Evaluate => softmax(mean, 1),
        };
        allocation::actions(&values(shares), self.shares.len(), self.progress.n_examples)
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        self.progress.n_examples += transitions.len() as u64;
        let (observations, targets) = examples(transitions, &self.scaling);
        let loss = self.loss(observations, targets, rng);
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
        checkpoint::write(NAME, dir, file, &self.progress)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, progress) = checkpoint::read(NAME, dir)?;
        self.network
            .restore("network", &file)
            .map_err(checkpoint::error_of(NAME))?;
        self.progress = progress;
        Ok(())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let policy = Policy::new(
            self.network.network(),
            self.scaling.ports(&self.shares),
            Head::SoftmaxMean,
        );
        policy.write(dir).map_err(checkpoint::error_of(NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let ports = self.scaling.ports(&self.shares);
        checkpoint::import_policy(NAME, &mut self.network, dir, &ports, Head::SoftmaxMean)?;
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::bandit;
    use contract::random::stream;

    fn agent(loss: RegressionLoss) -> GaussianSoftmaxRegression {
        let config = Config {
            loss,
            width: 16,
            ..Config::default()
        };
        GaussianSoftmaxRegression::new(&config, &bandit::interface(), &mut stream(&["regression"])).unwrap()
    }

    #[test]
    fn the_density_by_hand() {
        // Two standard deviations of 0.5 above the mean: -2 + ln 2 - ln(2 pi) / 2.
        let ln_sd = matrix(vec![0.5f32.ln()], 1);
        let density = values(log_density(matrix(vec![1.0], 1), ln_sd, matrix(vec![2.0], 1)))[0];
        assert!((f64::from(density) - (-2.0 + 2f64.ln() - HALF_LN_TWO_PI)).abs() < 1e-6);
    }

    #[test]
    fn both_losses_find_the_target() {
        for loss in [RegressionLoss::ExpectedError, RegressionLoss::LogLikelihood] {
            let (mut agent, mut rng) = (agent(loss), stream(&["find"]));
            let before = bandit::error(&mut agent, &mut rng);
            bandit::train(&mut agent, 400, &mut rng);
            let after = bandit::error(&mut agent, &mut rng);
            assert!(before > 0.2 && after < 0.06, "{loss:?} {before} {after}");
        }
    }

    #[test]
    fn a_saved_agent_continues() {
        bandit::assert_continues(|rng| build(Config::default(), &bandit::interface(), rng).unwrap());
    }

    #[test]
    fn what_it_records_is_declared_and_what_it_exports_acts() {
        bandit::assert_declared(&mut agent(RegressionLoss::ExpectedError), &metrics());
        bandit::assert_exports(&mut agent(RegressionLoss::ExpectedError));
        let config = || Config {
            width: 16,
            ..Config::default()
        };
        bandit::assert_imports(|interface, rng| build(config(), interface, rng).unwrap());
    }

    #[test]
    fn a_state_that_is_no_target_is_refused() {
        let interface = crate::shared::seat::tests::allocation(&["x"], &["best_1"], 3);
        assert!(matches!(
            build(Config::default(), &interface, &mut stream(&["x"])),
            Err(Error::Mismatch { .. })
        ));
    }
}
