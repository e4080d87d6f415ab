//! Independent soft actor-critic: every seat learns alone and treats the others as a part of its environment.
//!
//! Haarnoja et al. 2018, "Soft actor-critic algorithms and applications", arXiv:1812.05905 (equations are
//! its), once per seat, as independent learners were defined by Tan 1993, "Multi-agent reinforcement
//! learning: independent vs. cooperative agents".
//!
//! | paper | here | shape |
//! |---|---|---|
//! | s, s' | the columns of `observations`, `next_observations` that `sight` gives to the seat | `[batch, seen]` |
//! | a | the seat's own columns of the joint `actions` | `[batch, n_i]` |
//! | a = f(eps; s) | `tanh(mean + sd noise)` | `[batch, n_i]` |
//! | log pi | `log_density` on the cube | `[batch, 1]` |
//! | Q_1, Q_2 | `critics` of the seat | `[batch, 1]` each |
//! | Q target | `target_critics` | `[batch, 1]` each |
//! | alpha | temperature, kept as `log_temperature` | scalar per seat |
//! | gamma, tau | `discount`, `target_smoothing` | scalars |
//!
//! Departures
//! - The temperature is exp of a number that descends `-(log pi + target)`, the form of the authors' code.
//! - A discount of 0.95 and tau of 0.01 by default, as for the other agents that play several seats; `preset:
//!   haarnoja` has the paper's. `preset: thesis` and `preset: released_code` take sizes and rates of the
//!   thesis's own algorithm: it does not compare with this one. There is no batch normalisation of inputs,
//!   which its code has in every network.
//! - No uniform first actions: the untrained policies act until learning starts.
//!
//! Metrics, means over updates and seats since the last measurement: `critic_loss` half the squared error
//! summed over both critics, `policy_loss` eq. 9, `policy_entropy` `-mean(log pi)`, `temperature` alpha,
//! `mean_value` mean of the lower critic at the policy's actions.

mod config;
#[cfg(test)]
mod tests;

pub use config::{Config, Temperature};

use crate::shared::{
    checkpoint::{self, finite},
    joint::{JointLayout, columns},
    replay::{Batch, Replay},
    schedule::UpdateSchedule,
    targets::{bootstrapped, half_squared_error, mean},
};
use burn::{module::Module, tensor::Tensor};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    network::{Mlp, TwinMlp, values},
    optimizer::{Adam, ScalarAdam, TrainedNetwork},
    parameters::{restore, soft_update, store},
    policy_file::{Head, Policy, Ports},
    squashed::{mean_action, sample_exact},
    tensor_file::TensorFile,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "independent_sac";
/// Gain of the policies' last layer: first means are close to zero and first deviations close to 1.
const POLICY_OUTPUT_GAIN: f64 = 0.1;

/// Soft actor-critic in every seat.
#[derive(Debug, Clone)]
pub struct IndependentSac {
    config: Config,
    layout: JointLayout,
    learners: Vec<Learner>,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Networks and temperature of one seat.
#[derive(Debug, Clone)]
struct Learner {
    policy: TrainedNetwork<Mlp>,
    critics: TrainedNetwork<TwinMlp>,
    target_critics: TwinMlp,
    temperature: TemperatureState,
    target_entropy: f64,
}

/// A temperature and its optimiser.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct TemperatureState {
    log_temperature: f64,
    adam: ScalarAdam,
}

/// Columns of a batch from which one seat learns.
struct SeatBatch {
    seen: Tensor<2>,
    actions: Tensor<2>,
    rewards: Tensor<2>,
    next_seen: Tensor<2>,
    continues: Tensor<2>,
}

/// State of a checkpoint besides its tensors.
#[derive(Serialize, Deserialize)]
struct Counters {
    temperatures: Vec<TemperatureState>,
    schedule: UpdateSchedule,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "soft actor-critic in every seat, each for itself";
    let traits = AgentTraits::learner([Feed::Decisions], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for seats that observe boxes and act in boxes with limits -1 and 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat, [`Error::Config`] for settings that contradict each other.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(IndependentSac::new(config, interface, rng)?))
}

/// Metrics that [`IndependentSac::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![
        Metric::new(
            "critic_loss",
            "",
            "half the squared error of both critics, mean over seats",
        )
        .lower_is_better(),
        Metric::new(
            "policy_loss",
            "",
            "temperature times log pi less the lower critic, mean over seats",
        )
        .lower_is_better(),
        Metric::new(
            "policy_entropy",
            "nat",
            "minus the mean log density of a seat's sampled actions",
        ),
        Metric::new("temperature", "", "weight of the entropy, mean over seats").lower_is_better(),
        Metric::new(
            "mean_value",
            "",
            "mean of the lower critic at the policies' actions",
        ),
    ]
}

impl IndependentSac {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        config.check()?;
        let layout = JointLayout::new(NAME, interface)?;
        let learners = (0..layout.n_seats())
            .map(|seat| Learner::new(&config, &layout, seat, rng))
            .collect();
        Ok(Self {
            learners,
            replay: Replay::of_seats(config.replay_capacity, &layout),
            schedule: UpdateSchedule::new(),
            config,
            layout,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let step = self.schedule.n_steps();
        for seat in 0..self.layout.n_seats() {
            let drawn = self
                .replay
                .sample_distinct(self.config.batch_size.min(self.replay.len()), rng);
            let batch = self.seat_batch(seat, drawn);
            let learner = &mut self.learners[seat];
            learner.update_critics(&batch, self.config.discount, step, rng, record)?;
            let log_pi = learner.update_policy(&batch, step, rng, record)?;
            if self.config.temperature == Temperature::Automatic {
                learner.update_temperature(log_pi);
            }
            learner.follow(self.config.target_smoothing);
        }
        self.schedule.count_update();
        Ok(())
    }

    fn seat_batch(&self, seat: usize, batch: Batch) -> SeatBatch {
        SeatBatch {
            seen: self.seen(seat, &batch.observations),
            actions: columns(&batch.actions, self.layout.acted(seat)),
            rewards: self
                .replay
                .rewards_of(&batch, seat, self.config.reward_normalisation),
            next_seen: self.seen(seat, &batch.next_observations),
            continues: batch.continues,
        }
    }

    fn seen(&self, seat: usize, observations: &Tensor<2>) -> Tensor<2> {
        columns(observations, self.config.sight.columns(&self.layout, seat))
    }

    fn own_action(&self, seat: usize, observations: &Tensor<2>, mode: Mode, rng: &mut Rng) -> Tensor<2> {
        let (seen, policy) = (
            self.seen(seat, observations),
            self.learners[seat].policy.network().valid(),
        );
        match mode {
            Mode::Train => sample_exact(policy.forward(seen), rng).action,
            Mode::Evaluate => mean_action(policy.forward(seen)),
        }
    }
}

impl Learner {
    fn new(config: &Config, layout: &JointLayout, seat: usize, rng: &mut Rng) -> Self {
        let (n_seen, n_done) = (config.sight.columns(layout, seat).len(), layout.acted(seat).len());
        let hidden = config.hidden();
        let policy = hidden.network(n_seen, 2 * n_done, POLICY_OUTPUT_GAIN, rng);
        let mut critic = || hidden.network(n_seen + n_done, 1, 1.0, rng);
        let critics = TwinMlp {
            first: critic(),
            second: critic(),
        };
        let adam = ScalarAdam::new(config.temperature_learning_rate);
        Self {
            target_critics: critics.valid(),
            policy: TrainedNetwork::new(
                policy,
                Adam::new(config.actor_learning_rate, config.gradient_clip),
            ),
            critics: TrainedNetwork::new(
                critics,
                Adam::new(config.critic_learning_rate, config.gradient_clip),
            ),
            temperature: TemperatureState {
                log_temperature: config.first_temperature.ln(),
                adam,
            },
            target_entropy: config.target_nats(n_done),
        }
    }

    /// Eq. 5: both critics descend the soft Bellman error.
    fn update_critics(
        &mut self,
        batch: &SeatBatch,
        discount: f64,
        step: u64,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let target = self.soft_target(batch, discount, rng);
        let (q1, q2) = self
            .critics
            .network()
            .forward(joined(&batch.seen, batch.actions.clone()));
        let loss = half_squared_error(q1, target.clone()) + half_squared_error(q2, target);
        record.mean(
            "critic_loss",
            finite("critic_loss", step, values(loss.clone())[0])?,
        );
        self.critics.descend(&loss);
        Ok(())
    }

    /// Eq. 2 and 3: reward plus the discounted soft value of the next observation, without gradients.
    fn soft_target(&self, batch: &SeatBatch, discount: f64, rng: &mut Rng) -> Tensor<2> {
        let next = sample_exact(
            self.policy.network().valid().forward(batch.next_seen.clone()),
            rng,
        );
        let (q1, q2) = self.target_critics.forward(joined(&batch.next_seen, next.action));
        let soft_value = q1.min_pair(q2) - next.log_density * self.temperature();
        bootstrapped(
            batch.rewards.clone(),
            batch.continues.clone(),
            soft_value,
            discount,
        )
    }

    /// Eq. 9: the policy descends `alpha log pi - Q`; returns the mean of `log pi`.
    fn update_policy(
        &mut self,
        batch: &SeatBatch,
        step: u64,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<f64, Error> {
        let (loss, log_pi, value) = self.policy_loss(self.policy.network(), batch, rng);
        record.mean(
            "policy_loss",
            finite("policy_loss", step, values(loss.clone())[0])?,
        );
        self.policy.descend(&loss);
        record.mean("policy_entropy", -f64::from(log_pi));
        record.mean("mean_value", f64::from(value));
        record.mean("temperature", self.temperature());
        Ok(f64::from(log_pi))
    }

    /// Loss of eq. 9, and the means of `log pi` and of the lower critic.
    fn policy_loss(&self, policy: &Mlp, batch: &SeatBatch, rng: &mut Rng) -> (Tensor<1>, f32, f32) {
        let drawn = sample_exact(policy.forward(batch.seen.clone()), rng);
        // Untracked critics: the gradient passes through them to the action alone.
        let (q1, q2) = self
            .critics
            .network()
            .valid()
            .forward(joined(&batch.seen, drawn.action));
        let q = q1.min_pair(q2);
        let loss = (drawn.log_density.clone() * self.temperature() - q.clone()).mean();
        (loss, mean(drawn.log_density), mean(q))
    }

    /// Eq. 18, for the logarithm of the temperature: it rises where the entropy is below its target.
    fn update_temperature(&mut self, mean_log_pi: f64) {
        let TemperatureState {
            log_temperature,
            adam,
        } = &mut self.temperature;
        *log_temperature = adam.step(*log_temperature, -(mean_log_pi + self.target_entropy));
    }

    fn temperature(&self) -> f64 {
        self.temperature.log_temperature.exp()
    }

    fn follow(&mut self, tau: f64) {
        self.target_critics = soft_update(
            std::mem::take(&mut self.target_critics),
            self.critics.network(),
            tau,
        );
    }
}

fn joined(seen: &Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
    Tensor::cat(vec![seen.clone(), actions], 1)
}

impl IndependentSac {
    /// Inputs and outputs of a seat's policy as its file describes them.
    fn ports(&self, seat: usize) -> Ports {
        self.layout.ports(
            self.config.sight.columns(&self.layout, seat),
            self.layout.acted(seat),
        )
    }
}

impl Agent for IndependentSac {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let joint = self.layout.observations(observations);
        let own = (0..self.layout.n_seats())
            .map(|seat| self.own_action(seat, &joint, mode, rng))
            .collect();
        self.layout
            .actions(&values(Tensor::cat(own, 1)), self.schedule.n_steps())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        transitions
            .iter()
            .for_each(|transition| self.replay.push(transition));
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

    fn updates(&self) -> Option<Updates> {
        Some(
            self.schedule
                .updates(self.config.learning_starts, self.config.updates_per_step),
        )
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        for (seat, learner) in self.learners.iter().enumerate() {
            learner.policy.store(&format!("policy_{seat}"), &mut file);
            learner.critics.store(&format!("critics_{seat}"), &mut file);
            store(
                &learner.target_critics,
                &format!("target_critics_{seat}"),
                &mut file,
            );
        }
        self.replay.store(&mut file);
        let temperatures = self.learners.iter().map(|learner| learner.temperature).collect();
        checkpoint::write(
            NAME,
            dir,
            file,
            &Counters {
                temperatures,
                schedule: self.schedule,
            },
        )
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let (file, counters): (_, Counters) = checkpoint::read(NAME, dir)?;
        let misfit = checkpoint::error_of(NAME);
        for (seat, learner) in self.learners.iter_mut().enumerate() {
            learner
                .policy
                .restore(&format!("policy_{seat}"), &file)
                .map_err(&misfit)?;
            learner
                .critics
                .restore(&format!("critics_{seat}"), &file)
                .map_err(&misfit)?;
            let target = restore(
                learner.target_critics.clone(),
                &format!("target_critics_{seat}"),
                &file,
            );
            learner.target_critics = target.map_err(&misfit)?;
        }
        self.replay.restore(&file).map_err(&misfit)?;
        for (learner, temperature) in self.learners.iter_mut().zip(counters.temperatures) {
            learner.temperature = temperature;
        }
        self.schedule = counters.schedule;
        Ok(())
    }

    /// Writes one file per seat, in a folder with the seat's name.
    fn export(&self, dir: &Path) -> Result<bool, Error> {
        for (seat, learner) in self.learners.iter().enumerate() {
            let policy = Policy::new(learner.policy.network(), self.ports(seat), Head::Tanh);
            policy
                .write(&self.layout.folder(dir, seat)?)
                .map_err(checkpoint::error_of(NAME))?;
        }
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        for seat in 0..self.learners.len() {
            let (ports, folder) = (self.ports(seat), self.layout.place(dir, seat));
            checkpoint::import_policy(NAME, &mut self.learners[seat].policy, &folder, &ports, Head::Tanh)?;
        }
        Ok(true)
    }
}
