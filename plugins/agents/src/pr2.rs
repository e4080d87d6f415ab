//! PR2: probabilistic recursive reasoning, a policy that improves through its opponents' predicted answers to
//! its own action.
//!
//! Wen et al. 2019, "Probabilistic recursive reasoning for multi-agent reinforcement learning", ICLR; thesis,
//! section 4.5, as a baseline with an entropy term, in the form of its released code
//! (github.com/Yuantian013/TDOM-AC).
//!
//! | paper | here | shape |
//! |---|---|---|
//! | pi(a^i given s) | `policy` | head `[batch, 2 n_i]` |
//! | rho(a^-i given s, a^i) | `opponents`, `opponent_samples` draws of each | heads `[batch, 2 n_j]` |
//! | Q^i(s, a^i, a^-i) | `critic` | `[batch, 1]` |
//! | alpha | `policy_entropy_weight`, `opponent_entropy_weight`, `critic_entropy_weight` | scalars |
//!
//! Order of an update, per seat on a minibatch of its own: critic, opponent models, policy.
//! - Critic: towards `r + gamma (1 - d) [mean over the draws of Q_target - alpha log pi]` at a^i drawn from
//!   pi(s').
//! - Opponent model of seat o: `mean(alpha log rho - Q^i)` with o's stored action replaced by its answer to
//!   the own stored one.
//! - Policy: `mean(alpha log pi - mean over the draws of Q^i)`; the gradient also flows through the answers
//!   into a^i.
//!
//! The heads of the opponent models do not depend on the draw, so they are evaluated once for all draws; the
//! critic is evaluated once per draw, since its inputs are normalised draw by draw. The released code
//! subtracts from Q^i in the opponent models' loss an estimate of its mean, a constant without a gradient,
//! which is left out here.
//!
//! Variants of the released code, all with Gaussian opponent models instead of the paper's sampler trained by
//! Stein gradients: `differential_game` is `pr2.py`; `released_code` is `pr2_comp.py` (which its tag script
//! imports); `released_code_navigation` is `pr2_v1.py`, where opponent models minimise the seat's own value
//! and the critic bootstraps from one mean over the whole batch. `original` leaves the entropy of the own
//! policy out, as the paper does; the opponent models keep theirs, which makes them soft posteriors.
//! `joined_draws: log_mean_exp` is the paper's soft maximum over the draws.
//!
//! Departures from the thesis' text: those of [`crate::tdom_ac`].
//!
//! Metrics: those of [`crate::tdom_ac`] with the losses above.

use crate::shared::opponent_modelling::{
    Algorithm, Conditioning, Game, Learner, Origin, Player, SeatBatch, Settings, beside,
    metrics as shared_metrics, others,
};
use burn::tensor::Tensor;
use contract::{Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Preset, Recorder, Registry, Rng};
use numerics::squashed::{mean_action, sample};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

const NAME: &str = "pr2";

/// Value after a transition in the critic's target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Bootstrap {
    /// The value of the transition's own next state.
    #[default]
    PerState,
    /// The mean value of the next states of the whole batch.
    BatchMean,
}

/// Direction in which the opponent models move the seat's own value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OpponentObjective {
    /// Up: benevolent opponents.
    #[default]
    Maximise,
    /// Down: the worst case.
    Minimise,
}

/// Aggregation of the values of several draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JoinedDraws {
    /// Their mean.
    #[default]
    Mean,
    /// `alpha ln mean exp(Q / alpha)`, with the entropy weight of the objective; the mean where that is 0.
    LogMeanExp,
}

/// Hyper-parameters. The defaults are those of the released code's latest variant in the particle tasks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Draws from the opponent models per state, in the critic's target and the policy's objective.
    #[schemars(range(min = 1, max = 1024), extend("x-source" = "released code: 1 in predator and prey, else \
                                                                16"))]
    pub opponent_samples: usize,
    /// Value after a transition in the critic's target.
    #[schemars(extend("x-source" = "released code: per_state in predator and prey, else batch_mean"))]
    pub bootstrap: Bootstrap,
    /// Direction in which the opponent models move the seat's own value.
    #[schemars(extend("x-source" = "Wen et al. 2019; released code: minimise in cooperative navigation"))]
    pub opponent_objective: OpponentObjective,
    /// Aggregation of the values of several draws.
    #[schemars(extend("x-source" = "released code; Wen et al. 2019: log_mean_exp"))]
    pub joined_draws: JoinedDraws,
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
            opponent_samples: 1,
            bootstrap: Bootstrap::PerState,
            opponent_objective: OpponentObjective::Maximise,
            joined_draws: JoinedDraws::Mean,
            critic_entropy_weight: 1.0,
            settings: Settings::default(),
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let own = |samples: u8, bootstrap: &str, objective: &str| {
            json!({
                "critic_entropy_weight": 1.0, "opponent_samples": samples, "bootstrap": bootstrap,
                "opponent_objective": objective, "joined_draws": "mean",
            })
        };
        let mut original = own(16, "per_state", "maximise");
        original["policy_entropy_weight"] = 0.0.into();
        original["critic_entropy_weight"] = 0.0.into();
        let navigation = own(16, "batch_mean", "minimise");
        vec![
            Origin::Text.preset(
                "thesis",
                "thesis, section 4.5, as printed",
                own(16, "per_state", "maximise"),
            ),
            Origin::ParticleCode.preset(
                "original",
                "Wen et al. 2019: no entropy of the own policy",
                original,
            ),
            Origin::ParticleCode.preset(
                "released_code",
                "released code, predator and prey (pr2_comp.py)",
                own(1, "per_state", "maximise"),
            ),
            Origin::ParticleCode.preset(
                "released_code_navigation",
                "released code, cooperative navigation (pr2_v1.py)",
                navigation,
            ),
            Origin::GameCode.preset(
                "differential_game",
                "released code, differential game (pr2.py)",
                own(16, "batch_mean", "maximise"),
            ),
        ]
    }
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "actor-critic for several seats that reasons through the others' answers to its own action";
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
    const CONDITIONING: Conditioning = Conditioning::PredictionOnAction;
    const HAS_PRIOR: bool = false;

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
        let head = game.players[seat]
            .policy
            .acting_head(game.seen(seat, observations));
        match mode {
            Mode::Train => sample(head, rng).action,
            Mode::Evaluate => mean_action(head),
        }
    }

    fn predict(&self, game: &Game, seat: usize, observations: &Tensor<2>, actions: &Tensor<2>) -> Tensor<2> {
        let input = beside(&game.seen(seat, observations), vec![game.own(actions, seat)]);
        let models = game.players[seat].opponents.iter();
        Tensor::cat(
            models
                .map(|model| mean_action(model.acting_head(input.clone())))
                .collect(),
            1,
        )
    }

    fn improve(
        &self,
        game: &mut Game,
        seat: usize,
        batch: &SeatBatch,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let next_value = self.next_value(game, seat, batch, rng);
        game.improve_critic(seat, batch, next_value, record)?;
        let mut total = 0.0;
        for (at, other) in others(game.players.len(), seat).enumerate() {
            let loss = self.opponent_loss(game, seat, (at, other), batch, rng);
            total += game.opponent_step(seat, at, &loss)?;
        }
        record.mean("opponent_loss", total);
        let (loss, log_density) = self.policy_loss(game, seat, batch, rng);
        game.improve_policy(seat, &loss, log_density, record)
    }
}

impl Config {
    /// Value at s' in the target: `Q_target - alpha log pi`, aggregated over the draws and, for `batch_mean`,
    /// over the batch.
    fn next_value(&self, game: &mut Game, seat: usize, batch: &SeatBatch, rng: &mut Rng) -> Tensor<2> {
        let following = &batch.next_observations;
        let seen = game.seen(seat, following);
        let own = sample(game.players[seat].policy.plain_head(seen.clone()), rng);
        let answers = self.answers(&mut game.players[seat], &seen, &own.action, rng);
        let critic = &game.players[seat].critic;
        let values = answers
            .into_iter()
            .map(|others| critic.target_value(following, game.joint(seat, own.action.clone(), others)));
        let weight = self.critic_entropy_weight;
        let value = self.joined(values.collect(), weight) - own.log_density * weight;
        match self.bootstrap {
            Bootstrap::PerState => value,
            Bootstrap::BatchMean => value.zeros_like() + value.mean().unsqueeze(),
        }
    }

    /// `mean(alpha log rho - Q^i)`, or with `+ Q^i`, at the answer of one opponent to the own stored action.
    fn opponent_loss(
        &self,
        game: &mut Game,
        seat: usize,
        (at, other): (usize, usize),
        batch: &SeatBatch,
        rng: &mut Rng,
    ) -> Tensor<1> {
        let input = beside(
            &game.seen(seat, &batch.observations),
            vec![game.own(&batch.actions, seat)],
        );
        let drawn = sample(game.players[seat].opponents[at].tracked_head(input), rng);
        let actions = game.layout.with_action(&batch.actions, other, drawn.action);
        let value = game.players[seat].critic.value(&batch.observations, actions);
        let entropy = drawn.log_density * self.settings.opponent_entropy_weight;
        match self.opponent_objective {
            OpponentObjective::Maximise => (entropy - value).mean(),
            OpponentObjective::Minimise => (entropy + value).mean(),
        }
    }

    /// `mean(alpha log pi - Q^i)` with the answers to the drawn action, and `log pi` `[batch, 1]`.
    fn policy_loss(
        &self,
        game: &mut Game,
        seat: usize,
        batch: &SeatBatch,
        rng: &mut Rng,
    ) -> (Tensor<1>, Tensor<2>) {
        let s = &batch.observations;
        let seen = game.seen(seat, s);
        let own = sample(game.players[seat].policy.tracked_head(seen.clone()), rng);
        let answers = self.answers(&mut game.players[seat], &seen, &own.action, rng);
        let critic = &game.players[seat].critic;
        let values = answers
            .into_iter()
            .map(|others| critic.value(s, game.joint(seat, own.action.clone(), others)));
        let weight = self.settings.policy_entropy_weight;
        let value = self.joined(values.collect(), weight);
        ((own.log_density.clone() * weight - value).mean(), own.log_density)
    }

    /// Answers of the opponents to an action: one action of each per draw. Gradients flow through them into
    /// the action alone.
    fn answers(
        &self,
        player: &mut Player,
        observations: &Tensor<2>,
        action: &Tensor<2>,
        rng: &mut Rng,
    ) -> Vec<Vec<Tensor<2>>> {
        let input = beside(observations, vec![action.clone()]);
        let heads: Vec<_> = player
            .opponents
            .iter_mut()
            .map(|model| model.plain_head(input.clone()))
            .collect();
        let mut answer = |head: &Tensor<2>| sample(head.clone(), rng).action;
        (0..self.opponent_samples)
            .map(|_| heads.iter().map(&mut answer).collect())
            .collect()
    }

    #[allow(clippy::cast_precision_loss, reason = "a number of draws is far below 2^52")]
    fn joined(&self, values: Vec<Tensor<2>>, entropy_weight: f64) -> Tensor<2> {
        let (n, values) = (values.len() as f64, Tensor::cat(values, 1));
        if self.joined_draws == JoinedDraws::Mean || entropy_weight == 0.0 {
            return values.mean_dim(1);
        }
        let scaled = values / entropy_weight;
        // The largest value is subtracted so that no exponential overflows.
        let greatest = scaled.clone().detach().max_dim(1);
        ((scaled - greatest.clone()).exp().sum_dim(1).log() + greatest - n.ln()) * entropy_weight
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::{coordination, opponent_modelling::trials};
    use contract::random::stream;
    use numerics::network::{matrix, values};

    fn tiny() -> Config {
        Config {
            opponent_samples: 2,
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
        for bootstrap in [Bootstrap::PerState, Bootstrap::BatchMean] {
            let mut learner = trials::learner(Config {
                critic_entropy_weight: 0.3,
                bootstrap,
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
            let own = sample(player.policy.plain_head(s.clone()), rng);
            let head = player.opponents[0].plain_head(Tensor::cat(vec![s.clone(), own.action.clone()], 1));
            let mut q = || {
                let answer = sample(head.clone(), rng).action;
                player
                    .critic
                    .target_value(s, Tensor::cat(vec![own.action.clone(), answer], 1))
            };
            let mut want = values((q() + q()) * 0.5 - own.log_density.clone() * 0.3);
            if bootstrap == Bootstrap::BatchMean {
                want = vec![want.iter().sum::<f32>() / 8.0; 8];
            }
            assert!(
                got.iter().zip(&want).all(|(got, want)| (got - want).abs() < 1e-5),
                "{got:?} {want:?}"
            );
        }
    }

    #[test]
    fn draws_are_joined_by_hand() {
        let join = |joined_draws, weight| {
            let draws = vec![matrix(vec![1.0, 0.0], 1), matrix(vec![3.0, 0.0], 1)];
            values(
                Config {
                    joined_draws,
                    ..plain()
                }
                .joined(draws, weight),
            )
        };
        assert_eq!(join(JoinedDraws::Mean, 2.0), [2.0, 0.0]);
        assert_eq!(join(JoinedDraws::LogMeanExp, 0.0), [2.0, 0.0]);
        let soft = join(JoinedDraws::LogMeanExp, 2.0);
        let want = 2.0 * (f32::midpoint(0.5f32.exp(), 1.5f32.exp())).ln();
        assert!(
            (soft[0] - want).abs() < 1e-5 && soft[1].abs() < 1e-6,
            "{soft:?} {want}"
        );
    }

    /// With one critic and one set of draws, the recursion through the opponents' answers is part of the
    /// gradient.
    #[test]
    fn gradients_agree_with_finite_differences_through_the_answers() {
        for (input_normalisation, joined_draws) in
            [(false, JoinedDraws::Mean), (true, JoinedDraws::LogMeanExp)]
        {
            let settings = Settings {
                input_normalisation,
                ..trials::plain()
            };
            let config = Config {
                joined_draws,
                settings,
                ..plain()
            };
            let policy = |learner: &mut Learner<Config>, batch: &SeatBatch, rng: &mut Rng| {
                learner
                    .algorithm
                    .clone()
                    .policy_loss(&mut learner.game, 0, batch, rng)
                    .0
            };
            trials::assert_gradient(
                config.clone(),
                |learner| &mut learner.game.players[0].policy,
                policy,
            );
            let opponent = |learner: &mut Learner<Config>, batch: &SeatBatch, rng: &mut Rng| {
                learner
                    .algorithm
                    .clone()
                    .opponent_loss(&mut learner.game, 0, (0, 1), batch, rng)
            };
            trials::assert_gradient(
                config,
                |learner| &mut learner.game.players[0].opponents[0],
                opponent,
            );
        }
    }

    #[test]
    fn losses_reach_one_network_alone() {
        let mut learner = trials::learner(plain());
        let batch = trials::batch(&mut learner, 8);
        let config = learner.algorithm.clone();
        let loss = config.opponent_loss(&mut learner.game, 0, (0, 1), &batch, &mut stream(&["noise"]));
        trials::assert_reaches_only(&learner, &loss, "seat_0.opponent_0");
        let (loss, _) = config.policy_loss(&mut learner.game, 1, &batch, &mut stream(&["noise"]));
        trials::assert_reaches_only(&learner, &loss, "seat_1.policy");
    }

    #[test]
    fn a_pessimist_turns_the_gradient_of_the_value() {
        let mut learner = trials::learner(Config {
            settings: Settings {
                opponent_entropy_weight: 0.0,
                ..trials::plain()
            },
            ..plain()
        });
        let batch = trials::batch(&mut learner, 8);
        let mut gradient = |opponent_objective| {
            let config = Config {
                opponent_objective,
                ..learner.algorithm.clone()
            };
            let loss = config.opponent_loss(&mut learner.game, 0, (0, 1), &batch, &mut stream(&["noise"]));
            trials::gradient(&learner.game.players[0].opponents[0], &loss)
        };
        let (up, down) = (
            gradient(OpponentObjective::Maximise),
            gradient(OpponentObjective::Minimise),
        );
        assert!(trials::norm(&up) > 1e-3 && up.iter().zip(&down).all(|(up, down)| *up == -down));
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
