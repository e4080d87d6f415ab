//! Moves short trials from folders of their own into a pack.
//!
//! The pack is written beside its place, read back, flushed and renamed, with the folders that lead to it, before the
//! first folder is touched. Other machines may see a folder's old names for a while, so packed trials stay in both
//! places until the pack has settled. Then each trial's files are removed, its acknowledgement first, under its lease
//! and only if they are the bytes of the pack. If this is interrupted at any point, every trial is intact in one of the
//! two places, and the next packing completes it.

use super::{
    ENDING, FOLDER, Pack, ShortTrial,
    form::{Writer, id_of, number},
};
use crate::{
    store::{
        Claim, Leases, Owner, Store, TrialFile, absent_is_fine, fsck::refuse_links, inside, lease::is_lease,
        partial, remove, sealed_folder::flush_way,
    },
    world::{
        clock,
        fs::{self, File},
    },
};
use contract::{Error, digest};
use std::{
    io::{BufWriter, ErrorKind},
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

/// Largest number of bytes of a packed trial; larger ones stay in folders, since packing saves files, not bytes.
const MOST_BYTES: usize = 1 << 20;

/// The files of a trial that can be packed.
pub(super) const FILES: [&str; 2] = ["trial.json", "metrics.parquet"];

/// Result of a packing.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize)]
pub struct Packing {
    /// The pack that was written, inside the store; `None` if no trial was new.
    pub pack: Option<PathBuf>,
    /// Number of trials in the pack.
    pub packed: usize,
    /// Size of the pack in bytes.
    pub bytes: u64,
    /// Number of removed folders, including those of earlier packings that were interrupted.
    pub removed: usize,
    /// Number of trials that keep their folders: they left more than metrics, did not end successfully, or are large.
    pub kept: usize,
}

impl Store {
    /// Packs every trial that ended `ok` and left only metrics. Folders are removed when the pack is `settle` old.
    ///
    /// # Errors
    /// [`Error::File`] if the store cannot be read or written.
    pub fn pack(&self, leases: &Leases, settle: Duration) -> Result<Packing, Error> {
        refuse_links(self)?;
        let ids = self.ids_with_folders();
        let mut done = self.write_pack(&ids)?;
        if done.packed > 0 {
            clock::sleep(settle);
        }
        self.leave_all_to_packs(&ids, leases, &mut done, &|| false)?;
        Ok(done)
    }

    /// Removes the folders of trials that packs have, until asked to stop.
    pub(super) fn leave_all_to_packs(
        &self,
        ids: &[String],
        leases: &Leases,
        done: &mut Packing,
        stopping: &dyn Fn() -> bool,
    ) -> Result<(), Error> {
        let packs = self.packs()?;
        for id in ids {
            if stopping() {
                break;
            }
            done.removed += usize::from(self.leave_to_packs(id, &packs, leases)?);
        }
        done.kept = ids.len() - done.removed;
        Ok(())
    }

    /// Writes a new pack of those trials that no pack has yet.
    pub(super) fn write_pack(&self, ids: &[String]) -> Result<Packing, Error> {
        let packs = self.packs()?;
        let is_new = |id: &String, trial: &ShortTrial| {
            let has = |pack: &Arc<Pack>| pack.trial(id).is_ok_and(|held| held.as_ref() == Some(trial));
            !packs.iter().any(has)
        };
        let short = |id: &String| Some((number(id)?, self.short(id).filter(|trial| is_new(id, trial))?));
        let mut trials = ids.iter().filter_map(short).peekable();
        if trials.peek().is_none() {
            return Ok(Packing::default());
        }
        self.new_pack(&mut trials)
    }

    /// Writes a pack of these trials, which come in the order of their ids.
    pub(super) fn new_pack(
        &self,
        trials: &mut dyn Iterator<Item = (u128, ShortTrial)>,
    ) -> Result<Packing, Error> {
        let folder = self.root.join(FOLDER);
        fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        // Processes of several machines may have the same process id.
        let temporary = folder.join(format!(".{}.tmp", Owner::this_process().token()));
        let written = write(&temporary, trials).and_then(|(packed, bytes)| {
            let digest = File::open(&temporary).and_then(digest::of_file);
            let digest = digest.map_err(Error::file("read", &temporary))?;
            let inside = Path::new(FOLDER).join(format!("{digest}{ENDING}"));
            let path = self.root.join(&inside);
            fs::rename(&temporary, &path).map_err(Error::file("rename to", &path))?;
            flush_way(&path, 2)?;
            Ok(Packing {
                pack: Some(inside),
                packed,
                bytes,
                ..Packing::default()
            })
        });
        if written.is_err() {
            // Frees the space of a full disk; `fsck` finds a file that cannot be removed.
            let _ = fs::remove_file(&temporary);
        }
        written
    }

    /// An intact trial that can be packed. A trial that cannot be read is left out; `fsck` reports it.
    fn short(&self, id: &str) -> Option<ShortTrial> {
        let folder = self.folder(id);
        let mut files = inside::files_of(&folder).ok()?;
        files.retain(|name| !is_lease(name));
        let read = |name: &str| inside::read(&folder.join(name)).ok().flatten();
        let trial = if let [name] = files.as_slice()
            && partial::step_of(name).is_some()
        {
            // A trial that continues from a checkpoint here keeps it.
            paused(id, &read(name)?)?
        } else if files == ["metrics.parquet", "trial.json"] {
            let [acknowledgement, metrics] = FILES.map(read);
            ShortTrial {
                acknowledgement: acknowledgement?,
                metrics: metrics?,
            }
        } else {
            return None;
        };
        let file: TrialFile = serde_json::from_slice(&trial.acknowledgement).ok()?;
        let is_short = trial.acknowledgement.len() + trial.metrics.len() <= MOST_BYTES
            && file.files.is_empty()
            && file.output.is_none();
        (is_short && trial.is_whole(id)).then_some(trial)
    }

    /// Removes the folder of a packed trial; true if it is gone.
    fn leave_to_packs(&self, id: &str, packs: &[Arc<Pack>], leases: &Leases) -> Result<bool, Error> {
        let mut held = Vec::new();
        for pack in packs {
            held.extend(pack.trial(id)?.filter(|trial| trial.is_whole(id)));
        }
        if held.is_empty() || leases.claim(id)? != Claim::Mine {
            return Ok(false);
        }
        let removed = self.remove_files(id, &held);
        leases.release(id)?;
        if !removed? {
            return Ok(false);
        }
        let folder = self.folder(id);
        match fs::remove_dir(&folder) {
            // Another process has meanwhile asked for the trial.
            Err(source) if source.kind() == ErrorKind::DirectoryNotEmpty => Ok(false),
            outcome => absent_is_fine(outcome)
                .map(|()| true)
                .map_err(Error::file("remove", &folder)),
        }
    }

    /// Removes the files of a trial if they are the same bytes as those of one of `held`; true if they were.
    fn remove_files(&self, id: &str, held: &[ShortTrial]) -> Result<bool, Error> {
        let folder = self.folder(id);
        let own = FILES.map(|name| inside::read(&folder.join(name)));
        let [acknowledgement, metrics] = own;
        let (acknowledgement, metrics) = (acknowledgement?, metrics?);
        let is_same = |held: &ShortTrial| {
            acknowledgement
                .as_ref()
                .is_none_or(|own| *own == held.acknowledgement)
                && metrics.as_ref().is_none_or(|own| *own == held.metrics)
        };
        if !held.iter().any(is_same) {
            return Ok(false);
        }
        for name in partial::names_in(&folder)? {
            let left = inside::read(&folder.join(&name))?;
            let is_packed = |bytes: Vec<u8>| paused(id, &bytes).is_some_and(|paused| held.contains(&paused));
            if left.is_none_or(is_packed) {
                remove(&folder.join(&name))?;
            }
        }
        FILES.iter().try_for_each(|name| remove(&folder.join(name)))?;
        Ok(true)
    }
}

/// A trial at its pause, from the bytes of its file.
fn paused(id: &str, bytes: &[u8]) -> Option<ShortTrial> {
    let [metrics, acknowledgement] = partial::parts(id, bytes).ok()?;
    Some(ShortTrial {
        acknowledgement,
        metrics,
    })
}

/// Writes a pack, flushes it and reads it back; returns its number of trials and its size in bytes.
fn write(path: &Path, trials: &mut dyn Iterator<Item = (u128, ShortTrial)>) -> Result<(usize, u64), Error> {
    let wrong = || Error::file("write", path);
    let file = File::create(path).map_err(Error::file("create", path))?;
    let mut writer = Writer::begin(BufWriter::new(file)).map_err(wrong())?;
    for (id, trial) in trials {
        writer
            .add(id, &trial.acknowledgement, &trial.metrics)
            .map_err(wrong())?;
    }
    let (buffer, entries) = writer.end().map_err(wrong())?;
    let file = buffer.into_inner().map_err(|error| wrong()(error.into_error()))?;
    file.sync_all().map_err(Error::file("flush", path))?;
    let bytes = file.metadata().map_err(Error::file("read", path))?.len();
    read_back(path, entries.len())?;
    Ok((entries.len(), bytes))
}

/// Reads a pack back and compares it with the intended content.
fn read_back(path: &Path, count: usize) -> Result<(), Error> {
    let pack = Pack::open(path)?;
    let is_whole = pack.is_some_and(|pack| {
        let whole = |entry| {
            pack.trial_at(entry)
                .is_ok_and(|trial| trial.is_whole(&id_of(entry.id)))
        };
        pack.index.is_whole && pack.index.entries.len() == count && pack.index.entries.iter().all(whole)
    });
    if is_whole {
        return Ok(());
    }
    Err(Error::Damaged {
        path: path.to_owned(),
        problem: "it did not come back from the disk as it was written".into(),
    })
}
