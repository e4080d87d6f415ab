//! Leases, each of which names the process that computes a trial now.
//!
//! ```text
//! <root>/owners/<token>.json        one file per process: host, boot, process id, start, Slurm job, and how long a
//!                                   lease holds
//! <trial's folder>/lease            a hard link to its owner's file
//!                  takeover-<hash>  the same, while the lease of a dead owner is removed
//! ```
//!
//! A lease is taken by creating one link, which fails if the lease exists; a partly written file can never be seen. The
//! owner renews all its leases at once by touching its own file, because links share the time of modification. A lease
//! dies with its owner: at once if the process can be seen to be gone, and otherwise when it was not renewed for as
//! long as its owner declared that it holds. A lease never has to be removed by hand. If two processes compute one
//! trial nevertheless (an owner that was only suspended), they store the same bits, so a lease saves work but is not
//! needed for correctness. Taking a living owner for dead does no harm either: an owner whose file is gone writes it
//! again.

use super::{Owner, Store, boundary, remove, write_durably};
use crate::world::{
    clock,
    fs::{self, File, OpenOptions},
};
use contract::Error;
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, BTreeSet},
    io::{ErrorKind, Write},
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant, SystemTime},
};

/// Largest difference between the clock of a machine and that of the file system. Only commands that write no file need
/// it.
const CLOCKS_DIFFER: Duration = Duration::from_secs(300);

/// Longest time for which a lease holds without renewal: a day. Longer declared times are not accepted.
pub const LONGEST_EXPIRY: Duration = Duration::from_secs(86_400);

/// Prefix of the name of a mark, with which the lease of a dead process is removed.
const MARK: &str = "takeover-";

/// Whether the name, in a trial's folder, is that of the lease or of a mark.
pub(super) fn is_lease(name: &str) -> bool {
    name == "lease" || name.starts_with(MARK.trim_end_matches('-'))
}

/// Result of a claim to a trial.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Claim {
    /// This process has the lease now.
    Mine,
    /// A living process has it.
    Held(Owner),
}

/// Content of an owner's file, and therefore of each of its leases.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Announcement {
    #[serde(flatten)]
    pub(super) owner: Owner,
    /// Time in seconds for which a lease holds after a renewal, if no process can see whether the owner runs.
    #[serde(default = "usual_expiry_s")]
    lease_expiry_s: f64,
}

impl Announcement {
    /// The announcement of an owner whose leases hold for `expiry`.
    pub(super) fn new(owner: Owner, expiry: Duration) -> Self {
        Self {
            owner,
            lease_expiry_s: expiry.as_secs_f64(),
        }
    }

    /// Time for which a lease holds after a renewal.
    pub(super) fn expiry(&self) -> Duration {
        // A foreign value may be no valid time, or one too long to wait for.
        let said = Duration::try_from_secs_f64(self.lease_expiry_s).ok();
        said.filter(|expiry| *expiry <= LONGEST_EXPIRY)
            .unwrap_or(Duration::from_secs_f64(usual_expiry_s()))
    }
}

/// Expiry in seconds for programs that did not announce one.
fn usual_expiry_s() -> f64 {
    30.0
}

/// The leases that this process holds.
#[derive(Debug)]
pub struct Leases {
    store: Store,
    announcement: Announcement,
    file: PathBuf,
    /// Ids of the trials whose leases this process has.
    held: Mutex<BTreeSet<String>>,
    /// Leases with a renewal in the future: that time, and the moment when each was first seen this way.
    ahead: Mutex<BTreeMap<PathBuf, (SystemTime, Instant)>>,
}

impl Leases {
    /// Announces this process to a store. If no other process can see whether it runs, its leases count as dead after
    /// it has not renewed them for `expiry`.
    ///
    /// # Errors
    /// [`Error::File`] if the store's folder cannot be written.
    pub fn open(store: &Store, expiry: Duration) -> Result<Self, Error> {
        let announcement = Announcement::new(Owner::this_process(), expiry);
        let folder = store.root().join("owners");
        let file = folder.join(format!("{}.json", announcement.owner.token()));
        forget_the_dead(&folder);
        let leases = Self {
            store: store.clone(),
            announcement,
            file,
            held: Mutex::default(),
            ahead: Mutex::default(),
        };
        leases.write()?;
        Ok(leases)
    }

    /// Claims a trial.
    ///
    /// # Errors
    /// [`Error::File`] if the store cannot be written, or if its file system has no hard links.
    pub fn claim(&self, id: &str) -> Result<Claim, Error> {
        let folder = self.store.folder(id);
        let lease = folder.join("lease");
        // A lease is as old as its owner's file: without this renewal it would look silent after a long halt.
        self.beat()?;
        loop {
            // Packing removes the folders of trials, so this one may be absent.
            fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
            match self.take(id, &lease) {
                Ok(()) => {
                    boundary::pass("after a lease is taken", &lease);
                    return Ok(Claim::Mine);
                }
                Err(source) if source.kind() == ErrorKind::AlreadyExists => {}
                Err(source) if source.kind() == ErrorKind::NotFound && !fs::exists(&self.file) => {
                    self.announce_again()?;
                    continue;
                }
                Err(source) if source.kind() == ErrorKind::NotFound && !fs::exists(&folder) => continue,
                Err(source) => return Err(Error::file("link a lease at", &lease)(source)),
            }
            match self.holder(&lease)? {
                Some(owner) => return Ok(Claim::Held(owner)),
                None => self.remove_dead(&lease)?,
            }
        }
    }

    fn take(&self, id: &str, lease: &Path) -> std::io::Result<()> {
        // A thread that meanwhile writes the owner's file again must know of this lease.
        let mut held = lock(&self.held);
        fs::hard_link(&self.file, lease)?;
        held.insert(id.to_owned());
        Ok(())
    }

    /// Releases a trial.
    ///
    /// # Errors
    /// [`Error::File`] if the lease cannot be removed.
    pub fn release(&self, id: &str) -> Result<(), Error> {
        let lease = self.store.folder(id).join("lease");
        boundary::pass("before a lease is given back", &lease);
        // A lease that was taken over while this process was suspended belongs to another process.
        let outcome = if self.is_ours(&lease)? {
            remove(&lease)
        } else {
            Ok(())
        };
        lock(&self.held).remove(id);
        outcome
    }

    fn is_ours(&self, lease: &Path) -> Result<bool, Error> {
        Ok(read(lease)?.is_some_and(|found| found.said.owner == self.announcement.owner))
    }

    /// Renews all leases of this process.
    ///
    /// # Errors
    /// [`Error::File`] if the owner's file cannot be written.
    pub fn beat(&self) -> Result<(), Error> {
        match self.touch() {
            Err(source) if source.kind() == ErrorKind::NotFound => self.announce_again(),
            outcome => outcome.map_err(Error::file("renew the leases by", &self.file)),
        }
    }

    fn touch(&self) -> std::io::Result<()> {
        // Writes the same first byte again: the file system's own clock stamps the modification, and no write can be
        // torn.
        OpenOptions::new().write(true).open(&self.file)?.write_all(b"{")
    }

    /// Writes the owner's file again after another process removed it. A lease of this process is still a link to it
    /// and becomes the file again, so that one renewal still renews all of them.
    fn announce_again(&self) -> Result<(), Error> {
        let held = lock(&self.held);
        for id in held.iter().filter(|_| !fs::exists(&self.file)) {
            let lease = self.store.folder(id).join("lease");
            if self.is_ours(&lease)? && fs::hard_link(&lease, &self.file).is_ok() {
                return self
                    .touch()
                    .map_err(Error::file("renew the leases by", &self.file));
            }
        }
        if fs::exists(&self.file) {
            Ok(())
        } else {
            self.write()
        }
    }

    fn write(&self) -> Result<(), Error> {
        let folder = self.file.parent().unwrap_or(self.store.root());
        if fs::is_taken(folder) && !fs::is_folder(folder) {
            return Err(self.store.no_place(folder));
        }
        fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
        let text = serde_json::to_vec(&self.announcement).map_err(|source| Error::Worker {
            problem: source.to_string(),
        })?;
        write_durably(&self.file, &text)
    }

    /// The living owner of a lease; `None` if it is dead or the lease is gone.
    fn holder(&self, lease: &Path) -> Result<Option<Owner>, Error> {
        let Some(found) = read(lease)? else {
            return Ok(None);
        };
        Ok(self.lives(lease, &found)?.then_some(found.said.owner))
    }

    fn lives(&self, lease: &Path, found: &LeaseFile) -> Result<bool, Error> {
        match found.said.owner.is_alive() {
            Some(alive) => Ok(alive),
            None => Ok(!self.is_silent(lease, found)?),
        }
    }

    /// Whether a lease was not renewed for as long as it holds.
    fn is_silent(&self, lease: &Path, found: &LeaseFile) -> Result<bool, Error> {
        // Both times come from the clock of the file system that holds them.
        self.beat()?;
        let now = modified(&self.file).map_err(Error::file("read", &self.file))?;
        let silence = now
            .duration_since(found.renewed)
            .unwrap_or_else(|_| self.silence_seen(lease, found.renewed));
        Ok(silence >= found.expiry())
    }

    /// Time for which this process has seen a lease unchanged. It is used if a lease was renewed in the future (a clock
    /// was set back): its age is not known then, but a living owner still renews it.
    fn silence_seen(&self, lease: &Path, renewed: SystemTime) -> Duration {
        let mut ahead = lock(&self.ahead);
        let seen = ahead
            .entry(lease.to_owned())
            .or_insert_with(|| (renewed, clock::now()));
        if seen.0 != renewed {
            *seen = (renewed, clock::now());
        }
        clock::since(seen.1)
    }

    /// Removes a lease, or a mark, whose owner is dead. Only the holder of the mark for this very owner may do so;
    /// otherwise a slower process would remove the lease that another one has just put in its place. A mark whose own
    /// owner died is removed in the same way.
    fn remove_dead(&self, file: &Path) -> Result<(), Error> {
        let Some(owner) = self.dead_owner(file)? else {
            return Ok(());
        };
        let mark = mark_for(file, &owner);
        match fs::hard_link(&self.file, &mark) {
            Ok(()) => {
                // Marks have a different name for every owner; this failpoint has one name for all.
                let mark_of_any = file.with_file_name("takeover");
                let place = if file.ends_with("lease") {
                    file
                } else {
                    &mark_of_any
                };
                boundary::pass("before a dead lease is removed", place);
                let again = self.dead_owner(file);
                let removed = again.and_then(|now| if now == Some(owner) { remove(file) } else { Ok(()) });
                remove(&mark)?;
                removed
            }
            Err(source) if source.kind() == ErrorKind::AlreadyExists => {
                self.remove_dead(&mark)?;
                clock::sleep(Duration::from_millis(2));
                Ok(())
            }
            Err(source) if source.kind() == ErrorKind::NotFound && !fs::exists(&self.file) => {
                self.announce_again()
            }
            Err(source) => Err(Error::file("link", &mark)(source)),
        }
    }

    /// File name of the dead owner of a lease or a mark; empty if the file names no owner. `None` if its owner is
    /// alive, or the file is absent.
    fn dead_owner(&self, file: &Path) -> Result<Option<String>, Error> {
        match look(file)? {
            LeaseEntry::Gone => Ok(None),
            LeaseEntry::Damaged => Ok(Some(String::new())),
            LeaseEntry::Owned(found) => {
                let lives = self.lives(file, &found)?;
                Ok((!lives).then(|| found.said.owner.token()))
            }
        }
    }
}

/// Path of the mark under which the lease of a dead owner at `file` is removed.
fn mark_for(file: &Path, owner: &str) -> PathBuf {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let hash = blake3::hash(format!("{name}/{owner}").as_bytes());
    file.with_file_name(format!("{MARK}{}", &hash.to_hex()[..16]))
}

impl Drop for Leases {
    fn drop(&mut self) {
        // The next process removes a file that is left behind.
        let _ = fs::remove_file(&self.file);
    }
}

impl Store {
    /// The process that computes a trial now, as far as can be determined here. An owner that is known to be dead is
    /// left out, as is one that cannot be seen and has been silent for long.
    #[must_use]
    pub fn running(&self, id: &str) -> Option<Owner> {
        let found = read(&self.folder(id).join("lease")).ok()??;
        found.may_be_alive().then_some(found.said.owner)
    }

    /// Processes that announced themselves and may be alive.
    #[must_use]
    pub fn owners(&self) -> Vec<Owner> {
        let entries = fs::read_dir(self.root().join("owners"))
            .into_iter()
            .flatten()
            .flatten();
        let found = entries.filter_map(|entry| read(&entry.path()).ok()?);
        let mut owners: Vec<Owner> = found
            .filter(LeaseFile::may_be_alive)
            .map(|found| found.said.owner)
            .collect();
        owners.sort_by(|a, b| (&a.host, a.pid).cmp(&(&b.host, b.pid)));
        owners
    }
}

/// Removes files of processes that are gone; their leases keep the content. If a process is alive nevertheless, it
/// writes its file again.
fn forget_the_dead(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let dead = matches!(read(&entry.path()), Ok(Some(found)) if !found.may_be_alive());
        if dead {
            // Another process may have removed it already.
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// An owner's file, or a lease, with the time of its renewal.
#[derive(Debug)]
struct LeaseFile {
    said: Announcement,
    renewed: SystemTime,
}

impl LeaseFile {
    fn expiry(&self) -> Duration {
        self.said.expiry()
    }

    /// Whether the process may be alive: false if it is known to be dead, or cannot be seen and was silent for longer
    /// than clocks can differ.
    fn may_be_alive(&self) -> bool {
        let gap = clock::date()
            .duration_since(self.renewed)
            .unwrap_or_else(|ahead| ahead.duration());
        self.said
            .owner
            .is_alive()
            .unwrap_or_else(|| gap < self.expiry() + CLOCKS_DIFFER)
    }
}

/// Reads an owner's file or a lease; `None` if there is no such file or no owner in it.
fn read(path: &Path) -> Result<Option<LeaseFile>, Error> {
    Ok(match look(path)? {
        LeaseEntry::Owned(found) => Some(found),
        LeaseEntry::Gone | LeaseEntry::Damaged => None,
    })
}

/// Entry at the place of a lease.
enum LeaseEntry {
    Gone,
    /// A file without an owner, with which no process can hold a trial.
    Damaged,
    Owned(LeaseFile),
}

fn look(path: &Path) -> Result<LeaseEntry, Error> {
    // Opening a pipe waits for a writer.
    let read = || -> std::io::Result<(Vec<u8>, SystemTime)> { Ok((fs::read(path)?, modified(path)?)) };
    if fs::symlink_metadata(path).is_ok_and(|data| !data.is_file()) {
        return Ok(LeaseEntry::Damaged);
    }
    match read() {
        Ok((text, renewed)) => Ok(serde_json::from_slice(&text).map_or(LeaseEntry::Damaged, |said| {
            LeaseEntry::Owned(LeaseFile { said, renewed })
        })),
        Err(source) if source.kind() == ErrorKind::NotFound => Ok(LeaseEntry::Gone),
        Err(source) => Err(Error::file("read", path)(source)),
    }
}

fn modified(path: &Path) -> std::io::Result<SystemTime> {
    File::open(path)?.metadata()?.modified()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // The locked value is consistent between any two statements.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests;
