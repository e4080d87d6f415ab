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
//! | alpha | `temperature` | scalar |
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
    acting, allocation,
    batch::plan_of,
    checkpoint,
    replay::Replay,
    scaling::{ObservationScaling, Scaling},
    schedule::UpdateSchedule,
    seat,
    seat_network::HiddenLayers,
    soft_learner::{self, ActionSet, Settings, Sizes, SoftLearner},
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    activation::Activation,
    equations::network::Network,
    policy_file::{Head, Policy, Ports},
};
use plan::{Plans, State};
use rand::RngCore;
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
    learner: SoftLearner,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
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

impl Config {
    fn sizes(&self, n_observed: usize, n_shares: usize) -> Sizes {
        let hidden = |layers| HiddenLayers {
            width: self.width,
            layers,
            activation: Activation::LeakyRelu,
        };
        Sizes {
            seen: n_observed,
            done: n_shares,
            policy: hidden(self.policy_layers),
            output_gain: self.output_gain,
            critics: hidden(self.critic_layers),
        }
    }

    #[allow(clippy::cast_precision_loss, reason = "a number of shares is far below 2^52")]
    fn settings(&self, n_shares: usize) -> Settings {
        Settings {
            actor_learning_rate: self.actor_learning_rate,
            critic_learning_rate: self.critic_learning_rate,
            temperature_learning_rate: Some(self.temperature_learning_rate),
            gradient_clip: self.gradient_clip,
            target_entropy: self.target_entropy.unwrap_or(-(n_shares as f64)),
            discount: self.discount,
            target_smoothing: self.target_smoothing,
        }
    }
}

impl GaussianSoftmaxSac {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = seat::only_seat(NAME, interface)?;
        let shares = seat::simplex(NAME, seat)?.to_vec();
        let scaling = Scaling::new(config.observation_scaling, seat::observed(NAME, seat)?);
        let sizes = config.sizes(scaling.n_channels(), shares.len());
        let (set, settings) = (ActionSet::Simplex, config.settings(shares.len()));
        let (mut state, first_temperature) = (State::default(), config.first_temperature);
        let initialise =
            |network: &Network, gain, state: &mut State<f32>| network.initialise(gain, state, rng);
        let learner = SoftLearner::new(
            "",
            set,
            sizes,
            first_temperature,
            settings,
            &mut state,
            initialise,
        );
        Ok(Self {
            replay: Replay::new(config.replay_capacity, sizes.seen, sizes.done, 1),
            learner,
            state,
            acting: Plans::default(),
            learning: Plans::default(),
            schedule: UpdateSchedule::new(),
            config,
            scaling,
            shares,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let batch = self.replay.draw(self.config.batch_size, rng);
        let (learner, widths) = (&self.learner, self.replay.widths());
        let plan = plan_of(&mut self.learning, batch.n_rows, widths, |batch| {
            learner.update(batch, |all| all);
        });
        batch.write(plan);
        plan.run_seeded("update", &mut self.state, rng.next_u64());
        soft_learner::record(plan, self.schedule.n_steps(), record)?;
        self.schedule.count_update();
        Ok(())
    }

    fn ports(&self) -> Ports {
        self.scaling.ports(&self.shares)
    }
}

impl Agent for GaussianSoftmaxSac {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let (learner, shape) = (&self.learner, [observations.len(), self.scaling.n_channels()]);
        let plan = self.acting.of_rows(observations.len(), |equations| {
            learner.act(equations.input("observations", shape));
        });
        plan.write("observations", &self.scaling.rows(observations));
        let shares = acting::actions(plan, mode, &mut self.state, rng);
        allocation::actions(shares, self.shares.len(), self.schedule.n_steps())
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

    fn plan(&mut self, _: usize) -> Option<String> {
        let (learner, config, widths) = (&self.learner, &self.config, self.replay.widths());
        let plan = plan_of(&mut self.learning, config.batch_size, widths, |batch| {
            learner.update(batch, |all| all);
        });
        Some(plan.graph().to_string())
    }

    checkpoint::keeps!(NAME);

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let (policy, ports) = (&self.learner.policy, self.ports());
        let policy = Policy::new(policy, &self.state, ports, Head::SoftmaxMean);
        policy.write(dir).map_err(checkpoint::error_of(NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let (ports, policy, state) = (self.ports(), &self.learner.policy, &mut self.state);
        checkpoint::import_policy(NAME, policy, state, dir, &ports, Head::SoftmaxMean)?;
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::{
        bandit,
        batch::BatchInputs,
        gradient_checks::{assert_gradient, outputs},
        soft_learner::joined,
    };
    use contract::random::stream;
    use numerics::equations::network::lower;
    use plan::Equations;

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
    fn the_target_entropy_is_minus_the_number_of_shares() {
        assert_eq!(agent(tiny()).learner.target_entropy(), -3.0);
        let given = agent(Config {
            target_entropy: Some(-1.5),
            ..tiny()
        });
        assert_eq!(given.learner.target_entropy(), -1.5);
    }

    /// Begins a routine `loss` for a batch of 4.
    fn write<'e>(agent: &GaussianSoftmaxSac, equations: &'e Equations) -> BatchInputs<'e> {
        let batch = BatchInputs::new(equations, 4, agent.replay.widths());
        equations.routine("loss");
        batch
    }

    #[test]
    fn the_soft_target_by_hand() {
        let mut agent = agent(Config {
            first_temperature: 0.5,
            ..tiny()
        });
        bandit::train(&mut agent, 1, &mut stream(&["target"]));
        let mut batch = agent.replay.draw(4, &mut stream(&["batch"]));
        batch.continues.fill(1.0);
        let learner = &agent.learner;
        // Draws of a routine are numbered, so that the target's draw is that of `next`.
        let [target] = outputs(["target"], &agent.state, &batch, |equations| {
            equations.output("target", learner.soft_target(write(&agent, equations)));
        });
        let [q, log_pi] = outputs(["lower", "log_pi"], &agent.state, &batch, |equations| {
            let inputs = write(&agent, equations);
            let next = learner.draw(inputs.next_observations);
            let seen = joined(inputs.next_observations, next.action);
            equations.output("lower", lower(&learner.target_critics, seen));
            equations.output("log_pi", next.log_density);
        });
        let expected = |i: usize| batch.rewards[i] + 0.99 * (q[i] - 0.5 * log_pi[i]);
        assert!((0..4).all(|i| (target[i] - expected(i)).abs() < 1e-5));
    }

    #[test]
    fn the_policy_gradient_agrees_with_finite_differences() {
        let mut agent = agent(Config { width: 5, ..tiny() });
        bandit::train(&mut agent, 3, &mut stream(&["gradient"]));
        let batch = agent.replay.draw(4, &mut stream(&["batch"]));
        let learner = &agent.learner;
        assert_gradient(&[&learner.policy], &agent.state, &batch, |equations| {
            let (loss, _) = learner.policy_loss(write(&agent, equations));
            equations.output("loss", loss);
        });
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

    #[test]
    fn members_of_a_population_learn_as_trials_alone() {
        crate::shared::population::assert_members_learn_as_alone(
            |rng| GaussianSoftmaxSac::new(tiny(), &bandit::interface(), rng).unwrap(),
            |agent| std::slice::from_mut(&mut agent.learning),
            |agent, rng| drop(bandit::train(agent, 5, rng)),
        );
    }
}
