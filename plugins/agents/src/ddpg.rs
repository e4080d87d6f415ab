//! Deep deterministic policy gradient with a softmax output: a baseline on the simplex without a density.
//!
//! Lillicrap et al. 2015, "Continuous control with deep reinforcement learning", arXiv:1509.02971, algorithm
//! 1.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s, s' | `observations`, `next_observations` (scaled) | `[batch, observed]` |
//! | mu(s) | `softmax(policy(s))` | `[batch, n_shares]` |
//! | Q(s, a) | `critic` | `[batch, 1]` |
//! | mu', Q' | `target_policy`, `target_critic` | as above |
//! | N | exploration noise, added to the logits before the softmax | `[n_shares]` |
//! | gamma, tau | `discount`, `target_smoothing` | scalars |
//!
//! Departures from the paper
//! - Softmax output, since actions are shares; the noise is added to its logits so that actions stay on the
//!   simplex.
//! - Independent Gaussian noise instead of an Ornstein-Uhlenbeck process: a decision here has no
//!   inertia, and rows of a batch stay independent of each other.
//! - Networks as the thesis has them for all its agents (three hidden layers, leaky rectifiers, no batch
//!   normalisation, the action enters at the first layer), initialised after He et al.; the policy's last
//!   layer starts small, as in the paper.
//! - No weight decay. Batches of 256 and one update per 16 environment steps by default, as for the other
//!   agents.
//!
//! Metrics, means over the updates since the last measurement: `critic_loss` half the squared error,
//! `policy_loss` `-mean(Q(s, mu(s)))`.

use crate::shared::{
    allocation,
    checkpoint::{self, finite},
    replay::{Batch, Replay},
    scaling::{ObservationScaling, Scaling},
    schedule::UpdateSchedule,
    seat,
    targets::{bootstrapped, half_squared_error},
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
    gaussian::standard_normal,
    network::{Activation, Mlp, device, matrix, values},
    optimizer::{Adam, TrainedNetwork},
    parameters::{restore, soft_update, store},
    policy_file::{Head, Policy},
    tensor_file::TensorFile,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "ddpg";
const LAYERS: [Activation; 3] = [Activation::LeakyRelu; 3];
/// Gain of the policy's last layer: at 300 inputs, the paper's bound of 3e-3 for uniform weights.
const POLICY_OUTPUT_GAIN: f64 = 0.03;

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Step size of Adam for the policy.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Lillicrap et al. 2015, section 7"))]
    pub actor_learning_rate: f64,
    /// Step size of Adam for the critic.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Lillicrap et al. 2015, section 7"))]
    pub critic_learning_rate: f64,
    /// Standard deviation of the noise on the logits while training.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-source" = "Lillicrap et al. 2015, section 7: sigma \
                                                                  0.2"))]
    pub exploration_sd: f64,
    /// Transitions per update.
    #[schemars(range(min = 1, max = 65536), extend("x-source" = "as for the Dirichlet policy; Lillicrap et \
                                                                 al. 2015: 64"))]
    pub batch_size: usize,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Lillicrap et al. 2015, section 7"))]
    pub discount: f64,
    /// Smoothing tau of both target networks.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "thesis, table 3.1; Lillicrap et al. 2015: \
                                                                 0.001"))]
    pub target_smoothing: f64,
    /// Updates per environment step, all environments counted.
    #[schemars(range(min = 0.0, max = 64.0), extend("x-source" = "as for the Dirichlet policy; Lillicrap et \
                                                                  al. 2015: 1"))]
    pub updates_per_step: f64,
    /// Units of each of the three hidden layers of policy and critic.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "thesis, section 3.4.5"))]
    pub width: usize,
    /// Transitions that the replay buffer holds.
    #[schemars(range(min = 1, max = 100_000_000), extend("x-source" = "Lillicrap et al. 2015, section 7"))]
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
            critic_learning_rate: 1e-3,
            exploration_sd: 0.2,
            batch_size: 256,
            discount: 0.99,
            target_smoothing: 0.005,
            updates_per_step: 0.0625,
            width: 256,
            replay_capacity: 1_000_000,
            learning_starts: 5_000,
            gradient_clip: None,
            observation_scaling: ObservationScaling::Typical,
        }
    }
}

impl contract::Config for Config {}

/// Deep deterministic policy gradient on a simplex.
#[derive(Debug, Clone)]
pub struct Ddpg {
    config: Config,
    scaling: Scaling,
    shares: Vec<String>,
    policy: TrainedNetwork<Mlp>,
    critic: TrainedNetwork<Mlp>,
    target_policy: Mlp,
    target_critic: Mlp,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "deep deterministic policy gradient with a softmax output";
    // Off-policy: the replay buffer takes decisions of any policy.
    let traits = AgentTraits::learner([Feed::Decisions, Feed::Dataset], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that observes a box and acts on a simplex.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(Ddpg::new(config, interface, rng)?))
}

/// Metrics that [`Ddpg::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![
        Metric::new("critic_loss", "", "half the squared error of the critic").lower_is_better(),
        Metric::new(
            "policy_loss",
            "",
            "minus the critic's value of the policy's actions",
        )
        .lower_is_better(),
    ]
}

impl Ddpg {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = seat::only_seat(NAME, interface)?;
        let shares = seat::simplex(NAME, seat)?.to_vec();
        let scaling = Scaling::new(config.observation_scaling, seat::observed(NAME, seat)?);
        let (n_observed, n_shares, width) = (scaling.n_channels(), shares.len(), config.width);
        let tracked = device().autodiff();
        let policy = Mlp::new(
            &[n_observed, width, width, width, n_shares],
            &LAYERS,
            POLICY_OUTPUT_GAIN,
            rng,
            &tracked,
        );
        let critic = Mlp::new(
            &[n_observed + n_shares, width, width, width, 1],
            &LAYERS,
            1.0,
            rng,
            &tracked,
        );
        Ok(Self {
            target_policy: policy.valid(),
            target_critic: critic.valid(),
            policy: TrainedNetwork::new(
                policy,
                Adam::new(config.actor_learning_rate, config.gradient_clip),
            ),
            critic: TrainedNetwork::new(
                critic,
                Adam::new(config.critic_learning_rate, config.gradient_clip),
            ),
            replay: Replay::new(config.replay_capacity, n_observed, n_shares, 1),
            schedule: UpdateSchedule::new(),
            config,
            scaling,
            shares,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let batch = self.replay.sample_with_replacement(self.config.batch_size, rng);
        self.update_critic(&batch, record)?;
        self.update_policy(&batch, record)?;
        let tau = self.config.target_smoothing;
        self.target_critic = soft_update(
            std::mem::take(&mut self.target_critic),
            self.critic.network(),
            tau,
        );
        self.target_policy = soft_update(
            std::mem::take(&mut self.target_policy),
            self.policy.network(),
            tau,
        );
        self.schedule.count_update();
        Ok(())
    }

    /// Eq. 4: the critic descends the squared error to its target.
    fn update_critic(&mut self, batch: &Batch, record: &mut Recorder) -> Result<(), Error> {
        let target = self.target(batch);
        let q = value(self.critic.network(), &batch.observations, batch.actions.clone());
        let loss = half_squared_error(q, target);
        record.mean(
            "critic_loss",
            finite("critic_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        self.critic.descend(&loss);
        Ok(())
    }

    /// Eq. 5: `r + gamma Q'(s', mu'(s'))`.
    fn target(&self, batch: &Batch) -> Tensor<2> {
        let next_action = softmax(self.target_policy.forward(batch.next_observations.clone()), 1);
        let next_value = value(&self.target_critic, &batch.next_observations, next_action);
        bootstrapped(
            batch.rewards.clone(),
            batch.continues.clone(),
            next_value,
            self.config.discount,
        )
    }

    /// Eq. 6: the policy ascends the critic through its action.
    fn update_policy(&mut self, batch: &Batch, record: &mut Recorder) -> Result<(), Error> {
        let action = softmax(self.policy.network().forward(batch.observations.clone()), 1);
        // An untracked critic: the gradient passes through it to the action alone.
        let loss = value(&self.critic.network().valid(), &batch.observations, action)
            .mean()
            .neg();
        record.mean(
            "policy_loss",
            finite("policy_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        self.policy.descend(&loss);
        Ok(())
    }
}

fn value(critic: &Mlp, observations: &Tensor<2>, action: Tensor<2>) -> Tensor<2> {
    critic.forward(Tensor::cat(vec![observations.clone(), action], 1))
}

#[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
fn noise(rows: usize, columns: usize, sd: f64, rng: &mut Rng) -> Tensor<2> {
    matrix(
        (0..rows * columns)
            .map(|_| (sd * standard_normal(rng)) as f32)
            .collect(),
        columns,
    )
}

impl Agent for Ddpg {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let scaled = observations
            .iter()
            .flat_map(|observation| self.scaling.apply(&observation.seats[0]))
            .collect();
        let logits = self
            .policy
            .network()
            .valid()
            .forward(matrix(scaled, self.scaling.n_channels()));
        let logits = match mode {
            Mode::Train => {
                logits
                    + noise(
                        observations.len(),
                        self.shares.len(),
                        self.config.exploration_sd,
                        rng,
                    )
            }
            Mode::Evaluate => logits,
        };
        allocation::actions(
            &values(softmax(logits, 1)),
            self.shares.len(),
            self.schedule.n_steps(),
        )
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

    checkpoint::keeps!(NAME; trained: policy, critic; targets: target_policy, target_critic; counters:);

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

    fn agent(config: Config) -> Ddpg {
        Ddpg::new(config, &bandit::interface(), &mut stream(&["ddpg"])).unwrap()
    }

    #[test]
    fn the_target_uses_both_target_networks() {
        let mut agent = agent(tiny());
        bandit::train(&mut agent, 6, &mut stream(&["target"]));
        let mut batch = agent.replay.sample_with_replacement(4, &mut stream(&["batch"]));
        batch.continues = batch.continues.ones_like();
        let next = softmax(agent.target_policy.forward(batch.next_observations.clone()), 1);
        let q = values(value(&agent.target_critic, &batch.next_observations, next));
        let (y, r) = (values(agent.target(&batch)), values(batch.rewards));
        assert!((0..4).all(|i| (y[i] - (r[i] + 0.99 * q[i])).abs() < 1e-6));
    }

    #[test]
    fn it_explores_while_training_only() {
        let mut agent = agent(tiny());
        let observation = [Observation {
            seats: vec![vec![0.3]],
            state: Vec::new(),
        }];
        let mut rng = stream(&["noise"]);
        let mut act = |mode| agent.act(&observation, mode, &mut rng).unwrap();
        assert_ne!(act(Mode::Train), act(Mode::Train));
        assert_eq!(act(Mode::Evaluate), act(Mode::Evaluate));
        let drawn = values(noise(5_000, 2, 0.2, &mut rng));
        let variance = drawn.iter().map(|x| x * x).sum::<f32>() / 10_000.0;
        assert!((variance - 0.04).abs() < 0.002, "{variance}");
    }

    #[test]
    fn it_learns_a_bandit() {
        let config = Config {
            actor_learning_rate: 1e-3,
            critic_learning_rate: 3e-3,
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
