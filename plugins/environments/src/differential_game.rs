//! The differential game "max of two quadratics": one joint action, one shared reward, a trap (thesis,
//! section 4.5.1).
//!
//! Every player i chooses a_i in [-10, 10]; all earn
//!
//! r = max(f_1, f_2), f_1 = -0.8 sum_i (a_i + 5)^2 / w, f_2 = 10 - sum_i (a_i - 5)^2.
//!
//! f_1 has a wide hill of height 0 at a = (-5, ..., -5), f_2 a narrow one of height 10 at (5, ..., 5), with a
//! valley between them: from most points the gradient leads to the lower one.
//!
//! | symbol | here                                        | range |
//! |--------|---------------------------------------------|-------|
//! | a_i    | ten times `agent_i.unit_action`; traced as `agent_i.action` | [-10, 10] |
//! | w      | 9 for `scale: thesis`, where the division by 3 is squared; 3 for `rommeo` | |
//!
//! `zero_sum_game` has the same surface for two opposed players: the first earns r, the second -r. It has a
//! saddle point of height -15 at (5, 10), where no player gains by moving alone. The thesis has no such game,
//! but its theorem 1 is about them.
//!
//! An episode is one step and terminates. The observation is uninformative: each player observes the constant
//! 1, so that the joint observation of two players is [1, 1], as in the authors' public code.

use crate::unit_box::{self, LimitExcess};
use contract::{Channel, End, Environment, Error, Metric, PerEpisode, Rng, Seat, Space, StaticTrace, Step};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Factor from a seat's action to the player's action.
pub const ACTION_SCALE: f64 = 10.0;

/// Intervals of each axis of the surface: a multiple of 4, so that -5 and 5 are grid points.
const SURFACE_INTERVALS: u32 = 40;

/// The width of the wider hill.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// ((a + 5) / 3)^2, as in the thesis and its figures.
    #[default]
    Thesis,
    /// (a + 5)^2 / 3, as in the public code of ROMMEO.
    Rommeo,
}

/// Settings of the `differential_game` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DifferentialGameConfig {
    /// Number of players.
    #[schemars(range(min = 1, max = 1000))]
    pub players: usize,
    /// The width of the lower, misleading hill.
    #[schemars(extend("x-source" = "thesis, section 4.5.1"))]
    pub scale: Scale,
}

impl Default for DifferentialGameConfig {
    fn default() -> Self {
        Self {
            players: 2,
            scale: Scale::Thesis,
        }
    }
}

impl contract::Config for DifferentialGameConfig {}

/// Settings of the `zero_sum_game` environment.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ZeroSumConfig {
    /// The width of the wider hill.
    pub scale: Scale,
}

impl contract::Config for ZeroSumConfig {}

impl DifferentialGameConfig {
    /// The reward of every player (of the first, where they are opposed) for actions in [-10, 10], one per
    /// player.
    #[must_use]
    pub fn reward(&self, actions: &[f64]) -> f64 {
        let width = match self.scale {
            Scale::Thesis => 9.0,
            Scale::Rommeo => 3.0,
        };
        let squares = |center: f64| {
            actions
                .iter()
                .map(|action| (action - center) * (action - center))
                .sum::<f64>()
        };
        (-0.8 * squares(-5.0) / width).max(10.0 - squares(5.0))
    }

    /// The reward over two players' actions on a grid that contains the tops of both hills.
    fn surface(&self) -> StaticTrace {
        let at = |index: u32| ACTION_SCALE * (2.0 * f64::from(index) / f64::from(SURFACE_INTERVALS) - 1.0);
        let places = || (0..=SURFACE_INTERVALS).map(at);
        let points = places().flat_map(|first| places().map(move |second| (first, second)));
        StaticTrace {
            names: ["surface_action_0", "surface_action_1", "surface_reward"]
                .map(String::from)
                .into(),
            points: points
                .map(|(first, second)| vec![first, second, self.reward(&[first, second])])
                .collect(),
        }
    }
}

/// The environments `differential_game` and `zero_sum_game`.
#[derive(Debug)]
pub struct DifferentialGame {
    config: DifferentialGameConfig,
    /// Factor of each player's reward: 1, or -1 for an opposed player.
    shares: Vec<f64>,
    seats: Vec<Seat>,
    metrics: Vec<Metric>,
    /// The last joint action, in [-10, 10]; `NaN` before the first.
    actions: Vec<f64>,
    reward: f64,
}

/// Builds the environment; registered as `differential_game`.
///
/// # Errors
/// [`Error::Config`] for a game without players.
pub fn build(config: DifferentialGameConfig) -> Result<Box<dyn Environment>, Error> {
    if config.players == 0 {
        return Err(Error::config("players", "a game needs at least one player"));
    }
    Ok(Box::new(DifferentialGame::new(config)))
}

/// Builds two opposed players; registered as `zero_sum_game`.
///
/// # Errors
/// None.
pub fn build_zero_sum(config: ZeroSumConfig) -> Result<Box<dyn Environment>, Error> {
    let game = DifferentialGame::new(DifferentialGameConfig {
        players: 2,
        scale: config.scale,
    });
    Ok(Box::new(DifferentialGame {
        shares: vec![1.0, -1.0],
        ..game
    }))
}

impl DifferentialGame {
    fn new(config: DifferentialGameConfig) -> Self {
        let seat = |player: usize| Seat {
            name: format!("agent_{player}"),
            observation: Space::Box(vec![Channel::new("constant", "").within(1.0, 1.0)]),
            action: Space::Box(vec![
                Channel::new("unit_action", "")
                    .within(-1.0, 1.0)
                    .typical(0.0, 0.6),
            ]),
        };
        let last = |name: String, about: &str| Metric::new(&name, "", about).per_episode(PerEpisode::Last);
        let about = "reward of every player for the joint action; of the first, where players are opposed";
        let joint_reward = last("joint_reward".into(), about);
        let action = |player: usize| {
            last(
                format!("action_{player}"),
                "action of this player, in [-10, 10]; 5 is best together",
            )
        };
        Self {
            seats: (0..config.players).map(seat).collect(),
            metrics: [joint_reward]
                .into_iter()
                .chain((0..config.players).map(action))
                .collect(),
            actions: vec![f64::NAN; config.players],
            reward: f64::NAN,
            shares: vec![1.0; config.players],
            config,
        }
    }

    fn observe(&self) -> Vec<Vec<f64>> {
        vec![vec![1.0]; self.config.players]
    }

    fn forget(&mut self) {
        self.actions.fill(f64::NAN);
        self.reward = f64::NAN;
    }

    /// Stores the joint action.
    fn read(&mut self, actions: &[Vec<f64>]) -> Result<(), Error> {
        unit_box::check_seats(actions, self.config.players)?;
        for (player, (given, action)) in actions.iter().zip(&mut self.actions).enumerate() {
            let [entry] = unit_box::checked(given, player, ["unit_action"], LimitExcess::Refused)?;
            *action = ACTION_SCALE * entry;
        }
        Ok(())
    }
}

impl Environment for DifferentialGame {
    fn seats(&self) -> &[Seat] {
        &self.seats
    }

    fn metrics(&self) -> &[Metric] {
        &self.metrics
    }

    fn reset(&mut self, _rng: &mut Rng) -> Result<Vec<Vec<f64>>, Error> {
        self.forget();
        Ok(self.observe())
    }

    fn step(&mut self, actions: &[Vec<f64>], _rng: &mut Rng) -> Result<Step, Error> {
        self.read(actions)?;
        self.reward = self.config.reward(&self.actions);
        let rewards = self.shares.iter().map(|share| share * self.reward).collect();
        let actions = self.actions.iter().enumerate();
        Ok(Step::new(self.observe(), rewards, Some(End::Terminated))
            .record("joint_reward", self.reward)
            .record_all(actions.map(|(player, action)| (format!("action_{player}"), *action))))
    }

    fn state_channels(&self) -> Vec<Channel> {
        (0..self.config.players)
            .map(|player| Channel::new(format!("agent_{player}.constant"), "").within(1.0, 1.0))
            .collect()
    }

    fn state(&self) -> Vec<f64> {
        vec![1.0; self.config.players]
    }

    fn trace_channels(&self) -> Vec<Channel> {
        let action = |player: usize| {
            Channel::new(format!("agent_{player}.action"), "").within(-ACTION_SCALE, ACTION_SCALE)
        };
        (0..self.config.players)
            .map(action)
            .chain([Channel::new("joint_reward", "")])
            .collect()
    }

    fn trace(&self) -> Vec<f64> {
        self.actions.iter().copied().chain([self.reward]).collect()
    }

    fn static_trace(&self) -> Option<StaticTrace> {
        (self.config.players == 2).then(|| self.config.surface())
    }

    fn snapshot(&self) -> serde_json::Value {
        serde_json::Value::Null
    }

    fn restore(&mut self, _snapshot: &serde_json::Value) -> Result<(), Error> {
        // An episode is one step: between steps there is no state to restore.
        self.forget();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn config(scale: Scale) -> DifferentialGameConfig {
        DifferentialGameConfig {
            scale,
            ..Default::default()
        }
    }

    #[test]
    fn the_hills_and_the_valley() {
        for (scale, actions, reward) in [
            (Scale::Thesis, [5.0, 5.0], 10.0),
            (Scale::Thesis, [-5.0, -5.0], 0.0),
            (Scale::Thesis, [0.0, 0.0], -40.0 / 9.0),
            (Scale::Rommeo, [0.0, 0.0], -40.0 / 3.0),
            (Scale::Thesis, [4.0, 6.0], 8.0),
            (Scale::Rommeo, [-5.0, -2.0], -2.4),
        ] {
            assert!(
                (config(scale).reward(&actions) - reward).abs() < 1e-12,
                "{scale:?} {actions:?}"
            );
        }
    }

    #[test]
    fn the_surface_holds_both_tops() {
        let surface = DifferentialGame::new(config(Scale::Thesis))
            .static_trace()
            .unwrap();
        assert_eq!(surface.points.len(), 41 * 41);
        for point in [
            [5.0, 5.0, 10.0],
            [-5.0, -5.0, 0.0],
            [-10.0, 10.0, -0.8 * 250.0 / 9.0],
        ] {
            assert!(surface.points.contains(&point.to_vec()), "{point:?}");
        }
        assert!(
            DifferentialGame::new(DifferentialGameConfig {
                players: 3,
                ..config(Scale::Thesis)
            })
            .static_trace()
            .is_none()
        );
    }

    #[test]
    fn one_step_is_an_episode() {
        let mut game = DifferentialGame::new(DifferentialGameConfig {
            players: 3,
            scale: Scale::Thesis,
        });
        let mut rng = contract::random::stream(&[]);
        assert_eq!(game.reset(&mut rng).unwrap(), vec![vec![1.0]; 3]);
        assert!(game.trace().iter().all(|value| value.is_nan()));
        let step = game.step(&[vec![0.5], vec![0.4], vec![0.6]], &mut rng).unwrap();
        assert_eq!((&step.rewards, step.end), (&vec![8.0; 3], Some(End::Terminated)));
        let metrics = ["action_0", "action_1", "action_2", "joint_reward"];
        assert_eq!(
            metrics.map(|metric| step.metric(metric).unwrap()),
            [5.0, 4.0, 6.0, 8.0]
        );
        assert_eq!(game.trace(), [5.0, 4.0, 6.0, 8.0]);
    }

    #[test]
    fn opposed_players_gain_nothing_by_leaving_the_saddle_alone() {
        let mut game = build_zero_sum(ZeroSumConfig::default()).unwrap();
        let mut rng = contract::random::stream(&[]);
        let step = game.step(&[vec![0.5], vec![1.0]], &mut rng).unwrap();
        assert_eq!(step.rewards, [-15.0, 15.0]);
        for place in (-100..=100).map(|at| f64::from(at) / 100.0) {
            let rewards = |actions: [f64; 2], game: &mut dyn Environment| {
                game.step(
                    &actions.map(|action| vec![action]),
                    &mut contract::random::stream(&[]),
                )
                .unwrap()
                .rewards
            };
            assert!(
                rewards([place, 1.0], &mut *game)[0] <= -15.0 && rewards([0.5, place], &mut *game)[1] <= 15.0,
                "{place}"
            );
        }
    }

    #[test]
    fn an_invalid_joint_action_is_refused() {
        let mut game = DifferentialGame::new(config(Scale::Thesis));
        let mut rng = contract::random::stream(&[]);
        for actions in [
            vec![vec![0.0]],
            vec![vec![0.0], vec![1.1]],
            vec![vec![f64::NAN], vec![0.0]],
            vec![vec![0.0], vec![]],
        ] {
            assert!(matches!(game.step(&actions, &mut rng), Err(Error::Action { .. })));
        }
        assert!(
            build(DifferentialGameConfig {
                players: 0,
                ..config(Scale::Thesis)
            })
            .is_err()
        );
    }

    proptest! {
        #[test]
        fn ten_is_the_most(actions in prop::collection::vec(-10.0_f64..10.0, 1..5)) {
            for scale in [Scale::Thesis, Scale::Rommeo] {
                prop_assert!(config(scale).reward(&actions) <= 10.0);
                prop_assert!(config(scale).reward(&actions) >= config(Scale::Rommeo).reward(&actions));
            }
        }
    }
}
