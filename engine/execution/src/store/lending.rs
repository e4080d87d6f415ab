//! Links artifacts from one store into another, which computes the trials that take them.

use super::{Store, TrialFile, write_durably};
use crate::world::fs;
use contract::{Error, artifact::Taken};
use std::path::Path;

impl Store {
    /// Puts an artifact into another store under the same trial, after each of its files was compared with its
    /// acknowledged hash. Files are linked if both stores lie on one file system, and otherwise copied. The trials that
    /// take them there compare them with their hashes again.
    ///
    /// # Errors
    /// [`Error::Source`] if the artifact cannot be used, [`Error::File`] if the other store cannot be written.
    pub fn lend(&self, taken: &Taken, to: &Store) -> Result<(), Error> {
        let (id, from) = (&taken.trial, self.artifact(taken)?);
        let gone = || Error::Source {
            trial: id.clone(),
            problem: "it was acknowledged a moment ago, and is gone".into(),
        };
        let (text, _) = self.acknowledged(id)?.ok_or_else(gone)?;
        let file: TrialFile = self.file(id)?.ok_or_else(gone)?;
        let folder = to.folder(id);
        for name in file.files.keys().filter(|name| taken.kind.has_file(name)) {
            share(&from.join(name), &folder.join(name))?;
        }
        write_durably(&folder.join("trial.json"), &text)
    }
}

fn share(from: &Path, to: &Path) -> Result<(), Error> {
    let folder = to.parent().unwrap_or(to);
    fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
    if fs::exists(to) || fs::hard_link(from, to).is_ok() {
        return Ok(());
    }
    fs::copy(from, to).map(|_| ()).map_err(Error::file("copy to", to))
}
