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
mod learner;
mod networks;
mod policy_graph;
mod prediction;
mod seat_update;
#[cfg(test)]
pub(crate) mod trials;

pub use config::{ActingPrediction, Origin, Settings};
pub use learner::Learner;
pub use networks::{Critic, GaussianNetwork};
pub(crate) use policy_graph::portable;
pub(crate) use prediction::{acted, decide, policy_loss, predict};
pub use seat_update::SeatUpdate;
pub(crate) use seat_update::of_seat;

use super::joint::{JointLayout, ObservationScope};
use contract::{Metric, Mode, Rng};
use plan::{Equations, Expression, State};

/// Metric of [`contract::Agent::assess`]: mean squared difference between predicted and actual actions of the others.
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

/// Metrics that every algorithm records in training, and the prediction error of [`contract::Agent::assess`].
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
