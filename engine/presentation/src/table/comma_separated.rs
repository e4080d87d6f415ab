//! A table as comma-separated values in long form: one line per cell, all digits.

use super::{Cell, Grid};
use contract::Error;
use statistics::Verdict;
use std::borrow::Cow;

const HEADER: [&str; 13] = [
    "row",
    "column",
    "statistic",
    "n",
    "planned",
    "value",
    "sd",
    "low",
    "high",
    "published",
    "verdict",
    "verdict_holm",
    "missing",
];

/// One line per cell under a header; fields without a number are empty.
///
/// # Errors
/// [`Error::Render`] if the writer refuses, which a buffer in memory does not do.
pub fn csv(grid: &Grid) -> Result<String, Error> {
    let mut lines = vec![HEADER.map(String::from).to_vec()];
    for (row, cells) in grid.rows.iter().zip(&grid.cells) {
        for (column, cell) in grid.columns.iter().zip(cells) {
            let mut line = vec![
                row.name.clone(),
                column.name.clone(),
                grid.one_number.name().into(),
            ];
            line.extend(fields(cell));
            lines.push(line);
        }
    }
    write(lines)
}

fn fields(cell: &Cell) -> [String; 10] {
    let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    [
        cell.seeds.len().to_string(),
        cell.planned.to_string(),
        number(cell.estimate),
        number(cell.sd),
        number(cell.interval.map(|interval| interval.0)),
        number(cell.interval.map(|interval| interval.1)),
        number(cell.published()),
        cell.verdict().map_or("", Verdict::word).into(),
        cell.judgement
            .as_ref()
            .and_then(|judgement| judgement.adjusted)
            .map_or("", Verdict::word)
            .into(),
        cell.missing
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>()
            .join("; "),
    ]
}

/// A field as a cell of a spreadsheet. Text that a spreadsheet would compute gets an apostrophe before it and stays
/// text; numbers stay numbers.
#[must_use]
pub fn guarded(field: &str) -> Cow<'_, str> {
    let computed = field.starts_with(['=', '+', '-', '@', '\t', '\r', '\n']);
    // A sign alone is no formula.
    if computed && field.len() > 1 && field.parse::<f64>().is_err() {
        Cow::Owned(format!("'{field}"))
    } else {
        Cow::Borrowed(field)
    }
}

/// Lines of fields as comma-separated values, quoted where needed.
///
/// # Errors
/// [`Error::Render`] if the writer refuses, which a buffer in memory does not do.
pub fn write<L: AsRef<[String]>>(lines: impl IntoIterator<Item = L>) -> Result<String, Error> {
    let refused = |problem: String| Error::Render {
        what: "comma-separated values".into(),
        problem,
    };
    let mut writer = csv::WriterBuilder::new().flexible(true).from_writer(Vec::new());
    for line in lines {
        for field in line.as_ref() {
            writer
                .write_field(guarded(field).as_bytes())
                .map_err(|error| refused(error.to_string()))?;
        }
        writer
            .write_record(None::<&[u8]>)
            .map_err(|error| refused(error.to_string()))?;
    }
    let bytes = writer.into_inner().map_err(|error| refused(error.to_string()))?;
    String::from_utf8(bytes).map_err(|error| refused(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_spreadsheet_computes_a_name() {
        let fields = [
            "=2+2", "+a", "-b", "@c", "\td", "-1.5", "+3", "-inf", "e=f", "+", "",
        ]
        .map(String::from);
        let written = write([fields]).unwrap();
        assert_eq!(written.trim_end(), "'=2+2,'+a,'-b,'@c,'\td,-1.5,+3,-inf,e=f,+,");
    }
}
