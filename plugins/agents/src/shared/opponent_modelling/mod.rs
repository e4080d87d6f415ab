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
#[cfg(test)]
pub(crate) mod trials;

pub use config::{ActingPrediction, Origin, Settings};
pub use networks::{Critic, GaussianNetwork};
pub(crate) use policy_graph::portable;
pub(crate) use prediction::{decide, policy_loss, predict};

use super::checkpoint::{self, finite};
use super::joint::{JointLayout, columns};
use super::replay::Replay;
use super::schedule::UpdateSchedule;
use super::seat::mismatch;
use super::targets::bootstrapped;
use burn::tensor::Tensor;
use contract::{
    Action, Agent, Error, Interface, Metric, Mode, Observation, Recorder, Rng, Transition, Updates,
};
use numerics::{
    network::{matrix, values},
    policy_file::FILE_NAME,
    squashed::{Draw, sample},
    tensor_file::{TensorFile, TensorFileError},
};
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
    fn decide(
        &self,
        game: &Game,
        seat: usize,
        observations: &Tensor<2>,
        mode: Mode,
        rng: &mut Rng,
    ) -> Tensor<2>;

    /// Predicts the mean actions of the others `[rows, n_acted - n_i]` as a seat sees them where the joint
    /// actions are `actions`.
    fn predict(&self, game: &Game, seat: usize, observations: &Tensor<2>, actions: &Tensor<2>) -> Tensor<2>;

    /// Updates the networks of a seat once.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a loss that is not finite.
    fn improve(
        &self,
        game: &mut Game,
        seat: usize,
        batch: &SeatBatch,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error>;
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

/// A batch of transitions as one seat learns from them.
#[derive(Debug, Clone)]
pub struct SeatBatch {
    /// Observations of all seats, `[batch, n_observed]`.
    pub observations: Tensor<2>,
    /// Actions of all seats, `[batch, n_acted]`.
    pub actions: Tensor<2>,
    /// Rewards of the seat, `[batch, 1]`.
    pub rewards: Tensor<2>,
    /// Next observations of all seats, `[batch, n_observed]`.
    pub next_observations: Tensor<2>,
    /// 0 after a terminal step, else 1, `[batch, 1]`.
    pub continues: Tensor<2>,
}

/// All seats with their networks and the replay buffer.
#[derive(Debug, Clone)]
pub struct Game {
    /// Settings that all algorithms share.
    pub settings: Settings,
    /// Columns of each seat in joint vectors.
    pub layout: JointLayout,
    /// Networks, one entry per seat.
    pub players: Vec<Player>,
    /// Transitions of all seats.
    pub replay: Replay,
    schedule: UpdateSchedule,
}

/// Agent that plays all seats of a game by one algorithm.
#[derive(Debug, Clone)]
pub struct Learner<A> {
    pub(crate) algorithm: A,
    pub(crate) game: Game,
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
    fn new<A: Algorithm>(layout: &JointLayout, seat: usize, settings: &Settings, rng: &mut Rng) -> Self {
        let (n_observed, n_acted, sizes) = (layout.n_observed(), layout.n_acted(), layout.action_sizes());
        let (own, n_seen) = (sizes[seat], settings.sight().columns(layout, seat).len());
        let (for_policy, for_opponents) = match A::CONDITIONING {
            Conditioning::PolicyOnPrediction => (n_seen + n_acted - own, n_seen),
            Conditioning::PredictionOnAction => (n_seen, n_seen + own),
        };
        let policy =
            GaussianNetwork::new(for_policy, own, settings, rng).keeping_latest(settings.stale_policy_step);
        let critic = Critic::new(n_observed, n_acted, settings, rng);
        let opponent = |other| GaussianNetwork::new(for_opponents, sizes[other], settings, rng);
        let opponents = others(sizes.len(), seat).map(opponent).collect();
        let prior = A::HAS_PRIOR.then(|| GaussianNetwork::new(n_seen, own, settings, rng));
        Self {
            policy,
            critic,
            opponents,
            prior,
        }
    }

    /// One draw per row and opponent, without gradients in the parameters of the opponent models.
    pub fn draw_others(&mut self, input: &Tensor<2>, rng: &mut Rng) -> Vec<Draw> {
        self.opponents
            .iter_mut()
            .map(|model| sample(model.plain_head(input.clone()), rng))
            .collect()
    }

    /// Names under which the Gaussians of a seat are stored, in their order.
    fn names(&self, seat: usize) -> Vec<String> {
        let opponents = (0..self.opponents.len()).map(|at| format!("seat_{seat}.opponent_{at}"));
        let prior = self.prior.iter().map(|_| format!("seat_{seat}.prior"));
        [format!("seat_{seat}.policy")]
            .into_iter()
            .chain(opponents)
            .chain(prior)
            .collect()
    }

    /// Policy, opponent models and, where the algorithm has one, the prior.
    fn gaussians(&self) -> impl Iterator<Item = &GaussianNetwork> {
        [&self.policy]
            .into_iter()
            .chain(&self.opponents)
            .chain(&self.prior)
    }

    fn gaussians_mut(&mut self) -> impl Iterator<Item = &mut GaussianNetwork> {
        [&mut self.policy]
            .into_iter()
            .chain(&mut self.opponents)
            .chain(&mut self.prior)
    }
}

/// The other seats of `n_seats`, in order.
pub(crate) fn others(n_seats: usize, seat: usize) -> impl Iterator<Item = usize> {
    (0..n_seats).filter(move |other| *other != seat)
}

/// Observations and actions side by side: the input of a network that is conditioned on both.
pub(crate) fn beside(observations: &Tensor<2>, actions: Vec<Tensor<2>>) -> Tensor<2> {
    Tensor::cat([vec![observations.clone()], actions].concat(), 1)
}

impl Game {
    /// Joint action `[batch, n_acted]` from a seat's own action and those of the others, in order.
    #[must_use]
    pub fn joint(&self, seat: usize, own: Tensor<2>, mut others: Vec<Tensor<2>>) -> Tensor<2> {
        others.insert(seat, own);
        Tensor::cat(others, 1)
    }

    /// Columns of joint observations that policy, opponent models and prior of a seat see.
    #[must_use]
    pub fn seen(&self, seat: usize, observations: &Tensor<2>) -> Tensor<2> {
        columns(observations, self.settings.sight().columns(&self.layout, seat))
    }

    /// Own columns of a seat in joint actions.
    #[must_use]
    pub fn own(&self, actions: &Tensor<2>, seat: usize) -> Tensor<2> {
        columns(actions, self.layout.acted(seat))
    }

    /// Records a loss of shape `[1]` as a training metric.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a loss that is not finite.
    pub fn record_loss(&self, metric: &str, loss: &Tensor<1>, record: &mut Recorder) -> Result<(), Error> {
        record.mean(
            metric,
            finite(metric, self.schedule.n_steps(), values(loss.clone())[0])?,
        );
        Ok(())
    }

    /// Takes one step of a seat's critic towards `r + gamma (1 - d) next_value`, where `next_value` is
    /// `[batch, 1]` (eq. 4.12, without its half).
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a loss that is not finite.
    pub fn improve_critic(
        &mut self,
        seat: usize,
        batch: &SeatBatch,
        next_value: Tensor<2>,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let SeatBatch {
            rewards, continues, ..
        } = batch.clone();
        let target = bootstrapped(rewards, continues, next_value, self.settings.discount);
        let value = self.players[seat]
            .critic
            .tracked_value(&batch.observations, batch.actions.clone());
        let loss = (value - target).square().mean();
        self.record_loss("critic_loss", &loss, record)?;
        self.players[seat].critic.descend(&loss);
        if self.settings.stale_policy_step {
            self.players[seat].policy.step_again();
        }
        Ok(())
    }

    /// Takes one step of a seat's opponent model `at`; returns its loss.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a loss that is not finite.
    pub fn opponent_step(&mut self, seat: usize, at: usize, loss: &Tensor<1>) -> Result<f64, Error> {
        let value = finite("opponent_loss", self.schedule.n_steps(), values(loss.clone())[0])?;
        self.players[seat].opponents[at].descend(loss);
        Ok(value)
    }

    /// Takes one step of a seat's policy; `log_density` `[batch, 1]` is that of its draws.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a loss that is not finite.
    pub fn improve_policy(
        &mut self,
        seat: usize,
        loss: &Tensor<1>,
        log_density: Tensor<2>,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        self.record_loss("policy_loss", loss, record)?;
        self.record_loss("policy_entropy", &log_density.mean().neg(), record)?;
        self.players[seat].policy.descend(loss);
        Ok(())
    }

    /// Draws a minibatch for a seat.
    pub(crate) fn batch(&self, seat: usize, rng: &mut Rng) -> SeatBatch {
        let batch = self
            .replay
            .sample_distinct(self.settings.batch_size.min(self.replay.len()), rng);
        SeatBatch {
            rewards: self
                .replay
                .rewards_of(&batch, seat, self.settings.reward_normalisation),
            observations: batch.observations,
            actions: batch.actions,
            next_observations: batch.next_observations,
            continues: batch.continues,
        }
    }

    /// All Gaussians of all seats with the names under which they are stored.
    fn gaussians(&self) -> impl Iterator<Item = (String, &GaussianNetwork)> {
        let players = self.players.iter().enumerate();
        players.flat_map(|(seat, player)| player.names(seat).into_iter().zip(player.gaussians()))
    }

    fn gaussians_mut(&mut self) -> impl Iterator<Item = (String, &mut GaussianNetwork)> {
        let players = self.players.iter_mut().enumerate();
        players.flat_map(|(seat, player)| player.names(seat).into_iter().zip(player.gaussians_mut()))
    }

    /// Policies and opponent models in a file, from which another program or `load` can act.
    fn exported(&self, agent: &str) -> TensorFile {
        let mut file = TensorFile::default();
        let seat = |(seat, player): (usize, &Player)| {
            let ports = self.layout.ports(
                self.settings.sight().columns(&self.layout, seat),
                self.layout.acted(seat),
            );
            let sizes = player.policy.network().sizes();
            json!({ "name": self.layout.seats()[seat], "inputs": ports.inputs, "outputs": ports.outputs,
                "policy_sizes": sizes })
        };
        let seats: Vec<_> = self.players.iter().enumerate().map(seat).collect();
        file.header = json!({
            "format": 1, "agent": agent, "seats": seats,
            "activation": self.settings.activation, "input_normalisation": self.settings.input_normalisation,
            "epsilon": numerics::input_norm::EPSILON, "head": "tanh_of_first_half",
        });
        for (name, model) in self.gaussians() {
            model.store_acting(&name, &mut file);
        }
        file
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
        settings: Settings,
        interface: &Interface,
        rng: &mut Rng,
    ) -> Result<Self, Error> {
        let layout = JointLayout::new(A::NAME, interface)?;
        settings.check()?;
        if layout.n_seats() < 2 {
            return Err(mismatch(
                A::NAME,
                "it models opponents, and the environment has one seat alone",
            ));
        }
        let players = (0..layout.n_seats())
            .map(|seat| Player::new::<A>(&layout, seat, &settings, rng))
            .collect();
        let replay = Replay::of_seats(settings.replay_capacity, &layout);
        Ok(Self {
            algorithm,
            game: Game {
                settings,
                layout,
                players,
                replay,
                schedule: UpdateSchedule::new(),
            },
        })
    }

    /// Updates every seat once, then the target critics.
    pub(crate) fn update(&mut self, rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        for seat in 0..self.game.players.len() {
            let batch = self.game.batch(seat, rng);
            self.algorithm
                .improve(&mut self.game, seat, &batch, rng, record)?;
        }
        let tau = self.game.settings.target_smoothing;
        self.game
            .players
            .iter_mut()
            .for_each(|player| player.critic.follow(tau));
        self.game.schedule.count_update();
        Ok(())
    }

    fn restore(&mut self, file: &TensorFile) -> Result<(), TensorFileError> {
        for (name, model) in self.game.gaussians_mut() {
            model.restore(&name, file)?;
        }
        for (seat, player) in self.game.players.iter_mut().enumerate() {
            player.critic.restore(&format!("seat_{seat}.critic"), file)?;
        }
        self.game.replay.restore(file)
    }

    fn restore_acting(&mut self, file: &TensorFile) -> Result<(), TensorFileError> {
        self.game
            .gaussians_mut()
            .try_for_each(|(name, model)| model.restore_acting(&name, file))
    }
}

impl<A: Algorithm> Agent for Learner<A> {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let joint = self.game.layout.observations(observations);
        let decide = |seat| self.algorithm.decide(&self.game, seat, &joint, mode, rng);
        let actions = Tensor::cat((0..self.game.players.len()).map(decide).collect(), 1);
        self.game
            .layout
            .actions(&values(actions), self.game.schedule.n_steps())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        transitions
            .iter()
            .for_each(|transition| self.game.replay.push(transition));
        let Settings {
            learning_starts,
            updates_per_step,
            ..
        } = self.game.settings;
        for _ in 0..self
            .game
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
        let (joint, layout) = (self.game.layout.observations(observations), &self.game.layout);
        let entries = actions
            .iter()
            .flatten()
            .flatten()
            .map(|entry| *entry as f32)
            .collect();
        let done = matrix(entries, layout.n_acted());
        let error = |seat| {
            let predicted = self.algorithm.predict(&self.game, seat, &joint, &done);
            let parts = others(layout.n_seats(), seat)
                .map(|other| self.game.own(&done, other))
                .collect();
            (predicted - Tensor::cat(parts, 1)).square().mean_dim(1)
        };
        let errors = values(Tensor::cat((0..layout.n_seats()).map(error).collect(), 1));
        Ok(errors
            .chunks(layout.n_seats())
            .map(|row| row.iter().map(|error| f64::from(*error)).collect())
            .collect())
    }

    fn updates(&self) -> Option<Updates> {
        Some(self.game.schedule.updates(
            self.game.settings.learning_starts,
            self.game.settings.updates_per_step,
        ))
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let mut file = TensorFile::default();
        for (name, model) in self.game.gaussians() {
            model.store(&name, &mut file);
        }
        for (seat, player) in self.game.players.iter().enumerate() {
            player.critic.store(&format!("seat_{seat}.critic"), &mut file);
        }
        self.game.replay.store(&mut file);
        checkpoint::write(A::NAME, dir, file, &self.game.schedule)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let misfit = checkpoint::error_of(A::NAME);
        let (file, schedule): (_, UpdateSchedule) = checkpoint::read(A::NAME, dir)?;
        self.restore(&file).map_err(&misfit)?;
        self.game.schedule = schedule;
        Ok(())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        self.game
            .exported(A::NAME)
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
