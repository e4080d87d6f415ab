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
//! | alpha | `temperature` | scalar per seat |
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
    acting,
    batch::{BatchInputs, plan_of},
    checkpoint,
    joint::{JointLayout, ObservationScope},
    replay::Replay,
    schedule::UpdateSchedule,
    soft_learner::{self, ActionSet, Sizes, SoftLearner},
};
use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Transition, Updates,
};
use numerics::{
    equations::network::Network,
    policy_file::{Head, Policy, Ports},
};
use plan::{Equations, Expression, Plans, State};
use rand::RngCore;
use std::{ops::Range, path::Path};

const NAME: &str = "independent_sac";
/// Gain of the policies' last layer: first means are close to zero and first deviations close to 1.
const POLICY_OUTPUT_GAIN: f64 = 0.1;

/// Soft actor-critic in every seat.
#[derive(Debug, Clone)]
pub struct IndependentSac {
    config: Config,
    seats: Seats,
    state: State<f32>,
    acting: Plans,
    /// Updates of each seat.
    learning: Vec<Plans>,
    replay: Replay,
    schedule: UpdateSchedule,
}

/// Learners of the seats, and what each of them sees.
#[derive(Debug, Clone)]
struct Seats {
    layout: JointLayout,
    sight: ObservationScope,
    learners: Vec<SoftLearner>,
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
        let (mut state, n_seats) = (State::default(), layout.n_seats());
        let learner = |seat| {
            let sizes = Sizes {
                seen: config.sight.columns(&layout, seat).len(),
                done: layout.acted(seat).len(),
                policy: config.hidden(),
                output_gain: POLICY_OUTPUT_GAIN,
                critics: config.hidden(),
            };
            let (prefix, settings) = (format!("seat_{seat}."), config.settings(sizes.done));
            let first_temperature = config.first_temperature;
            let set = ActionSet::Box;
            let initialise =
                |network: &Network, gain, state: &mut State<f32>| network.initialise(gain, state, rng);
            SoftLearner::new(
                &prefix,
                set,
                sizes,
                first_temperature,
                settings,
                &mut state,
                initialise,
            )
        };
        Ok(Self {
            seats: Seats {
                learners: (0..n_seats).map(learner).collect(),
                sight: config.sight,
                layout: layout.clone(),
            },
            replay: Replay::of_seats(config.replay_capacity, &layout),
            state,
            acting: Plans::default(),
            learning: vec![Plans::default(); n_seats],
            schedule: UpdateSchedule::new(),
            config,
        })
    }

    fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let n_rows = self.config.batch_size.min(self.replay.len());
        let (seats, widths) = (&self.seats, self.replay.widths());
        for (seat, plans) in self.learning.iter_mut().enumerate() {
            let mut batch = self.replay.draw_distinct(n_rows, rng);
            if self.config.reward_normalisation {
                self.replay.standardise_rewards(&mut batch);
            }
            let plan = plan_of(plans, n_rows, widths, |batch| seats.update(seat, batch));
            batch.write(plan);
            plan.run_seeded("update", &mut self.state, rng.next_u64());
            soft_learner::record(plan, self.schedule.n_steps(), record)?;
        }
        self.schedule.count_update();
        Ok(())
    }
}

impl Seats {
    /// Columns of the joint observation that a seat sees.
    fn seen(&self, seat: usize) -> Range<usize> {
        self.sight.columns(&self.layout, seat)
    }

    /// Columns of a batch from which one seat learns.
    fn part<'e>(&self, seat: usize, batch: BatchInputs<'e>) -> BatchInputs<'e> {
        BatchInputs {
            observations: batch.observations.columns(self.seen(seat)),
            actions: batch.actions.columns(self.layout.acted(seat)),
            rewards: batch.rewards.columns(seat..seat + 1),
            next_observations: batch.next_observations.columns(self.seen(seat)),
            continues: batch.continues,
        }
    }

    /// The update of one seat.
    fn update(&self, seat: usize, batch: BatchInputs<'_>) {
        self.learners[seat].update(batch, |all| self.part(seat, all));
    }

    /// Joint actions, drawn and most likely ones.
    fn act(&self, equations: &Equations, n_rows: usize) {
        let joint = equations.input("observations", [n_rows, self.layout.n_observed()]);
        let learners = || self.learners.iter().enumerate();
        equations.routine("draw");
        let own = learners().map(|(seat, learner)| learner.drawn(joint.columns(self.seen(seat))));
        equations.output("drawn", equations.join(&own.collect::<Vec<Expression<'_>>>()));
        equations.routine("choose");
        let own = learners().map(|(seat, learner)| learner.chosen(joint.columns(self.seen(seat))));
        equations.output("chosen", equations.join(&own.collect::<Vec<Expression<'_>>>()));
    }

    /// Inputs and outputs of a seat's policy as its file describes them.
    fn ports(&self, seat: usize) -> Ports {
        self.layout.ports(self.seen(seat), self.layout.acted(seat))
    }
}

impl Agent for IndependentSac {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let (seats, n_rows) = (&self.seats, observations.len());
        let plan = self
            .acting
            .of_rows(n_rows, |equations| seats.act(equations, n_rows));
        plan.write("observations", &seats.layout.observation_rows(observations));
        let action = acting::actions(plan, mode, &mut self.state, rng);
        let joint = action;
        seats.layout.actions(joint, self.schedule.n_steps())
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

    fn plan(&mut self, _: usize) -> Option<String> {
        let (seats, n_rows, widths) = (&self.seats, self.config.batch_size, self.replay.widths());
        let of_seats = self.learning.iter_mut().enumerate().map(|(seat, plans)| {
            let plan = plan_of(plans, n_rows, widths, |batch| seats.update(seat, batch));
            format!("{}: {}", seats.layout.seats()[seat], plan.graph())
        });
        Some(of_seats.collect())
    }

    checkpoint::keeps!(NAME);

    /// Writes one file per seat, in a folder with the seat's name.
    fn export(&self, dir: &Path) -> Result<bool, Error> {
        for (seat, learner) in self.seats.learners.iter().enumerate() {
            let policy = Policy::new(&learner.policy, &self.state, self.seats.ports(seat), Head::Tanh);
            policy
                .write(&self.seats.layout.folder(dir, seat)?)
                .map_err(checkpoint::error_of(NAME))?;
        }
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        for (seat, learner) in self.seats.learners.iter().enumerate() {
            let (ports, folder) = (self.seats.ports(seat), self.seats.layout.place(dir, seat));
            let state = &mut self.state;
            checkpoint::import_policy(NAME, &learner.policy, state, &folder, &ports, Head::Tanh)?;
        }
        Ok(true)
    }
}
