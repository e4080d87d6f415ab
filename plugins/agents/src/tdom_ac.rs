//! TDOM-AC: actor-critic whose opponent models follow the others' own improvement.
//!
//! Thesis, chapter 4 (equations are its); algorithm 2. The released code is that of
//! github.com/Yuantian013/TDOM-AC.
//!
//! | thesis | here | shape |
//! |---|---|---|
//! | s, a, r^i | `batch` of a [`SeatUpdate`] | `[batch, ..]` |
//! | a_hat^-i ~ rho^i(. given s) | `predicted`, one draw per opponent | `[batch, n_j]` each |
//! | a_hat^i ~ pi^i(. given s, a_hat^-i) | `own` | `[batch, n_i]` |
//! | alpha | `policy_entropy_weight` (4.16), `opponent_entropy_weight` (4.22), `critic_entropy_weight` (4.13) | scalars |
//!
//! Order of an update, per seat on a minibatch of its own: critic (4.13), opponent models (4.22), policy
//! (4.16).
//!
//! Departures from the thesis. The defaults are those of the published curves (`preset:
//! released_code`); `preset: thesis` is the text.
//! - Rectifiers instead of leaky ones; inputs normalised by the batch; rewards standardised over the buffer;
//!   gradients clipped at 0.5; 0.5 instead of 1 as the entropy's weight in the critic's target; a second step
//!   of the policy along its stale gradient after each critic update; acting on the mean of the opponent
//!   model.
//! - Equation 4.12 is used without its factor of a half.
//! - `neutralised` sums the critics of all seats. As printed, the sum of equation 4.17 runs over the others
//!   alone and nothing would cancel between two players; the proof of theorem 1 adds `Q^1` and `Q^2`, and so
//!   does this objective. The own action is drawn from the policy at the predicted actions and is a constant,
//!   as in the proof.
//! - Running moments of normalised inputs take in each batch once per use of a network; the released code
//!   draws all opponents anew for each of them and takes a batch in more often.
//!
//! Metrics, means over the updates since the last measurement and over the seats: `critic_loss` squared
//! error, `opponent_loss` eq. 4.22 summed over the opponents, `policy_loss` eq. 4.16, `policy_entropy`
//! `-mean(log pi)`. In evaluation `opponent_prediction_error`, per seat.

use crate::shared::opponent_modelling::{
    ActingPrediction, Algorithm, Conditioning, Game, Learner, Origin, SeatUpdate, Settings, beside, decide,
    metrics as shared_metrics, policy_loss, predict,
};
use contract::{Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Preset, Registry, Rng};
use numerics::equations::squashed::{Correction, sample};
use plan::Expression;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

const NAME: &str = "tdom_ac";

/// Objective of the opponent models.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OpponentObjective {
    /// Eq. 4.22: each model ascends the critic of the seat that it models, with the stored actions of the
    /// others.
    #[default]
    Aligned,
    /// Eq. 4.17 as in theorem 1: all models ascend the sum of all critics, in which those of opposed seats
    /// cancel.
    Neutralised,
}

/// Hyper-parameters. The defaults are those of the released code in the particle tasks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Objective of the opponent models.
    #[schemars(extend("x-source" = "thesis, eq. 4.22"))]
    pub opponent_objective: OpponentObjective,
    /// Actions of the others that the policy is given when it explores.
    #[schemars(extend("x-source" = "released code; thesis, algorithm 2: sample"))]
    pub acting_prediction: ActingPrediction,
    /// Weight alpha of the entropy in the critic's target.
    #[schemars(range(min = 0.0), extend("x-source" = "released code; thesis, section 4.5: 1"))]
    pub critic_entropy_weight: f64,
    /// Settings that all algorithms with opponent models share.
    #[serde(flatten)]
    pub settings: Settings,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            opponent_objective: OpponentObjective::Aligned,
            acting_prediction: ActingPrediction::Mean,
            critic_entropy_weight: 0.5,
            settings: Settings::default(),
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let own = |weight: f64, acting: &str| {
            json!({ "critic_entropy_weight": weight,
            "acting_prediction": acting })
        };
        vec![
            Origin::Text.preset("thesis", "thesis, section 4.5, as printed", own(1.0, "sample")),
            Origin::ParticleCode.preset("released_code", "released code, particle tasks", own(0.5, "mean")),
            Origin::GameCode.preset(
                "differential_game",
                "released code, differential game",
                own(0.0, "mean"),
            ),
        ]
    }
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "actor-critic for several seats whose opponent models follow the others' improvement";
    let traits = AgentTraits::learner([Feed::Decisions], metrics());
    registry.agent(NAME, version, about, traits, build);
}

/// Builds the agent for an environment with several seats that observe boxes and act in boxes from -1 to 1.
///
/// # Errors
/// [`Error::Mismatch`] for any other environment.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    Ok(Box::new(Learner::new(config, interface, rng)?))
}

/// Metrics of the agent.
fn metrics() -> Vec<Metric> {
    shared_metrics()
}

impl Algorithm for Config {
    const NAME: &'static str = NAME;
    const CONDITIONING: Conditioning = Conditioning::PolicyOnPrediction;
    const HAS_PRIOR: bool = false;

    fn settings(&self) -> &Settings {
        &self.settings
    }

    fn decide<'e>(
        &self,
        game: &Game,
        seat: usize,
        observations: Expression<'e>,
        mode: Mode,
    ) -> Expression<'e> {
        decide(game, seat, observations, self.acting_prediction, mode)
    }

    fn predict<'e>(
        &self,
        game: &Game,
        seat: usize,
        observations: Expression<'e>,
        _actions: Expression<'e>,
    ) -> Expression<'e> {
        predict(game, seat, game.seen(seat, observations))
    }

    fn improve(&self, update: SeatUpdate<'_, '_>) {
        update.improve_critic(self.next_value(update));
        update.improve_opponents(|at, other| {
            self.opponent_objective(update, at, other)
                .loss(self.settings.opponent_entropy_weight)
        });
        let (loss, log_density) = policy_loss(update, self.settings.policy_entropy_weight);
        update.improve_policy(loss, log_density);
    }
}

/// Parts of the objective of an opponent model, `[batch, 1]` each.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Parts<'e> {
    /// `log rho` of the model's draws.
    pub(crate) log_density: Expression<'e>,
    /// Values of the critics for them.
    pub(crate) value: Expression<'e>,
}

impl<'e> Parts<'e> {
    /// `mean(alpha log rho - Q)`.
    pub(crate) fn loss(self, entropy_weight: f64) -> Expression<'e> {
        (self.log_density * entropy_weight - self.value).mean()
    }
}

impl Config {
    /// Value at s' in the target of eq. 4.13: `Q_target - alpha (log pi + sum log rho)`.
    fn next_value<'e>(&self, update: SeatUpdate<'_, 'e>) -> Expression<'e> {
        let (player, following) = (update.player(), update.batch.next_observations);
        let seen = update.seen(following);
        let draws = update.draw_others(seen);
        let predicted: Vec<_> = draws.iter().map(|draw| draw.action).collect();
        let head = player.policy.head(beside(seen, &predicted));
        let own = sample(head, Correction::Softened);
        let densities = draws.iter().map(|draw| draw.log_density);
        let log_density = densities.fold(own.log_density, |sum, one| sum + one);
        let actions = update.joint(own.action, predicted);
        player.critic.target_value(following, actions) - log_density * self.critic_entropy_weight
    }

    /// Objective of the opponent model `at`, which predicts the seat `other`.
    pub(crate) fn opponent_objective<'e>(
        &self,
        update: SeatUpdate<'_, 'e>,
        at: usize,
        other: usize,
    ) -> Parts<'e> {
        match self.opponent_objective {
            OpponentObjective::Aligned => aligned(update, at, other),
            OpponentObjective::Neutralised => neutralised(update, at),
        }
    }
}

/// Eq. 4.22: the critic of the seat `other`, with the stored actions of all seats but it.
fn aligned<'e>(update: SeatUpdate<'_, 'e>, at: usize, other: usize) -> Parts<'e> {
    let observations = update.batch.observations;
    let head = update.player().opponents[at].head(update.seen(observations));
    let drawn = sample(head, Correction::Softened);
    let actions = update.exchanged(other, drawn.action);
    Parts {
        log_density: drawn.log_density,
        value: update.game.players[other].critic.value(observations, actions),
    }
}

/// Eq. 4.17: the sum of the critics of all seats, with predicted actions of all others.
fn neutralised<'e>(update: SeatUpdate<'_, 'e>, at: usize) -> Parts<'e> {
    let (player, observations) = (update.player(), update.batch.observations);
    let seen = update.seen(observations);
    let draws = update.draw_others(seen);
    let mut predicted: Vec<_> = draws.iter().map(|draw| draw.action).collect();
    let drawn = sample(player.opponents[at].head(seen), Correction::Softened);
    predicted[at] = drawn.action;
    let own = sample(player.policy.head(beside(seen, &predicted)), Correction::Softened);
    // The own action is a constant.
    let actions = update.joint(own.action.stop_gradient(), predicted);
    let critics = update.game.players.iter();
    let values = critics.map(|player| player.critic.value(observations, actions));
    Parts {
        log_density: drawn.log_density,
        // A game has players.
        value: values.reduce(|sum, value| sum + value).expect("a player"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::{coordination, opponent_modelling::trials};

    fn tiny() -> Config {
        Config {
            settings: trials::tiny(),
            ..Config::default()
        }
    }

    fn plain() -> Config {
        Config {
            settings: trials::plain(),
            ..tiny()
        }
    }

    fn learner(config: Config) -> Learner<Config> {
        trials::learner(config)
    }

    #[test]
    fn the_soft_target_by_its_parts() {
        let mut learner = learner(Config {
            critic_entropy_weight: 0.3,
            ..plain()
        });
        let batch = trials::batch(&mut learner, 8);
        let got = trials::computed(&learner, 1, &batch, |update| learner.algorithm.next_value(update));
        let want = trials::computed(&learner, 1, &batch, |update| {
            let (player, s) = (update.player(), update.batch.next_observations);
            let draw = |head| sample(head, Correction::Softened);
            let other = draw(player.opponents[0].head(s));
            let own = draw(player.policy.head(s.equations().join(&[s, other.action])));
            let actions = s.equations().join(&[other.action, own.action]);
            let q = player.critic.target_value(s, actions);
            q - (own.log_density + other.log_density) * 0.3
        });
        assert!(
            got.iter().zip(&want).all(|(got, want)| (got - want).abs() < 1e-5),
            "{got:?} {want:?}"
        );
    }

    #[test]
    fn gradients_agree_with_finite_differences_through_the_draws() {
        for input_normalisation in [false, true] {
            let settings = Settings {
                input_normalisation,
                ..trials::plain()
            };
            let config = Config { settings, ..plain() };
            trials::assert_gradient(
                config.clone(),
                |player| &player.opponents[0],
                |update| aligned(update, 0, 1).loss(1.0),
            );
            trials::assert_gradient(
                config,
                |player| &player.policy,
                |update| policy_loss(update, 0.7).0,
            );
        }
    }

    #[test]
    fn losses_reach_one_network_alone() {
        for opponent_objective in [OpponentObjective::Aligned, OpponentObjective::Neutralised] {
            let mut learner = learner(Config {
                opponent_objective,
                ..plain()
            });
            let batch = trials::batch(&mut learner, 8);
            let config = &learner.algorithm;
            trials::assert_moves_only(&learner, 0, &batch, "seat_0.opponent_0", |update| {
                update.improve_opponents(|at, other| config.opponent_objective(update, at, other).loss(1.0));
            });
            trials::assert_moves_only(&learner, 0, &batch, "seat_0.policy", |update| {
                let (loss, log_density) = policy_loss(update, 1.0);
                update.improve_policy(loss, log_density);
            });
        }
    }

    /// Theorem 1: where the second critic is minus the first, the neutralised objective has the gradient of
    /// the entropy alone.
    #[test]
    fn opposed_critics_neutralise_the_gradient_of_eq_4_17_and_not_that_of_4_22() {
        let mut learner = learner(plain());
        let batch = trials::batch(&mut learner, 16);
        let critics = [0, 1].map(|seat: usize| learner.game.players[seat].critic.network().parameter_names());
        for (at, (of_one, of_other)) in critics[0].iter().zip(&critics[1]).enumerate() {
            // Minus the last layer, which has a weight and a bias.
            let sign = if at < 4 { 1.0 } else { -1.0 };
            let opposed: Vec<f32> = learner.state.entries(of_one).iter().map(|x| sign * x).collect();
            learner.state.entries_mut(of_other).copy_from_slice(&opposed);
        }
        let model = &learner.game.players[0].opponents[0];
        let of = |write: &dyn for<'e> Fn(SeatUpdate<'_, 'e>) -> Expression<'e>| {
            trials::gradient(&learner, model, &batch, write)
        };
        let loss_and_entropy = |opponent_objective| {
            let config = Config {
                opponent_objective,
                ..plain()
            };
            let loss = of(&|update| config.opponent_objective(update, 0, 1).loss(1.0));
            let entropy = of(&|update| config.opponent_objective(update, 0, 1).log_density.mean());
            (loss, entropy)
        };
        let (neutralised, entropy) = loss_and_entropy(OpponentObjective::Neutralised);
        assert!(trials::distance(&neutralised, &entropy) < 1e-6 * (1.0 + trials::norm(&entropy)));
        let (aligned, entropy) = loss_and_entropy(OpponentObjective::Aligned);
        assert!(trials::distance(&aligned, &entropy) > 0.01);
    }

    #[test]
    fn it_learns_to_coordinate() {
        let settings = Settings {
            policy_entropy_weight: 0.1,
            opponent_entropy_weight: 0.1,
            ..trials::tiny()
        };
        trials::assert_learns(Config { settings, ..tiny() });
    }

    #[test]
    fn a_saved_agent_continues() {
        coordination::assert_continues(|rng| build(tiny(), &coordination::game(), rng).unwrap());
    }

    #[test]
    fn an_exported_agent_acts_and_predicts_the_same() {
        trials::assert_exports(tiny());
    }

    #[test]
    fn a_seat_that_sees_its_own_observation_heeds_no_other() {
        trials::assert_sight(|settings| Config { settings, ..tiny() });
    }

    #[test]
    fn recorded_metrics_are_declared() {
        trials::assert_declared(tiny(), metrics());
    }

    #[test]
    fn members_of_a_population_learn_as_trials_alone() {
        trials::assert_members_learn_as_alone(&tiny());
    }
}
