//! A table as comma-separated values that a spreadsheet opens without running anything.

use super::table::{ExportCells, ExportColumn, ExportTable};
use contract::Error;
use execution::world::fs::File;
use std::{io::BufWriter, path::Path};

/// Sentence on [`guarded`] in the description of columns.
pub(super) const ABOUT_GUARD: &str = "a text that begins with = + - @ or a control character has an \
                                      apostrophe before it, so that no spreadsheet takes it for a formula";

/// Writes the table with a header; fields are quoted where needed.
///
/// # Errors
/// [`Error::File`] where the file cannot be written.
pub(super) fn write(table: &ExportTable<'_>, path: &Path) -> Result<(), Error> {
    let file = File::create(path).map_err(Error::file("create", path))?;
    let mut writer = csv::Writer::from_writer(BufWriter::new(file));
    let refused = |error: csv::Error| Error::file("write", path)(error.into());
    let names = table.columns.iter().map(|column| guarded(&column.name));
    writer.write_record(names).map_err(refused)?;
    for row in 0..table.trials.len() {
        let fields = table
            .columns
            .iter()
            .map(|column| field(column, table.place(column, row)));
        writer.write_record(fields).map_err(refused)?;
    }
    let file = writer
        .into_inner()
        .map_err(|error| Error::file("write", path)(error.into_error()))?;
    let file = file
        .into_inner()
        .map_err(|error| Error::file("write", path)(error.into_error()))?;
    file.sync_all().map_err(Error::file("flush", path))
}

/// Text of a cell: numbers have all their digits, and an empty cell is empty.
fn field(column: &ExportColumn<'_>, at: usize) -> String {
    match &column.cells {
        ExportCells::Text(cells) => cells[at].as_deref().map_or(String::new(), guarded),
        ExportCells::Count(cells) => shown(cells[at]),
        ExportCells::Whole(cells) => shown(cells[at]),
        ExportCells::Number(cells) => shown(cells[at]),
        ExportCells::Flag(cells) => shown(cells[at]),
    }
}

fn shown(value: Option<impl ToString>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}

/// A text as a cell; a text that a spreadsheet would compute is protected and stays text.
fn guarded(text: &str) -> String {
    if text.starts_with(['=', '+', '-', '@', '\t', '\r', '\n']) {
        format!("'{text}")
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formulas_stay_texts_and_numbers_stay_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        let text = |words: &[&'static str]| {
            ExportCells::Text(words.iter().map(|word| Some((*word).into())).collect())
        };
        let table = ExportTable {
            name: "table",
            about: "rows",
            trials: vec![0, 0, 1, 1, 1],
            columns: vec![
                ExportColumn::new("word", "", text(&["=1+1", "+a", "-a", "@a", "a, \"b\""])),
                ExportColumn::new(
                    "value",
                    "",
                    ExportCells::Number(vec![Some(-1.5), None, Some(1e-300), Some(0.1), Some(-0.0)]),
                ),
                ExportColumn::new("trial", "", text(&["first", "second"])).of_trials(),
                ExportColumn::new("whole", "", ExportCells::Whole(vec![Some(-7), None])).of_trials(),
            ],
        };
        write(&table, &path).unwrap();
        let written = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = written.lines().collect();
        assert_eq!(lines[0], "word,value,trial,whole");
        assert_eq!(lines[1..3], ["'=1+1,-1.5,first,-7", "'+a,,first,-7"]);
        assert!(
            lines[3].starts_with("'-a,0.000") && lines[3].ends_with("1,second,"),
            "{}",
            lines[3]
        );
        assert_eq!(lines[4..], ["'@a,0.1,second,", "\"a, \"\"b\"\"\",-0,second,"]);
    }
}
