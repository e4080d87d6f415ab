//! One set of results: read from a report's folder, or taken from a study's present contents.

use super::{Named, settings};
use crate::{Contents, Manifest, Passed, Verdicts, file_slug};
use contract::Error;
use document::diagnostic::Sources;
use execution::world::fs;
use presentation::table::{Cell, Grid};
use serde::Serialize;
use serde_json::Value;
use std::{
    collections::BTreeMap,
    fmt, io,
    path::{Path, PathBuf},
};

/// One set of results, for a comparison.
#[derive(Debug, Clone, Default)]
pub struct Side {
    /// Origin of the results.
    pub named: Named,
    /// The cells of all tables.
    pub cells: BTreeMap<CellAddress, CellValues>,
    /// Verdicts on published values and claims.
    pub verdicts: Vec<Passed>,
    /// The leaves of the resolved study, by dotted key.
    pub settings: BTreeMap<String, Value>,
}

/// Address of a cell, by names that hold on both sides.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct CellAddress {
    /// Name of the table, as its files have it.
    pub table: String,
    /// Name of the row.
    pub row: String,
    /// Name of the column.
    pub column: String,
}

impl fmt::Display for CellAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}, {}", self.table, self.row, self.column)
    }
}

/// Values of a cell with their seeds.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct CellValues {
    /// Reduction of seeds to one number, in the words of the table's CSV file.
    pub statistic: String,
    /// The value; `None` where no seed has one.
    pub value: Option<f64>,
    /// 95 % interval of the value.
    pub interval: Option<(f64, f64)>,
    /// The number of every seed; empty where the value is not made of numbers by seed.
    pub seeds: BTreeMap<u64, f64>,
}

impl CellValues {
    /// The values in the order of their seeds.
    #[must_use]
    pub fn values(&self) -> Vec<f64> {
        self.seeds.values().copied().collect()
    }

    fn of(grid: &Grid, cell: &Cell) -> Self {
        Self {
            statistic: grid.one_number.name().into(),
            value: cell.estimate,
            interval: cell.interval,
            seeds: cell.seeds.iter().copied().collect(),
        }
    }
}

impl Side {
    /// The side of a study's present contents.
    #[must_use]
    pub fn of(named: Named, contents: &Contents, verdicts: Verdicts, resolved: &Value) -> Self {
        let mut cells = BTreeMap::new();
        let grids = contents
            .tables
            .iter()
            .filter_map(|(name, grid)| Some((name, grid.as_ref().ok()?)));
        for (name, grid) in grids {
            for (row, line) in grid.rows.iter().zip(&grid.cells) {
                for (column, cell) in grid.columns.iter().zip(line) {
                    let place = CellAddress {
                        table: file_slug(name),
                        row: row.name.clone(),
                        column: column.name.clone(),
                    };
                    cells.insert(place, CellValues::of(grid, cell));
                }
            }
        }
        Self {
            named,
            cells,
            verdicts: verdicts.verdicts,
            settings: settings::flat(resolved),
        }
    }

    /// The side of a report in a folder, labelled with `from`. `None` where the folder has no report.
    ///
    /// # Errors
    /// [`Error::File`] where a file cannot be read, [`Error::Input`] where one does not fit the form of a report.
    pub fn read(folder: &Path, from: &str) -> Result<Option<Self>, Error> {
        let verdicts = match read(&folder.join("verdicts.json"))? {
            Some(text) => Some(parse_verdicts(&folder.join("verdicts.json"), &text)?),
            None => None,
        };
        let cells = cells(&folder.join("tables"))?;
        if verdicts.is_none() && cells.is_empty() {
            return Ok(None);
        }
        let settings = match read(&folder.join("resolved.yaml"))? {
            Some(text) => settings::flat(&parse_study(&folder.join("resolved.yaml"), &text)?),
            None => BTreeMap::new(),
        };
        let verdicts = verdicts.unwrap_or_default();
        let named = Named {
            from: from.into(),
            study: verdicts.study,
            options: Manifest::read(folder)
                .map(|manifest| manifest.options)
                .unwrap_or_default(),
        };
        Ok(Some(Self {
            named,
            cells,
            verdicts: verdicts.verdicts,
            settings,
        }))
    }
}

/// A study that was written out, as data.
///
/// # Errors
/// [`Error::Input`] where it is no YAML.
pub fn parse_study(path: &Path, text: &str) -> Result<Value, Error> {
    let mut sources = Sources::default();
    let source = sources.add_file(&path.display().to_string(), text);
    let node = document::parse(&sources, source, text).map_err(|problems| {
        let problem = problems
            .first()
            .map_or_else(String::new, |first| first.message.clone());
        input(path, format!("it is no YAML: {problem}"))
    })?;
    Ok(node.to_value())
}

fn parse_verdicts(path: &Path, text: &str) -> Result<Verdicts, Error> {
    serde_json::from_str(text).map_err(|error| input(path, format!("it holds no verdicts: {error}")))
}

/// The text of a file; `None` where it does not exist.
fn read(path: &Path) -> Result<Option<String>, Error> {
    match fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Error::file("read", path)(error)),
    }
}

/// The cells of all tables of a folder.
fn cells(folder: &Path) -> Result<BTreeMap<CellAddress, CellValues>, Error> {
    let mut cells = BTreeMap::new();
    for name in execution::store::names(folder)? {
        let Some(table) = name.strip_suffix(".csv") else {
            continue;
        };
        let path = folder.join(&name);
        let Some(lines) = lines(&path, "statistic")? else {
            continue;
        };
        let by_seed = lines_by_seed(&folder.join(format!("{table}-seeds.csv")))?;
        for line in lines {
            let place = line.place(table);
            let seeds = by_seed.get(&place).cloned().unwrap_or_default();
            cells.insert(place, line.measured(seeds)?);
        }
    }
    Ok(cells)
}

/// Numbers by seed of every cell of a table.
fn lines_by_seed(path: &Path) -> Result<BTreeMap<CellAddress, BTreeMap<u64, f64>>, Error> {
    let mut cells: BTreeMap<CellAddress, BTreeMap<u64, f64>> = BTreeMap::new();
    let table = path.file_name().unwrap_or_default().to_string_lossy();
    let table = table.trim_end_matches("-seeds.csv");
    for line in lines(path, "seed")?.unwrap_or_default() {
        if let (Some(seed), Some(value)) = (line.number("seed")?, line.number("value")?) {
            cells.entry(line.place(table)).or_default().insert(seed, value);
        }
    }
    Ok(cells)
}

/// A line of a CSV file that a report wrote.
struct CsvLine {
    path: PathBuf,
    number: u64,
    fields: BTreeMap<String, String>,
}

/// The lines of a file whose third column has this name, as in files of reports; `None` for any other file, and for
/// one that does not exist.
fn lines(path: &Path, third: &str) -> Result<Option<Vec<CsvLine>>, Error> {
    let Some(text) = read(path)? else {
        return Ok(None);
    };
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let wrong = |error: csv::Error| {
        let line = error.position().map(csv::Position::line);
        Error::Input {
            path: path.into(),
            line,
            column: None,
            problem: error.to_string(),
        }
    };
    let head: Vec<String> = reader.headers().map_err(wrong)?.iter().map(Into::into).collect();
    if head.first().is_none_or(|first| first != "row") || head.get(2).is_none_or(|name| name != third) {
        return Ok(None);
    }
    let line = |(record, number): (Result<csv::StringRecord, csv::Error>, u64)| {
        let fields = head
            .iter()
            .cloned()
            .zip(record?.iter().map(String::from))
            .collect();
        let path = path.to_owned();
        Ok(CsvLine { path, number, fields })
    };
    reader
        .records()
        .zip(2..)
        .map(line)
        .collect::<Result<_, _>>()
        .map(Some)
        .map_err(wrong)
}

impl CsvLine {
    fn text(&self, column: &str) -> &str {
        self.fields.get(column).map_or("", String::as_str)
    }

    fn place(&self, table: &str) -> CellAddress {
        CellAddress {
            table: table.into(),
            row: self.text("row").into(),
            column: self.text("column").into(),
        }
    }

    /// The number in a column; `None` where the field is empty.
    fn number<T: std::str::FromStr>(&self, column: &str) -> Result<Option<T>, Error> {
        let text = self.text(column);
        let wrong = |_| Error::Input {
            path: self.path.clone(),
            line: Some(self.number),
            column: Some(column.into()),
            problem: format!("`{text}` is no number"),
        };
        (!text.is_empty())
            .then(|| text.parse().map_err(wrong))
            .transpose()
    }

    fn measured(&self, seeds: BTreeMap<u64, f64>) -> Result<CellValues, Error> {
        let ends: (Option<f64>, Option<f64>) = (self.number("low")?, self.number("high")?);
        Ok(CellValues {
            statistic: self.text("statistic").into(),
            value: self.number("value")?,
            interval: ends.0.zip(ends.1),
            seeds,
        })
    }
}

fn input(path: &Path, problem: String) -> Error {
    Error::Input {
        path: path.into(),
        line: None,
        column: None,
        problem,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::StudyInfo;
    use presentation::table::{Axis, Comparison, TableSpec};
    use testing::synthetic::study;

    fn info() -> StudyInfo {
        let comparison = Comparison {
            rows: Axis::Environment.into(),
            value: "cycle_length".into(),
            agents: vec!["dsac".into(), "ddpg".into()],
            ..Comparison::default()
        };
        StudyInfo {
            name: "small".into(),
            tables: vec![("table/one".into(), TableSpec::of(comparison))],
            ..StudyInfo::default()
        }
    }

    /// A report's files hold the same values as the contents, to the last bit.
    #[test]
    fn a_folder_holds_what_the_study_holds() {
        let (info, results, dir) = (info(), study(), tempfile::tempdir().unwrap());
        let mut contents = Contents::judged(&info, &results);
        crate::write(
            dir.path(),
            &info,
            &results,
            &mut contents,
            &crate::Provenance::default(),
        )
        .unwrap();
        let read = Side::read(dir.path(), "here").unwrap().unwrap();
        let verdicts = Verdicts::of(&info, &results, &contents);
        let own = Side::of(read.named.clone(), &contents, verdicts, &Value::Null);
        assert_eq!(read.cells, own.cells);
        assert_eq!((read.cells.len(), read.named.study.as_str()), (4, "small"));
        let first = read.cells.keys().next().unwrap();
        assert_eq!(first.to_string(), "table-one: eight_cells, ddpg");
        assert_eq!(read.cells[first].seeds.len(), 3);
    }

    #[test]
    fn a_folder_without_results_is_none_and_a_broken_one_is_named() {
        let dir = tempfile::tempdir().unwrap();
        assert!(Side::read(dir.path(), "here").unwrap().is_none());
        fs::create_dir(dir.path().join("tables")).unwrap();
        let file = dir.path().join("tables/t.csv");
        fs::write(&file, "a,b\n1,2\n").unwrap();
        assert!(
            Side::read(dir.path(), "here").unwrap().is_none(),
            "a table of somebody else"
        );
        fs::write(&file, "row,column,statistic,value,low,high\nx,y,mean,many,,\n").unwrap();
        let error = Side::read(dir.path(), "here").unwrap_err().to_string();
        assert!(
            error.contains("t.csv`, line 2, column `value`: `many` is no number"),
            "{error}"
        );
        fs::remove_file(file).unwrap();
        fs::write(dir.path().join("verdicts.json"), "{").unwrap();
        let error = Side::read(dir.path(), "here").unwrap_err().to_string();
        assert!(
            error.contains("verdicts.json") && error.contains("holds no verdicts"),
            "{error}"
        );
    }
}
