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
    /// The program and its arguments, as a list; no shell reads them. `{seed}`, `{steps}`, `{evaluate_every}`,
    /// `{environment.KEY}`, `{input.NAME}`, `{checkpoint}`, `{folder}`, `{parameters}` (the path of a JSON file
    /// with all of them) and the name of each parameter in braces are replaced; `{{` is a brace.
    pub run: Vec<String>,
    /// Parameters of the program by name, as `{NAME}` in its words. They are swept and searched as keys of the agent.
    #[schemars(extend("x-own-keys" = true))]
    pub parameters: BTreeMap<String, Value>,
    /// Its files, seen from the study's folder: a list of names and patterns in which `*` stands for any part of a name
    /// and `**` for folders of any depth; or `{ NAME: { file: PATH } }` with the name that each has in the
    /// working folder. Nothing else lies there.
    #[schemars(extend("x-patterns" = true))]
    pub sources: Sources,
    /// The lock file of its packages, as `uv.lock`, `requirements.txt` or `Cargo.lock`; `none` for a program that needs
    /// none.
    pub lock: Option<Lock>,
    /// Other files that it reads, by name: `{input.NAME}` is the path of a copy.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub inputs: BTreeMap<String, NamedFile>,
    /// Environment variables that it is given.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub variables: BTreeMap<String, String>,
    /// Where its metrics stand that say nothing else.
    pub reads: Reads,
    /// Its metrics by name: each with its key or column there, or as `{ key: .., from: .., step: .., last: .. }`.
    pub metrics: BTreeMap<String, MetricText>,
    /// The files that it leaves for others, by patterns in the working folder.
    #[serde(skip_serializing_if = "Leaves::is_empty")]
    pub leaves: Leaves,
    /// How the engine measures it, on the episodes of the other agents: by `calls` of `trial.measure` while it runs,
    /// or by the `policy` that it `leaves`. Absent where the program alone says its numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured: Option<Measured>,
    /// Words that are added where it goes on from what lies in `{checkpoint}`. Without them it begins anew after every
    /// interruption.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub resume: Vec<String>,
    /// Units and better directions of its metrics, by name. No part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub shown: BTreeMap<String, Shown>,
    /// How it is told to end. No part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub stop: Stop,
    /// Names of environment variables of the machine that it is given besides. No part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub inherit: Vec<String>,
    /// The cores and graphics cards of a trial: `{ cores: 2, gpus: 1 }`. No part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    #[serde(skip_serializing_if = "is_usual")]
    pub needs: Needs,
    /// The program that runs in the place of the first word: one on the path, or its place, as
    /// `.venv/bin/python`; empty for the first word itself. No part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub interpreter: String,
}

impl contract::Config for ProgramConfig {}

/// A file by its path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedFile {
    /// The file, as seen from the study.
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

/// The lock file of the packages of a program.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "`none`, or `{ file: PATH }`")]
pub enum Lock {
    /// Nothing does.
    Without(NoLock),
    /// A lock file.
    File(NamedFile),
}

/// The word for a program without a lock file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum NoLock {
    /// There is none.
    None,
}

/// Where metrics stand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Reads {
    /// `stdout` or `stderr`, whose lines are JSON objects or words `KEY=VALUE`; `log`, the file of JSON objects that
    /// the variable `REGIMEN_LOG` names and `trial.log` writes; or a file in the working folder or a pattern of such:
    /// tables as CSV, Parquet or JSON, and TensorBoard's event files.
    pub from: String,
    /// The key or column with the step, or `{ sum: COLUMN }`. Absent: `step`; lines of output without it are numbered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<StepText>,
}

impl Default for Reads {
    fn default() -> Self {
        Self {
            from: "stdout".into(),
            step: None,
        }
    }
}

/// Where steps stand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "the name of a column, or `{ sum: COLUMN }`")]
pub enum StepText {
    /// In a column.
    Column(String),
    /// They are the running sum of a column.
    Sum(SumOf),
}

impl StepText {
    /// As files are read by it.
    pub fn step(&self) -> Step {
        match self {
            Self::Column(column) => Step::Column(column.clone()),
            Self::Sum(of) => Step::Sum(of.clone()),
        }
    }
}

/// Where a metric stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "a key, or `{ key: .., from: .., step: .., last: .. }`")]
pub enum MetricText {
    /// Its key, column or tag.
    Key(String),
    /// With more that is said of it.
    Said(SaidMetric),
}

/// A metric that stands elsewhere, or of which several values count.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SaidMetric {
    /// Its key, column or tag; names of nested objects are joined by `/`.
    pub key: String,
    /// As `from` of `reads`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
    /// As `step` of `reads`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<StepText>,
    /// How many of the last values are averaged to what is measured at a step.
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

/// How a metric is shown.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Shown {
    /// SI unit; empty where there is none.
    pub unit: String,
    /// Whether less is better.
    pub lower_is_better: bool,
}

/// The artifacts of a program.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Leaves {
    /// Its policy: one ONNX file from an observation to an action, as `"*.onnx"`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub policy: Option<String>,
}

impl Leaves {
    fn is_empty(&self) -> bool {
        self.policy.is_none()
    }
}

/// How a program is told to end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Stop {
    /// The signal: `term`, or `usr1` for programs that save their state at it and leave.
    pub signal: StopSignal,
    /// How long it may take to leave, before it is ended.
    #[schemars(range(min = 0.0, max = 3600.0), extend("x-unit" = "s"))]
    pub grace_s: f64,
}

impl Default for Stop {
    fn default() -> Self {
        Self {
            signal: StopSignal::Term,
            grace_s: 10.0,
        }
    }
}

/// Where a metric stands, with what all have in common.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Its name.
    pub name: String,
    /// Its key, column or tag.
    pub key: String,
    /// `stdout`, `stderr`, `log`, or a pattern.
    pub from: String,
    /// Where steps stand, if the study says so.
    pub step: Option<StepText>,
    /// How many values count.
    pub last: u64,
}

impl ProgramConfig {
    /// Where each metric stands, in the order of their names.
    pub fn readings(&self) -> Vec<Reading> {
        let reading = |(name, text): (&String, &MetricText)| {
            let said = match text {
                MetricText::Key(key) => SaidMetric {
                    key: key.clone(),
                    from: None,
                    step: None,
                    last: one(),
                },
                MetricText::Said(said) => said.clone(),
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

    /// A metric as tables and figures know it.
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

    /// The words that say the same must not have two ids.
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
