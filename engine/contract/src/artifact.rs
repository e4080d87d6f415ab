//! Artifacts: files that a trial leaves in its folder for other trials, and their names in configs.
//!
//! A plugin declares a config value as a [`Artifact`]; a study writes `{ from: NAME }` there. The plan finds the trial
//! that leaves it and makes that trial's id, instead of the name, part of the consumer's. The identity of an artifact
//! therefore covers every step that leads to it. A trial gets the folder of each artifact after its files were compared
//! with their acknowledged hashes.

use crate::Error;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{
    borrow::Cow,
    collections::BTreeMap,
    fmt::{self, Display, Formatter},
    fs,
    marker::PhantomData,
    path::{Path, PathBuf},
};

/// The folder of a [`ArtifactKind::Checkpoint`] inside a trial's.
pub const CHECKPOINT: &str = "checkpoint";
/// The file with the state of the protocol, in that folder.
pub const CHECKPOINT_STATE: &str = "state.json";
/// The file with the rows recorded so far, in that folder.
pub const CHECKPOINT_ROWS: &str = "metrics.parquet";
/// The folder with the state of the agent, in that folder.
pub const CHECKPOINT_AGENT: &str = "agent";

/// The policy of an agent that trains itself, in a trial's folder.
pub const ONNX_FILE: &str = "policy.onnx";
/// The file of an agent whose code is not part of this program, in the agent's own format, in a trial's folder.
pub const SAVED_FILE: &str = "policy.saved";

/// The file with the graph of a design.
pub const GRAPH_FILE: &str = "graph.json";
/// The file with samples.
pub const IMAGES_FILE: &str = "images.png";

/// A kind of artifact that a trial can leave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ArtifactKind {
    /// A policy: `policy.safetensors`, in folders by seat if each seat has its own policy; `policy.onnx` of an agent
    /// that trains itself; `policy.saved` of a learner in Python.
    Policy,
    /// Networks with everything that learning continues from except its experience: `networks.safetensors`, in folders
    /// by seat if each seat has its own.
    Networks,
    /// The state of learning at the last step, including experience and environments: the folder `checkpoint`.
    Checkpoint,
    /// Transitions that were gathered: the folder `dataset`, in Parquet.
    Dataset,
    /// A config that was chosen: `choice.json`.
    Choice,
    /// The graph of a design that was found: `graph.json`.
    Graph,
    /// Samples of generated images: `images.png`.
    Images,
}

impl ArtifactKind {
    /// All kinds, in the order of the documentation.
    pub const ALL: [Self; 7] = [
        Self::Policy,
        Self::Networks,
        Self::Checkpoint,
        Self::Dataset,
        Self::Choice,
        Self::Graph,
        Self::Images,
    ];

    /// Name of the kind in studies and messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Policy => "policy",
            Self::Networks => "networks",
            Self::Checkpoint => "checkpoint",
            Self::Dataset => "dataset",
            Self::Choice => "choice",
            Self::Graph => "graph",
            Self::Images => "images",
        }
    }

    /// A sentence on the kind and on its place in a trial's folder.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            Self::Policy => {
                "A policy: `policy.safetensors`, in folders by seat where there is one policy per seat, or \
                 `policy.onnx`, or `policy.saved` of a learner in Python."
            }
            Self::Networks => {
                "Networks with all that learning goes on with but its experience: `networks.safetensors`, in \
                 folders by seat where each has its own."
            }
            Self::Checkpoint => {
                "Learning as it stood at the last step, experience and environments too: the folder `checkpoint`."
            }
            Self::Dataset => "Transitions that were gathered: the folder `dataset`, in Parquet.",
            Self::Choice => "A config that was chosen: `choice.json`.",
            Self::Graph => "The graph of a design that was found: `graph.json`, for the figure `graph`.",
            Self::Images => "Samples of what was made: `images.png`, for the figure `images`.",
        }
    }

    /// Whether a trial's folder holds an artifact of this kind.
    #[must_use]
    pub fn lies_in(self, folder: &Path) -> bool {
        let beside_or_below = |name: &str| {
            let below = fs::read_dir(folder).into_iter().flatten().flatten();
            folder.join(name).is_file() || below.into_iter().any(|entry| entry.path().join(name).is_file())
        };
        match self {
            Self::Policy => {
                let is_there = |name: &&str| folder.join(name).is_file();
                beside_or_below("policy.safetensors") || [ONNX_FILE, SAVED_FILE].iter().any(is_there)
            }
            Self::Networks => beside_or_below("networks.safetensors"),
            Self::Checkpoint => folder.join(CHECKPOINT).join(CHECKPOINT_STATE).is_file(),
            Self::Dataset => folder.join("dataset").is_dir(),
            Self::Choice => folder.join("choice.json").is_file(),
            Self::Graph => folder.join(GRAPH_FILE).is_file(),
            Self::Images => folder.join(IMAGES_FILE).is_file(),
        }
    }

    /// Whether a path inside a trial's folder is a file of such an artifact.
    #[must_use]
    pub fn has_file(self, path: &str) -> bool {
        let last = path.rsplit('/').next().unwrap_or_default();
        match self {
            _ if is_of_checkpoint(path) => self == Self::Checkpoint,
            Self::Checkpoint => false,
            Self::Policy => {
                [ONNX_FILE, SAVED_FILE].contains(&path)
                    || last.ends_with(".safetensors") && !Self::Networks.has_file(path)
            }
            Self::Networks => last == "networks.safetensors",
            Self::Dataset => path.starts_with("dataset/"),
            Self::Choice => path == "choice.json",
            Self::Graph => path == GRAPH_FILE,
            Self::Images => path == IMAGES_FILE,
        }
    }
}

/// Whether only a [`ArtifactKind::Checkpoint`] has a file at this path.
fn is_of_checkpoint(path: &str) -> bool {
    path.strip_prefix(CHECKPOINT)
        .and_then(|rest| rest.strip_prefix('/'))
        .is_some_and(|rest| {
            [CHECKPOINT_STATE, CHECKPOINT_ROWS].contains(&rest)
                || rest
                    .strip_prefix(CHECKPOINT_AGENT)
                    .is_some_and(|rest| rest.starts_with('/'))
        })
}

impl Display for ArtifactKind {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        out.pad(self.name())
    }
}

/// Marker of a kind of artifact: a type that shows which kind a config takes.
pub trait ArtifactMarker: 'static {
    /// The kind that the type stands for.
    const KIND: ArtifactKind;
}

/// [`ArtifactKind::Policy`].
#[derive(Debug, Clone, PartialEq)]
pub struct Policy;
/// [`ArtifactKind::Networks`].
#[derive(Debug, Clone, PartialEq)]
pub struct Networks;
/// [`ArtifactKind::Checkpoint`].
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint;
/// [`ArtifactKind::Dataset`].
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset;
/// [`ArtifactKind::Choice`].
#[derive(Debug, Clone, PartialEq)]
pub struct Choice;

impl ArtifactMarker for Policy {
    const KIND: ArtifactKind = ArtifactKind::Policy;
}

impl ArtifactMarker for Networks {
    const KIND: ArtifactKind = ArtifactKind::Networks;
}

impl ArtifactMarker for Checkpoint {
    const KIND: ArtifactKind = ArtifactKind::Checkpoint;
}

impl ArtifactMarker for Dataset {
    const KIND: ArtifactKind = ArtifactKind::Dataset;
}

impl ArtifactMarker for Choice {
    const KIND: ArtifactKind = ArtifactKind::Choice;
}

/// The trial from which a config takes an artifact, by the names of a study.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Reference {
    /// An entry of the section `prepare`, or an agent.
    pub from: String,
    /// The environment in which the agent was trained; that of the trial which takes the artifact where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub environment: Option<String>,
    /// The seed whose artifact every seed takes; seed `k` takes that of seed `k` where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
}

/// An artifact of another trial in a config: names in a study, or a folder inside a trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ArtifactConfig", into = "ArtifactConfig")]
#[serde(bound = "K: ArtifactMarker + Clone")]
pub struct Artifact<K: ArtifactMarker> {
    reference: Reference,
    folder: Option<PathBuf>,
    kind: PhantomData<fn() -> K>,
}

/// The form of an artifact in a config.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ArtifactConfig {
    from: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    environment: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seed: Option<u64>,
    /// Kind of the artifact, written by the program, so that a complete config names it.
    #[serde(rename = "product", default)]
    artifact: Option<ArtifactKind>,
    /// Set inside a trial, instead of the names of the study.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    folder: Option<PathBuf>,
}

impl<K: ArtifactMarker> Artifact<K> {
    /// The name of its source in the study.
    #[must_use]
    pub fn source(&self) -> &str {
        &self.reference.from
    }

    /// The folder of the trial that left it, after every file of the artifact was checked.
    ///
    /// # Errors
    /// [`Error::Source`] outside a trial, where no artifact is available.
    pub fn folder(&self) -> Result<&Path, Error> {
        self.folder.as_deref().ok_or_else(|| Error::Source {
            trial: format!("`{}`", self.reference.from),
            problem: format!("its {} is at hand only inside a trial of a study", K::KIND),
        })
    }
}

impl<K: ArtifactMarker> TryFrom<ArtifactConfig> for Artifact<K> {
    type Error = String;

    fn try_from(form: ArtifactConfig) -> Result<Self, String> {
        let ArtifactConfig {
            from,
            environment,
            seed,
            artifact,
            folder,
        } = form;
        match artifact.filter(|kind| *kind != K::KIND) {
            Some(other) => Err(format!("a {} is taken here, no {other}", K::KIND)),
            None => Ok(Self {
                reference: Reference {
                    from,
                    environment,
                    seed,
                },
                folder,
                kind: PhantomData,
            }),
        }
    }
}

impl<K: ArtifactMarker> From<Artifact<K>> for ArtifactConfig {
    fn from(artifact: Artifact<K>) -> Self {
        let Reference {
            from,
            environment,
            seed,
        } = artifact.reference;
        // A folder is not part of a config, since it differs between stores.
        Self {
            from,
            environment,
            seed,
            artifact: Some(K::KIND),
            folder: None,
        }
    }
}

impl<K: ArtifactMarker> JsonSchema for Artifact<K> {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        format!("ProductOf{}", K::KIND).into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        reference_schema(K::KIND)
    }
}

/// Schema of an artifact of this kind, as a study writes it.
#[must_use]
pub fn reference_schema(kind: ArtifactKind) -> Schema {
    json_schema!({
        "type": "object", "additionalProperties": false, "required": ["from"],
        "properties": {
            "from": { "type": "string", "description": format!("Whose {kind}: an entry of the section \
                                                                `prepare`, or an agent.") },
            "environment": {
                "type": "string",
                "description": "The environment that the agent was trained in; the one of the trial itself \
                                where absent.",
            },
            "seed": {
                "type": "integer", "minimum": 0,
                "description": "The seed whose artifact every seed takes; seed k takes that of seed k where \
                                absent.",
            },
            "product": { "enum": [kind.name()], "description": "The kind of artifact; need not be written." },
        },
    })
}

/// A trial's artifact that another trial takes.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Taken {
    /// Id of the trial that leaves it.
    pub trial: String,
    /// Kind of the artifact.
    pub kind: ArtifactKind,
}

/// Finds the folder of an artifact that exists and is complete.
pub type FindArtifact<'a> = &'a dyn Fn(&Taken) -> Result<PathBuf, Error>;

/// Lookup for trials without a store: there is nothing to find.
///
/// # Errors
/// [`Error::Source`], always.
pub fn no_artifact(taken: &Taken) -> Result<PathBuf, Error> {
    Err(Error::Source {
        trial: taken.trial.clone(),
        problem: "there is no store to find it in".into(),
    })
}

/// The artifacts that a complete config names, by JSON pointer.
#[must_use]
pub fn named_in(config: &Value) -> BTreeMap<String, (ArtifactKind, Reference)> {
    let mut found = BTreeMap::new();
    walk(config, "", &mut found);
    found
}

fn walk(value: &Value, at: &str, found: &mut BTreeMap<String, (ArtifactKind, Reference)>) {
    let mut into = |key: &str, item: &Value| {
        // Most of a config is numbers and words, which cannot name artifacts.
        if item.is_object() || item.is_array() {
            let below = format!("{at}/{}", key.replace('~', "~0").replace('/', "~1"));
            walk(item, &below, found);
        }
    };
    match value {
        Value::Object(map) => match as_reference(value) {
            Some(named) => drop(found.insert(at.into(), named)),
            None => map.iter().for_each(|(key, item)| into(key, item)),
        },
        Value::Array(items) => items
            .iter()
            .enumerate()
            .for_each(|(index, item)| into(&index.to_string(), item)),
        _ => {}
    }
}

/// An artifact of a config that its plugin wrote: the plugin's type added the kind to the names.
fn as_reference(value: &Value) -> Option<(ArtifactKind, Reference)> {
    let kind = ArtifactKind::deserialize(value.get("product")?).ok()?;
    Some((kind, Reference::deserialize(value).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    struct Config {
        start: Option<Artifact<Networks>>,
        sets: Vec<Artifact<Dataset>>,
    }

    fn config(value: Value) -> Result<Config, String> {
        serde_json::from_value(value).map_err(|error| error.to_string())
    }

    #[test]
    fn a_config_says_what_it_takes_and_from_whom() {
        let read = config(
            json!({"start": {"from": "fresh", "seed": 0}, "sets": [{"from": "rules",
                "environment": "pack"}]}),
        )
        .unwrap();
        let complete = serde_json::to_value(&read).unwrap();
        assert_eq!(config(complete.clone()).unwrap(), read);
        let reference = |from: &str, environment: Option<&str>, seed| Reference {
            from: from.into(),
            environment: environment.map(Into::into),
            seed,
        };
        let expected = BTreeMap::from([
            (
                "/sets/0".to_string(),
                (ArtifactKind::Dataset, reference("rules", Some("pack"), None)),
            ),
            (
                "/start".to_string(),
                (ArtifactKind::Networks, reference("fresh", None, Some(0))),
            ),
        ]);
        assert_eq!(named_in(&complete), expected);
        assert!(read.start.unwrap().folder().is_err());
    }

    #[test]
    fn another_kind_and_unknown_keys_are_refused() {
        let message =
            config(json!({"start": {"from": "fresh", "product": "dataset"}, "sets": []})).unwrap_err();
        assert!(
            message.contains("a networks is taken here") || message.contains("networks"),
            "{message}"
        );
        assert!(config(json!({"start": {"form": "fresh"}, "sets": []})).is_err());
    }

    #[test]
    fn files_belong_to_one_kind() {
        let kinds = ArtifactKind::ALL;
        let paths = [
            "policy.safetensors",
            "policy.onnx",
            "policy.saved",
            "good_0/policy.safetensors",
            "networks.safetensors",
            "checkpoint/state.json",
            "checkpoint/agent/good_0/networks.safetensors",
            "checkpoint/policy.safetensors",
            "dataset/data/0/part-0.parquet",
            "choice.json",
            "graph.json",
            "images.png",
        ];
        for path in paths {
            assert_eq!(
                kinds.iter().filter(|kind| kind.has_file(path)).count(),
                1,
                "{path}"
            );
        }
        assert!(!kinds.iter().any(|kind| kind.has_file("trial.json")));
    }
}
