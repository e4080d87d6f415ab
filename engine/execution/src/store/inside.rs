//! Reads files inside a store only: no symbolic link is followed, and no name leads out of a trial's folder.

use super::lease::is_lease;
use crate::world::fs;
use contract::{ArtifactKind, Error};
use std::{
    io::ErrorKind,
    path::{Path, PathBuf},
};

/// Content of a file; `None` if there is none.
///
/// # Errors
/// [`Error::Damaged`] if something other than a file has its name.
pub(crate) fn read(path: &Path) -> Result<Option<Vec<u8>>, Error> {
    let absent = |kind: ErrorKind| kind == ErrorKind::NotFound;
    match fs::symlink_metadata(path).map(|data| data.is_file()) {
        Ok(true) => {}
        Ok(false) => return Err(no_file(path)),
        Err(source) if absent(source.kind()) => return Ok(None),
        Err(source) => return Err(Error::file("read", path)(source)),
    }
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(source) if absent(source.kind()) => Ok(None),
        Err(source) => Err(Error::file("read", path)(source)),
    }
}

/// Content of a file of a trial, which may lie in folders inside the trial's.
///
/// # Errors
/// The errors of [`read`].
pub(super) fn read_in(trial: &Path, name: &str) -> Result<Option<Vec<u8>>, Error> {
    let path = trial.join(name);
    let link = path
        .ancestors()
        .skip(1)
        .take_while(|folder| *folder != trial)
        .find(|folder| is_link(folder));
    match link {
        Some(folder) => Err(no_file(folder)),
        None => read(&path),
    }
}

fn no_file(path: &Path) -> Error {
    let problem = "a link, a folder or a pipe has the name of a file; none is followed".into();
    Error::Damaged {
        path: path.to_owned(),
        problem,
    }
}

/// Metadata of the entry at a path, or of the link itself; `None` if there is none. Unlike the functions below, it
/// distinguishes an entry that cannot be seen from an absent one.
///
/// # Errors
/// The error of the system.
pub(super) fn look(path: &Path) -> Result<Option<fs::Metadata>, Error> {
    match fs::symlink_metadata(path) {
        Ok(data) => Ok(Some(data)),
        Err(source) if source.kind() == ErrorKind::NotFound => Ok(None),
        Err(source) => Err(Error::file("look at", path)(source)),
    }
}

/// Whether the path is a folder, and not a link to one.
pub(super) fn is_folder(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|data| data.is_dir())
}

/// Whether the path is a file, and not a link to one.
pub(super) fn is_file(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|data| data.is_file())
}

/// Whether the path is a symbolic link, wherever it leads.
pub(super) fn is_link(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|data| data.is_symlink())
}

/// Largest number of folders between a trial's folder and a file in it.
const DEEPEST: usize = 4;

/// Whether the path, inside a trial's folder, is that of an artifact.
pub(super) fn is_artifact(name: &str) -> bool {
    let parts: Vec<&str> = name.split('/').collect();
    let plain = |part: &&str| !part.is_empty() && !part.starts_with('.') && !part.contains(['\\', '\0']);
    let is_deep = |kind: &ArtifactKind| kind.has_file(name);
    let deepest = if [ArtifactKind::Dataset, ArtifactKind::Checkpoint]
        .iter()
        .any(is_deep)
    {
        DEEPEST
    } else {
        1
    };
    parts.len() <= deepest + 1
        && parts.iter().all(plain)
        && ArtifactKind::ALL.iter().any(|kind| kind.has_file(name))
}

/// Names in a trial's folder that no seat and no artifact may use.
const NO_SEATS: [&str; 4] = ["running", "trial.json", "earlier.json", "metrics.parquet"];

/// Paths of all files in a trial's folder and the folders in it, in order. Every other entry is listed as a file:
/// links, empty folders, folders deeper than any artifact, `running`, and folders with the name of a file.
///
/// # Errors
/// [`Error::File`] if a folder cannot be read.
pub(super) fn files_of(trial: &Path) -> Result<Vec<String>, Error> {
    let mut found = Vec::new();
    gather(trial, "", DEEPEST, &mut found)?;
    found.sort_unstable();
    Ok(found)
}

fn gather(folder: &Path, at: &str, deeper: usize, found: &mut Vec<String>) -> Result<(), Error> {
    for name in super::names(folder)? {
        let (path, inside) = (folder.join(&name), format!("{at}{name}"));
        let before = found.len();
        let may_have = deeper > 0 && !NO_SEATS.contains(&inside.as_str()) && !is_lease(&inside);
        if may_have && look(&path)?.is_some_and(|data| data.is_dir()) {
            gather(&path, &format!("{inside}/"), deeper - 1, found)?;
        }
        // A folder without files is also listed.
        if found.len() == before {
            found.push(inside);
        }
    }
    Ok(())
}

/// Files and folders inside a folder, at any depth.
///
/// # Errors
/// A folder cannot be read, or something in it is neither a file nor a folder.
pub(super) fn contents(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let kind = entry.file_type()?;
        if kind.is_dir() {
            found.extend(contents(&entry.path())?);
        } else if !kind.is_file() {
            return Err(std::io::Error::new(
                ErrorKind::InvalidData,
                "it is neither a file nor a folder",
            ));
        }
        found.push(entry.path());
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn artifacts_lie_in_the_trials_folder_or_a_seats_and_datasets_below() {
        for name in [
            "policy.safetensors",
            "agent_3/critic.safetensors",
            "choice.json",
            "graph.json",
            "images.png",
            "dataset/data/0/part-0.parquet",
        ] {
            assert!(is_artifact(name), "{name}");
        }
        let others = [
            "../policy.safetensors",
            "../../x.safetensors",
            "seat/../../x.safetensors",
            "/etc/x.safetensors",
            "a/b/c.safetensors",
            "a//b.safetensors",
            "a\\b.safetensors",
            ".hidden.safetensors",
            "trial.json",
            "seat/graph.json",
            "other.png",
            "",
        ];
        for name in others {
            assert!(!is_artifact(name), "{name}");
        }
    }

    #[test]
    fn a_link_is_not_followed_wherever_it_stands() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir(path("seat")).unwrap();
        fs::write(path("seat/a.safetensors"), "a").unwrap();
        symlink(path("seat"), path("linked")).unwrap();
        symlink(path("seat/a.safetensors"), path("a.safetensors")).unwrap();
        symlink("..", path("loop")).unwrap();
        assert_eq!(
            read_in(folder.path(), "seat/a.safetensors").unwrap(),
            Some(b"a".to_vec())
        );
        assert_eq!(read_in(folder.path(), "seat/b.safetensors").unwrap(), None);
        for name in ["linked/a.safetensors", "a.safetensors"] {
            assert!(
                matches!(read_in(folder.path(), name), Err(Error::Damaged { .. })),
                "{name}"
            );
        }
        assert_eq!(
            files_of(folder.path()).unwrap(),
            ["a.safetensors", "linked", "loop", "seat/a.safetensors"]
        );
        assert!(
            contents(folder.path()).is_err(),
            "a folder with links is not what was written"
        );
    }
}
