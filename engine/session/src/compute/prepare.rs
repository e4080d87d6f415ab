//! Preparation before trials run: damaged trials are set aside and trials to be repeated are marked, so that this
//! command and every later one count both as missing.

use super::Compute;
use crate::{Failure, Planned, Session};
use contract::{
    Error,
    trial::Trial,
    trial_end::{EndState, TrialEnd, is_missing},
};
use document::count::{count, either};
use execution::store::{Claim, Findings, Leases, Store};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// The ends of the trials of each study; `None` where a trial is missing.
pub(crate) type Ends = Vec<Vec<Option<TrialEnd>>>;

impl Compute<'_> {
    /// Makes the store ready for running `planned` and returns the ends of its trials so far.
    pub(crate) fn prepare(&self, planned: &[Planned], store: &Store) -> Result<Ends, Failure> {
        let mut damaged = BTreeSet::new();
        let mut ends: Ends = Vec::new();
        for one in planned {
            let trials = &one.plan.trials;
            let found = store.ends(trials);
            for (position, error) in found.unreadable {
                match error {
                    Error::Damaged { .. } => {
                        damaged.insert(trials[position].id.as_str());
                    }
                    error => self
                        .session
                        .notice(&format!("warning: {error}; the trial counts as missing")),
                }
            }
            damaged.extend(damaged_pauses(one, &found.all, store));
            ends.push(found.all);
        }
        if self.whole {
            damaged.extend(self.damaged_files(planned, &ends, store));
        }
        if !damaged.is_empty() {
            self.heal(&damaged, store)?;
            forget(planned, &mut ends, &damaged);
        }
        if self.retry_failed {
            let again = self.try_again(planned, &ends, store)?;
            forget(planned, &mut ends, &again);
        }
        Ok(ends)
    }

    /// Trials with damaged files: metrics that the report will read, or artifacts that missing trials take. A trial's
    /// metrics are read once, not in every generation of a search.
    fn damaged_files<'p>(&self, planned: &'p [Planned], ends: &Ends, store: &Store) -> BTreeSet<&'p str> {
        let trials = || {
            planned
                .iter()
                .flat_map(|one| &one.plan.trials)
                .zip(ends.iter().flatten())
        };
        // A trial that belongs to several studies or settings is checked once.
        let ended: BTreeMap<&str, &TrialEnd> = trials()
            .filter_map(|(trial, end)| Some((&*trial.id, end.as_ref()?)))
            .collect();
        let taken: BTreeSet<String> = trials()
            .filter(|(_, end)| is_missing(end.as_ref()))
            .flat_map(|(trial, _)| trial.key.sources())
            .collect();
        let artifacts = ended
            .keys()
            .copied()
            .filter(|id| taken.contains(*id) && store.has_damaged_artifact(id));
        let mut sound = self.sound.borrow_mut();
        let unread = ended.iter().filter(|(id, _)| !sound.contains(**id));
        let unread: Vec<(&str, &TrialEnd)> = unread.map(|(id, end)| (*id, *end)).collect();
        let mut damaged: BTreeSet<&str> = store.with_damaged_metrics(&unread).into_iter().collect();
        let is_sound = |(id, end): &&(&str, &TrialEnd)| end.state == EndState::Ok && !damaged.contains(id);
        sound.extend(unread.iter().filter(is_sound).map(|(id, _)| (*id).to_owned()));
        damaged.extend(artifacts);
        damaged
    }

    fn heal(&self, damaged: &BTreeSet<&str>, store: &Store) -> Result<(), Failure> {
        let leases = Leases::open(store, self.session.settings.lease_expiry)?;
        let ids: Vec<&str> = damaged.iter().copied().collect();
        say_healed(self.session, &store.heal(&ids, &leases)?);
        Ok(())
    }

    /// Marks the trials that did not end `ok`. Trials that another program runs are left alone.
    fn try_again<'p>(
        &self,
        planned: &'p [Planned],
        ends: &Ends,
        store: &Store,
    ) -> Result<BTreeSet<&'p str>, Failure> {
        let trials = planned.iter().flat_map(|one| &one.plan.trials);
        let failed = trials
            .zip(ends.iter().flatten())
            .filter(|(_, end)| has_failed(end.as_ref()));
        let failed: BTreeSet<&str> = failed.map(|(trial, _)| &*trial.id).collect();
        if failed.is_empty() {
            return Ok(failed);
        }
        let leases = Leases::open(store, self.session.settings.lease_expiry)?;
        for id in &failed {
            match leases.claim(id) {
                Ok(Claim::Mine) => {
                    let marked = mark(id, store);
                    leases.release(id)?;
                    marked?;
                }
                Ok(Claim::Held(_)) => {}
                Err(error) => match store.obstacle_to_writing(id) {
                    Some(obstacle) => self.session.notice(&format!("warning: {obstacle}")),
                    None => return Err(error.into()),
                },
            }
        }
        Ok(failed)
    }
}

/// Makes a failed trial missing. Before this program held the lease, another program may have done so already, or
/// computed the trial with success.
fn mark(id: &str, store: &Store) -> Result<(), Error> {
    if has_failed(store.end(id)?.as_ref()) {
        store.try_again(id)
    } else {
        Ok(())
    }
}

/// True if a trial ended in a state that is kept until somebody asks for a repetition.
fn has_failed(end: Option<&TrialEnd>) -> bool {
    !is_missing(end) && end.is_some_and(|end| end.state != EndState::Ok)
}

/// The number of failed trials by state, and the command that runs them again; `None` if no trial failed. A trial of
/// several studies counts once.
#[must_use]
pub fn failed_in_words<'a>(
    ends: impl Iterator<Item = (&'a str, Option<&'a TrialEnd>)>,
    again: &str,
) -> Option<String> {
    let failed: BTreeMap<&str, EndState> = ends
        .filter(|(_, end)| has_failed(*end))
        .filter_map(|(id, end)| Some((id, end?.state)))
        .collect();
    let states: Vec<EndState> = failed.into_values().collect();
    let number = |state: EndState| states.iter().filter(|one| **one == state).count();
    let counts = EndState::FAILURES
        .map(|state| (number(state), state.name()))
        .into_iter()
        .filter(|(count, _)| *count > 0);
    let counts: Vec<String> = counts.map(|(count, name)| format!("{count} {name}")).collect();
    let words = || {
        format!(
            "{} did not end ok ({}): `{again}` runs {} again",
            count(states.len(), "trial"),
            counts.join(", "),
            either(&states.len(), "it", "them")
        )
    };
    (!states.is_empty()).then(words)
}

/// Trials of searches that have not ended `ok` and whose record at a pause is damaged.
fn damaged_pauses<'p>(one: &'p Planned, ends: &[Option<TrialEnd>], store: &Store) -> Vec<&'p str> {
    let is_ok = |end: &Option<TrialEnd>| end.as_ref().is_some_and(|end| end.state == EndState::Ok);
    let open = one.plan.trials.iter().zip(ends).filter(|(_, end)| !is_ok(end));
    let tried = open
        .map(|(trial, _)| trial)
        .filter(|trial| trial.cell.purpose.is_tried());
    let is_damaged = |trial: &&Arc<Trial>| matches!(store.partial(&trial.id), Err(Error::Damaged { .. }));
    let all = one.paused.iter().chain(tried).filter(is_damaged);
    all.map(|trial| trial.id.as_str()).collect()
}

fn forget(planned: &[Planned], ends: &mut Ends, missing: &BTreeSet<&str>) {
    for (one, ends) in planned.iter().zip(ends) {
        let trials = one.plan.trials.iter().zip(ends);
        trials
            .filter(|(trial, _)| missing.contains(&*trial.id))
            .for_each(|(_, end)| *end = None);
    }
}

fn say_healed(session: &Session<'_>, healed: &Findings) {
    let Some(aside) = &healed.aside else { return };
    for finding in &healed.findings {
        session.notice(&format!(
            "{:<8} {}: {}",
            finding.fault.name(),
            finding.path.display(),
            finding.problem
        ));
    }
    let trials: BTreeSet<_> = healed
        .findings
        .iter()
        .filter_map(|finding| finding.trial.as_ref())
        .collect();
    session.notice(&format!(
        "set aside in `{}` of the store; {} {} again",
        aside.display(),
        count(trials.len(), "damaged trial"),
        either(&trials.len(), "runs", "run")
    ));
}
