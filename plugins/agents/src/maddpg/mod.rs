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
    batch::{Batch, BatchInputs, plan_of},
    bellman::{bootstrapped, half_squared_error},
    checkpoint::{self, finite},
    joint::JointLayout,
    replay::Replay,
    schedule::UpdateSchedule,
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    equations::network::Network,
    policy_file::{Head, Policy, Ports},
};
use plan::{Descent, Equations, Expression, Plans, State};
use std::{ops::Range, path::Path};

const NAME: &str = "maddpg";
/// Gain of the policies' last layer: first actions are close to zero, where tanh is not flat.
const POLICY_OUTPUT_GAIN: f64 = 0.1;
/// Metrics of the update of a seat.
const LOSSES: [&str; 2] = ["critic_loss", "policy_loss"];

/// Multi-agent deep deterministic policy gradient for all seats.
#[derive(Debug, Clone)]
pub struct Maddpg {
    config: Config,
    learner: Learner,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
    replay: Replay,
    exploration: Exploration,
    schedule: UpdateSchedule,
}

/// Networks of all seats, and the equations by which they act and learn.
#[derive(Debug, Clone)]
struct Learner {
    layout: JointLayout,
    seats: Vec<Seat>,
}

/// Networks of one seat.
#[derive(Debug, Clone)]
struct Seat {
    /// Columns of the joint observation that the policy sees.
    seen: Range<usize>,
    policy: Network,
    critic: Network,
    target_policy: Network,
    target_critic: Network,
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
        let mut state = State::default();
        let seats = (0..layout.n_seats()).map(|seat| Seat::new(&config, &layout, seat, &mut state, rng));
        Ok(Self {
            replay: Replay::of_seats(config.replay_capacity, &layout),
            exploration: Exploration::new(config.exploration_noise, layout.n_acted()),
            learner: Learner {
                seats: seats.collect(),
                layout,
            },
            state,
            acting: Plans::default(),
            learning: Plans::default(),
            schedule: UpdateSchedule::new(),
            config,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let (learner, config, widths) = (&self.learner, &self.config, self.replay.widths());
        let n_rows = config.batch_size.min(self.replay.len());
        let plan = plan_of(&mut self.learning, n_rows, widths, |batch| {
            learner.update(batch, config);
        });
        for seat in 0..widths.seats {
            drawn(&self.replay, n_rows, config, rng).write(plan);
            plan.run(&of_seat(seat, "update"), &mut self.state);
            for metric in LOSSES {
                let loss = plan.number(&of_seat(seat, metric));
                record.mean(metric, finite(metric, self.schedule.n_steps(), loss)?);
            }
        }
        plan.run("follow", &mut self.state);
        record.mean(
            "exploration_sd",
            config.exploration_sd_at(self.schedule.n_steps()),
        );
        self.schedule.count_update();
        Ok(())
    }

    /// Inputs and outputs of a seat's policy as its file describes them.
    fn ports(&self, seat: usize) -> Ports {
        let layout = &self.learner.layout;
        layout.ports(self.learner.seats[seat].seen.clone(), layout.acted(seat))
    }
}

/// A batch for one seat, with the rewards that its config asks for.
fn drawn(replay: &Replay, n_rows: usize, config: &Config, rng: &mut Rng) -> Batch {
    let mut batch = replay.draw_distinct(n_rows, rng);
    if config.reward_normalisation {
        replay.standardise_rewards(&mut batch);
    }
    batch
}

/// Name of what belongs to a seat.
fn of_seat(seat: usize, what: &str) -> String {
    format!("seat_{seat}.{what}")
}

impl Seat {
    fn new(
        config: &Config,
        layout: &JointLayout,
        seat: usize,
        state: &mut State<f32>,
        rng: &mut Rng,
    ) -> Self {
        let seen = config.policy_sight.columns(layout, seat);
        let mut network = |what: &str, inputs, outputs, gain| {
            let network = config.hidden().network(of_seat(seat, what), inputs, outputs);
            network.initialise(gain, state, rng);
            network
        };
        let policy = network("policy", seen.len(), layout.acted(seat).len(), POLICY_OUTPUT_GAIN);
        let critic = network("critic", layout.n_observed() + layout.n_acted(), 1, 1.0);
        Self {
            seen,
            target_policy: policy.copied(of_seat(seat, "target_policy"), state),
            target_critic: critic.copied(of_seat(seat, "target_critic"), state),
            policy,
            critic,
        }
    }

    /// Inputs of tanh `[batch, n_i]` by the seat's policy or its target.
    fn logits<'e>(&self, policy: &Network, observations: Expression<'e>) -> Expression<'e> {
        policy.apply(observations.columns(self.seen.clone()))
    }

    /// Moves the targets towards their networks.
    fn follow(&self, equations: &Equations, tau: f64) {
        for (target, source) in [
            (&self.target_critic, &self.critic),
            (&self.target_policy, &self.policy),
        ] {
            equations.follow(&target.parameters(equations), &source.parameters(equations), tau);
        }
    }
}

impl Learner {
    /// Joint actions of the policies.
    fn act(&self, observations: Expression<'_>) {
        let equations = observations.equations();
        equations.routine("act");
        equations.output("actions", self.joint_action(observations, |seat| &seat.policy));
    }

    /// One update of each seat's critic and policy, and one move of all targets.
    fn update(&self, batch: BatchInputs<'_>, config: &Config) {
        let equations = batch.observations.equations();
        let descend = |loss, network: &Network, rate, first_rate| {
            let descent = Descent::adam(rate, first_rate, config.gradient_clip);
            equations.descend(loss, &network.parameters(equations), &descent);
        };
        for (at, seat) in self.seats.iter().enumerate() {
            equations.routine(&of_seat(at, "update"));
            let loss = self.critic_loss(at, batch, config.discount);
            equations.output(&of_seat(at, "critic_loss"), loss);
            descend(
                loss,
                &seat.critic,
                "critic_learning_rate",
                config.critic_learning_rate,
            );
            let (loss, penalty) = self.policy_loss(at, batch);
            equations.output(&of_seat(at, "policy_loss"), loss);
            let loss = loss + penalty * config.logit_penalty;
            descend(
                loss,
                &seat.policy,
                "actor_learning_rate",
                config.actor_learning_rate,
            );
        }
        equations.routine("follow");
        for seat in &self.seats {
            seat.follow(equations, config.target_smoothing);
        }
    }

    /// Eq. 6: half the squared error of a seat's critic.
    fn critic_loss<'e>(&self, seat: usize, batch: BatchInputs<'e>, discount: f64) -> Expression<'e> {
        let value = value(&self.seats[seat].critic, batch.observations, batch.actions);
        half_squared_error(value, self.target(seat, batch, discount))
    }

    /// Eq. 6: `y = r_i + gamma Q_i'(x', mu_1'(o_1'), ..., mu_N'(o_N'))`.
    fn target<'e>(&self, seat: usize, batch: BatchInputs<'e>, discount: f64) -> Expression<'e> {
        let next = self.joint_action(batch.next_observations, |seat| &seat.target_policy);
        let next_value = value(&self.seats[seat].target_critic, batch.next_observations, next);
        let rewards = batch.rewards.columns(seat..seat + 1);
        bootstrapped(rewards, batch.continues, next_value, discount)
    }

    /// Eq. 5: minus the critic's mean value, where the actions of the others are those of the batch, and the mean
    /// square of the inputs of tanh.
    fn policy_loss<'e>(&self, at: usize, batch: BatchInputs<'e>) -> (Expression<'e>, Expression<'e>) {
        let seat = &self.seats[at];
        let logits = seat.logits(&seat.policy, batch.observations);
        let actions = self.layout.exchanged(batch.actions, at, logits.tanh());
        let value = value(&seat.critic, batch.observations, actions);
        (-value.mean(), logits.square().mean())
    }

    fn joint_action<'e>(
        &self,
        observations: Expression<'e>,
        policy: impl Fn(&Seat) -> &Network,
    ) -> Expression<'e> {
        let act = |seat: &Seat| seat.logits(policy(seat), observations).tanh();
        let actions: Vec<_> = self.seats.iter().map(act).collect();
        observations.equations().join(&actions)
    }
}

fn value<'e>(critic: &Network, observations: Expression<'e>, actions: Expression<'e>) -> Expression<'e> {
    critic.apply(observations.equations().join(&[observations, actions]))
}

impl Agent for Maddpg {
    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let (learner, layout, n_rows) = (&self.learner, &self.learner.layout, observations.len());
        let plan = self.acting.of_rows(n_rows, |equations| {
            learner.act(equations.input("observations", [n_rows, layout.n_observed()]));
        });
        plan.write("observations", &layout.observation_rows(observations));
        plan.run("act", &mut self.state);
        let mut actions = plan.entries("actions").to_vec();
        if mode == Mode::Train {
            let sd = self.config.exploration_sd_at(self.schedule.n_steps()) as f32;
            let noise = self.exploration.draw(n_rows, rng);
            actions
                .iter_mut()
                .zip(noise)
                .for_each(|(action, noise)| *action += sd * noise);
        }
        layout.actions(&actions, self.schedule.n_steps())
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

    fn plan(&mut self, _: usize) -> Option<String> {
        let (learner, config, widths) = (&self.learner, &self.config, self.replay.widths());
        let plan = plan_of(&mut self.learning, config.batch_size, widths, |batch| {
            learner.update(batch, config);
        });
        Some(plan.graph().to_string())
    }

    checkpoint::keeps!(NAME; counters: exploration);

    /// Writes one file per seat, in a folder with the seat's name.
    fn export(&self, dir: &Path) -> Result<bool, Error> {
        for (at, seat) in self.learner.seats.iter().enumerate() {
            let policy = Policy::new(&seat.policy, &self.state, self.ports(at), Head::Tanh);
            policy
                .write(&self.learner.layout.folder(dir, at)?)
                .map_err(checkpoint::error_of(NAME))?;
        }
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        for (at, seat) in self.learner.seats.iter().enumerate() {
            let (ports, folder) = (self.ports(at), self.learner.layout.place(dir, at));
            checkpoint::import_policy(NAME, &seat.policy, &mut self.state, &folder, &ports, Head::Tanh)?;
        }
        Ok(true)
    }
}
