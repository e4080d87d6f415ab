//! Files that are complete or absent after a crash: written beside their places, flushed and renamed.

use super::{boundary, sealed_folder};
use crate::world::{
    fs::{self, File},
    process,
};
use contract::Error;
use std::{
    io::{self, Write},
    path::{Path, PathBuf},
};

/// Names in a folder, in order; empty if there is no folder.
///
/// # Errors
/// [`Error::File`] if the folder cannot be read.
pub fn names(folder: &Path) -> Result<Vec<String>, Error> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(source) if source.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(source) => return Err(Error::file("read", folder)(source)),
    };
    let mut names = Vec::new();
    for entry in entries {
        names.push(
            entry
                .map_err(Error::file("read", folder))?
                .file_name()
                .to_string_lossy()
                .into_owned(),
        );
    }
    names.sort_unstable();
    Ok(names)
}

/// Writes a file so that after a crash it is either the old one or the complete new one.
///
/// # Errors
/// [`Error::File`] if the folder or the file cannot be written.
pub fn write_durably(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let temporary = write_beside(path, bytes)?;
    fs::rename(&temporary, path).map_err(Error::file("rename to", path))?;
    flush_folder_of(path)
}

/// Like [`write_durably`], for a new file; false if the file exists, which is then not changed.
pub(super) fn write_new_durably(path: &Path, bytes: &[u8]) -> Result<bool, Error> {
    let temporary = write_beside(path, bytes)?;
    let is_new = match fs::hard_link(&temporary, path) {
        Ok(()) => true,
        Err(source) if source.kind() == io::ErrorKind::AlreadyExists => false,
        Err(source) => {
            let _ = fs::remove_file(&temporary);
            return Err(Error::file("link", path)(source));
        }
    };
    remove(&temporary)?;
    flush_folder_of(path)?;
    Ok(is_new)
}

/// Path under which this process writes a file before the rename to its place. The process id keeps apart two processes
/// that write the same trial.
pub(super) fn temporary(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}.tmp", process::id()))
}

pub(super) fn write_beside(path: &Path, bytes: &[u8]) -> Result<PathBuf, Error> {
    let temporary = temporary(path);
    boundary::pass("before a file is created", path);
    let written = write_flushed(&temporary, path, bytes);
    if written.is_err() {
        // Frees the space of a full disk; `fsck` finds a file that cannot be removed.
        let _ = fs::remove_file(&temporary);
    }
    written.map(|()| temporary)
}

/// Flushes the name of a file to the disk.
pub(super) fn flush_folder_of(path: &Path) -> Result<(), Error> {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    boundary::pass("after a file is renamed", path);
    sealed_folder::flush(folder).map_err(Error::file("flush", folder))?;
    boundary::pass("after a folder is flushed", path);
    Ok(())
}

fn write_flushed(temporary: &Path, path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let mut file = File::create(temporary).map_err(Error::file("create", temporary))?;
    let (first, second) = bytes.split_at(bytes.len() / 2);
    file.write_all(first).map_err(Error::file("write", temporary))?;
    boundary::pass("after half of a file is written", path);
    file.write_all(second).map_err(Error::file("write", temporary))?;
    boundary::pass("after a file is written", path);
    file.sync_all().map_err(Error::file("flush", temporary))?;
    boundary::pass("after a file is flushed", path);
    Ok(())
}

/// Removes a file, which may already be gone.
pub(super) fn remove(path: &Path) -> Result<(), Error> {
    absent_is_fine(fs::remove_file(path)).map_err(Error::file("remove", path))
}

pub(crate) fn absent_is_fine(outcome: io::Result<()>) -> io::Result<()> {
    outcome.or_else(|source| {
        if source.kind() == io::ErrorKind::NotFound {
            Ok(())
        } else {
            Err(source)
        }
    })
}
