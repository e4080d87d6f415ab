//! Given actions, read from a CSV file.

use super::columns::{action_names, blank_action};
use contract::{Action, Error, Seat};
use document::input_file::{self, Use};
use std::{collections::BTreeMap, path::Path};

/// Reads actions for the seats of an environment from a CSV file whose columns are the action channels, in
/// any order.
///
/// # Errors
/// [`Error::Input`] with file, line and column for a missing, unknown or duplicate column, a line of another length,
/// and a cell that is not a number; [`Error::File`] if the file cannot be read.
pub fn read_actions(seats: &[Seat], path: &Path) -> Result<Vec<Action>, Error> {
    let file = input_file::open(path, Use::Text).map_err(Error::file("read", path))?;
    let mut reader = csv::Reader::from_reader(file);
    let header = reader
        .headers()
        .map_err(|source| unreadable(path, source))?
        .clone();
    let places: BTreeMap<String, (usize, usize)> = action_names(seats).into_iter().collect();
    let known = |name: &str| {
        places
            .get(name)
            .copied()
            .ok_or_else(|| unknown_column(path, name, &places))
    };
    let columns = header.iter().map(known).collect::<Result<Vec<_>, _>>()?;
    for (name, place) in &places {
        let problem = match columns.iter().filter(|column| *column == place).count() {
            0 => format!("column `{name}` is missing"),
            1 => continue,
            _ => format!("column `{name}` is there twice"),
        };
        return Err(Error::Input {
            path: path.into(),
            line: Some(1),
            column: None,
            problem,
        });
    }
    let row = |record: Result<csv::StringRecord, csv::Error>| {
        parse_row(
            seats,
            &columns,
            &record.map_err(|source| unreadable(path, source))?,
            &header,
            path,
        )
    };
    reader.records().map(row).collect()
}

fn parse_row(
    seats: &[Seat],
    columns: &[(usize, usize)],
    record: &csv::StringRecord,
    header: &csv::StringRecord,
    path: &Path,
) -> Result<Action, Error> {
    let mut action = blank_action(seats);
    for ((&(seat, entry), cell), name) in columns.iter().zip(record).zip(header) {
        let number = cell.trim().parse().ok().filter(|number: &f64| number.is_finite());
        action[seat][entry] = number.ok_or_else(|| Error::Input {
            path: path.into(),
            line: record.position().map(csv::Position::line),
            column: Some(name.into()),
            problem: format!("`{cell}` is no number"),
        })?;
    }
    Ok(action)
}

fn unknown_column(path: &Path, name: &str, places: &BTreeMap<String, (usize, usize)>) -> Error {
    let known = places.keys().cloned().collect::<Vec<_>>().join(", ");
    let problem = format!("this is no action of the environment; its actions: {known}");
    Error::Input {
        path: path.into(),
        line: Some(1),
        column: Some(name.into()),
        problem,
    }
}

fn unreadable(path: &Path, source: csv::Error) -> Error {
    let line = source.position().map(csv::Position::line);
    let problem = match source.into_kind() {
        csv::ErrorKind::Io(source) => return Error::file("read", path)(source),
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => format!("{len} cells in place of {expected_len}"),
        csv::ErrorKind::Utf8 { .. } => "this is no UTF-8 text".into(),
        other => format!("{other:?}"),
    };
    Error::Input {
        path: path.into(),
        line,
        column: None,
        problem,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::Space;

    fn read(bytes: &[u8]) -> Result<Vec<Action>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("weights.csv");
        std::fs::write(&path, bytes).unwrap();
        let action = Space::Simplex(vec!["weight_1".into(), "weight_2".into()]);
        let seats = [Seat {
            name: String::new(),
            observation: Space::Box(Vec::new()),
            action,
        }];
        let folder = format!("{}/", folder.path().display());
        read_actions(&seats, &path).map_err(|error| error.to_string().replace(&folder, ""))
    }

    #[test]
    fn columns_may_stand_in_any_order() {
        assert_eq!(
            read(b"weight_2,weight_1\n0.25, 0.75\n1,0\n").unwrap(),
            [[[0.75, 0.25]], [[0.0, 1.0]]]
        );
    }

    #[test]
    fn what_is_wrong_is_said_with_its_place() {
        for (text, message) in [
            (
                &b"weight_1\n1\n"[..],
                "`weights.csv`, line 1: column `weight_2` is missing",
            ),
            (
                b"weight_1,weight_2,weight_1\n1,0,0\n",
                "`weights.csv`, line 1: column `weight_1` is there twice",
            ),
            (
                b"weight_1,share_2\n1,0\n",
                "`weights.csv`, line 1, column `share_2`: this is no action of the environment; its \
                 actions: weight_1, weight_2",
            ),
            (
                b"weight_1,weight_2\n1,0\n0.5,x\n",
                "`weights.csv`, line 3, column `weight_2`: `x` is no number",
            ),
            (
                b"weight_1,weight_2\nNaN,0\n",
                "`weights.csv`, line 2, column `weight_1`: `NaN` is no number",
            ),
            (
                b"weight_1,weight_2\n1,0\n1\n",
                "`weights.csv`, line 3: 1 cells in place of 2",
            ),
            (
                b"weight_1,weight_2\n1,\xff\n",
                "`weights.csv`, line 2: this is no UTF-8 text",
            ),
        ] {
            assert_eq!(read(text).unwrap_err(), message);
        }
        let error = read_actions(&[], Path::new("absent.csv")).unwrap_err();
        assert!(matches!(error, Error::File { doing: "read", .. }), "{error}");
    }
}
