//! The config of an agent in Python.

use crate::{
    config::check_metric_name,
    making::{Code, MakeRequest, Maker, NamedFile},
};
use contract::{Error, Metric};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// Settings of the `python` agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AgentConfig {
    /// The class or function that makes the agent, as `FILE.py:CLASS`; the file lies beside the study.
    pub make: Maker,
    /// Arguments of the call by name. Instead of a value, `{ file: PATH }` passes the path of a file whose content
    /// enters the trial's id.
    pub arguments: BTreeMap<String, Value>,
    /// Whether the agent learns: protocols then train it with its `learn`. Otherwise it is a rule, which is only
    /// measured.
    pub learns: bool,
    /// Names of the numbers that `learn` returns, each recorded as the mean since the previous measurement.
    #[serde(skip_serializing_if = "BTreeSet::is_empty")]
    pub metrics: BTreeSet<String>,
    /// Other files of your own that it imports, each as the module with the file's name.
    pub sources: Vec<NamedFile>,
    /// The lock file of its packages, as `python3 -m pip freeze` writes it; the installed packages must match
    /// it.
    pub lock: Option<NamedFile>,
    /// The Python interpreter: a program on the path, or its location. Not part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub interpreter: String,
}

impl Default for AgentConfig {
    fn default() -> Self {
        Self {
            make: Maker::Word(String::new()),
            arguments: BTreeMap::new(),
            learns: false,
            metrics: BTreeSet::new(),
            sources: Vec::new(),
            lock: None,
            interpreter: "python3".into(),
        }
    }
}

impl contract::Config for AgentConfig {}

/// Whether the agent of a config learns, and the metrics that it records.
pub fn said_of(config: &Value) -> (bool, Vec<Metric>) {
    let names = config["metrics"].as_array().into_iter().flatten();
    let metric = |name: &str| Metric::new(name, "", "of `learn`");
    (
        config["learns"] == true,
        names.filter_map(Value::as_str).map(metric).collect(),
    )
}

impl AgentConfig {
    /// The request with which Python makes the agent; it holds the seats and the seed.
    ///
    /// # Errors
    /// [`Error::Config`] for a config without a maker or lock file, and for invalid names of metrics;
    /// [`Error::File`] where a file cannot be read.
    pub fn request(&self, seats: Value, seed: u32) -> Result<MakeRequest, Error> {
        let code = Code {
            make: self.make.of_agent()?,
            arguments: &self.arguments,
            sources: &self.sources,
            lock: self.lock.as_ref(),
            interpreter: &self.interpreter,
        };
        if !self.learns && !self.metrics.is_empty() {
            let problem = "are those that `learn` returns, and a rule has none: write `learns: true`, or leave them out";
            return Err(Error::config("metrics", problem));
        }
        self.metrics
            .iter()
            .try_for_each(|name| check_metric_name(name, "what `learn` returns"))?;
        let agent = json!({ "seats": seats, "seed": seed, "learns": self.learns, "metrics": self.metrics });
        code.request(json!({ "agent": agent }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(value: Value) -> AgentConfig {
        serde_json::from_value(value).unwrap()
    }

    fn refused(value: Value) -> String {
        config(value).request(json!([]), 0).unwrap_err().to_string()
    }

    #[test]
    fn a_config_says_whether_it_learns_and_what_it_records() {
        assert_eq!(said_of(&json!(AgentConfig::default())), (false, Vec::new()));
        let (learns, metrics) = said_of(&json!({ "learns": true, "metrics": ["loss", 3] }));
        assert!(learns && metrics.len() == 1 && metrics[0].name == "loss");
        assert!(json!(config(json!({}))).get("metrics").is_none());
    }

    #[test]
    fn configs_without_a_maker_or_with_invalid_metrics_are_refused() {
        assert!(refused(json!({})).contains("`make`: `` names nothing that makes an agent"));
        let own = std::env::temp_dir().join(format!("regimen-{}.py", std::process::id()));
        std::fs::write(&own, "class Rule: pass").unwrap();
        let with = |more: Value| {
            let mut value = json!({ "make": { "file": own, "call": "Rule" }, "lock": { "file": own } });
            value
                .as_object_mut()
                .unwrap()
                .extend(more.as_object().unwrap().clone());
            refused(value)
        };
        assert!(with(json!({ "lock": null })).contains("`lock`: names no file"));
        assert!(with(json!({ "metrics": ["loss"] })).contains("write `learns: true`"));
        let taken = with(json!({ "metrics": ["return"], "learns": true }));
        assert!(
            taken.contains("`return` is recorded of every environment"),
            "{taken}"
        );
        std::fs::remove_file(&own).unwrap();
    }
}
