//! Protocol `track`: an agent acts over whole episodes one after the other, as an estimator tracks unit after
//! unit; nothing is learned.
//!
//! Episodes are the environment's own, in order, if it has a list of them
//! ([`reset_to`](contract::Environment::reset_to)), and an agent with memory is restarted with each. They become the
//! final measurement, one episode each, and the trial leaves the environment's drawings of the last one.

use contract::{
    ArtifactKind, Config, Error, Metric, Protocol, Registry,
    protocol::{self, Measurement, Run, measure_alone},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of the `track` protocol.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EpisodeTracking {
    /// Number of episodes.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub episodes: u64,
    /// Number of its first episodes that are recorded step by step.
    pub trace_episodes: u64,
}

impl Default for EpisodeTracking {
    fn default() -> Self {
        Self {
            episodes: 10,
            trace_episodes: 0,
        }
    }
}

impl Config for EpisodeTracking {}

pub(super) fn register(registry: &mut Registry) {
    registry.protocol(
        "track",
        1,
        "Follow whole episodes one after the other, as an estimator follows unit after unit; nothing is learned.",
        |config: EpisodeTracking| config,
        |config| Ok(Box::new(config)),
    );
}

impl Protocol for EpisodeTracking {
    fn metrics(&self) -> Vec<Metric> {
        protocol::measurement_metrics()
    }

    fn leaves(&self) -> Vec<ArtifactKind> {
        vec![ArtifactKind::Graph, ArtifactKind::Images]
    }

    fn total_steps(&self) -> u64 {
        self.episodes
    }

    fn experience(&self) -> u64 {
        0
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        let all = Measurement::one_by_one(self.episodes, self.trace_episodes).with_drawings();
        measure_alone(run, std::iter::once(all), self.episodes)
    }
}

#[cfg(test)]
mod tests {
    use super::super::numbered_episodes::recorded;
    use contract::Phase;
    use serde_json::{Value, json};

    fn returns(agent: &str, protocol: &str, config: &Value) -> Vec<f64> {
        let record = recorded(agent, protocol, config, 0).unwrap();
        let of_returns = record
            .rows()
            .iter()
            .filter(|row| row.phase == Phase::Final && record.names()[usize::from(row.metric)] == "return");
        of_returns.map(|row| row.value).collect()
    }

    /// Episode k shows k three times, so that the sums are k, 2 k and 3 k.
    const ALONE: [f64; 4] = [0.0, 6.0, 12.0, 18.0];

    #[test]
    fn episodes_follow_each_other_whoever_plays() {
        let config = json!({ "episodes": 4 });
        assert_eq!(returns("remembers", "track", &config), ALONE);
        assert_eq!(returns("forgets", "track", &config), ALONE);
    }

    #[test]
    fn an_agent_that_remembers_plays_alone_wherever_it_is_measured() {
        let config = json!({ "steps": 0, "final_episodes": 4 });
        assert_eq!(returns("remembers", "train_evaluate", &config), ALONE);
    }
}
