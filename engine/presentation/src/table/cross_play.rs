//! The matrix of a play: the players of one role along the rows, those of another along the columns, and the means of
//! both.

use super::{
    Cell, FixedReason, Grid, Heading, MissingReason, MissingSeeds, NumberFormat, Quantity, Scope, Statistic,
    Table, comparison::summarise, problem,
};
use crate::kinds::KindSpec;
use crate::names::{Names, Place};
use analysis::{cross_play::Encounters, results::Results};
use contract::Error;
use document::diagnostic::suggest;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{SequentialDesign, estimators::mean};
use std::collections::BTreeMap;

/// Heading of the row and the column of means.
pub const MEAN: &str = "mean";

/// A metric of a play by the players of two roles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CrossPlayTable {
    /// The play, by its name in the study's section `cross_play`.
    pub play: String,
    /// The role along the rows.
    pub rows: String,
    /// The role along the columns.
    pub columns: String,
    /// The metric.
    pub value: String,
    /// Whether the smallest mean of a cell becomes 0 and the largest 1; agents that were not trained do not affect the
    /// scale.
    pub normalise: bool,
    /// Digits after the decimal point.
    #[schemars(range(max = 9))]
    pub decimals: Option<usize>,
    /// Names to print instead of the study's own.
    pub labels: BTreeMap<String, String>,
}

impl Default for CrossPlayTable {
    fn default() -> Self {
        Self {
            play: String::new(),
            rows: String::new(),
            columns: String::new(),
            value: "return".into(),
            normalise: true,
            decimals: None,
            labels: BTreeMap::new(),
        }
    }
}

impl KindSpec for CrossPlayTable {
    fn name() -> &'static str {
        "cross_play"
    }

    fn about() -> &'static str {
        "A metric of a play, by who plays one role along the rows and who another along the columns, \
             with both means."
    }

    fn example() -> &'static str {
        "{ play: tag, rows: chaser, columns: runner, value: return, normalise: false }"
    }
}

impl Table for CrossPlayTable {
    fn check(
        &self,
        names: &mut Names<'_>,
        at: &Place<'_>,
        _: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>) {
        check(self, names, at)
    }

    fn build(&self, results: &Results) -> Result<Grid, Error> {
        build(self, results)
    }

    fn metric_of_unit(&self) -> Option<&str> {
        (!self.normalise).then_some(&self.value)
    }
}

/// Checks the play, its roles and the metric; returns the names of rows and columns.
fn check(spec: &CrossPlayTable, names: &mut Names<'_>, place: &Place<'_>) -> (Vec<String>, Vec<String>) {
    let vocabulary = names.vocabulary;
    let Some(play) = vocabulary.plays.iter().find(|play| play.name == spec.play) else {
        let help = suggest(&spec.play, vocabulary.plays.iter().map(|play| play.name.as_str()));
        names.say(
            place.value("play"),
            format!("no play is named `{}`", spec.play),
            help,
        );
        return (Vec::new(), Vec::new());
    };
    for (key, role) in [("rows", &spec.rows), ("columns", &spec.columns)] {
        if !play.roles.iter().any(|(known, _)| known == role) {
            let help = suggest(role, play.roles.iter().map(|(known, _)| known.as_str()));
            names.say(
                place.value(key),
                format!("`{}` has no role `{role}`", play.name),
                help,
            );
        }
    }
    if spec.rows == spec.columns {
        names.say(
            place.value("columns"),
            "rows and columns are the same role",
            "choose another role",
        );
    }
    if !play.metrics.contains(&spec.value) {
        names.unknown_metric(&spec.value, place.value("value"), &play.metrics);
    }
    let players = play.players.iter().map(|player| player.name.clone());
    let lines: Vec<String> = players.chain([MEAN.to_owned()]).collect();
    names.labels(
        place,
        &lines,
        &[spec.rows.clone(), spec.columns.clone(), spec.value.clone()],
    );
    (lines.clone(), lines)
}

/// The trials of a cell, as agents by role. A role without an entry is played by every trained agent.
type RoleAssignment<'a> = Vec<(&'a str, &'a str)>;

/// Computes the matrix. The mean of a row or column is over trained opponents, seed by seed.
///
/// # Errors
/// [`Error::Render`] if the results contain no such play or role.
fn build(spec: &CrossPlayTable, results: &Results) -> Result<Grid, Error> {
    let encounters = Encounters::of(results, &spec.play);
    let (rows, columns) = (encounters.players(&spec.rows), encounters.players(&spec.columns));
    if rows.is_empty() || columns.is_empty() {
        let (play, rows, columns) = (&spec.play, &spec.rows, &spec.columns);
        return Err(problem(&format!(
            "no trial of the play `{play}` has the roles `{rows}` and `{columns}`"
        )));
    }
    let matrix = Matrix::of(spec, results, &encounters, [&rows, &columns]);
    let cell = |row: Option<&str>, column: Option<&str>| {
        let casting: RoleAssignment<'_> = [(spec.rows.as_str(), row), (spec.columns.as_str(), column)]
            .into_iter()
            .filter_map(|(role, it)| Some((role, it?)))
            .collect();
        if casting.is_empty() {
            Cell::default()
        } else {
            matrix.cell(&casting, results)
        }
    };
    let lines = |names: &[&'_ str]| {
        names
            .iter()
            .map(|name| Some((*name).to_owned()))
            .chain([None])
            .collect::<Vec<_>>()
    };
    let (down, across) = (lines(&rows), lines(&columns));
    let cells: Vec<Vec<Cell>> = down
        .iter()
        .map(|row| {
            across
                .iter()
                .map(|column| cell(row.as_deref(), column.as_deref()))
                .collect()
        })
        .collect();
    let estimates = cells.iter().flatten().filter_map(|cell| cell.estimate);
    let floors = rows.iter().chain(&columns).any(|name| encounters.is_floor(name));
    Ok(Grid {
        quantity: Quantity::plain(quantity(spec)),
        row_axis: "agent".into(),
        format: spec
            .decimals
            .map_or_else(|| NumberFormat::fitting(estimates), NumberFormat::Fixed),
        rows: headings(spec, &down),
        columns: headings(spec, &across),
        notes: notes(&matrix, floors, results),
        cells,
        ..Grid::default()
    })
}

/// The ends of the scale of a normalised matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scale {
    low: f64,
    high: f64,
    /// Number of cells between trained agents, and number of those with a value.
    n_cells: usize,
    n_known: usize,
}

impl Scale {
    /// The scale from the smallest to the largest mean over seeds of a cell between trained agents.
    fn of(spec: &CrossPlayTable, encounters: &Encounters<'_>, rows: &[&str], columns: &[&str]) -> Self {
        let trained = |names: &[&'_ str]| {
            names
                .iter()
                .filter(|name| !encounters.is_floor(name))
                .map(ToString::to_string)
                .collect()
        };
        let (rows, columns): (Vec<String>, Vec<String>) = (trained(rows), trained(columns));
        let value = |row: &String, column: &String| {
            let seeds = encounters.by_seed(&[(&spec.rows, row), (&spec.columns, column)], &spec.value);
            (!seeds.is_empty()).then(|| mean(&seeds.into_values().collect::<Vec<_>>()))
        };
        let known: Vec<f64> = rows
            .iter()
            .flat_map(|row| columns.iter().filter_map(move |column| value(row, column)))
            .collect();
        let low = known.iter().copied().fold(f64::INFINITY, f64::min);
        let high = known.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self {
            low,
            high,
            n_cells: rows.len() * columns.len(),
            n_known: known.len(),
        }
    }

    /// Whether the mean of some values is one of the two ends of the scale.
    fn is_end(&self, values: &[f64]) -> bool {
        let mean = mean(values);
        mean == self.low || mean == self.high
    }

    /// A sentence on the ends of the scale.
    fn in_words(&self, design: Option<&SequentialDesign>) -> String {
        let format = NumberFormat::fitting([self.low, self.high].into_iter());
        let [low, high] = [self.low, self.high].map(|end| format.write(end));
        let when = design.and_then(|design| design.looks().first());
        let when = when.map_or(String::new(), |seeds| {
            format!(", the ends of the scale after the first look, at {seeds} seeds")
        });
        format!("0 stands for {low} and 1 for {high}{when}.")
    }

    /// A sentence on cells of the scale without a value; `None` if all have one.
    fn lack_in_words(&self) -> Option<String> {
        let Self { n_known, n_cells, .. } = *self;
        (n_known < n_cells).then(|| {
            format!(
                "The scale is made of {n_known} of {n_cells} cells; it will move when the others have run."
            )
        })
    }

    /// A value on the scale; `None` if all cells are equal, or if fewer than two have a value.
    fn apply(&self, value: f64) -> Option<f64> {
        (self.high > self.low).then(|| (value - self.low) / (self.high - self.low))
    }
}

/// A play's values with the scale on which they are shown.
struct Matrix<'a> {
    spec: &'a CrossPlayTable,
    encounters: &'a Encounters<'a>,
    scale: Option<Scale>,
    /// The meetings that set the scale.
    ends_of: Encounters<'a>,
    /// Whether all of these meetings have ended; no planned look is complete without them.
    stands: bool,
}

impl<'a> Matrix<'a> {
    /// With planned looks the ends of the scale are those of the first look, so that later seeds do not change an
    /// earlier verdict.
    fn of(
        spec: &'a CrossPlayTable,
        results: &Results,
        encounters: &'a Encounters<'a>,
        [rows, columns]: [&[&str]; 2],
    ) -> Self {
        let first = results.limits().first().copied();
        let ends_of = encounters.until(first.unwrap_or(u64::MAX));
        Self {
            spec,
            encounters,
            scale: spec.normalise.then(|| Scale::of(spec, &ends_of, rows, columns)),
            ends_of,
            stands: results.seeds_of(&encounters.trials(&[])).complete() > 0,
        }
    }

    fn cell(&self, casting: &[(&str, &str)], results: &Results) -> Cell {
        let scope = Scope {
            trials: self.encounters.trials(casting),
        };
        let mut missing = scope.absences();
        let raw = self.encounters.by_seed(casting, &self.spec.value);
        let seeds = self.scaled(&raw);
        if seeds.len() < raw.len() {
            missing.push(MissingSeeds::of(MissingReason::AllAlike));
        }
        let mut cell = Cell {
            planned: scope.planned(),
            failed: scope.failed(),
            missing,
            fixed: self.is_end(casting).then_some(FixedReason::Ends),
            ..Cell::resting_on(&scope.trials, results)
        };
        if self.scale.is_some() && !self.stands {
            cell.looks.limits.clear();
        }
        let as_of = |limit: u64| {
            let raw = self.encounters.until(limit).by_seed(casting, &self.spec.value);
            (limit, self.scaled(&raw))
        };
        let as_of = match cell.looks.design {
            Some(_) => cell.looks.limits().into_iter().map(as_of).collect(),
            None => BTreeMap::new(),
        };
        summarise(seeds, Statistic::Mean, Cell { as_of, ..cell })
    }

    fn scaled(&self, raw: &BTreeMap<u64, f64>) -> Vec<(u64, f64)> {
        let scaled = |value| self.scale.map_or(Some(value), |scale| scale.apply(value));
        raw.iter()
            .filter_map(|(seed, value)| Some((*seed, scaled(*value)?)))
            .collect()
    }

    /// Whether a cell is 0 or 1 because it sets the scale.
    fn is_end(&self, casting: &[(&str, &str)]) -> bool {
        let values = || self.ends_of.by_seed(casting, &self.spec.value).into_values();
        self.scale
            .is_some_and(|scale| scale.is_end(&values().collect::<Vec<_>>()))
    }
}

fn headings(spec: &CrossPlayTable, names: &[Option<String>]) -> Vec<Heading> {
    let heading = |name: &Option<String>| {
        let name = name.as_deref().unwrap_or(MEAN);
        Heading::of(name, label(spec, name))
    };
    names.iter().map(heading).collect()
}

fn label<'a>(spec: &'a CrossPlayTable, name: &'a str) -> &'a str {
    spec.labels.get(name).map_or(name, String::as_str)
}

fn quantity(spec: &CrossPlayTable) -> String {
    let value = spec
        .labels
        .get(&spec.value)
        .cloned()
        .unwrap_or_else(|| spec.value.replace('_', " "));
    if spec.normalise {
        format!("{value}, min-max normalised over the cells")
    } else {
        value
    }
}

fn notes(matrix: &Matrix<'_>, floors: bool, results: &Results) -> Vec<String> {
    let spec = matrix.spec;
    let mut notes = vec![format!(
        "Rows: who plays {}; columns: who plays {}. Means are over the opponents, seed by seed.",
        label(spec, &spec.rows),
        label(spec, &spec.columns)
    )];
    if matrix.encounters.is_crossed() {
        notes.push(
            "Every seed of one agent meets every seed of the other. What stands for a seed is the mean over \
             all meetings with what it adds in each role; their mean is that of all meetings, and their \
             spread counts the seeds of both sides."
                .into(),
        );
    }
    if floors {
        notes.push(
            "Agents that were not trained are shown beside; they have no part in the means of others or in \
             the scale."
                .into(),
        );
    }
    let scale = matrix.scale.filter(|scale| scale.high > scale.low);
    notes.extend(scale.map(|scale| scale.in_words(results.design.as_ref())));
    notes.extend(scale.and_then(|scale| scale.lack_in_words()));
    notes
}

#[cfg(test)]
mod tests;
