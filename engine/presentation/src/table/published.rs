//! Published values beside reproduced ones: their forms in a study, and the margin of agreement.

use super::{Cell, Grid};
use analysis::published_curve::PublishedCurve;
use contract::Error;
use document::count::count;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{
    Judgement, Reference, Summary, Verdict,
    binomial::Share,
    verdict::{default_margin, judge},
};
use std::collections::BTreeMap;

/// A published value of a row, or one for each column of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum PublishedRow {
    /// The value of the row's only column, or of every column that is not a bound or baseline.
    Value(f64),
    /// The value with the known facts about it.
    Entry(PublishedValue),
    /// Values by column name.
    Columns(BTreeMap<String, PublishedCell>),
}

impl PublishedRow {
    /// Whether a choice was made with knowledge of one of the values.
    #[must_use]
    pub fn is_calibrated(&self) -> bool {
        match self {
            PublishedRow::Value(_) => false,
            PublishedRow::Entry(entry) => entry.calibrated_on.is_some(),
            PublishedRow::Columns(columns) => {
                columns.values().any(|cell| cell.entry().calibrated_on.is_some())
            }
        }
    }
}

/// A published value of one cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum PublishedCell {
    /// The value alone.
    Value(f64),
    /// The value with the known facts about it.
    Entry(PublishedValue),
}

/// A published value with the known facts about it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PublishedValue {
    /// The value.
    pub value: f64,
    /// Standard deviation over the published runs. With `n` the value counts as uncertain, without both as exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub sd: Option<f64>,
    /// Number of published runs. A share of successes with it counts as uncertain, without `sd`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 2))]
    pub n: Option<u32>,
    /// A choice that was made with knowledge of this value. Agreement with it is then by construction: CALIBRATED
    /// stands for REPRODUCED.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrated_on: Option<String>,
}

impl PublishedValue {
    /// The value as a share of the published runs; `None` if their number is not given, or if the value is no share of
    /// that number of runs, as printed with two digits or more.
    #[must_use]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number from 0 to n"
    )]
    pub fn share(&self) -> Option<Share> {
        const ROUNDING: f64 = 0.005;
        let n = self.n?;
        let successes = (self.value * f64::from(n)).round();
        let is_near = (successes / f64::from(n) - self.value).abs() <= ROUNDING;
        let is_share = is_near && (0.0..=f64::from(n)).contains(&successes);
        is_share.then_some(Share {
            successes: successes as u32,
            n,
        })
    }
}

impl PublishedCell {
    /// The value with the known facts about it.
    #[must_use]
    pub fn entry(&self) -> PublishedValue {
        match self {
            PublishedCell::Value(value) => PublishedValue {
                value: *value,
                ..PublishedValue::default()
            },
            PublishedCell::Entry(entry) => entry.clone(),
        }
    }
}

/// Largest distance of a reproduced value from the published one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Margin {
    /// In the unit of the cell, without a reason.
    Absolute(f64),
    /// On a scale of its own, with a reason.
    Stated(StatedMargin),
}

/// A margin on one scale, with its reason.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StatedMargin {
    /// In the unit of the cell.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub absolute: Option<f64>,
    /// In percent of the published value.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub percent: Option<f64>,
    /// As a factor: 1.2 allows from the published value over 1.2 to 1.2 times it.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1.0))]
    pub ratio: Option<f64>,
    /// Reason why values this close count as the same.
    pub why: String,
}

impl Margin {
    /// The smallest and largest value that count as the same as a published one; 5 % of it without a margin.
    #[must_use]
    pub fn band(margin: Option<&Self>, published: f64) -> (f64, f64) {
        let around = |distance: f64| (published - distance, published + distance);
        match margin {
            None => around(default_margin(published)),
            Some(Margin::Absolute(distance)) => around(*distance),
            Some(Margin::Stated(StatedMargin {
                absolute: Some(distance),
                ..
            })) => around(*distance),
            Some(Margin::Stated(StatedMargin {
                percent: Some(percent),
                ..
            })) => around(percent / 100.0 * published.abs()),
            Some(Margin::Stated(StatedMargin { ratio, .. })) => {
                let ratio = ratio.unwrap_or(1.0);
                let ends = [published / ratio, published * ratio];
                (ends[0].min(ends[1]), ends[0].max(ends[1]))
            }
        }
    }

    /// The margin as text, as in `a factor of 1.2`.
    #[must_use]
    pub fn in_words(margin: Option<&Self>, unit: &str) -> String {
        let absolute = |distance: &f64| match unit {
            "%" => format!("± {distance} percentage points"),
            unit => format!("± {distance} {unit}").trim_end().to_owned(),
        };
        match margin {
            None => "± 5 % of it".into(),
            Some(Margin::Absolute(distance)) => absolute(distance),
            Some(Margin::Stated(StatedMargin {
                absolute: Some(distance),
                ..
            })) => absolute(distance),
            Some(Margin::Stated(StatedMargin {
                percent: Some(percent),
                ..
            })) => format!("± {percent} % of it"),
            Some(Margin::Stated(StatedMargin { ratio, .. })) => {
                format!("times or over {}", ratio.unwrap_or(1.0))
            }
        }
    }

    /// The reason of a margin; empty if none is given.
    #[must_use]
    pub fn reason(margin: Option<&Self>) -> &str {
        match margin {
            Some(Margin::Stated(stated)) => &stated.why,
            Some(Margin::Absolute(_)) | None => "",
        }
    }
}

/// Rules of a table that hold for all its published values.
pub(super) struct JudgingRules<'a> {
    /// Largest distance of a value from the published one that counts as the same.
    pub(super) margin: Option<&'a Margin>,
    /// Choice that was made with knowledge of all published values.
    pub(super) calibrated_on: Option<&'a str>,
    /// Whether they belong to another system.
    pub(super) of_another_system: bool,
    /// Agents to which a row's single published value does not apply.
    pub(super) baselines: &'a [String],
}

impl JudgingRules<'_> {
    /// Writes a row's published values into its cells; returns whether each of them has a cell.
    pub(super) fn publish(&self, grid: &mut Grid, row: &str, published: &PublishedRow) -> bool {
        let Some(row) = grid
            .rows
            .iter()
            .position(|heading| heading.name == row || heading.label == row)
        else {
            return false;
        };
        match published {
            PublishedRow::Value(value) => {
                self.publish_row(grid, row, &PublishedCell::Value(*value).entry());
                true
            }
            PublishedRow::Entry(entry) => {
                self.publish_row(grid, row, entry);
                true
            }
            PublishedRow::Columns(values) => self.publish_columns(grid, row, values),
        }
    }

    /// Writes a published curve beside the row of its agent, at the steps of the columns, each over as many
    /// measurements up to there as the reproduced value. Returns a sentence on the runs behind it.
    ///
    /// # Errors
    /// [`Error::Render`] if the file no longer contains the requested values.
    pub(super) fn publish_curve(
        &self,
        grid: &mut Grid,
        curve: &PublishedCurve,
        last: usize,
    ) -> Result<String, Error> {
        let runs = curve.runs().map_err(|error| Error::Render {
            what: "table".into(),
            problem: error.to_string(),
        })?;
        let names = [curve.agent.as_deref(), curve.environment.as_deref()];
        let is_row = |heading: &super::Heading| {
            names
                .into_iter()
                .flatten()
                .all(|name| heading.name.split(", ").any(|word| word == name))
        };
        for row in (0..grid.rows.len()).filter(|row| is_row(&grid.rows[*row])) {
            for column in 0..grid.columns.len() {
                let Ok(step) = grid.columns[column].name.parse() else {
                    continue;
                };
                let values: Vec<f64> = runs.iter().filter_map(|run| run.last_mean(step, last)).collect();
                if let Some(entry) = entry_of(&values) {
                    self.compare(&mut grid.cells[row][column], &entry);
                }
            }
        }
        let over = if last == 1 {
            "the measurement".to_owned()
        } else {
            format!("the last {last} measurements")
        };
        Ok(format!(
            "Published curve {}: {}, {over} up to each step.",
            curve.label,
            count(runs.len(), "run")
        ))
    }

    fn publish_row(&self, grid: &mut Grid, row: usize, entry: &PublishedValue) {
        let only = grid.columns.len() == 1;
        for column in 0..grid.columns.len() {
            if only
                || !self
                    .baselines
                    .iter()
                    .any(|name| *name == grid.columns[column].name)
            {
                self.compare(&mut grid.cells[row][column], entry);
            }
        }
    }

    fn publish_columns(&self, grid: &mut Grid, row: usize, values: &BTreeMap<String, PublishedCell>) -> bool {
        let only = (grid.columns.len() == 1 && values.len() == 1).then_some(0);
        let mut placed = true;
        for (name, value) in values {
            match grid
                .columns
                .iter()
                .position(|column| column.name == *name)
                .or(only)
            {
                Some(column) => self.compare(&mut grid.cells[row][column], &value.entry()),
                None => placed = false,
            }
        }
        placed
    }

    fn compare(&self, cell: &mut Cell, entry: &PublishedValue) {
        let reference = Reference {
            value: entry.value,
            runs: entry.sd.zip(entry.n),
            share: entry.share().filter(|_| cell.is_share),
            band: Margin::band(self.margin, entry.value),
        };
        let calibrated = entry.calibrated_on.as_deref().or(self.calibrated_on);
        let unjudged = match () {
            () if cell.seeds.is_empty() => None,
            () if cell.fixed.is_some() || self.of_another_system => Some(Verdict::NotJudged),
            () if cell.is_untrained() => Some(Verdict::NotTrained),
            () => None,
        };
        let without = |verdict| Judgement::without(verdict, reference, &cell.seeds);
        let judged = || judge(reference, cell.sample(), cell.failed, &cell.looks, cell.is_share);
        let judgement = match unjudged.map_or_else(judged, without) {
            it if it.verdict == Verdict::Reproduced && calibrated.is_some() => without(Verdict::Calibrated),
            it => Judgement {
                verdict: it.verdict.at_budget(cell.training),
                ..it
            },
        };
        cell.calibrated_on = calibrated.map(Into::into);
        cell.judgement = Some(judgement);
    }
}

/// Published runs as one value; `None` without any.
fn entry_of(values: &[f64]) -> Option<PublishedValue> {
    let summary = Summary::of(values)?;
    let n = summary.sd.and(u32::try_from(summary.n).ok());
    Some(PublishedValue {
        value: summary.mean,
        sd: summary.sd,
        n,
        calibrated_on: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn margin(text: &str) -> Margin {
        serde_json::from_str(text).unwrap()
    }

    #[test]
    fn bands_on_every_scale() {
        let band = |text: &str, published| Margin::band(Some(&margin(text)), published);
        assert_eq!(Margin::band(None, -40.0), (-42.0, -38.0));
        assert_eq!(band("5", 1.0), (-4.0, 6.0));
        assert_eq!(band(r#"{"absolute": 0.5, "why": "x"}"#, 1.0), (0.5, 1.5));
        assert_eq!(band(r#"{"percent": 10}"#, 20.0), (18.0, 22.0));
        assert_eq!(band(r#"{"ratio": 2}"#, 4.0), (2.0, 8.0));
        assert_eq!(band(r#"{"ratio": 2}"#, -4.0), (-8.0, -2.0));
    }

    #[test]
    fn a_value_with_a_number_of_runs_is_a_share_of_them_or_none() {
        let share = |value: f64, n: u32| {
            let n = Some(n);
            PublishedValue {
                value,
                n,
                ..PublishedValue::default()
            }
            .share()
        };
        assert_eq!(share(0.667, 3), Some(Share { successes: 2, n: 3 }));
        assert_eq!(share(0.67, 3), Some(Share { successes: 2, n: 3 }));
        assert_eq!(
            share(0.5, 300),
            Some(Share {
                successes: 150,
                n: 300
            })
        );
        assert_eq!(
            [share(1.0, 5), share(0.0, 5)].map(|it| it.map(|it| it.successes)),
            [Some(5), Some(0)]
        );
        assert_eq!(
            [share(0.5, 3), share(0.7, 3), share(-0.2, 5), share(1.2, 5)],
            [None; 4]
        );
    }

    #[test]
    fn margins_in_words() {
        let words = |text: &str, unit| Margin::in_words(Some(&margin(text)), unit);
        assert_eq!(Margin::in_words(None, "s"), "± 5 % of it");
        assert_eq!(words("5", "%"), "± 5 percentage points");
        assert_eq!(words(r#"{"absolute": 5}"#, "s"), "± 5 s");
        assert_eq!(words(r#"{"ratio": 1.25}"#, ""), "times or over 1.25");
    }

    #[test]
    fn published_values_in_every_notation() {
        let read = |text: &str| serde_json::from_str::<PublishedRow>(text).unwrap();
        assert_eq!(read("3"), PublishedRow::Value(3.0));
        assert!(
            matches!(read(r#"{"value": 3, "sd": 1, "n": 5}"#), PublishedRow::Entry(entry) if entry.n == Some(5))
        );
        let PublishedRow::Columns(columns) =
            read(r#"{"a": 3, "b": {"value": 4, "calibrated_on": "the load"}}"#)
        else {
            panic!()
        };
        assert_eq!(columns["b"].entry().calibrated_on.as_deref(), Some("the load"));
    }
}
