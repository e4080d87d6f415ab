//! `pack`: packs short trials of a store into one file.

use super::{Common, Format, say};
use clap::Args;
use contract::Registry;
use document::count::{count, either};
use execution::store::{self, Leases, Packing, Store};
use session::{Exit, Failure, Settings};
use std::{path::PathBuf, time::Duration};

/// The store to pack, and the time that packed trials keep their folders.
#[derive(Debug, Clone, Args)]
pub(super) struct PackOptions {
    /// Folder of the store.
    #[arg(value_name = "STORE")]
    folder: Option<PathBuf>,
    /// Time that packed trials keep their folders, because other machines that share the store may see its old names
    /// for that long.
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    settle_s: u32,
}

/// The exit code is always 0: trials that cannot be packed stay unchanged.
pub(super) fn pack(registry: &Registry, options: &PackOptions, common: &Common) -> Result<Exit, Failure> {
    let settings = Settings::read(registry, &common.machine())?;
    let root = options.folder.clone().unwrap_or(settings.store);
    if let Some(problem) = store::no_store(&root)? {
        return Err(Failure::refusal(problem));
    }
    let store = Store::at(&root);
    let leases = Leases::open(&store, settings.lease_expiry)?;
    let done = store.pack(&leases, Duration::from_secs(options.settle_s.into()))?;
    match common.format {
        Format::Json => say(&serde_json::to_string(&done).unwrap_or_default()),
        Format::Text => say(&as_text(&done)),
    }
    Ok(Exit::Ok)
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
