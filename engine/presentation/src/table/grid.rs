//! A computed table: numbers with what they rest on. Its sentences are made in [`super::footnotes`].

use super::{Cause, Direction, Form, LatexLayout, Margin, MissingSeeds, NumberFormat, Statistic};
use analysis::{results::Results, training_share};
use contract::{trial::CellName, trial_result::TrialResult};
use statistics::{Judgement, MeanEstimate, Sample, Seeds, TrainingShare, Verdict};
use std::{
    borrow::Cow,
    collections::{BTreeMap, BTreeSet},
    fmt,
};

/// A table as data: what the renderers read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Grid {
    /// What the table shows, in one sentence.
    pub caption: String,
    /// What the numbers are.
    pub quantity: Quantity,
    /// Unit of the numbers; empty where there is none or it is not known.
    pub unit: String,
    /// How seeds became one number.
    pub one_number: Reduction,
    /// What the rows are: `agent`, `environment` or `setting`.
    pub row_axis: Cow<'static, str>,
    /// One heading per row.
    pub rows: Vec<Heading>,
    /// One heading per column of values.
    pub columns: Vec<Heading>,
    /// The cells, `[row][column]`.
    pub cells: Vec<Vec<Cell>>,
    /// How numbers are written.
    pub format: NumberFormat,
    /// How far a value may lie from the published one.
    pub margin: Option<Margin>,
    /// True where the comparison was thought of after results were seen.
    pub exploratory: bool,
    /// What was found out about values that differ; printed where one does.
    pub cause: Option<Cause>,
    /// Sentences under the table.
    pub notes: Vec<String>,
    /// Which values of each column are better, where that is known; empty where it was not asked for.
    pub better: Vec<Option<Direction>>,
    /// How it is set in LaTeX, where the study says it.
    pub latex: Option<LatexLayout>,
}

/// What the numbers of a table are. Its display is a phrase, as in `cycle length, change from equal, by
/// seed`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Quantity {
    /// The quantity of one agent.
    pub value: String,
    /// How values are written relative to an agent, and its name; `None` where they are not.
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

    /// The phrase without how values are paired, for the axis of a figure.
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

/// How seeds became one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reduction {
    /// By a statistic over seeds.
    Of(Statistic),
    /// As the share of seeds with success.
    Share,
    /// By a statistic of its own in each column.
    Aggregates,
    /// As the correlation of the ranks of their means.
    RankCorrelation,
}

impl Reduction {
    /// The name in words.
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

/// Why a value is what it is by construction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FixedReason {
    /// An agent beside itself.
    Itself,
    /// The mean that became 0 or 1.
    Ends,
    /// An agent that stands for 0 or 1.
    Scale,
}

/// Heading of a row or column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Heading {
    /// Name in the study, by which published values are found.
    pub name: String,
    /// What is printed.
    pub label: String,
}

/// One number of a table with what it rests on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cell {
    /// The number of each seed, in the order of seeds.
    pub seeds: Vec<(u64, f64)>,
    /// The same as it was when the seeds below a number were all there were, where the others move it: a verdict of an
    /// earlier look knows nothing of later seeds. A number that is not here has those of `seeds`.
    pub as_of: BTreeMap<u64, Vec<(u64, f64)>>,
    /// How many seeds the study plans.
    pub planned: usize,
    /// How many seeds ended, but not well.
    pub failed: usize,
    /// The seeds as one number; `None` where no seed has one.
    pub estimate: Option<f64>,
    /// Standard deviation over seeds; `None` below two seeds.
    pub sd: Option<f64>,
    /// 95 % interval of the estimate; `None` below two seeds.
    pub interval: Option<(f64, f64)>,
    /// The published number and how the seeds compare with it; `None` where nothing is published.
    pub judgement: Option<Judgement>,
    /// Why seeds are missing.
    pub missing: Vec<MissingSeeds>,
    /// Why the value is what it is by construction; `None` where it is not.
    pub fixed: Option<FixedReason>,
    /// What was chosen with the published value in view; `None` where nothing was.
    pub calibrated_on: Option<String>,
    /// True where the values are successes of seeds, 0 or 1.
    pub is_share: bool,
    /// Agents behind the value that made no update.
    pub untrained: Vec<String>,
    /// How much of the source's training is behind the value; `None` where the study does not say it.
    pub training: Option<TrainingShare>,
    /// An earlier number of seeds at which the verdict was seen without a plan.
    pub seen_at: Option<u32>,
    /// What the verdict was first passed by, where that was changed after it was seen: then it is exploratory.
    pub first_judged_by: Option<String>,
    /// Which seeds a verdict may rest on.
    pub looks: Seeds,
    /// The combinations whose seeds are behind the value.
    pub rests_on: BTreeSet<CellName>,
}

/// One printed column: a column of the grid, or what stands beside it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The reproduced value with its interval.
    Value(usize),
    /// The published value.
    Published(usize),
    /// The verdict.
    Verdict(usize),
}

impl Grid {
    /// True where a value of it, or what it is judged by, was thought of after results were seen.
    #[must_use]
    pub fn is_exploratory(&self, cell: &Cell) -> bool {
        self.exploratory || cell.first_judged_by.is_some()
    }

    /// The printed columns from left to right: each column, followed by published value and verdict where it
    /// has any.
    #[must_use]
    pub fn parts(&self) -> Vec<Part> {
        let has_published = |column: usize| self.cells.iter().any(|row| row[column].judgement.is_some());
        let beside = |column| {
            [
                Part::Value(column),
                Part::Published(column),
                Part::Verdict(column),
            ]
        };
        (0..self.columns.len())
            .flat_map(|c| beside(c).into_iter().take(if has_published(c) { 3 } else { 1 }))
            .collect()
    }

    /// Heading of a printed column.
    #[must_use]
    pub fn heading(&self, part: Part) -> &str {
        match part {
            Part::Value(column) => &self.columns[column].label,
            Part::Published(_) => "published",
            Part::Verdict(_) => "verdict",
        }
    }

    /// Text of one printed cell.
    #[must_use]
    pub fn text(&self, row: usize, part: Part) -> String {
        match part {
            Part::Value(column) => self.value(&self.cells[row][column]),
            Part::Published(column) => self.cells[row][column]
                .published()
                .map_or(String::new(), |value| self.format.published(value)),
            Part::Verdict(column) => self.cells[row][column].verdict_in_words(),
        }
    }

    /// Heading over the row headings: what the rows are.
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

    /// The number of seeds that most cells rest on; cells with another number say theirs. `None` where no
    /// cell has a seed.
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

    /// What follows a value: its number of seeds where that is not the usual one, and a star where some are
    /// missing.
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
    /// True where the study plans more seeds than the cell has.
    #[must_use]
    pub fn is_incomplete(&self) -> bool {
        self.seeds.len() < self.planned
    }

    /// The published number.
    #[must_use]
    pub fn published(&self) -> Option<f64> {
        self.judgement.as_ref().map(|judgement| judgement.reference.value)
    }

    /// How the seeds compare with the published number.
    #[must_use]
    pub fn verdict(&self) -> Option<Verdict> {
        self.judgement.as_ref().map(|judgement| judgement.verdict)
    }

    /// The verdict, and the one that all judged values of the study have together where it is another.
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

    /// A cell with what is behind it, without values.
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
            rests_on: trials.iter().map(|trial| trial.cell()).collect(),
            ..Self::default()
        }
    }

    /// The same with the mean of these values of seeds and its 95 % interval; without a value where there are none.
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

    /// The numbers that a verdict rests on.
    #[must_use]
    pub fn sample(&self) -> Sample<'_> {
        Sample {
            values: &self.seeds,
            as_of: Some(&self.as_of),
        }
    }

    /// True where an agent behind the value made no update.
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
