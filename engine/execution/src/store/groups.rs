//! Reads many trials of a store at once, one group of folders after the other.
//!
//! A group is listed and the packs are opened once for all its trials, so that no absent file is opened; few
//! groups are held at once.

use super::{
    Store, StoredTrial, names,
    pack::{PackReader, acknowledged_in, loaded_in, outlined_in, readers},
};
use contract::{Error, trial::Trial, trial_result::TrialResult};
use rayon::prelude::*;
use std::{
    borrow::Borrow,
    collections::{BTreeMap, BTreeSet, HashSet},
    sync::Arc,
};

/// Number of trials in one group of folders from which on the group is listed first.
const LIST_FROM: usize = 4;

/// Number of groups of folders, for each thread, that are read before their results are taken.
const GROUPS_PER_THREAD: usize = 2;

impl Store {
    /// Calls `take` with the place and the stored part of each stored trial; an error means a faulty file. For a trial
    /// in a pack, the pack's own outline is used.
    pub(super) fn each_stored(
        &self,
        trials: &[impl Borrow<Trial> + Sync],
        take: impl FnMut(usize, Result<StoredTrial, Error>),
    ) {
        let in_packs = |packs: &mut [PackReader<'_>], trial: &Trial| outlined_in(packs, &trial.id);
        self.each_found(trials, |trial| self.stored(&trial.id), in_packs, take);
    }

    /// Like [`each_stored`](Self::each_stored), but reads every `trial.json`, including those in packs.
    pub(super) fn each_acknowledged(
        &self,
        trials: &[impl Borrow<Trial> + Sync],
        take: impl FnMut(usize, Result<StoredTrial, Error>),
    ) {
        let in_packs = |packs: &mut [PackReader<'_>], trial: &Trial| {
            acknowledged_in(packs, &trial.id).map(|found| found.map(|(_, stored)| stored))
        };
        self.each_found(trials, |trial| self.stored(&trial.id), in_packs, take);
    }

    /// Calls `take` with the place of each trial that is found, and with its value or the reason why it cannot be used.
    /// Trials come group by group, so that few are held at once and a pack is opened once per group.
    fn each_found<T: Send>(
        &self,
        trials: &[impl Borrow<Trial> + Sync],
        in_folder: impl Fn(&Trial) -> Result<Option<T>, Error> + Sync,
        in_packs: impl Fn(&mut [PackReader<'_>], &Trial) -> Result<Option<T>, Error> + Sync,
        mut take: impl FnMut(usize, Result<T, Error>),
    ) {
        let mut groups: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (position, trial) in trials.iter().enumerate() {
            groups
                .entry(digits(&trial.borrow().id))
                .or_default()
                .push(position);
        }
        let groups: Vec<_> = groups.into_iter().collect();
        let in_group = |(group, positions): &(&str, Vec<usize>)| {
            let trials = positions
                .iter()
                .map(|&position| (position, trials[position].borrow()));
            self.found_in_group(group, trials.collect(), &in_folder, &in_packs)
        };
        for some in groups.chunks(GROUPS_PER_THREAD * rayon::current_num_threads()) {
            let found: Vec<_> = some.par_iter().flat_map_iter(in_group).collect();
            found
                .into_iter()
                .for_each(|(position, found)| take(position, found));
        }
    }

    /// The stored trials of one group of folders.
    fn found_in_group<T>(
        &self,
        group: &str,
        trials: Vec<(usize, &Trial)>,
        in_folder: impl Fn(&Trial) -> Result<Option<T>, Error>,
        in_packs: impl Fn(&mut [PackReader<'_>], &Trial) -> Result<Option<T>, Error>,
    ) -> Vec<(usize, Result<T, Error>)> {
        let folder = self.root.join("trials").join(group);
        let listed: Option<HashSet<String>> =
            (trials.len() >= LIST_FROM).then(|| names(&folder).unwrap_or_default().into_iter().collect());
        // Packs are read after the folders, since trials move from folders to packs.
        let packs = self.packs();
        let mut open = packs.as_ref().ok().and_then(|packs| readers(packs).ok());
        let mut find = |trial: &Trial| match (&listed, &mut open) {
            (Some(listed), Some(packs)) if !listed.contains(&trial.id) => in_packs(packs, trial),
            // A folder that cannot be read is reported for each trial.
            _ => in_folder(trial),
        };
        let found = trials
            .into_iter()
            .map(|(position, trial)| (position, find(trial).transpose()));
        found
            .filter_map(|(position, found)| Some((position, found?)))
            .collect()
    }

    /// Each trial with its record, in the order of `trials`. Trials that [`Store::load`] refuses count as missing and
    /// are returned by their places, with the reason.
    #[must_use]
    pub fn load_all(&self, trials: &[&Arc<Trial>]) -> (Vec<TrialResult>, Vec<(usize, Error)>) {
        let none = Arc::default();
        let missing = |trial: &&Arc<Trial>| TrialResult {
            names: Arc::clone(&none),
            ..TrialResult::missing(Arc::clone(trial))
        };
        let mut all: Vec<TrialResult> = trials.iter().map(missing).collect();
        let mut unreadable = Vec::new();
        // Most trials record the same metrics, and missing ones record none.
        let mut names = BTreeSet::<Arc<Vec<String>>>::new();
        let each: Vec<&Trial> = trials.iter().map(|trial| &***trial).collect();
        let in_packs = |packs: &mut [PackReader<'_>], trial: &Trial| loaded_in(packs, self, &trial.id);
        self.each_found(
            &each,
            |trial| self.loaded(&trial.id),
            in_packs,
            |position, loaded| match loaded {
                Ok((end, table)) => {
                    let shared = names.get(&table.names).cloned().unwrap_or_else(|| {
                        let new = Arc::new(table.names);
                        names.insert(Arc::clone(&new));
                        new
                    });
                    let result = &mut all[position];
                    (result.end, result.names, result.rows) = (Some(Box::new(end)), shared, table.rows);
                }
                Err(error) => unreadable.push((position, error)),
            },
        );
        unreadable.sort_by_key(|(position, _)| *position);
        (all, unreadable)
    }
}

/// The digits of an id that name its group of folders.
fn digits(id: &str) -> &str {
    id.get(..2).unwrap_or("00")
}
