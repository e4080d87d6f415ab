//! ROMMEO: actor-critic with an opponent model that is regularised towards the observed actions of the
//! others.
//!
//! Tian et al. 2019, "A regularized opponent model with maximum entropy objective", IJCAI; thesis, section
//! 4.5, as a baseline, in the form of its released code (github.com/Yuantian013/TDOM-AC).
//!
//! | paper | here | shape |
//! |---|---|---|
//! | rho(a^-i given s) | `opponents`, draws `predicted` | `[batch, n_j]` each |
//! | P(a^j given s) | `prior` of seat j, which the others read | head `[batch, 2 n_j]` |
//! | pi(a^i given s, a^-i) | `policy` | head `[batch, 2 n_i]` |
//! | alpha | `policy_entropy_weight`, `opponent_entropy_weight`, `critic_entropy_weight` | scalars |
//!
//! Order of an update, per seat on a minibatch of its own: prior, critic, opponent models, policy.
//! - Prior: `mean(-log P(a^i) + k (mean sigma^2 + mean mu^2))` at the seat's own stored actions.
//! - Critic: towards `r + gamma (1 - d) [Q_target - alpha log pi + sum_j (log P^j - log rho^j)]`.
//! - Opponent model of seat o: `mean(log rho - log P^o - Q^i + alpha log pi)` with o's stored action replaced
//!   by a draw.
//! - Policy: `mean(alpha log pi - Q^i)` at predictions that are constants.
//!
//! Departures
//! - From the paper, as the thesis' code has them: one prior per seat, fitted to minibatches of the whole
//!   buffer and not to the latest data; the own action in the opponent model's loss is the stored one and not
//!   a draw; joint observations; the entropy weight is constant and not annealed.
//! - From the thesis' text: those of [`crate::tdom_ac`].
//!
//! Metrics: those of [`crate::tdom_ac`] with the losses above, and `prior_loss`.

use crate::shared::opponent_modelling::{
    ActingPrediction, Algorithm, Conditioning, Game, GaussianNetwork, Learner, Origin, SeatUpdate, Settings,
    beside, decide, metrics as shared_metrics, policy_loss, predict,
};
use contract::{Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Preset, Registry, Rng};
use numerics::equations::squashed::{Correction, candidate_of, log_density, log_sd, mean, sample};
use plan::Expression;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

const NAME: &str = "rommeo";

/// Hyper-parameters. The defaults are those of the released code in the particle tasks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Actions of the others that the policy is given when it explores.
    #[schemars(extend("x-source" = "released code; thesis, algorithm 2"))]
    pub acting_prediction: ActingPrediction,
    /// Weight k of the squares of the prior's mean and standard deviation in its loss.
    #[schemars(range(min = 0.0), extend("x-source" = "released code"))]
    pub prior_regularisation: f64,
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
            acting_prediction: ActingPrediction::Sample,
            prior_regularisation: 0.0005,
            critic_entropy_weight: 1.0,
            settings: Settings::default(),
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let own = |acting: &str| json!({ "critic_entropy_weight": 1.0, "acting_prediction": acting });
        vec![
            Origin::Text.preset("thesis", "thesis, section 4.5, as printed", own("sample")),
            Origin::ParticleCode.preset("released_code", "released code, particle tasks", own("sample")),
            Origin::GameCode.preset(
                "differential_game",
                "released code, differential game",
                own("mean"),
            ),
        ]
    }
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "actor-critic for several seats with opponent models regularised by what the others did";
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
    let prior = Metric::new("prior_loss", "", "loss of the priors, mean over the seats").lower_is_better();
    [shared_metrics(), vec![prior]].concat()
}

impl Algorithm for Config {
    const NAME: &'static str = NAME;
    const CONDITIONING: Conditioning = Conditioning::PolicyOnPrediction;
    const HAS_PRIOR: bool = true;

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
        self.improve_prior(update);
        update.improve_critic(self.next_value(update));
        update.improve_opponents(|at, other| self.opponent_loss(update, at, other));
        let (loss, log_density) = policy_loss(update, self.settings.policy_entropy_weight);
        update.improve_policy(loss, log_density);
    }
}

/// Prior of a seat.
fn prior(game: &Game, seat: usize) -> &GaussianNetwork {
    // This algorithm declares priors, so every seat has one.
    game.players[seat].prior.as_ref().expect("a prior per seat")
}

/// Log density under the prior of a seat of candidates that another seat has drawn.
fn expected<'e>(
    game: &Game,
    seat: usize,
    observations: Expression<'e>,
    candidate: Expression<'e>,
) -> Expression<'e> {
    let head = prior(game, seat).head(game.seen(seat, observations));
    log_density(head, candidate, Correction::Softened)
}

impl Config {
    /// One step of the prior towards the seat's own stored actions.
    fn improve_prior(&self, update: SeatUpdate<'_, '_>) {
        let loss = self.prior_loss(update);
        update.output("prior_loss", loss);
        prior(update.game, update.seat).descend(loss, update.settings);
    }

    fn prior_loss<'e>(&self, update: SeatUpdate<'_, 'e>) -> Expression<'e> {
        let SeatUpdate {
            game, seat, batch, ..
        } = update;
        let candidate = candidate_of(game.own(batch.actions, seat));
        let head = prior(game, seat).head(update.seen(batch.observations));
        let squares = log_sd(head).exp().square().mean() + mean(head).square().mean();
        squares * self.prior_regularisation - log_density(head, candidate, Correction::Softened).mean()
    }

    /// Value at s' in the target: `Q_target - alpha log pi + sum_j (log P^j - log rho^j)`.
    fn next_value<'e>(&self, update: SeatUpdate<'_, 'e>) -> Expression<'e> {
        let (player, following) = (update.player(), update.batch.next_observations);
        let seen = update.seen(following);
        let draws = update.draw_others(seen);
        let predicted: Vec<_> = draws.iter().map(|draw| draw.action).collect();
        let head = player.policy.head(beside(seen, &predicted));
        let own = sample(head, Correction::Softened);
        let mut value = own.log_density * -self.critic_entropy_weight;
        for (at, other) in update.opponents() {
            let expected = expected(update.game, other, following, draws[at].candidate);
            value = value + expected - draws[at].log_density;
        }
        let actions = update.joint(own.action, predicted);
        value + player.critic.target_value(following, actions)
    }

    /// `mean(log rho - log P^o - Q^i + alpha log pi(a^i))` with the stored actions of all seats but o.
    fn opponent_loss<'e>(&self, update: SeatUpdate<'_, 'e>, at: usize, other: usize) -> Expression<'e> {
        let SeatUpdate {
            game, seat, batch, ..
        } = update;
        let (player, observations) = (update.player(), batch.observations);
        let seen = update.seen(observations);
        let drawn = sample(player.opponents[at].head(seen), Correction::Softened);
        let expected = expected(game, other, observations, drawn.candidate);
        let actions = update.exchanged(other, drawn.action);
        let head = player.policy.head(beside(seen, &game.of_others(actions, seat)));
        let own = candidate_of(game.own(batch.actions, seat));
        let log_pi = log_density(head, own, Correction::Softened);
        let value = player.critic.value(observations, actions);
        (drawn.log_density - expected - value + log_pi * self.settings.opponent_entropy_weight).mean()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::{coordination, opponent_modelling::trials};
    use plan::{Equations, Processor};

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

    #[test]
    fn the_target_by_its_parts() {
        let mut learner = trials::learner(Config {
            critic_entropy_weight: 0.3,
            ..plain()
        });
        let batch = trials::batch(&mut learner, 8);
        let got = trials::computed(&learner, 0, &batch, |update| learner.algorithm.next_value(update));
        let want = trials::computed(&learner, 0, &batch, |update| {
            let (player, s) = (update.player(), update.batch.next_observations);
            let draw = |head| sample(head, Correction::Softened);
            let other = draw(player.opponents[0].head(s));
            let own = draw(player.policy.head(s.equations().join(&[s, other.action])));
            let actions = s.equations().join(&[own.action, other.action]);
            let q = player.critic.target_value(s, actions);
            let head = prior(update.game, 1).head(s);
            let seen = log_density(head, other.candidate, Correction::Softened);
            q - own.log_density * 0.3 + seen - other.log_density
        });
        assert!(
            got.iter().zip(&want).all(|(got, want)| (got - want).abs() < 1e-4),
            "{got:?} {want:?}"
        );
    }

    #[test]
    fn gradients_agree_with_finite_differences() {
        for input_normalisation in [false, true] {
            let settings = Settings {
                input_normalisation,
                ..trials::plain()
            };
            let config = Config {
                prior_regularisation: 0.1,
                settings,
                ..plain()
            };
            // Through the prior's density of the draw, the critic and the policy's condition.
            trials::assert_gradient(
                config.clone(),
                |player| &player.opponents[0],
                |update| config.opponent_loss(update, 0, 1),
            );
            trials::assert_gradient(
                config.clone(),
                |player| player.prior.as_ref().unwrap(),
                |update| config.prior_loss(update),
            );
        }
    }

    #[test]
    fn losses_reach_one_network_alone() {
        let mut learner = trials::learner(plain());
        let batch = trials::batch(&mut learner, 8);
        let config = &learner.algorithm;
        trials::assert_moves_only(&learner, 0, &batch, "seat_0.opponent_0", |update| {
            update.improve_opponents(|at, other| config.opponent_loss(update, at, other));
        });
        trials::assert_moves_only(&learner, 1, &batch, "seat_1.prior", |update| {
            config.improve_prior(update);
        });
    }

    #[test]
    fn the_prior_learns_the_stored_actions() {
        let mut learner = trials::learner(Config {
            settings: Settings {
                learning_rate: 0.01,
                ..trials::tiny()
            },
            ..tiny()
        });
        let batch = trials::batch(&mut learner, 32);
        let equations = Equations::new();
        learner
            .algorithm
            .improve_prior(trials::begin(&learner, 0, 32, &equations));
        let mut plan = Processor::<f32>::new(equations.into_graph());
        batch.write(&mut plan);
        let mut losses = (0..101).map(|_| {
            plan.run("loss", &mut learner.state);
            plan.number("seat_0.prior_loss")
        });
        let (before, after) = (losses.next().unwrap(), losses.last().unwrap());
        assert!(after < before - 0.2, "{before} {after}");
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
