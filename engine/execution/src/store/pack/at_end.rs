//! Packing at the end of a run.
//!
//! Packing on request waits until the pack has settled, since other machines may show old names for a while. A run does
//! not wait: it packs only if the store lies on a file system of this machine alone, no other process works in it, and
//! so many trials are short that their files are a burden.

use super::{Packing, packing::FILES};
use crate::{
    store::{Leases, Owner, Store, fsck::refuse_links, inside, lease::is_lease},
    world::fs,
};
use contract::Error;
use std::{collections::HashSet, time::Duration};

impl Store {
    /// Packs those of the trials that ended `ok` and left only metrics, if there are `many` or more, and completes an
    /// interrupted packing of them; `None` if there are too few, or packing is not allowed.
    ///
    /// # Errors
    /// [`Error::File`] if the store cannot be read or written.
    pub fn pack_at_end<'a>(
        &self,
        trials: impl Iterator<Item = &'a str>,
        many: usize,
        lease_expiry: Duration,
        stopping: &dyn Fn() -> bool,
    ) -> Result<Option<Packing>, Error> {
        let own: HashSet<&str> = trials.collect();
        let mut ids = self.ids_with_folders();
        ids.retain(|id| own.contains(id.as_str()) && self.has_metrics_alone(id));
        let packs = self.packs()?;
        let (packed, new): (Vec<_>, Vec<_>) = ids
            .into_iter()
            .partition(|id| packs.iter().any(|pack| pack.entry(id).is_some()));
        let is_many = new.len() >= many;
        let is_nothing = packed.is_empty() && !is_many;
        if is_nothing || !self.is_left_to_this_process() {
            return Ok(None);
        }
        refuse_links(self)?;
        let leases = Leases::open(self, lease_expiry)?;
        let (mut done, mut ids) = (Packing::default(), packed);
        if is_many {
            done = self.write_pack(&new)?;
            ids.extend(new);
        }
        self.leave_all_to_packs(&ids, &leases, &mut done, stopping)?;
        Ok((done.removed > 0).then_some(done))
    }

    /// Whether a trial's folder holds only files that can be packed.
    fn has_metrics_alone(&self, id: &str) -> bool {
        let is_packed = |name: &String| FILES.contains(&name.as_str()) || is_lease(name);
        inside::files_of(&self.folder(id)).is_ok_and(|files| files.iter().all(is_packed))
    }

    /// Whether no other process works in the store, and no other machine can see it.
    fn is_left_to_this_process(&self) -> bool {
        let this = Owner::this_process();
        self.bucket().is_none()
            && fs::is_of_this_machine(self.root())
            && self.owners().iter().all(|owner| *owner == this)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{pack::tests::Bench, stub};

    const EXPIRY: Duration = Duration::from_secs(30);
    const MANY: usize = 12;

    fn at_end(bench: &Bench, seeds: u64) -> Option<Packing> {
        let trials: Vec<_> = (0..seeds).map(|seed| stub::trial(4, seed)).collect();
        let ids = trials.iter().map(|trial| trial.id.as_str());
        bench.store.pack_at_end(ids, MANY, EXPIRY, &|| false).unwrap()
    }

    /// Announces a process of another machine.
    fn at_work_elsewhere(store: &Store) -> std::path::PathBuf {
        let owner = Owner {
            host: "another-host".into(),
            ..Owner::this_process()
        };
        let folder = store.root().join("owners");
        let file = folder.join("another.json");
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(&file, serde_json::to_vec(&owner).unwrap()).unwrap();
        file
    }

    #[test]
    fn few_trials_keep_their_folders_and_many_are_packed_once_nobody_else_is_at_work() {
        let few = MANY as u64 - 1;
        let bench = Bench::finished(few);
        assert_eq!(at_end(&bench, few), None);
        bench.finish(few);
        bench.finish(few + 1);
        let other = at_work_elsewhere(&bench.store);
        assert_eq!(at_end(&bench, few + 1), None, "somebody else is at work");
        std::fs::remove_file(other).unwrap();
        let done = at_end(&bench, few + 1).unwrap();
        assert_eq!((done.packed, done.removed, done.kept), (MANY, MANY, 0));
        assert_eq!(bench.store.ids_with_folders().len(), 1, "that of another study");
        assert_eq!(at_end(&bench, few + 2), None);
    }
}
