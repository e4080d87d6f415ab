//! The lines of `status` about missing trials: running ones with their process and the step of their log, those that
//! resume from a checkpoint, and those that are tried again with their earlier ends.

use contract::{
    trial::Trial,
    trial_end::{TrialEnd, is_missing},
};
use execution::store::{Owner, Store, metric_log};
use std::sync::Arc;

/// Maximum number of lines about running or begun trials.
const MOST_LINES: usize = 20;

/// One line per trial that runs or has a checkpoint; empty where there is none.
pub(super) fn begun(store: &Store, trials: &[Arc<Trial>], ends: &[Option<TrialEnd>]) -> String {
    // Without a live process no trial runs.
    let may_run = !store.owners().is_empty();
    let missing = trials
        .iter()
        .zip(ends)
        .filter(|(_, end)| is_missing(end.as_ref()));
    let begun: Vec<_> = missing
        .filter_map(|(trial, _)| {
            let owner = may_run.then(|| store.running(&trial.id)).flatten();
            (owner.is_some() || store.checkpoints(&trial.id) > 0).then_some((trial, owner))
        })
        .collect();
    let mut lines: Vec<String> = begun
        .iter()
        .take(MOST_LINES)
        .map(|(trial, owner)| {
            let (word, text) = match owner {
                Some(owner) => ("running", running_on(owner)),
                None => ("begun", "goes on from a checkpoint".to_owned()),
            };
            let logged = logged(store, &trial.id)
                .map_or_else(String::new, |step| format!(", logged up to step {step}"));
            format!("  {word:<8} {}: {text}{logged}", trial.title())
        })
        .collect();
    if begun.len() > MOST_LINES {
        lines.push(format!("           {} more", begun.len() - MOST_LINES));
    }
    lines.join("\n")
}

fn running_on(owner: &Owner) -> String {
    let job = owner
        .slurm_job
        .as_ref()
        .map_or_else(String::new, |job| format!(", Slurm job {job}"));
    format!("process {} on {}{job}", owner.pid, owner.host)
}

/// One line for each missing trial with an earlier failure; empty if there is none.
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

/// The step of the last row in a running trial's log.
fn logged(store: &Store, id: &str) -> Option<u64> {
    let log = metric_log::read(&store.folder(id).join("running").join("metrics.log")).ok()?;
    log.table.rows.last().map(|row| row.step)
}
