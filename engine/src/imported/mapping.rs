//! How files of other programs are read, as a study says it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

/// Runs of another program in one environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImportedText {
    /// Files seen from the study's folder, or patterns of such in which `*` stands for any part of a name: CSV files, and
    /// TensorBoard's event files, whose names hold `tfevents`.
    pub from: Patterns,
    /// The environment of the study that the runs are of; the only one where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub environment: Option<String>,
    /// Metrics of the study, each with the column or tag that holds it, as in `{ return: charts/episodic_return }`.
    #[schemars(extend("minProperties" = 1))]
    pub metrics: BTreeMap<String, String>,
    /// The column with the step; event files have steps of their own.
    #[serde(default = "step")]
    pub step: String,
    /// The column with the seed. Without it runs are numbered in the order of their files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<String>,
    /// The column that tells the runs of one file apart, where that is not the seed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Lines that count: those with these values in these columns.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub only: BTreeMap<String, Value>,
    /// How many of a run's last values are averaged to what it came to in the end.
    #[serde(default = "one")]
    #[schemars(range(min = 1, max = 1_000_000))]
    pub last: u64,
    /// Whose runs they are, with version and address.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub about: String,
}

/// A pattern or a list of such.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Patterns {
    /// One.
    One(String),
    /// Several.
    Several(#[schemars(length(min = 1))] Vec<String>),
}

impl Patterns {
    /// All of them.
    #[must_use]
    pub fn all(&self) -> &[String] {
        match self {
            Self::One(pattern) => std::slice::from_ref(pattern),
            Self::Several(patterns) => patterns,
        }
    }
}

fn step() -> String {
    "step".into()
}

fn one() -> u64 {
    1
}

/// What of an entry decides how its files are read.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mapping {
    /// Columns or tags by metric.
    pub metrics: BTreeMap<String, String>,
    /// The column with the step.
    pub step: String,
    /// The column with the seed.
    pub seed: Option<String>,
    /// The column that tells runs apart.
    pub run: Option<String>,
    /// Values that lines must have, as text.
    pub only: BTreeMap<String, String>,
    /// How many of the last values make the final one.
    pub last: u64,
}

impl Default for Mapping {
    fn default() -> Self {
        Self {
            metrics: BTreeMap::new(),
            step: step(),
            seed: None,
            run: None,
            only: BTreeMap::new(),
            last: one(),
        }
    }
}

impl ImportedText {
    /// How its files are read.
    #[must_use]
    pub fn mapping(&self) -> Mapping {
        let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        Mapping {
            metrics: self.metrics.clone(),
            step: self.step.clone(),
            seed: self.seed.clone(),
            run: self.run.clone(),
            only: self
                .only
                .iter()
                .map(|(column, value)| (column.clone(), text(value)))
                .collect(),
            last: self.last,
        }
    }
}
