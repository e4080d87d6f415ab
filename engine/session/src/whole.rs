//! Folders that are written atomically.

use crate::Failure;
use contract::Error;
use execution::{
    store,
    world::{fs, process},
};
use std::path::{Path, PathBuf};

/// A folder that appears as a whole or not at all: it is filled beside its final path and renamed at the end.
pub struct Whole {
    folder: PathBuf,
    to: PathBuf,
}

impl Whole {
    /// Begins a folder beside `to`.
    ///
    /// # Errors
    /// A folder that is not empty, or cannot be created.
    pub fn begin(to: &Path) -> Result<Self, Failure> {
        if !store::names(to)?.is_empty() {
            return Err(Failure::refusal(format!(
                "`{}` is not empty; name a new folder",
                to.display()
            )));
        }
        let name = to.file_name().ok_or_else(|| {
            Failure::refusal(format!(
                "`{}` is no name of a folder that could be made",
                to.display()
            ))
        })?;
        let beside = format!(".{}.{}.tmp", name.to_string_lossy(), process::id());
        let folder = to.with_file_name(beside);
        fs::create_dir_all(&folder).map_err(Error::file("create", &folder))?;
        let to = to.to_owned();
        Ok(Self { folder, to })
    }

    /// The folder to be filled.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Moves the folder to its final path.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be renamed.
    pub fn end(self) -> Result<(), Error> {
        // An empty folder of that name does not prevent the renaming.
        fs::rename(&self.folder, &self.to).map_err(Error::file("rename to", &self.to))
    }
}

impl Drop for Whole {
    fn drop(&mut self) {
        // After the renaming nothing is left here; after a failure, a partial folder is of no use.
        let _ = fs::remove_dir_all(&self.folder);
    }
}
