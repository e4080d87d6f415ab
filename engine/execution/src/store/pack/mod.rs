//! Packs: files that hold many short trials, so that a store of very many has few files.
//!
//! `<root>/packs/<digest>.pack` contains the exact bytes of `trial.json` and `metrics.parquet` of trials that ended
//! `ok` and left no artifact, and is named by the hash of its content. The record of a paused trial without other files
//! may also lie there; it counts as long as the trial has not ended. A pack is written once and never changed. A trial
//! with a folder of its own is read from there. Packs come second, so that a trial may be in both; if its place in a
//! pack is damaged, it runs again as a missing one.

mod at_end;
mod form;
mod outline;
mod packing;
mod salvage;
#[cfg(test)]
mod tests;

pub use packing::Packing;

use super::{EndWithMetrics, Store, StoredTrial, index::parse, inside, names};
use crate::world::fs::File;
use contract::{Error, digest, trial_end::EndState};
use form::{PackEntry, id_of, number};
use outline::OUTLINE_LENGTH;
use std::{
    collections::BTreeMap,
    io::{self, BufReader, Read, Seek, SeekFrom},
    ops::Range,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

/// The folder of packs in a store.
pub(super) const FOLDER: &str = "packs";
const ENDING: &str = ".pack";

/// The packs of a store as they were last seen, by file name.
#[derive(Debug, Default)]
pub(super) struct Packs(Mutex<BTreeMap<String, Arc<Pack>>>);

/// An opened pack.
#[derive(Debug)]
pub(super) struct Pack {
    path: PathBuf,
    index: form::Index,
}

/// A short trial in the form in which packs contain it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ShortTrial {
    /// Bytes of `trial.json`.
    pub(super) acknowledgement: Vec<u8>,
    /// Bytes of `metrics.parquet`.
    pub(super) metrics: Vec<u8>,
}

impl ShortTrial {
    /// Whether these are the acknowledged bytes of this trial.
    fn is_whole(&self, id: &str) -> bool {
        self.state(id).is_some()
    }

    /// End state of this trial, which ended `ok` or has paused; `None` if it differs from its acknowledgement.
    fn state(&self, id: &str) -> Option<EndState> {
        let trial = parse(&self.acknowledgement)
            .ok()
            .filter(|trial| trial.id() == id)?;
        let is_whole = digest::of_bytes(&self.metrics) == trial.end.digest;
        Some(trial.end.state).filter(|state| is_whole && matches!(state, EndState::Ok | EndState::Paused))
    }
}

impl Store {
    /// The packs that the store has now.
    ///
    /// # Errors
    /// [`Error::File`] if a pack cannot be read.
    pub(super) fn packs(&self) -> Result<Vec<Arc<Pack>>, Error> {
        let folder = self.root.join(FOLDER);
        let there = names(&folder)?;
        let mut known = lock(&self.packs.0);
        known.retain(|name, _| there.contains(name));
        for name in there.into_iter().filter(|name| is_pack(name)) {
            if !known.contains_key(&name)
                && let Some(pack) = Pack::open(&folder.join(&name))?
            {
                known.insert(name, Arc::new(pack));
            }
        }
        Ok(known.values().cloned().collect())
    }

    /// Drops a pack from memory, so that its next use reads it again.
    fn forget_pack(&self, path: &Path) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        lock(&self.packs.0).remove(&*name);
    }

    /// Paths, inside the store, of the packs that have a place for a trial, whatever it contains.
    pub(super) fn packs_with(&self, id: &str) -> Vec<PathBuf> {
        let packs = self.packs().unwrap_or_default();
        let with = packs.iter().filter(|pack| pack.entry(id).is_some());
        with.map(|pack| {
            pack.path
                .strip_prefix(&self.root)
                .unwrap_or(&pack.path)
                .to_owned()
        })
        .collect()
    }

    /// The acknowledgement of a trial in a pack, which is intact and belongs to this trial, and its end; `None` if no
    /// pack has it.
    ///
    /// # Errors
    /// [`Error::File`] if a pack cannot be read.
    pub(super) fn acknowledged_in_pack(&self, id: &str) -> Result<Option<AcknowledgedTrial>, Error> {
        let packs = self.packs_of(id)?;
        acknowledged_in(&mut readers(&packs)?, id)
    }

    /// The metrics of a trial from a pack that has them with the acknowledged hash.
    ///
    /// # Errors
    /// [`Error::File`] if a pack cannot be read.
    pub(super) fn metrics_in_pack(&self, id: &str, digest: &str) -> Result<Option<Vec<u8>>, Error> {
        let packs = self.packs_of(id)?;
        metrics_in(&mut readers(&packs)?, id, digest)
    }

    /// The error for a trial whose metrics are in none of their places; it names a pack with other metrics.
    pub(super) fn without_metrics(&self, id: &str, path: PathBuf) -> Error {
        match self.packs_with(id).into_iter().next() {
            Some(pack) => Error::Damaged {
                path: self.root.join(pack),
                problem: format!("the metrics of trial {id} in it are not those that were acknowledged"),
            },
            None => Error::Damaged {
                path,
                problem: "it is not there".into(),
            },
        }
    }

    /// Intact records of a paused trial in packs.
    ///
    /// # Errors
    /// [`Error::File`] if a pack cannot be read.
    pub(super) fn paused_in_packs(&self, id: &str) -> Result<Vec<ShortTrial>, Error> {
        let mut found = Vec::new();
        for pack in self.packs_of(id)? {
            let held = pack.trial(id)?;
            found.extend(held.filter(|held| held.state(id) == Some(EndState::Paused)));
        }
        Ok(found)
    }

    /// The packs that have a place for a trial.
    fn packs_of(&self, id: &str) -> Result<Vec<Arc<Pack>>, Error> {
        let mut packs = self.packs()?;
        packs.retain(|pack| pack.entry(id).is_some());
        Ok(packs)
    }
}

/// Text of a `trial.json`, and the trial that it describes.
pub(super) type AcknowledgedTrial = (Vec<u8>, StoredTrial);

/// The acknowledgement of a trial that has ended, from the first of these packs that has it intact.
///
/// # Errors
/// [`Error::File`] if a pack cannot be read.
pub(super) fn acknowledged_in(
    packs: &mut [PackReader<'_>],
    id: &str,
) -> Result<Option<AcknowledgedTrial>, Error> {
    for pack in packs {
        let Some(text) = pack.acknowledgement(id)? else {
            continue;
        };
        let ended = |trial: &StoredTrial| trial.id() == id && trial.end.state != EndState::Paused;
        if let Some(trial) = parse(&text).ok().filter(ended) {
            return Ok(Some((text, trial)));
        }
    }
    Ok(None)
}

/// End of a trial from the first of these packs that has it. If the pack has an outline of the trial, its own bytes are
/// not read: they may be damaged, and so may its metrics.
///
/// # Errors
/// [`Error::File`] if a pack cannot be read.
pub(super) fn outlined_in(packs: &mut [PackReader<'_>], id: &str) -> Result<Option<StoredTrial>, Error> {
    for pack in &mut *packs {
        let told = pack.outline(id)?.filter(|trial| trial.id() == id);
        if told.is_some() {
            return Ok(told);
        }
    }
    acknowledged_in(packs, id).map(|found| found.map(|(_, trial)| trial))
}

/// The metrics of a trial from the first of these packs that has them with the acknowledged hash.
///
/// # Errors
/// [`Error::File`] if a pack cannot be read.
fn metrics_in(packs: &mut [PackReader<'_>], id: &str, digest: &str) -> Result<Option<Vec<u8>>, Error> {
    for pack in packs {
        let metrics = pack.metrics(id)?;
        if let Some(metrics) = metrics.filter(|metrics| digest::of_bytes(metrics) == digest) {
            return Ok(Some(metrics));
        }
    }
    Ok(None)
}

/// End and metrics of a trial, from the first of these packs that has them; `None` if none has.
///
/// # Errors
/// [`Error::File`] if a pack cannot be read, [`Error::Damaged`] if no copy in the store matches its acknowledgement.
pub(super) fn loaded_in(
    packs: &mut [PackReader<'_>],
    store: &Store,
    id: &str,
) -> Result<Option<EndWithMetrics>, Error> {
    let Some((_, trial)) = acknowledged_in(packs, id)? else {
        return Ok(None);
    };
    let metrics = || match metrics_in(packs, id, &trial.end.digest)? {
        Some(metrics) => Ok(metrics),
        None => store.metrics(id, &trial.end.digest),
    };
    let table = store.decoded(id, &trial.end, metrics)?;
    Ok(Some((trial.end, table)))
}

/// A pack whose file is open.
pub(super) struct PackReader<'a> {
    pack: &'a Pack,
    file: File,
    /// Outlines that were read, and their range of places in the index.
    outlines: (Range<usize>, Vec<u8>),
}

/// Opens these packs.
///
/// # Errors
/// [`Error::File`] if one cannot be read.
pub(super) fn readers(packs: &[Arc<Pack>]) -> Result<Vec<PackReader<'_>>, Error> {
    packs.iter().map(|pack| pack.reader()).collect()
}

impl PackReader<'_> {
    /// Outline of a trial; `None` if the pack has none.
    fn outline(&mut self, id: &str) -> Result<Option<StoredTrial>, Error> {
        let Some(place) = self.pack.place(id) else {
            return Ok(None);
        };
        if !self.outlines.0.contains(&place) {
            self.read_outlines(place)?;
        }
        let at = place.saturating_sub(self.outlines.0.start) * OUTLINE_LENGTH;
        let bytes = self.outlines.1.get(at..at + OUTLINE_LENGTH);
        Ok(bytes.and_then(|bytes| self.pack.index.outlines.trial(bytes)))
    }

    /// Reads the outlines of all trials whose ids begin like the one at `place`, since they are requested together.
    fn read_outlines(&mut self, place: usize) -> Result<(), Error> {
        let places = self.pack.neighbours(place);
        let bytes = match self.pack.index.outlines.bytes_of(&places) {
            Some((at, length)) => self.bytes(at, length)?,
            None => Vec::new(),
        };
        self.outlines = (places, bytes);
        Ok(())
    }

    fn acknowledgement(&mut self, id: &str) -> Result<Option<Vec<u8>>, Error> {
        let entry = self.pack.entry(id).copied();
        entry
            .map(|entry| self.bytes(entry.at, entry.acknowledgement.into()))
            .transpose()
    }

    fn metrics(&mut self, id: &str) -> Result<Option<Vec<u8>>, Error> {
        let entry = self.pack.entry(id).copied();
        let bytes = |entry: PackEntry| {
            let at = entry.at.saturating_add(entry.acknowledgement.into());
            self.bytes(at, entry.metrics.into())
        };
        entry.map(bytes).transpose()
    }

    fn trial_at(&mut self, entry: &PackEntry) -> Result<ShortTrial, Error> {
        let mut bytes = self.bytes(entry.at, entry.length())?;
        let metrics = bytes.split_off((entry.acknowledgement as usize).min(bytes.len()));
        Ok(ShortTrial {
            acknowledgement: bytes,
            metrics,
        })
    }

    fn bytes(&mut self, at: u64, length: u64) -> Result<Vec<u8>, Error> {
        // The lengths in an index lie inside the pack, so that no more memory is reserved than the file has.
        let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or_default());
        let read = self
            .file
            .seek(SeekFrom::Start(at))
            .and_then(|_| (&mut self.file).take(length).read_to_end(&mut bytes));
        read.map_err(Error::file("read", &self.pack.path)).map(|_| bytes)
    }
}

impl Pack {
    /// Opens a pack; `None` if it is gone.
    fn open(path: &Path) -> Result<Option<Self>, Error> {
        if !inside::is_file(path) {
            return Ok(None);
        }
        let file = match File::open(path) {
            Ok(file) => file,
            Err(source) if source.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(Error::file("read", path)(source)),
        };
        let index = form::index(&mut BufReader::new(file)).map_err(Error::file("read", path))?;
        Ok(Some(Self {
            path: path.to_owned(),
            index,
        }))
    }

    /// Ids of all trials in the pack, in order.
    pub(super) fn ids(&self) -> impl Iterator<Item = String> {
        self.index.entries.iter().map(|entry| id_of(entry.id))
    }

    fn entry(&self, id: &str) -> Option<&PackEntry> {
        self.place(id).map(|place| &self.index.entries[place])
    }

    /// Place of a trial in the index.
    fn place(&self, id: &str) -> Option<usize> {
        let id = number(id)?;
        self.index
            .entries
            .binary_search_by_key(&id, |entry| entry.id)
            .ok()
    }

    /// Places of the trials in the group of folders of the one at `place`.
    fn neighbours(&self, place: usize) -> Range<usize> {
        let entries = &self.index.entries;
        let group = |entry: &PackEntry| entry.id >> (u128::BITS - 8);
        let own = group(&entries[place]);
        let begin = entries.partition_point(|entry| group(entry) < own);
        begin..entries.partition_point(|entry| group(entry) <= own)
    }

    fn reader(&self) -> Result<PackReader<'_>, Error> {
        let file = File::open(&self.path).map_err(Error::file("read", &self.path))?;
        Ok(PackReader {
            pack: self,
            file,
            outlines: (0..0, Vec::new()),
        })
    }

    /// The bytes that the pack has for a trial, damaged or not.
    pub(super) fn trial(&self, id: &str) -> Result<Option<ShortTrial>, Error> {
        self.entry(id).map(|entry| self.trial_at(entry)).transpose()
    }

    fn trial_at(&self, entry: &PackEntry) -> Result<ShortTrial, Error> {
        self.reader()?.trial_at(entry)
    }
}

/// Whether the path, inside a store, is that of a pack.
pub(super) fn is_path(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.parent() == Some(Path::new(FOLDER)) && is_pack(&name)
}

/// Whether the file name is that of a pack.
fn is_pack(name: &str) -> bool {
    name.strip_suffix(ENDING)
        .is_some_and(|digest| number(digest).is_some())
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
