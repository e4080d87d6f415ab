//! The record of a trial that has not ended `ok`: up to a pause of a search, or up to the last measurement before a
//! number was not finite. One file in the trial's folder, `partial-STEP.parcel`, contains the metrics and their
//! acknowledgement: a text like that of `trial.json`, sealed, with the key and the digest of the metrics. The name
//! contains the step up to which the trial was measured, so that a program which lost its lease and writes late does
//! not replace a later pause: the file with the largest step counts. Earlier files are removed when it is stored, and
//! all of them when the trial has ended `ok`, since its metrics include them. Searches compare settings by this record,
//! so it is merged, checked and verified like an ended trial.

use super::{
    METRICS, Store, TrialFile, boundary, bundle, date, index, inside, pack, remove,
    sealed_folder::flush_way_to, write_durably,
};
use crate::world::fs;
use contract::{
    Error, Phase, Recorder, digest,
    metrics_file::{self, MetricsTable},
    recorder::{Row, Running},
    trial::Trial,
    trial_end::{EndState, TrialEnd},
};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// File name of a record in transit, for any step.
pub(super) const NAME: &str = "partial.parcel";
/// Parts of the file, in this order.
const FILES: [&str; 2] = [METRICS, "trial.json"];

/// The record of a trial up to a pause, or before its numbers were not finite.
#[derive(Debug, Clone, PartialEq)]
pub struct Partial {
    /// Acknowledgement of the record; its end names the reason for the stop.
    pub file: TrialFile,
    /// Metrics of the record.
    pub table: MetricsTable,
}

impl Partial {
    /// Step of the last measurement during learning; `None` if there was none.
    #[must_use]
    pub fn step(&self) -> Option<u64> {
        let measured = self.table.rows.iter().filter(|row| row.phase == Phase::Evaluate);
        measured.map(|row| row.step).max()
    }

    /// Whether this record contains the first rows of `other`, or all of them.
    pub(super) fn begins(&self, other: &Self) -> bool {
        let named = |it: &Self, row: &Row| {
            let name = it.table.names.get(usize::from(row.metric)).cloned();
            (
                row.phase,
                row.step,
                row.episode,
                row.seat,
                name,
                row.value.to_bits(),
            )
        };
        let (own, others) = (&self.table.rows, &other.table.rows);
        own.len() <= others.len()
            && own
                .iter()
                .zip(others)
                .all(|(one, another)| named(self, one) == named(other, another))
    }
}

/// The first rows of a record, with the names that they use.
pub(super) fn first_rows(record: &Recorder, count: usize) -> Recorder {
    let rows = record.rows()[..count.min(record.rows().len())].to_vec();
    let names = rows
        .iter()
        .map(|row| usize::from(row.metric) + 1)
        .max()
        .unwrap_or(0);
    Recorder::resumed(record.names()[..names].to_vec(), rows, Running::default())
}

/// Number of rows up to a step, that step included.
pub(super) fn rows_until(record: &Recorder, step: u64) -> usize {
    let rows = record.rows();
    rows.iter().position(|row| row.step > step).unwrap_or(rows.len())
}

impl Store {
    /// The record of a trial that has not ended `ok`, in its folder or in a pack; `None` if none is stored.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the file was changed, or is of another trial.
    pub fn partial(&self, id: &str) -> Result<Option<Partial>, Error> {
        match self.farthest_file(id)? {
            Some((path, bytes)) => decode(id, &bytes, &path).map(Some),
            None => self.partial_in_packs(id),
        }
    }

    /// The file of the latest pause in a trial's folder.
    fn farthest_file(&self, id: &str) -> Result<Option<(PathBuf, Vec<u8>)>, Error> {
        let folder = self.folder(id);
        for name in names_in(&folder)?.iter().rev() {
            let path = folder.join(name);
            // A file that is removed meanwhile is replaced by a later one.
            if let Some(bytes) = inside::read(&path)? {
                return Ok(Some((path, bytes)));
            }
        }
        Ok(None)
    }

    /// The step up to which the stored record of a trial that has not ended `ok` was measured; a damaged
    /// record counts as none.
    #[must_use]
    pub fn measured_until(&self, id: &str) -> Option<u64> {
        self.partial(id).ok().flatten()?.step()
    }

    /// Stores the record of a trial up to a pause, or before a number was not finite; `end` tells which. A stored
    /// record is kept if it contains more. A damaged one is set aside.
    ///
    /// # Errors
    /// [`Error::File`] if a file cannot be written.
    pub fn keep_partial(&self, trial: &Trial, end: TrialEnd, record: &Recorder) -> Result<(), Error> {
        let metrics = metrics_file::encode(record, &trial.id)?;
        let digest = digest::of_bytes(&metrics);
        let file = TrialFile {
            ended_at: Some(date::now()),
            build: self.build.clone(),
            ..TrialFile::new(trial, TrialEnd { digest, ..end }, BTreeMap::new())
        };
        let bytes = encode(&trial.id, metrics, &file)?;
        let new = decode(&trial.id, &bytes, &self.folder(&trial.id))?;
        match self.partial(&trial.id) {
            Ok(Some(known)) if known.step() > new.step() => return Ok(()),
            Ok(_) => {}
            Err(Error::Damaged { path, problem }) => self.set_partial_aside(&trial.id, &path, problem)?,
            Err(error) => return Err(error),
        }
        self.write_partial(&trial.id, &bytes, &new)
    }

    /// Writes the bytes of a record to their place, and removes the records of earlier pauses.
    pub(super) fn write_partial(&self, id: &str, bytes: &[u8], partial: &Partial) -> Result<(), Error> {
        let folder = self.folder(id);
        fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        flush_way_to(&folder)?;
        let step = partial.step().unwrap_or(0);
        write_durably(&folder.join(name_at(step)), bytes)?;
        boundary::pass("after a pause is stored", &folder);
        let earlier = names_in(&folder)?
            .into_iter()
            .filter(|name| step_of(name) < Some(step));
        earlier
            .into_iter()
            .try_for_each(|name| remove(&folder.join(name)))
    }

    /// The bytes of a trial's intact record, with their content; `None` if there are none.
    pub(super) fn partial_bytes(&self, id: &str) -> Result<Option<(Vec<u8>, Partial)>, Error> {
        let Some(partial) = self.partial(id)? else {
            return Ok(None);
        };
        let bytes = match self.farthest_file(id)? {
            Some((_, bytes)) => bytes,
            // The record lies in a pack.
            None => encode(id, self.packed_metrics(id, &partial)?, &partial.file)?,
        };
        Ok(Some((bytes, partial)))
    }

    /// The metrics and the acknowledgement of a paused trial, by their names; empty if none is stored.
    ///
    /// # Errors
    /// The errors of [`partial`](Self::partial).
    pub fn files_at_pause(&self, id: &str) -> Result<Vec<(String, Vec<u8>)>, Error> {
        let Some((bytes, _)) = self.partial_bytes(id)? else {
            return Ok(Vec::new());
        };
        let parts = parts(id, &bytes).map_err(|problem| damaged(&self.folder(id), problem))?;
        Ok(FILES.map(str::to_owned).into_iter().zip(parts).collect())
    }

    fn packed_metrics(&self, id: &str, partial: &Partial) -> Result<Vec<u8>, Error> {
        let metrics = self.metrics_in_pack(id, &partial.file.end.digest)?;
        metrics.ok_or_else(|| damaged(&self.folder(id), "its metrics at a pause are not there".into()))
    }

    /// The latest record of a paused trial in packs.
    fn partial_in_packs(&self, id: &str) -> Result<Option<Partial>, Error> {
        let mut farthest: Option<Partial> = None;
        for short in self.paused_in_packs(id)? {
            let found = of_files(id, short.metrics, &short.acknowledgement, Path::new(pack::FOLDER))?;
            if farthest.as_ref().is_none_or(|known| known.step() < found.step()) {
                farthest = Some(found);
            }
        }
        Ok(farthest)
    }

    fn set_partial_aside(&self, id: &str, path: &Path, problem: String) -> Result<(), Error> {
        let finding = super::Finding {
            path: path.strip_prefix(&self.root).unwrap_or(path).to_owned(),
            fault: super::Fault::Damaged,
            problem,
            trial: Some(id.to_owned()),
        };
        self.aside(vec![finding]).map(drop)
    }
}

/// Removes the partial records of a trial that has ended `ok`; usually there are none.
pub(super) fn forget(trial: &Path) -> Result<(), Error> {
    names_in(trial)?
        .iter()
        .try_for_each(|name| remove(&trial.join(name)))
}

/// File name of the record up to a step.
pub(super) fn name_at(step: u64) -> String {
    format!("partial-{step}.parcel")
}

/// The step in the name of a record, 0 for one that was in transit; `None` for other names.
pub(super) fn step_of(name: &str) -> Option<u64> {
    if name == NAME {
        return Some(0);
    }
    let step = name.strip_prefix("partial-")?.strip_suffix(".parcel")?;
    step.parse().ok().filter(|step| name_at(*step) == name)
}

/// File names of the records in a trial's folder, the latest last.
pub(super) fn names_in(trial: &Path) -> Result<Vec<String>, Error> {
    let mut names = super::names(trial)?;
    names.retain(|name| step_of(name).is_some());
    names.sort_by_key(|name| step_of(name));
    Ok(names)
}

/// Bytes of a record's file.
pub(super) fn encode(id: &str, metrics: Vec<u8>, file: &TrialFile) -> Result<Vec<u8>, Error> {
    let text = file
        .to_bytes()
        .map_err(|source| damaged(Path::new(NAME), source.to_string()))?;
    Ok(of_parts(id, metrics, text))
}

/// Bytes of a record's file from its two parts.
pub(super) fn of_parts(id: &str, metrics: Vec<u8>, acknowledgement: Vec<u8>) -> Vec<u8> {
    let [first, last] = FILES.map(str::to_owned);
    bundle::to_bytes(id, &[(first, metrics), (last, acknowledgement)])
}

/// The metrics and the acknowledgement in the bytes of a record's file.
pub(super) fn parts(id: &str, bytes: &[u8]) -> Result<[Vec<u8>; 2], String> {
    let files = bundle::from_bytes(id, bytes)?;
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    if names != FILES {
        return Err("it holds other files than those of a pause".into());
    }
    let parts: Vec<Vec<u8>> = files.into_iter().map(|(_, bytes)| bytes).collect();
    parts
        .try_into()
        .map_err(|_| "it holds more than two files".into())
}

/// The record of the trial `id` in the bytes of a file.
pub(super) fn decode(id: &str, bytes: &[u8], path: &Path) -> Result<Partial, Error> {
    let [metrics, text] = parts(id, bytes).map_err(|problem| damaged(path, problem))?;
    if of_parts(id, metrics.clone(), text.clone()) != bytes {
        return Err(damaged(path, "its first line is not as it was written".into()));
    }
    of_files(id, metrics, &text, path)
}

fn of_files(id: &str, metrics: Vec<u8>, text: &[u8], path: &Path) -> Result<Partial, Error> {
    if let Some(problem) = index::newer(text) {
        let path = path.to_owned();
        return Err(Error::Newer { path, problem });
    }
    let stored = index::parse(text).map_err(|problem| damaged(path, problem))?;
    let file: TrialFile = serde_json::from_slice(text).map_err(|source| damaged(path, source.to_string()))?;
    if stored.id() != id || file.key.id() != id {
        return Err(damaged(path, format!("it belongs to trial {}", file.key.id())));
    }
    if !matches!(file.end.state, EndState::Paused | EndState::Nan) {
        let state = file.end.state.name();
        return Err(damaged(
            path,
            format!("a trial that ended as {state} keeps no such file"),
        ));
    }
    if digest::of_bytes(&metrics) != file.end.digest {
        return Err(damaged(path, "its hash is not the acknowledged one".into()));
    }
    let table = metrics_file::decode(metrics, path)?;
    Ok(Partial { file, table })
}

fn damaged(path: &Path, problem: String) -> Error {
    Error::Damaged {
        path: path.to_owned(),
        problem,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::stub::trial;
    use proptest::prelude::*;

    fn end(state: EndState) -> TrialEnd {
        TrialEnd {
            state,
            reason: String::new(),
            wall_s: 1.0,
            decision_s: None,
            device: None,
            digest: String::new(),
        }
    }

    fn record(measurements: u64) -> Recorder {
        let mut record = Recorder::default();
        for number in 1..=measurements {
            record.add(Phase::Train, 100 * number, 0, 0, "loss", 0.1 * number as f64);
            record.add(Phase::Evaluate, 100 * number, 0, 0, "return", 0.3 * number as f64);
        }
        record
    }

    #[test]
    fn what_a_trial_had_recorded_comes_back_and_never_becomes_less() {
        let folder = tempfile::tempdir().unwrap();
        let (store, trial) = (Store::at(folder.path()), trial(4, 0));
        assert_eq!(store.partial(&trial.id).unwrap(), None);
        for (paused, kept) in [(1, 100), (3, 300), (2, 300)] {
            store
                .keep_partial(&trial, end(EndState::Paused), &record(paused))
                .unwrap();
            assert_eq!(store.measured_until(&trial.id), Some(kept));
        }
        let partial = store.partial(&trial.id).unwrap().unwrap();
        assert_eq!(partial.table.rows, record(3).rows());
        assert_eq!(store.end(&trial.id).unwrap(), None, "it has not ended");
        // The final metrics contain the whole record.
        store.finish(&trial, &record(4), 1.0).unwrap();
        assert_eq!(store.partial(&trial.id).unwrap(), None);
    }

    #[test]
    fn who_writes_late_takes_nothing_of_a_later_pause_away() {
        let folder = tempfile::tempdir().unwrap();
        let (store, trial) = (Store::at(folder.path()), trial(4, 0));
        let keep = |rows| {
            store
                .keep_partial(&trial, end(EndState::Paused), &record(rows))
                .unwrap();
        };
        let place = store.folder(&trial.id);
        keep(2);
        let late = fs::read(place.join(name_at(200))).unwrap();
        keep(4);
        assert_eq!(names_in(&place).unwrap(), [name_at(400)]);
        // The late writer had checked the store before the other one wrote.
        let partial = decode(&trial.id, &late, &place).unwrap();
        store.write_partial(&trial.id, &late, &partial).unwrap();
        assert_eq!(store.measured_until(&trial.id), Some(400));
        keep(5);
        assert_eq!(names_in(&place).unwrap(), [name_at(500)]);
    }

    #[test]
    fn the_rows_until_a_step_are_the_same_however_many_follow() {
        let (short, long) = (record(2), record(5));
        let until = |record: &Recorder| first_rows(record, rows_until(record, 200));
        let [one, other] = [until(&short), until(&long)].map(|it| metrics_file::encode(&it, "id").unwrap());
        assert_eq!(one, other);
        let mut later = record(2);
        later.add(Phase::Evaluate, 300, 0, 0, "of later", 1.0);
        assert_eq!(metrics_file::encode(&until(&later), "id").unwrap(), one);
    }

    #[test]
    fn what_is_damaged_is_set_aside_before_it_is_written_anew() {
        let folder = tempfile::tempdir().unwrap();
        let (store, trial) = (Store::at(folder.path()), trial(4, 0));
        store
            .keep_partial(&trial, end(EndState::Paused), &record(3))
            .unwrap();
        fs::write(store.folder(&trial.id).join(name_at(300)), "of somebody else").unwrap();
        assert!(matches!(store.partial(&trial.id), Err(Error::Damaged { .. })));
        store
            .keep_partial(&trial, end(EndState::Paused), &record(2))
            .unwrap();
        assert_eq!(store.measured_until(&trial.id), Some(200));
        let aside = folder.path().join("aside/1/trials");
        assert!(fs::exists(&aside));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn every_changed_bit_and_every_cut_is_found(place in 0.0..1.0f64, bit in 0u8..8) {
            let folder = tempfile::tempdir().unwrap();
            let (store, trial) = (Store::at(folder.path()), trial(4, 0));
            store.keep_partial(&trial, end(EndState::Nan), &record(2)).unwrap();
            let path = store.folder(&trial.id).join(name_at(200));
            let mut bytes = fs::read(&path).unwrap();
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss,
                reason = "a place in the file")]
            let index = (place * bytes.len() as f64) as usize;
            fs::write(&path, &bytes[..index]).unwrap();
            prop_assert!(store.partial(&trial.id).is_err());
            bytes[index] ^= 1 << bit;
            fs::write(&path, &bytes).unwrap();
            prop_assert!(store.partial(&trial.id).is_err(), "bit {bit} of byte {index}");
        }
    }
}
