//! The way to read files of other programs, as a study defines it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::PathBuf,
};

/// Runs of another program in one environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportedText {
    /// Files, relative to the study's folder, or patterns with `*` for any part of a name and `**` for folders of any
    /// depth: tables as CSV, Parquet or JSON, and TensorBoard's event files, each also packed by gzip.
    pub from: Patterns,
    /// The environment of the study to which the runs belong; the only one where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub environment: Option<String>,
    /// Metrics of the study, each with the column or tag that holds it, as in `{ return: charts/episodic_return }`. A
    /// list of columns, or a pattern with `*`, takes every column as a run.
    #[schemars(extend("minProperties" = 1))]
    pub metrics: BTreeMap<String, Patterns>,
    /// The column with the step, or `{ sum: COLUMN }` if steps are the running sum of a column, such as the lengths of
    /// episodes; event files have steps of their own.
    #[serde(default)]
    pub step: Step,
    /// The column with the seed. Without it, runs are numbered in the order of their files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<String>,
    /// The column that distinguishes the runs of one file, if it is not the seed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Whether each file is a run, or all files of a folder together are one. Where absent, a table is a run, and so is
    /// a folder of event files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run_per: Option<RunPer>,
    /// The meaning of steps that go back; where absent, such a log is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restart: Option<Restart>,
    /// The meaning of several values of a run at one step. Where absent, a table with such values is refused, and event
    /// files, which have one writer each, use the mean.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub same_step: Option<SameStep>,
    /// Parts to leave out: runs without a value, and values that are not finite; without an entry here they are
    /// refused.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub leave_out: BTreeSet<LeftOut>,
    /// Whether files with the same content count as separate runs; where absent, a copy is counted once.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub copies: Option<Copies>,
    /// Values of columns that a line must have to count.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub only: BTreeMap<String, Value>,
    /// Number of a run's last values that are averaged to its final value.
    #[serde(default = "one")]
    #[schemars(range(min = 1, max = 1_000_000))]
    pub last: u64,
    /// Origin of the runs, with version and address.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub about: String,
}

/// The source of the steps of a table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Step {
    /// Steps in a column.
    Column(String),
    /// Steps as the running sum of a column.
    Sum(SumOf),
}

/// Steps that are the running sum of a column.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SumOf {
    /// The column, such as `l`, the length of an episode, in logs of the Monitor of Stable-Baselines3.
    pub sum: String,
}

impl Default for Step {
    fn default() -> Self {
        Self::Column("step".into())
    }
}

impl Step {
    /// The running sum of a column.
    #[must_use]
    pub fn sum_of(column: &str) -> Self {
        Self::Sum(SumOf { sum: column.into() })
    }

    /// The column with the steps, or with their increments.
    #[must_use]
    pub fn column(&self) -> &str {
        match self {
            Self::Column(column) => column,
            Self::Sum(of) => &of.sum,
        }
    }
}

/// The files that form a run, if no column distinguishes runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum RunPer {
    /// Each file.
    File,
    /// All files of a folder together.
    Folder,
}

/// The meaning of steps that go back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum Restart {
    /// Another run begins.
    NewRun,
    /// The same run resumed from a checkpoint: values that were logged earlier, from that step on, are purged.
    Resume,
}

/// The meaning of several values of a run at one step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum SameStep {
    /// Their mean counts.
    Mean,
    /// The last one counts.
    Last,
}

/// The advice for a value that is infinite or not a number.
pub(super) const NOT_FINITE: &str = "write `leave_out: [not_finite]` where nothing was measured there";

/// Parts of files that are refused unless an entry leaves them out.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema, clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum LeftOut {
    /// Runs that lack a value of a metric.
    Empty,
    /// Values that are infinite or not a number.
    NotFinite,
}

/// The meaning of files with the same content.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum Copies {
    /// Each file counts, for example if several runs gave the same values.
    Count,
}

/// A pattern or a list of patterns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Patterns {
    /// One pattern.
    One(String),
    /// Several patterns.
    Several(#[schemars(length(min = 1))] Vec<String>),
}

impl From<&str> for Patterns {
    fn from(one: &str) -> Self {
        Self::One(one.into())
    }
}

impl From<Vec<String>> for Patterns {
    fn from(mut all: Vec<String>) -> Self {
        match all.as_slice() {
            [_] => Self::One(all.remove(0)),
            _ => Self::Several(all),
        }
    }
}

impl Patterns {
    /// All patterns, in the order of the study.
    #[must_use]
    pub fn all(&self) -> &[String] {
        match self {
            Self::One(pattern) => std::slice::from_ref(pattern),
            Self::Several(patterns) => patterns,
        }
    }
}

fn one() -> u64 {
    1
}

/// The keys of an entry that determine the reading of its files. Absent keys are left out, so that the ids of runs do
/// not depend on keys that were added later.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mapping {
    /// Columns or tags by metric.
    pub metrics: BTreeMap<String, Patterns>,
    /// Source of the steps.
    pub step: Step,
    /// Name of the column with the seed.
    pub seed: Option<String>,
    /// The column that distinguishes runs.
    pub run: Option<String>,
    /// The files that form a run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run_per: Option<RunPer>,
    /// The meaning of steps that go back.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restart: Option<Restart>,
    /// The meaning of several values at one step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub same_step: Option<SameStep>,
    /// Parts that are left out.
    #[serde(skip_serializing_if = "BTreeSet::is_empty")]
    pub leave_out: BTreeSet<LeftOut>,
    /// The meaning of files with the same content.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub copies: Option<Copies>,
    /// Values that lines must have, as text.
    pub only: BTreeMap<String, String>,
    /// Number of the last values that are averaged to the final one.
    pub last: u64,
    /// Whether the files are those of an own trial, which follow other rules: values that are not finite stay, and a
    /// metric may have no value yet.
    #[serde(skip)]
    pub is_own: bool,
    /// Line numbers at which an own trial resumed from a checkpoint, by file. Values after such a line replace earlier
    /// ones at the same and later steps.
    #[serde(skip)]
    pub begins: BTreeMap<PathBuf, BTreeSet<u64>>,
}

impl Default for Mapping {
    fn default() -> Self {
        Self {
            metrics: BTreeMap::new(),
            step: Step::default(),
            seed: None,
            run: None,
            run_per: None,
            restart: None,
            same_step: None,
            leave_out: BTreeSet::new(),
            copies: None,
            only: BTreeMap::new(),
            last: one(),
            is_own: false,
            begins: BTreeMap::new(),
        }
    }
}

impl Mapping {
    /// Whether this part is left out.
    #[must_use]
    pub fn leaves_out(&self, part: LeftOut) -> bool {
        self.leave_out.contains(&part)
    }
}

impl ImportedText {
    /// The way its files are read.
    #[must_use]
    pub fn mapping(&self) -> Mapping {
        let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let only = self
            .only
            .iter()
            .map(|(column, value)| (column.clone(), text(value)));
        Mapping {
            metrics: self.metrics.clone(),
            step: self.step.clone(),
            seed: self.seed.clone(),
            run: self.run.clone(),
            run_per: self.run_per,
            restart: self.restart,
            same_step: self.same_step,
            leave_out: self.leave_out.clone(),
            copies: self.copies,
            only: only.collect(),
            last: self.last,
            is_own: false,
            begins: BTreeMap::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// The mapping is part of the ids of runs, so keys that were added later must not change it.
    #[test]
    fn an_entry_without_the_newer_keys_is_identified_as_before() {
        let entry =
            json!({ "from": "a.csv", "metrics": { "return": "r" }, "seed": "seed", "only": { "lr": 0.5 } });
        let entry: ImportedText = serde_json::from_value(entry).unwrap();
        let identified = json!({
            "metrics": { "return": "r" }, "step": "step", "seed": "seed", "run": null, "only": { "lr": "0.5" }, "last": 1,
        });
        assert_eq!(serde_json::to_value(entry.mapping()).unwrap(), identified);
    }

    #[test]
    fn newer_keys_are_written_as_they_are_read() {
        let entry = json!({
            "from": ["a.csv", "b.csv"], "metrics": { "return": ["r", "s"] }, "step": { "sum": "l" }, "run_per": "folder",
            "restart": "new_run", "same_step": "mean", "leave_out": ["empty", "not_finite"], "copies": "count", "last": 1,
        });
        let read: ImportedText = serde_json::from_value(entry.clone()).unwrap();
        assert_eq!(serde_json::to_value(read).unwrap(), entry);
        let wrong = json!({ "from": "a.csv", "metrics": { "return": "r" }, "step": { "sums": "l" } });
        assert!(serde_json::from_value::<ImportedText>(wrong).is_err());
    }
}
