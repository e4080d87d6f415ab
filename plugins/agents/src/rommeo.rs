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
    ActingPrediction, Algorithm, Conditioning, Game, GaussianNetwork, Learner, Origin, SeatBatch, Settings,
    beside, decide, metrics as shared_metrics, others, policy_loss, predict,
};
use burn::tensor::Tensor;
use contract::{Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Preset, Recorder, Registry, Rng};
use numerics::{
    gaussian_head::{mean, standard_deviation},
    squashed::{candidate_of, log_density, sample},
};
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

    fn decide(
        &self,
        game: &Game,
        seat: usize,
        observations: &Tensor<2>,
        mode: Mode,
        rng: &mut Rng,
    ) -> Tensor<2> {
        decide(game, seat, observations, self.acting_prediction, mode, rng)
    }

    fn predict(&self, game: &Game, seat: usize, observations: &Tensor<2>, _actions: &Tensor<2>) -> Tensor<2> {
        predict(game, seat, observations)
    }

    fn improve(
        &self,
        game: &mut Game,
        seat: usize,
        batch: &SeatBatch,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        self.improve_prior(game, seat, batch, record)?;
        let next_value = self.next_value(game, seat, batch, rng);
        game.improve_critic(seat, batch, next_value, record)?;
        let mut total = 0.0;
        for (at, other) in others(game.players.len(), seat).enumerate() {
            let loss = self.opponent_loss(game, seat, (at, other), batch, rng);
            total += game.opponent_step(seat, at, &loss)?;
        }
        record.mean("opponent_loss", total);
        let (loss, log_density) = policy_loss(game, seat, batch, self.settings.policy_entropy_weight, rng);
        game.improve_policy(seat, &loss, log_density, record)
    }
}

/// Prior of a seat.
fn prior(game: &mut Game, seat: usize) -> &mut GaussianNetwork {
    // This algorithm declares priors, so every seat has one.
    game.players[seat].prior.as_mut().expect("a prior per seat")
}

impl Config {
    /// One step of the prior towards the seat's own stored actions.
    fn improve_prior(
        &self,
        game: &mut Game,
        seat: usize,
        batch: &SeatBatch,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let loss = self.prior_loss(game, seat, batch);
        game.record_loss("prior_loss", &loss, record)?;
        prior(game, seat).descend(&loss);
        Ok(())
    }

    fn prior_loss(&self, game: &mut Game, seat: usize, batch: &SeatBatch) -> Tensor<1> {
        let candidate = candidate_of(game.own(&batch.actions, seat));
        let seen = game.seen(seat, &batch.observations);
        let head = prior(game, seat).tracked_head(seen);
        let squares = standard_deviation(head.clone()).square().mean() + mean(head.clone()).square().mean();
        squares * self.prior_regularisation - log_density(head, candidate).mean()
    }

    /// Value at s' in the target: `Q_target - alpha log pi + sum_j (log P^j - log rho^j)`.
    fn next_value(&self, game: &mut Game, seat: usize, batch: &SeatBatch, rng: &mut Rng) -> Tensor<2> {
        let following = &batch.next_observations;
        let seen = game.seen(seat, following);
        let draws = game.players[seat].draw_others(&seen, rng);
        let predicted: Vec<_> = draws.iter().map(|draw| draw.action.clone()).collect();
        let own = sample(
            game.players[seat]
                .policy
                .plain_head(beside(&seen, predicted.clone())),
            rng,
        );
        let mut value = own.log_density * -self.critic_entropy_weight;
        for (draw, other) in draws.into_iter().zip(others(game.players.len(), seat)) {
            let seen_by_other = game.seen(other, following);
            let expected = log_density(prior(game, other).plain_head(seen_by_other), draw.candidate);
            value = value + expected - draw.log_density;
        }
        let actions = game.joint(seat, own.action, predicted);
        value + game.players[seat].critic.target_value(following, actions)
    }

    /// `mean(log rho - log P^o - Q^i + alpha log pi(a^i))` with the stored actions of all seats but o.
    fn opponent_loss(
        &self,
        game: &mut Game,
        seat: usize,
        (at, other): (usize, usize),
        batch: &SeatBatch,
        rng: &mut Rng,
    ) -> Tensor<1> {
        let s = &batch.observations;
        let (seen, seen_by_other) = (game.seen(seat, s), game.seen(other, s));
        let drawn = sample(game.players[seat].opponents[at].tracked_head(seen.clone()), rng);
        let expected = log_density(prior(game, other).plain_head(seen_by_other), drawn.candidate);
        let actions = game.layout.with_action(&batch.actions, other, drawn.action);
        let of_others = others(game.players.len(), seat)
            .map(|other| game.own(&actions, other))
            .collect();
        let own = candidate_of(game.own(&batch.actions, seat));
        let log_pi = log_density(
            game.players[seat].policy.plain_head(beside(&seen, of_others)),
            own,
        );
        let value = game.players[seat].critic.value(s, actions);
        (drawn.log_density - expected - value + log_pi * self.settings.opponent_entropy_weight).mean()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::{coordination, opponent_modelling::trials};
    use contract::random::stream;
    use numerics::network::values;

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
        let got = values(learner.algorithm.clone().next_value(
            &mut learner.game,
            0,
            &batch,
            &mut stream(&["noise"]),
        ));
        let (s, rng) = (&batch.next_observations, &mut stream(&["noise"]));
        let player = &mut learner.game.players[0];
        let other = sample(player.opponents[0].plain_head(s.clone()), rng);
        let own = sample(
            player
                .policy
                .plain_head(Tensor::cat(vec![s.clone(), other.action.clone()], 1)),
            rng,
        );
        let q = player
            .critic
            .target_value(s, Tensor::cat(vec![own.action, other.action], 1));
        let seen = log_density(prior(&mut learner.game, 1).plain_head(s.clone()), other.candidate);
        let want = values(q - own.log_density * 0.3 + seen - other.log_density);
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
            let config = Config { settings, ..plain() };
            // Through the prior's density of the draw, the critic and the policy's condition.
            let opponent = |learner: &mut Learner<Config>, batch: &SeatBatch, rng: &mut Rng| {
                learner
                    .algorithm
                    .clone()
                    .opponent_loss(&mut learner.game, 0, (0, 1), batch, rng)
            };
            trials::assert_gradient(
                config.clone(),
                |learner| &mut learner.game.players[0].opponents[0],
                opponent,
            );
            let of_prior = |learner: &mut Learner<Config>, batch: &SeatBatch, _: &mut Rng| {
                Config {
                    prior_regularisation: 0.1,
                    ..plain()
                }
                .prior_loss(&mut learner.game, 0, batch)
            };
            trials::assert_gradient(config, |learner| prior(&mut learner.game, 0), of_prior);
        }
    }

    #[test]
    fn losses_reach_one_network_alone() {
        let mut learner = trials::learner(plain());
        let batch = trials::batch(&mut learner, 8);
        let config = learner.algorithm.clone();
        let loss = config.opponent_loss(&mut learner.game, 0, (0, 1), &batch, &mut stream(&["noise"]));
        trials::assert_reaches_only(&learner, &loss, "seat_0.opponent_0");
        let loss = config.prior_loss(&mut learner.game, 1, &batch);
        trials::assert_reaches_only(&learner, &loss, "seat_1.prior");
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
        let mut record = Recorder::default();
        let before = values(learner.algorithm.prior_loss(&mut learner.game, 0, &batch))[0];
        let config = learner.algorithm.clone();
        (0..100).for_each(|_| {
            config
                .improve_prior(&mut learner.game, 0, &batch, &mut record)
                .unwrap();
        });
        let after = values(config.prior_loss(&mut learner.game, 0, &batch))[0];
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
}
