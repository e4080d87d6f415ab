//! Files of a dataset that Minari reads besides its rows (`minari/dataset/minari_storage.py`, `minari/serialization.py`
//! of version 0.5.4).

use super::layout::Layout;
use crate::Space;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{
    fmt::Write as _,
    path::{Component, Path},
};

/// The folder that Minari calls a storage.
pub(super) const DATA: &str = "data";
/// File with the numbers of episodes and steps.
pub(super) const METADATA: &str = "data/metadata.json";
/// File with the length of an episode, in the episode's folder.
pub(super) const EPISODE_METADATA: &str = "metadata.json";
/// The first version of Minari that reads Parquet files; later ones read its files.
const VERSION: &str = "0.5.3";
/// Name of the dataset, in the form that Minari requires.
const NAME: &str = "regimen/gathered-v0";

/// Size of a dataset.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Totals {
    /// Number of episodes, which are numbered from 0.
    pub(super) total_episodes: u64,
    /// Decisions of all episodes.
    pub(super) total_steps: u64,
}

/// The file of an episode inside the folder of the dataset.
pub(super) fn episode_file(episode: u64) -> String {
    format!("{DATA}/{episode}/part-0.parquet")
}

/// Metadata of an episode.
pub(super) fn of_episode(episode: u64, steps: u64) -> Value {
    json!({ "id": episode, "total_steps": steps })
}

/// Metadata of a dataset of `bytes` bytes.
pub(super) fn of_dataset(layout: &Layout<'_>, totals: &Totals, bytes: u64) -> Value {
    let Totals {
        total_episodes,
        total_steps,
    } = totals;
    // In megabytes with one decimal.
    #[allow(clippy::cast_precision_loss, reason = "a number of bytes is far below 2^52")]
    let size = (bytes as f64 / 1e5).round() / 10.0;
    json!({
        "dataset_id": NAME,
        "minari_version": VERSION,
        "data_format": "parquet",
        "total_episodes": total_episodes,
        "total_steps": total_steps,
        "dataset_size": size,
        "observation_space": joint(&layout.observations()),
        "action_space": joint(&layout.actions()),
    })
}

/// The same metadata for a dataset that is passed on under a name of its own: its id, and its size in megabytes, exact
/// to the byte.
pub(super) fn named(mut metadata: Value, id: Option<&str>, bytes: u64) -> Value {
    if let Some(id) = id {
        metadata["dataset_id"] = json!(id);
    }
    #[allow(clippy::cast_precision_loss, reason = "a number of bytes is far below 2^52")]
    let size = bytes as f64 / 1e6;
    metadata["dataset_size"] = json!(size);
    metadata
}

/// The id that Minari gives a folder at `place` below its root, as in `regimen/pack-v0`; `None` if Minari refuses the
/// name (`minari/dataset/minari_dataset.py`).
pub(super) fn id_of(place: &Path) -> Option<String> {
    let part = |part: Component<'_>| match part {
        Component::Normal(name) => name.to_str().map(String::from),
        _ => None,
    };
    let parts: Vec<String> = place.components().map(part).collect::<Option<_>>()?;
    let (name, namespaces) = parts.split_last()?;
    let is_word = |text: &str| {
        let is_part = |letter: char| letter.is_alphanumeric() || letter == '-' || letter == '_';
        !text.is_empty() && text.chars().all(is_part)
    };
    let (word, version) = name.rsplit_once("-v")?;
    let has_version = !version.is_empty() && version.bytes().all(|byte| byte.is_ascii_digit());
    // A namespace has at least two letters.
    let namespace = namespaces.join("/");
    let fits = namespaces.iter().all(|part| is_word(part)) && namespace.chars().count() != 1;
    (is_word(word) && has_version && fits).then(|| parts.join("/"))
}

/// The spaces of all seats as one, in the format of `minari.serialization`, which requires text inside the metadata.
fn joint(spaces: &[&Space]) -> String {
    let numbers = |space: &&Space| match space {
        Space::Discrete(names) => Some(names.len()),
        _ => None,
    };
    match (spaces, spaces.iter().map(numbers).collect::<Option<Vec<usize>>>()) {
        ([_], Some(numbers)) => {
            json!({ "type": "Discrete", "dtype": "int64", "start": 0, "n": numbers[0] }).to_string()
        }
        (_, Some(numbers)) => {
            let start = vec![0; numbers.len()];
            json!({ "type": "MultiDiscrete", "dtype": "int64", "start": start, "nvec": numbers }).to_string()
        }
        (_, None) => {
            let limits: Vec<(f64, f64)> = spaces.iter().flat_map(|space| limits(space)).collect();
            let [low, high] = [|limit: &(f64, f64)| limit.0, |limit: &(f64, f64)| limit.1]
                .map(|side| list(limits.iter().map(side)));
            boxed(limits.len(), &low, &high)
        }
    }
}

/// Lowest and highest value of each entry of a vector.
fn limits(space: &Space) -> Vec<(f64, f64)> {
    match space {
        Space::Box(channels) => channels
            .iter()
            .map(|channel| (channel.low, channel.high))
            .collect(),
        Space::Simplex(names) => vec![(0.0, 1.0); names.len()],
        Space::Choices(_) => vec![(-1.0, 1.0); space.len()],
        Space::Discrete(names) => {
            #[allow(clippy::cast_precision_loss, reason = "a number of choices is far below 2^52")]
            let last = names.len().saturating_sub(1) as f64;
            vec![(0.0, last)]
        }
    }
}

fn boxed(length: usize, low: &str, high: &str) -> String {
    format!(r#"{{"type": "Box", "dtype": "float64", "shape": [{length}], "low": [{low}], "high": [{high}]}}"#)
}

/// Numbers with commas between them; Python's JSON supports infinities.
fn list(numbers: impl Iterator<Item = f64>) -> String {
    let mut text = String::new();
    for number in numbers {
        let comma = if text.is_empty() { "" } else { ", " };
        let infinite = if number > 0.0 { "Infinity" } else { "-Infinity" };
        let number = if number.is_finite() {
            json!(number).to_string()
        } else {
            infinite.into()
        };
        // Writing to a string cannot fail.
        let _ = write!(text, "{comma}{number}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Channel;

    #[test]
    fn spaces_are_written_as_minari_writes_them() {
        let channels = vec![
            Channel::new("speed", "m/s"),
            Channel::new("angle", "").within(-1.5, 2.0),
        ];
        let limits = r#""low": [-Infinity, -1.5], "high": [Infinity, 2.0]"#;
        let expected = format!(r#"{{"type": "Box", "dtype": "float64", "shape": [2], {limits}}}"#);
        assert_eq!(joint(&[&Space::Box(channels)]), expected);
        let names = || vec!["a".to_string(), "b".into()];
        let expected =
            r#"{"type": "Box", "dtype": "float64", "shape": [2], "low": [0.0, 0.0], "high": [1.0, 1.0]}"#;
        assert_eq!(joint(&[&Space::Simplex(names())]), expected);
        let choices = Space::Choices(vec![crate::Choice::new("norm", &["none", "batch"])]);
        let expected =
            r#"{"type": "Box", "dtype": "float64", "shape": [2], "low": [-1.0, -1.0], "high": [1.0, 1.0]}"#;
        assert_eq!(joint(&[&choices]), expected);
        let choice: Value = serde_json::from_str(&joint(&[&Space::Discrete(names())])).unwrap();
        assert_eq!(
            choice,
            json!({ "type": "Discrete", "dtype": "int64", "start": 0, "n": 2 })
        );
    }

    #[test]
    fn a_place_below_the_root_is_an_id() {
        let id = |place: &str| id_of(Path::new(place));
        for place in ["regimen/pack-v0", "pack-v12", "ab/c/some_name-v1-v2"] {
            assert_eq!(id(place).as_deref(), Some(place));
        }
        for place in [
            "",
            "pack",
            "pack-v",
            "-v0",
            "a/pack-v0",
            "my data/pack-v0",
            "pack.v0",
            "../pack-v0",
            "/pack-v0",
        ] {
            assert_eq!(id(place), None, "{place}");
        }
    }

    #[test]
    fn several_seats_are_one_agent_to_minari() {
        let names = |n: usize| Space::Discrete(vec!["a".to_string(); n]);
        let choices: Value = serde_json::from_str(&joint(&[&names(2), &names(3)])).unwrap();
        assert_eq!(
            choices,
            json!({ "type": "MultiDiscrete", "dtype": "int64", "start": [0, 0], "nvec": [2, 3] })
        );
        let speed = Space::Box(vec![Channel::new("speed", "m/s").within(-2.0, 2.0)]);
        let shares = Space::Simplex(vec!["a".to_string(), "b".into()]);
        let expected = r#"{"type": "Box", "dtype": "float64", "shape": [3], "low": [-2.0, 0.0, 0.0], "high": [2.0, 1.0, 1.0]}"#;
        assert_eq!(joint(&[&speed, &shares]), expected);
    }
}
