//! TD3 with behaviour cloning: an actor-critic for datasets that stays close to their actions.
//!
//! Fujimoto and Gu 2021, "A minimalist approach to offline reinforcement learning", arXiv:2106.06860
//! (equations are its), on Fujimoto et al. 2018, "Addressing function approximation error in actor-critic
//! methods", arXiv:1802.09477 (TD3).
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s, s' | observations less their mean over the dataset, divided by their deviation (eq. 6) | `[batch, observed]` |
//! | a | actions of the dataset | `[batch, n]` |
//! | pi(s) | `tanh(z)` in a box with limits -1 and 1, `softmax(z)` on a simplex | `[batch, n]` |
//! | Q_1, Q_2 | `critics` of scaled observation and centred action | `[batch, 1]` each |
//! | pi', Q' | `target_policy`, `target_critics` | as above |
//! | epsilon | `clip(N(0, sigma), -c, c)`, sigma 0.2, c 0.5 | `[batch, n]` |
//! | alpha, lambda | `alpha` 2.5; `lambda = alpha / mean abs Q_1(s, pi(s))` over the batch, without gradient | scalars |
//! | gamma, tau, d | `discount`, `target_smoothing`, `policy_delay` | scalars |
//!
//! With `c(a)` the centred action, `a` in a box and `n a - 1` on a simplex:
//! - the target of both critics is `y = r + gamma (1 - terminal) min(Q'_1, Q'_2)(s', a')` with the smoothed
//!   `a' = pi'(s') + epsilon`;
//! - every `policy_delay` updates of the critics the policy descends `-lambda mean(Q_1(s, pi(s))) +
//!   mean((c(pi(s)) - c(a))^2)` (eq. 5) and all targets follow by `tau`.
//!
//! Departures from the paper
//! - Simplex. The paper acts in boxes. Here shares are the softmax of the outputs, and the noise of the
//!   target is added to the outputs before it, so that the smoothed action stays on the simplex. Critics and the
//!   cloning term see `n a - 1`: squares of plain shares are so small that `alpha` would have another meaning
//!   than in a box.
//! - A deviation is enlarged by a thousandth of the typical one of its channel; the paper adds 0.001 to
//!   states without units.
//! - Half the squared error is descended by the critics: the same steps under Adam.
//! - The agent acts alike in training and evaluation; no training asks it to act.
//!
//! Metrics, means over the updates since the last measurement: `critic_loss` half the squared error summed
//! over both critics, `policy_loss` eq. 5, `clone_error` the mean over batch and entries of `|pi(s) - a|`,
//! `mean_value` the mean of `Q_1(s, pi(s))`.

#[cfg(test)]
mod tests;

use crate::shared::{
    batch::{BatchInputs, plan_of},
    bellman::{bootstrapped, half_squared_error},
    checkpoint::finite,
    dataset_actor::{ActionSet, ActorSettings, DatasetActor, ScalingSource},
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::equations::network::{Network, lower, parameters};
use plan::{Descent, Expression, Plans, Processor};
use rand::RngCore;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "td3_bc";

/// Hyper-parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Weight alpha of the critics against the cloning; 0 for cloning alone.
    #[schemars(range(min = 0.0, max = 1e6), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub alpha: f64,
    /// Step size of Adam for the policy.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub actor_learning_rate: f64,
    /// Step size of Adam for both critics.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub critic_learning_rate: f64,
    /// Discount gamma.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub discount: f64,
    /// Smoothing tau of the targets.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub target_smoothing: f64,
    /// Updates of the critics per update of the policy.
    #[schemars(range(min = 1, max = 1000), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub policy_delay: u64,
    /// Standard deviation of the noise on the target policy.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub target_noise: f64,
    /// Largest absolute value of that noise.
    #[schemars(range(min = 0.0, max = 10.0), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub target_noise_limit: f64,
    /// Units of each hidden layer of policy and critics.
    #[schemars(range(min = 1, max = 4096), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub width: usize,
    /// Number of hidden layers of policy and critics.
    #[schemars(range(min = 1, max = 8), extend("x-source" = "Fujimoto and Gu 2021, table 3"))]
    pub layers: usize,
    /// Largest Euclidean norm of a gradient, or null for no limit.
    #[schemars(range(min = 0.0))]
    pub gradient_clip: Option<f64>,
    /// Source of the moments by which observations are scaled.
    #[schemars(extend("x-source" = "Fujimoto and Gu 2021, eq. 6"))]
    pub scale_by: ScalingSource,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            alpha: 2.5,
            actor_learning_rate: 3e-4,
            critic_learning_rate: 3e-4,
            discount: 0.99,
            target_smoothing: 0.005,
            policy_delay: 2,
            target_noise: 0.2,
            target_noise_limit: 0.5,
            width: 256,
            layers: 2,
            gradient_clip: None,
            scale_by: ScalingSource::Dataset,
        }
    }
}

impl contract::Config for Config {}

/// TD3 with behaviour cloning for one seat.
#[derive(Debug, Clone)]
pub struct Td3Bc {
    config: Config,
    actor: DatasetActor,
    learner: Learner,
    learning: Plans,
}

/// Networks, and the equations by which they learn.
#[derive(Debug, Clone)]
struct Learner {
    actions: ActionSet,
    policy: Network,
    critics: [Network; 2],
    target_policy: Network,
    target_critics: [Network; 2],
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "actor-critic for datasets that stays close to the actions that they show (TD3+BC)";
    let traits = AgentTraits::learner([Feed::Dataset], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for one seat that observes a box and acts on a simplex or within -1 and 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(Td3Bc::new(config, interface, rng)?))
}

/// Metrics that [`Td3Bc::learn`] records.
#[must_use]
fn metrics() -> Vec<Metric> {
    vec![
        Metric::new("critic_loss", "", "half the squared error of both critics").lower_is_better(),
        Metric::new(
            "policy_loss",
            "",
            "minus the weighted value of the policy's actions plus the cloning, eq. 5",
        )
        .lower_is_better(),
        Metric::new(
            "clone_error",
            "",
            "mean absolute deviation from the actions of the dataset",
        )
        .lower_is_better(),
        Metric::new(
            "mean_value",
            "",
            "mean of the first critic at the policy's actions",
        ),
    ]
}

impl Td3Bc {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let form = ActorSettings {
            width: config.width,
            layers: config.layers,
            scale_by: config.scale_by,
        };
        let mut actor = DatasetActor::new(NAME, &form, interface, rng)?;
        let (policy, n_judged) = (actor.policy.clone(), actor.n_observed() + actor.n_acted());
        let state = &mut actor.state;
        let critics =
            ["critics.first", "critics.second"].map(|name| form.network(name, [n_judged, 1], state, rng));
        let learner = Learner {
            actions: actor.actions,
            target_policy: policy.copied("target_policy", state),
            target_critics: critics
                .each_ref()
                .map(|critic| critic.copied(format!("target_{}", critic.name()), state)),
            policy,
            critics,
        };
        Ok(Self {
            config,
            actor,
            learner,
            learning: Plans::default(),
        })
    }

    /// The plan for a batch of so many rows, and the actor whose state it trains.
    fn written(&mut self, n_rows: usize) -> (&mut Processor<f32>, &mut DatasetActor) {
        let (actor, learner, config) = (&mut self.actor, &self.learner, &self.config);
        let plan = plan_of(&mut self.learning, n_rows, actor.widths(), |batch| {
            learner.update(batch, config);
        });
        (plan, actor)
    }
}

impl Learner {
    /// An update of the critics, and one of the policy and the targets.
    fn update(&self, batch: BatchInputs<'_>, config: &Config) {
        let equations = batch.observations.equations();
        equations.routine("update critics");
        let adam = |rate, first_rate| Descent::adam(rate, first_rate, config.gradient_clip);
        let critics = parameters(&self.critics, equations);
        let loss = self.critic_loss(batch, config);
        equations.output("critic_loss", loss);
        equations.descend(
            loss,
            &critics,
            &adam("critic_learning_rate", config.critic_learning_rate),
        );

        equations.routine("update policy");
        let policy = self.policy.parameters(equations);
        let (acted, q) = self.acted_and_valued(batch);
        let loss = self.policy_loss(batch, acted, q, lambda(q, config.alpha));
        equations.output("policy_loss", loss);
        equations.output("mean_value", q.mean());
        equations.output("clone_error", (acted - batch.actions).abs().mean());
        equations.descend(
            loss,
            &policy,
            &adam("actor_learning_rate", config.actor_learning_rate),
        );
        let targets = parameters(&self.target_critics, equations);
        equations.follow(&targets, &critics, config.target_smoothing);
        let target = self.target_policy.parameters(equations);
        equations.follow(&target, &policy, config.target_smoothing);
    }

    /// TD3, algorithm 1: half the squared error of both critics to the lower target.
    fn critic_loss<'e>(&self, batch: BatchInputs<'e>, config: &Config) -> Expression<'e> {
        let target = self.target(batch, config);
        let judged = self.judged(batch.observations, batch.actions);
        let [first, second] = self
            .critics
            .each_ref()
            .map(|critic| half_squared_error(critic.apply(judged), target));
        first + second
    }

    /// `y = r + gamma (1 - terminal) min(Q'_1, Q'_2)(s', a')`.
    fn target<'e>(&self, batch: BatchInputs<'e>, config: &Config) -> Expression<'e> {
        let next = self.smoothed(batch.next_observations, config);
        let value = lower(&self.target_critics, self.judged(batch.next_observations, next));
        bootstrapped(batch.rewards, batch.continues, value, config.discount)
    }

    /// Noisy actions of the target policy: in a box the noise is added to the action, on a simplex before the
    /// softmax.
    fn smoothed<'e>(&self, observations: Expression<'e>, config: &Config) -> Expression<'e> {
        let outputs = self.target_policy.apply(observations);
        let noise = clipped_noise(outputs, config.target_noise, config.target_noise_limit);
        match self.actions {
            ActionSet::Cube => (self.actions.act(outputs) + noise).clamp(-1.0, 1.0),
            ActionSet::Simplex => self.actions.act(outputs + noise),
        }
    }

    /// Actions of the policy and their values by the first critic.
    fn acted_and_valued<'e>(&self, batch: BatchInputs<'e>) -> (Expression<'e>, Expression<'e>) {
        let acted = self.actions.act(self.policy.apply(batch.observations));
        let judged = self.judged(batch.observations, acted);
        (acted, self.critics[0].apply(judged))
    }

    /// Eq. 5: the policy ascends the first critic and stays close to the dataset.
    fn policy_loss<'e>(
        &self,
        batch: BatchInputs<'e>,
        acted: Expression<'e>,
        q: Expression<'e>,
        lambda: Expression<'e>,
    ) -> Expression<'e> {
        let distance = self.actions.centred(acted) - self.actions.centred(batch.actions);
        distance.square().mean() - q.mean() * lambda
    }

    /// Input of the critics: observations and centred actions.
    fn judged<'e>(&self, observations: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
        let equations = observations.equations();
        equations.join(&[observations, self.actions.centred(actions)])
    }
}

/// Weight `alpha / mean |Q|`, through which no gradient passes.
fn lambda(q: Expression<'_>, alpha: f64) -> Expression<'_> {
    alpha / q.abs().mean().stop_gradient()
}

/// Noise for outputs of the target policy.
fn clipped_noise(outputs: Expression<'_>, sd: f64, limit: f64) -> Expression<'_> {
    let noise = outputs.equations().normal(outputs.shape());
    (noise * sd).clamp(-limit, limit)
}

impl Agent for Td3Bc {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        self.actor.act(observations)
    }

    fn observe_dataset(&mut self, transitions: &[Transition]) -> Result<(), Error> {
        self.actor.observe_dataset(transitions);
        Ok(())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let (batch, policy_delay) = (self.actor.batch(transitions), self.config.policy_delay);
        let (plan, actor) = self.written(batch.n_rows);
        batch.write(plan);
        plan.run_seeded("update critics", &mut actor.state, rng.next_u64());
        let critic_loss = finite("critic_loss", actor.n_updates, plan.number("critic_loss"))?;
        record.mean("critic_loss", critic_loss);
        actor.n_updates += 1;
        if actor.n_updates.is_multiple_of(policy_delay) {
            plan.run("update policy", &mut actor.state);
            let policy_loss = finite("policy_loss", actor.n_updates, plan.number("policy_loss"))?;
            record.mean("policy_loss", policy_loss);
            for metric in ["mean_value", "clone_error"] {
                record.mean(metric, plan.number(metric));
            }
        }
        Ok(())
    }

    fn plan(&mut self, n_rows: usize) -> Option<String> {
        Some(self.written(n_rows).0.graph().to_string())
    }

    fn updates(&self) -> Option<Updates> {
        Some(self.actor.updates())
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        self.actor.save(dir)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        self.actor.load(dir)
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        self.actor.export(dir)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        self.actor.import(dir)
    }
}
