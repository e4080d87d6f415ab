//! `pack`: short trials of a store in one file.

use super::{
    BAD_SPEC, Common, Failure, Format, OK, complain,
    compute::listen_for_signals,
    planned::Planned,
    say,
    settings::{self, Settings},
};
use clap::Args;
use document::count::{count, either};
use execution::store::{self, Leases, Packing, Store};
use std::{
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

/// A run packs its trials where so many of them have a folder and left nothing but metrics.
const MANY: usize = 1000;

/// Which store, and how careful.
#[derive(Debug, Clone, Args)]
pub(super) struct PackOptions {
    /// Folder of the store.
    #[arg(value_name = "STORE")]
    folder: Option<PathBuf>,
    /// How long packed trials keep their folders: other machines that share the store may see its old names for so
    /// long.
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    settle_s: u32,
}

/// Always 0: what cannot be packed stays as it is.
pub(super) fn pack(options: &PackOptions, common: &Common) -> Result<u8, Failure> {
    let settings = settings::read(common)?;
    let root = options.folder.clone().unwrap_or(settings.store);
    if let Some(problem) = store::no_store(&root)? {
        let text = format!("error: {problem}");
        return Err(Failure { code: BAD_SPEC, text });
    }
    let store = Store::at(&root);
    let leases = Leases::open(&store, settings.lease_expiry)?;
    let done = store.pack(&leases, Duration::from_secs(options.settle_s.into()))?;
    match common.format {
        Format::Json => say(&serde_json::to_string(&done).unwrap_or_default()),
        Format::Text => say(&as_text(&done)),
    }
    Ok(OK)
}

/// Packs the trials of finished studies at the end of a run, where they are many. A store that cannot be packed is a
/// warning: nothing is lost by it.
pub(super) fn at_end(planned: &[Planned], store: &Store, settings: &Settings) -> Result<(), Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    listen_for_signals(&stop)?;
    let trials = planned.iter().flat_map(|one| &one.plan.trials);
    let stopping = || stop.load(Ordering::SeqCst);
    let ids = trials.map(|trial| trial.id.as_str());
    match store.pack_at_end(ids, MANY, settings.lease_expiry, &stopping) {
        Ok(Some(done)) => {
            let removed = count(done.removed, "short trial");
            let lie = either(&done.removed, "lies", "lie");
            complain(&format!(
                "{removed} {lie} in `{}` now, without folders of their own",
                store.root().join("packs").display()
            ));
        }
        Ok(None) => {}
        Err(error) => complain(&format!("warning: short trials keep their folders: {error}")),
    }
    Ok(())
}

fn as_text(done: &Packing) -> String {
    let pack = done.pack.as_ref().map_or_else(
        || "no trial is new to packs".to_owned(),
        |pack| {
            let (trials, kilobytes) = (count(done.packed, "trial"), done.bytes.div_ceil(1000));
            let lie = either(&done.packed, "lies", "lie");
            format!("{trials} {lie} in `{}` now, {kilobytes} kB", pack.display())
        },
    );
    let removed = count(done.removed, "folder");
    let (gone, keep) = (
        either(&done.removed, "is", "are"),
        either(&done.kept, "keeps its folder", "keep their folders"),
    );
    let kept = count(done.kept, "trial");
    format!(
        "{pack}\n{removed} {gone} gone; {kept} {keep}: what left more than metrics, did not end well, runs now or is large"
    )
}
