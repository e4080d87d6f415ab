//! What a study says of an environment in Python.

use crate::making::{Code, Make, NamedFile, Told};
use contract::{Error, Metric, PerEpisode};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;

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

impl contract::Config for PythonConfig {}

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

impl PythonConfig {
    /// What Python is told.
    ///
    /// # Errors
    /// [`Error::Config`] for a config that names nothing to make or no lock file, and for a metric with a name of
    /// another one; [`Error::File`] where a file cannot be read.
    pub fn told(&self) -> Result<Told, Error> {
        let code = Code {
            make: self.make.of_environment()?,
            arguments: &self.arguments,
            sources: &self.sources,
            lock: self.lock.as_ref(),
            interpreter: &self.interpreter,
        };
        self.metrics
            .keys()
            .try_for_each(|name| of_ones_own(name, "an entry of `info`"))?;
        let takes: BTreeMap<&String, Take> = self
            .metrics
            .iter()
            .map(|(name, metric)| (name, metric.take()))
            .collect();
        code.told(json!({ "metrics": takes }))
    }
}

/// Refuses names that claims cannot say, and those of what is recorded anyhow; `what` is what has the name.
///
/// # Errors
/// [`Error::Config`] at `metrics`.
pub fn of_ones_own(name: &str, what: &str) -> Result<(), Error> {
    let problem = if ["return", "episode_length", "success"].contains(&name) {
        Some(format!(
            "is recorded of every environment; take {what} with another name"
        ))
    } else {
        Metric::name_problem(name).map(str::to_owned)
    };
    let refusal = |problem: String| Error::config("metrics", format!("`{name}` {problem}"));
    problem.map_or(Ok(()), |problem| Err(refusal(problem)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::DataFile;

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
        let told = package.make.of_environment().unwrap();
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
    fn metrics_have_names_of_their_own_and_stand_in_no_config_without_them() {
        let with = |metrics: Value| config(json!({ "make": "gymnasium:A-v1", "metrics": metrics }));
        let metric = |form: Value| with(json!({ "cost": form })).metrics["cost"].named("cost");
        assert_eq!(metric(json!("max")).per_episode, PerEpisode::Max);
        let said = metric(json!({ "take": "mean", "lower_is_better": true, "unit": "m" }));
        assert_eq!((said.unit.as_str(), said.better), ("m", contract::Better::Lower));
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
