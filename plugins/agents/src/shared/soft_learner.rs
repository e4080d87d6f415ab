//! The equations of soft actor-critic with a Gaussian policy, for actions in a box or on a simplex.
//!
//! Haarnoja et al. 2018, "Soft actor-critic algorithms and applications", arXiv:1812.05905 (equations are
//! its).
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s, s' | `observations`, `next_observations` of a batch | `[batch, seen]` |
//! | a = f(eps; s) | action of a draw | `[batch, done]` |
//! | log pi | `log_density` of a draw | `[batch, 1]` |
//! | Q_1, Q_2 | `critics` | `[batch, 1]` each |
//! | Q target | `target_critics` | `[batch, 1]` each |
//! | alpha | `temperature` | scalar |
//! | H | `target_entropy` | scalar |
//! | gamma, tau | `discount`, `target_smoothing` | scalars |

use super::batch::BatchInputs;
use super::bellman::{Weight, bootstrapped, half_squared_error};
use super::checkpoint::finite;
use super::seat_network::HiddenLayers;
use contract::{Error, Recorder};
use numerics::equations::{
    gaussian_softmax,
    network::{Network, lower, parameters},
    squashed::{self, Correction, Draw},
};
use plan::{Descent, Expression, Processor, State};

/// Set of actions, by which the head of the policy becomes an action.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActionSet {
    /// A box with limits -1 and 1: the candidate goes through tanh, and the density is that of the action.
    Box,
    /// A simplex: the candidate goes through softmax, and the density is that of the candidate.
    Simplex,
}

/// Sizes of the networks.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Number of entries of an observation.
    pub seen: usize,
    /// Number of entries of an action.
    pub done: usize,
    /// Hidden layers of the policy.
    pub policy: HiddenLayers,
    /// Gain of the policy's last layer.
    pub output_gain: f64,
    /// Hidden layers of each critic.
    pub critics: HiddenLayers,
}

/// Constants of an update.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Step size of Adam for the policy.
    pub actor_learning_rate: f64,
    /// Step size of Adam for the critics.
    pub critic_learning_rate: f64,
    /// Step size of Adam for the logarithm of the temperature, or none for a fixed temperature.
    pub temperature_learning_rate: Option<f64>,
    /// Largest Euclidean norm of a gradient, or none for no limit.
    pub gradient_clip: Option<f64>,
    /// Entropy in nats that the temperature steers to.
    pub target_entropy: f64,
    /// Discount gamma.
    pub discount: f64,
    /// Smoothing tau of the target critics.
    pub target_smoothing: f64,
}

/// Networks and temperature, and the equations by which they act and learn.
#[derive(Debug, Clone)]
pub struct SoftLearner {
    /// The policy; its outputs are means and logarithms of deviations.
    pub policy: Network,
    /// Critics of observation and action.
    pub critics: [Network; 2],
    /// Critics that follow slowly.
    pub target_critics: [Network; 2],
    /// Weight of the entropy.
    pub temperature: Weight,
    actions: ActionSet,
    settings: Settings,
}

impl ActionSet {
    /// Draws one action per row of `head`.
    #[must_use]
    pub fn draw(self, head: Expression<'_>) -> Draw<'_> {
        match self {
            ActionSet::Box => squashed::sample(head, Correction::Exact),
            ActionSet::Simplex => gaussian_softmax::sample(head),
        }
    }

    fn mean_action(self, head: Expression<'_>) -> Expression<'_> {
        match self {
            ActionSet::Box => squashed::mean_action(head),
            ActionSet::Simplex => gaussian_softmax::mean_action(head),
        }
    }
}

impl SoftLearner {
    /// Adds the parameters of a learner to a state, with names that begin with `prefix`. `initialise` adds a
    /// network with the gain of its last layer: the policy, then both critics.
    pub fn new(
        prefix: &str,
        actions: ActionSet,
        sizes: Sizes,
        first_temperature: f64,
        settings: Settings,
        state: &mut State<f32>,
        mut initialise: impl FnMut(&Network, f64, &mut State<f32>),
    ) -> Self {
        let Sizes { seen, done, .. } = sizes;
        let name = |network: &str| format!("{prefix}{network}");
        let policy = sizes.policy.network(name("policy"), seen, 2 * done);
        initialise(&policy, sizes.output_gain, state);
        let critics = ["first", "second"].map(|which| {
            let name = name(&format!("critics.{which}"));
            let critic = sizes.critics.network(name, seen + done, 1);
            initialise(&critic, 1.0, state);
            critic
        });
        let target_critics = ["first", "second"].map(|which| name(&format!("target_critics.{which}")));
        let [first, second] = &critics;
        let [first_name, second_name] = target_critics;
        Self {
            target_critics: [first.copied(first_name, state), second.copied(second_name, state)],
            policy,
            critics,
            temperature: Weight::new(&name("temperature"), first_temperature, state),
            actions,
            settings,
        }
    }

    /// Entropy in nats that the temperature steers to.
    #[cfg(test)]
    pub fn target_entropy(&self) -> f64 {
        self.settings.target_entropy
    }

    /// Draws of the policy.
    #[must_use]
    pub fn draw<'e>(&self, observations: Expression<'e>) -> Draw<'e> {
        self.actions.draw(self.policy.apply(observations))
    }

    /// Drawn actions of the policy, `[rows, done]`.
    #[must_use]
    pub fn drawn<'e>(&self, observations: Expression<'e>) -> Expression<'e> {
        self.draw(observations).action
    }

    /// Actions of the policy's means, `[rows, done]`.
    #[must_use]
    pub fn chosen<'e>(&self, observations: Expression<'e>) -> Expression<'e> {
        self.actions.mean_action(self.policy.apply(observations))
    }

    /// The routines `draw` and `choose` with the outputs `drawn` and `chosen`, `[rows, done]` each.
    pub fn act(&self, observations: Expression<'_>) {
        let equations = observations.equations();
        equations.routine("draw");
        equations.output("drawn", self.drawn(observations));
        equations.routine("choose");
        equations.output("chosen", self.chosen(observations));
    }

    /// The routine `update` of critics, policy, temperature and target critics, with the outputs that [`record`] reads.
    /// `part` picks the learner's columns of a batch.
    pub fn update<'e>(&self, batch: BatchInputs<'e>, part: impl FnOnce(BatchInputs<'e>) -> BatchInputs<'e>) {
        let (equations, settings) = (batch.observations.equations(), &self.settings);
        equations.routine("update");
        let batch = part(batch);
        let adam = |rate, first_rate| Descent::adam(rate, first_rate, settings.gradient_clip);
        let loss = self.critic_loss(batch, self.soft_target(batch));
        equations.output("critic_loss", loss);
        let critics = parameters(&self.critics, equations);
        let descent = adam("critic_learning_rate", settings.critic_learning_rate);
        equations.descend(loss, &critics, &descent);

        let (loss, log_density) = self.policy_loss(batch);
        equations.output("policy_loss", loss);
        let policy = self.policy.parameters(equations);
        let descent = adam("actor_learning_rate", settings.actor_learning_rate);
        equations.descend(loss, &policy, &descent);
        equations.output("policy_entropy", -log_density);
        equations.output("temperature", self.temperature.expression(equations));
        self.steer_temperature(log_density);
        let targets = parameters(&self.target_critics, equations);
        equations.follow(&targets, &critics, settings.target_smoothing);
    }

    /// Eq. 2 and 3: reward plus the discounted soft value of the next observation.
    #[must_use]
    pub fn soft_target<'e>(&self, batch: BatchInputs<'e>) -> Expression<'e> {
        let next = self.draw(batch.next_observations);
        let value = lower(&self.target_critics, joined(batch.next_observations, next.action));
        let soft_value = value - next.log_density * self.temperature.expression(value.equations());
        bootstrapped(batch.rewards, batch.continues, soft_value, self.settings.discount)
    }

    /// Eq. 5: half the squared soft Bellman error of both critics.
    #[must_use]
    pub fn critic_loss<'e>(&self, batch: BatchInputs<'e>, target: Expression<'e>) -> Expression<'e> {
        let seen = joined(batch.observations, batch.actions);
        let [first, second] = self
            .critics
            .each_ref()
            .map(|critic| half_squared_error(critic.apply(seen), target));
        first + second
    }

    /// Eq. 9, and the mean of `log pi`.
    #[must_use]
    pub fn policy_loss<'e>(&self, batch: BatchInputs<'e>) -> (Expression<'e>, Expression<'e>) {
        let drawn = self.draw(batch.observations);
        let value = lower(&self.critics, joined(batch.observations, drawn.action));
        let equations = value.equations();
        equations.output("mean_value", value.mean());
        let loss = (drawn.log_density * self.temperature.expression(equations) - value).mean();
        (loss, drawn.log_density.mean())
    }

    /// Eq. 18, for the logarithm of the temperature: it rises where the entropy is below its target.
    pub fn steer_temperature(&self, mean_log_density: Expression<'_>) {
        if let Some(rate) = self.settings.temperature_learning_rate {
            self.temperature
                .rise_with(mean_log_density + self.settings.target_entropy, rate);
        }
    }
}

/// Observations and actions side by side, the input of critics.
#[must_use]
pub fn joined<'e>(observations: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
    observations.equations().join(&[observations, actions])
}

/// Records the outputs of an update.
///
/// # Errors
/// [`Error::NotFinite`] where a loss is not finite.
pub fn record(plan: &Processor<f32>, step: u64, record: &mut Recorder) -> Result<(), Error> {
    for metric in ["critic_loss", "policy_loss"] {
        record.mean(metric, finite(metric, step, plan.number(metric))?);
    }
    for metric in ["policy_entropy", "mean_value", "temperature"] {
        record.mean(metric, plan.number(metric));
    }
    Ok(())
}
