//! Causes of values that differ from the published ones, as the study states them.

use super::Grid;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::Verdict;
use std::collections::BTreeMap;

/// Attempts to find out why values differ: of the whole table, or of each row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Cause {
    /// One paragraph about all values that differ.
    OfAll(String),
    /// A paragraph about each row with such values, by its name.
    ByRow(BTreeMap<String, String>),
}

impl Cause {
    /// The paragraph about a row; `None` if the study has none for it.
    #[must_use]
    pub fn of(&self, row: &str) -> Option<&str> {
        let text = match self {
            Cause::OfAll(text) => text,
            Cause::ByRow(rows) => rows.get(row)?,
        };
        Some(text.trim()).filter(|text| !text.is_empty())
    }
}

impl Grid {
    /// The cause for a row with a value that differs; `None` if no value differs or the study gives no cause.
    #[must_use]
    pub fn cause(&self, row: usize) -> Option<&str> {
        let differs = self.cells[row]
            .iter()
            .any(|cell| cell.verdict() == Some(Verdict::Differs));
        let cause = self.cause.as_ref().filter(|_| differs)?;
        cause.of(&self.rows[row].name)
    }

    /// The causes of all rows as they are printed under the table, each paragraph once.
    pub(super) fn causes(&self) -> Vec<String> {
        let mut causes: Vec<String> = Vec::new();
        for (index, row) in self.rows.iter().enumerate() {
            let about = match self.cause {
                Some(Cause::ByRow(_)) => format!(" ({})", row.label),
                _ => String::new(),
            };
            let cause = self.cause(index).map(|text| format!("Cause{about}: {text}"));
            causes.extend(cause.filter(|cause| !causes.contains(cause)));
        }
        causes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{Cell, Heading, Intervals, markdown};
    use statistics::{Judgement, Reference};

    /// Rows `a`, `b` and `c` with one value each and these verdicts.
    fn grid(verdicts: [Verdict; 3], cause: &str) -> Grid {
        let cell = |verdict| {
            let judgement = Judgement::without(verdict, Reference::within(1.0, 0.1), &[(0, 2.0)]);
            vec![Cell {
                judgement: Some(judgement),
                ..Cell::default()
            }]
        };
        Grid {
            rows: vec![
                Heading::of("a", "Rule A"),
                Heading::of("b", "b"),
                Heading::of("c", "c"),
            ],
            columns: vec![Heading::of("v", "v")],
            cells: verdicts.map(cell).into(),
            cause: Some(serde_json::from_str(cause).unwrap()),
            ..Grid::default()
        }
    }

    #[test]
    fn a_cause_is_printed_right_under_a_table_in_which_a_value_differs() {
        use Verdict::{Calibrated, Differs, Inconclusive, Reproduced};
        let text = r#""The *load* was `drawn` anew.""#;
        let differs = grid([Differs, Reproduced, Differs], text);
        assert_eq!(
            differs.footnotes(Intervals::InBrackets)[0],
            "Cause: The *load* was `drawn` anew."
        );
        let printed = markdown(&differs);
        assert_eq!(printed.matches("Cause: ").count(), 1, "{printed}");
        assert!(
            printed.contains("|\n\nCause: The \\*load\\* was `drawn` anew.\n"),
            "{printed}"
        );
        for others in [[Reproduced; 3], [Inconclusive, Calibrated, Reproduced]] {
            assert!(!markdown(&grid(others, text)).contains("Cause"));
        }
    }

    #[test]
    fn causes_by_row_stand_for_the_rows_that_differ() {
        use Verdict::{Differs, Reproduced};
        let grid = grid(
            [Differs, Reproduced, Differs],
            r#"{"a": "one", "b": "two", "c": " "}"#,
        );
        assert_eq!(grid.causes(), ["Cause (Rule A): one"]);
        assert_eq!([0, 1, 2].map(|row| grid.cause(row)), [Some("one"), None, None]);
    }
}
