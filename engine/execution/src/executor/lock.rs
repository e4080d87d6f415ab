//! The lock on the submissions of a store: one process at a time decides about them.

use super::{Error, Stop};
use crate::{
    store::{Owner, Store},
    world::{
        clock,
        fs::{self, File},
    },
};
use std::{
    io::{self, ErrorKind, Read as _, Write as _},
    path::{Path, PathBuf},
    time::Duration,
};

/// Interval between two attempts at the lock.
const LOOK: Duration = Duration::from_millis(50);
/// Usual length of a wait; after it the holder of the lock is reported.
const USUAL: Duration = Duration::from_secs(2);

/// Limits of a wait for the lock, and the report of a long one.
pub struct Wait<'a> {
    /// Longest time to wait.
    pub limit: Duration,
    /// The stop request, which ends the wait before its limit.
    pub stop: &'a Stop,
    /// Receiver of the message that the wait takes long.
    pub say: &'a mut dyn FnMut(&str),
}

/// Keeps other processes from deciding about submissions of this store until the file is dropped. The system releases
/// the lock when its holder dies.
///
/// # Errors
/// [`Error::Held`] if another process holds it for longer than the wait, [`Error::Interrupted`], and errors of creating
/// or locking its file.
pub fn lock(store: &Path, wait: Wait<'_>) -> Result<File, Error> {
    let (mut file, path) = open(store)?;
    let (begun, mut told) = (clock::now(), false);
    loop {
        match file.try_lock().map_err(io::Error::from) {
            Ok(()) => break,
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            // Some shared file systems have no locks. Two submitters at the same moment then submit more workers than
            // are needed.
            Err(error) if error.kind() == ErrorKind::Unsupported => return Ok(file),
            Err(error) => return Err(contract::Error::file("lock", &path)(error).into()),
        }
        let waited = clock::since(begun);
        if wait.stop.is_asked() {
            return Err(Error::Interrupted {
                program: "the holder of the submissions' lock",
            });
        }
        if waited >= wait.limit {
            let (by, after_s) = (holder(&path), wait.limit.as_secs_f64());
            return Err(Error::Held { path, by, after_s });
        }
        if waited >= USUAL && !std::mem::replace(&mut told, true) {
            let by = holder(&path);
            (wait.say)(&format!("waiting for `{}`, which {by} holds", path.display()));
        }
        clock::sleep(LOOK);
    }
    // A file without a name only leaves the holder unnamed in messages.
    let _ = file.set_len(0).and_then(|()| file.write_all(name().as_bytes()));
    Ok(file)
}

fn open(store: &Path) -> Result<(File, PathBuf), contract::Error> {
    let folder = super::submission::folder_of_all(store);
    if fs::is_taken(&folder) && !fs::is_folder(&folder) {
        return Err(Store::at(store).no_place(&folder));
    }
    fs::create_dir_all(&folder).map_err(contract::Error::file("create", &folder))?;
    let path = folder.join("lock");
    // Opening a pipe would wait for a reader.
    if fs::symlink_metadata(&path).is_ok_and(|data| !data.is_file()) {
        let problem = "a link, a folder or a pipe has the name of the lock: remove it".into();
        return Err(contract::Error::Damaged { path, problem });
    }
    let file = File::options().create(true).append(true).open(&path);
    Ok((file.map_err(contract::Error::file("open", &path))?, path))
}

/// Name of this process for other processes.
fn name() -> String {
    let owner = Owner::this_process();
    let job = owner.slurm_job.map(|job| format!(" (Slurm job {job})"));
    format!(
        "process {} on {}{}",
        owner.pid,
        owner.host,
        job.unwrap_or_default()
    )
}

/// Holder of the lock according to its file.
fn holder(path: &Path) -> String {
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(200).read_to_string(&mut text));
    let line = text.lines().next().unwrap_or_default().trim();
    if read.is_err() || line.is_empty() {
        "another process".into()
    } else {
        line.replace(char::is_control, " ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wait<'a>(limit_s: u64, stop: &'a Stop, say: &'a mut dyn FnMut(&str)) -> Wait<'a> {
        let limit = Duration::from_secs(limit_s);
        Wait { limit, stop, say }
    }

    #[test]
    fn a_lock_that_is_held_is_waited_for_and_its_holder_named() {
        let store = tempfile::tempdir().unwrap();
        let stop = Stop::default();
        let mut said = Vec::new();
        let mut say = |text: &str| said.push(text.to_owned());
        let held = lock(store.path(), wait(60, &stop, &mut say)).unwrap();
        let refused = lock(store.path(), wait(3, &stop, &mut say)).unwrap_err();
        drop(held);
        assert!(lock(store.path(), wait(60, &stop, &mut say)).is_ok());
        let me = format!("process {} on ", std::process::id());
        assert!(said.len() == 1 && said[0].contains(&me), "{said:?}");
        let refused = refused.to_string();
        assert!(
            refused.contains(&me) && refused.contains("more than 3 s"),
            "{refused}"
        );
    }

    #[test]
    fn a_wait_for_a_lock_can_be_stopped() {
        let store = tempfile::tempdir().unwrap();
        let flag = std::sync::Arc::default();
        let _held = lock(store.path(), wait(60, &Stop::default(), &mut |_| ())).unwrap();
        std::sync::atomic::AtomicBool::store(&flag, true, std::sync::atomic::Ordering::SeqCst);
        let stopped = lock(store.path(), wait(600, &Stop::on(&flag), &mut |_| ()));
        assert!(matches!(stopped, Err(Error::Interrupted { .. })));
    }
}
