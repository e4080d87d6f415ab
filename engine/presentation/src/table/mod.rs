//! Tables: their specifications, and their computation from results.

mod aggregate;
mod best_settings;
mod cause;
mod comma_separated;
mod comparison;
mod cross_play;
mod footnotes;
mod grid;
mod html;
mod latex;
mod markdown;
mod metrics;
mod missing;
pub(crate) mod normalised_scores;
mod number_format;
pub mod prose;
mod published;
mod rank_correlation;
mod seeds;
mod terminal;
#[cfg(test)]
mod tests;

pub use crate::axis::{Axis, TableAxis};
pub use aggregate::{Aggregate, SUITE_MEAN};
pub use best_settings::BestSettings;
pub use cause::Cause;
pub use comma_separated::{csv, guarded as guarded_csv, write as write_csv};
pub use comparison::{Comparison, Form, Improvement, Statistic, compare};
pub use cross_play::{CrossPlayTable, MEAN};
pub use footnotes::Intervals;
pub use footnotes::{changed_rule_in_words, unplanned_look_in_words, untrained_in_words};
pub use grid::{Cell, FixedReason, Grid, Heading, PrintedColumn, Quantity, Reduction};
pub use html::{html, published_and_verdict, word as verdict_word};
pub use latex::{BestScope, Direction, LatexLayout, ValueForm, WideTable, latex};
pub use markdown::{escape as escape_markdown, markdown, row as markdown_row};
pub use metrics::Metrics;
pub use missing::{MissingReason, MissingSeeds};
pub use normalised_scores::{Bound, Normalisation, ScoreScale};
pub use number_format::NumberFormat;
pub use published::{Margin, PublishedCell, PublishedRow, PublishedValue, StatedMargin};
pub use rank_correlation::RankCorrelation;
pub use seeds::Scope;
pub use terminal::align;
pub use terminal::{terminal, terminal_in_short, wrap};

use crate::{
    kinds::{Chosen, Kind, KindOptions, KindSpec, Readable},
    names::{Names, Place},
};
use analysis::{published_curve::PublishedCurve, results::Results};
use contract::Error;
use published::JudgingRules;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, sync::Arc};

/// The kinds of tables of the engine, in the order in which they are listed.
pub(crate) fn kinds() -> Vec<Readable<dyn Table>> {
    vec![
        kind::<Improvement>(),
        kind::<Comparison>(),
        kind::<CrossPlayTable>(),
        kind::<Aggregate>(),
        kind::<RankCorrelation>(),
        kind::<Metrics>(),
        kind::<BestSettings>(),
    ]
}

/// Interface of every kind of table.
pub trait Table: KindOptions {
    /// Checks every name in it against the names that trials record, and its options for published values. Returns
    /// the names of its rows and columns.
    fn check(
        &self,
        names: &mut Names<'_>,
        at: &Place<'_>,
        published: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>);

    /// Computes rows, columns and cells, without published values.
    ///
    /// # Errors
    /// [`Error::Render`] if the results lack the values that it shows.
    fn build(&self, results: &Results) -> Result<Grid, Error>;

    /// Agents to which a row's single published value does not apply.
    fn baselines(&self, _: &Results) -> Vec<String> {
        Vec::new()
    }

    /// Better direction of a column; `None` if the kind does not determine it.
    fn better(&self, _column: &str) -> Option<Direction> {
        None
    }

    /// The metric that gives the numbers their unit; `None` if they have another unit or none.
    fn metric_of_unit(&self) -> Option<&str> {
        None
    }

    /// Phrase for values that are no means over seeds and cannot be judged against published ones; `None` for means.
    fn no_means(&self) -> Option<&'static str> {
        None
    }

    /// Whether the values are shares of seeds with success.
    fn shows_shares(&self) -> bool {
        false
    }

    /// Number of measurements up to each column, a step, over which published curves are compared; `None` if columns
    /// are no steps or rows no agents.
    fn measurements_by_step(&self) -> Option<u64> {
        None
    }
}

/// One table of a study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TableSpec {
    /// Caption of the table, in one sentence.
    #[serde(default)]
    pub caption: String,
    /// Kind of the table: exactly one.
    #[serde(flatten, skip_deserializing, default = "unread")]
    #[schemars(skip)]
    pub kind: Chosen<dyn Table>,
    /// Published values by row, or by row and column.
    #[serde(default)]
    pub published: BTreeMap<String, PublishedRow>,
    /// Published curves. Each is compared with the row of its agent at every one of `at_steps`, over as many
    /// measurements up to there (`last`, 1 where absent) as the study's own; several runs count as an uncertain value.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub published_curves: Vec<PublishedCurve>,
    /// Largest distance of a reproduced value from the published one: a number in the unit of the cell, or one of
    /// `absolute`, `percent` and `ratio` with a reason, `why`; 5 % of the published value if absent.
    #[serde(default)]
    pub margin: Option<Margin>,
    /// A choice that was made with knowledge of the published values; agreement with them is then by construction, and
    /// their verdict is CALIBRATED.
    #[serde(default)]
    pub calibrated_on: Option<String>,
    /// The system of the published values, if it differs from the one here: they are printed but not judged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of_another_system: Option<String>,
    /// Whether the comparison was thought of after results were seen; its verdicts are counted separately.
    #[serde(default)]
    pub exploratory: bool,
    /// Attempts to find out why values differ from the published ones: a paragraph, or one for each row. It is printed
    /// if a value differs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<Cause>,
    /// Sentences under the table: deviations, sources.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Typesetting of the LaTeX file: bold values, the form of intervals, and the handling of a wide table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latex: Option<LatexLayout>,
}

/// The kind of a table whose options are not read yet; its reader fills them in.
fn unread() -> Chosen<dyn Table> {
    Chosen::of::<Comparison>(Arc::new(Comparison::default()))
}

impl TableSpec {
    /// A table of this kind, without published values, caption and notes.
    #[must_use]
    pub fn of<K: Table + KindSpec>(kind: K) -> Self {
        Self {
            caption: String::new(),
            kind: Chosen::of::<K>(Arc::new(kind)),
            published: BTreeMap::new(),
            published_curves: Vec::new(),
            margin: None,
            calibrated_on: None,
            of_another_system: None,
            exploratory: false,
            cause: None,
            notes: Vec::new(),
            latex: None,
        }
    }

    /// Whether a choice was made with knowledge of one of the published values.
    #[must_use]
    pub fn is_calibrated(&self) -> bool {
        self.calibrated_on.is_some() || self.published.values().any(PublishedRow::is_calibrated)
    }
}

/// The entry of a kind of tables.
pub(crate) fn kind<T: Table + KindSpec>() -> Readable<dyn Table> {
    Readable {
        kind: Kind::of::<T>(),
        read: |options, _| Ok(Arc::new(serde_json::from_value::<T>(options)?)),
    }
}

/// Computes a table. Missing seeds are counted in their cells, never left out silently.
///
/// # Errors
/// [`Error::Render`] if the spec names an agent that the results do not contain, or if the results lack its values.
pub fn build(spec: &TableSpec, results: &Results) -> Result<Grid, Error> {
    let kind = &spec.kind;
    let (mut grid, baselines) = (kind.build(results)?, kind.baselines(results));
    for heading in grid.rows.iter_mut().chain(&mut grid.columns) {
        heading.label = one_line(&heading.label);
    }
    grid.quantity.value = one_line(&grid.quantity.value);
    grid.caption.clone_from(&spec.caption);
    grid.notes.extend(spec.notes.iter().cloned());
    if let Some(system) = &spec.of_another_system {
        grid.notes.push(format!(
            "Published values are of another system and are not judged: {system}."
        ));
    }
    grid.margin.clone_from(&spec.margin);
    grid.exploratory = spec.exploratory;
    grid.latex.clone_from(&spec.latex);
    let said = spec.latex.as_ref().and_then(|layout| layout.better);
    grid.better = grid
        .columns
        .iter()
        .map(|column| kind.better(&column.name).or(said))
        .collect();
    grid.cause.clone_from(&spec.cause);
    let judging = JudgingRules {
        margin: spec.margin.as_ref(),
        calibrated_on: spec.calibrated_on.as_deref(),
        of_another_system: spec.of_another_system.is_some(),
        baselines: &baselines,
    };
    let last = usize::try_from(kind.measurements_by_step().unwrap_or(1)).unwrap_or(usize::MAX);
    for curve in &spec.published_curves {
        let note = judging.publish_curve(&mut grid, curve, last)?;
        grid.notes.push(note);
    }
    for (row, published) in &spec.published {
        if !judging.publish(&mut grid, row, published) {
            grid.notes.push(format!(
                "Published values of `{row}` have no place in this table."
            ));
        }
    }
    Ok(grid)
}

/// A label with a space for each break between lines, for which a row of a terminal and a line of a figure have no
/// place.
pub(crate) fn one_line(label: &str) -> String {
    label.replace("\r\n", " ").replace(['\n', '\r'], " ")
}

fn problem(problem: &str) -> Error {
    Error::Render {
        what: "table".into(),
        problem: problem.into(),
    }
}
