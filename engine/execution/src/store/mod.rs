//! The store: the files of every trial, by the trial's id. The store is also the queue: missing trials are the ones
//! that run.
//!
//! ```text
//! <root>/trials/<first two digits>/<id>/
//!     metrics.parquet      the record of an `ok` trial, long form
//!     trial.json           the acknowledgement: key, end state, digest of metrics.parquet
//!     policy.safetensors   the learned policy, where there is one, or <seat>/policy.safetensors
//!     networks.safetensors, dataset/, choice.json, graph.json, images.png
//!                          further artifacts, see [`ArtifactKind`](contract::ArtifactKind)
//!     earlier.json         the earlier end, while the trial is tried again
//!     running/             while the trial runs: its rows so far and a checkpoint, see [`RunningTrial`]
//!     partial-4.parcel     the record at a pause, or before a number was not finite, see [`Partial`]
//! ```
//!
//! A trial that ended `ok` and left only metrics may lie in `<root>/packs/<digest>.pack` together with others.
//!
//! Every file is written beside its place, flushed to the disk and renamed. `trial.json` comes last: a trial without it
//! has not run, whatever else is in its folder.

mod announced;
mod artifacts;
mod aside;
mod boundary;
mod bucket;
mod bundle;
mod date;
mod durable;
mod earlier;
mod fingerprint;
mod fsck;
mod groups;
mod index;
mod inside;
mod lease;
mod lending;
mod merge;
pub mod metric_log;
mod obstacle;
mod owner;
mod pack;
mod partial;
mod recognition;
mod remade;
mod repeats;
mod running;
mod seal;
mod sealed_folder;
mod seen;
mod stored_cell;
#[cfg(test)]
mod stub;
mod values;

pub use announced::Announcements;
pub use boundary::install as install_boundary_hook;
pub(crate) use bucket::BucketLeases;
pub use bucket::{Bucket, Object, ObjectStorage, Objects, RegisterObjectStorage, WriteCondition};
pub(crate) use bundle::{Bundle, BundleError, Manifest, read_bytes};
pub use date::{now, rfc_3339_of, seconds_of};
pub(crate) use durable::absent_is_fine;
pub use durable::{names, write_durably};
pub use fingerprint::{Difference, Fingerprint};
pub use fsck::{Fault, Finding, Findings};
pub use index::{StoredTrial, TrialValues};
pub(crate) use inside::read as read_file;
pub use lease::{Claim, LONGEST_EXPIRY, Leases};
pub use merge::{Fate, Merge, Merged, Side};
pub use owner::Owner;
pub use pack::Packing;
pub use partial::Partial;
pub use recognition::{is_store, no_store};
pub use running::RunningTrial;
pub(crate) use running::work;
pub(crate) use sealed_folder::flush_way;
pub use seen::{Fixed, SeenVerdicts, is_record};
pub use stored_cell::{StoredCell, Took};

use crate::world::fs;
use contract::{
    Build, Error, Recorder, digest,
    metrics_file::{self, MetricsTable},
    trial::{Trial, TrialKey},
    trial_end::{EndState, TrialEnd, is_missing},
    trial_result::TrialResult,
};
use durable::{remove, temporary, write_new_durably};
use lease::Announcement;
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

/// Trials on disk, below one folder.
#[derive(Debug, Clone)]
pub struct Store {
    root: PathBuf,
    /// Source code to store as that of the program that computed a trial.
    build: Option<Build>,
    /// Device to store as that of the run that computed a trial.
    device: Option<String>,
    packs: Arc<pack::Packs>,
    /// The bucket through which the trials are shared with other machines.
    bucket: Option<Bucket>,
}

/// Content of `trial.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialFile {
    /// Version of the file's form.
    pub schema: u32,
    /// Ids of environment, agent and protocol, with which the end can be read without the configs.
    #[serde(default)]
    pub parts: Option<[String; 3]>,
    /// The key of the trial: everything that determined its numbers.
    pub key: TrialKey,
    /// End of the trial.
    pub end: TrialEnd,
    /// Time of the end, in UTC in the format of RFC 3339; absent if the program did not record it. It is not part of
    /// any id or digest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended_at: Option<String>,
    /// Source code of the program that computed the trial, if known. It is not part of any id.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub build: Option<Build>,
    /// Hashes of the trial's artifacts, by path inside its folder: a policy, networks, a dataset, a choice,
    /// drawings.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
    /// Hash of the trial's output, if that is kept. It is no result: honest runs of one trial differ in it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output: Option<String>,
    /// Whether the agent trained itself, as a program does. Honest runs of it may differ, and the run that was stored
    /// first is kept.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub trained_itself: bool,
}

/// The file of a trial's metrics.
const METRICS: &str = "metrics.parquet";

/// The file of a trial's output, compressed by gzip.
pub const OUTPUT: &str = "output.gz";

impl TrialFile {
    /// Acknowledgement that `trial` ended as `end` and left `files`, which are named with their hashes.
    #[must_use]
    pub fn new(trial: &Trial, end: TrialEnd, files: BTreeMap<String, String>) -> Self {
        let parts = Some(trial.key.part_ids());
        Self {
            schema: TRIAL_SCHEMA,
            parts,
            key: trial.key.clone(),
            end,
            ended_at: None,
            build: None,
            files,
            output: None,
            trained_itself: false,
        }
    }

    /// Whether another acknowledgement names the same bytes, in which case the values are the same.
    fn names_same_bytes(&self, other: &Self) -> bool {
        let named = |it: &Self| (it.end.state, it.end.digest.clone(), it.files.clone());
        named(self) == named(other)
    }

    /// Text of the file.
    ///
    /// # Errors
    /// The error of a config that cannot be written as JSON.
    pub fn to_bytes(&self) -> Result<Vec<u8>, serde_json::Error> {
        Ok(seal::sealed(serde_json::to_vec(self)?))
    }
}

/// End and metrics of a trial; there are no metrics unless it ended `ok`.
type EndWithMetrics = (TrialEnd, MetricsTable);

/// The folder of the records of verdicts that were seen.
const LOOKS: &str = "looks";

/// Version of `trial.json`: from 2 on it ends with a hash of the text before it.
const TRIAL_SCHEMA: u32 = 2;

impl Store {
    /// The store under `root`; no folder is created before the first trial ends.
    #[must_use]
    pub fn at(root: impl Into<PathBuf>) -> Self {
        Self {
            root: root.into(),
            build: None,
            device: None,
            packs: Arc::default(),
            bucket: None,
        }
    }

    /// The same store, for a program that knows the source code from which it was built.
    #[must_use]
    pub fn by(self, build: Option<Build>) -> Self {
        Self { build, ..self }
    }

    /// The same store, for a process whose trials use this device besides the processor.
    #[must_use]
    pub fn on(self, device: Option<&str>) -> Self {
        let device = device.map(Into::into);
        Self { device, ..self }
    }

    /// Folder of the store.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Folder of a trial.
    #[must_use]
    pub fn folder(&self, id: &str) -> PathBuf {
        self.root
            .join("trials")
            .join(id.get(..2).unwrap_or("00"))
            .join(id)
    }

    /// End of a trial; `None` if it has not run.
    ///
    /// # Errors
    /// [`Error::Damaged`] if its file is faulty.
    pub fn end(&self, id: &str) -> Result<Option<TrialEnd>, Error> {
        Ok(self.stored(id)?.map(|trial| trial.end))
    }

    /// Stores the record of an `ok` trial and acknowledges it. Calling it twice has no further effect.
    ///
    /// # Errors
    /// [`Error::File`] if a file cannot be written.
    pub fn finish(&self, trial: &Trial, record: &Recorder, wall_s: f64) -> Result<TrialEnd, Error> {
        let folder = self.folder(&trial.id);
        fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        let bytes = metrics_file::encode(record, &trial.id)?;
        write_durably(&folder.join(METRICS), &bytes)?;
        let end = TrialEnd {
            state: EndState::Ok,
            reason: String::new(),
            wall_s,
            decision_s: record.decision_s(),
            device: self.device.clone(),
            digest: digest::of_bytes(&bytes),
        };
        self.acknowledge_with(trial, end, artifacts::exported(&folder)?)
    }

    /// Acknowledges the end of a trial, and returns the end that is then stored. A process that was suspended while it
    /// failed may continue after another one has computed the trial: a valid end is kept.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be written.
    pub fn acknowledge(&self, trial: &Trial, end: TrialEnd) -> Result<TrialEnd, Error> {
        self.acknowledge_with(trial, end, BTreeMap::new())
    }

    fn acknowledge_with(
        &self,
        trial: &Trial,
        end: TrialEnd,
        files: BTreeMap<String, String>,
    ) -> Result<TrialEnd, Error> {
        let folder = self.folder(&trial.id);
        fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        let (ended_at, build) = (Some(date::now()), self.build.clone());
        let file = TrialFile {
            ended_at,
            build,
            output: running::settle_output(&folder)?,
            trained_itself: running::has_work(&folder),
            ..TrialFile::new(trial, end.clone(), files)
        };
        sealed_folder::flush_way_to(&folder)?;
        let path = folder.join("trial.json");
        let text = file.to_bytes().map_err(|source| Error::Damaged {
            path: path.clone(),
            problem: source.to_string(),
        })?;
        let end = if end.state == EndState::Ok {
            write_durably(&path, &text)?;
            partial::forget(&folder)?;
            end
        } else {
            self.publish_failure(&trial.id, &path, &text)?.unwrap_or(end)
        };
        earlier::forget(&folder)?;
        Ok(end)
    }

    /// Puts the acknowledgement of a failure at `path`, unless there is a valid end, which is then returned. The file
    /// is linked, not renamed: a rename would replace a file that another process put there at this moment.
    fn publish_failure(&self, id: &str, path: &Path, text: &[u8]) -> Result<Option<TrialEnd>, Error> {
        loop {
            let stored = self.end(id)?;
            if stored.is_some() && !is_missing(stored.as_ref()) {
                return Ok(stored);
            }
            if stored.is_some() {
                self.put_missing_end_aside(path)?;
            }
            if write_new_durably(path, text)? {
                return Ok(None);
            }
        }
    }

    /// Removes the acknowledgement of a trial that was killed, and no other one.
    fn put_missing_end_aside(&self, path: &Path) -> Result<(), Error> {
        let aside = temporary(path);
        absent_is_fine(fs::rename(path, &aside)).map_err(Error::file("rename to", &aside))?;
        let moved = inside::read(&aside)?.and_then(|text| index::parse(&text).ok());
        if moved.is_some_and(|moved| !is_missing(Some(&moved.end))) {
            // Another process has put this acknowledgement there since the check.
            return fs::rename(&aside, path).map_err(Error::file("rename to", path));
        }
        remove(&aside)
    }

    /// Acknowledgement of a trial; `None` if it has none.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the file was changed, or is of another trial.
    pub fn file(&self, id: &str) -> Result<Option<TrialFile>, Error> {
        let path = self.folder(id).join("trial.json");
        let Some((text, _)) = self.acknowledged(id)? else {
            return Ok(None);
        };
        let damaged = |problem: String| Error::Damaged {
            path: path.clone(),
            problem,
        };
        let file: TrialFile = serde_json::from_slice(&text).map_err(|source| damaged(source.to_string()))?;
        let own = file.key.id();
        if own != id {
            return Err(damaged(format!("it belongs to trial {own}")));
        }
        Ok(Some(file))
    }

    /// A trial with its complete record.
    ///
    /// # Errors
    /// [`Error::Damaged`] if a file differs from the acknowledged one.
    pub fn load(&self, trial: &Arc<Trial>) -> Result<TrialResult, Error> {
        let mut result = TrialResult::missing(Arc::clone(trial));
        if let Some((end, table)) = self.loaded(&trial.id)? {
            (result.end, result.names, result.rows) =
                (Some(Box::new(end)), Arc::new(table.names), table.rows);
        }
        Ok(result)
    }

    /// End and metrics of a trial; `None` if it has not run.
    fn loaded(&self, id: &str) -> Result<Option<EndWithMetrics>, Error> {
        let Some(end) = self.end(id)? else {
            return Ok(None);
        };
        let table = self.recorded(id, &end)?;
        Ok(Some((end, table)))
    }

    /// Metrics of a trial with this end, from the file that was acknowledged.
    fn recorded(&self, id: &str, end: &TrialEnd) -> Result<MetricsTable, Error> {
        self.decoded(id, end, || self.metrics(id, &end.digest))
    }

    /// Metrics of a trial with this end, decoded from the file that `metrics` reads; empty unless it ended
    /// `ok`.
    fn decoded(
        &self,
        id: &str,
        end: &TrialEnd,
        metrics: impl FnOnce() -> Result<Vec<u8>, Error>,
    ) -> Result<MetricsTable, Error> {
        match end.state {
            EndState::Ok => metrics_file::decode(metrics()?, &self.folder(id).join(METRICS)),
            _ => Ok(MetricsTable::default()),
        }
    }

    /// Adds the partial record of a trial of a search that has not ended `ok`. An earlier program kept the measurements
    /// at a pause only in the log; therefore the log of a trial without a stored record is read up to its last complete
    /// frame.
    ///
    /// # Errors
    /// [`Error::Damaged`] if a stored file was changed.
    pub fn read_partial(&self, result: &mut TrialResult) -> Result<(), Error> {
        if result.is_ok() || !result.trial.cell.purpose.is_tried() {
            return Ok(());
        }
        let id = &result.trial.id;
        let log = || metric_log::read(&self.folder(id).join("running").join("metrics.log"));
        let table = match self.partial(id)? {
            Some(partial) => Some(partial.table),
            None if is_missing(result.end.as_deref()) => log().ok().map(|log| log.table),
            None => None,
        };
        if let Some(table) = table {
            (result.names, result.rows) = (table.names.into(), table.rows);
        }
        Ok(())
    }

    /// Bytes of `trial.json` and of `metrics.parquet` of a trial that ended `ok`, in its folder or in a pack.
    ///
    /// # Errors
    /// [`Error::Damaged`] if one is absent or differs from the acknowledged one.
    pub fn files(&self, id: &str) -> Result<[Vec<u8>; 2], Error> {
        let absent = || Error::Damaged {
            path: self.folder(id).join("trial.json"),
            problem: "it is not there".into(),
        };
        let (text, stored) = self.acknowledged(id)?.ok_or_else(absent)?;
        Ok([text, self.metrics(id, &stored.end.digest)?])
    }

    /// The metrics file of a trial, compared with its acknowledged hash.
    fn metrics(&self, id: &str, digest: &str) -> Result<Vec<u8>, Error> {
        let path = self.folder(id).join(METRICS);
        match inside::read(&path)? {
            Some(bytes) if digest::of_bytes(&bytes) == digest => Ok(bytes),
            Some(_) => Err(Error::Damaged {
                path,
                problem: "its hash is not the acknowledged one".into(),
            }),
            // The file may have moved into a pack, even at this moment.
            None => match self.metrics_in_pack(id, digest)? {
                Some(bytes) => Ok(bytes),
                None => Err(self.without_metrics(id, path)),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::Phase;

    fn trial(seed: u64) -> Trial {
        stub::trial(4, seed)
    }

    fn record() -> Recorder {
        let mut record = Recorder::default();
        record.add(Phase::Evaluate, 1000, 0, 0, "return", 0.1 + 0.2);
        record.add(Phase::Final, 2000, 3, 1, "cycle_length", -7.0);
        record
    }

    #[test]
    fn what_was_recorded_comes_back_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        assert_eq!(store.end(&trial(1).id).unwrap(), None);
        let first = store.finish(&trial(1), &record(), 1.0).unwrap();
        let second = store.finish(&trial(1), &record(), 2.0).unwrap();
        assert_eq!(first.digest, second.digest);
        assert!(
            store
                .stored(&trial(1).id)
                .unwrap()
                .unwrap()
                .ended_at
                .is_some_and(|date| date.ends_with('Z'))
        );
        let loaded = store.load(&trial(1).into()).unwrap();
        assert_eq!(loaded.rows, record().rows());
        assert_eq!(*loaded.names, record().names());
    }

    fn ended(state: EndState) -> TrialEnd {
        TrialEnd {
            state,
            reason: "told".into(),
            wall_s: 1.0,
            decision_s: None,
            device: None,
            digest: String::new(),
        }
    }

    #[test]
    fn a_failure_takes_the_place_of_a_kill_and_of_no_end_that_holds() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let (killed, failed) = (ended(EndState::Killed), ended(EndState::Failed));
        let say = |end: &TrialEnd| store.acknowledge(&trial(1), end.clone()).unwrap();
        assert_eq!(say(&killed), killed);
        assert_eq!(say(&failed), failed);
        assert_eq!(say(&killed), failed);
        let ok = store.finish(&trial(1), &record(), 1.0).unwrap();
        assert_eq!(store.acknowledge(&trial(1), failed).unwrap(), ok);
        assert_eq!(store.end(&trial(1).id).unwrap(), Some(ok));
        let names = names(&store.folder(&trial(1).id)).unwrap();
        assert_eq!(names, ["metrics.parquet", "trial.json"]);
    }

    #[test]
    fn a_changed_byte_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        store.finish(&trial(1), &record(), 1.0).unwrap();
        let path = store.folder(&trial(1).id).join(METRICS);
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&path, bytes).unwrap();
        assert!(matches!(store.load(&trial(1).into()), Err(Error::Damaged { .. })));
    }

    #[test]
    fn a_file_of_another_trial_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        store.finish(&trial(1), &record(), 1.0).unwrap();
        fs::create_dir_all(store.folder(&trial(2).id)).unwrap();
        fs::copy(
            store.folder(&trial(1).id).join("trial.json"),
            store.folder(&trial(2).id).join("trial.json"),
        )
        .unwrap();
        assert!(matches!(store.end(&trial(2).id), Err(Error::Damaged { .. })));
    }
}
