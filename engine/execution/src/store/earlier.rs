//! The earlier end of a trial, kept while it is tried again.
//!
//! A trial is tried again by moving its acknowledgement to another name beside it. It is then missing until it has
//! ended again, whatever happens to the process that wanted it.

use super::{Store, boundary, index::parse, inside, remove, sealed_folder::flush};
use crate::world::fs;
use contract::{Error, trial_end::TrialEnd};
use std::path::Path;

const NAME: &str = "earlier.json";

impl Store {
    /// Makes an ended trial missing, and keeps its end as the earlier one. Only the holder of the trial's
    /// lease may call it.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be renamed.
    pub fn try_again(&self, id: &str) -> Result<(), Error> {
        let folder = self.folder(id);
        let earlier = folder.join(NAME);
        fs::rename(folder.join("trial.json"), &earlier).map_err(Error::file("rename to", &earlier))?;
        boundary::pass("after an end is put beside", &earlier);
        flush(&folder).map_err(Error::file("flush", &folder))
    }

    /// The earlier end of a trial that has to be tried again.
    #[must_use]
    pub fn earlier(&self, id: &str) -> Option<TrialEnd> {
        Some(parse(&inside::read(&self.folder(id).join(NAME)).ok()??).ok()?.end)
    }
}

/// Removes the earlier end of a trial that has ended again; usually there is none.
pub(super) fn forget(trial: &Path) -> Result<(), Error> {
    remove(&trial.join(NAME))
}
