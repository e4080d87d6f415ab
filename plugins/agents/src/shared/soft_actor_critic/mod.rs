//! Soft actor-critic: actions in a box from a squashed Gaussian policy that is paid for its entropy.
//!
//! Haarnoja et al. 2018, "Soft actor-critic algorithms and applications", arXiv:1812.05905 (equations are
//! its).
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s, s' | `observations`, `next_observations` (scaled) | `[batch, observed]` |
//! | a = f(eps; s) | `tanh(mean + sd noise)` | `[batch, n]` |
//! | log pi | `log_density` on the cube | `[batch, 1]` |
//! | Q_1, Q_2 | `critics` | `[batch, 1]` each |
//! | Q target | `target_critics` | `[batch, 1]` each |
//! | alpha | `temperature` | scalar |
//! | H | `target_entropy`, minus the number of entries of an action | scalar |
//! | gamma, tau | `discount`, `target_smoothing` | scalars |
//!
//! In evaluation the policy acts by `tanh(mean)`.
//!
//! Departures from the paper
//! - The temperature is exp of a number that descends `-(log pi + target)`, the form of the authors' code.
//! - No uniform first actions: the untrained policy acts until learning starts.
//! - Observations are scaled by the typical values of their channels; `observation_scaling: none` leaves them
//!   as they are.
//! - Weights are initialised after He et al. 2015, and the policy's last layer a tenth as large, so that
//!   first means are close to zero and first deviations close to 1.
//!
//! Metrics, means over the updates since the last measurement: `critic_loss` half the squared error summed
//! over both critics, `policy_loss` eq. 9, `policy_entropy` `-mean(log pi)`, `temperature` alpha,
//! `mean_value` mean of the lower critic at the policy's actions.

mod config;
#[cfg(test)]
mod tests;

pub use config::{Config, Temperature};

use crate::shared::{
    box_seat::BoxSeat,
    checkpoint::{self, finite},
    multiplier::Multiplier,
    replay::{Batch, Replay},
    schedule::UpdateSchedule,
    targets::{bootstrapped, half_squared_error, mean},
};
use burn::{module::Module, tensor::Tensor};
use contract::{
    Action, Agent, Error, Interface, Metric, Mode, Observation, Recorder, Rng, Transition, Updates,
};
use numerics::{
    network::{Mlp, TwinMlp, matrix, values},
    optimizer::{Adam, TrainedNetwork},
    parameters::{restore, soft_update, store},
    policy_file::{Head, Policy},
    squashed::{mean_action, sample_exact},
    tensor_file::TensorFile,
};
use std::path::Path;

const NAME: &str = "soft_actor_critic";
/// Gain of the policy's last layer.
const POLICY_OUTPUT_GAIN: f64 = 0.1;

/// Soft actor-critic for one seat.
#[derive(Debug, Clone)]
pub struct SoftActorCritic {
    config: Config,
    seat: BoxSeat,
    target_entropy: f64,
    policy: TrainedNetwork<Mlp>,
    critics: TrainedNetwork<TwinMlp>,
    target_critics: TwinMlp,
    temperature: Multiplier,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Metrics that [`SoftActorCritic::learn`] records.
pub(crate) fn metrics() -> Vec<Metric> {
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
            "minus the mean log density of sampled actions",
        ),
        Metric::new("temperature", "", "weight of the entropy").lower_is_better(),
        Metric::new(
            "mean_value",
            "",
            "mean of the lower critic at the policy's actions",
        ),
    ]
}

impl SoftActorCritic {
    /// Builds the agent for one seat that observes a box and acts in a box with limits -1 and 1.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for any other seat, [`Error::Config`] for settings that contradict each other.
    pub(crate) fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = BoxSeat::new(NAME, config.observation_scaling, interface)?;
        config.check()?;
        let (n_seen, n_done, hidden) = (seat.n_observed(), seat.n_acted(), config.hidden());
        let policy = hidden.network(n_seen, 2 * n_done, POLICY_OUTPUT_GAIN, rng);
        let mut critic = || hidden.network(n_seen + n_done, 1, 1.0, rng);
        let critics = TwinMlp {
            first: critic(),
            second: critic(),
        };
        Ok(Self::assemble(config, seat, policy, critics))
    }

    /// Builds the agent around given networks: a policy `[observed]` to `[2 n]`, critics `[observed + n]` to
    /// `[1]`.
    #[allow(clippy::cast_precision_loss, reason = "a number of entries is far below 2^52")]
    pub(crate) fn assemble(config: Config, seat: BoxSeat, policy: Mlp, critics: TwinMlp) -> Self {
        let (n_seen, n_done) = (seat.n_observed(), seat.n_acted());
        let adam = |rate| Adam::new(rate, config.gradient_clip);
        Self {
            target_entropy: config.target_entropy.unwrap_or(-(n_done as f64)),
            target_critics: critics.valid(),
            policy: TrainedNetwork::new(policy, adam(config.actor_learning_rate)),
            critics: TrainedNetwork::new(critics, adam(config.critic_learning_rate)),
            temperature: Multiplier::new(config.first_temperature, config.temperature_learning_rate),
            replay: Replay::new(config.replay_capacity, n_seen, n_done, 1),
            schedule: UpdateSchedule::new(),
            config,
            seat,
        }
    }

    /// Stores a transition in the replay buffer without an update.
    pub(crate) fn remember(&mut self, transition: &Transition) {
        self.replay.push_scaled(transition, &self.seat.scaling);
    }

    /// Number of stored transitions.
    pub(crate) fn n_remembered(&self) -> usize {
        self.replay.len()
    }

    /// Number of updates so far.
    pub(crate) fn n_updates(&self) -> u64 {
        self.schedule.n_updates()
    }

    /// Updates once with a batch drawn from the replay buffer.
    pub(crate) fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let batch = self
            .replay
            .sample_distinct(self.config.batch_size.min(self.replay.len()), rng);
        self.improve(&batch, rng, record)
    }

    /// Updates once with the whole replay buffer as the batch.
    pub(crate) fn update_with_everything(
        &mut self,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let batch = self.replay.latest(self.replay.len());
        self.improve(&batch, rng, record)
    }

    fn improve(&mut self, batch: &Batch, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        self.update_critics(batch, rng, record)?;
        let log_pi = self.update_policy(batch, rng, record)?;
        if self.config.temperature == Temperature::Automatic {
            // Eq. 18: it rises where the entropy is below its target.
            self.temperature.rise_with(log_pi + self.target_entropy);
        }
        let target = std::mem::take(&mut self.target_critics);
        self.target_critics = soft_update(target, self.critics.network(), self.config.target_smoothing);
        self.schedule.count_update();
        Ok(())
    }

    /// Eq. 5: both critics descend the soft Bellman error.
    fn update_critics(&mut self, batch: &Batch, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let target = self.soft_target(batch, rng);
        let loss = critic_loss(self.critics.network(), batch, &target);
        record.mean(
            "critic_loss",
            finite("critic_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        self.critics.descend(&loss);
        Ok(())
    }

    /// Eq. 2 and 3: reward plus the discounted soft value of the next observation, without gradients.
    fn soft_target(&self, batch: &Batch, rng: &mut Rng) -> Tensor<2> {
        let policy = self.policy.network().valid();
        let next = sample_exact(policy.forward(batch.next_observations.clone()), rng);
        let (q1, q2) = self
            .target_critics
            .forward(joined(&batch.next_observations, next.action));
        let soft_value = q1.min_pair(q2) - next.log_density * self.temperature.value();
        bootstrapped(
            batch.rewards.clone(),
            batch.continues.clone(),
            soft_value,
            self.config.discount,
        )
    }

    /// Eq. 9: the policy descends `alpha log pi - Q`; returns the mean of `log pi`.
    fn update_policy(&mut self, batch: &Batch, rng: &mut Rng, record: &mut Recorder) -> Result<f64, Error> {
        let (loss, log_pi, value) = self.policy_loss(self.policy.network(), batch, rng);
        record.mean(
            "policy_loss",
            finite("policy_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        self.policy.descend(&loss);
        record.mean("policy_entropy", -f64::from(log_pi));
        record.mean("mean_value", f64::from(value));
        record.mean("temperature", self.temperature.value());
        Ok(f64::from(log_pi))
    }

    /// Loss of eq. 9, and the means of `log pi` and of the lower critic.
    fn policy_loss(&self, policy: &Mlp, batch: &Batch, rng: &mut Rng) -> (Tensor<1>, f32, f32) {
        let drawn = sample_exact(policy.forward(batch.observations.clone()), rng);
        // Untracked critics: the gradient passes through them to the action alone.
        let critics = self.critics.network().valid();
        let (q1, q2) = critics.forward(joined(&batch.observations, drawn.action));
        let q = q1.min_pair(q2);
        let loss = (drawn.log_density.clone() * self.temperature.value() - q.clone()).mean();
        (loss, mean(drawn.log_density), mean(q))
    }
}

/// Half the squared error of both critics.
fn critic_loss(critics: &TwinMlp, batch: &Batch, target: &Tensor<2>) -> Tensor<1> {
    let (q1, q2) = critics.forward(joined(&batch.observations, batch.actions.clone()));
    half_squared_error(q1, target.clone()) + half_squared_error(q2, target.clone())
}

fn joined(observations: &Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
    Tensor::cat(vec![observations.clone(), actions], 1)
}

impl Agent for SoftActorCritic {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let seen = matrix(self.seat.scaled(observations), self.seat.n_observed());
        let head = self.policy.network().valid().forward(seen);
        let action = match mode {
            Mode::Train => sample_exact(head, rng).action,
            Mode::Evaluate => mean_action(head),
        };
        self.seat.actions(&values(action), self.schedule.n_steps())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        for transition in transitions {
            self.remember(transition);
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

    checkpoint::keeps!(NAME; trained: policy, critics; targets: target_critics; counters: temperature);

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let policy = Policy::new(self.policy.network(), self.seat.ports(), Head::Tanh);
        policy.write(dir).map_err(checkpoint::error_of(NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        checkpoint::import_policy(NAME, &mut self.policy, dir, &self.seat.ports(), Head::Tanh)?;
        Ok(true)
    }
}
