//! Reads HDF5 in the layout of the published N-CMAPSS files.
//!
//! | dataset | shape | content |
//! |---|---|---|
//! | `W_dev`, `X_s_dev`, `X_v_dev`, `T_dev`, `A_dev` | `[samples, columns]` | flight conditions, sensors, virtual sensors, health, unit and cycle |
//! | the same with `_test` | `[samples, columns]` | the same for the held-out units |
//! | `W_var`, `X_s_var`, ... | `[columns]` | names of the columns |
//!
//! Files of gigabytes are read in blocks of rows. Rows are counted from 1, those for testing after the others.

use super::files::Row;
use contract::Error;
use document::reach::quoted_names;
use hdf5_reader::{Dataset, Hdf5File, SliceInfo, SliceInfoElem};
use std::path::Path;

const GROUPS: [&str; 5] = ["A", "W", "X_s", "X_v", "T"];
const PARTS: [&str; 2] = ["dev", "test"];
/// Rows in one block.
const ROWS: u64 = 65_536;

/// Reads some columns, row by row.
///
/// # Errors
/// [`Error::Damaged`] for another layout, [`Error::Input`] where a column is missing or holds an entry that is
/// not a number, and the errors of `row`.
pub(super) fn read(path: &Path, names: &[&str], row: &mut Row<'_>) -> Result<(), Error> {
    let file = Hdf5File::open(path).map_err(|error| damaged(path, &error))?;
    let places = places(path, &file, names)?;
    let mut line = 0;
    for part in PARTS {
        read_part(path, &file, (part, &places, names), &mut line, row)?;
    }
    Ok(())
}

/// The group of each requested column and its position there.
fn places(path: &Path, file: &Hdf5File, names: &[&str]) -> Result<Vec<(usize, usize)>, Error> {
    let mut known = Vec::new();
    for (group, name) in GROUPS.iter().enumerate() {
        let named = file.dataset(&format!("{name}_var"));
        let columns = named
            .and_then(|it| it.read_strings())
            .map_err(|error| damaged(path, &error))?;
        known.extend(
            columns
                .into_iter()
                .enumerate()
                .map(|(place, it)| (it, (group, place))),
        );
    }
    let place = |name: &&str| {
        let found = known
            .iter()
            .find(|(it, _)| it.trim_end_matches('\0').trim() == *name);
        found.map(|(_, place)| *place).ok_or_else(|| {
            let known: Vec<&str> = known.iter().map(|(it, _)| it.as_str()).collect();
            let problem = format!("is missing; there are {}", quoted_names(path, known));
            wrong(path, None, name, problem)
        })
    };
    names.iter().map(place).collect()
}

fn read_part(
    path: &Path,
    file: &Hdf5File,
    (part, places, names): (&str, &[(usize, usize)], &[&str]),
    line: &mut u64,
    row: &mut Row<'_>,
) -> Result<(), Error> {
    let open = |group: &&str| file.dataset(&format!("{group}_{part}"));
    let datasets = GROUPS.iter().map(open).collect::<Result<Vec<_>, _>>();
    let datasets = datasets.map_err(|error| damaged(path, &error))?;
    let n_rows = n_rows(path, part, &datasets)?;
    let mut values = vec![0.0; names.len()];
    for first in (0..n_rows).step_by(ROWS as usize) {
        let count = ROWS.min(n_rows - first);
        let pieces = datasets.iter().map(|dataset| piece(path, dataset, first, count));
        let pieces = pieces.collect::<Result<Vec<_>, Error>>()?;
        for index in 0..count as usize {
            *line += 1;
            for ((value, (group, place)), name) in values.iter_mut().zip(places).zip(names) {
                let (numbers, width) = &pieces[*group];
                *value = numbers[index * width + place];
                if !value.is_finite() {
                    return Err(wrong(path, Some(*line), name, format!("`{value}` is no number")));
                }
            }
            row(*line, &values)?;
        }
    }
    Ok(())
}

/// Number of rows of a part, which all its datasets share.
fn n_rows(path: &Path, part: &str, datasets: &[Dataset]) -> Result<u64, Error> {
    let rows: Vec<u64> = datasets
        .iter()
        .map(|it| it.shape().first().copied().unwrap_or(0))
        .collect();
    if datasets.iter().any(|it| it.ndim() != 2) || rows.iter().any(|it| *it != rows[0]) {
        let shapes: Vec<String> = GROUPS
            .iter()
            .zip(datasets)
            .map(|(group, it)| format!("{group}_{part} {:?}", it.shape()))
            .collect();
        return Err(damaged(
            path,
            &format!("tables of other lengths: {}", shapes.join(", ")),
        ));
    }
    Ok(rows[0])
}

/// Consecutive rows of a dataset, and their width. Numbers may have single precision.
fn piece(path: &Path, dataset: &Dataset, first: u64, count: u64) -> Result<(Vec<f64>, usize), Error> {
    let width = dataset.shape()[1];
    let slice = |start, end| SliceInfoElem::Slice { start, end, step: 1 };
    let selection = SliceInfo {
        selections: vec![slice(first, first + count), slice(0, width)],
    };
    let numbers = dataset
        .read_slice::<f64>(&selection)
        .map(|it| it.into_iter().collect());
    let single = || {
        dataset
            .read_slice::<f32>(&selection)
            .map(|it| it.into_iter().map(f64::from).collect())
    };
    let numbers: Result<Vec<f64>, _> = numbers.or_else(|_| single());
    Ok((numbers.map_err(|error| damaged(path, &error))?, width as usize))
}

fn damaged(path: &Path, problem: &dyn std::fmt::Display) -> Error {
    Error::Damaged {
        path: path.into(),
        problem: problem.to_string(),
    }
}

fn wrong(path: &Path, line: Option<u64>, column: &str, problem: String) -> Error {
    Error::Input {
        path: path.into(),
        line,
        column: Some(column.into()),
        problem,
    }
}
