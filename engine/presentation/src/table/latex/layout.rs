//! Options of a study for tables in LaTeX.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Typesetting of a table in LaTeX.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LatexLayout {
    /// Print the best value in bold, and with it every value whose interval overlaps that of the best one.
    pub bold_best: bool,
    /// Whether higher or lower values are better. `bold_best` needs it where the table does not know it, as with
    /// aggregates of normalised scores.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub better: Option<Direction>,
    /// Values among which the best one is sought; those of a row where rows are environments, else those of a column.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub best_of: Option<BestScope>,
    /// How a value and its interval are written.
    pub value: ValueForm,
    /// Print the verdicts on published values, and their rules.
    pub verdicts: bool,
    /// Align the decimal points of a column. It needs no package.
    pub align_decimals: bool,
    /// Handling of a table that is wider than the text.
    pub wide: WideTable,
    /// Width of the text in millimetres; 122 is that of `article` at 10 points.
    #[schemars(range(min = 40.0, max = 400.0))]
    pub text_width_mm: f64,
    /// Height of the text in millimetres, which limits the width of a turned table.
    #[schemars(range(min = 40.0, max = 600.0))]
    pub text_height_mm: f64,
}

impl Default for LatexLayout {
    fn default() -> Self {
        Self {
            bold_best: false,
            better: None,
            best_of: None,
            value: ValueForm::Brackets,
            verdicts: true,
            align_decimals: false,
            wide: WideTable::Split,
            text_width_mm: 122.0,
            text_height_mm: 193.0,
        }
    }
}

/// Better direction of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// More is better.
    Higher,
    /// Less is better.
    Lower,
}

/// Values that are compared with each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BestScope {
    /// Those of a row.
    Row,
    /// Those of a column.
    Column,
}

/// How a value and its interval are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ValueForm {
    /// The interval in brackets after the value.
    Brackets,
    /// The interval in brackets and small type after the value.
    SmallInterval,
    /// Half of the interval after ±; the larger half if the value is not in the middle.
    HalfWidth,
    /// The value without its interval.
    Alone,
}

/// Handling of a table that is wider than the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WideTable {
    /// Its columns are split over several tables below each other, each with the headings of the rows.
    Split,
    /// It is turned (`sidewaystable` of the package `rotating`), and split if it is wider than a page is high.
    Turn,
    /// It stays as wide as it is.
    Keep,
}
