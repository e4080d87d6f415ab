//! The part of the environment that depends on the task: bodies, observations, rewards and metrics.

use super::world::{Body, World, difference};
use contract::{Channel, Metric, PerEpisode};

/// A task of agents among landmarks.
pub(super) trait Scenario: Send {
    /// Number of agents.
    fn agents(&self) -> usize;

    /// Agents, then landmarks.
    fn bodies(&self) -> Vec<Body>;

    /// Largest distance of random landmarks from the axes.
    fn landmark_range(&self) -> f64;

    /// Channels of the values that [`Scenario::observe`] appends.
    fn observation_channels(&self, agent: usize) -> Vec<Channel>;

    /// Appends the observation of an agent.
    fn observe(&self, world: &World, agent: usize, seen: &mut Vec<f64>);

    /// One metric per value of [`Scenario::assess`] besides the rewards.
    fn metrics(&self) -> Vec<Metric>;

    /// Rewards of all agents, and the metrics, after a step.
    fn assess(&self, world: &World) -> (Vec<f64>, MetricValues);
}

/// Values of metrics under their names.
pub(super) type MetricValues = Vec<(&'static str, f64)>;

/// Appends the part of an observation that all tasks share: own velocity and position, then the relative
/// positions of the landmarks and the other agents.
pub(super) fn surroundings(world: &World, agent: usize, seen: &mut Vec<f64>) {
    let own = world.agents()[agent];
    seen.extend(own.velocity);
    seen.extend(own.position);
    let others = world
        .agents()
        .iter()
        .enumerate()
        .filter(|(other, _)| *other != agent)
        .map(|(_, motion)| motion);
    for motion in world.landmarks().iter().chain(others) {
        seen.extend(difference(motion.position, own.position));
    }
}

/// Channels of [`surroundings`].
pub(super) fn surroundings_channels(agent: usize, agents: usize, landmarks: usize) -> Vec<Channel> {
    let own = pair("velocity", 0.5).into_iter().chain(pair("position", 0.6));
    let of_landmarks = (0..landmarks).flat_map(|landmark| pair(&format!("to_landmark_{landmark}"), 0.8));
    let of_others = others(agent, agents).flat_map(|other| pair(&format!("to_agent_{other}"), 0.8));
    own.chain(of_landmarks).chain(of_others).collect()
}

/// All agents but one, in order.
pub(super) fn others(agent: usize, agents: usize) -> impl Iterator<Item = usize> {
    (0..agents).filter(move |other| *other != agent)
}

/// `<name>_x` and `<name>_y`, around 0.
pub(super) fn pair(name: &str, spread: f64) -> [Channel; 2] {
    ["x", "y"].map(|axis| Channel::new(format!("{name}_{axis}"), "").typical(0.0, spread))
}

/// Metrics that all tasks share.
pub(super) fn metrics() -> Vec<Metric> {
    vec![
        Metric::new("total_return", "", "sum of the rewards of all agents").per_episode(PerEpisode::Sum),
        Metric::new(
            "collisions",
            "",
            "pairs of agents that overlap, counted at every step",
        )
        .lower_is_better(),
    ]
}
