//! Artifacts of trials in the store, for other programs and for other trials.

use super::{
    Store,
    inside::{files_of, is_artifact, look, read_in},
    sealed_folder::flush,
    write_durably,
};
use crate::world::fs;
use contract::{Error, artifact::Taken, digest::of_bytes as hash, trial_end::EndState};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

impl Store {
    /// The folder of a trial with the artifact that it left, after each of its files was compared with the acknowledged
    /// hash.
    ///
    /// # Errors
    /// [`Error::Source`] if the trial did not end `ok`, left no such artifact, or left one that is now damaged.
    pub fn artifact(&self, taken: &Taken) -> Result<PathBuf, Error> {
        let problem = || Error::Source {
            trial: taken.trial.clone(),
            problem: format!(
                "it left no {} that was acknowledged, as trials of older versions did; remove its folder to \
                 run it again",
                taken.kind
            ),
        };
        self.artifact_if_left(taken)?.ok_or_else(problem)
    }

    /// Like [`artifact`](Self::artifact), but `None` if the trial left no such artifact.
    ///
    /// # Errors
    /// [`Error::Source`] if the trial did not end `ok`, or left one that is now damaged.
    pub fn artifact_if_left(&self, taken: &Taken) -> Result<Option<PathBuf>, Error> {
        let Taken { trial: id, kind } = taken;
        let unusable = |problem: String| Error::Source {
            trial: id.into(),
            problem,
        };
        let file = self.file(id).map_err(|error| unusable(error.to_string()))?;
        let Some(file) = file else {
            return Err(unusable("it has not run".into()));
        };
        if file.end.state != EndState::Ok {
            return Err(unusable(format!("it ended as {}", file.end.state.name())));
        }
        let mut files = file
            .files
            .iter()
            .filter(|(name, _)| kind.has_file(name))
            .peekable();
        if files.peek().is_none() {
            return Ok(None);
        }
        let folder = self.folder(id);
        match files.find(|(name, digest)| !is_whole(&folder, name, digest)) {
            Some((name, _)) => Err(unusable(format!("`{name}` {DAMAGED}"))),
            None => Ok(Some(folder)),
        }
    }

    /// Copies the files of an artifact whose paths begin with `below` into a folder, under the rest of their paths. The
    /// written bytes are those that were compared with the acknowledged hashes.
    ///
    /// # Errors
    /// [`Error::Source`] as for [`artifact`](Self::artifact), [`Error::File`] if the folder cannot be written.
    pub fn copy_artifact(&self, taken: &Taken, below: &str, to: &Path) -> Result<(), Error> {
        let from = self.artifact(taken)?;
        let file = self.file(&taken.trial)?;
        for (name, digest) in file.iter().flat_map(|file| &file.files) {
            let Some(inside) = name.strip_prefix(below).filter(|_| taken.kind.has_file(name)) else {
                continue;
            };
            let bytes = read_in(&from, name)?.filter(|bytes| hash(bytes) == *digest);
            let bytes = bytes.ok_or_else(|| Error::Source {
                trial: taken.trial.clone(),
                problem: format!("`{name}` {DAMAGED}"),
            })?;
            let path = to.join(inside);
            let folder = path.parent().unwrap_or(to);
            fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
            write_durably(&path, &bytes)?;
        }
        Ok(())
    }

    /// Whether a trial left artifacts whose files differ from the acknowledged ones.
    #[must_use]
    pub fn has_damaged_artifact(&self, id: &str) -> bool {
        match self.file(id) {
            Ok(file) => file.is_some_and(|it| {
                it.files
                    .iter()
                    .any(|(name, digest)| !is_whole(&self.folder(id), name, digest))
            }),
            Err(error) => matches!(error, Error::Damaged { .. }),
        }
    }
}

const DAMAGED: &str =
    "is damaged or not there; `regimen run` of its study sets it aside and runs the trial again";

fn is_whole(folder: &Path, name: &str, digest: &str) -> bool {
    read_in(folder, name).is_ok_and(|bytes| bytes.is_some_and(|bytes| hash(&bytes) == digest))
}

/// Hashes of the artifacts in a trial's folder, by path inside it. The files and the folders that hold them
/// are flushed to the disk.
pub(super) fn exported(folder: &Path) -> Result<BTreeMap<String, String>, Error> {
    let mut files = BTreeMap::new();
    for name in files_of(folder)?.into_iter().filter(|name| is_artifact(name)) {
        let path = folder.join(&name);
        if !look(&path)?.is_some_and(|data| data.is_file()) {
            continue;
        }
        flush_within(folder, &path)?;
        let bytes = fs::read(&path).map_err(Error::file("read", &path))?;
        files.insert(name, hash(&bytes));
    }
    Ok(files)
}

/// Flushes a file of a trial to the disk, and the folders inside the trial's that lead to it.
pub(super) fn flush_within(trial: &Path, file: &Path) -> Result<(), Error> {
    let inside = file.ancestors().take_while(|path| *path != trial);
    inside
        .into_iter()
        .try_for_each(|path| flush(path).map_err(Error::file("flush", path)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::stub;
    use contract::{Phase, Recorder, artifact::ArtifactKind};
    use std::fs;

    #[test]
    fn every_changed_bit_and_every_cut_of_a_policy_is_found_and_its_file_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::at(dir.path().join("store"));
        let trial = stub::trial(4, 0);
        let path = store.folder(&trial.id).join("policy.safetensors");
        let whole: Vec<u8> = (0..64).collect();
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, &whole).unwrap();
        let mut record = Recorder::default();
        record.add(Phase::Final, 10, 0, 0, "return", 1.0);
        store.finish(&trial, &record, 1.0).unwrap();
        let taken = Taken {
            trial: trial.id.clone(),
            kind: ArtifactKind::Policy,
        };
        store.artifact(&taken).unwrap();
        let to = dir.path().join("taken");
        let refused = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            assert!(store.has_damaged_artifact(&trial.id));
            for error in [
                store.artifact(&taken).unwrap_err(),
                store.copy_artifact(&taken, "", &to).unwrap_err(),
            ] {
                assert!(error.to_string().contains("`policy.safetensors`"), "{error}");
            }
            assert!(!to.exists(), "nothing of it arrives");
        };
        for place in 0..whole.len() {
            refused(&whole[..place]);
            for bit in 0..8 {
                let mut changed = whole.clone();
                changed[place] ^= 1 << bit;
                refused(&changed);
            }
        }
    }
}
