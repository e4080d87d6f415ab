//! TDOM-AC: actor-critic whose opponent models follow the others' own improvement.
//!
//! Thesis, chapter 4 (equations are its); algorithm 2. The released code is that of
//! github.com/Yuantian013/TDOM-AC.
//!
//! | thesis | here | shape |
//! |---|---|---|
//! | s, a, r^i | [`SeatBatch`] | `[batch, ..]` |
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
    ActingPrediction, Algorithm, Conditioning, Game, Learner, Origin, SeatBatch, Settings, beside, decide,
    metrics as shared_metrics, others, policy_loss, predict,
};
use burn::tensor::Tensor;
use contract::{Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Preset, Recorder, Registry, Rng};
use numerics::squashed::sample;
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
        let next_value = self.next_value(game, seat, batch, rng);
        game.improve_critic(seat, batch, next_value, record)?;
        self.improve_opponents(game, seat, batch, rng, record)?;
        let (loss, log_density) = policy_loss(game, seat, batch, self.settings.policy_entropy_weight, rng);
        game.improve_policy(seat, &loss, log_density, record)
    }
}

impl Config {
    /// Value at s' in the target of eq. 4.13: `Q_target - alpha (log pi + sum log rho)`.
    fn next_value(&self, game: &mut Game, seat: usize, batch: &SeatBatch, rng: &mut Rng) -> Tensor<2> {
        let following = &batch.next_observations;
        let seen = game.seen(seat, following);
        let player = &mut game.players[seat];
        let draws = player.draw_others(&seen, rng);
        let predicted: Vec<_> = draws.iter().map(|draw| draw.action.clone()).collect();
        let own = sample(player.policy.plain_head(beside(&seen, predicted.clone())), rng);
        let log_density = draws
            .into_iter()
            .fold(own.log_density, |sum, draw| sum + draw.log_density);
        let actions = game.joint(seat, own.action, predicted);
        game.players[seat].critic.target_value(following, actions) - log_density * self.critic_entropy_weight
    }

    fn improve_opponents(
        &self,
        game: &mut Game,
        seat: usize,
        batch: &SeatBatch,
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let mut total = 0.0;
        for (at, other) in others(game.players.len(), seat).enumerate() {
            let loss = match self.opponent_objective {
                OpponentObjective::Aligned => self.aligned_loss(game, seat, (at, other), batch, rng),
                OpponentObjective::Neutralised => self.neutralised_loss(game, seat, at, batch, rng),
            };
            total += game.opponent_step(seat, at, &loss)?;
        }
        record.mean("opponent_loss", total);
        Ok(())
    }

    /// Eq. 4.22 for one opponent as a loss: `mean(alpha log rho - Q^j)`, with the stored actions of all seats
    /// but j.
    pub(crate) fn aligned_loss(
        &self,
        game: &mut Game,
        seat: usize,
        (at, other): (usize, usize),
        batch: &SeatBatch,
        rng: &mut Rng,
    ) -> Tensor<1> {
        let seen = game.seen(seat, &batch.observations);
        let drawn = sample(game.players[seat].opponents[at].tracked_head(seen), rng);
        let actions = game.layout.with_action(&batch.actions, other, drawn.action);
        let value = game.players[other].critic.value(&batch.observations, actions);
        (drawn.log_density * self.settings.opponent_entropy_weight - value).mean()
    }

    /// Eq. 4.17 for one opponent as a loss: `mean(alpha log rho - sum of all Q)`, with predicted actions of
    /// all others.
    pub(crate) fn neutralised_loss(
        &self,
        game: &mut Game,
        seat: usize,
        at: usize,
        batch: &SeatBatch,
        rng: &mut Rng,
    ) -> Tensor<1> {
        let seen = game.seen(seat, &batch.observations);
        let player = &mut game.players[seat];
        let mut predicted: Vec<_> = player
            .draw_others(&seen, rng)
            .into_iter()
            .map(|draw| draw.action)
            .collect();
        let drawn = sample(player.opponents[at].tracked_head(seen.clone()), rng);
        predicted[at] = drawn.action.clone().detach();
        let own = sample(
            player
                .policy
                .plain_head(beside(&seen, predicted.clone()).detach()),
            rng,
        )
        .action
        .detach();
        predicted[at] = drawn.action;
        let actions = game.joint(seat, own, predicted);
        let critics = game
            .players
            .iter()
            .map(|player| player.critic.value(&batch.observations, actions.clone()));
        let loss = critics.fold(
            drawn.log_density * self.settings.opponent_entropy_weight,
            |sum, value| sum - value,
        );
        loss.mean()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::{coordination, opponent_modelling::trials};
    use contract::random::stream;
    use numerics::{
        network::values,
        parameters::{parameters, with_parameters},
    };

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
        let got = values(learner.algorithm.clone().next_value(
            &mut learner.game,
            1,
            &batch,
            &mut stream(&["noise"]),
        ));
        let (player, s, rng) = (
            &mut learner.game.players[1],
            &batch.next_observations,
            &mut stream(&["noise"]),
        );
        let other = sample(player.opponents[0].plain_head(s.clone()), rng);
        let own = sample(
            player
                .policy
                .plain_head(Tensor::cat(vec![s.clone(), other.action.clone()], 1)),
            rng,
        );
        let q = player
            .critic
            .target_value(s, Tensor::cat(vec![other.action, own.action], 1));
        let want = values(q - (own.log_density + other.log_density) * 0.3);
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
            let aligned = |learner: &mut Learner<Config>, batch: &SeatBatch, rng: &mut Rng| {
                learner
                    .algorithm
                    .clone()
                    .aligned_loss(&mut learner.game, 0, (0, 1), batch, rng)
            };
            trials::assert_gradient(
                config.clone(),
                |learner| &mut learner.game.players[0].opponents[0],
                aligned,
            );
            let policy = |learner: &mut Learner<Config>, batch: &SeatBatch, rng: &mut Rng| {
                policy_loss(&mut learner.game, 0, batch, 0.7, rng).0
            };
            trials::assert_gradient(
                config.clone(),
                |learner| &mut learner.game.players[0].policy,
                policy,
            );
        }
    }

    #[test]
    fn losses_reach_one_network_alone() {
        let mut learner = learner(plain());
        let batch = trials::batch(&mut learner, 8);
        let config = learner.algorithm.clone();
        let loss = config.aligned_loss(&mut learner.game, 0, (0, 1), &batch, &mut stream(&["noise"]));
        trials::assert_reaches_only(&learner, &loss, "seat_0.opponent_0");
        let loss = config.neutralised_loss(&mut learner.game, 0, 0, &batch, &mut stream(&["noise"]));
        trials::assert_reaches_only(&learner, &loss, "seat_0.opponent_0");
        let (loss, _) = policy_loss(&mut learner.game, 0, &batch, 1.0, &mut stream(&["noise"]));
        trials::assert_reaches_only(&learner, &loss, "seat_0.policy");
    }

    /// Theorem 1: where the second critic is minus the first, the neutralised objective has the gradient of
    /// the entropy alone.
    #[test]
    fn opposed_critics_neutralise_the_gradient_of_eq_4_17_and_not_that_of_4_22() {
        let mut learner = learner(plain());
        let batch = trials::batch(&mut learner, 16);
        let mut opposed = parameters(learner.game.players[0].critic.network());
        opposed[4..]
            .iter_mut()
            .flat_map(|parameter| &mut parameter.values)
            .for_each(|x| *x = -*x);
        let network = with_parameters(learner.game.players[0].critic.network().clone(), &opposed).unwrap();
        learner.game.players[1]
            .critic
            .set_network(network, &learner.algorithm.settings);
        let rng = || stream(&["draws"]);
        let entropy = |learner: &mut Learner<Config>| {
            let mut rng = rng();
            learner.game.players[0].draw_others(&batch.observations, &mut rng);
            let head = learner.game.players[0].opponents[0].tracked_head(batch.observations.clone());
            trials::gradient(
                &learner.game.players[0].opponents[0],
                &sample(head, &mut rng).log_density.mean(),
            )
        };
        let config = learner.algorithm.clone();
        let neutralised = config.neutralised_loss(&mut learner.game, 0, 0, &batch, &mut rng());
        let neutralised = trials::gradient(&learner.game.players[0].opponents[0], &neutralised);
        let entropy_alone = entropy(&mut learner);
        assert!(trials::distance(&neutralised, &entropy_alone) < 1e-6 * (1.0 + trials::norm(&entropy_alone)));
        let aligned = config.aligned_loss(&mut learner.game, 0, (0, 1), &batch, &mut rng());
        let aligned = trials::gradient(&learner.game.players[0].opponents[0], &aligned);
        let head = learner.game.players[0].opponents[0].tracked_head(batch.observations.clone());
        let entropy_alone = sample(head, &mut rng()).log_density.mean();
        let entropy_alone = trials::gradient(&learner.game.players[0].opponents[0], &entropy_alone);
        assert!(trials::distance(&aligned, &entropy_alone) > 0.01);
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
