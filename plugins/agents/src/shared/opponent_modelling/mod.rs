//! Frame of the algorithms with opponent models: networks per seat, replay, the order of updates, acting,
//! storing.
//!
//! | thesis, chapter 4 | here | shape |
//! |---|---|---|
//! | s, s' | `observations`, `next_observations`: those of all seats, in order | `[batch, n_observed]` |
//! | a^i, a^-i | `actions`, all seats in order | `[batch, n_acted]` |
//! | r^i | `rewards`, standardised where the settings say so | `[batch, 1]` |
//! | pi^i | [`Player::policy`] | head `[batch, 2 n_i]` |
//! | rho^i, one factor per opponent | [`Player::opponents`], in the order of the seats | heads `[batch, 2 n_j]` |
//! | P(a^i given s), ROMMEO alone | [`Player::prior`] | head `[batch, 2 n_i]` |
//! | Q^i and its target | [`Player::critic`] | `[batch, 1]` |
//!
//! Policies, opponent models and priors see the joint observation, as in the released code, or with `sight:
//! own` that of their seat. Each seat has its own networks and draws its own minibatch; target critics move
//! after all seats are through. A critic's input is the joint action in the order of the seats, then the
//! joint observation: the released code puts the own action last, which is the same network with its columns
//! named otherwise.
//!
//! A folder that `save` wrote continues training. One that `export` wrote (`policy.safetensors`) holds
//! policies, opponent models and running moments of all seats: `import` takes it, and the agent then acts as
//! the exported one did, so that some seats of one stored agent can be set against the other seats of
//! another.

mod config;
mod networks;
mod policy_graph;
mod prediction;
mod seat_update;
#[cfg(test)]
pub(crate) mod trials;

pub use config::{ActingPrediction, Origin, Settings};
pub use networks::{Critic, GaussianNetwork};
pub(crate) use policy_graph::portable;
pub(crate) use prediction::{acted, decide, policy_loss, predict};
pub use seat_update::SeatUpdate;
pub(crate) use seat_update::of_seat;

use super::batch::BatchRows;
use super::checkpoint::{self, finite};
use super::joint::{JointLayout, ObservationScope};
use super::replay::Replay;
use super::schedule::UpdateSchedule;
use super::seat::mismatch;
use contract::{
    Action, Agent, Error, Interface, Metric, Mode, Observation, Recorder, Rng, Transition, Updates,
};
use numerics::{
    equations::input_norm::EPSILON,
    policy_file::FILE_NAME,
    tensor_file::{TensorFile, TensorFileError},
};
use plan::{Equations, Expression, Plans, Processor, State};
use rand::RngCore;
use serde_json::json;
use std::path::Path;

/// Metric of [`Agent::assess`]: mean squared difference between predicted and actual actions of the others.
pub const PREDICTION_ERROR: &str = "opponent_prediction_error";

/// Direction in which own actions and predicted actions depend on each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Conditioning {
    /// `pi(a^i given s, a^-i)` and `rho(a^-i given s)`.
    PolicyOnPrediction,
    /// `pi(a^i given s)` and `rho(a^-i given s, a^i)`.
    PredictionOnAction,
}

/// An algorithm with opponent models. Its config implements this trait.
pub trait Algorithm: Clone + Send + 'static {
    /// Name under which the agent is registered.
    const NAME: &'static str;
    /// Which of policy and opponent models is conditioned on the other.
    const CONDITIONING: Conditioning;
    /// Whether each seat has a prior over its own action.
    const HAS_PRIOR: bool;

    /// Settings that all algorithms share.
    fn settings(&self) -> &Settings;

    /// Chooses the actions `[rows, n_i]` of a seat.
    fn decide<'e>(
        &self,
        game: &Game,
        seat: usize,
        observations: Expression<'e>,
        mode: Mode,
    ) -> Expression<'e>;

    /// Predicts the mean actions of the others `[rows, n_acted - n_i]` as a seat sees them where the joint
    /// actions are `actions`.
    fn predict<'e>(
        &self,
        game: &Game,
        seat: usize,
        observations: Expression<'e>,
        actions: Expression<'e>,
    ) -> Expression<'e>;

    /// Updates the networks of a seat once, and names the metrics of the update.
    fn improve(&self, update: SeatUpdate<'_, '_>);
}

/// Networks of one seat.
#[derive(Debug, Clone)]
pub struct Player {
    /// Policy pi.
    pub policy: GaussianNetwork,
    /// Critic Q with its target.
    pub critic: Critic,
    /// Opponent models rho, one network per other seat, in the order of the seats.
    pub opponents: Vec<GaussianNetwork>,
    /// Prior P, where the algorithm has one.
    pub prior: Option<GaussianNetwork>,
}

/// All seats with their networks.
#[derive(Debug, Clone)]
pub struct Game {
    /// Columns of each seat in joint vectors.
    pub layout: JointLayout,
    /// Observations that policies, opponent models and priors see.
    pub sight: ObservationScope,
    /// Networks, one entry per seat.
    pub players: Vec<Player>,
}

/// Agent that plays all seats of a game by one algorithm.
#[derive(Debug, Clone)]
pub struct Learner<A> {
    pub(crate) algorithm: A,
    pub(crate) config: Settings,
    pub(crate) game: Game,
    pub(crate) state: State<f32>,
    acting: Plans,
    learning: Plans,
    pub(crate) replay: Replay,
    schedule: UpdateSchedule,
}

/// Metrics that every algorithm records in training, and the prediction error of [`Agent::assess`].
pub(crate) fn metrics() -> Vec<Metric> {
    vec![
        Metric::new(
            "critic_loss",
            "",
            "mean squared error of the critics, mean over the seats",
        )
        .lower_is_better(),
        Metric::new(
            "opponent_loss",
            "",
            "loss of the opponent models, summed over the opponents of a seat",
        )
        .lower_is_better(),
        Metric::new("policy_loss", "", "loss of the policies, mean over the seats").lower_is_better(),
        Metric::new(
            "policy_entropy",
            "nat",
            "minus the mean log density of sampled actions",
        ),
        prediction_error(),
    ]
}

fn prediction_error() -> Metric {
    let about =
        "mean squared difference between predicted and actual actions of the others, per seat (Fig. 4.5)";
    Metric::new(PREDICTION_ERROR, "", about)
        .lower_is_better()
        .per_episode(contract::PerEpisode::Mean)
}

impl Player {
    fn new<A: Algorithm>(
        layout: &JointLayout,
        seat: usize,
        settings: &Settings,
        state: &mut State<f32>,
        rng: &mut Rng,
    ) -> Self {
        let (n_observed, n_acted, sizes) = (layout.n_observed(), layout.n_acted(), layout.action_sizes());
        let (own, n_seen) = (sizes[seat], settings.sight().columns(layout, seat).len());
        let (for_policy, for_opponents) = match A::CONDITIONING {
            Conditioning::PolicyOnPrediction => (n_seen + n_acted - own, n_seen),
            Conditioning::PredictionOnAction => (n_seen, n_seen + own),
        };
        let gaussian = |what: &str, n_inputs, n_actions, state: &mut State<f32>, rng: &mut Rng| {
            GaussianNetwork::new(&of_seat(seat, what), n_inputs, n_actions, settings, state, rng)
        };
        let mut policy = gaussian("policy", for_policy, own, state, rng);
        if settings.stale_policy_step {
            policy = policy.keeping_latest(state);
        }
        let names = ["critic", "target_critic"].map(|what| of_seat(seat, what));
        let critic = Critic::new(
            names.each_ref().map(String::as_str),
            n_observed,
            n_acted,
            settings,
            state,
            rng,
        );
        let opponents = others(sizes.len(), seat).enumerate();
        let opponents = opponents
            .map(|(at, other)| gaussian(&format!("opponent_{at}"), for_opponents, sizes[other], state, rng));
        Self {
            policy,
            critic,
            opponents: opponents.collect(),
            prior: A::HAS_PRIOR.then(|| gaussian("prior", n_seen, own, state, rng)),
        }
    }

    /// Policy, opponent models and, where the algorithm has one, the prior.
    fn gaussians(&self) -> impl Iterator<Item = &GaussianNetwork> {
        [&self.policy]
            .into_iter()
            .chain(&self.opponents)
            .chain(&self.prior)
    }
}

/// The other seats of `n_seats`, in order.
pub(crate) fn others(n_seats: usize, seat: usize) -> impl Iterator<Item = usize> {
    (0..n_seats).filter(move |other| *other != seat)
}

/// Observations and actions side by side: the input of a network that is conditioned on both.
pub(crate) fn beside<'e>(observations: Expression<'e>, actions: &[Expression<'e>]) -> Expression<'e> {
    observations
        .equations()
        .join(&[&[observations], actions].concat())
}

impl Game {
    /// Columns of joint observations that policy, opponent models and prior of a seat see.
    #[must_use]
    pub fn seen<'e>(&self, seat: usize, observations: Expression<'e>) -> Expression<'e> {
        let columns = self.sight.columns(&self.layout, seat);
        if columns == (0..observations.n_columns()) {
            return observations;
        }
        observations.columns(columns)
    }

    /// Own columns of a seat in joint actions.
    #[must_use]
    pub fn own<'e>(&self, actions: Expression<'e>, seat: usize) -> Expression<'e> {
        actions.columns(self.layout.acted(seat))
    }

    /// Columns of the others in joint actions, in their order.
    pub(crate) fn of_others<'e>(&self, actions: Expression<'e>, seat: usize) -> Vec<Expression<'e>> {
        let others = others(self.players.len(), seat);
        others.map(|other| self.own(actions, other)).collect()
    }

    /// Actions of all seats, drawn and most likely ones, and errors of their predictions.
    fn act<A: Algorithm>(&self, algorithm: &A, equations: &Equations, n_rows: usize) {
        let observations = equations.input("observations", [n_rows, self.layout.n_observed()]);
        let actions = equations.input("actions", [n_rows, self.layout.n_acted()]);
        let seats = || 0..self.players.len();
        for (routine, output, mode) in [
            ("draw", "drawn", Mode::Train),
            ("choose", "chosen", Mode::Evaluate),
        ] {
            equations.routine(routine);
            let decide = |seat| algorithm.decide(self, seat, observations, mode);
            equations.output(output, equations.join(&seats().map(decide).collect::<Vec<_>>()));
        }
        equations.routine("assess");
        let error = |seat| {
            let predicted = algorithm.predict(self, seat, observations, actions);
            let done = equations.join(&self.of_others(actions, seat));
            (predicted - done).square().mean_columns()
        };
        equations.output("errors", equations.join(&seats().map(error).collect::<Vec<_>>()));
    }

    /// One update of every seat, then of the target critics.
    fn update<A: Algorithm>(&self, algorithm: &A, updates: &[SeatUpdate<'_, '_>]) {
        for update in updates {
            algorithm.improve(*update);
        }
        for update in updates {
            let (critic, equations) = (&update.player().critic, update.batch.observations.equations());
            critic.follow(equations, update.settings.target_smoothing);
        }
    }
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

    fn with_settings(
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
        let (game, config, algorithm) = (&self.game, &self.config, &self.algorithm);
        let batches = self.batches(rng);
        // The first update has no latest gradient to repeat; its plan serves once.
        let is_first = config.stale_policy_step && !game.players[0].policy.has_stepped(&self.state);
        let mut once = Plans::default();
        let plans = if is_first { &mut once } else { &mut self.learning };
        let plan = plans.of_rows(batches.n_rows, |equations| {
            equations.routine("update");
            game.update(
                algorithm,
                &game.updates(config, equations, batches.n_rows, !is_first),
            );
        });
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
    pub(crate) of_seats: Vec<BatchRows>,
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
        let actions = match mode {
            Mode::Train => {
                plan.run_seeded("draw", state, rng.next_u64());
                "drawn"
            }
            Mode::Evaluate => {
                plan.run("choose", state);
                "chosen"
            }
        };
        let actions = plan.entries(actions).to_vec();
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

    checkpoint::keeps_state!(A::NAME);

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
