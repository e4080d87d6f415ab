//! Finds the profiles of a study that have stored trials.

use crate::{Planned, Selection};
use contract::{Registry, trial::Trial, trial_end::EndState};
use execution::store::Store;
use report::{ProfileState, ProfileTrials};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// The trials of a profile.
struct Ends {
    planned: usize,
    /// Those that have run.
    stored: Vec<(String, EndState)>,
}

/// The number of stored trials of every profile, starting with the study without a profile; empty if the study has no
/// profiles. `own` holds the ends of the report's own trials.
///
/// A profile is read as the study defines it, without the changes of the command line.
pub(crate) fn of(
    registry: &Registry,
    one: &Planned,
    own: &[Option<EndState>],
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
            Some(Ends::of(&one.plan.trials, own))
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

impl Ends {
    fn of(trials: &[Arc<Trial>], states: &[Option<EndState>]) -> Self {
        let stored = trials
            .iter()
            .zip(states)
            .filter_map(|(trial, state)| Some((trial.id.clone(), (*state)?)));
        Self {
            planned: trials.len(),
            stored: stored.collect(),
        }
    }
}

fn planned(registry: &Registry, one: &Planned, profile: Option<String>, store: &Store) -> Option<Ends> {
    let options = study::Options {
        profile,
        ..study::Options::default()
    };
    let trials = study::load(&one.path, registry, &options).ok()?.plan().trials;
    // Damage was reported when the report's own trials were read; other damage does not concern this report.
    let states = store.stored_of(&trials, |it| it.end.state).all;
    Some(Ends::of(&trials, &states))
}

/// Number of profiles that use a stored trial, by the trial's id.
fn users<'a>(profiles: impl Iterator<Item = &'a Ends>) -> BTreeMap<&'a str, usize> {
    let mut users = BTreeMap::new();
    for ends in profiles {
        for id in ends
            .stored
            .iter()
            .map(|(id, _)| id.as_str())
            .collect::<BTreeSet<_>>()
        {
            *users.entry(id).or_default() += 1;
        }
    }
    users
}

fn count(ends: &Ends, users: &BTreeMap<&str, usize>) -> ProfileTrials {
    let mut counts = ProfileTrials {
        planned: ends.planned,
        ..ProfileTrials::default()
    };
    for (id, state) in &ends.stored {
        match state {
            EndState::Ok => counts.ok += 1,
            _ => counts.failed += 1,
        }
        counts.own += usize::from(users.get(id.as_str()) == Some(&1));
    }
    counts
}
