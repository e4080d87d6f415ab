//! Looks up which profiles of a study were ever run here.

use super::{Selection, study::Planned};
use crate::{
    Registry,
    report::{ProfileState, ProfileTrials},
    results::EndState,
    spec,
    store::{Store, StoredTrial},
};
use std::collections::{BTreeMap, BTreeSet};

/// The trials of a profile by their ids, each with how it ended; `None` where it has not run.
type Ends = Vec<(String, Option<EndState>)>;

/// Every profile with what the store has of its trials, the study without a profile first; nothing where it
/// has no profiles. `stored` is what the store has of the report's own trials.
///
/// A profile is taken as the study has it, without what the command line changes.
pub(super) fn of(
    registry: &Registry,
    one: &Planned,
    stored: &[Option<StoredTrial>],
    selection: &Selection,
    store: &Store,
) -> Vec<ProfileState> {
    if one.study.profiles.is_empty() {
        return Vec::new();
    }
    let changed = !selection.sets.is_empty() || selection.seeds.is_some() || !selection.only.is_empty();
    let names = std::iter::once(None).chain(one.study.profiles.iter().cloned().map(Some));
    let load = |name: Option<String>| {
        let this_report = !changed && name == selection.profile;
        let ends = if this_report {
            Some(own(one, stored))
        } else {
            planned(registry, one, name.clone(), store)
        };
        (name, this_report, ends)
    };
    let loaded: Vec<_> = names.map(load).collect();
    let users = users(loaded.iter().filter_map(|(_, _, ends)| ends.as_ref()));
    let state = |(name, this_report, ends): &(Option<String>, bool, Option<Ends>)| {
        let trials = ends.as_ref().map(|ends| count(ends, &users));
        ProfileState {
            name: name.clone(),
            this_report: *this_report,
            trials,
        }
    };
    loaded.iter().map(state).collect()
}

fn own(one: &Planned, stored: &[Option<StoredTrial>]) -> Ends {
    let states = stored.iter().map(|stored| stored.as_ref().map(|it| it.end.state));
    one.plan
        .trials
        .iter()
        .map(|trial| trial.id.clone())
        .zip(states)
        .collect()
}

fn planned(registry: &Registry, one: &Planned, profile: Option<String>, store: &Store) -> Option<Ends> {
    let options = spec::Options {
        profile,
        ..spec::Options::default()
    };
    let trials = spec::load(&one.path, registry, &options).ok()?.plan().trials;
    // What is damaged was complained of when the report's own trials were read, or is no concern of this
    // report.
    let states = store
        .ends(&trials)
        .into_iter()
        .map(|end| end.ok().flatten().map(|end| end.state));
    Some(trials.into_iter().map(|trial| trial.id).zip(states).collect())
}

/// How many profiles have a trial, by the trial's id.
fn users<'a>(profiles: impl Iterator<Item = &'a Ends>) -> BTreeMap<&'a str, usize> {
    let mut users = BTreeMap::new();
    for trials in profiles {
        for id in trials.iter().map(|(id, _)| id.as_str()).collect::<BTreeSet<_>>() {
            *users.entry(id).or_default() += 1;
        }
    }
    users
}

fn count(ends: &Ends, users: &BTreeMap<&str, usize>) -> ProfileTrials {
    let mut counts = ProfileTrials {
        planned: ends.len(),
        ..ProfileTrials::default()
    };
    for (id, state) in ends
        .iter()
        .filter_map(|(id, state)| Some((id.as_str(), (*state)?)))
    {
        match state {
            EndState::Ok => counts.ok += 1,
            _ => counts.failed += 1,
        }
        counts.own += usize::from(users.get(id) == Some(&1));
    }
    counts
}
