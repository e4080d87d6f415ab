//! Leases: which process computes a trial now.
//!
//! ```text
//! <root>/owners/<token>.json     one file per process: host, boot, process id, start, Slurm job
//! <trial's folder>/lease         a hard link to its owner's file
//! ```
//!
//! Taking a lease is one link, which fails where the lease exists; nothing half-written can be seen. The owner renews all
//! its leases at once by touching its own file, because links share the time of change. A lease dies with its owner: on
//! the same host and boot at once, when the process is gone; from elsewhere when it was not renewed for a while. No lease
//! has ever to be cleared by hand. Two processes that compute one trial all the same (an owner that was only suspended)
//! store the same bits, so a lease saves work and is not needed for correctness.

use super::{Store, boundary, write_durably};
use crate::Error;
use serde::{Deserialize, Serialize};
use std::{
    fs::{self, File, OpenOptions},
    io::{ErrorKind, Write},
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

/// A process that computes trials.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Owner {
    /// Name of the machine.
    pub host: String,
    /// The machine's boot and the process namespace: process ids mean something only within them.
    pub boot: String,
    /// Process id.
    pub pid: u32,
    /// When the process started, in clock ticks since boot; tells a process from a later one with its id.
    pub started_ticks: u64,
    /// The Slurm job and array task it runs in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slurm_job: Option<String>,
}

impl Owner {
    /// This process.
    #[must_use]
    pub fn this_process() -> Self {
        let pid = std::process::id();
        let variable = |name: &str| std::env::var(name).ok();
        let task = variable("SLURM_ARRAY_JOB_ID").zip(variable("SLURM_ARRAY_TASK_ID")).map(|(job, task)| format!("{job}_{task}"));
        Self {
            host: line_of("/proc/sys/kernel/hostname").unwrap_or_else(|| "unknown".into()),
            boot: this_boot(),
            pid,
            started_ticks: started_ticks(pid).unwrap_or(0),
            slurm_job: task.or_else(|| variable("SLURM_JOB_ID")),
        }
    }

    /// Whether the process still runs; `None` where that cannot be told from here.
    #[must_use]
    pub fn is_alive(&self) -> Option<bool> {
        let here = line_of("/proc/sys/kernel/hostname")?;
        if self.host != here {
            return None;
        }
        // After a restart of the machine, or in another container, nothing of the old processes is left here.
        Some(self.boot == this_boot() && started_ticks(self.pid) == Some(self.started_ticks))
    }

    fn token(&self) -> String {
        let identity = format!("{}/{}/{}/{}", self.host, self.boot, self.pid, self.started_ticks);
        format!("{}-{}-{}", self.host, self.pid, &blake3::hash(identity.as_bytes()).to_hex()[..8])
    }
}

/// The outcome of asking for a trial.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Claim {
    /// The lease is ours now.
    Mine,
    /// A living process has it.
    Held(Owner),
}

/// The leases that this process takes.
#[derive(Debug)]
pub struct Leases {
    store: Store,
    file: PathBuf,
    expiry: Duration,
}

impl Leases {
    /// Announces this process to a store. Leases of processes elsewhere count as dead when not renewed for `expiry`.
    ///
    /// # Errors
    /// Where the store's folder cannot be written.
    pub fn open(store: &Store, expiry: Duration) -> Result<Self, Error> {
        let owner = Owner::this_process();
        let folder = store.root().join("owners");
        fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        let leases = Self { store: store.clone(), file: folder.join(format!("{}.json", owner.token())), expiry };
        leases.forget_the_dead(&folder);
        let text = serde_json::to_vec(&owner).map_err(|source| Error::Worker { problem: source.to_string() })?;
        write_durably(&leases.file, &text)?;
        Ok(leases)
    }

    /// Asks for a trial.
    ///
    /// # Errors
    /// Where the store cannot be written, or its file system knows no hard links.
    pub fn claim(&self, id: &str) -> Result<Claim, Error> {
        let folder = self.store.folder(id);
        fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        let lease = folder.join("lease");
        loop {
            match fs::hard_link(&self.file, &lease) {
                Ok(()) => {
                    boundary::pass("after a lease is taken", &lease);
                    return Ok(Claim::Mine);
                }
                Err(source) if source.kind() == ErrorKind::AlreadyExists => {}
                Err(source) => return Err(Error::file("link a lease at", &lease)(source)),
            }
            match self.holder(&lease)? {
                Some(owner) => return Ok(Claim::Held(owner)),
                None => self.remove_dead(&folder, &lease)?,
            }
        }
    }

    /// Gives a trial back.
    ///
    /// # Errors
    /// Where the lease cannot be removed.
    pub fn release(&self, id: &str) -> Result<(), Error> {
        let lease = self.store.folder(id).join("lease");
        // A lease that was taken over while this process was suspended belongs to another one.
        boundary::pass("before a lease is given back", &lease);
        if is_same_file(&lease, &self.file) { remove(&lease) } else { Ok(()) }
    }

    /// Renews all leases of this process.
    ///
    /// # Errors
    /// Where the owner's file cannot be written.
    pub fn beat(&self) -> Result<(), Error> {
        // The same first byte again: the file system's own clock stamps the change, and nothing can be torn.
        let touch = || OpenOptions::new().write(true).open(&self.file)?.write_all(b"{");
        touch().map_err(Error::file("renew the leases by", &self.file))
    }

    /// The living owner of a lease, `None` where it is dead or gone.
    fn holder(&self, lease: &Path) -> Result<Option<Owner>, Error> {
        let Some((owner, renewed)) = read(lease)? else { return Ok(None) };
        match owner.is_alive() {
            Some(alive) => Ok(alive.then_some(owner)),
            None => {
                // Both times come from the clock of the file system that holds them.
                self.beat()?;
                let now = modified(&self.file).map_err(Error::file("read", &self.file))?;
                let age = now.duration_since(renewed).unwrap_or_default();
                Ok((age < self.expiry).then_some(owner))
            }
        }
    }

    /// Removes a lease whose owner is dead. Only who holds `takeover` may, and looks again first: otherwise the lease that
    /// another process has just taken could be removed.
    fn remove_dead(&self, folder: &Path, lease: &Path) -> Result<(), Error> {
        let takeover = folder.join("takeover");
        match fs::hard_link(&self.file, &takeover) {
            Ok(()) => {
                boundary::pass("before a dead lease is removed", lease);
                let removed = self.holder(lease).and_then(|holder| if holder.is_none() { remove(lease) } else { Ok(()) });
                remove(&takeover)?;
                removed
            }
            Err(source) if source.kind() == ErrorKind::AlreadyExists => {
                if self.holder(&takeover)?.is_none() {
                    remove(&takeover)?;
                }
                std::thread::sleep(Duration::from_millis(2));
                Ok(())
            }
            Err(source) => Err(Error::file("link", &takeover)(source)),
        }
    }

    /// Files of processes that are gone; their leases keep the content.
    fn forget_the_dead(&self, folder: &Path) {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let dead = matches!(read(&entry.path()), Ok(Some((owner, _))) if owner.is_alive() == Some(false));
            if dead {
                // Another process may have removed it already.
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

impl Drop for Leases {
    fn drop(&mut self) {
        // What stays behind is forgotten by the next process.
        let _ = fs::remove_file(&self.file);
    }
}

impl Store {
    /// Who computes a trial now, as far as can be told from here: an owner that is known to be dead is left out.
    #[must_use]
    pub fn running(&self, id: &str) -> Option<Owner> {
        let (owner, _) = read(&self.folder(id).join("lease")).ok()??;
        (owner.is_alive() != Some(false)).then_some(owner)
    }

    /// Processes that announced themselves and are not known to be dead.
    #[must_use]
    pub fn owners(&self) -> Vec<Owner> {
        let entries = fs::read_dir(self.root().join("owners")).into_iter().flatten().flatten();
        let owners = entries.filter_map(|entry| read(&entry.path()).ok()?.map(|(owner, _)| owner));
        let mut owners: Vec<Owner> = owners.filter(|owner| owner.is_alive() != Some(false)).collect();
        owners.sort_by(|a, b| (&a.host, a.pid).cmp(&(&b.host, b.pid)));
        owners
    }
}

/// The owner in a file and when the file was renewed; `None` where there is no such file or no owner in it.
fn read(path: &Path) -> Result<Option<(Owner, SystemTime)>, Error> {
    let read = || -> std::io::Result<(Vec<u8>, SystemTime)> { Ok((fs::read(path)?, modified(path)?)) };
    match read() {
        // A file that holds no owner was damaged; nobody can hold a trial by it.
        Ok((text, renewed)) => Ok(serde_json::from_slice(&text).ok().map(|owner| (owner, renewed))),
        Err(source) if source.kind() == ErrorKind::NotFound => Ok(None),
        Err(source) => Err(Error::file("read", path)(source)),
    }
}

fn modified(path: &Path) -> std::io::Result<SystemTime> {
    File::open(path)?.metadata()?.modified()
}

fn is_same_file(one: &Path, other: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |path: &Path| fs::metadata(path).map(|file| (file.dev(), file.ino())).ok();
    identity(one).is_some_and(|file| identity(other) == Some(file))
}

fn remove(path: &Path) -> Result<(), Error> {
    match fs::remove_file(path) {
        Err(source) if source.kind() != ErrorKind::NotFound => Err(Error::file("remove", path)(source)),
        _ => Ok(()),
    }
}

fn line_of(path: &str) -> Option<String> {
    fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

fn this_boot() -> String {
    let namespace = fs::read_link("/proc/self/ns/pid").map(|link| link.display().to_string()).unwrap_or_default();
    format!("{} {namespace}", line_of("/proc/sys/kernel/random/boot_id").unwrap_or_default())
}

/// When a living process started; `None` where there is none with this id, or only its remains.
fn started_ticks(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in parentheses may hold anything; the fields after it are numbered from 3.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let gone = matches!(*fields.first()?, "Z" | "X");
    if gone { None } else { fields.get(19)?.parse().ok() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ID: &str = "0123456789abcdef0123456789abcdef";

    fn leases(store: &Store) -> Leases {
        Leases::open(store, Duration::from_secs(30)).unwrap()
    }

    /// Leaves the lease of another process behind.
    fn lease_of(store: &Store, owner: &Owner) {
        fs::create_dir_all(store.folder(ID)).unwrap();
        fs::write(store.folder(ID).join("lease"), serde_json::to_vec(owner).unwrap()).unwrap();
    }

    #[test]
    fn a_lease_is_exclusive_until_it_is_given_back() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let leases = leases(&store);
        assert_eq!(leases.claim(ID).unwrap(), Claim::Mine);
        assert!(matches!(leases.claim(ID).unwrap(), Claim::Held(owner) if owner == Owner::this_process()));
        assert_eq!(store.running(ID), Some(Owner::this_process()));
        leases.release(ID).unwrap();
        assert_eq!(store.running(ID), None);
        assert_eq!(leases.claim(ID).unwrap(), Claim::Mine);
    }

    #[test]
    fn many_threads_ask_and_one_gets_it() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let leases = leases(&store);
        // The lease of a dead process lies in the way.
        lease_of(&store, &Owner { started_ticks: 1, ..Owner::this_process() });
        let won = std::thread::scope(|scope| {
            let asked: Vec<_> = (0..16).map(|_| scope.spawn(|| leases.claim(ID).unwrap())).collect();
            asked.into_iter().map(|thread| thread.join().unwrap()).filter(|claim| *claim == Claim::Mine).count()
        });
        assert_eq!(won, 1);
    }

    #[test]
    fn a_lease_dies_with_its_process_its_boot_or_its_silence() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let this = Owner::this_process();
        let dead = [
            Owner { started_ticks: this.started_ticks + 1, ..this.clone() },
            Owner { boot: "another boot".into(), ..this.clone() },
        ];
        for owner in dead {
            lease_of(&store, &owner);
            let leases = leases(&store);
            assert_eq!(leases.claim(ID).unwrap(), Claim::Mine);
            leases.release(ID).unwrap();
        }
        let elsewhere = Owner { host: "another-host".into(), ..this };
        lease_of(&store, &elsewhere);
        assert_eq!(leases(&store).claim(ID).unwrap(), Claim::Held(elsewhere));
        let impatient = Leases::open(&store, Duration::ZERO).unwrap();
        assert_eq!(impatient.claim(ID).unwrap(), Claim::Mine);
    }

    #[test]
    fn a_beat_renews_every_lease_and_changes_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        let leases = leases(&store);
        leases.claim(ID).unwrap();
        let lease = store.folder(ID).join("lease");
        let (text, before) = (fs::read(&lease).unwrap(), modified(&lease).unwrap());
        std::thread::sleep(Duration::from_millis(20));
        leases.beat().unwrap();
        assert_eq!(fs::read(&lease).unwrap(), text);
        assert!(modified(&lease).unwrap() > before);
    }

    #[test]
    fn a_damaged_lease_holds_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path());
        fs::create_dir_all(store.folder(ID)).unwrap();
        fs::write(store.folder(ID).join("lease"), "{\"host\": ").unwrap();
        assert_eq!(leases(&store).claim(ID).unwrap(), Claim::Mine);
    }
}
