//! The matrix of a play: who played one role along the rows, who played another along the columns, and both
//! means.

use super::{
    Cell, Fixed, Grid, Heading, Missing, NoValue, NumberFormat, Quantity, Scope, Statistic, Table,
    comparison::summarise, problem,
};
use crate::{
    Error,
    cross_play::Encounters,
    diagnostic::suggest,
    results::Results,
    spec::names::{Names, Place},
    statistics::estimators::mean,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Heading of the row and the column of means.
pub const MEAN: &str = "mean";

/// A metric of a play by who played which role.
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
    /// Whether the smallest mean of a cell becomes 0 and the largest 1; agents that were not trained have no
    /// part in this.
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

impl Table for CrossPlayTable {
    fn example() -> &'static str {
        "{ play: tag, rows: chaser, columns: runner, value: return, normalise: false }"
    }

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
    let world = names.world;
    let Some(play) = world.plays.iter().find(|play| play.name == spec.play) else {
        let help = suggest(&spec.play, world.plays.iter().map(|play| play.name.as_str()));
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

/// Which trials a cell is made of: agents by role. A role that is left out is played by every agent that was
/// trained.
type Casting<'a> = Vec<(&'a str, &'a str)>;

/// Computes the matrix. The mean of a row or column is over trained opponents, seed by seed.
///
/// # Errors
/// [`Error::Render`] where the results know no such play or role.
fn build(spec: &CrossPlayTable, results: &Results) -> Result<Grid, Error> {
    let encounters = Encounters::of(results, &spec.play);
    let (rows, columns) = (encounters.players(&spec.rows), encounters.players(&spec.columns));
    if rows.is_empty() || columns.is_empty() {
        let (play, rows, columns) = (&spec.play, &spec.rows, &spec.columns);
        return Err(problem(&format!(
            "no trial of the play `{play}` has the roles `{rows}` and `{columns}`"
        )));
    }
    let scale = if spec.normalise {
        Some(Scale::of(spec, &encounters, &rows, &columns))
    } else {
        None
    };
    let cell = |row: Option<&str>, column: Option<&str>| {
        let casting: Casting<'_> = [(spec.rows.as_str(), row), (spec.columns.as_str(), column)]
            .into_iter()
            .filter_map(|(role, it)| Some((role, it?)))
            .collect();
        if casting.is_empty() {
            Cell::default()
        } else {
            make_cell(spec, &encounters, &casting, scale.as_ref(), results)
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
        notes: notes(spec, scale.as_ref(), floors, encounters.is_crossed()),
        cells,
        ..Grid::default()
    })
}

/// What becomes 0 and 1.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scale {
    low: f64,
    high: f64,
    /// Cells between trained agents, and how many of them have a value.
    n_cells: usize,
    n_known: usize,
}

impl Scale {
    /// The smallest and largest mean over seeds of a cell between agents that were trained.
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

    /// True for values whose mean is one of the two that make the scale.
    fn is_end(&self, values: &[f64]) -> bool {
        let mean = mean(values);
        mean == self.low || mean == self.high
    }

    /// `None` where all cells are alike, or fewer than two have a value.
    fn apply(&self, value: f64) -> Option<f64> {
        (self.high > self.low).then(|| (value - self.low) / (self.high - self.low))
    }
}

fn make_cell(
    spec: &CrossPlayTable,
    encounters: &Encounters<'_>,
    casting: &[(&str, &str)],
    scale: Option<&Scale>,
    results: &Results,
) -> Cell {
    let scope = Scope {
        trials: encounters.trials(casting),
    };
    let mut missing = scope.absences();
    let raw = encounters.by_seed(casting, &spec.value);
    let scaled = |value| scale.map_or(Some(value), |scale| scale.apply(value));
    let seeds: Vec<(u64, f64)> = raw
        .iter()
        .filter_map(|(seed, value)| Some((*seed, scaled(*value)?)))
        .collect();
    if seeds.len() < raw.len() {
        missing.push(Missing::of(NoValue::AllAlike));
    }
    let fixed = scale.is_some_and(|scale| scale.is_end(&raw.into_values().collect::<Vec<_>>()));
    let cell = Cell {
        planned: scope.planned(),
        failed: scope.failed(),
        missing,
        fixed: fixed.then_some(Fixed::Ends),
        ..Cell::resting_on(&scope.trials, results)
    };
    summarise(seeds, Statistic::Mean, cell)
}

fn headings(spec: &CrossPlayTable, names: &[Option<String>]) -> Vec<Heading> {
    let heading = |name: &Option<String>| {
        let name = name.clone().unwrap_or_else(|| MEAN.into());
        Heading {
            label: spec.labels.get(&name).cloned().unwrap_or_else(|| name.clone()),
            name,
        }
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

fn notes(spec: &CrossPlayTable, scale: Option<&Scale>, floors: bool, crossed: bool) -> Vec<String> {
    let mut notes = vec![format!(
        "Rows: who plays {}; columns: who plays {}. Means are over the opponents, seed by seed.",
        label(spec, &spec.rows),
        label(spec, &spec.columns)
    )];
    if crossed {
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
    if let Some(Scale {
        low,
        high,
        n_cells,
        n_known,
    }) = scale.filter(|scale| scale.high > scale.low)
    {
        let format = NumberFormat::fitting([*low, *high].into_iter());
        notes.push(format!(
            "0 stands for {} and 1 for {}.",
            format.write(*low),
            format.write(*high)
        ));
        if n_known < n_cells {
            notes.push(format!(
                "The scale is made of {n_known} of {n_cells} cells; it will move when the others have run."
            ));
        }
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        cross_play::tests::encounter,
        table::{Margin, Published, PublishedCell, TableSpec, build, csv, html, latex, markdown},
    };

    const AGENTS: [&str; 3] = ["tdom_ac", "rommeo", "pr2"];
    /// The matrix of the thesis, table 4.2, and its means.
    const PUBLISHED: [[f64; 4]; 3] = [
        [0.967, 1.0, 0.999, 0.989],
        [0.674, 0.997, 0.981, 0.884],
        [0.0, 0.722, 0.313, 0.345],
    ];
    const MEANS: [f64; 3] = [0.547, 0.906, 0.764];

    fn spec() -> CrossPlayTable {
        CrossPlayTable {
            play: "pursuit".into(),
            rows: "prey".into(),
            columns: "predators".into(),
            value: "score".into(),
            decimals: Some(3),
            ..CrossPlayTable::default()
        }
    }

    /// Scores that normalise to the published matrix: -70 becomes 0 and 30 becomes 1; seeds differ by 2.
    fn results(with_floor: bool) -> Results {
        let mut trials = Vec::new();
        for (prey, row) in AGENTS.iter().zip(PUBLISHED) {
            for (predators, value) in AGENTS.iter().zip(row) {
                trials.extend(
                    [(0, -1.0), (1, 1.0)]
                        .map(|(seed, shift)| encounter(prey, predators, seed, 100.0 * value - 70.0 + shift)),
                );
            }
            if with_floor {
                trials.push(encounter(prey, "still", 0, 500.0));
            }
        }
        Results::of(trials)
    }

    fn estimates(grid: &Grid) -> Vec<Vec<Option<f64>>> {
        let rounded = |cell: &Cell| cell.estimate.map(|estimate| (estimate * 1000.0).round() / 1000.0);
        grid.cells
            .iter()
            .map(|row| row.iter().map(rounded).collect())
            .collect()
    }

    #[test]
    fn the_published_matrix_comes_out_with_both_means() {
        let mut wanted: Vec<Vec<Option<f64>>> = PUBLISHED
            .iter()
            .map(|row| row.iter().copied().map(Some).collect())
            .collect();
        wanted.push(MEANS.into_iter().map(Some).chain([None]).collect());
        let grid = super::build(&spec(), &results(false)).unwrap();
        assert_eq!(estimates(&grid), wanted);
        // Seeds lie at 1 on both sides of the mean, 0.01 after scaling: t(0.975, 1) = 12.706 standard errors
        // of 0.01.
        let (low, high) = grid.cells[0][0].interval.unwrap();
        assert!((high - low - 2.0 * 0.12706).abs() < 1e-5 && grid.cells[0][0].seeds.len() == 2);
        let raw = super::build(
            &CrossPlayTable {
                normalise: false,
                ..spec()
            },
            &results(false),
        )
        .unwrap();
        assert_eq!(raw.cells[2][0].estimate, Some(-70.0));
    }

    #[test]
    fn a_floor_stands_beside_and_moves_nothing() {
        let grid = super::build(&spec(), &results(true)).unwrap();
        let columns: Vec<&str> = grid.columns.iter().map(|column| column.name.as_str()).collect();
        assert_eq!(columns, ["tdom_ac", "rommeo", "pr2", "still", MEAN]);
        assert_eq!(grid.cells[0][3].estimate, Some(5.7));
        assert_eq!(estimates(&grid)[0][4], Some(0.989));
    }

    #[test]
    fn what_lacks_is_said() {
        let mut results = results(false);
        for trial in &mut results.trials[..3] {
            trial.end = None;
            trial.rows.clear();
        }
        let grid = super::build(&spec(), &results).unwrap();
        assert_eq!(
            (
                grid.cells[0][0].estimate,
                grid.cells[0][0].planned,
                grid.cells[0][1].seeds.len()
            ),
            (None, 2, 1)
        );
        assert!(grid.cells[0][3].seeds.is_empty() && grid.cells[3][2].seeds.len() == 2);
        assert!(
            grid.notes.iter().any(|note| note.contains("8 of 9 cells")),
            "{:?}",
            grid.notes
        );
        let alike = Results::of(vec![encounter("a", "a", 0, 1.0), encounter("a", "b", 0, 1.0)]);
        let grid = super::build(&spec(), &alike).unwrap();
        assert!(
            grid.cells[0][0].estimate.is_none()
                && grid.cells[0][0].incompleteness().contains("no two cells differ")
        );
        assert!(
            super::build(
                &CrossPlayTable {
                    play: "chess".into(),
                    ..spec()
                },
                &alike
            )
            .is_err()
        );
    }

    #[test]
    fn every_renderer_writes_it_with_published_values_beside() {
        let columns = |row: [f64; 4]| {
            let names = AGENTS.into_iter().chain([MEAN]).map(String::from);
            Published::Columns(names.zip(row.map(PublishedCell::Value)).collect())
        };
        let mut published: BTreeMap<String, Published> = AGENTS
            .into_iter()
            .zip(PUBLISHED)
            .map(|(name, row)| (name.into(), columns(row)))
            .collect();
        let means = AGENTS
            .into_iter()
            .map(String::from)
            .zip(MEANS.map(PublishedCell::Value))
            .collect();
        published.insert(MEAN.into(), Published::Columns(means));
        let spec = TableSpec {
            published,
            margin: Some(Margin::Absolute(0.1)),
            ..TableSpec::of(spec())
        };
        let grid = build(&spec, &results(false)).unwrap();
        assert!(
            grid.notes.iter().all(|note| !note.contains("have no place")),
            "{:?}",
            grid.notes
        );
        insta::assert_snapshot!("cross_play_markdown", markdown(&grid));
        insta::assert_snapshot!("cross_play_latex", latex(&grid, "table-4.2"));
        for text in [
            csv(&grid).unwrap(),
            html(&grid),
            crate::table::terminal(&grid, 200),
        ] {
            assert!(text.contains("0.967") && text.contains(MEAN), "{text}");
        }
    }
}
