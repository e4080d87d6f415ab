//! Soft actor-critic with a Gaussian-softmax policy: the original algorithm made to act on a simplex, as a
//! baseline.
//!
//! Haarnoja et al. 2018, "Soft actor-critic algorithms and applications", arXiv:1812.05905; thesis, section
//! 3.4.1, for the policy: a candidate `u ~ N(mean, sd)` becomes the shares `a = softmax(u)` (eq. 3.3).
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s, s' | `observations`, `next_observations` (scaled) | `[batch, observed]` |
//! | u | candidate | `[batch, n_shares]` |
//! | a | `action = softmax(u)`, the input of the critics | `[batch, n_shares]` |
//! | log pi | `log_density` of the candidate | `[batch, 1]` |
//! | alpha | temperature, kept as `log_temperature` | scalar |
//! | H | `target_entropy`, minus the number of shares | scalar |
//!
//! Departures from the paper
//! - Softmax instead of tanh. The density is that of the candidate: softmax is no one-to-one map, and
//!   the density that ordinary code takes is the one whose bias the thesis describes (section 3.4.1).
//! - Networks as the thesis has them: three hidden layers with leaky rectifiers, initialised after He et al.
//! - `ln sd` is clamped to [-20, 2], as in the authors' code.
//! - One update per 16 environment steps and a first temperature of 0.1 by default, as for the Dirichlet
//!   policy.
//!
//! Metrics, means over the updates since the last measurement: `critic_loss`, `policy_loss`, `policy_entropy`
//! (`-mean(log pi)` of the candidate), `temperature`, `mean_value`.

use crate::shared::{
    allocation,
    checkpoint::{self, finite},
    replay::{Batch, Replay},
    scaling::{ObservationScaling, Scaling},
    schedule::UpdateSchedule,
    seat,
    targets::{bootstrapped, half_squared_error, mean},
};
use burn::{
    module::Module,
    tensor::{Tensor, activation::softmax},
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    gaussian_head::{self, mean_and_log_sd},
    gaussian_softmax::{GaussianSoftmaxSample, gaussian_softmax_sample},
    network::{Activation, Mlp, TwinMlp, device, matrix, values},
    optimizer::{Adam, ScalarAdam, TrainedNetwork},
    parameters::{restore, soft_update, store},
    policy_file::{Head, Policy},
    tensor_file::TensorFile,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "gaussian_softmax_sac";

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam for the policy.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 3.1"))]
    pub actor_learning_rate: f64,
    /// Step size of Adam for both critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 3.1"))]
    pub critic_learning_rate: f64,
    /// Step size of Adam for the logarithm of the temperature.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub temperature_learning_rate: f64,
    /// Temperature before learning.
    #[schemars(range(min = 1e-9, max = 1e3), extend("x-source" = "as for the Dirichlet policy"))]
    pub first_temperature: f64,
    /// Entropy of the candidate that the temperature steers to, in nats; null for minus the number of shares.
    #[schemars(extend("x-source" = "Haarnoja et al. 2018, table 1: null"))]
    pub target_entropy: Option<f64>,
    /// Transitions per update.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "Haarnoja et al. 2018, table 1; thesis, \
                                                                 table 3.1: 1024"))]
    pub batch_size: usize,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 3.1"))]
    pub discount: f64,
    /// Smoothing tau of the target critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 3.1"))]
    pub target_smoothing: f64,
    /// Updates per environment step, all environments counted.
    #[schemars(range(min = 0.0, max = 64.0), extend("x-source" = "as for the Dirichlet policy; thesis, \
                                                                  table 3.1: 1"))]
    pub updates_per_step: f64,
    /// Units of each hidden layer of policy and critics.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "thesis, section 3.4.5"))]
    pub width: usize,
    /// Scale of the policy's initial output weights; 1 is that of the Kaiming initialiser, which the thesis
    /// names. With a small scale the first policy shares about equally. At 1 its shares are so uneven that
    /// packs last 2 decisions, and 100 000 steps go by before it learns.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-source" = "own choice, by experiment"))]
    pub output_gain: f64,
    /// Number of hidden layers of the policy.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "thesis, section 3.4.5"))]
    pub policy_layers: usize,
    /// Number of hidden layers of each critic.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "thesis, section 3.4.5"))]
    pub critic_layers: usize,
    /// Transitions that the replay buffer holds.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "Haarnoja et al. 2018, table 1"))]
    pub replay_capacity: usize,
    /// Environment steps before the first update.
    #[schemars(range(min = 1), extend("x-source" = "as for the Dirichlet policy"))]
    pub learning_starts: u64,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0))]
    pub gradient_clip: Option<f64>,
    /// Scaling of observations for the networks.
    pub observation_scaling: ObservationScaling,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            actor_learning_rate: 1e-4,
            critic_learning_rate: 3e-4,
            temperature_learning_rate: 3e-4,
            first_temperature: 0.1,
            target_entropy: None,
            batch_size: 256,
            discount: 0.99,
            target_smoothing: 0.005,
            updates_per_step: 0.0625,
            width: 256,
            output_gain: 0.01,
            policy_layers: 3,
            critic_layers: 3,
            replay_capacity: 1_000_000,
            learning_starts: 5_000,
            gradient_clip: None,
            observation_scaling: ObservationScaling::Typical,
        }
    }
}

impl contract::Config for Config {}

/// Soft actor-critic for one seat that acts on a simplex.
#[derive(Debug, Clone)]
pub struct GaussianSoftmaxSac {
    config: Config,
    scaling: Scaling,
    shares: Vec<String>,
    target_entropy: f64,
    policy: TrainedNetwork<Mlp>,
    critics: TrainedNetwork<TwinMlp>,
    target_critics: TwinMlp,
    log_temperature: f64,
    temperature_adam: ScalarAdam,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "soft actor-critic with a Gaussian-softmax policy";
    // Off-policy: the replay buffer takes decisions of any policy.
    let traits = AgentTraits::learner([Feed::Decisions, Feed::Dataset], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that observes a box and acts on a simplex.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(GaussianSoftmaxSac::new(config, interface, rng)?))
}

/// Metrics that [`GaussianSoftmaxSac::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![
        Metric::new("critic_loss", "", "half the squared error of both critics").lower_is_better(),
        Metric::new(
            "policy_loss",
            "",
            "temperature times log pi less the lower critic",
        )
        .lower_is_better(),
        Metric::new(
            "policy_entropy",
            "nat",
            "minus the mean log density of sampled candidates",
        ),
        Metric::new("temperature", "", "weight of the entropy").lower_is_better(),
        Metric::new(
            "mean_value",
            "",
            "mean of the lower critic at the policy's actions",
        ),
    ]
}

impl GaussianSoftmaxSac {
    #[allow(clippy::cast_precision_loss, reason = "a number of shares is far below 2^52")]
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = seat::only_seat(NAME, interface)?;
        let shares = seat::simplex(NAME, seat)?.to_vec();
        let scaling = Scaling::new(config.observation_scaling, seat::observed(NAME, seat)?);
        let (n_observed, n_shares, width) = (scaling.n_channels(), shares.len(), config.width);
        let tracked = device().autodiff();
        let sizes = |inputs, layers, outputs| [vec![inputs], vec![width; layers], vec![outputs]].concat();
        let activations = |layers| vec![Activation::LeakyRelu; layers];
        let (layers, outputs) = (config.policy_layers, 2 * n_shares);
        let policy = Mlp::new(
            &sizes(n_observed, layers, outputs),
            &activations(layers),
            config.output_gain,
            rng,
            &tracked,
        );
        let (layers, inputs) = (config.critic_layers, n_observed + n_shares);
        let critics = TwinMlp::new(
            &sizes(inputs, layers, 1),
            &activations(layers),
            1.0,
            rng,
            &tracked,
        );
        let adam = |rate| Adam::new(rate, config.gradient_clip);
        Ok(Self {
            target_entropy: config.target_entropy.unwrap_or(-(n_shares as f64)),
            target_critics: critics.valid(),
            policy: TrainedNetwork::new(policy, adam(config.actor_learning_rate)),
            critics: TrainedNetwork::new(critics, adam(config.critic_learning_rate)),
            log_temperature: config.first_temperature.ln(),
            temperature_adam: ScalarAdam::new(config.temperature_learning_rate),
            replay: Replay::new(config.replay_capacity, n_observed, n_shares, 1),
            schedule: UpdateSchedule::new(),
            config,
            scaling,
            shares,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let batch = self.replay.sample_with_replacement(self.config.batch_size, rng);
        self.update_critics(&batch, rng, record)?;
        let log_pi = self.update_policy(&batch, rng, record)?;
        self.update_temperature(log_pi);
        let target = std::mem::take(&mut self.target_critics);
        self.target_critics = soft_update(target, self.critics.network(), self.config.target_smoothing);
        self.schedule.count_update();
        Ok(())
    }

    /// Eq. 5 of the paper: both critics descend the soft Bellman error.
    fn update_critics(&mut self, batch: &Batch, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let target = self.soft_target(batch, rng);
        let input = Tensor::cat(vec![batch.observations.clone(), batch.actions.clone()], 1);
        let (q1, q2) = self.critics.network().forward(input);
        let loss = half_squared_error(q1, target.clone()) + half_squared_error(q2, target);
        record.mean(
            "critic_loss",
            finite("critic_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        self.critics.descend(&loss);
        Ok(())
    }

    /// Eq. 2 and 3: reward plus the discounted soft value of the next observation, without gradients.
    fn soft_target(&self, batch: &Batch, rng: &mut Rng) -> Tensor<2> {
        let next = self.draw(&self.policy.network().valid(), &batch.next_observations, rng);
        let (q1, q2) = self
            .target_critics
            .forward(Tensor::cat(vec![batch.next_observations.clone(), next.action], 1));
        let soft_value = q1.min_pair(q2) - next.log_density * self.temperature();
        bootstrapped(
            batch.rewards.clone(),
            batch.continues.clone(),
            soft_value,
            self.config.discount,
        )
    }

    /// Eq. 9: the policy descends `temperature * log pi - Q`; returns the mean of `log pi`.
    fn update_policy(&mut self, batch: &Batch, rng: &mut Rng, record: &mut Recorder) -> Result<f64, Error> {
        let drawn = self.draw(self.policy.network(), &batch.observations, rng);
        // Untracked critics: the gradient passes through them to the action alone.
        let input = Tensor::cat(vec![batch.observations.clone(), drawn.action], 1);
        let (q1, q2) = self.critics.network().valid().forward(input);
        let q = q1.min_pair(q2);
        let loss = (drawn.log_density.clone() * self.temperature() - q.clone()).mean();
        record.mean(
            "policy_loss",
            finite("policy_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        self.policy.descend(&loss);
        let mean_log_pi = f64::from(mean(drawn.log_density));
        record.mean("policy_entropy", -mean_log_pi);
        record.mean("mean_value", f64::from(mean(q)));
        record.mean("temperature", self.temperature());
        Ok(mean_log_pi)
    }

    /// Eq. 18, for the logarithm of the temperature: it rises where the entropy is below its target.
    fn update_temperature(&mut self, mean_log_pi: f64) {
        let gradient = -(mean_log_pi + self.target_entropy);
        self.log_temperature = self.temperature_adam.step(self.log_temperature, gradient);
    }

    fn temperature(&self) -> f64 {
        self.log_temperature.exp()
    }

    fn draw(&self, policy: &Mlp, observations: &Tensor<2>, rng: &mut Rng) -> GaussianSoftmaxSample {
        let (mean, log_sd) = mean_and_log_sd(policy.forward(observations.clone()));
        gaussian_softmax_sample(mean, log_sd, rng)
    }
}

impl Agent for GaussianSoftmaxSac {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let scaled = observations
            .iter()
            .flat_map(|observation| self.scaling.apply(&observation.seats[0]))
            .collect();
        let scaled = matrix(scaled, self.scaling.n_channels());
        let policy = self.policy.network().valid();
        let shares = match mode {
            Mode::Train => self.draw(&policy, &scaled, rng).action,
            Mode::Evaluate => softmax(gaussian_head::mean(policy.forward(scaled)), 1),
        };
        allocation::actions(&values(shares), self.shares.len(), self.schedule.n_steps())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        for transition in transitions {
            self.replay.push_scaled(transition, &self.scaling);
        }
        let Config {
            learning_starts,
            updates_per_step,
            ..
        } = self.config;
        for _ in 0..self
            .schedule
            .advance(transitions.len(), learning_starts, updates_per_step)
        {
            self.update(rng, record)?;
        }
        Ok(())
    }

    checkpoint::keeps!(NAME; trained: policy, critics; targets: target_critics; counters: log_temperature, temperature_adam);

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let policy = Policy::new(
            self.policy.network(),
            self.scaling.ports(&self.shares),
            Head::SoftmaxMean,
        );
        policy.write(dir).map_err(checkpoint::error_of(NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let ports = self.scaling.ports(&self.shares);
        checkpoint::import_policy(NAME, &mut self.policy, dir, &ports, Head::SoftmaxMean)?;
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::bandit;
    use contract::random::stream;

    fn tiny() -> Config {
        Config {
            width: 16,
            batch_size: 32,
            learning_starts: 32,
            updates_per_step: 0.125,
            ..Config::default()
        }
    }

    fn agent(config: Config) -> GaussianSoftmaxSac {
        GaussianSoftmaxSac::new(config, &bandit::interface(), &mut stream(&["gsac"])).unwrap()
    }

    #[test]
    fn deviations_stay_within_their_limits() {
        let (mean, log_sd) = mean_and_log_sd(matrix(vec![1.0, -2.0, 5.0, -30.0], 4));
        assert_eq!(
            (values(mean), values(log_sd)),
            (vec![1.0, -2.0], vec![2.0, -20.0])
        );
    }

    #[test]
    fn the_target_entropy_is_minus_the_number_of_shares() {
        assert_eq!(agent(tiny()).target_entropy, -3.0);
        assert_eq!(
            agent(Config {
                target_entropy: Some(-1.5),
                ..tiny()
            })
            .target_entropy,
            -1.5
        );
    }

    #[test]
    fn the_soft_target_by_hand() {
        let mut agent = agent(Config {
            first_temperature: 0.5,
            ..tiny()
        });
        bandit::train(&mut agent, 1, &mut stream(&["target"]));
        let mut batch = agent.replay.sample_with_replacement(4, &mut stream(&["batch"]));
        batch.continues = batch.continues.ones_like();
        let target = values(agent.soft_target(&batch, &mut stream(&["noise"])));
        let next = agent.draw(
            &agent.policy.network().valid(),
            &batch.next_observations,
            &mut stream(&["noise"]),
        );
        let (q1, q2) = agent
            .target_critics
            .forward(Tensor::cat(vec![batch.next_observations, next.action], 1));
        let (q1, q2, log_pi, r) = (
            values(q1),
            values(q2),
            values(next.log_density),
            values(batch.rewards),
        );
        for i in 0..4 {
            assert!((target[i] - (r[i] + 0.99 * (q1[i].min(q2[i]) - 0.5 * log_pi[i]))).abs() < 1e-5);
        }
    }

    #[test]
    fn it_learns_a_bandit() {
        let config = Config {
            actor_learning_rate: 3e-3,
            critic_learning_rate: 3e-3,
            first_temperature: 0.01,
            target_entropy: Some(-6.0),
            ..tiny()
        };
        let mut rng = stream(&["bandit"]);
        let mut agent = agent(config);
        let before = bandit::error(&mut agent, &mut rng);
        bandit::train(&mut agent, 700, &mut rng);
        let after = bandit::error(&mut agent, &mut rng);
        assert!(before > 0.25 && after < 0.1, "{before} {after}");
    }

    #[test]
    fn a_saved_agent_continues() {
        bandit::assert_continues(|rng| build(tiny(), &bandit::interface(), rng).unwrap());
    }

    #[test]
    fn recorded_metrics_are_declared() {
        bandit::assert_declared(&mut agent(tiny()), &metrics());
    }

    #[test]
    fn the_exported_policy_takes_the_evaluation_actions() {
        bandit::assert_exports(&mut agent(tiny()));
        bandit::assert_imports(|interface, rng| build(tiny(), interface, rng).unwrap());
    }
}
