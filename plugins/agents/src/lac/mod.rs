//! Lyapunov actor-critic (`lac`), and its constrained form (`clac`) with smooth actions.
//!
//! M. Han, L. Zhang, J. Wang and W. Pan 2020, "Actor-critic reinforcement learning for control with
//! stability guarantee", arXiv:2004.14288, and the authors' code; thesis, section 2.3.3, for `clac`
//! (equations are its). "Released code" is that of the thesis' group for the calibration of models.
//!
//! | thesis | here | shape |
//! |---|---|---|
//! | c | cost, minus the reward; 0 at least | `[batch, 1]` |
//! | s, s' | `observations`, `next_observations` (scaled) | `[batch, observed]` |
//! | a = f(eps, s) | `tanh(mean + sd noise)`, ln sd within `log_sd_low` and `log_sd_high` | `[batch, n]` |
//! | pi*(s) | `tanh(mean)`, also the action in evaluation | `[batch, n]` |
//! | s_near | `before`, the observation one step before s | `[batch, observed]` |
//! | L(s, a) | sum of the squares of the last hidden layer of `lyapunov` | `[batch, 1]` |
//! | L target | `target_lyapunov` at a sample of `target_policy` | `[batch, 1]` |
//! | lambda | `multiplier`, at most 1 where it counts | scalar |
//! | beta, H_t | `temperature`, `target_entropy` | scalars |
//! | alpha, alpha_3 | `smoothness`, `decrease` | scalars |
//! | gamma, tau | `discount`, `target_smoothing` | scalars |
//!
//! An update, after which both targets follow by tau:
//! - L descends half the squared error to `c + gamma (1 - d) L_target(s', a')` (eq. 2.5 and 2.6) without an
//!   entropy bonus;
//! - the policy descends `lambda D + beta mean(log pi(a | s)) + alpha |pi*(s) - pi*(s_near)|` (eq. 2.7 and
//!   2.10) with the violation `D = mean(L(s', f(eps, s')) - L(s, a) + alpha_3 c)`, in which a gradient passes
//!   through the action at s' alone;
//! - `log lambda` ascends `log lambda D` (eq. 2.9), `log beta` ascends `log beta (log pi + H_t)` (eq. 2.8).
//!
//! Departures
//! - Eq. 2.6 prints a maximum over actions; a sample is taken, as all public code does.
//! - Eq. 2.8 and 2.9 print beta and lambda themselves as factors; public code has their logarithms.
//! - The parts of an update follow each other. Public code evaluates them at once, and moves the targets
//!   first.
//! - Leaky rectifiers have the slope 0.01 below zero (Maas et al. 2013, whom the thesis names), in the
//!   released code 0.2. Mean and ln sd are one last layer of the policy, there they are two.
//! - Learning rates decline from update to update, in the released code from episode to episode; it keeps
//!   transitions of whole episodes, and for CLAC none of the first two steps of one, here not the first.
//!
//! Metrics, means over the updates since the last measurement: `lyapunov_loss`, `policy_loss`,
//! `policy_entropy` `-mean(log pi)`, `temperature` beta, `multiplier` lambda as it counts, `violation` D,
//! `mean_lyapunov` mean of L(s, a), and where `smoothness` is above 0 `action_change`, the norm that it
//! weighs.

mod config;
mod exploration;
mod memory;
mod networks;
#[cfg(test)]
mod tests;

pub use config::{ClacConfig, Config, SmoothnessNorm};

use crate::shared::{
    box_seat::BoxSeat,
    checkpoint::{self, finite},
    multiplier::Multiplier,
    schedule::UpdateSchedule,
    seat::mismatch,
    targets::{bootstrapped, half_squared_error, mean},
};
use burn::{module::Module, tensor::Tensor};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use exploration::Disturbance;
use memory::{Memory, MemoryBatch, MemoryOptions, PreviousObservations};
use networks::{Limits, value};
use numerics::{
    network::{Mlp, matrix, values},
    optimizer::{Adam, TrainedNetwork},
    parameters::{restore, soft_update, store},
    policy_file::{Head, Policy},
    squashed::{mean_action, sample_exact},
    tensor_file::TensorFile,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

const LAC: &str = "lac";
const CLAC: &str = "clac";
/// Agent of both algorithms.
#[derive(Debug, Clone)]
pub struct LyapunovActorCritic {
    name: &'static str,
    config: Config,
    seat: BoxSeat,
    disturbance: Disturbance,
    target_entropy: f64,
    policy: TrainedNetwork<Mlp>,
    lyapunov: TrainedNetwork<Mlp>,
    target_policy: Mlp,
    target_lyapunov: Mlp,
    multiplier: Multiplier,
    temperature: Multiplier,
    memory: Memory,
    schedule: UpdateSchedule,
}

/// State of a checkpoint besides its tensors.
#[derive(Serialize, Deserialize)]
struct Counters {
    multiplier: Multiplier,
    temperature: Multiplier,
    before: PreviousObservations,
    schedule: UpdateSchedule,
}

/// Loss of the policy with the means of its parts.
struct PolicyLoss {
    loss: Tensor<1>,
    violation: f64,
    log_pi: f64,
    action_change: Option<f64>,
}

/// Registers Lyapunov actor-critic.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about =
        "actor-critic that lets a Lyapunov function of the cost fall; learns from costs of 0 at least";
    registry.agent(LAC, version, about, traits(), |config, interface, rng| {
        build(LAC, config, interface, rng)
    });
}

/// Registers the constrained form.
pub(crate) fn register_constrained(registry: &mut Registry, version: u32) {
    let about = "Lyapunov actor-critic that is kept from moving its action between neighbouring states";
    registry.agent(
        CLAC,
        version,
        about,
        traits(),
        |ClacConfig(config), interface, rng| build(CLAC, config, interface, rng),
    );
}

/// Traits of both algorithms. They take no datasets, whose transitions lack the observation before.
fn traits() -> AgentTraits {
    AgentTraits::learner([Feed::Decisions], metrics())
}

/// Builds the agent for one seat that observes a box and acts in a box with limits -1 and 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat; [`Error::Config`] for settings that contradict each other or name
/// unknown channels.
fn build(
    name: &'static str,
    config: Config,
    interface: &Interface,
    rng: &mut Rng,
) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(LyapunovActorCritic::new(name, config, interface, rng)?))
}

/// Metrics that [`LyapunovActorCritic::learn`] records.
fn metrics() -> Vec<Metric> {
    let of = Metric::new;
    vec![
        of(
            "lyapunov_loss",
            "",
            "half the squared error of the Lyapunov critic",
        )
        .lower_is_better(),
        of("policy_loss", "", "violation, log pi and action change, weighed").lower_is_better(),
        of(
            "policy_entropy",
            "nat",
            "minus the mean log density of sampled actions",
        ),
        of("temperature", "", "weight of the entropy").lower_is_better(),
        of("multiplier", "", "weight of the violation, at most 1").lower_is_better(),
        of("violation", "", "by how much the Lyapunov value falls too little").lower_is_better(),
        of("mean_lyapunov", "", "mean Lyapunov value of what was done").lower_is_better(),
        of(
            "action_change",
            "",
            "norm of the scored action's moves to neighbouring states; where `smoothness` is above 0",
        )
        .lower_is_better(),
    ]
}

impl LyapunovActorCritic {
    #[allow(clippy::cast_precision_loss, reason = "a number of entries is far below 2^52")]
    fn new(name: &'static str, config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let seat = BoxSeat::new(name, config.observation_scaling, interface)?;
        config.check()?;
        let (n_seen, n_done) = (seat.n_observed(), seat.n_acted());
        let policy = networks::policy(&config, n_seen, n_done, rng);
        let lyapunov = networks::lyapunov(&config, n_seen, n_done, rng);
        let adam = |rate| Adam::new(rate, config.gradient_clip);
        let options = MemoryOptions {
            before: config.smoothness > 0.0,
            bootstrap_at_time_limit: config.bootstrap_at_time_limit,
        };
        Ok(Self {
            name,
            disturbance: Disturbance::new(&config, &seat)?,
            target_entropy: config.target_entropy.unwrap_or(-(n_done as f64)),
            target_policy: policy.valid(),
            target_lyapunov: lyapunov.valid(),
            policy: TrainedNetwork::new(policy, adam(config.actor_learning_rate)),
            lyapunov: TrainedNetwork::new(lyapunov, adam(config.lyapunov_learning_rate)),
            multiplier: Multiplier::new(config.first_multiplier, config.multiplier_learning_rate),
            temperature: Multiplier::new(config.first_temperature, config.temperature_learning_rate),
            memory: Memory::new(config.replay_capacity, n_seen, n_done, options),
            schedule: UpdateSchedule::new(),
            config,
            seat,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        self.decline();
        let batch = self.memory.sample(self.config.batch_size, rng);
        self.update_lyapunov(&batch, rng, record)?;
        let PolicyLoss {
            violation, log_pi, ..
        } = self.update_policy(&batch, rng, record)?;
        // Eq. 2.9 and 2.8: the weights rise where the value falls too little and where the entropy is too
        // low.
        self.multiplier.rise_with(violation);
        self.temperature.rise_with(log_pi + self.target_entropy);
        self.follow();
        self.schedule.count_update();
        Ok(())
    }

    /// Sets the learning rates of the present step.
    fn decline(&mut self) {
        let left = self.config.rate_left(self.schedule.n_steps());
        self.policy
            .set_learning_rate(left * self.config.actor_learning_rate);
        self.lyapunov
            .set_learning_rate(left * self.config.lyapunov_learning_rate);
        self.multiplier
            .set_learning_rate(left * self.config.multiplier_learning_rate);
        self.temperature
            .set_learning_rate(left * self.config.temperature_learning_rate);
    }

    /// Eq. 2.5: the Lyapunov critic descends half the squared error to its target.
    fn update_lyapunov(
        &mut self,
        batch: &MemoryBatch,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let target = self.target(batch, rng);
        let found = value(
            self.lyapunov.network(),
            &batch.observations,
            batch.actions.clone(),
        );
        record.mean("mean_lyapunov", f64::from(mean(found.clone())));
        let loss = half_squared_error(found, target);
        record.mean(
            "lyapunov_loss",
            finite("lyapunov_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        self.lyapunov.descend(&loss);
        Ok(())
    }

    /// Eq. 2.6: `c + gamma (1 - d) L_target(s', a')` with a sample of the target policy, without gradients.
    fn target(&self, batch: &MemoryBatch, rng: &mut Rng) -> Tensor<2> {
        let next = self
            .limits()
            .draw(&self.target_policy, &batch.next_observations, rng);
        bootstrapped(
            batch.costs.clone(),
            batch.continues.clone(),
            value(&self.target_lyapunov, &batch.next_observations, next.action),
            self.config.discount,
        )
    }

    fn update_policy(
        &mut self,
        batch: &MemoryBatch,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<PolicyLoss, Error> {
        let found = self.policy_loss(self.policy.network(), batch, rng);
        record.mean(
            "policy_loss",
            finite(
                "policy_loss",
                self.schedule.n_steps(),
                values(found.loss.clone())[0],
            )?,
        );
        self.policy.descend(&found.loss);
        record.mean("policy_entropy", -found.log_pi);
        record.mean("violation", found.violation);
        record.mean("multiplier", self.weight());
        record.mean("temperature", self.temperature.value());
        if let Some(change) = found.action_change {
            record.mean("action_change", change);
        }
        Ok(found)
    }

    /// Eq. 2.7, and eq. 2.10 where the observation before is stored.
    fn policy_loss(&self, policy: &Mlp, batch: &MemoryBatch, rng: &mut Rng) -> PolicyLoss {
        let violation = self.violation(policy, batch, rng);
        let head = self.limits().head(policy, &batch.observations);
        let log_pi = sample_exact(head.clone(), rng).log_density.mean();
        let mut loss = violation.clone() * self.weight() + log_pi.clone() * self.temperature.value();
        let action_change = batch.before.as_ref().map(|before| {
            let moves = mean_action(head) - mean_action(self.limits().head(policy, before));
            self.config.smoothness_norm.of(moves)
        });
        if let Some(change) = &action_change {
            loss = loss + change.clone() * self.config.smoothness;
        }
        let number = |x: Tensor<1>| f64::from(values(x)[0]);
        PolicyLoss {
            loss,
            violation: number(violation),
            log_pi: number(log_pi),
            action_change: action_change.map(number),
        }
    }

    /// `mean(L(s', f(eps, s')) - L(s, a) + alpha_3 c)`: above 0 where the Lyapunov value falls too little.
    fn violation(&self, policy: &Mlp, batch: &MemoryBatch, rng: &mut Rng) -> Tensor<1> {
        // An untracked critic: the gradient passes through it to the action alone.
        let lyapunov = self.lyapunov.network().valid();
        let next = self.limits().draw(policy, &batch.next_observations, rng).action;
        let rise = value(&lyapunov, &batch.next_observations, next)
            - value(&lyapunov, &batch.observations, batch.actions.clone());
        (rise + batch.costs.clone() * self.config.decrease).mean()
    }

    fn limits(&self) -> Limits {
        Limits {
            low: self.config.log_sd_low,
            high: self.config.log_sd_high,
        }
    }

    /// Multiplier as it enters the loss, at most 1.
    fn weight(&self) -> f64 {
        self.multiplier.value().min(1.0)
    }

    /// Refuses negative costs: their discounted sum is no Lyapunov function.
    fn check_costs(&self, transitions: &[Transition]) -> Result<(), Error> {
        let Some(gain) = transitions.iter().find(|it| it.rewards[0] > 0.0) else {
            return Ok(());
        };
        let (step, reward) = (self.schedule.n_steps(), gain.rewards[0]);
        let problem = format!(
            "a Lyapunov critic needs costs of at least 0, which are minus the rewards; after step {step} the \
             reward is {reward}: use an environment whose rewards are 0 at most"
        );
        Err(mismatch(self.name, problem))
    }

    fn follow(&mut self) {
        let tau = self.config.target_smoothing;
        self.target_lyapunov = soft_update(
            std::mem::take(&mut self.target_lyapunov),
            self.lyapunov.network(),
            tau,
        );
        self.target_policy = soft_update(
            std::mem::take(&mut self.target_policy),
            self.policy.network(),
            tau,
        );
    }
}

impl Agent for LyapunovActorCritic {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let mut seen = self.seat.scaled(observations);
        if mode == Mode::Train {
            self.disturbance.add_to(&mut seen, rng);
        }
        let seen = matrix(seen, self.seat.n_observed());
        let head = self.limits().head(&self.policy.network().valid(), &seen);
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
        self.check_costs(transitions)?;
        self.memory.push(transitions, &self.seat.scaling);
        let Config {
            learning_starts,
            updates_per_step,
            ..
        } = self.config;
        let due = self
            .schedule
            .advance(transitions.len(), learning_starts, updates_per_step);
        if self.memory.is_empty() {
            // The buffer is empty after episodes of one step.
            return Ok(());
        }
        (0..due).try_for_each(|_| self.update(rng, record))
    }

    fn updates(&self) -> Option<Updates> {
        Some(
            self.schedule
                .updates(self.config.learning_starts, self.config.updates_per_step),
        )
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        self.policy.store("policy", &mut file);
        self.lyapunov.store("lyapunov", &mut file);
        store(&self.target_policy, "target_policy", &mut file);
        store(&self.target_lyapunov, "target_lyapunov", &mut file);
        self.memory.store(&mut file);
        let counters = Counters {
            multiplier: self.multiplier,
            temperature: self.temperature,
            before: self.memory.before().clone(),
            schedule: self.schedule,
        };
        checkpoint::write(self.name, dir, file, &counters)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, counters): (_, Counters) = checkpoint::read(self.name, dir)?;
        let misfit = checkpoint::error_of(self.name);
        self.policy.restore("policy", &file).map_err(&misfit)?;
        self.lyapunov.restore("lyapunov", &file).map_err(&misfit)?;
        self.target_policy = restore(self.target_policy.clone(), "target_policy", &file).map_err(&misfit)?;
        self.target_lyapunov =
            restore(self.target_lyapunov.clone(), "target_lyapunov", &file).map_err(&misfit)?;
        self.memory.restore(&file, counters.before).map_err(&misfit)?;
        (self.multiplier, self.temperature, self.schedule) =
            (counters.multiplier, counters.temperature, counters.schedule);
        Ok(())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let policy = Policy::new(self.policy.network(), self.seat.ports(), Head::Tanh);
        policy.write(dir).map_err(checkpoint::error_of(self.name))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        checkpoint::import_policy(self.name, &mut self.policy, dir, &self.seat.ports(), Head::Tanh)?;
        Ok(true)
    }
}
