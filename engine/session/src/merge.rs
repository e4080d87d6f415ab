//! Merges the trials of several stores into one.

use crate::{Exit, Failure, Observer, Settings, seen::unite};
use execution::{
    store::{self, Fate, Leases, Merge, Merged, Store},
    world::fs,
};
use std::path::{Path, PathBuf};

/// The outcome of merging one store into another.
pub struct MergedStore {
    /// The source store.
    pub from: PathBuf,
    /// Its trials.
    pub trials: Vec<Merged>,
    /// Whether every record of verdicts could be read.
    pub has_records: bool,
}

/// Copies the trials of `sources` into the store `into`, which is created if it does not exist. With `dry_run` nothing
/// is written. `hear` is called for every trial.
///
/// # Errors
/// Fails for a source that does not exist or is the destination, and for a destination that cannot be written.
pub fn merge(
    sources: &[PathBuf],
    into: &Path,
    dry_run: bool,
    settings: &Settings,
    observer: &dyn Observer,
    hear: &mut dyn FnMut(&Merged),
) -> Result<Vec<MergedStore>, Failure> {
    sources.iter().try_for_each(|from| check(from, into))?;
    let into = Store::at(into);
    let leases = (!dry_run)
        .then(|| Leases::open(&into, settings.lease_expiry))
        .transpose()?;
    let mut merge = Merge::new(&into, leases.as_ref())?;
    let mut stores = Vec::new();
    for from in sources {
        let source = Store::at(from);
        let mut trials = Vec::new();
        merge.take(&source, &mut |merged| {
            hear(&merged);
            trials.push(merged);
        })?;
        stores.push(MergedStore {
            from: from.clone(),
            trials,
            has_records: unite(observer, &into, &source, dry_run)?,
        });
    }
    Ok(stores)
}

/// Exit code 101 if two stores hold different bytes of one trial. 106 if a trial was not copied because it is damaged
/// or running, or a record of verdicts because it is damaged. Otherwise 0.
#[must_use]
pub fn exit_of_merge(stores: &[MergedStore]) -> Exit {
    let fates = || stores.iter().flat_map(|store| &store.trials).map(|it| &it.fate);
    if fates().any(|fate| matches!(fate, Fate::Conflict { .. })) {
        Exit::Differs
    } else if fates().any(|fate| matches!(fate, Fate::Damaged { .. } | Fate::Running { .. }))
        || stores.iter().any(|store| !store.has_records)
    {
        Exit::Incomplete
    } else {
        Exit::Ok
    }
}

/// Refuses a source that does not exist, and a source that is the destination.
fn check(from: &Path, into: &Path) -> Result<(), Failure> {
    if let Some(problem) = store::no_store(from)? {
        return Err(Failure::refusal(problem));
    }
    if fs::is_same(from, into) {
        return Err(Failure::refusal(format!(
            "`{}` is the store that is taken into; name another one",
            from.display()
        )));
    }
    Ok(())
}
