//! The config of an environment in Python.

use crate::making::{Code, MakeRequest, Maker, NamedFile};
use contract::{Error, Metric, PerEpisode};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Settings of the `python` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PythonConfig {
    /// The maker of the environment: `gymnasium:ID`; `pettingzoo:MODULE`, whose `parallel_env` is called; or
    /// `FILE.py:FUNCTION`, a file beside the study and the function in it that is called.
    pub make: Maker,
    /// Arguments of the call by name. Instead of a value, `{ file: PATH }` passes the path of a file whose content
    /// enters the trial's id.
    pub arguments: BTreeMap<String, Value>,
    /// Entries of `info` that are recorded as metrics, by name. The value is the reduction of an episode's steps to one
    /// number: `sum`, `mean`, `last`, `max` or `min`; or it is written as `{ take: sum, lower_is_better: true, unit: m3
    /// }`. With several agents, each has its own metric, as `AGENT_NAME`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, InfoMetric>,
    /// Other files of your own that it imports, each as the module with the file's name.
    pub sources: Vec<NamedFile>,
    /// The lock file of its packages, as `python3 -m pip freeze` writes it; the installed packages must match
    /// it.
    pub lock: Option<NamedFile>,
    /// The Python interpreter: a program on the path, or its location. Not part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub interpreter: String,
}

impl Default for PythonConfig {
    fn default() -> Self {
        Self {
            make: Maker::Word(String::new()),
            arguments: BTreeMap::new(),
            metrics: BTreeMap::new(),
            sources: Vec::new(),
            lock: None,
            interpreter: "python3".into(),
        }
    }
}

impl contract::Config for PythonConfig {}

/// The metric of an entry of `info`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "`sum`, `mean`, `last`, `max` or `min`, or `{ take: .. }` with one of these"
)]
pub enum InfoMetric {
    /// The reduction over an episode's steps alone.
    Reduction(EpisodeReduction),
    /// The reduction with unit and direction.
    Detailed(MetricDetails),
}

/// A metric with its unit and its better direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MetricDetails {
    /// Reduction of an episode's steps to one number.
    pub take: EpisodeReduction,
    /// Whether lower values are better.
    #[serde(default)]
    pub lower_is_better: bool,
    /// SI unit; empty for a number without one.
    #[serde(default)]
    pub unit: String,
}

/// Reduction of an episode's steps to one value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EpisodeReduction {
    /// The sum over all steps.
    Sum,
    /// The mean over all steps.
    Mean,
    /// The value of the last step; earlier steps need not have one.
    Last,
    /// The largest value.
    Max,
    /// The smallest value.
    Min,
}

impl InfoMetric {
    /// Reduction over the steps of an episode.
    fn take(&self) -> EpisodeReduction {
        match self {
            Self::Reduction(take) | Self::Detailed(MetricDetails { take, .. }) => *take,
        }
    }

    /// The metric in the form that tables and figures use.
    pub fn named(&self, name: &str) -> Metric {
        let per_episode = match self.take() {
            EpisodeReduction::Sum => PerEpisode::Sum,
            EpisodeReduction::Mean => PerEpisode::Mean,
            EpisodeReduction::Last => PerEpisode::Last,
            EpisodeReduction::Max => PerEpisode::Max,
            EpisodeReduction::Min => PerEpisode::Min,
        };
        let (unit, lower) = match self {
            Self::Reduction(_) => ("", false),
            Self::Detailed(said) => (said.unit.as_str(), said.lower_is_better),
        };
        let metric = Metric::new(name, unit, "of `info`").per_episode(per_episode);
        if lower { metric.lower_is_better() } else { metric }
    }
}

impl PythonConfig {
    /// The request with which Python makes the environment.
    ///
    /// # Errors
    /// [`Error::Config`] for a config without a maker or lock file, and for a metric with a name that is taken;
    /// [`Error::File`] where a file cannot be read.
    pub fn request(&self) -> Result<MakeRequest, Error> {
        let code = Code {
            make: self.make.of_environment()?,
            arguments: &self.arguments,
            sources: &self.sources,
            lock: self.lock.as_ref(),
            interpreter: &self.interpreter,
        };
        self.metrics
            .keys()
            .try_for_each(|name| check_metric_name(name, "an entry of `info`"))?;
        let takes: BTreeMap<&String, EpisodeReduction> = self
            .metrics
            .iter()
            .map(|(name, metric)| (name, metric.take()))
            .collect();
        code.request(json!({ "metrics": takes }))
    }
}

/// Refuses names that claims cannot write and names of the engine's own metrics; `what` describes the owner of
/// the name.
///
/// # Errors
/// [`Error::Config`] at `metrics`.
pub fn check_metric_name(name: &str, what: &str) -> Result<(), Error> {
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
        let request = package.make.of_environment().unwrap();
        assert_eq!(
            request,
            json!({ "package": "gymnasium", "name": "ale_py:ALE/Pong-v5" })
        );
    }

    #[test]
    fn configs_without_a_maker_or_a_lock_file_are_refused() {
        for word in ["", "gymnasium:", "gym:CartPole-v1", "tank.py", "make"] {
            let problem = config(json!({ "make": word })).request().unwrap_err().to_string();
            assert!(
                problem.contains(&format!("`make`: `{word}` names nothing")),
                "{problem}"
            );
        }
        let problem = config(json!({ "make": "gymnasium:CartPole-v1" }))
            .request()
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
            let problem = config.request().unwrap_err().to_string();
            assert!(
                problem.contains("`metrics`") && problem.contains(why),
                "{problem}"
            );
        }
        assert!(json!(config(json!({}))).get("metrics").is_none());
    }
}
