//! Short trials of a store in one file, at the end of a run.

use crate::{Failure, Planned, Session};
use document::count::{count, either};
use std::sync::atomic::Ordering;

/// A run packs its trials where so many of them have a folder and left nothing but metrics.
const MANY: usize = 1000;

impl Session<'_> {
    /// Packs the trials of finished studies, where they are many. A store that cannot be packed is a warning: nothing
    /// is lost by it.
    ///
    /// # Errors
    /// Where nothing could stop it.
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
