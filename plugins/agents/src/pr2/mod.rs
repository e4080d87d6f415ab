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

#[cfg(test)]
mod tests;

use crate::shared::opponent_modelling::{
    Algorithm, Conditioning, Game, Learner, Origin, SeatUpdate, Settings, acted, beside,
    metrics as shared_metrics, predict,
};
use contract::{Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Preset, Registry, Rng};
use numerics::equations::squashed::{Correction, sample};
use plan::Expression;
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

    fn decide<'e>(
        &self,
        game: &Game,
        seat: usize,
        observations: Expression<'e>,
        mode: Mode,
    ) -> Expression<'e> {
        let policy = &game.players[seat].policy;
        acted(policy.acting_head(game.seen(seat, observations)), mode)
    }

    fn predict<'e>(
        &self,
        game: &Game,
        seat: usize,
        observations: Expression<'e>,
        actions: Expression<'e>,
    ) -> Expression<'e> {
        let own = game.own(actions, seat);
        predict(game, seat, beside(game.seen(seat, observations), &[own]))
    }

    fn improve(&self, update: SeatUpdate<'_, '_>) {
        update.improve_critic(self.next_value(update));
        update.improve_opponents(|at, other| self.opponent_loss(update, at, other));
        let (loss, log_density) = self.policy_loss(update);
        update.improve_policy(loss, log_density);
    }
}

impl Config {
    /// Value at s' in the target: `Q_target - alpha log pi`, aggregated over the draws and, for `batch_mean`,
    /// over the batch.
    fn next_value<'e>(&self, update: SeatUpdate<'_, 'e>) -> Expression<'e> {
        let (player, following) = (update.player(), update.batch.next_observations);
        let seen = update.seen(following);
        let own = sample(player.policy.head(seen), Correction::Softened);
        let answers = self.answers(update, seen, own.action).into_iter();
        let values = answers.map(|others| {
            let actions = update.joint(own.action, others);
            player.critic.target_value(following, actions)
        });
        let weight = self.critic_entropy_weight;
        let value = self.joined(&values.collect::<Vec<_>>(), weight) - own.log_density * weight;
        match self.bootstrap {
            Bootstrap::PerState => value,
            Bootstrap::BatchMean => value.mean(),
        }
    }

    /// `mean(alpha log rho - Q^i)`, or with `+ Q^i`, at the answer of one opponent to the own stored action.
    fn opponent_loss<'e>(&self, update: SeatUpdate<'_, 'e>, at: usize, other: usize) -> Expression<'e> {
        let (player, observations) = (update.player(), update.batch.observations);
        let own = update.game.own(update.batch.actions, update.seat);
        let head = player.opponents[at].head(beside(update.seen(observations), &[own]));
        let drawn = sample(head, Correction::Softened);
        let actions = update.exchanged(other, drawn.action);
        let value = player.critic.value(observations, actions);
        let entropy = drawn.log_density * self.settings.opponent_entropy_weight;
        match self.opponent_objective {
            OpponentObjective::Maximise => (entropy - value).mean(),
            OpponentObjective::Minimise => (entropy + value).mean(),
        }
    }

    /// `mean(alpha log pi - Q^i)` with the answers to the drawn action, and `log pi` `[batch, 1]`.
    fn policy_loss<'e>(&self, update: SeatUpdate<'_, 'e>) -> (Expression<'e>, Expression<'e>) {
        let (player, observations) = (update.player(), update.batch.observations);
        let seen = update.seen(observations);
        let own = sample(player.policy.head(seen), Correction::Softened);
        let answers = self.answers(update, seen, own.action).into_iter();
        let values = answers.map(|others| {
            let actions = update.joint(own.action, others);
            player.critic.value(observations, actions)
        });
        let weight = self.settings.policy_entropy_weight;
        let value = self.joined(&values.collect::<Vec<_>>(), weight);
        ((own.log_density * weight - value).mean(), own.log_density)
    }

    /// Answers of the opponents to an action: one action of each per draw.
    fn answers<'e>(
        &self,
        update: SeatUpdate<'_, 'e>,
        seen: Expression<'e>,
        action: Expression<'e>,
    ) -> Vec<Vec<Expression<'e>>> {
        let (models, input) = (&update.player().opponents, beside(seen, &[action]));
        let heads: Vec<_> = models.iter().map(|model| model.head(input)).collect();
        let answer = |head: &Expression<'e>| sample(*head, Correction::Softened).action;
        (0..self.opponent_samples)
            .map(|_| heads.iter().map(answer).collect())
            .collect()
    }

    /// Values of several draws `[batch, 1]` as one.
    #[allow(clippy::cast_precision_loss, reason = "a number of draws is far below 2^52")]
    fn joined<'e>(&self, values: &[Expression<'e>], entropy_weight: f64) -> Expression<'e> {
        let (n, values) = (values.len() as f64, values[0].equations().join(values));
        if self.joined_draws == JoinedDraws::Mean || entropy_weight == 0.0 {
            return values.mean_columns();
        }
        let scaled = values / entropy_weight;
        // The largest value is subtracted so that no exponential overflows.
        let greatest = scaled.largest_of_columns();
        ((scaled - greatest).exp().sum_columns().ln() + greatest - n.ln()) * entropy_weight
    }
}
