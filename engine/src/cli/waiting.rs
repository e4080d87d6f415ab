//! What trials of cross-play wait for.

use crate::{
    cross_play,
    results::{EndState, TrialEnd},
    store::{Store, is_missing},
    trial::Trial,
};
use std::collections::BTreeMap;

/// How many missing trials play policies that are still to come, and which policies do not come; a line each.
pub(super) fn lines(trials: &[Trial], ends: &[Option<TrialEnd>], store: &Store) -> Vec<String> {
    let known: BTreeMap<&str, &Trial> = trials.iter().map(|trial| (trial.id.as_str(), trial)).collect();
    let (mut to_come, mut failed) = (0, BTreeMap::<String, usize>::new());
    for (trial, _) in trials.iter().zip(ends).filter(|(_, end)| is_missing(end.as_ref())) {
        let sources = cross_play::sources(&trial.key);
        let lacking = sources.into_iter().map(|source| (store.end(&source).unwrap_or(None), source));
        let lacking: Vec<_> = lacking.filter(|(end, _)| end.as_ref().is_none_or(|end| end.state != EndState::Ok)).collect();
        let for_good =
            lacking.iter().find_map(|(end, source)| Some((end.as_ref().filter(|end| !is_missing(Some(end)))?, source)));
        match for_good {
            Some((end, source)) => *failed.entry(source_line(end, source, &known)).or_default() += 1,
            None => to_come += usize::from(!lacking.is_empty()),
        }
    }
    let waiting = (to_come > 0).then(|| format!("  {to_come} trials of cross-play wait for policies of trials that are missing"));
    let failed = failed.into_iter().map(|(source, count)| format!("  {count} trials of cross-play cannot run: {source}"));
    waiting.into_iter().chain(failed).collect()
}

fn source_line(end: &TrialEnd, source: &str, known: &BTreeMap<&str, &Trial>) -> String {
    let title = known.get(source).map_or_else(
        || format!("trial {source}"),
        |trial| format!("{} {} seed {}", trial.environment, trial.agent, trial.key.seed),
    );
    let reason = if end.reason.is_empty() { String::new() } else { format!(": {}", end.reason) };
    format!("{title} ended as {}{reason}", end.state.name())
}
