//! The reasons why missing trials wait: they take artifacts of other trials that are still missing, or that will stay
//! missing without an action of the user.

use contract::{
    trial::Trial,
    trial_end::{EndState, TrialEnd, is_missing},
};
use document::count::{count, either};
use execution::store::Store;
use serde_json::{Value, json};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// Missing trials that take artifacts of other trials.
#[derive(Debug, Default)]
pub struct Waiting {
    /// Number of trials whose artifacts are still to come.
    to_come: usize,
    /// The reasons why other trials are blocked, with the number of trials for each.
    because: BTreeMap<String, usize>,
    /// Blocked trials, by their places among the trials.
    blocked: BTreeSet<usize>,
}

/// Availability of the artifact of a trial.
#[derive(Debug, Clone, PartialEq)]
enum Availability {
    /// The artifact is stored.
    There,
    /// The trial is missing and will run.
    ToCome,
    /// The artifact will not come by itself, for this reason.
    Never(String),
}

impl Waiting {
    /// Examines the artifacts that every missing trial takes.
    pub(crate) fn of(trials: &[Arc<Trial>], ends: &[Option<TrialEnd>], store: &Store) -> Self {
        // If no trial takes an artifact, there is nothing to look up.
        if !trials.iter().any(|trial| trial.key.takes()) {
            return Self::default();
        }
        let known = trials.iter().map(|trial| (trial.id.as_str(), &**trial)).collect();
        let mut sources = Known {
            store,
            trials: known,
            seen: BTreeMap::new(),
        };
        let mut waiting = Self::default();
        for (place, (trial, _)) in trials
            .iter()
            .zip(ends)
            .enumerate()
            .filter(|(_, (_, end))| is_missing(end.as_ref()))
        {
            match sources.of_all(trial) {
                Availability::There => {}
                Availability::ToCome => waiting.to_come += 1,
                Availability::Never(because) => {
                    waiting.blocked.insert(place);
                    *waiting.because.entry(because).or_default() += 1;
                }
            }
        }
        waiting
    }

    /// True if the trial at this place will not run by itself.
    #[must_use]
    pub fn is_blocked(&self, place: usize) -> bool {
        self.blocked.contains(&place)
    }

    /// The reasons as lines for people.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let verb = either(&self.to_come, "waits", "wait");
        let trials = count(self.to_come, "trial");
        let to_come = (self.to_come > 0).then(|| format!("  {trials} {verb} for what other trials leave"));
        let blocked = self.because.iter().map(|(because, number)| {
            let verb = either(number, "is", "are");
            format!("  {} {verb} blocked: {because}", count(*number, "trial"))
        });
        to_come.into_iter().chain(blocked).collect()
    }

    /// The reasons as JSON for programs.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let blocked = self
            .because
            .iter()
            .map(|(because, trials)| json!({ "trials": trials, "because": because }));
        json!({ "to_come": self.to_come, "blocked": blocked.collect::<Vec<_>>() })
    }
}

struct Known<'a> {
    store: &'a Store,
    trials: BTreeMap<&'a str, &'a Trial>,
    seen: BTreeMap<String, Availability>,
}

impl Known<'_> {
    /// The obstacle of a trial. An artifact that will never come takes precedence over one that is still to come.
    fn of_all(&mut self, trial: &Trial) -> Availability {
        let mut answer = Availability::There;
        for taken in trial.key.taken() {
            let left = self.source(&taken.trial);
            let left = match left {
                // The trial ended `ok`; its artifact may still be damaged or of another kind.
                Availability::There => self.store.artifact(&taken).map_or_else(
                    |error| Availability::Never(error.to_string()),
                    |_| Availability::There,
                ),
                other => other,
            };
            match left {
                Availability::Never(because) => return Availability::Never(because),
                Availability::ToCome => answer = Availability::ToCome,
                Availability::There => {}
            }
        }
        answer
    }

    /// The end of a source or, if it is missing, whether it can run.
    fn source(&mut self, id: &str) -> Availability {
        if let Some(known) = self.seen.get(id) {
            return known.clone();
        }
        let found = match self.store.end(id).unwrap_or(None) {
            Some(end) if end.state == EndState::Ok => Availability::There,
            Some(end) if !is_missing(Some(&end)) => Availability::Never(self.line(&end, id)),
            _ => match self.trials.get(id).copied().map(|trial| self.of_all(trial)) {
                Some(Availability::Never(because)) => Availability::Never(because),
                _ => Availability::ToCome,
            },
        };
        self.seen.insert(id.to_owned(), found.clone());
        found
    }

    fn line(&self, end: &TrialEnd, id: &str) -> String {
        let title = self
            .trials
            .get(id)
            .map_or_else(|| format!("trial {id}"), |trial| trial.title());
        let reason = if end.reason.is_empty() {
            String::new()
        } else {
            format!(": {}", end.reason)
        };
        format!("{title} ended as {}{reason}", end.state.name())
    }
}
