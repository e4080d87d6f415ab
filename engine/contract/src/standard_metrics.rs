//! Metrics that protocols record whatever the environment and the agent.

use crate::{Metric, PerEpisode};

/// The metric of agents that learn: the number of updates made so far. Agents that do not learn record none.
pub const UPDATES: &str = "updates";
/// How far an agent trained that trains itself: the last step for which it gave a value.
pub const OWN_STEPS: &str = "own_steps";

/// The metric of studies that say what success is: 1 for a seed with success, 0 for one without.
pub const SUCCESS: &str = "success";

/// The metric that every measured episode records once: how many decisions it took.
pub const EPISODE_LENGTH: &str = "episode_length";

/// What [`OWN_STEPS`] says, for names, units and directions.
#[must_use]
pub fn own_steps_metric() -> Metric {
    Metric::new(
        OWN_STEPS,
        "steps",
        "the last step for which an agent that trains itself gave a value",
    )
    .per_episode(PerEpisode::Last)
}

/// What [`UPDATES`] says, for names, units and directions.
#[must_use]
pub fn updates_metric() -> Metric {
    Metric::new(UPDATES, "", "updates that the agent made so far").per_episode(PerEpisode::Last)
}
