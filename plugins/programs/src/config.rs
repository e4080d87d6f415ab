//! The keys of a program in a study.

use contract::{DataFile, Metric, own_training::Measured, resources::Needs};
use execution::guard::StopSignal;
use imported::{Step, SumOf};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{borrow::Cow, collections::BTreeMap};

/// Settings of the `program` agent.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ProgramConfig {
    /// The program and its arguments, as a list that no shell reads. `{seed}`, `{steps}`, `{evaluate_every}`,
    /// `{environment.KEY}`, `{input.NAME}`, `{checkpoint}`, `{folder}`, `{parameters}` (the path of a JSON file
    /// with all of them) and the name of each parameter in braces are replaced; `{{` is a brace.
    pub run: Vec<String>,
    /// Parameters of the program by name, written as `{NAME}` in `run`. They are swept and searched as keys of
    /// the agent.
    #[schemars(extend("x-own-keys" = true))]
    pub parameters: BTreeMap<String, Value>,
    /// Files of the program, relative to the study's folder: a list of names and patterns in which `*` stands
    /// for any part of a name and `**` for folders of any depth; or `{ NAME: { file: PATH } }` with the name of
    /// each in the working folder. No other files lie there. Patterns enter no hidden folder, store, folder of results,
    /// virtual environment or `__pycache__`.
    #[schemars(extend("x-patterns" = true))]
    pub sources: Sources,
    /// The lock file of the program's packages, such as `uv.lock`, `requirements.txt` or `Cargo.lock`; `none`
    /// for a program without packages.
    pub lock: Option<Lock>,
    /// Other files that the program reads, by name: `{input.NAME}` is the path of a copy.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub inputs: BTreeMap<String, NamedFile>,
    /// Environment variables of the program.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub variables: BTreeMap<String, String>,
    /// Source of the metrics without a `from` of their own.
    pub reads: MetricSource,
    /// Metrics by name: each with its key or column, or as `{ key: .., from: .., step: .., last: .. }`.
    pub metrics: BTreeMap<String, MetricText>,
    /// Files that the program leaves for other trials, by patterns in the working folder.
    #[serde(skip_serializing_if = "LeftFiles::is_empty")]
    pub leaves: LeftFiles,
    /// Way in which the engine measures the program, on the episodes of the other agents: by `calls` of `trial.measure`
    /// while it runs, or by the `policy` that it `leaves`. Absent if the program reports all its numbers itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured: Option<Measured>,
    /// Words that are added to `run` where the program continues from `{checkpoint}`. Without them it begins
    /// anew after every interruption.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub resume: Vec<String>,
    /// Units and better directions of metrics, by name. Not part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub shown: BTreeMap<String, MetricDisplay>,
    /// Signal and time to end the program. Not part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub stop: StopRequest,
    /// Names of the machine's environment variables that the program gets too. Not part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub inherit: Vec<String>,
    /// The cores and graphics cards of a trial: `{ cores: 2, gpus: 1 }`. Not part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    #[serde(skip_serializing_if = "is_usual")]
    pub needs: Needs,
    /// The program that replaces the first word: one on the path, or a location such as `.venv/bin/python`; empty for
    /// the first word itself. Not part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub interpreter: String,
}

impl contract::Config for ProgramConfig {}

/// A file by its path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedFile {
    /// Path of the file, relative to the study.
    pub file: DataFile,
}

/// Files of a program by their names in the working folder.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Sources(pub BTreeMap<String, NamedFile>);

impl JsonSchema for Sources {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "Sources".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "anyOf": [
                { "type": "array", "items": { "type": "string" } },
                {
                    "type": "object",
                    "additionalProperties": {
                        "type": "object", "additionalProperties": false, "required": ["file"],
                        "properties": {
                            "file": { "type": "string", "description": "The file, as seen from the study." },
                        },
                    },
                },
            ],
        })
    }
}

/// The lock file of a program's packages.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "`none`, or `{ file: PATH }`")]
pub enum Lock {
    /// The program has no packages.
    Without(NoLock),
    /// The lock file.
    File(NamedFile),
}

/// The word for a program without a lock file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoLock {
    /// No lock file.
    None,
}

/// Source of metrics, with that of their steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MetricSource {
    /// `stdout` or `stderr`, whose lines are JSON objects or words `KEY=VALUE`; `log`, the file of JSON objects
    /// that the variable `REGIMEN_LOG` names and `trial.log` writes; or a file or a pattern of files in the
    /// working folder: tables as CSV, Parquet or JSON, and TensorBoard's event files.
    pub from: String,
    /// The key or column of the step, or `{ sum: COLUMN }`. Absent: `step`; lines of output without a step are
    /// numbered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<StepText>,
}

impl Default for MetricSource {
    fn default() -> Self {
        Self {
            from: "stdout".into(),
            step: None,
        }
    }
}

/// Source of the steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "the name of a column, or `{ sum: COLUMN }`")]
pub enum StepText {
    /// A column that holds the step.
    Column(String),
    /// The running sum of a column.
    Sum(SumOf),
}

impl StepText {
    /// The step in the form that readers of files take.
    pub fn step(&self) -> Step {
        match self {
            Self::Column(column) => Step::Column(column.clone()),
            Self::Sum(of) => Step::Sum(of.clone()),
        }
    }
}

/// Source of a metric.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "a key, or `{ key: .., from: .., step: .., last: .. }`")]
pub enum MetricText {
    /// Key, column or tag.
    Key(String),
    /// Key with a source or a mean of its own.
    Detailed(MetricDetails),
}

/// A metric with a source of its own, or averaged over several values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MetricDetails {
    /// Key, column or tag; names of nested objects are joined by `/`.
    pub key: String,
    /// Like `from` of `reads`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
    /// Like `step` of `reads`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<StepText>,
    /// Number of last values that are averaged to the measurement at a step.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    #[schemars(range(min = 1, max = 1_000_000))]
    pub last: u64,
}

fn one() -> u64 {
    1
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_one(last: &u64) -> bool {
    *last == one()
}

fn is_usual(needs: &Needs) -> bool {
    *needs == Needs::default()
}

/// Unit and direction of a metric.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MetricDisplay {
    /// SI unit; empty for a number without one.
    pub unit: String,
    /// Whether lower values are better.
    pub lower_is_better: bool,
}

/// The artifacts of a program.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LeftFiles {
    /// The program's policy: one ONNX file from an observation to an action, as `"*.onnx"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub policy: Option<String>,
}

impl LeftFiles {
    fn is_empty(&self) -> bool {
        self.policy.is_none()
    }
}

/// Signal to end a program, and its time to end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StopRequest {
    /// The signal: `term`, or `usr1` for programs that save their state at it and leave.
    pub signal: StopSignal,
    /// Time that the program has to end before it is killed.
    #[schemars(range(min = 0.0, max = 3600.0), extend("x-unit" = "s"))]
    pub grace_s: f64,
}

impl Default for StopRequest {
    fn default() -> Self {
        Self {
            signal: StopSignal::Term,
            grace_s: 10.0,
        }
    }
}

/// Source of a metric, with the defaults of `reads` filled in.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Name of the metric.
    pub name: String,
    /// Key, column or tag.
    pub key: String,
    /// `stdout`, `stderr`, `log`, or a pattern.
    pub from: String,
    /// Source of the steps, if the study names one.
    pub step: Option<StepText>,
    /// Number of last values that are averaged.
    pub last: u64,
}

impl ProgramConfig {
    /// Sources of all metrics, ordered by name.
    pub fn readings(&self) -> Vec<Reading> {
        let reading = |(name, text): (&String, &MetricText)| {
            let said = match text {
                MetricText::Key(key) => MetricDetails {
                    key: key.clone(),
                    from: None,
                    step: None,
                    last: one(),
                },
                MetricText::Detailed(said) => said.clone(),
            };
            Reading {
                name: name.clone(),
                key: said.key,
                from: said.from.unwrap_or_else(|| self.reads.from.clone()),
                step: said.step.or_else(|| self.reads.step.clone()),
                last: said.last,
            }
        };
        self.metrics.iter().map(reading).collect()
    }

    /// The metric in the form that tables and figures use.
    pub fn metric(&self, name: &str) -> Metric {
        let shown = self.shown.get(name).cloned().unwrap_or_default();
        let metric = Metric::new(name, &shown.unit, "as the program says it");
        if shown.lower_is_better {
            metric.lower_is_better()
        } else {
            metric
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use serde_json::json;

    pub(crate) fn config(value: Value) -> ProgramConfig {
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn a_metric_has_what_all_have_in_common_unless_it_says_more() {
        let config = config(json!({
            "reads": { "from": "log.csv", "step": "t" },
            "metrics": { "a": "x", "b": { "key": "y", "from": "stdout", "step": { "sum": "l" }, "last": 3 } },
            "shown": { "b": { "unit": "m", "lower_is_better": true } },
        }));
        let [a, b] = &config.readings()[..] else { panic!() };
        assert_eq!((a.from.as_str(), a.last), ("log.csv", 1));
        assert_eq!(a.step, Some(StepText::Column("t".into())));
        assert_eq!((b.from.as_str(), b.key.as_str(), b.last), ("stdout", "y", 3));
        assert_eq!(b.step.as_ref().map(StepText::step), Some(Step::sum_of("l")));
        assert_eq!(config.metric("b").unit, "m");
    }

    /// Words with one meaning must not have two ids.
    #[test]
    fn a_config_is_written_as_it_is_read() {
        let written = json!({
            "run": ["sh"], "parameters": { "lr": 0.1 }, "sources": {}, "lock": "none", "reads": { "from": "stdout" },
            "metrics": { "a": "x" }, "shown": {}, "stop": { "signal": "term", "grace_s": 10.0 }, "inherit": [],
            "interpreter": "",
        });
        assert_eq!(json!(config(written.clone())), written);
    }
}
