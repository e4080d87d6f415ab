//! Folders that appear whole or not at all.

use crate::Failure;
use contract::Error;
use execution::{
    store,
    world::{fs, process},
};
use std::path::{Path, PathBuf};

/// A folder that appears whole or not at all: it is filled beside its place and renamed.
pub struct Whole {
    folder: PathBuf,
    to: PathBuf,
}

impl Whole {
    /// Begins a folder.
    ///
    /// # Errors
    /// A folder that is not empty, or cannot be made.
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

    /// Where it is filled.
    /// The folder to be filled.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Lets it appear.
    /// Puts it in its place.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be renamed.
    pub fn end(self) -> Result<(), Error> {
        // An empty folder of the name is in the way of none.
        fs::rename(&self.folder, &self.to).map_err(Error::file("rename to", &self.to))
    }
}

impl Drop for Whole {
    fn drop(&mut self) {
        // Where it was renamed there is nothing; where something went wrong, half a folder helps nobody.
        let _ = fs::remove_dir_all(&self.folder);
    }
}
