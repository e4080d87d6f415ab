//! Metrics that protocols record for every environment and agent.

use crate::{Metric, PerEpisode};
use serde::Serialize;
use serde_json::Value;

/// The metric of agents that learn: the number of updates made so far. Agents that do not learn record none.
pub const UPDATES: &str = "updates";
/// The metric of agents that train themselves: the last step for which they gave a value.
pub const OWN_STEPS: &str = "own_steps";

/// The metric of studies that define success: 1 for a seed with success, 0 for one without.
pub const SUCCESS: &str = "success";

/// The metric that every measured episode records once: the number of its decisions.
pub const EPISODE_LENGTH: &str = "episode_length";

/// The metric that every trial has when results are read: its duration in seconds.
pub const WALL_TIME: &str = "wall_time";

/// The metric that trials of agents that learn have when results are read: the seconds of the trial per update.
pub const TIME_PER_UPDATE: &str = "time_per_update";

/// The metric that trials which measure episodes at their end have when results are read: the seconds that the agent
/// took for a decision there.
pub const TIME_PER_DECISION: &str = "time_per_decision";

/// The sentence that is printed wherever a time is shown.
pub const TIMES_ARE_OF_THE_MACHINE: &str = "Times are measurements of the machine that computed the trials \
                                            and of what else it did; they differ from run to run.";

/// Description of [`OWN_STEPS`], for names, units and directions.
#[must_use]
pub fn own_steps_metric() -> Metric {
    Metric::new(
        OWN_STEPS,
        "steps",
        "the last step for which an agent that trains itself gave a value",
    )
    .per_episode(PerEpisode::Last)
}

/// Description of [`UPDATES`], for names, units and directions.
#[must_use]
pub fn updates_metric() -> Metric {
    Metric::new(UPDATES, "", "updates that the agent made so far").per_episode(PerEpisode::Last)
}

/// Description of [`WALL_TIME`], for names, units and directions.
#[must_use]
pub fn wall_time_metric() -> Metric {
    Metric::new(WALL_TIME, "s", "wall-clock time of the trial")
        .lower_is_better()
        .per_episode(PerEpisode::Last)
}

/// Description of [`TIME_PER_UPDATE`], for names, units and directions.
#[must_use]
pub fn time_per_update_metric() -> Metric {
    let about = "wall-clock time of the trial over the updates that the agent made";
    Metric::new(TIME_PER_UPDATE, "s", about)
        .lower_is_better()
        .per_episode(PerEpisode::Last)
}

/// Description of [`TIME_PER_DECISION`], for names, units and directions.
#[must_use]
pub fn time_per_decision_metric() -> Metric {
    let about = "wall-clock time that the agent took for a decision of the final measurement";
    Metric::new(TIME_PER_DECISION, "s", about)
        .lower_is_better()
        .per_episode(PerEpisode::Last)
}

/// The metric of a record of means over episodes that holds the root of the mean square of another metric.
#[must_use]
pub fn root_of_squares(metric: &str) -> String {
    format!("rms({metric})")
}

/// Whether one of the words of `asked`, a part of a study, is the name of a time.
#[must_use]
pub fn names_times(asked: &impl Serialize) -> bool {
    serde_json::to_value(asked).is_ok_and(|asked| has_time(&asked))
}

fn has_time(asked: &Value) -> bool {
    let is_name = |letter: char| letter.is_alphanumeric() || letter == '_';
    match asked {
        Value::String(text) => text
            .split(|letter| !is_name(letter))
            .any(|word| [WALL_TIME, TIME_PER_UPDATE, TIME_PER_DECISION].contains(&word)),
        Value::Array(items) => items.iter().any(has_time),
        Value::Object(entries) => entries.values().any(has_time),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_found_by_their_whole_names() {
        let asked = |text: &str| names_times(&serde_json::json!({ "claims": [{ "claim": text }] }));
        assert!(asked("pr2.time_per_update > rommeo.time_per_update") && asked("a.wall_time < 3"));
        assert!(!asked("a.lifetime_per_update > b.wall_times"));
    }
}
