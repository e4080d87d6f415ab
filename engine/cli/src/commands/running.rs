//! The lines of `status` on trials that are being computed now: who has them, and how far their log is; and on
//! those that are tried again: how they ended before.

use contract::{
    trial::Trial,
    trial_end::{TrialEnd, is_missing},
};
use execution::store::{Store, metric_log};
use std::sync::Arc;

/// Lines about running trials, at most this many.
const MOST_LINES: usize = 20;

/// One line per running trial; empty where none runs.
pub(super) fn running(store: &Store, trials: &[Arc<Trial>], ends: &[Option<TrialEnd>]) -> String {
    // Without a living process nothing can be held, and no folder needs to be looked into.
    if store.owners().is_empty() {
        return String::new();
    }
    let missing = trials
        .iter()
        .zip(ends)
        .filter(|(_, end)| is_missing(end.as_ref()));
    let held: Vec<_> = missing
        .filter_map(|(trial, _)| Some((trial, store.running(&trial.id)?)))
        .collect();
    let mut lines: Vec<String> = held
        .iter()
        .take(MOST_LINES)
        .map(|(trial, owner)| {
            let job = owner
                .slurm_job
                .as_ref()
                .map_or_else(String::new, |job| format!(", Slurm job {job}"));
            let logged = logged(store, &trial.id)
                .map_or_else(String::new, |step| format!(", logged up to step {step}"));
            format!(
                "  running  {}: process {} on {}{job}{logged}",
                trial.title(),
                owner.pid,
                owner.host
            )
        })
        .collect();
    if held.len() > MOST_LINES {
        lines.push(format!("  running  {} more", held.len() - MOST_LINES));
    }
    lines.join("\n")
}

/// One line per missing trial that ended badly before; empty where there is none.
pub(super) fn tried_again(store: &Store, trials: &[Arc<Trial>], ends: &[Option<TrialEnd>]) -> String {
    let missing = trials.iter().zip(ends).filter(|(_, end)| end.is_none());
    let earlier = missing.filter_map(|(trial, _)| Some((trial, store.earlier(&trial.id)?)));
    let lines = earlier.map(|(trial, end)| {
        format!(
            "  again    {}: ended as {} before and is tried again: {}",
            trial.title(),
            end.state.name(),
            end.reason
        )
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// The step of the last row that has reached a running trial's log.
fn logged(store: &Store, id: &str) -> Option<u64> {
    let log = metric_log::read(&store.folder(id).join("running").join("metrics.log")).ok()?;
    log.table.rows.last().map(|row| row.step)
}
