//! `export --minari TRIAL`: episodes of a stored trial as a dataset that Minari reads.
//!
//! A gathered dataset is copied, and every file is checked against its acknowledged hash. For a trial that gathered
//! nothing, episodes are played: episode `k` is the one that `rollout --trial TRIAL --seed <seed + k>` writes. Minari
//! finds a dataset by its path below its root, so that path is the id of the dataset.

use crate::{Failure, one_trial, rollout, whole::Whole};
use contract::{
    ArtifactKind, Error, Registry,
    artifact::Taken,
    dataset::{self, Dataset, DatasetWriter},
    random::Streams,
    trial::TrialKey,
};
use execution::store::Store;
use std::{
    ops::Range,
    path::{Path, PathBuf},
};

/// Maximum number of decisions of a played episode; a longer episode is truncated and marked so.
const LONGEST_EPISODE: u64 = 100_000;

/// Exported episodes of one trial.
pub struct TakenEpisodes {
    /// Id of the trial.
    pub trial: String,
    /// Number of episodes.
    pub episodes: usize,
    /// Number of decisions in them.
    pub decisions: usize,
    /// The id by which Minari finds the dataset; `None` if its path is not a valid id.
    pub id: Option<String>,
    /// The root folder of Minari under which the dataset has that id.
    pub root: Option<PathBuf>,
}

/// Exports the episodes of the trial that `prefix` names: the dataset that it gathered, or one episode for each seed of
/// `played`. `minari_root` is the folder below which Minari looks for datasets.
///
/// # Errors
/// Fails if there is no such trial, if seeds are given for a trial that gathered a dataset or missing for one that did
/// not, and if the folder exists or cannot be written.
pub fn of_trial(
    registry: &Registry,
    store: &Store,
    prefix: &str,
    played: Option<Range<u64>>,
    to: &Path,
    minari_root: Option<&Path>,
) -> Result<TakenEpisodes, Failure> {
    let (id, file) = one_trial::that_ended_well(store, prefix)?;
    let gathered = Taken {
        trial: id.clone(),
        kind: ArtifactKind::Dataset,
    };
    check_source(
        &id,
        store.artifact_if_left(&gathered)?.is_some(),
        played.is_some(),
    )?;
    let whole = Whole::begin(to)?;
    match played {
        None => store.copy_artifact(&gathered, &format!("{}/", dataset::FOLDER), whole.folder())?,
        Some(seeds) => play(registry, store, &file.key, seeds, whole.folder())?,
    }
    let dataset = Dataset::read_from(whole.folder())?;
    let name = id_of(to, minari_root);
    dataset::name(whole.folder(), name.as_deref())?;
    whole.end()?;
    Ok(TakenEpisodes {
        trial: id,
        episodes: dataset.episodes.len(),
        decisions: dataset.episodes.iter().map(|episode| episode.actions.len()).sum(),
        root: name.as_deref().map(|name| root_of(to, name)),
        id: name,
    })
}

/// Refuses to play episodes if the trial gathered a dataset, and to copy a dataset if it gathered none.
fn check_source(id: &str, is_gathered: bool, is_played: bool) -> Result<(), Failure> {
    match (is_gathered, is_played) {
        (true, true) => Err(Failure::refusal(format!(
            "trial {id} gathered a dataset, which is taken as it is; leave out `--episodes`"
        ))),
        (false, false) => Err(Failure::refusal(format!(
            "trial {id} gathered no dataset; say with `--episodes` how many its agent shall play"
        ))),
        _ => Ok(()),
    }
}

/// The id of a dataset in the folder `to`: its path below the root of Minari, or the last two names of its path if it
/// lies elsewhere. `None` if these are not a valid id.
fn id_of(to: &Path, root: Option<&Path>) -> Option<String> {
    // A path that cannot be made absolute has no id.
    let whole = |path: &Path| std::path::absolute(path).ok();
    let to = whole(to)?;
    let usual = to
        .ancestors()
        .find(|it| it.ends_with(".minari/datasets"))
        .map(Path::to_path_buf);
    let below = |root: PathBuf| to.strip_prefix(root).ok().map(Path::to_path_buf);
    let place = root
        .and_then(whole)
        .and_then(below)
        .or_else(|| usual.and_then(below));
    if let Some(place) = place {
        return dataset::id_of(&place);
    }
    let name = PathBuf::from(to.file_name()?);
    let namespace = to.parent().and_then(Path::file_name);
    let place = namespace.map(|namespace| Path::new(namespace).join(&name));
    place
        .and_then(|place| dataset::id_of(&place))
        .or_else(|| dataset::id_of(&name))
}

/// The folder below which the path of `to` is its id.
fn root_of(to: &Path, id: &str) -> PathBuf {
    let to = std::path::absolute(to).unwrap_or_else(|_| to.to_path_buf());
    let root = to.ancestors().nth(id.split('/').count());
    root.unwrap_or(Path::new("/")).to_owned()
}

/// Plays one episode for each seed and stores it.
fn play(
    registry: &Registry,
    store: &Store,
    key: &TrialKey,
    seeds: Range<u64>,
    folder: &Path,
) -> Result<(), Failure> {
    let find = |taken: &Taken| store.artifact(taken);
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

/// The error of an episode, with the seed that plays it again.
fn in_episode(error: Error, seed: u64) -> Failure {
    Failure::refusal(format!("the episode of seed {seed}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_id_is_the_place_below_the_root_of_minari() {
        let id = |to: &str, root: Option<&str>| id_of(Path::new(to), root.map(Path::new));
        let known = [
            ("/data/regimen/pack-v0", Some("/data"), "regimen/pack-v0"),
            ("/data/pack-v0", Some("/data"), "pack-v0"),
            ("/home/a/.minari/datasets/pack-v0", None, "pack-v0"),
            ("/data/regimen/pack-v0", None, "regimen/pack-v0"),
            ("/data/regimen/pack-v0", Some("/elsewhere"), "regimen/pack-v0"),
            ("/my data/pack-v0", None, "pack-v0"),
        ];
        for (to, root, expected) in known {
            assert_eq!(id(to, root).as_deref(), Some(expected), "{to}");
        }
        assert_eq!(id("/data/taken/dataset", None), None);
        assert_eq!(id("/data/my data/pack-v0", Some("/data")), None);
        assert_eq!(
            root_of(Path::new("/data/regimen/pack-v0"), "regimen/pack-v0"),
            Path::new("/data")
        );
    }
}
