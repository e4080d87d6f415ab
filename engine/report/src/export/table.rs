//! A table of typed columns, some with one cell per trial instead of one per row.

use contract::{
    Error,
    parquet::{self, Values},
};
use serde_json::{Value, json};
use std::{borrow::Cow, path::Path};

/// Cells of a column; `None` is an empty cell.
#[derive(Debug, Clone, PartialEq)]
pub enum ExportCells<'a> {
    /// Texts.
    Text(Vec<Option<Cow<'a, str>>>),
    /// Numbers of items.
    Count(Vec<Option<u64>>),
    /// Whole numbers of any sign.
    Whole(Vec<Option<i64>>),
    /// Floating-point numbers.
    Number(Vec<Option<f64>>),
    /// Truth values.
    Flag(Vec<Option<bool>>),
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportColumn<'a> {
    /// Name of the column.
    pub name: String,
    /// Description in one line.
    pub about: String,
    /// SI unit, empty where there is none.
    pub unit: String,
    /// Whether the column has a cell per trial, instead of one per row.
    pub per_trial: bool,
    /// Cells of the column, one per trial or per row.
    pub cells: ExportCells<'a>,
}

/// A table whose rows belong to trials.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportTable<'a> {
    /// Its name, and that of its file.
    pub name: &'static str,
    /// Description of a row.
    pub about: &'static str,
    /// Index of the trial of every row.
    pub trials: Vec<usize>,
    /// The columns.
    pub columns: Vec<ExportColumn<'a>>,
}

impl ExportCells<'_> {
    /// Type of the column in the terms of a Table Schema.
    fn kind(&self) -> &'static str {
        match self {
            Self::Text(_) => "string",
            Self::Count(_) | Self::Whole(_) => "integer",
            Self::Number(_) => "number",
            Self::Flag(_) => "boolean",
        }
    }
}

impl<'a> ExportColumn<'a> {
    /// A column with a cell per row.
    #[must_use]
    pub fn new(name: &str, about: &str, cells: ExportCells<'a>) -> Self {
        Self {
            name: name.into(),
            about: about.into(),
            unit: String::new(),
            per_trial: false,
            cells,
        }
    }

    /// The same column with a cell per trial.
    #[must_use]
    pub fn of_trials(self) -> Self {
        Self {
            per_trial: true,
            ..self
        }
    }

    /// The same column with a unit.
    #[must_use]
    pub fn in_unit(self, unit: &str) -> Self {
        Self {
            unit: unit.into(),
            ..self
        }
    }

    fn describe(&self) -> Value {
        json!({"name": self.name, "type": self.cells.kind(), "description": self.about, "unit": self.unit})
    }
}

impl ExportTable<'_> {
    /// Index of a row's cell in a column.
    pub(super) fn place(&self, column: &ExportColumn<'_>, row: usize) -> usize {
        if column.per_trial { self.trials[row] } else { row }
    }

    /// Description of the table and its columns.
    pub(super) fn describe(&self, file: &str) -> Value {
        let fields: Vec<Value> = self.columns.iter().map(ExportColumn::describe).collect();
        json!({"file": file, "description": self.about, "rows": self.trials.len(), "fields": fields})
    }

    /// The table as a Parquet file.
    pub(super) fn to_parquet(&self, path: &Path) -> Result<Vec<u8>, Error> {
        let columns = self
            .columns
            .iter()
            .map(|column| (column.name.as_str(), self.values(column)));
        parquet::encode(
            path,
            columns.collect(),
            &[("regimen.table", self.name.to_owned())],
        )
    }

    fn values<'b>(&self, column: &'b ExportColumn<'_>) -> Values<'b> {
        let rows = || (0..self.trials.len()).map(|row| self.place(column, row));
        match &column.cells {
            ExportCells::Text(cells) => Values::MaybeText(rows().map(|at| cells[at].as_deref()).collect()),
            ExportCells::Count(cells) => Values::MaybeU64(rows().map(|at| cells[at]).collect()),
            ExportCells::Whole(cells) => Values::MaybeI64(rows().map(|at| cells[at]).collect()),
            ExportCells::Number(cells) => Values::MaybeF64(rows().map(|at| cells[at]).collect()),
            ExportCells::Flag(cells) => Values::MaybeBool(rows().map(|at| cells[at]).collect()),
        }
    }
}
