//! Multi-agent deep deterministic policy gradient: a deterministic policy and a critic of the joint action
//! for every seat.
//!
//! Lowe et al. 2017, "Multi-agent actor-critic for mixed cooperative-competitive environments",
//! arXiv:1706.02275, algorithm 1; constants of `preset: openai` from the authors' code.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | x, x' | joint `observations`, `next_observations` | `[batch, n_observed]` |
//! | o_i | the columns that `policy_sight` gives to seat i | `[batch, ..]` |
//! | a_1, ..., a_N | joint `actions` | `[batch, n_acted]` |
//! | mu_i(o_i) | `tanh(policy(o_i))` | `[batch, n_i]` |
//! | Q_i(x, a_1, ..., a_N) | `critic` of seat i | `[batch, 1]` |
//! | mu_i', Q_i' | `target_policy`, `target_critic` | as above |
//! | N_t | exploration noise, added to the actions, which are then clamped to -1 and 1 | `[n_acted]` |
//! | gamma, tau | `discount`, `target_smoothing` | scalars |
//!
//! Departures from the paper
//! - The authors' code draws discrete choices by Gumbel-softmax, noise included, and has no other noise.
//!   Actions here are numbers: tanh takes the place of the draw and Gaussian or Ornstein-Uhlenbeck noise that
//!   of its randomness; the penalty on logits stays, on the inputs of tanh.
//! - The policies of the others are known in the targets (the paper's default); they are not inferred from
//!   actions (its section 4.2), and there are no ensembles (4.3).
//! - Half of the squared error; all targets move after all seats have learned. Weights start after He et al.,
//!   the policy's last layer small. No batch normalisation of inputs, which the thesis's code has in every
//!   network.
//! - The thesis does not compare with this algorithm. `preset: thesis` takes the sizes and rates of the
//!   thesis's own, `preset: released_code` those of its code, whose working logs do hold runs of it. The
//!   noise is our choice there, and the penalty on logits stays: without it, at the rate of 0.01 of the
//!   differential game, tanh saturates within 250 steps and no gradient is left.
//!
//! Metrics, means over updates and seats since the last measurement: `critic_loss` half the squared error,
//! `policy_loss` `-mean(Q_i)` at the policy's action, without the penalty, `exploration_sd` the deviation of
//! the noise.

mod config;
mod exploration;
#[cfg(test)]
mod tests;

pub use config::Config;
pub use exploration::Noise;

use exploration::Exploration;

use crate::shared::{
    checkpoint::{self, finite},
    joint::{JointLayout, columns},
    replay::{Batch, Replay},
    schedule::UpdateSchedule,
    targets::{bootstrapped, half_squared_error},
};
use burn::{module::Module, tensor::Tensor};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    network::{Mlp, values},
    optimizer::{Adam, TrainedNetwork},
    parameters::{restore, soft_update, store},
    policy_file::{Head, Policy, Ports},
    tensor_file::TensorFile,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

const NAME: &str = "maddpg";
/// Gain of the policies' last layer: first actions are close to zero, where tanh is not flat.
const POLICY_OUTPUT_GAIN: f64 = 0.1;

/// Multi-agent deep deterministic policy gradient for all seats.
#[derive(Debug, Clone)]
pub struct Maddpg {
    config: Config,
    layout: JointLayout,
    learners: Vec<Learner>,
    replay: Replay,
    exploration: Exploration,
    schedule: UpdateSchedule,
}

/// Networks of one seat.
#[derive(Debug, Clone)]
struct Learner {
    policy: TrainedNetwork<Mlp>,
    critic: TrainedNetwork<Mlp>,
    target_policy: Mlp,
    target_critic: Mlp,
}

/// State of a checkpoint besides its tensors.
#[derive(Serialize, Deserialize)]
struct Counters {
    exploration: Exploration,
    schedule: UpdateSchedule,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "multi-agent deep deterministic policy gradient: critics of the joint action";
    let traits = AgentTraits::learner([Feed::Decisions], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for seats that observe boxes and act in boxes with limits -1 and 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat, [`Error::Config`] for settings that contradict each other.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(Maddpg::new(config, interface, rng)?))
}

/// Metrics that [`Maddpg::learn`] records.
fn metrics() -> Vec<Metric> {
    vec![
        Metric::new(
            "critic_loss",
            "",
            "half the squared error of a critic, mean over seats",
        )
        .lower_is_better(),
        Metric::new(
            "policy_loss",
            "",
            "minus the critic's value of the policy's actions, mean over seats",
        )
        .lower_is_better(),
        Metric::new(
            "exploration_sd",
            "",
            "standard deviation of the noise on the actions",
        )
        .lower_is_better(),
    ]
}

impl Maddpg {
    fn new(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        config.check()?;
        let layout = JointLayout::new(NAME, interface)?;
        let learners = (0..layout.n_seats())
            .map(|seat| Learner::new(&config, &layout, seat, rng))
            .collect();
        Ok(Self {
            learners,
            replay: Replay::of_seats(config.replay_capacity, &layout),
            exploration: Exploration::new(config.exploration_noise, layout.n_acted()),
            schedule: UpdateSchedule::new(),
            config,
            layout,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        for seat in 0..self.layout.n_seats() {
            let batch = self
                .replay
                .sample_distinct(self.config.batch_size.min(self.replay.len()), rng);
            self.update_critic(seat, &batch, record)?;
            self.update_policy(seat, &batch, record)?;
        }
        let tau = self.config.target_smoothing;
        self.learners.iter_mut().for_each(|learner| learner.follow(tau));
        record.mean(
            "exploration_sd",
            self.config.exploration_sd_at(self.schedule.n_steps()),
        );
        self.schedule.count_update();
        Ok(())
    }

    /// Eq. 6: the critic descends the squared error to its target.
    fn update_critic(&mut self, seat: usize, batch: &Batch, record: &mut Recorder) -> Result<(), Error> {
        let target = self.target(seat, batch);
        let critic = &mut self.learners[seat].critic;
        let loss = half_squared_error(
            value(critic.network(), &batch.observations, batch.actions.clone()),
            target,
        );
        record.mean(
            "critic_loss",
            finite("critic_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        critic.descend(&loss);
        Ok(())
    }

    /// Eq. 6: `y = r_i + gamma Q_i'(x', mu_1'(o_1'), ..., mu_N'(o_N'))`.
    fn target(&self, seat: usize, batch: &Batch) -> Tensor<2> {
        let next = self.joint_action(&batch.next_observations, |learner| learner.target_policy.clone());
        let next_value = value(&self.learners[seat].target_critic, &batch.next_observations, next);
        let rewards = self
            .replay
            .rewards_of(batch, seat, self.config.reward_normalisation);
        bootstrapped(rewards, batch.continues.clone(), next_value, self.config.discount)
    }

    /// Eq. 5: the policy ascends its critic through its own action; the actions of the others are those of
    /// the batch.
    fn update_policy(&mut self, seat: usize, batch: &Batch, record: &mut Recorder) -> Result<(), Error> {
        let (loss, penalty) = self.policy_loss(seat, self.learners[seat].policy.network(), batch);
        record.mean(
            "policy_loss",
            finite("policy_loss", self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        self.learners[seat].policy.descend(&(loss + penalty));
        Ok(())
    }

    /// Minus the critic's mean value, and the penalty on the inputs of tanh.
    fn policy_loss(&self, seat: usize, policy: &Mlp, batch: &Batch) -> (Tensor<1>, Tensor<1>) {
        let logits = policy.forward(self.seen(seat, &batch.observations));
        let actions = self
            .layout
            .with_action(&batch.actions, seat, logits.clone().tanh());
        // An untracked critic: the gradient passes through it to the action alone.
        let critic = self.learners[seat].critic.network().valid();
        let loss = value(&critic, &batch.observations, actions).mean().neg();
        (loss, logits.square().mean() * self.config.logit_penalty)
    }

    fn seen(&self, seat: usize, observations: &Tensor<2>) -> Tensor<2> {
        columns(observations, self.config.policy_sight.columns(&self.layout, seat))
    }

    fn joint_action(&self, observations: &Tensor<2>, policy: impl Fn(&Learner) -> Mlp) -> Tensor<2> {
        let act = |(seat, learner)| policy(learner).forward(self.seen(seat, observations)).tanh();
        Tensor::cat(self.learners.iter().enumerate().map(act).collect(), 1)
    }
}

impl Learner {
    fn new(config: &Config, layout: &JointLayout, seat: usize, rng: &mut Rng) -> Self {
        let hidden = config.hidden();
        let (n_seen, n_done) = (
            config.policy_sight.columns(layout, seat).len(),
            layout.acted(seat).len(),
        );
        let policy = hidden.network(n_seen, n_done, POLICY_OUTPUT_GAIN, rng);
        let critic = hidden.network(layout.n_observed() + layout.n_acted(), 1, 1.0, rng);
        Self {
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
        }
    }

    fn follow(&mut self, tau: f64) {
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
    }
}

fn value(critic: &Mlp, observations: &Tensor<2>, actions: Tensor<2>) -> Tensor<2> {
    critic.forward(Tensor::cat(vec![observations.clone(), actions], 1))
}

impl Maddpg {
    /// Inputs and outputs of a seat's policy as its file describes them.
    fn ports(&self, seat: usize) -> Ports {
        self.layout.ports(
            self.config.policy_sight.columns(&self.layout, seat),
            self.layout.acted(seat),
        )
    }
}

impl Agent for Maddpg {
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let joint = self.layout.observations(observations);
        let mut actions = values(self.joint_action(&joint, |learner| learner.policy.network().valid()));
        if mode == Mode::Train {
            let sd = self.config.exploration_sd_at(self.schedule.n_steps()) as f32;
            let noise = self.exploration.draw(observations.len(), rng);
            actions
                .iter_mut()
                .zip(noise)
                .for_each(|(action, noise)| *action += sd * noise);
        }
        self.layout.actions(&actions, self.schedule.n_steps())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        for (row, transition) in transitions.iter().enumerate() {
            self.replay.push(transition);
            if transition.end.is_some() {
                self.exploration.restart(row);
            }
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
            learner.critic.store(&format!("critic_{seat}"), &mut file);
            store(
                &learner.target_policy,
                &format!("target_policy_{seat}"),
                &mut file,
            );
            store(
                &learner.target_critic,
                &format!("target_critic_{seat}"),
                &mut file,
            );
        }
        self.replay.store(&mut file);
        let counters = Counters {
            exploration: self.exploration.clone(),
            schedule: self.schedule,
        };
        checkpoint::write(NAME, dir, file, &counters)
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
                .critic
                .restore(&format!("critic_{seat}"), &file)
                .map_err(&misfit)?;
            let target =
                |network: &Mlp, name| restore(network.clone(), &format!("target_{name}_{seat}"), &file);
            learner.target_policy = target(&learner.target_policy, "policy").map_err(&misfit)?;
            learner.target_critic = target(&learner.target_critic, "critic").map_err(&misfit)?;
        }
        self.replay.restore(&file).map_err(&misfit)?;
        (self.exploration, self.schedule) = (counters.exploration, counters.schedule);
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
