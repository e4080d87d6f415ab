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
    acting,
    batch::{Batch, plan_of},
    box_seat::BoxSeat,
    checkpoint,
    replay::Replay,
    schedule::UpdateSchedule,
    soft_learner::{self, ActionSet, Sizes, SoftLearner},
};
use contract::{
    Action, Agent, Error, Interface, Metric, Mode, Observation, Recorder, Rng, Transition, Updates,
};
use numerics::{
    equations::network::Network,
    policy_file::{Head, Policy},
};
use plan::{Plans, State};
use rand::RngCore;
use std::path::Path;

const NAME: &str = "soft_actor_critic";
/// Gain of the policy's last layer.
const POLICY_OUTPUT_GAIN: f64 = 0.1;

/// Soft actor-critic for one seat.
#[derive(Debug, Clone)]
pub struct SoftActorCritic {
    config: Config,
    seat: BoxSeat,
    learner: SoftLearner,
    state: State<f32>,
    acting: Plans,
    learning: Plans,
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
        Ok(Self::assemble(config, seat, |network, output_gain, state| {
            network.initialise(output_gain, state, rng);
        }))
    }

    /// Builds the agent for a seat. `initialise` adds a network with the gain of its last layer to a state: the policy,
    /// then both critics.
    pub(crate) fn assemble(
        config: Config,
        seat: BoxSeat,
        initialise: impl FnMut(&Network, f64, &mut State<f32>),
    ) -> Self {
        let sizes = Sizes {
            seen: seat.n_observed(),
            done: seat.n_acted(),
            policy: config.hidden(),
            output_gain: POLICY_OUTPUT_GAIN,
            critics: config.hidden(),
        };
        let (set, settings) = (ActionSet::Box, config.settings(sizes.done));
        let (mut state, first_temperature) = (State::default(), config.first_temperature);
        let learner = SoftLearner::new(
            "",
            set,
            sizes,
            first_temperature,
            settings,
            &mut state,
            initialise,
        );
        Self {
            replay: Replay::new(config.replay_capacity, sizes.seen, sizes.done, 1),
            learner,
            state,
            acting: Plans::default(),
            learning: Plans::default(),
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
        let n_rows = self.config.batch_size.min(self.replay.len());
        let batch = self.replay.draw_distinct(n_rows, rng);
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
}

impl Agent for SoftActorCritic {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let (learner, seat) = (&self.learner, &self.seat);
        let plan = self.acting.of_rows(observations.len(), |equations| {
            learner.act(equations.input("observations", [observations.len(), seat.n_observed()]));
        });
        plan.write("observations", &seat.scaled(observations));
        let action = acting::actions(plan, mode, &mut self.state, rng);
        seat.actions(action, self.schedule.n_steps())
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

    fn plan(&mut self, _: usize) -> Option<String> {
        let (learner, rows, widths) = (&self.learner, self.config.batch_size, self.replay.widths());
        let plan = plan_of(&mut self.learning, rows, widths, |batch| {
            learner.update(batch, |all| all);
        });
        Some(plan.graph().to_string())
    }

    checkpoint::keeps!(NAME);

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        let policy = Policy::new(&self.learner.policy, &self.state, self.seat.ports(), Head::Tanh);
        policy.write(dir).map_err(checkpoint::error_of(NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let ports = self.seat.ports();
        checkpoint::import_policy(
            NAME,
            &self.learner.policy,
            &mut self.state,
            dir,
            &ports,
            Head::Tanh,
        )?;
        Ok(true)
    }
}
