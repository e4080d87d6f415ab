//! What trials of cross-play wait for.

use crate::{
    cross_play,
    results::{EndState, TrialEnd},
    store::{Store, is_missing},
    trial::Trial,
};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Missing trials that play policies of other trials.
pub(super) struct Waiting {
    /// How many play policies that are still to come.
    to_come: usize,
    /// Why others cannot run, and how many for that reason.
    cannot_run: BTreeMap<String, usize>,
}

/// A trial whose policy another one plays.
#[derive(Debug, Clone, PartialEq)]
enum Source {
    /// Its policy can be played.
    There,
    /// It is missing.
    ToCome,
    /// Its policy will not come by itself, and why.
    Never(String),
}

impl Waiting {
    /// Looks at what every missing trial plays.
    pub(super) fn of(trials: &[Trial], ends: &[Option<TrialEnd>], store: &Store) -> Self {
        let known: BTreeMap<&str, &Trial> = trials.iter().map(|trial| (trial.id.as_str(), trial)).collect();
        let mut seen: BTreeMap<String, Source> = BTreeMap::new();
        let mut waiting = Self { to_come: 0, cannot_run: BTreeMap::new() };
        for (trial, _) in trials.iter().zip(ends).filter(|(_, end)| is_missing(end.as_ref())) {
            let sources = cross_play::sources(&trial.key).into_iter();
            let played: Vec<Source> =
                sources.map(|id| seen.entry(id.clone()).or_insert_with(|| source(&id, store, &known)).clone()).collect();
            waiting.add(&played);
        }
        waiting
    }

    fn add(&mut self, played: &[Source]) {
        let never = played.iter().find_map(|source| if let Source::Never(because) = source { Some(because) } else { None });
        match never {
            Some(because) => *self.cannot_run.entry(because.clone()).or_default() += 1,
            None => self.to_come += usize::from(played.contains(&Source::ToCome)),
        }
    }

    /// A line each, for people.
    pub(super) fn lines(&self) -> Vec<String> {
        let count = self.to_come;
        let to_come = (count > 0).then(|| format!("  {count} trials of cross-play wait for policies of trials that are missing"));
        let failed = self.cannot_run.iter().map(|(source, count)| format!("  {count} trials of cross-play cannot run: {source}"));
        to_come.into_iter().chain(failed).collect()
    }

    /// The same for programs.
    pub(super) fn to_json(&self) -> Value {
        let cannot_run = self.cannot_run.iter().map(|(because, trials)| json!({ "trials": trials, "because": because }));
        json!({ "to_come": self.to_come, "cannot_run": cannot_run.collect::<Vec<_>>() })
    }
}

fn source(id: &str, store: &Store, known: &BTreeMap<&str, &Trial>) -> Source {
    match store.end(id).unwrap_or(None) {
        Some(end) if end.state == EndState::Ok => {
            store.policy(id).map_or_else(|error| Source::Never(error.to_string()), |_| Source::There)
        }
        Some(end) if !is_missing(Some(&end)) => Source::Never(source_line(&end, id, known)),
        _ => Source::ToCome,
    }
}

fn source_line(end: &TrialEnd, source: &str, known: &BTreeMap<&str, &Trial>) -> String {
    let title = known.get(source).map_or_else(|| format!("trial {source}"), |trial| trial.title());
    let reason = if end.reason.is_empty() { String::new() } else { format!(": {}", end.reason) };
    format!("{title} ended as {}{reason}", end.state.name())
}
