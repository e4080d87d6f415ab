//! Reads rows of numbers from the files of recordings.

#[cfg(feature = "hdf5")]
use contract::panics::or_damaged;
use contract::{DataFile, Error, FileFormat};
use document::reach::{quoted, quoted_names};

/// Receives every row: its line (in CSV, from 1 with the header) or number, and the values of the columns.
pub(super) type Row<'a> = dyn FnMut(u64, &[f64]) -> Result<(), Error> + 'a;

/// Reads some columns of a file, row by row.
///
/// # Errors
/// [`Error::File`], [`Error::Damaged`] and [`Error::Input`] for a file that cannot be read or has another
/// format, a missing column or an entry that is not a number; and the errors of `row`.
pub(super) fn read(file: &DataFile, names: &[&str], row: &mut Row<'_>) -> Result<(), Error> {
    match file.format()? {
        // For unknown bytes, the reader of text reports their position.
        FileFormat::Text | FileFormat::Binary => csv(file, names, row),
        FileFormat::Parquet => parquet(file, names, row),
        #[cfg(feature = "hdf5")]
        FileFormat::Hdf5 => {
            or_damaged(file.path(), || super::hdf5::read(file.path(), names, row))?;
            file.unchanged()
        }
        #[cfg(not(feature = "hdf5"))]
        FileFormat::Hdf5 => Err(wrong(
            file,
            None,
            None,
            "this program was built without its feature `hdf5`; give CSV or Parquet in its place".into(),
        )),
    }
}

fn csv(file: &DataFile, names: &[&str], row: &mut Row<'_>) -> Result<(), Error> {
    let text = file.text()?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let unreadable = |error: csv::Error| {
        let line = error.position().map(csv::Position::line);
        wrong(file, line, None, error.to_string())
    };
    let header = reader.headers().map_err(unreadable)?.clone();
    let place = |name: &&str| {
        let found = header.iter().position(|column| column == *name);
        found.ok_or_else(|| {
            let problem = format!("is missing; there are {}", quoted_names(file.path(), &header));
            wrong(file, Some(1), Some(name), problem)
        })
    };
    let places = names.iter().map(place).collect::<Result<Vec<_>, _>>()?;
    let mut values = vec![0.0; names.len()];
    for record in reader.records() {
        let record = record.map_err(unreadable)?;
        let line = record.position().map_or(0, csv::Position::line);
        for ((value, place), name) in values.iter_mut().zip(&places).zip(names) {
            let cell = record.get(*place).unwrap_or_default();
            let number = cell.parse().ok().filter(|number: &f64| number.is_finite());
            *value = number.ok_or_else(|| no_number(file, line, name, cell))?;
        }
        row(line, &values)?;
    }
    Ok(())
}

fn parquet(file: &DataFile, names: &[&str], row: &mut Row<'_>) -> Result<(), Error> {
    let columns = file.parquet_columns(names)?;
    let mut values = vec![0.0; names.len()];
    for index in 0..columns.first().map_or(0, Vec::len) {
        let line = index as u64 + 1;
        for ((value, column), name) in values.iter_mut().zip(&columns).zip(names) {
            *value = column[index];
            if !value.is_finite() {
                return Err(no_number(file, line, name, &value.to_string()));
            }
        }
        row(line, &values)?;
    }
    Ok(())
}

fn no_number(file: &DataFile, line: u64, column: &str, cell: &str) -> Error {
    wrong(
        file,
        Some(line),
        Some(column),
        format!("`{}` is no number", quoted(file.path(), cell)),
    )
}

fn wrong(file: &DataFile, line: Option<u64>, column: Option<&str>, problem: String) -> Error {
    Error::Input {
        path: file.path().into(),
        line,
        column: column.map(Into::into),
        problem,
    }
}
