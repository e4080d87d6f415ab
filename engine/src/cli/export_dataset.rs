//! `export --minari TRIAL`: episodes of a stored trial as a dataset that Minari reads.
//!
//! What a trial gathered is copied, every file held against its acknowledged hash. A trial that gathered nothing is
//! played: episode `k` is the one that `rollout --trial TRIAL --seed <seed + k>` writes.

use super::{
    Common, Failure, OK,
    export::{Whole, refused},
    one_trial, say, settings,
};
use crate::{
    Error, ProductKind, Registry,
    count::count,
    dataset::{self, Dataset, DatasetWriter},
    product::Taken,
    random::Streams,
    rollout,
    store::Store,
    trial::TrialKey,
};
use std::path::Path;

/// Most decisions of an episode that is played; one that goes on is cut off, and says so.
const LONGEST_EPISODE: u64 = 100_000;

/// What is played where nothing was gathered.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(super) struct Play {
    /// With `--minari`, of a trial that gathered no dataset: how many episodes its policy plays.
    #[arg(long, value_name = "N", requires = "minari", value_parser = clap::value_parser!(u64).range(1..))]
    episodes: Option<u64>,
    /// With `--episodes`: seed of the first one, which counts up; 0 where absent.
    #[arg(long, value_name = "N", requires = "episodes")]
    seed: Option<u64>,
}

/// Takes away the episodes of one trial, which `prefix` names.
pub(super) fn of_trial(
    registry: &Registry,
    prefix: &str,
    play: Play,
    to: &Path,
    common: &Common,
) -> Result<u8, Failure> {
    let store = settings::read(common)?.open()?;
    let (id, file) = one_trial::that_ended_well(&store, prefix)?;
    let gathered = Taken {
        trial: id.clone(),
        kind: ProductKind::Dataset,
    };
    let is_gathered = store.product_if_left(&gathered)?.is_some();
    match (is_gathered, play.episodes) {
        (true, Some(_)) => {
            return Err(refused(format!(
                "trial {id} gathered a dataset, which is taken as it is; leave out `--episodes`"
            )));
        }
        (false, None) => {
            return Err(refused(format!(
                "trial {id} gathered no dataset; say with `--episodes` how many its agent shall play"
            )));
        }
        _ => {}
    }
    let whole = Whole::begin(to)?;
    match play.episodes {
        None => store.copy_product(&gathered, &format!("{}/", dataset::FOLDER), whole.folder())?,
        Some(episodes) => {
            let seed = play.seed.unwrap_or(0);
            self::play(
                registry,
                &store,
                &file.key,
                seed..seed.saturating_add(episodes),
                whole.folder(),
            )?;
        }
    }
    let dataset = Dataset::read_from(whole.folder())?;
    whole.end()?;
    let decisions: usize = dataset.episodes.iter().map(|episode| episode.actions.len()).sum();
    say(&format!(
        "trial {id}: {} of {} in `{}`",
        count(dataset.episodes.len(), "episode"),
        count(decisions, "decision"),
        to.display()
    ));
    Ok(OK)
}

/// Plays an episode per seed and keeps it.
fn play(
    registry: &Registry,
    store: &Store,
    key: &TrialKey,
    seeds: std::ops::Range<u64>,
    folder: &Path,
) -> Result<(), Failure> {
    let find = |taken: &Taken| store.product(taken);
    let mut environment = one_trial::environment(registry, key, &find)?;
    let interface = environment.interface();
    let mut writer = DatasetWriter::at(folder, &interface)?;
    for seed in seeds {
        let streams = Streams::new("rollout", "rollout", seed);
        let mut agent = rollout::trained_agent(key, registry, &interface, &streams, &find)?;
        let episode = rollout::episode(&mut *environment, &mut *agent, LONGEST_EPISODE, seed);
        writer.episode(&episode.map_err(|error| in_episode(error, seed))?)?;
    }
    Ok(writer.finish()?)
}

/// The error of an episode, which its seed plays again.
fn in_episode(error: Error, seed: u64) -> Failure {
    refused(format!("the episode of seed {seed}: {error}"))
}
