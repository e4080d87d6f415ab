//! Answers of a study: its findings beside printed items of the source or beside questions, one line each.
//!
//! The answer itself is computed: it follows from the verdicts on the claims and published values that the line
//! names.

use super::summary::{PlaceholderTarget, Summary};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A line as it is written.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AnswerText {
    /// The item of the source, such as `table 3.2`; absent for a question that no source prints.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub item: String,
    /// The source's statement there, as values or as text, or the question.
    pub printed: String,
    /// The finding, with placeholders as in `summary`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub here: String,
    /// Claims and published values that decide, as in `[claim 1, "table-3.2: four, learner"]`. A line that depends on
    /// nothing, such as that of a drawing, has no answer.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by: Vec<String>,
    /// Difference of the system from that of the source, such as `other engines`; absent where it is the same.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub system: String,
}

/// A line after the check against the study.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Answer {
    /// The line as the study file has it.
    pub text: AnswerText,
    /// The finding, with its placeholders parsed.
    pub here: Summary,
    /// The claims and values that decide the answer.
    pub by: Vec<PlaceholderTarget>,
}
