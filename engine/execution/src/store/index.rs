//! Reads the ends of many trials of a store at once, and lists its trials.
//!
//! Only the requested part of each `trial.json` is parsed: the configs, which are most of it, are skipped. The ids of
//! its parts, its seed and its numerics version show that a file belongs to the trial whose folder contains it.

use super::{Store, TRIAL_SCHEMA, inside, names, seal::is_sealed};
use crate::store::{StoredCell, Took};
use contract::{
    Build, Error,
    form_version::form_version,
    trial::{Trial, trial_id},
    trial_end::{EndState, TrialEnd},
};
use rayon::prelude::*;
use serde::{Deserialize, de::IgnoredAny};
use std::{
    borrow::Borrow,
    collections::{BTreeMap, BTreeSet, HashSet},
    path::Path,
};

/// Values that were read for many trials.
#[derive(Debug)]
pub struct TrialValues<T> {
    /// One entry per trial, in their order; `None` if it has not run, or if its file cannot be used.
    pub all: Vec<Option<T>>,
    /// Trials, by their places, with faulty files, and the reasons.
    pub unreadable: Vec<(usize, Error)>,
}

impl<T> TrialValues<T> {
    fn none(count: usize) -> Self {
        let mut all = Vec::new();
        all.resize_with(count, || None);
        let unreadable = Vec::new();
        Self { all, unreadable }
    }

    fn note(&mut self, position: usize, found: Result<T, Error>) {
        match found {
            Ok(found) => self.all[position] = Some(found),
            Err(error) => self.unreadable.push((position, error)),
        }
    }

    fn in_order(mut self) -> Self {
        self.unreadable.sort_by_key(|(position, _)| *position);
        self
    }
}

/// A stored trial without its configs.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredTrial {
    /// Ids of environment, agent and protocol.
    pub parts: [String; 3],
    /// Seed of the trial.
    pub seed: u64,
    /// Version of the shared numerical code.
    pub numerics: u32,
    /// End of the trial.
    pub end: TrialEnd,
    /// Time of the end according to the file; `None` if the program that stored it did not record it.
    pub ended_at: Option<String>,
    /// Source code of the program that computed the trial, if it was recorded.
    pub build: Option<Build>,
}

impl StoredTrial {
    /// Id of the trial.
    pub(super) fn id(&self) -> String {
        let parts = self.parts.each_ref().map(String::as_str);
        trial_id(parts, self.seed, self.numerics)
    }
}

impl Store {
    /// Ends of trials, for callers that read no metrics: without the digests of metrics, which would fill the memory
    /// for a million trials.
    #[must_use]
    pub fn outcomes(&self, trials: &[impl Borrow<Trial> + Sync]) -> TrialValues<TrialEnd> {
        let without_digest = |it: StoredTrial| TrialEnd {
            digest: String::new(),
            ..it.end
        };
        self.stored_of(trials, without_digest)
    }

    /// Ends of trials, as [`Store::end`] returns them, from every acknowledgement, since a damaged one must be found
    /// before trials run.
    #[must_use]
    pub fn ends(&self, trials: &[impl Borrow<Trial> + Sync]) -> TrialValues<TrialEnd> {
        let mut found = TrialValues::none(trials.len());
        self.each_acknowledged(trials, |at, stored| found.note(at, stored.map(|it| it.end)));
        found.in_order()
    }

    /// The value of `keep` for each stored trial; for trials in packs, the outlines of the packs are used.
    #[must_use]
    pub fn stored_of<T>(
        &self,
        trials: &[impl Borrow<Trial> + Sync],
        mut keep: impl FnMut(StoredTrial) -> T,
    ) -> TrialValues<T> {
        let mut found = TrialValues::none(trials.len());
        self.each_stored(trials, |at, stored| found.note(at, stored.map(&mut keep)));
        found.in_order()
    }

    /// A trial without its configs; `None` if it has not run.
    ///
    /// # Errors
    /// [`Error::Damaged`] if its file is faulty.
    pub fn stored(&self, id: &str) -> Result<Option<StoredTrial>, Error> {
        Ok(self.acknowledged(id)?.map(|(_, trial)| trial))
    }

    /// The text of a trial's `trial.json`, which is intact and belongs to this trial, with the value of
    /// [`Store::stored`].
    pub(super) fn acknowledged(&self, id: &str) -> Result<Option<(Vec<u8>, StoredTrial)>, Error> {
        let path = self.folder(id).join("trial.json");
        let Some(text) = inside::read(&path)? else {
            return self.acknowledged_in_pack(id);
        };
        let damaged = |problem: String| Error::Damaged {
            path: path.clone(),
            problem,
        };
        if let Some(problem) = newer(&text) {
            return Err(Error::Newer { path, problem });
        }
        let trial = parse(&text).map_err(damaged)?;
        let own = trial.id();
        if own != id {
            return Err(damaged(format!("it belongs to trial {own}")));
        }
        if trial.end.state == EndState::Ok {
            return Ok(Some((text, trial)));
        }
        // A process that was suspended while its computation failed may have stored the failure after the
        // trial was packed.
        let packed = self.acknowledged_in_pack(id)?;
        let packed = packed.filter(|(_, trial)| trial.end.state == EndState::Ok);
        Ok(Some(packed.unwrap_or((text, trial))))
    }

    /// The distinct combinations of parts and device in the store, each with its seeds.
    ///
    /// `known` are trials that are known to be stored, with their ends; at most `most` others are read.
    /// Faulty files are skipped.
    #[must_use]
    pub fn cells(&self, known: &[(&Trial, &TrialEnd)], most: usize) -> Vec<StoredCell> {
        if most == 0 {
            return of_plan(known);
        }
        let read: HashSet<&str> = known.iter().map(|(trial, _)| trial.id.as_str()).collect();
        let mut ids = self.ids();
        ids.retain(|id| !read.contains(id.as_str()));
        ids.truncate(most);
        let others: Vec<_> = ids
            .par_iter()
            .filter_map(|id| Some((id.as_str(), self.stored(id).ok()??)))
            .collect();
        let mut cells: BTreeMap<_, (&str, BTreeSet<u64>, Took)> = BTreeMap::new();
        for (id, trial) in &others {
            let parts = trial.parts.each_ref().map(String::as_str);
            let cell = cells
                .entry((parts, trial.numerics, &trial.end.device))
                .or_insert_with(|| (id, BTreeSet::new(), Took::default()));
            cell.1.insert(trial.seed);
            cell.2.add(took(&trial.end));
        }
        let cells: Vec<_> = cells.into_iter().collect();
        let cell = |((_, _, device), (id, seeds, took)): ((_, _, &Option<String>), (&str, _, _))| {
            Some(StoredCell {
                key: self.file(id).ok()??.key,
                seeds,
                device: device.clone(),
                took,
            })
        };
        let others = cells.into_par_iter().filter_map(cell).collect::<Vec<_>>();
        of_plan(known).into_iter().chain(others).collect()
    }

    /// The ids of the trials that have a place in the store and whose ids begin with `prefix`, in order.
    #[must_use]
    pub fn ids_beginning_with(&self, prefix: &str) -> Vec<String> {
        self.ids()
            .into_iter()
            .filter(|id| id.starts_with(prefix))
            .collect()
    }

    /// The ids of all trials that have a folder or lie in a pack, in order.
    pub(super) fn ids(&self) -> Vec<String> {
        let mut ids = self.ids_with_folders();
        for pack in self.packs().unwrap_or_default() {
            ids.extend(pack.ids());
        }
        ids.sort_unstable();
        ids.dedup();
        ids
    }

    /// The ids of all trials that have a folder, in order.
    pub(super) fn ids_with_folders(&self) -> Vec<String> {
        let trials = self.root.join("trials");
        // A folder that cannot be listed holds no trial; `fsck` reports it.
        let in_folder = |folder: &Path| names(folder).unwrap_or_default();
        let mut ids: Vec<String> = in_folder(&trials)
            .iter()
            .flat_map(|group| in_folder(&trials.join(group)))
            .collect();
        ids.sort_unstable();
        ids
    }
}

/// The combinations of trials of a plan. Neighbours with the same parts form one; equal combinations elsewhere are
/// joined when combinations are compared.
fn of_plan(trials: &[(&Trial, &TrialEnd)]) -> Vec<StoredCell> {
    trials
        .chunk_by(|(one, its_end), (other, end)| {
            one.key.shares_parts(&other.key) && its_end.device == end.device
        })
        .map(|cell| StoredCell {
            key: cell[0].0.key.clone(),
            device: cell[0].1.device.clone(),
            seeds: cell.iter().map(|(trial, _)| trial.key.seed).collect(),
            took: cell.iter().fold(Took::default(), |mut sum, (_, end)| {
                sum.add(took(end));
                sum
            }),
        })
        .collect()
}

/// Time of a trial that ended successfully; that of a failed trial says nothing about a complete one.
fn took(end: &TrialEnd) -> Took {
    match end.state {
        EndState::Ok => Took::once(end.wall_s),
        _ => Took::default(),
    }
}

/// The part of a `trial.json` that is parsed.
#[derive(Deserialize)]
struct Outline<'a> {
    schema: u32,
    #[serde(borrow, default)]
    parts: Option<[&'a str; 3]>,
    /// Files that the acknowledgement names besides the metrics, by path.
    #[serde(default)]
    files: BTreeMap<String, IgnoredAny>,
    key: Replicate,
    end: TrialEnd,
    #[serde(default)]
    ended_at: Option<String>,
    build: Option<Build>,
}

#[derive(Deserialize)]
struct Replicate {
    seed: u64,
    numerics: u32,
}

/// Signs that a later program wrote a `trial.json`. A text whose checksum does not match is not used.
pub(super) fn newer(text: &[u8]) -> Option<String> {
    let schema = form_version(text).ok()?;
    (schema > TRIAL_SCHEMA && is_sealed(text)).then(|| format!("version {schema} of its form"))
}

/// The checksum is verified first: the form that a file declares is not used before that.
pub(super) fn parse(text: &[u8]) -> Result<StoredTrial, String> {
    let outline: Outline<'_> = serde_json::from_slice(text).map_err(|source| source.to_string())?;
    if !is_sealed(text) {
        let earlier = "it carries no check that holds: an earlier program made it, or it was changed";
        return Err(if outline.schema < TRIAL_SCHEMA {
            earlier.into()
        } else {
            "its check does not hold".into()
        });
    }
    if outline.schema != TRIAL_SCHEMA {
        return Err(format!(
            "version {} of its form is not known to this program",
            outline.schema
        ));
    }
    if let Some(name) = outline.files.keys().find(|name| !inside::is_artifact(name)) {
        return Err(format!("it names a file that is none of a trial's: `{name}`"));
    }
    let Outline {
        parts,
        key: Replicate { seed, numerics },
        end,
        build,
        ended_at,
        ..
    } = outline;
    let parts = parts.ok_or("it does not name its parts")?.map(str::to_owned);
    Ok(StoredTrial {
        parts,
        seed,
        numerics,
        end,
        ended_at,
        build,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::stub::trial;
    use contract::Recorder;
    use serde_json::json;
    use std::fs;

    fn acknowledge(store: &Store, trial: &Trial, state: EndState) {
        let end = TrialEnd {
            state,
            reason: "told".into(),
            wall_s: 1.0,
            decision_s: None,
            device: None,
            digest: String::new(),
        };
        store.acknowledge(trial, end).unwrap();
    }

    #[test]
    fn many_ends_at_once_are_the_ends_one_by_one() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let trials: Vec<Trial> = (0..500).map(|seed| trial(4, seed)).collect();
        assert!(
            store.ends(&trials).all.iter().all(Option::is_none),
            "nothing is stored yet"
        );
        for (trial, state) in trials.iter().step_by(7).zip(
            [EndState::Ok, EndState::Nan, EndState::Killed]
                .into_iter()
                .cycle(),
        ) {
            acknowledge(&store, trial, state);
        }
        for (trial, end) in trials.iter().zip(store.ends(&trials).all) {
            assert_eq!(end, store.end(&trial.id).unwrap());
        }
    }

    #[test]
    fn files_of_another_trial_and_broken_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let trials = [trial(4, 1), trial(4, 2), trial(4, 3)];
        trials
            .iter()
            .for_each(|trial| acknowledge(&store, trial, EndState::Ok));
        let file = |trial: &Trial| store.folder(&trial.id).join("trial.json");
        fs::copy(file(&trials[0]), file(&trials[1])).unwrap();
        fs::write(file(&trials[2]), "{").unwrap();
        let TrialValues { all, unreadable } = store.ends(&trials);
        assert!(all[0].is_some() && all[1].is_none() && all[2].is_none());
        let [(1, Error::Damaged { problem, .. }), (2, Error::Damaged { .. })] = &unreadable[..] else {
            panic!("{unreadable:?}")
        };
        assert!(problem.contains(&trials[0].id));
    }

    #[test]
    fn a_file_that_calls_itself_older_is_not_believed_without_its_check() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let trial = trial(4, 1);
        store.finish(&trial, &Recorder::default(), 1.0).unwrap();
        let path = store.folder(&trial.id).join("trial.json");
        let whole = fs::read_to_string(&path).unwrap();
        for older in [
            whole.replace("\"schema\":2", "\"schema\":1"),
            whole.replace(",\"check\":", ",\"checked\":"),
        ] {
            assert_ne!(older, whole);
            fs::write(&path, older).unwrap();
            let Err(Error::Damaged { problem, .. }) = store.stored(&trial.id) else {
                panic!("it is believed")
            };
            assert!(problem.contains("check"), "{problem}");
        }
    }

    #[test]
    fn files_say_which_program_made_them_and_those_that_do_not_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let build = Build::told("ffa07ec12345", "true");
        let (silent, telling) = (
            Store::at(folder.path()),
            Store::at(folder.path()).by(build.clone()),
        );
        acknowledge(&silent, &trial(4, 1), EndState::Ok);
        acknowledge(&telling, &trial(4, 2), EndState::Ok);
        let built = |seed: u64| silent.stored(&trial(4, seed).id).unwrap().unwrap().build;
        assert_eq!((built(1), built(2)), (None, build));
        let text = fs::read_to_string(silent.folder(&trial(4, 1).id).join("trial.json")).unwrap();
        assert!(
            !text.contains("\"build\""),
            "as programs wrote it that knew no builds: {text}"
        );
    }

    #[test]
    fn cells_are_combinations_of_parts_with_their_seeds() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        for trial in [trial(4, 0), trial(4, 2), trial(8, 1)] {
            acknowledge(&store, &trial, EndState::Ok);
        }
        let mut cells = store.cells(&[], usize::MAX);
        cells.sort_by_key(|cell| cell.seeds.len());
        assert_eq!(cells.len(), 2);
        assert_eq!(*cells[0].key.environment.config, json!({"cells": 8}));
        assert_eq!(
            (&cells[1].seeds, cells[1].took.trials),
            (&BTreeSet::from([0, 2]), 2)
        );
        assert_eq!(store.cells(&[], 1).len(), 1);
        let (known, end) = (trial(8, 1), store.end(&trial(8, 1).id).unwrap().unwrap());
        assert_eq!(
            store.cells(&[(&known, &end)], usize::MAX).len(),
            2,
            "what is known is not read"
        );
        let alone = store.cells(&[(&known, &end)], 0);
        assert_eq!((alone.len(), alone[0].took), (1, Took::once(end.wall_s)));
    }
}
