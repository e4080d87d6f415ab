//! A computed table: numbers with their seeds and trials. [`super::footnotes`] makes its sentences.

use super::{Cause, Direction, Form, LatexLayout, Margin, MissingSeeds, NumberFormat, Statistic};
use analysis::{results::Results, training_share};
use contract::{trial::Combination, trial_result::TrialResult};
use statistics::{Judgement, MeanEstimate, Sample, Seeds, TrainingShare, Verdict};
use std::{
    borrow::Cow,
    collections::{BTreeMap, BTreeSet},
    fmt,
};

/// A table as data, for the renderers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Grid {
    /// Caption, in one sentence.
    pub caption: String,
    /// Quantity in the cells.
    pub quantity: Quantity,
    /// Unit of the numbers; empty if there is none or it is not known.
    pub unit: String,
    /// Reduction of the seeds to one number.
    pub one_number: Reduction,
    /// Axis of the rows: `agent`, `environment` or `setting`.
    pub row_axis: Cow<'static, str>,
    /// One heading per row.
    pub rows: Vec<Heading>,
    /// One heading per column of values.
    pub columns: Vec<Heading>,
    /// The cells, `[row][column]`.
    pub cells: Vec<Vec<Cell>>,
    /// Format of the numbers.
    pub format: NumberFormat,
    /// Largest distance of a value from the published one that counts as reproduced.
    pub margin: Option<Margin>,
    /// Whether the comparison was thought of after results were seen.
    pub exploratory: bool,
    /// Cause of values that differ; printed if one does.
    pub cause: Option<Cause>,
    /// Sentences under the table.
    pub notes: Vec<String>,
    /// Better direction of each column; `None` for a column with an unknown direction, empty if not requested.
    pub better: Vec<Option<Direction>>,
    /// Typesetting in LaTeX, if the study states it.
    pub latex: Option<LatexLayout>,
}

/// Quantity in the cells of a table. Its display is a phrase, as in `cycle length, change from equal, by seed`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Quantity {
    /// Phrase for the quantity of one agent.
    pub value: String,
    /// Form of values relative to an agent, and the agent's name; `None` for values that are not relative.
    pub relative: Option<(Form, String)>,
}

impl Quantity {
    /// A quantity that is relative to no agent.
    #[must_use]
    pub fn plain(value: String) -> Self {
        Self {
            value,
            relative: None,
        }
    }

    /// The phrase without the pairing of values, for the axis of a figure.
    #[must_use]
    pub fn label(&self) -> String {
        let value = &self.value;
        match &self.relative {
            None | Some((Form::Value, _)) => value.clone(),
            Some((Form::Difference, to)) => format!("{value} minus that of {to}"),
            Some((Form::Ratio, to)) => format!("{value} over that of {to}"),
            Some((Form::PercentChange, to)) => format!("{value}, change from {to}"),
        }
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let paired = self
            .relative
            .as_ref()
            .is_some_and(|(form, _)| *form != Form::Value);
        write!(f, "{}{}", self.label(), if paired { ", by seed" } else { "" })
    }
}

/// Reduction of seeds to one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reduction {
    /// A statistic over seeds.
    Of(Statistic),
    /// The share of seeds with success.
    Share,
    /// A statistic of its own in each column.
    Aggregates,
    /// The correlation of the ranks of their means.
    RankCorrelation,
}

impl Reduction {
    /// Name of the reduction as text.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Reduction::Of(statistic) => statistic.name(),
            Reduction::Share => "share",
            Reduction::Aggregates => "aggregates",
            Reduction::RankCorrelation => "rank correlation of means",
        }
    }
}

impl Default for Reduction {
    fn default() -> Self {
        Self::Of(Statistic::Mean)
    }
}

/// Reason why a value is fixed by construction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FixedReason {
    /// An agent is compared with itself.
    Itself,
    /// The mean became 0 or 1 by the normalisation.
    Ends,
    /// The agent sets the 0 or 1 of the scale.
    Scale,
}

/// Heading of a row or column.
#[derive(Debug, Clone, PartialEq)]
pub struct Heading {
    /// Name in the study, by which published values are found.
    pub name: String,
    /// Text to print.
    pub label: String,
    /// The swept number that it stands for; `None` if it stands for anything else.
    pub number: Option<f64>,
}

impl Heading {
    /// A heading that stands for no number.
    #[must_use]
    pub fn of(name: &str, label: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            label: label.into(),
            number: None,
        }
    }
}

/// One number of a table with the seeds and trials behind it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cell {
    /// The number of each seed, in the order of seeds.
    pub seeds: Vec<(u64, f64)>,
    /// The numbers of the seeds below a limit, by limit, as they were when no other seeds existed: a verdict of an
    /// earlier look must not depend on later seeds. A limit without an entry has the numbers in `seeds`.
    pub as_of: BTreeMap<u64, Vec<(u64, f64)>>,
    /// Number of seeds that the study plans.
    pub planned: usize,
    /// Number of seeds that ended unsuccessfully.
    pub failed: usize,
    /// The seeds as one number; `None` if no seed has one.
    pub estimate: Option<f64>,
    /// Standard deviation over seeds; `None` below two seeds.
    pub sd: Option<f64>,
    /// 95 % interval of the estimate; `None` below two seeds.
    pub interval: Option<(f64, f64)>,
    /// The published number and its comparison with the seeds; `None` if nothing is published.
    pub judgement: Option<Judgement>,
    /// Reasons for missing seeds.
    pub missing: Vec<MissingSeeds>,
    /// Reason why a value is fixed by construction; `None` if it is not.
    pub fixed: Option<FixedReason>,
    /// Choice that was made with knowledge of the published value; `None` if there was none.
    pub calibrated_on: Option<String>,
    /// Whether the values are successes of seeds, 0 or 1.
    pub is_share: bool,
    /// Agents behind the value that made no update.
    pub untrained: Vec<String>,
    /// Share of the source's training behind the value; `None` if the study does not state it.
    pub training: Option<TrainingShare>,
    /// An earlier number of seeds at which the verdict was seen without a plan.
    pub seen_at: Option<u32>,
    /// First rule of the verdict, if it was changed after the verdict was seen; the verdict is then exploratory.
    pub first_judged_by: Option<String>,
    /// Seeds on which a verdict may be based.
    pub looks: Seeds,
    /// The combinations whose seeds are behind the value.
    pub rests_on: BTreeSet<Combination>,
}

/// One printed column: a column of the grid, or its published values or verdicts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PrintedColumn {
    /// The reproduced value with its interval.
    Value(usize),
    /// The published value.
    Published(usize),
    /// The verdict.
    Verdict(usize),
}

impl Grid {
    /// Whether a cell is exploratory: its comparison or the rule of its verdict was thought of after results were
    /// seen.
    #[must_use]
    pub fn is_exploratory(&self, cell: &Cell) -> bool {
        self.exploratory || cell.first_judged_by.is_some()
    }

    /// The printed columns from left to right: each column, followed by its published values and verdicts if it has
    /// any.
    #[must_use]
    pub fn parts(&self) -> Vec<PrintedColumn> {
        let has_published = |column: usize| self.cells.iter().any(|row| row[column].judgement.is_some());
        let beside = |column| {
            [
                PrintedColumn::Value(column),
                PrintedColumn::Published(column),
                PrintedColumn::Verdict(column),
            ]
        };
        (0..self.columns.len())
            .flat_map(|c| beside(c).into_iter().take(if has_published(c) { 3 } else { 1 }))
            .collect()
    }

    /// Heading of a printed column.
    #[must_use]
    pub fn heading(&self, part: PrintedColumn) -> &str {
        match part {
            PrintedColumn::Value(column) => &self.columns[column].label,
            PrintedColumn::Published(_) => "published",
            PrintedColumn::Verdict(_) => "verdict",
        }
    }

    /// Text of one printed cell.
    #[must_use]
    pub fn text(&self, row: usize, part: PrintedColumn) -> String {
        match part {
            PrintedColumn::Value(column) => self.value(&self.cells[row][column]),
            PrintedColumn::Published(column) => self.cells[row][column]
                .published()
                .map_or(String::new(), |value| self.format.published(value)),
            PrintedColumn::Verdict(column) => self.cells[row][column].verdict_in_words(),
        }
    }

    /// Heading above the row headings: the axis of the rows.
    #[must_use]
    pub fn corner(&self) -> &str {
        &self.row_axis
    }

    /// All cells with the labels of their row and column, row by row.
    pub fn places(&self) -> impl Iterator<Item = (String, &Cell)> {
        let label = |row: &Heading, column: &Heading| {
            if self.columns.len() == 1 {
                row.label.clone()
            } else {
                format!("{}, {}", row.label, column.label)
            }
        };
        let places = self.rows.iter().zip(&self.cells);
        places.flat_map(move |(row, cells)| {
            self.columns
                .iter()
                .zip(cells)
                .map(move |(column, cell)| (label(row, column), cell))
        })
    }

    /// The number of seeds behind most cells; cells with another number state theirs. `None` if no cell has a seed.
    #[must_use]
    pub fn usual_n(&self) -> Option<usize> {
        let mut counts: std::collections::BTreeMap<usize, usize> = std::collections::BTreeMap::new();
        for cell in self.cells.iter().flatten().filter(|cell| cell.estimate.is_some()) {
            *counts.entry(cell.seeds.len()).or_default() += 1;
        }
        counts
            .into_iter()
            .max_by_key(|(n, cells)| (*cells, *n))
            .map(|(n, _)| n)
    }

    fn value(&self, cell: &Cell) -> String {
        let Some(estimate) = cell.estimate else {
            return cell.absence().into();
        };
        let mut text = self.format.write(estimate);
        if let Some((low, high)) = cell.interval {
            text += &format!(" [{}, {}]", self.format.write(low), self.format.write(high));
        }
        text + &self.remark(cell)
    }

    /// Remark after a value: its number of seeds if that is not the usual one, and a star if some are missing.
    pub(super) fn remark(&self, cell: &Cell) -> String {
        let mut text = String::new();
        if self.usual_n() != Some(cell.seeds.len()) {
            text += &format!(" (n = {})", cell.seeds.len());
        }
        if cell.is_incomplete() {
            text += " *";
        }
        text
    }
}

impl Cell {
    /// Whether the study plans more seeds than the cell has.
    #[must_use]
    pub fn is_incomplete(&self) -> bool {
        self.seeds.len() < self.planned
    }

    /// The published number; `None` if nothing is published for the cell.
    #[must_use]
    pub fn published(&self) -> Option<f64> {
        self.judgement.as_ref().map(|judgement| judgement.reference.value)
    }

    /// The verdict of the seeds on the published number; `None` if nothing is published.
    #[must_use]
    pub fn verdict(&self) -> Option<Verdict> {
        self.judgement.as_ref().map(|judgement| judgement.verdict)
    }

    /// The verdict, followed by the verdict of all judged values together (Holm) if that differs.
    #[must_use]
    pub fn verdict_in_words(&self) -> String {
        let Some(judgement) = &self.judgement else {
            return String::new();
        };
        let at = match self.training {
            Some(share) if judgement.verdict == Verdict::NotAtThisBudget => format!(" ({})", share.percent()),
            _ => String::new(),
        };
        let adjusted = judgement
            .adjusted
            .filter(|adjusted| *adjusted != judgement.verdict);
        let holm = adjusted.map_or_else(String::new, |adjusted| format!(" (Holm: {adjusted})"));
        format!("{}{at}{holm}", judgement.verdict)
    }

    /// A cell with the trials behind it, without values.
    #[must_use]
    pub fn resting_on(trials: &[&TrialResult], results: &Results) -> Self {
        let untrained: BTreeSet<&str> = trials
            .iter()
            .filter(|trial| trial.updates() == Some(0.0))
            .map(|trial| trial.trial.cell.agent.as_str())
            .collect();
        Self {
            untrained: untrained.into_iter().map(Into::into).collect(),
            training: training_share::behind(trials, results),
            looks: results.seeds_of(trials),
            rests_on: trials.iter().map(|trial| trial.combination().clone()).collect(),
            ..Self::default()
        }
    }

    /// The cell with the mean of these values by seed and its 95 % interval; without a value if there are none.
    #[must_use]
    pub fn with_mean(self, seeds: BTreeMap<u64, f64>) -> Self {
        let values: Vec<f64> = seeds.values().copied().collect();
        let estimate = (!values.is_empty()).then(|| MeanEstimate::of(&values));
        Self {
            seeds: seeds.into_iter().collect(),
            estimate: estimate.as_ref().map(|it| it.value),
            interval: estimate
                .and_then(|it| it.interval(0.95))
                .map(|interval| (interval.low, interval.high)),
            ..self
        }
    }

    /// The numbers on which a verdict is based.
    #[must_use]
    pub fn sample(&self) -> Sample<'_> {
        Sample {
            values: &self.seeds,
            as_of: Some(&self.as_of),
        }
    }

    /// Whether an agent behind the value made no update.
    #[must_use]
    pub fn is_untrained(&self) -> bool {
        !self.untrained.is_empty()
    }

    fn absence(&self) -> &'static str {
        match self.planned {
            0 => "–",
            _ if self.failed > 0 => "failed *",
            _ if !self.missing.iter().all(MissingSeeds::is_not_run) => "none *",
            _ => "not run *",
        }
    }
}
