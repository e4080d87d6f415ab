//! Sealed folders. The last file of each, `manifest.json`, lists a hash of every other file and thereby shows whether
//! the folder is complete.

use super::inside::{contents, is_file, is_folder, read};
use crate::world::fs::{self, File};
use contract::Error;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, io, path::Path};

const MANIFEST: &str = "manifest.json";

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Manifest {
    /// Version of the form.
    format: u32,
    /// Version of the program; another version may write and read other files.
    program: String,
    /// Id of the folder's trial.
    trial: String,
    /// BLAKE3 of every file, by its path inside the folder.
    files: BTreeMap<String, String>,
}

/// Flushes every file of a folder to the disk and adds the manifest last.
///
/// # Errors
/// [`Error::File`] if a file cannot be read or written.
pub(super) fn seal(folder: &Path, trial: &str) -> Result<(), Error> {
    let manifest = describe(folder, trial).map_err(Error::file("read", folder))?;
    let text = serde_json::to_vec(&manifest)
        .map_err(io::Error::from)
        .map_err(Error::file("write", folder))?;
    let flushed = contents(folder).and_then(|paths| paths.iter().try_for_each(|path| flush(path)));
    flushed.map_err(Error::file("flush", folder))?;
    // This also flushes the folder itself.
    super::write_durably(&folder.join(MANIFEST), &text)
}

/// Whether a folder is as [`seal`] left it, for this trial and this version of the program.
pub(super) fn is_whole(folder: &Path, trial: &str) -> bool {
    let text = read(&folder.join(MANIFEST))
        .ok()
        .flatten()
        .filter(|_| is_folder(folder));
    let manifest = text.and_then(|text| serde_json::from_slice::<Manifest>(&text).ok());
    manifest.is_some_and(|manifest| describe(folder, trial).is_ok_and(|found| found == manifest))
}

/// Waits until a file, or the names in a folder, are on the disk.
#[track_caller]
pub(crate) fn flush(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()
}

/// Flushes the names that lead to a trial's folder to the disk. The process that created them may not have
/// done so.
///
/// # Errors
/// [`Error::File`] if a folder of the store cannot be flushed.
pub(super) fn flush_way_to(trial: &Path) -> Result<(), Error> {
    flush_way(trial, 3)
}

/// Flushes the names that lead to a folder of the store to the disk: its own, and those of the next `folders` above it,
/// the last of which is the store.
///
/// # Errors
/// [`Error::File`] if a folder of the store cannot be flushed.
pub(crate) fn flush_way(to: &Path, folders: usize) -> Result<(), Error> {
    let mut above = to.ancestors().skip(1).map(named_or_here);
    for folder in above.by_ref().take(folders) {
        flush(folder).map_err(Error::file("flush", folder))?;
    }
    match above.next().map_or(Ok(()), flush) {
        // The folder that contains the store may be one that only other users can read.
        Err(source) if source.kind() != io::ErrorKind::PermissionDenied => {
            Err(Error::file("flush the folder above", to)(source))
        }
        _ => Ok(()),
    }
}

/// A folder by a non-empty path, since the path of the current folder may be empty.
fn named_or_here(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    }
}

fn describe(folder: &Path, trial: &str) -> io::Result<Manifest> {
    let mut files = BTreeMap::new();
    for path in contents(folder)?.into_iter().filter(|path| is_file(path)) {
        let name = path
            .strip_prefix(folder)
            .unwrap_or(&path)
            .to_string_lossy()
            .into_owned();
        if name != MANIFEST {
            files.insert(name, blake3::hash(&fs::read(&path)?).to_hex().to_string());
        }
    }
    Ok(Manifest {
        format: 1,
        program: env!("CARGO_PKG_VERSION").into(),
        trial: trial.into(),
        files,
    })
}
