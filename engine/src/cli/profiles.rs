//! Looks up which profiles of a study were ever run here, and when its trials ended.

use super::{Selection, study::Planned};
use crate::{
    Registry,
    report::{Period, ProfileState, ProfileTrials},
    results::EndState,
    spec,
    store::Store,
    trial::Trial,
};
use std::collections::{BTreeMap, BTreeSet};

/// When the trials of a study ended, as far as the store knows; `None` where it knows no date.
pub(super) fn period(one: &Planned, store: &Store) -> Option<Period> {
    let dates = store.stored_of(&one.plan.trials).into_iter().map(|stored| stored.ok().flatten()?.ended_at);
    Period::of(dates)
}

/// Every profile with what the store has of its trials, the study without a profile first; nothing where it has no profiles.
///
/// A profile is taken as the study has it, without what the command line changes.
pub(super) fn of(registry: &Registry, one: &Planned, selection: &Selection, store: &Store) -> Vec<ProfileState> {
    if one.study.profiles.is_empty() {
        return Vec::new();
    }
    let changed = !selection.sets.is_empty() || selection.seeds.is_some() || !selection.only.is_empty();
    let names = std::iter::once(None).chain(one.study.profiles.iter().cloned().map(Some));
    let load = |name: Option<String>| {
        let this_report = !changed && name == selection.profile;
        let trials = if this_report { Some(one.plan.trials.clone()) } else { planned(registry, one, name.clone()) };
        (ProfileState { name, this_report, trials: None }, trials)
    };
    let loaded: Vec<_> = names.map(load).collect();
    let users = users(loaded.iter().filter_map(|(_, trials)| trials.as_deref()));
    let counted = |(state, trials): (ProfileState, Option<Vec<Trial>>)| {
        let trials = trials.map(|trials| count(&trials, &users, store));
        ProfileState { trials, ..state }
    };
    loaded.into_iter().map(counted).collect()
}

fn planned(registry: &Registry, one: &Planned, profile: Option<String>) -> Option<Vec<Trial>> {
    let options = spec::Options { profile, ..spec::Options::default() };
    spec::load(&one.path, registry, &options).ok().map(|study| study.plan().trials)
}

/// How many profiles have a trial, by the trial's id.
fn users<'a>(profiles: impl Iterator<Item = &'a [Trial]>) -> BTreeMap<String, usize> {
    let mut users = BTreeMap::new();
    for trials in profiles {
        for id in trials.iter().map(|trial| &trial.id).collect::<BTreeSet<_>>() {
            *users.entry(id.clone()).or_default() += 1;
        }
    }
    users
}

fn count(trials: &[Trial], users: &BTreeMap<String, usize>, store: &Store) -> ProfileTrials {
    let mut counts = ProfileTrials { planned: trials.len(), ..ProfileTrials::default() };
    for (trial, stored) in trials.iter().zip(store.stored_of(trials)) {
        // What is damaged was complained of when the report's own trials were read, or is no concern of this report.
        let Some(end) = stored.ok().flatten().map(|stored| stored.end) else { continue };
        match end.state {
            EndState::Ok => counts.ok += 1,
            _ => counts.failed += 1,
        }
        counts.own += usize::from(users.get(&trial.id) == Some(&1));
    }
    counts
}
