//! One episode as a Parquet file: a row per decision, and one more for what was seen at the end.

use super::Episode;
use crate::{
    End, Error, Seat, Space,
    parquet::{self, Table, Values},
    world::fs,
};
use std::path::Path;

/// The file of an episode whose lengths fit the seat.
///
/// # Errors
/// [`Error::Damaged`] where a choice is no index.
pub(super) fn encode(episode: &Episode, seat: &Seat, path: &Path) -> Result<Vec<u8>, Error> {
    let n = episode.actions.len();
    let nothing_done = vec![0.0; seat.action.len()];
    let actions: Vec<&[f64]> = episode
        .actions
        .iter()
        .chain([&nothing_done])
        .map(Vec::as_slice)
        .collect();
    let observations = episode.observations.iter().map(Vec::as_slice).collect();
    let last = |end: End| (0..=n).map(|row| row + 1 == n && episode.end == end).collect();
    let columns = vec![
        ("observations", values(&seat.observation, observations, path)?),
        ("actions", values(&seat.action, actions, path)?),
        (
            "rewards",
            Values::F64(episode.rewards.iter().copied().chain([0.0]).collect()),
        ),
        ("terminations", Values::Bool(last(End::Terminated))),
        ("truncations", Values::Bool(last(End::Truncated))),
    ];
    parquet::encode(path, columns, &[])
}

/// Rows of a space; a choice is stored as a whole number.
fn values<'a>(space: &Space, rows: Vec<&'a [f64]>, path: &Path) -> Result<Values<'a>, Error> {
    if !matches!(space, Space::Discrete(_)) {
        return Ok(Values::Vectors(rows));
    }
    let index = |row: &&[f64]| {
        #[allow(
            clippy::cast_possible_truncation,
            reason = "a number of choices is far below 2^52"
        )]
        let index = row[0] as i64;
        #[allow(clippy::cast_precision_loss, reason = "as above")]
        let is_index = index as f64 == row[0];
        if is_index {
            Ok(index)
        } else {
            Err(damaged(
                path,
                format!("a choice is {}, which is no index", row[0]),
            ))
        }
    };
    Ok(Values::I64(rows.iter().map(index).collect::<Result<_, _>>()?))
}

/// Reads the file of an episode of a seat.
///
/// # Errors
/// [`Error::File`] where it is missing, [`Error::Damaged`] where it is something else.
pub(super) fn read(path: &Path, seat: &Seat) -> Result<Episode, Error> {
    let bytes = fs::read(path).map_err(Error::file("read", path))?;
    let table = Table::decode(bytes, path)?;
    let mut actions = rows(&table, "actions", &seat.action, path)?;
    let mut rewards = full(table.f64s("rewards")?, "rewards", path)?;
    actions.pop();
    rewards.pop();
    let terminations = full(table.bools("terminations")?, "terminations", path)?;
    let truncations = full(table.bools("truncations")?, "truncations", path)?;
    let end = end(&terminations, &truncations)
        .ok_or_else(|| damaged(path, "it does not end with its last decision"))?;
    let episode = Episode {
        observations: rows(&table, "observations", &seat.observation, path)?,
        actions,
        rewards,
        end,
    };
    match episode.misfit(seat) {
        None => Ok(episode),
        Some(problem) => Err(damaged(path, problem)),
    }
}

fn rows(table: &Table<'_>, name: &str, space: &Space, path: &Path) -> Result<Vec<Vec<f64>>, Error> {
    #[allow(clippy::cast_precision_loss, reason = "a number of choices is far below 2^52")]
    let choice = |index: i64| vec![index as f64];
    match space {
        Space::Discrete(_) => Ok(full(table.i64s(name)?, name, path)?
            .into_iter()
            .map(choice)
            .collect()),
        Space::Box(_) | Space::Simplex(_) | Space::Choices(_) => {
            full(table.vectors(name)?.into_iter(), name, path)
        }
    }
}

/// How an episode ended; `None` where that is not said of its last decision, and of that alone.
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
