//! Reasons of new trials: the differences from the nearest trial in the store.
//!
//! The nearest stored trial is the one with the fewest differing leaves: values of the configs of environment, agent
//! and protocol, plugins and their versions, numerics version and seed. Names of a study do not count. Combinations of
//! parts are compared instead of trials, each with all its seeds.

use super::{leaves::Difference, nearest::Search};
use contract::{
    trial::{Purpose, Trial, TrialKey},
    trial_end::{EndState, TrialEnd},
};
use execution::store::StoredCell;
use std::{
    borrow::Borrow,
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::Arc,
};

/// Reason why trials are not done.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// The parts are stored, with other seeds.
    NewSeed {
        /// The stored seeds.
        stored: BTreeSet<u64>,
    },
    /// The nearest stored trial has other parts.
    Changed {
        /// The differing leaves; never empty.
        differences: Vec<Difference>,
        /// The stored seeds, if the trial's is not among them.
        new_seed: Option<BTreeSet<u64>>,
    },
    /// Some artifacts that the trial takes come from new trials, given by the names of their entries.
    Takes(BTreeSet<String>),
    /// No stored trial shares at least two of the three plugins.
    NothingLikeIt,
    /// The worker process was killed from outside.
    Killed,
    /// The trial ended in this state, and would end the same way again.
    Failed(EndState),
}

/// Trials of one cell that are not done for the same reason.
#[derive(Debug, Clone, PartialEq)]
pub struct Novelty {
    /// Name of the environment in the study.
    pub environment: String,
    /// Name of the agent in the study.
    pub agent: String,
    /// Point of the sweep, as `key=value` words.
    pub setting: String,
    /// The seeds, in the order of the study.
    pub seeds: Vec<u64>,
    /// The common reason of these trials.
    pub reason: Reason,
}

/// The reason why each missing trial is not done, by cell and reason, in the order of the plan; trials of cross-play
/// are left out.
///
/// `ends` has one entry per trial.
#[must_use]
pub fn novelties(
    trials: &[impl Borrow<Trial>],
    ends: &[Option<TrialEnd>],
    stored: &[StoredCell],
) -> Vec<Novelty> {
    let pending = || {
        (trials.iter().zip(ends))
            .map(|(trial, end)| (trial.borrow(), end.as_ref().map(|end| end.state)))
            .filter(|(_, state)| *state != Some(EndState::Ok))
            // A trial that plays a policy is new because the policy is.
            .filter(|(trial, _)| !matches!(trial.cell.purpose, Purpose::Play(_)))
    };
    let takes = pending().any(|(trial, _)| trial.key.takes());
    let new: HashMap<&str, &Trial> = pending()
        .filter(|_| takes)
        .map(|(trial, _)| (trial.id.as_str(), trial))
        .collect();
    let mut search = Search::new(stored, by_cell(pending()).count());
    by_cell(pending())
        .flat_map(|cell| of_cell(&cell, &new, &mut search))
        .collect()
}

/// A trial that is to run, and its end state if it has ended.
type PendingTrial<'a> = (&'a Trial, Option<EndState>);

/// Groups neighbouring trials of one cell: a plan may have a million trials, but few of one cell.
fn by_cell<'a>(
    pending: impl Iterator<Item = PendingTrial<'a>>,
) -> impl Iterator<Item = Vec<PendingTrial<'a>>> {
    let mut pending = pending.peekable();
    std::iter::from_fn(move || {
        let first = pending.next()?;
        let mut cell = vec![first];
        while let Some(next) = pending.next_if(|(trial, _)| is_of_cell(first.0, trial)) {
            cell.push(next);
        }
        Some(cell)
    })
}

fn is_of_cell(one: &Trial, other: &Trial) -> bool {
    Arc::ptr_eq(&one.cell, &other.cell) || one.cell.combination == other.cell.combination
}

/// Names of the entries that a trial takes from and that are new themselves.
fn new_sources(trial: &Trial, new: &HashMap<&str, &Trial>) -> BTreeSet<String> {
    let taken = trial.key.taken_by_name();
    taken
        .iter()
        .filter_map(|taken| new.get(taken.trial.as_str()))
        .map(|source| entry(source))
        .collect()
}

fn entry(trial: &Trial) -> String {
    match trial.cell.purpose {
        Purpose::Prepared => trial.cell.environment.clone(),
        _ => format!("{} in {}", trial.cell.agent, trial.cell.environment),
    }
}

fn of_cell(cell: &[PendingTrial<'_>], new: &HashMap<&str, &Trial>, search: &mut Search<'_>) -> Vec<Novelty> {
    let mut reasons: Vec<(Reason, Vec<u64>)> = Vec::new();
    let mut add = |reason: Reason, seed: u64| match reasons.iter_mut().find(|(known, _)| *known == reason) {
        Some((_, seeds)) => seeds.push(seed),
        None => reasons.push((reason, vec![seed])),
    };
    let mut absent = Vec::new();
    for (trial, state) in cell {
        match state {
            None => match new_sources(trial, new) {
                none if none.is_empty() => absent.push(trial.key.seed),
                sources => add(Reason::Takes(sources), trial.key.seed),
            },
            Some(EndState::Killed) => add(Reason::Killed, trial.key.seed),
            Some(state) => add(Reason::Failed(*state), trial.key.seed),
        }
    }
    let first = cell[0].0;
    reasons.extend(of_absent(search, &first.key, &absent));
    let (environment, agent, setting) = (
        first.cell.environment.clone(),
        first.cell.agent.clone(),
        first.cell.point.words().to_owned(),
    );
    let named = |(reason, seeds)| Novelty {
        environment: environment.clone(),
        agent: agent.clone(),
        setting: setting.clone(),
        seeds,
        reason,
    };
    reasons.into_iter().map(named).collect()
}

/// The reasons why these seeds of a combination are not stored.
fn of_absent(search: &mut Search<'_>, key: &TrialKey, seeds: &[u64]) -> Vec<(Reason, Vec<u64>)> {
    if seeds.is_empty() {
        return Vec::new();
    }
    let planned = search.combination(key);
    if let Some(same) = search.same(&planned) {
        let stored = search.at(same).seeds.clone();
        return vec![(Reason::NewSeed { stored }, seeds.to_vec())];
    }
    let nearest = search.nearest(&planned, seeds);
    let Some(&first) = nearest.first() else {
        return vec![(Reason::NothingLikeIt, seeds.to_vec())];
    };
    let mut by_stored: BTreeMap<(bool, usize), Vec<u64>> = BTreeMap::new();
    for &seed in seeds {
        let is_known = |index: &usize| search.at(*index).seeds.contains(&seed);
        let with_seed = nearest.iter().copied().find(is_known);
        by_stored
            .entry((with_seed.is_none(), with_seed.unwrap_or(first)))
            .or_default()
            .push(seed);
    }
    let changed = |((new_seed, index), seeds): ((bool, usize), Vec<u64>)| {
        let differences = search.differences(index, &planned);
        let new_seed = new_seed.then(|| search.at(index).seeds.clone());
        (
            Reason::Changed {
                differences,
                new_seed,
            },
            seeds,
        )
    };
    let mut reasons: Vec<_> = by_stored.into_iter().map(changed).collect();
    reasons.sort_by_key(|(_, seeds)| seeds.first().copied());
    reasons
}
