//! Predator and prey: three slow predators, agents 0 to 2, chase one fast prey, agent 3, around two obstacles
//! (thesis, section 4.5.3; `simple_tag` in other programs).
//!
//! Agents start anywhere in [-1, 1]^2, obstacles in [-0.9, 0.9]^2. With n the number of predators that touch
//! the prey, D the sum of their distances to it and s = 0.1 where rewards are shaped, else 0:
//!
//! * each predator earns 10 n - s D,
//! * the prey earns s D - 10 n - [`leaving`]`(|x|) - `[`leaving`]`(|y|)`, so that it does not run away for
//!   good.

use super::{
    rules::Rules,
    scenario::{MetricValues, Scenario, metrics, pair, surroundings, surroundings_channels},
    world::{Body, World},
};
use arithmetic::double::exp;
use contract::{Channel, Metric, PerEpisode};

const PREDATORS: usize = 3;
const PREY: usize = PREDATORS;
const AGENTS: usize = PREDATORS + 1;
const OBSTACLES: usize = 2;
const PREDATOR_BODY: Body = Body {
    radius: 0.075,
    collides: true,
    acceleration: Some(3.0),
    top_speed: Some(1.0),
};
const PREY_BODY: Body = Body {
    radius: 0.05,
    collides: true,
    acceleration: Some(4.0),
    top_speed: Some(1.3),
};
const OBSTACLE: Body = Body {
    radius: 0.2,
    collides: true,
    acceleration: None,
    top_speed: None,
};
/// Reward of every predator for each predator that touches the prey.
const CATCH: f64 = 10.0;
/// Reward of the prey per unit of distance to each predator, where rewards are shaped.
const SHAPING: f64 = 0.1;

/// The scenario of predator and prey.
pub(super) struct PredatorPrey {
    /// The rules of the variant.
    pub(super) rules: Rules,
}

impl PredatorPrey {
    /// Number of predators that touch the prey.
    fn catches(world: &World) -> f64 {
        (0..PREDATORS)
            .map(|predator| if world.touching(predator, PREY) { 1.0 } else { 0.0 })
            .sum()
    }

    /// Reward of the prey, and loss of each predator, by distance.
    fn shaping(&self, world: &World) -> f64 {
        if !self.rules.shaped_pursuit {
            return 0.0;
        }
        (0..PREDATORS)
            .map(|predator| SHAPING * world.distance(predator, PREY))
            .sum()
    }
}

/// Penalty of the prey per axis at the distance `x` from the middle.
fn leaving(x: f64) -> f64 {
    match x {
        x if x < 0.9 => 0.0,
        x if x < 1.0 => (x - 0.9) * 10.0,
        x => exp(2.0 * x - 2.0).min(10.0),
    }
}

impl Scenario for PredatorPrey {
    fn agents(&self) -> usize {
        AGENTS
    }

    fn bodies(&self) -> Vec<Body> {
        [
            vec![PREDATOR_BODY; PREDATORS],
            vec![PREY_BODY],
            vec![OBSTACLE; OBSTACLES],
        ]
        .concat()
    }

    fn landmark_range(&self) -> f64 {
        0.9
    }

    fn observation_channels(&self, agent: usize) -> Vec<Channel> {
        let mut channels = surroundings_channels(agent, AGENTS, OBSTACLES);
        if agent != PREY {
            channels.extend(pair(&format!("velocity_of_agent_{PREY}"), 0.8));
        }
        channels
    }

    /// Own velocity and position, relative positions of obstacles and other agents; predators also observe the
    /// prey's velocity: 16 entries for a predator, 14 for the prey.
    fn observe(&self, world: &World, agent: usize, seen: &mut Vec<f64>) {
        surroundings(world, agent, seen);
        if agent != PREY {
            seen.extend(world.agents()[PREY].velocity);
        }
    }

    fn metrics(&self) -> Vec<Metric> {
        let catches = Metric::new(
            "catches",
            "",
            "predators that touch the prey, counted at every step",
        )
        .lower_is_better();
        let about =
            "the prey's reward less that of one predator: higher is better for the prey (thesis, table 4.2)";
        metrics()
            .into_iter()
            .chain([
                catches,
                Metric::new("score", "", about).per_episode(PerEpisode::Sum),
                Metric::new(
                    "leaving_penalty",
                    "",
                    "what the prey loses by going far from the middle",
                )
                .per_episode(PerEpisode::Sum)
                .lower_is_better(),
            ])
            .collect()
    }

    fn assess(&self, world: &World) -> (Vec<f64>, MetricValues) {
        let (catches, shaping) = (Self::catches(world), self.shaping(world));
        let predator = -shaping + CATCH * catches;
        let leaving: f64 = world.agents()[PREY]
            .position
            .iter()
            .map(|entry| leaving(entry.abs()))
            .sum();
        let prey = shaping - CATCH * catches - leaving;
        #[allow(clippy::cast_precision_loss, reason = "a handful of pairs")]
        let touching = world.touching_agents() as f64;
        let rewards = vec![predator, predator, predator, prey];
        let metrics = vec![
            ("total_return", rewards.iter().sum()),
            ("collisions", touching),
            ("catches", catches),
            ("score", prey - predator),
            ("leaving_penalty", leaving),
        ];
        (rewards, metrics)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaving_costs_more_and_more() {
        for (x, cost) in [
            (0.5, 0.0),
            (0.95, 0.5),
            (1.0, 1.0),
            (1.2, 1.491_825),
            (2.0, 7.389_056),
            (2.2, 10.0),
            (9.0, 10.0),
        ] {
            assert!((leaving(x) - cost).abs() < 1e-6, "{x}: {}", leaving(x));
        }
    }
}
