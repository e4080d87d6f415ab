//! Estimates of the time that missing trials take, from the most similar stored trials.
//!
//! The time of a trial with the same parts is used directly. If there is none, the nearest trial of the same
//! environment, agent and protocol gives the time of a step. A trial in another environment is never used: steps of one
//! may cost a thousand times those of another.

use super::nearest::{IndexedParts, Search};
use contract::trial::{Trial, TrialKey};
use execution::{pace, store::StoredCell};
use serde::Serialize;
use std::collections::HashMap;

/// The time that missing trials take.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Estimate {
    /// Number of missing trials.
    pub missing: usize,
    /// Number of missing trials without a similar stored trial; `worker_s` does not include them.
    pub unknown: usize,
    /// Seconds of the others on one worker.
    pub worker_s: f64,
}

/// An estimate for missing trials, each with its number of steps, from trials that were computed on the same hardware:
/// a device, or processors alone. `steps` gives the steps of a stored trial.
pub fn estimate<'t>(
    missing: impl IntoIterator<Item = (&'t Trial, u64)>,
    device: Option<&str>,
    stored: &[StoredCell],
    steps: impl Fn(&TrialKey) -> u64,
) -> Estimate {
    let missing: Vec<_> = missing.into_iter().collect();
    let cells: Vec<_> = missing
        .chunk_by(|(one, _), (other, _)| one.key.shares_parts(&other.key))
        .collect();
    let there = stored.iter().filter(|cell| cell.device.as_deref() == device);
    let mut search = Search::new(there, cells.len());
    let mut known = HashMap::new();
    let mut estimate = Estimate {
        missing: missing.len(),
        ..Estimate::default()
    };
    for cell in cells {
        let (trial, its_steps) = cell[0];
        let combination = search.combination(&trial.key);
        let one_s = *known
            .entry(combination)
            .or_insert_with_key(|combination| one_s(&search, combination, its_steps, &steps));
        match one_s {
            Some(one_s) => estimate.worker_s += cell.iter().map(|_| one_s).sum::<f64>(),
            None => estimate.unknown += cell.len(),
        }
    }
    estimate
}

/// Seconds of one missing trial, by the nearest stored one.
fn one_s(
    search: &Search<'_>,
    combination: &IndexedParts,
    its_steps: u64,
    steps: impl Fn(&TrialKey) -> u64,
) -> Option<f64> {
    let nearest = search.at(search.nearest_timed(combination)?);
    let step_s = nearest.took.mean_s()? / pace::steps(steps(nearest.key));
    Some(step_s * pace::steps(its_steps))
}
