//! End of a trial.

use document::plain_text::read_brief;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// State in which a trial ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EndState {
    /// It finished and its numbers are stored.
    Ok,
    /// A plugin reported an error.
    Failed,
    /// The code panicked.
    Panicked,
    /// It ran longer than allowed.
    Timeout,
    /// It used more memory than allowed.
    Oom,
    /// A number that must be finite was not.
    Nan,
    /// The worker process was killed from outside.
    Killed,
    /// It has reached a pause of a search, and its record up to there is stored. It has not ended, and `retry_on`
    /// cannot name this state.
    #[schemars(skip)]
    Paused,
}

impl EndState {
    /// Every state in which a trial has ended, except `ok`.
    pub const FAILURES: [EndState; 6] = [
        EndState::Failed,
        EndState::Panicked,
        EndState::Timeout,
        EndState::Oom,
        EndState::Nan,
        EndState::Killed,
    ];

    /// Name of the state, as it is stored and shown.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            EndState::Ok => "ok",
            EndState::Failed => "failed",
            EndState::Panicked => "panicked",
            EndState::Timeout => "timeout",
            EndState::Oom => "oom",
            EndState::Nan => "nan",
            EndState::Killed => "killed",
            EndState::Paused => "paused",
        }
    }
}

/// The stored end of a trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialEnd {
    /// State in which it ended.
    pub state: EndState,
    /// Reason for every state except `ok`; one line.
    #[serde(deserialize_with = "read_brief")]
    pub reason: String,
    /// Wall-clock time of the trial, in seconds.
    pub wall_s: f64,
    /// Mean wall-clock time of a decision of the final measurement, in seconds; `None` if none was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decision_s: Option<f64>,
    /// Name of the device on which the run computed the learners of many trials at once, in which case `wall_s` says
    /// nothing about a processor; `None` for processors alone, and if the trial did not end `ok`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Hash of the metrics file; empty if there is none.
    pub digest: String,
}

/// Whether a trial has to run: it never did, or was killed from outside.
#[must_use]
pub fn is_missing(end: Option<&TrialEnd>) -> bool {
    end.is_none_or(|end| matches!(end.state, EndState::Killed | EndState::Paused))
}
