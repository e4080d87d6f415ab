//! Protocol of cross-play: whole episodes between policies that learn no more.

use super::{
    Protocol, Run,
    evaluation::{self, Measurement, measure},
    position::Position,
};
use crate::{
    Error, Metric,
    cross_play::{NAME, VERSION},
    trial::Part,
};
use serde::{Deserialize, Serialize};
use serde_json::json;

/// How much to measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrossPlay {
    /// Episodes of each trial.
    pub episodes: u64,
}

impl CrossPlay {
    /// The protocol as part of a trial's key.
    #[must_use]
    pub fn part(self) -> Part {
        Part::new(NAME, VERSION, json!({ "episodes": self.episodes }))
    }
}

impl Protocol for CrossPlay {
    fn metrics(&self) -> Vec<Metric> {
        evaluation::metrics()
    }

    fn total_steps(&self) -> u64 {
        0
    }

    fn experience(&self) -> u64 {
        0
    }

    fn run(&self, run: &mut Run<'_>) -> Result<(), Error> {
        let position: Option<Position<()>> = run.resume()?;
        let what = Measurement::at_the_end(0, self.episodes, 0);
        measure(run, &what, position.and_then(|position| position.measuring), || None::<()>)
    }
}
