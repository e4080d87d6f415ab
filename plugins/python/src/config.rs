//! What a study says of an environment in Python.

use engine::{DataFile, Error, Metric, PerEpisode};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{borrow::Cow, collections::BTreeMap};

/// Settings of the `python` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PythonConfig {
    /// What makes the environment: `gymnasium:ID`; `pettingzoo:MODULE`, whose `parallel_env` is called; or
    /// `FILE.py:FUNCTION`, a file beside the study and what is called in it.
    pub make: Make,
    /// Arguments by name for what makes it. In place of a value, `{ file: PATH }` passes the path of a file whose
    /// content enters the trial's id.
    pub arguments: BTreeMap<String, Value>,
    /// Entries of `info` that are recorded as metrics, by name, with how the steps of an episode become one value:
    /// `sum`, `mean`, `last`, `max` or `min`; or as `{ take: sum, lower_is_better: true, unit: m3 }`. Of several agents
    /// each has its own, as `AGENT_NAME`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, InfoMetric>,
    /// Other files of your own that it imports, each as the module with the file's name.
    pub sources: Vec<NamedFile>,
    /// The lock file of its packages, as `python3 -m pip freeze` writes one: what is installed must be what it says.
    pub lock: Option<NamedFile>,
    /// The Python that runs it: a program on the path, or its place. No part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub interpreter: String,
}

impl Default for PythonConfig {
    fn default() -> Self {
        Self {
            make: Make::Word(String::new()),
            arguments: BTreeMap::new(),
            metrics: BTreeMap::new(),
            sources: Vec::new(),
            lock: None,
            interpreter: "python3".into(),
        }
    }
}

impl engine::Config for PythonConfig {}

/// A file by its path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedFile {
    /// The file, as seen from the study.
    pub file: DataFile,
}

/// How an entry of `info` becomes a metric.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "`sum`, `mean`, `last`, `max` or `min`, or `{ take: .. }` with one of these"
)]
pub enum InfoMetric {
    /// How steps become an episode, alone.
    Taken(Take),
    /// With more that is said of it.
    Said(SaidMetric),
}

/// A metric with its unit and its better direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SaidMetric {
    /// How steps become an episode.
    pub take: Take,
    /// Whether less is better.
    #[serde(default)]
    pub lower_is_better: bool,
    /// SI unit; empty where there is none.
    #[serde(default)]
    pub unit: String,
}

/// How the steps of an episode become one value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Take {
    /// Their sum.
    Sum,
    /// Their mean.
    Mean,
    /// The value of the last step; those before need not have one.
    Last,
    /// The largest.
    Max,
    /// The smallest.
    Min,
}

impl InfoMetric {
    /// How steps become an episode.
    fn take(&self) -> Take {
        match self {
            Self::Taken(take) | Self::Said(SaidMetric { take, .. }) => *take,
        }
    }

    /// As tables and figures know it.
    pub fn named(&self, name: &str) -> Metric {
        let per_episode = match self.take() {
            Take::Sum => PerEpisode::Sum,
            Take::Mean => PerEpisode::Mean,
            Take::Last => PerEpisode::Last,
            Take::Max => PerEpisode::Max,
            Take::Min => PerEpisode::Min,
        };
        let (unit, lower) = match self {
            Self::Taken(_) => ("", false),
            Self::Said(said) => (said.unit.as_str(), said.lower_is_better),
        };
        let metric = Metric::new(name, unit, "of `info`").per_episode(per_episode);
        if lower { metric.lower_is_better() } else { metric }
    }
}

/// What makes an environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "Written", into = "Written")]
pub enum Make {
    /// `PACKAGE:NAME`, or what nobody knows.
    Word(String),
    /// A function of a person's own file.
    Own {
        /// The file.
        file: DataFile,
        /// The function in it.
        call: String,
    },
}

/// What stands in a config.
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "`PACKAGE:NAME`, or `FILE.py:FUNCTION`")]
enum Written {
    Word(String),
    Own { file: DataFile, call: String },
}

impl From<Written> for Make {
    fn from(written: Written) -> Self {
        match written {
            Written::Own { file, call } => Self::Own { file, call },
            Written::Word(word) => match word.rsplit_once(':') {
                Some((file, call)) if file.ends_with(".py") => Self::Own {
                    file: DataFile::new(file),
                    call: call.into(),
                },
                _ => Self::Word(word),
            },
        }
    }
}

impl From<Make> for Written {
    fn from(make: Make) -> Self {
        match make {
            Make::Word(word) => Self::Word(word),
            Make::Own { file, call } => Self::Own { file, call },
        }
    }
}

impl JsonSchema for Make {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "Make".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "anyOf": [
                { "type": "string" },
                {
                    "type": "object", "additionalProperties": false, "required": ["file", "call"],
                    "properties": {
                        "file": { "type": "string", "description": "A file of your own, as seen from the study." },
                        "call": { "type": "string", "description": "What is called in it to make an environment." },
                    },
                },
            ],
        })
    }
}

/// What Python is told.
#[derive(Debug, Clone)]
pub struct Told {
    /// With the texts of files of its own, and the paths of others.
    pub asked: Value,
    /// The files among the arguments, by where in `asked` their paths stand: Python gets copies of its own.
    pub files: Vec<(String, DataFile)>,
}

impl Told {
    /// What tells it from others: what is told, and what the files hold.
    ///
    /// # Errors
    /// [`Error::File`] where one cannot be read.
    pub fn key(&self) -> Result<String, Error> {
        let digests = self.files.iter().map(|(_, file)| Ok(file.digest()?.into_owned()));
        let digests = digests.collect::<Result<Vec<String>, Error>>()?;
        Ok(json!([self.asked, digests]).to_string())
    }
}

impl PythonConfig {
    /// What Python is told.
    ///
    /// # Errors
    /// [`Error::Config`] for a config that names nothing to make or no lock file, and for a metric with a name of
    /// another one; [`Error::File`] where a file cannot be read.
    pub fn told(&self) -> Result<Told, Error> {
        let make = self.make.told()?;
        let lock = self.lock.as_ref().ok_or_else(|| self.without_lock())?;
        let sources = self.sources.iter().map(|source| text_of(&source.file));
        self.metrics.keys().try_for_each(|name| of_ones_own(name))?;
        let takes: BTreeMap<&String, Take> = self
            .metrics
            .iter()
            .map(|(name, metric)| (name, metric.take()))
            .collect();
        let mut files = Vec::new();
        let arguments = passed(&json!(self.arguments), "/arguments", &mut files);
        let asked = json!({
            "make": make,
            "arguments": arguments,
            "metrics": takes,
            "sources": sources.collect::<Result<Vec<_>, _>>()?,
            "lock": text_of(&lock.file)?,
            "interpreter": self.interpreter,
        });
        Ok(Told { asked, files })
    }

    fn without_lock(&self) -> Error {
        let interpreter = &self.interpreter;
        Error::config(
            "lock",
            format!(
                "names no file, so that nothing says which packages compute the numbers: write one by `{interpreter} \
                 -m pip freeze > requirements.txt`, and `lock: {{ file: requirements.txt }}`"
            ),
        )
    }
}

impl Make {
    fn told(&self) -> Result<Value, Error> {
        match self {
            Self::Own { file, call } => Ok(json!({ "file": text_of(file)?, "call": call })),
            Self::Word(word) => match word.split_once(':') {
                Some((package @ ("gymnasium" | "pettingzoo"), name)) if !name.is_empty() => {
                    Ok(json!({ "package": package, "name": name }))
                }
                _ => Err(Error::config(
                    "make",
                    format!(
                        "`{word}` names nothing that makes an environment: write `gymnasium:ID`, as \
                         `gymnasium:Pendulum-v1`, `pettingzoo:MODULE`, or `FILE.py:FUNCTION` with a file of your own"
                    ),
                )),
            },
        }
    }

    /// What it makes, in words.
    pub fn in_words(&self) -> String {
        match self {
            Self::Word(word) => word.clone(),
            Self::Own { file, call } => format!("{}:{call}", file.path().display()),
        }
    }
}

fn text_of(file: &DataFile) -> Result<Value, Error> {
    Ok(json!({ "path": file.path(), "text": file.text()? }))
}

/// An argument as Python gets it: a file by its path, which is noted with its place.
fn passed(argument: &Value, place: &str, files: &mut Vec<(String, DataFile)>) -> Value {
    let named = argument.as_object().filter(|map| map.len() == 1);
    let file = named.and_then(|map| DataFile::deserialize(map.get("file")?).ok());
    let escaped = |key: &str| key.replace('~', "~0").replace('/', "~1");
    match (file, argument) {
        (Some(file), _) => {
            let path = json!(file.path());
            files.push((place.into(), file));
            path
        }
        (None, Value::Object(map)) => {
            let each = map.iter().map(|(key, value)| {
                let below = format!("{place}/{}", escaped(key));
                (key.clone(), passed(value, &below, files))
            });
            Value::Object(each.collect())
        }
        (None, Value::Array(items)) => {
            let each = items.iter().enumerate();
            each.map(|(at, value)| passed(value, &format!("{place}/{at}"), files))
                .collect()
        }
        (None, other) => other.clone(),
    }
}

/// Refuses names that claims cannot say, and those of what is recorded anyhow.
fn of_ones_own(name: &str) -> Result<(), Error> {
    let problem = if ["return", "episode_length", "success"].contains(&name) {
        Some("is recorded of every environment; take an entry of `info` with another name")
    } else {
        Metric::name_problem(name)
    };
    let refusal = |problem| Error::config("metrics", format!("`{name}` {problem}"));
    problem.map_or(Ok(()), |problem| Err(refusal(problem)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(value: Value) -> PythonConfig {
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn a_file_of_ones_own_is_written_as_a_file_so_that_its_content_enters_the_id() {
        let own = config(json!({ "make": "envs/tank.py:make" }));
        assert_eq!(
            json!(own)["make"],
            json!({ "file": "envs/tank.py", "call": "make" })
        );
        assert_eq!(config(json!(own)), own);
        let package = config(json!({ "make": "gymnasium:ale_py:ALE/Pong-v5" }));
        assert_eq!(json!(package)["make"], "gymnasium:ale_py:ALE/Pong-v5");
        let told = package.make.told().unwrap();
        assert_eq!(
            told,
            json!({ "package": "gymnasium", "name": "ale_py:ALE/Pong-v5" })
        );
    }

    #[test]
    fn what_makes_nothing_and_what_has_no_lock_file_is_refused() {
        for word in ["", "gymnasium:", "gym:CartPole-v1", "tank.py", "make"] {
            let problem = config(json!({ "make": word })).told().unwrap_err().to_string();
            assert!(
                problem.contains(&format!("`make`: `{word}` names nothing")),
                "{problem}"
            );
        }
        let problem = config(json!({ "make": "gymnasium:CartPole-v1" }))
            .told()
            .unwrap_err();
        assert!(problem.to_string().contains("`lock`: names no file"), "{problem}");
    }

    #[test]
    fn files_among_arguments_are_passed_by_their_paths() {
        let argument =
            json!({ "table": { "file": "a.csv" }, "m/n": [{ "file": { "path": "b", "content": "1" } }] });
        let mut files = Vec::new();
        let found = passed(&argument, "", &mut files);
        assert_eq!(found, json!({ "table": "a.csv", "m/n": ["b"] }));
        for (place, file) in &files {
            assert_eq!(found.pointer(place), Some(&json!(file.path())));
        }
        assert_eq!(files.len(), 2);
        assert_eq!(
            passed(&json!({ "file": 3 }), "", &mut files),
            json!({ "file": 3 })
        );
    }

    #[test]
    fn metrics_have_names_of_their_own_and_stand_in_no_config_without_them() {
        let with = |metrics: Value| config(json!({ "make": "gymnasium:A-v1", "metrics": metrics }));
        let metric = |form: Value| with(json!({ "cost": form })).metrics["cost"].named("cost");
        assert_eq!(metric(json!("max")).per_episode, PerEpisode::Max);
        let said = metric(json!({ "take": "mean", "lower_is_better": true, "unit": "m" }));
        assert_eq!((said.unit.as_str(), said.better), ("m", engine::Better::Lower));
        for (name, why) in [
            ("return", "every environment"),
            ("a b", "no name"),
            ("", "no name"),
        ] {
            let mut config = with(json!({ name: "sum" }));
            config.lock = Some(NamedFile {
                file: DataFile::new("x"),
            });
            let problem = config.told().unwrap_err().to_string();
            assert!(
                problem.contains("`metrics`") && problem.contains(why),
                "{problem}"
            );
        }
        assert!(json!(config(json!({}))).get("metrics").is_none());
    }
}
