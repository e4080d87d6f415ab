//! The policies that trials leave in the store, for other programs and for cross-play.

use super::{Store, seal::hash};
use crate::{Error, results::EndState};
use std::{
    collections::BTreeMap,
    fs::{self, File},
    path::{Path, PathBuf},
};

impl Store {
    /// The folder of the policy that a trial left, each of its files held against the acknowledged hash.
    ///
    /// # Errors
    /// [`Error::Source`] where the trial did not end `ok`, left no policy, or left one that is damaged now.
    pub fn policy(&self, id: &str) -> Result<PathBuf, Error> {
        let unusable = |problem: String| Error::Source { trial: id.into(), problem };
        let file = self.file(id).map_err(|error| unusable(error.to_string()))?;
        let Some(file) = file else { return Err(unusable("it has not run".into())) };
        if file.end.state != EndState::Ok {
            return Err(unusable(format!("it ended as {}", file.end.state.name())));
        }
        if file.files.is_empty() {
            let problem =
                "it left none that was acknowledged, as trials of older versions did; remove its folder to run it again";
            return Err(unusable(problem.into()));
        }
        let folder = self.folder(id);
        for (name, digest) in &file.files {
            let bytes = fs::read(folder.join(name)).map_err(|source| unusable(format!("`{name}`: {source}")))?;
            if hash(&bytes) != *digest {
                return Err(unusable(format!("`{name}` is damaged; `regimen fsck` sets it aside, and the trial runs again")));
            }
        }
        Ok(folder)
    }
}

/// Hashes of what the agent exported into a trial's folder and folders of seats in it, by path inside it, brought to the disk.
pub(super) fn exported(folder: &Path) -> Result<BTreeMap<String, String>, Error> {
    let mut files = BTreeMap::new();
    for name in files_below(folder)?.into_iter().filter(|name| name.ends_with(".safetensors")) {
        let path = folder.join(&name);
        let seat = path.parent().filter(|parent| *parent != folder);
        for flushed in [Some(path.as_path()), seat].into_iter().flatten() {
            File::open(flushed).and_then(|file| file.sync_all()).map_err(Error::file("flush", flushed))?;
        }
        let bytes = fs::read(&path).map_err(Error::file("read", &path))?;
        files.insert(name, hash(&bytes));
    }
    Ok(files)
}

/// Paths of all files in a trial's folder, in order. What a running trial keeps is one entry, `running`.
pub(super) fn files_below(folder: &Path) -> Result<Vec<String>, Error> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(Error::file("read", folder))? {
        let entry = entry.map_err(Error::file("read", folder))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if entry.path().is_dir() && name != "running" {
            found.extend(files_below(&entry.path())?.into_iter().map(|below| format!("{name}/{below}")));
        } else {
            found.push(name);
        }
    }
    found.sort_unstable();
    Ok(found)
}
