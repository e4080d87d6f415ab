//! One episode as a Parquet file: a row per decision, and one more for the observation at the end.

use super::{
    Episode,
    layout::{Layout, length},
};
use crate::{
    End, Error, panics,
    parquet::{self, ParquetTable, Values},
};
use std::{fs, path::Path};

/// The file of an episode whose lengths fit.
///
/// # Errors
/// [`Error::Damaged`] if a choice is no index.
pub(super) fn encode(episode: &Episode, layout: &Layout<'_>, path: &Path) -> Result<Vec<u8>, Error> {
    let (n, n_seats) = (episode.actions.len(), layout.seats().len());
    let nothing_done = vec![0.0; length(&layout.actions())];
    let nothing_earned = vec![0.0; n_seats];
    let observations = episode.observations.iter().map(Vec::as_slice).collect();
    let actions = episode.actions.iter().chain([&nothing_done]);
    let actions = actions.map(Vec::as_slice).collect();
    let earned: Vec<&[f64]> = episode
        .rewards
        .chunks(n_seats)
        .chain([nothing_earned.as_slice()])
        .collect();
    let last = |end: End| (0..=n).map(|row| row + 1 == n && episode.end == end).collect();
    let mut columns = vec![
        (
            "observations",
            values(layout.sees_choices, n_seats, observations, path)?,
        ),
        ("actions", values(layout.makes_choices, n_seats, actions, path)?),
        (
            "rewards",
            Values::F64(earned.iter().map(|row| mean(row)).collect()),
        ),
        ("terminations", Values::Bool(last(End::Terminated))),
        ("truncations", Values::Bool(last(End::Truncated))),
    ];
    if layout.is_of_several() {
        columns.push(("seat_rewards", Values::Vectors(earned)));
    }
    if layout.n_state() > 0 {
        let states = episode.states.iter().map(Vec::as_slice).collect();
        columns.push(("states", Values::Vectors(states)));
    }
    parquet::encode(path, columns, &[])
}

/// Reward of a team: the mean over its seats.
#[allow(clippy::cast_precision_loss, reason = "a number of seats is far below 2^52")]
fn mean(of_seats: &[f64]) -> f64 {
    match of_seats {
        [one] => *one,
        several => several.iter().sum::<f64>() / several.len() as f64,
    }
}

/// Rows of seats. Choices are stored as whole numbers, and those of one seat without a vector around them.
fn values<'a>(
    are_choices: bool,
    n_seats: usize,
    rows: Vec<&'a [f64]>,
    path: &Path,
) -> Result<Values<'a>, Error> {
    if !are_choices {
        return Ok(Values::Vectors(rows));
    }
    let row = |row: &[f64]| row.iter().map(|choice| index(*choice, path)).collect();
    let rows: Vec<Vec<i64>> = rows.into_iter().map(row).collect::<Result<_, _>>()?;
    Ok(if n_seats == 1 {
        Values::I64(rows.concat())
    } else {
        Values::WholeVectors(rows)
    })
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    reason = "a number of choices is far below 2^52"
)]
fn index(choice: f64, path: &Path) -> Result<i64, Error> {
    let index = choice as i64;
    if index as f64 == choice {
        Ok(index)
    } else {
        Err(damaged(path, format!("a choice is {choice}, which is no index")))
    }
}

/// Reads the file of an episode.
///
/// # Errors
/// [`Error::File`] if it is missing, [`Error::Damaged`] if it is no such file.
pub(super) fn read(path: &Path, layout: &Layout<'_>) -> Result<Episode, Error> {
    let bytes = fs::read(path).map_err(Error::file("read", path))?;
    panics::or_damaged(path, || decode(bytes, path, layout))
}

fn decode(bytes: Vec<u8>, path: &Path, layout: &Layout<'_>) -> Result<Episode, Error> {
    let table = ParquetTable::decode(bytes, path)?;
    let n_seats = layout.seats().len();
    let mut actions = rows(&table, "actions", layout.makes_choices, n_seats, path)?;
    let mut rewards = if layout.is_of_several() {
        full(table.vectors("seat_rewards")?.into_iter(), "seat_rewards", path)?
    } else {
        let of_one = full(table.f64s("rewards")?, "rewards", path)?;
        of_one.into_iter().map(|reward| vec![reward]).collect()
    };
    let states = if layout.n_state() > 0 {
        full(table.vectors("states")?.into_iter(), "states", path)?
    } else {
        Vec::new()
    };
    actions.pop();
    rewards.pop();
    let terminations = full(table.bools("terminations")?, "terminations", path)?;
    let truncations = full(table.bools("truncations")?, "truncations", path)?;
    let end = end(&terminations, &truncations)
        .ok_or_else(|| damaged(path, "it does not end with its last decision"))?;
    let episode = Episode {
        observations: rows(&table, "observations", layout.sees_choices, n_seats, path)?,
        actions,
        rewards: rewards.concat(),
        states,
        end,
    };
    match layout.misfit(&episode) {
        None => Ok(episode),
        Some(problem) => Err(damaged(path, problem)),
    }
}

fn rows(
    table: &ParquetTable<'_>,
    name: &str,
    are_choices: bool,
    n_seats: usize,
    path: &Path,
) -> Result<Vec<Vec<f64>>, Error> {
    #[allow(clippy::cast_precision_loss, reason = "a number of choices is far below 2^52")]
    let choice = |index: i64| index as f64;
    match (are_choices, n_seats) {
        (false, _) => full(table.vectors(name)?.into_iter(), name, path),
        (true, 1) => Ok(full(table.i64s(name)?, name, path)?
            .into_iter()
            .map(|index| vec![choice(index)])
            .collect()),
        (true, _) => Ok(full(table.whole_vectors(name)?.into_iter(), name, path)?
            .into_iter()
            .map(|row| row.into_iter().map(choice).collect())
            .collect()),
    }
}

/// End of an episode; `None` if the flags do not mark only its last decision.
fn end(terminations: &[bool], truncations: &[bool]) -> Option<End> {
    let said: Vec<(usize, End)> = [(terminations, End::Terminated), (truncations, End::Truncated)]
        .into_iter()
        .flat_map(|(column, end)| {
            column
                .iter()
                .enumerate()
                .filter(|(_, said)| **said)
                .map(move |(row, _)| (row, end))
        })
        .collect();
    match said.as_slice() {
        [(row, end)] if row + 2 == terminations.len() => Some(*end),
        _ => None,
    }
}

fn full<T>(cells: impl Iterator<Item = Option<T>>, name: &str, path: &Path) -> Result<Vec<T>, Error> {
    cells
        .collect::<Option<Vec<T>>>()
        .ok_or_else(|| damaged(path, format!("a cell of `{name}` is empty")))
}

fn damaged(path: &Path, problem: impl Into<String>) -> Error {
    Error::Damaged {
        path: path.to_path_buf(),
        problem: problem.into(),
    }
}
