//! The agent: acting, the updates and their batches, storing.

use super::{Algorithm, Game, GaussianNetwork, Player, Settings, of_seat, prediction_error};
use crate::shared::acting;
use crate::shared::batch::Batch;
use crate::shared::checkpoint::{self, finite};
use crate::shared::joint::JointLayout;
use crate::shared::replay::Replay;
use crate::shared::schedule::UpdateSchedule;
use crate::shared::seat::mismatch;
use contract::{
    Action, Agent, Error, Interface, Metric, Mode, Observation, Recorder, Rng, Transition, Updates,
};
use numerics::{
    equations::input_norm::EPSILON,
    policy_file::FILE_NAME,
    tensor_file::{TensorFile, TensorFileError},
};
use plan::{Plans, Processor, State};
use rand::RngCore;
use serde_json::json;
use std::path::Path;

/// Agent that plays all seats of a game by one algorithm.
#[derive(Debug, Clone)]
pub struct Learner<A> {
    pub(crate) algorithm: A,
    pub(crate) config: Settings,
    pub(crate) game: Game,
    pub(crate) state: State<f32>,
    acting: Plans,
    pub(super) learning: Plans,
    pub(crate) replay: Replay,
    schedule: UpdateSchedule,
}

impl<A: Algorithm> Learner<A> {
    /// Builds the agent for an environment with at least two seats that all observe a box and act in a box
    /// with limits -1 and 1.
    ///
    /// # Errors
    /// [`Error::Mismatch`] for any other environment; [`Error::Config`] for batches that cannot be
    /// normalised.
    pub fn new(algorithm: A, interface: &Interface, rng: &mut Rng) -> Result<Self, Error> {
        let settings = *algorithm.settings();
        Self::with_settings(algorithm, settings, interface, rng)
    }

    pub(super) fn with_settings(
        algorithm: A,
        config: Settings,
        interface: &Interface,
        rng: &mut Rng,
    ) -> Result<Self, Error> {
        let layout = JointLayout::new(A::NAME, interface)?;
        config.check()?;
        if layout.n_seats() < 2 {
            return Err(mismatch(
                A::NAME,
                "it models opponents, and the environment has one seat alone",
            ));
        }
        let mut state = State::default();
        let players = (0..layout.n_seats())
            .map(|seat| Player::new::<A>(&layout, seat, &config, &mut state, rng))
            .collect();
        Ok(Self {
            algorithm,
            replay: Replay::of_seats(config.replay_capacity, &layout),
            game: Game {
                layout,
                sight: config.sight(),
                players,
            },
            config,
            state,
            acting: Plans::default(),
            learning: Plans::default(),
            schedule: UpdateSchedule::new(),
        })
    }

    /// Draws a minibatch for each seat, with the rewards that its settings ask for.
    pub(crate) fn batches(&self, rng: &mut Rng) -> Batches {
        let n_rows = self.config.batch_size.min(self.replay.len());
        let batch = |_| {
            let mut batch = self.replay.draw_distinct(n_rows, rng);
            if self.config.reward_normalisation {
                self.replay.standardise_rewards(&mut batch);
            }
            batch
        };
        Batches {
            n_rows,
            of_seats: (0..self.game.players.len()).map(batch).collect(),
        }
    }

    /// Updates every seat once, then the target critics.
    pub(crate) fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        let (game, algorithm, config) = (&self.game, &self.algorithm, &self.config);
        let batches = self.batches(rng);
        // The first update has no latest gradient to repeat; its plan serves once.
        let is_first = config.stale_policy_step && !game.players[0].policy.has_stepped(&self.state);
        let mut once = Plans::default();
        let plans = if is_first { &mut once } else { &mut self.learning };
        let plan = game.learning(plans, algorithm, config, batches.n_rows, !is_first);
        batches.write(plan);
        plan.run_seeded("update", &mut self.state, rng.next_u64());
        for seat in 0..game.players.len() {
            for metric in losses::<A>() {
                let loss = plan.number(&of_seat(seat, metric));
                record.mean(metric, finite(metric, self.schedule.n_steps(), loss)?);
            }
        }
        self.schedule.count_update();
        Ok(())
    }

    /// Plan of acting for a number of observations.
    fn acting(&mut self, n_rows: usize) -> (&mut Processor<f32>, &mut State<f32>) {
        let (game, algorithm) = (&self.game, &self.algorithm);
        let plan = self
            .acting
            .of_rows(n_rows, |equations| game.act(algorithm, equations, n_rows));
        (plan, &mut self.state)
    }

    /// Gaussians of all seats.
    fn gaussians(&self) -> impl Iterator<Item = &GaussianNetwork> {
        self.game.players.iter().flat_map(Player::gaussians)
    }

    /// Policies and opponent models in a file, from which another program or `load` can act.
    fn exported(&self) -> TensorFile {
        let (layout, config) = (&self.game.layout, &self.config);
        let mut file = TensorFile::default();
        let seat = |(seat, player): (usize, &Player)| {
            let ports = layout.ports(self.game.sight.columns(layout, seat), layout.acted(seat));
            let sizes = player.policy.network().sizes();
            json!({ "name": layout.seats()[seat], "inputs": ports.inputs, "outputs": ports.outputs,
                "policy_sizes": sizes })
        };
        let seats: Vec<_> = self.game.players.iter().enumerate().map(seat).collect();
        file.header = json!({
            "format": 1, "agent": A::NAME, "seats": seats,
            "activation": config.activation, "input_normalisation": config.input_normalisation,
            "epsilon": EPSILON, "head": "tanh_of_first_half",
        });
        self.gaussians()
            .for_each(|model| model.store(&self.state, &mut file));
        file
    }

    fn restore_acting(&mut self, file: &TensorFile) -> Result<(), TensorFileError> {
        let mut models = self.game.players.iter().flat_map(Player::gaussians);
        models.try_for_each(|model| model.restore(&mut self.state, file))
    }
}

/// A batch for each seat.
#[derive(Debug, Clone)]
pub(crate) struct Batches {
    pub(crate) n_rows: usize,
    pub(crate) of_seats: Vec<Batch>,
}

impl Batches {
    /// Writes the inputs that [`Game::updates`] has added.
    pub(crate) fn write(&self, plan: &mut Processor<f32>) {
        for (seat, batch) in self.of_seats.iter().enumerate() {
            batch.write_named(&of_seat(seat, ""), plan);
        }
    }
}

/// Metrics of the update of a seat.
fn losses<A: Algorithm>() -> impl Iterator<Item = &'static str> {
    let prior = A::HAS_PRIOR.then_some("prior_loss").into_iter();
    prior.chain(["critic_loss", "opponent_loss", "policy_loss", "policy_entropy"])
}

impl<A: Algorithm> Agent for Learner<A> {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let rows = self.game.layout.observation_rows(observations);
        let (plan, state) = self.acting(observations.len());
        plan.write("observations", &rows);
        let actions = acting::actions(plan, mode, state, rng);
        let actions = actions.to_vec();
        self.game.layout.actions(&actions, self.schedule.n_steps())
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
        let Settings {
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

    fn decision_metrics(&self) -> Vec<Metric> {
        vec![prediction_error()]
    }

    #[allow(clippy::cast_possible_truncation, reason = "networks compute in f32")]
    fn assess(&mut self, observations: &[Observation], actions: &[Action]) -> Result<Vec<Vec<f64>>, Error> {
        let (rows, n_seats) = (
            self.game.layout.observation_rows(observations),
            self.game.layout.n_seats(),
        );
        let done = actions.iter().flatten().flatten().map(|entry| *entry as f32);
        let done: Vec<f32> = done.collect();
        let (plan, state) = self.acting(observations.len());
        plan.write("observations", &rows);
        plan.write("actions", &done);
        plan.run("assess", state);
        let errors = plan.entries("errors").chunks(n_seats);
        Ok(errors
            .map(|row| row.iter().map(|error| f64::from(*error)).collect())
            .collect())
    }

    fn plan(&mut self, _: usize) -> Option<String> {
        let (game, algorithm, config) = (&self.game, &self.algorithm, &self.config);
        let plan = game.learning(&mut self.learning, algorithm, config, config.batch_size, true);
        Some(plan.graph().to_string())
    }

    checkpoint::keeps!(A::NAME);

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        self.exported()
            .write(&dir.join(FILE_NAME))
            .map_err(checkpoint::error_of(A::NAME))?;
        Ok(true)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        let misfit = checkpoint::error_of(A::NAME);
        let file = TensorFile::read(&dir.join(FILE_NAME)).map_err(&misfit)?;
        self.restore_acting(&file).map_err(&misfit)?;
        Ok(true)
    }
}
