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
    acting, allocation,
    batch::{BatchInputs, plan_of},
    bellman::{bootstrapped, half_squared_error},
    checkpoint::{self, finite},
    replay::Replay,
    scaling::{ObservationScaling, Scaling},
    schedule::UpdateSchedule,
    seat,
    seat_network::HiddenLayers,
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    activation::Activation,
    equations::network::Network,
    policy_file::{Head, Policy},
};
use plan::{Descent, Expression, Plans, State};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "ddpg";
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
    learner: Learner,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Networks, and the equations by which they act and learn.
#[derive(Debug, Clone)]
struct Learner {
    policy: Network,
    critic: Network,
    target_policy: Network,
    target_critic: Network,
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
        let (n_observed, n_shares) = (scaling.n_channels(), shares.len());
        let hidden = HiddenLayers {
            width: config.width,
            layers: 3,
            activation: Activation::LeakyRelu,
        };
        let mut state = State::default();
        let policy = hidden.network("policy", n_observed, n_shares);
        policy.initialise(POLICY_OUTPUT_GAIN, &mut state, rng);
        let critic = hidden.network("critic", n_observed + n_shares, 1);
        critic.initialise(1.0, &mut state, rng);
        let learner = Learner {
            target_policy: policy.copied("target_policy", &mut state),
            target_critic: critic.copied("target_critic", &mut state),
            policy,
            critic,
        };
        Ok(Self {
            replay: Replay::new(config.replay_capacity, n_observed, n_shares, 1),
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
        let (learner, config, widths) = (&self.learner, &self.config, self.replay.widths());
        let batch = self.replay.draw(config.batch_size, rng);
        let plan = plan_of(&mut self.learning, batch.n_rows, widths, |batch| {
            learner.update(batch, config);
        });
        batch.write(plan);
        plan.run("update", &mut self.state);
        for metric in ["critic_loss", "policy_loss"] {
            let loss = finite(metric, self.schedule.n_steps(), plan.number(metric))?;
            record.mean(metric, loss);
        }
        self.schedule.count_update();
        Ok(())
    }
}

impl Learner {
    /// Actions of the policy, with noise and without.
    fn act(&self, observations: Expression<'_>, exploration_sd: f64) {
        let equations = observations.equations();
        equations.routine("draw");
        let logits = self.policy.apply(observations);
        let noise = noise(logits, exploration_sd);
        equations.output("drawn", (logits + noise).softmax());
        equations.routine("choose");
        equations.output("chosen", self.policy.apply(observations).softmax());
    }

    /// One update of critic, policy and both targets.
    fn update(&self, batch: BatchInputs<'_>, config: &Config) {
        let equations = batch.observations.equations();
        equations.routine("update");
        let of = |network: &Network| network.parameters(equations);
        let (policy, critic) = (of(&self.policy), of(&self.critic));
        let adam = |rate, first_rate| Descent::adam(rate, first_rate, config.gradient_clip);
        // Eq. 4: the critic descends the squared error to its target.
        let target = self.target(batch, config.discount);
        let loss = half_squared_error(value(&self.critic, batch.observations, batch.actions), target);
        equations.output("critic_loss", loss);
        equations.descend(
            loss,
            &critic,
            &adam("critic_learning_rate", config.critic_learning_rate),
        );
        let loss = self.policy_loss(batch);
        equations.output("policy_loss", loss);
        equations.descend(
            loss,
            &policy,
            &adam("actor_learning_rate", config.actor_learning_rate),
        );
        equations.follow(&of(&self.target_critic), &critic, config.target_smoothing);
        equations.follow(&of(&self.target_policy), &policy, config.target_smoothing);
    }

    /// Eq. 5: `r + gamma Q'(s', mu'(s'))`.
    fn target<'e>(&self, batch: BatchInputs<'e>, discount: f64) -> Expression<'e> {
        let next_action = self.target_policy.apply(batch.next_observations).softmax();
        let next_value = value(&self.target_critic, batch.next_observations, next_action);
        bootstrapped(batch.rewards, batch.continues, next_value, discount)
    }

    /// Eq. 6: minus the critic's mean value of the policy's actions.
    fn policy_loss<'e>(&self, batch: BatchInputs<'e>) -> Expression<'e> {
        let action = self.policy.apply(batch.observations).softmax();
        -value(&self.critic, batch.observations, action).mean()
    }
}

fn value<'e>(critic: &Network, observations: Expression<'e>, action: Expression<'e>) -> Expression<'e> {
    critic.apply(observations.equations().join(&[observations, action]))
}

/// Independent Gaussian noise for logits.
fn noise(logits: Expression<'_>, sd: f64) -> Expression<'_> {
    logits.equations().normal(logits.shape()) * sd
}

impl Agent for Ddpg {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let (learner, n_observed) = (&self.learner, self.scaling.n_channels());
        let exploration_sd = self.config.exploration_sd;
        let plan = self.acting.of_rows(observations.len(), |equations| {
            let observations = equations.input("observations", [observations.len(), n_observed]);
            learner.act(observations, exploration_sd);
        });
        let seen = observations.iter().map(|observation| &observation.seats[0]);
        let scaled: Vec<f32> = seen.flat_map(|seen| self.scaling.apply(seen)).collect();
        plan.write("observations", &scaled);
        let action = acting::actions(plan, mode, &mut self.state, rng);
        let n_steps = self.schedule.n_steps();
        allocation::actions(action, self.shares.len(), n_steps)
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
            learner.update(batch, config);
        });
        Some(plan.graph().to_string())
    }

    checkpoint::keeps!(NAME);

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let (policy, ports) = (&self.learner.policy, self.scaling.ports(&self.shares));
        let policy = Policy::new(policy, &self.state, ports, Head::SoftmaxMean);
        policy.write(dir).map_err(checkpoint::error_of(NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let (policy, ports) = (&self.learner.policy, self.scaling.ports(&self.shares));
        checkpoint::import_policy(NAME, policy, &mut self.state, dir, &ports, Head::SoftmaxMean)?;
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::{bandit, gradient_checks::outputs};
    use contract::random::stream;
    use plan::{Equations, Processor};
    use rand::RngCore;

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
        let mut batch = agent.replay.draw(4, &mut stream(&["batch"]));
        batch.continues.fill(1.0);
        let learner = &agent.learner;
        let [y, q] = outputs(["target", "next_value"], &agent.state, &batch, |equations| {
            let inputs = BatchInputs::new(equations, 4, agent.replay.widths());
            equations.routine("loss");
            equations.output("target", learner.target(inputs, 0.99));
            let next = learner.target_policy.apply(inputs.next_observations).softmax();
            let q = value(&learner.target_critic, inputs.next_observations, next);
            equations.output("next_value", q);
        });
        let r = &batch.rewards;
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
        let equations = Equations::new();
        let logits = equations.input("logits", [5_000, 2]);
        equations.routine("draw");
        equations.output("noise", noise(logits, 0.2));
        let mut plan = Processor::<f32>::new(equations.into_graph());
        plan.run_seeded("draw", &mut State::default(), rng.next_u64());
        let variance = plan.entries("noise").iter().map(|x| x * x).sum::<f32>() / 10_000.0;
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

    #[test]
    fn members_of_a_population_learn_as_trials_alone() {
        crate::shared::population::assert_members_learn_as_alone(
            |rng| Ddpg::new(tiny(), &bandit::interface(), rng).unwrap(),
            |agent| std::slice::from_mut(&mut agent.learning),
            |agent, rng| drop(bandit::train(agent, 5, rng)),
        );
    }
}
