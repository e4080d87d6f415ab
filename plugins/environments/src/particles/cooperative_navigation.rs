//! Cooperative navigation: three agents have to cover three landmarks without touching each other (thesis,
//! section 4.5.2; `simple_spread` in other programs).
//!
//! Agents and landmarks start anywhere in [-1, 1]^2; landmarks do not collide. With C = - sum over landmarks of
//! the distance to the nearest agent and K_i the number of agents that overlap agent i, [`RewardSharing`]
//! defines the reward of agent i. Where an agent collides with itself, K_i is one more: over 25 steps the
//! return of each agent contains a constant -25.

use super::{
    rules::{RewardSharing, Rules},
    scenario::{MetricValues, Scenario, metrics, pair, surroundings, surroundings_channels},
    world::{Body, World},
};
use contract::{Channel, Metric, PerEpisode};

const AGENTS: usize = 3;
const LANDMARKS: usize = 3;
const AGENT: Body = Body {
    radius: 0.15,
    collides: true,
    acceleration: None,
    top_speed: None,
};
const LANDMARK: Body = Body {
    radius: 0.05,
    collides: false,
    acceleration: None,
    top_speed: None,
};

/// The scenario of cooperative navigation.
pub(super) struct CooperativeNavigation {
    /// The rules of the variant.
    pub(super) rules: Rules,
}

impl CooperativeNavigation {
    /// Sum over landmarks of the distance to the nearest agent.
    fn landmark_distance(world: &World) -> f64 {
        let nearest = |landmark| {
            (0..AGENTS)
                .map(|agent| world.distance(agent, landmark))
                .fold(f64::INFINITY, f64::min)
        };
        (AGENTS..AGENTS + LANDMARKS).map(nearest).sum()
    }

    /// Number of agents that each agent overlaps.
    fn collisions(&self, world: &World) -> [f64; AGENTS] {
        let mut collisions = [if self.rules.collides_with_itself { 1.0 } else { 0.0 }; AGENTS];
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            if world.touching(a, b) {
                collisions[a] += 1.0;
                collisions[b] += 1.0;
            }
        }
        collisions
    }

    fn rewards(&self, distance: f64, collisions: [f64; AGENTS]) -> [f64; AGENTS] {
        let own = collisions.map(|count| -distance - count);
        match self.rules.sharing {
            RewardSharing::Own => own,
            RewardSharing::Sum => [own.iter().sum(); AGENTS],
            RewardSharing::Local { ratio } => {
                collisions.map(|count| (1.0 - ratio) * -distance - ratio * count)
            }
        }
    }
}

impl Scenario for CooperativeNavigation {
    fn agents(&self) -> usize {
        AGENTS
    }

    fn bodies(&self) -> Vec<Body> {
        [vec![AGENT; AGENTS], vec![LANDMARK; LANDMARKS]].concat()
    }

    fn landmark_range(&self) -> f64 {
        1.0
    }

    fn observation_channels(&self, agent: usize) -> Vec<Channel> {
        let messages = (0..AGENTS)
            .filter(|other| *other != agent)
            .flat_map(|other| pair(&format!("message_{other}"), 1.0));
        let silent = messages.map(|channel| channel.within(0.0, 0.0));
        surroundings_channels(agent, AGENTS, LANDMARKS)
            .into_iter()
            .chain(silent)
            .collect()
    }

    /// 18 entries: own velocity and position, relative positions of landmarks and other agents, and the others'
    /// messages, always zero.
    fn observe(&self, world: &World, agent: usize, seen: &mut Vec<f64>) {
        surroundings(world, agent, seen);
        seen.extend([0.0; 2 * (AGENTS - 1)]);
    }

    fn metrics(&self) -> Vec<Metric> {
        let about = "sum over landmarks of the distance to the nearest agent, mean over the steps";
        let distance = Metric::new("landmark_distance", "", about)
            .lower_is_better()
            .per_episode(PerEpisode::Mean);
        metrics().into_iter().chain([distance]).collect()
    }

    fn assess(&self, world: &World) -> (Vec<f64>, MetricValues) {
        let (distance, collisions) = (Self::landmark_distance(world), self.collisions(world));
        let rewards = self.rewards(distance, collisions);
        #[allow(clippy::cast_precision_loss, reason = "a handful of pairs")]
        let touching = world.touching_agents() as f64;
        let metrics = vec![
            ("total_return", rewards.iter().sum()),
            ("collisions", touching),
            ("landmark_distance", distance),
        ];
        (rewards.to_vec(), metrics)
    }
}
