//! Packs short trials of a store into one file at the end of a run.

use crate::{Failure, Planned, Session};
use document::count::{count, either};
use std::sync::atomic::Ordering;

/// Minimum number of trials for packing; only trials in a folder that left nothing but metrics count.
const MANY: usize = 1000;

impl Session<'_> {
    /// Packs the trials of finished studies if there are many. If a store cannot be packed, it is only a warning, since
    /// no data is lost.
    ///
    /// # Errors
    /// Fails if nothing can stop it.
    pub fn pack(&self, planned: &[Planned]) -> Result<(), Failure> {
        let (store, stop) = (self.store()?, self.observer.stop()?);
        let trials = planned.iter().flat_map(|one| &one.plan.trials);
        let stopping = || stop.load(Ordering::SeqCst);
        let ids = trials.map(|trial| trial.id.as_str());
        match store.pack_at_end(ids, MANY, self.settings.lease_expiry, &stopping) {
            Ok(Some(done)) => {
                let removed = count(done.removed, "short trial");
                let lie = either(&done.removed, "lies", "lie");
                self.notice(&format!(
                    "{removed} {lie} in `{}` now, without folders of their own",
                    store.root().join("packs").display()
                ));
            }
            Ok(None) => {}
            Err(error) => self.notice(&format!("warning: short trials keep their folders: {error}")),
        }
        Ok(())
    }
}
