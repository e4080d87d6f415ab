//! Tables of columns in Parquet files; the only folder that uses the crate `parquet`.
//!
//! The same table always makes the same bytes. Two files with the same values have the same [`values_digest`],
//! independent of the library and codec that wrote them.

mod digest;
mod reading;
mod writing;

pub use digest::values_digest;
pub use writing::encode;

use crate::Error;
use document::reach::quoted_names;
use parquet::{data_type::ByteArray, errors::ParquetError};
use reading::NullableValues;
use std::path::Path;

/// The cells of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Values<'a> {
    /// Strings without empty cells.
    Text(Vec<&'a str>),
    /// Counts, as 64-bit numbers.
    U64(Vec<u64>),
    /// Small counts, as 32-bit numbers.
    U32(Vec<u32>),
    /// Whole numbers with a sign.
    I64(Vec<i64>),
    /// Floating-point numbers.
    F64(Vec<f64>),
    /// Truth values.
    Bool(Vec<bool>),
    /// A vector of numbers in every row.
    Vectors(Vec<&'a [f64]>),
    /// A vector of whole numbers in every row.
    WholeVectors(Vec<Vec<i64>>),
    /// Strings, with cells that may be empty.
    MaybeText(Vec<Option<&'a str>>),
    /// Counts, with cells that may be empty.
    MaybeU64(Vec<Option<u64>>),
    /// Whole numbers, with cells that may be empty.
    MaybeI64(Vec<Option<i64>>),
    /// Numbers, with cells that may be empty.
    MaybeF64(Vec<Option<f64>>),
    /// Truth values, with cells that may be empty.
    MaybeBool(Vec<Option<bool>>),
}

impl Values<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Text(values) => values.len(),
            Self::U64(values) => values.len(),
            Self::U32(values) => values.len(),
            Self::I64(values) => values.len(),
            Self::F64(values) => values.len(),
            Self::Bool(values) => values.len(),
            Self::Vectors(values) => values.len(),
            Self::WholeVectors(values) => values.len(),
            Self::MaybeText(values) => values.len(),
            Self::MaybeU64(values) => values.len(),
            Self::MaybeI64(values) => values.len(),
            Self::MaybeF64(values) => values.len(),
            Self::MaybeBool(values) => values.len(),
        }
    }

    fn may_be_empty(&self) -> bool {
        matches!(
            self,
            Self::MaybeText(_)
                | Self::MaybeU64(_)
                | Self::MaybeI64(_)
                | Self::MaybeF64(_)
                | Self::MaybeBool(_)
        )
    }
}

/// A file that was read. Its columns are requested by name and kind; an empty cell is `None`.
pub struct ParquetTable<'a> {
    columns: Vec<(String, ParquetColumn)>,
    path: &'a Path,
}

/// A column that was read.
#[derive(Debug)]
enum ParquetColumn {
    Text(NullableValues<ByteArray>),
    U64(NullableValues<u64>),
    U32(NullableValues<u32>),
    I64(NullableValues<i64>),
    F64(NullableValues<f64>),
    Bool(NullableValues<bool>),
    /// A row that is empty or has an empty entry is `None`.
    Vectors(Vec<Option<Vec<f64>>>),
    /// Like [`Vectors`](Self::Vectors), for whole numbers.
    WholeVectors(Vec<Option<Vec<i64>>>),
    /// Name of the kind of values that are not read.
    Other(String),
}

impl ParquetColumn {
    /// Name of its kind.
    fn kind(&self) -> &str {
        match self {
            Self::Text(_) => "text",
            Self::U64(_) => "counts",
            Self::U32(_) => "small counts",
            Self::I64(_) => "whole numbers",
            Self::F64(_) => "numbers",
            Self::Bool(_) => "truth values",
            Self::Vectors(_) => "vectors of numbers",
            Self::WholeVectors(_) => "vectors of whole numbers",
            Self::Other(kind) => kind,
        }
    }
}

impl<'a> ParquetTable<'a> {
    /// Reads a file of [`encode`], or of another program.
    ///
    /// # Errors
    /// [`Error::Damaged`] if it is no such file.
    pub fn decode(bytes: Vec<u8>, path: &'a Path) -> Result<Self, Error> {
        let columns = reading::columns(bytes).map_err(|source| unreadable(path, &source))?;
        Ok(Self { columns, path })
    }

    /// Strings; an empty cell is `None`.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the column is missing or of another type.
    pub fn texts(&self, name: &str) -> Result<impl Iterator<Item = Option<&str>>, Error> {
        match self.column(name)? {
            // Text that is not UTF-8 is refused when the column is read.
            ParquetColumn::Text(cells) => Ok(cells.iter().map(|it| it.and_then(|it| it.as_utf8().ok()))),
            other => Err(self.mismatch(name, other, "text")),
        }
    }

    /// Counts; an empty cell is `None`.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the column is missing or of another type.
    pub fn u64s(&self, name: &str) -> Result<impl Iterator<Item = Option<u64>>, Error> {
        match self.column(name)? {
            ParquetColumn::U64(cells) => Ok(cells.iter().map(Option::<&u64>::copied)),
            other => Err(self.mismatch(name, other, "counts")),
        }
    }

    /// Small counts; an empty cell is `None`.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the column is missing or of another type.
    pub fn u32s(&self, name: &str) -> Result<impl Iterator<Item = Option<u32>>, Error> {
        match self.column(name)? {
            ParquetColumn::U32(cells) => Ok(cells.iter().map(Option::<&u32>::copied)),
            other => Err(self.mismatch(name, other, "small counts")),
        }
    }

    /// Whole numbers; an empty cell is `None`.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the column is missing or of another type.
    pub fn i64s(&self, name: &str) -> Result<impl Iterator<Item = Option<i64>>, Error> {
        match self.column(name)? {
            ParquetColumn::I64(cells) => Ok(cells.iter().map(Option::<&i64>::copied)),
            other => Err(self.mismatch(name, other, "whole numbers")),
        }
    }

    /// Numbers; an empty cell is `None`.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the column is missing or of another type.
    pub fn f64s(&self, name: &str) -> Result<impl Iterator<Item = Option<f64>>, Error> {
        match self.column(name)? {
            ParquetColumn::F64(cells) => Ok(cells.iter().map(Option::<&f64>::copied)),
            other => Err(self.mismatch(name, other, "numbers")),
        }
    }

    /// Truth values; an empty cell is `None`.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the column is missing or of another type.
    pub fn bools(&self, name: &str) -> Result<impl Iterator<Item = Option<bool>>, Error> {
        match self.column(name)? {
            ParquetColumn::Bool(cells) => Ok(cells.iter().map(Option::<&bool>::copied)),
            other => Err(self.mismatch(name, other, "truth values")),
        }
    }

    /// Vectors of numbers; one with an empty entry is `None`.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the column is missing or of another type.
    pub fn vectors(&self, name: &str) -> Result<Vec<Option<Vec<f64>>>, Error> {
        match self.column(name)? {
            ParquetColumn::Vectors(rows) => Ok(rows.clone()),
            other => Err(self.mismatch(name, other, "vectors of numbers")),
        }
    }

    /// Vectors of whole numbers; one with an empty entry is `None`.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the column is missing or of another type.
    pub fn whole_vectors(&self, name: &str) -> Result<Vec<Option<Vec<i64>>>, Error> {
        match self.column(name)? {
            ParquetColumn::WholeVectors(rows) => Ok(rows.clone()),
            other => Err(self.mismatch(name, other, "vectors of whole numbers")),
        }
    }

    /// A column of numbers of any kind.
    ///
    /// # Errors
    /// [`Error::Input`] if it is missing, has another type or has an empty cell.
    #[allow(clippy::cast_precision_loss, reason = "a table's numbers are read as f64")]
    pub fn numbers(&self, name: &str) -> Result<Vec<f64>, Error> {
        let wrong = |row: Option<u64>, problem: String| Error::Input {
            path: self.path.to_path_buf(),
            line: row,
            column: Some(name.into()),
            problem,
        };
        let column = self.named(name).ok_or_else(|| {
            let known = quoted_names(self.path, self.names());
            wrong(None, format!("is missing; there are {known}"))
        })?;
        let numbers: Vec<Option<f64>> = match column {
            ParquetColumn::F64(cells) => cells.iter().map(Option::<&f64>::copied).collect(),
            ParquetColumn::U64(cells) => cells.iter().map(|it| it.map(|it| *it as f64)).collect(),
            ParquetColumn::I64(cells) => cells.iter().map(|it| it.map(|it| *it as f64)).collect(),
            ParquetColumn::U32(cells) => cells.iter().map(|it| it.map(|it| f64::from(*it))).collect(),
            _ => return Err(wrong(None, "holds no numbers".into())),
        };
        let cell = |(row, value): (u64, Option<f64>)| {
            value.ok_or_else(|| wrong(Some(row), "the cell is empty".into()))
        };
        (1..).zip(numbers).map(cell).collect()
    }

    /// Every column of numbers, strings or truth values with its cells as text, in the order of the file. An empty cell
    /// is an empty text, and columns of other kinds are skipped. The text of a number reads back to the same number.
    pub fn as_texts(&self) -> Vec<(String, Vec<String>)> {
        let cells = |(name, column): &(String, ParquetColumn)| {
            let cells = match column {
                ParquetColumn::Text(cells) => {
                    cells.as_texts(|it| it.as_utf8().unwrap_or_default().to_owned())
                }
                ParquetColumn::Bool(cells) => cells.as_texts(ToString::to_string),
                ParquetColumn::U64(cells) => cells.as_texts(ToString::to_string),
                ParquetColumn::U32(cells) => cells.as_texts(ToString::to_string),
                ParquetColumn::I64(cells) => cells.as_texts(ToString::to_string),
                ParquetColumn::F64(cells) => cells.as_texts(ToString::to_string),
                ParquetColumn::Vectors(_) | ParquetColumn::WholeVectors(_) | ParquetColumn::Other(_) => {
                    return None;
                }
            };
            Some((name.clone(), cells))
        };
        self.columns.iter().filter_map(cells).collect()
    }

    fn names(&self) -> Vec<&str> {
        self.columns.iter().map(|(name, _)| name.as_str()).collect()
    }

    fn named(&self, name: &str) -> Option<&ParquetColumn> {
        let mut found = self.columns.iter().filter(|(other, _)| other == name);
        found.next().map(|(_, column)| column)
    }

    fn column(&self, name: &str) -> Result<&ParquetColumn, Error> {
        self.named(name).ok_or_else(|| {
            let known = quoted_names(self.path, self.names());
            damaged(
                self.path,
                format!("column `{name}` is missing; there are {known}"),
            )
        })
    }

    fn mismatch(&self, name: &str, column: &ParquetColumn, expected: &str) -> Error {
        let problem = format!("column `{name}` holds {}, not {expected}", column.kind());
        damaged(self.path, problem)
    }
}

fn unreadable(path: &Path, source: &ParquetError) -> Error {
    damaged(path, source.to_string())
}

fn damaged(path: &Path, problem: String) -> Error {
    let path = path.to_path_buf();
    Error::Damaged { path, problem }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns() -> Vec<(&'static str, Values<'static>)> {
        vec![
            ("word", Values::Text(vec!["a", "b"])),
            ("count", Values::U64(vec![1, u64::MAX])),
            ("small", Values::U32(vec![0, 7])),
            ("whole", Values::I64(vec![-3, 3])),
            ("number", Values::F64(vec![0.1, f64::NEG_INFINITY])),
            ("flag", Values::Bool(vec![true, false])),
            ("vector", Values::Vectors(vec![&[1.0, -0.0], &[]])),
            ("choices", Values::WholeVectors(vec![vec![3, -1], vec![]])),
        ]
    }

    #[test]
    fn every_kind_of_column_comes_back_and_the_bytes_are_the_same() {
        let path = Path::new("table.parquet");
        let entries = [("version", "1".to_string())];
        let bytes = encode(path, columns(), &entries).unwrap();
        assert_eq!(bytes, encode(path, columns(), &entries).unwrap());
        let table = ParquetTable::decode(bytes, path).unwrap();
        assert_eq!(
            table.texts("word").unwrap().collect::<Vec<_>>(),
            [Some("a"), Some("b")]
        );
        assert_eq!(
            table.u64s("count").unwrap().collect::<Vec<_>>(),
            [Some(1), Some(u64::MAX)]
        );
        assert_eq!(
            table.u32s("small").unwrap().collect::<Vec<_>>(),
            [Some(0), Some(7)]
        );
        assert_eq!(
            table.i64s("whole").unwrap().collect::<Vec<_>>(),
            [Some(-3), Some(3)]
        );
        assert_eq!(
            table.f64s("number").unwrap().collect::<Vec<_>>(),
            [Some(0.1), Some(f64::NEG_INFINITY)]
        );
        assert_eq!(
            table.bools("flag").unwrap().collect::<Vec<_>>(),
            [Some(true), Some(false)]
        );
        let vectors = table.vectors("vector").unwrap();
        assert_eq!(vectors, [Some(vec![1.0, -0.0]), Some(vec![])]);
        assert!(vectors[0].as_ref().unwrap()[1].is_sign_negative());
        assert_eq!(
            table.whole_vectors("choices").unwrap(),
            [Some(vec![3, -1]), Some(vec![])]
        );
        assert!(table.whole_vectors("vector").is_err() && table.vectors("choices").is_err());
    }

    #[test]
    fn long_tables_are_compressed_and_short_ones_are_not() {
        let path = Path::new("table.parquet");
        for (height, is_compressed) in [(1000_u32, false), (4000, true)] {
            let numbers: Vec<f64> = (0..height).map(f64::from).collect();
            let columns = vec![("number", Values::F64(numbers.clone()))];
            let bytes = encode(path, columns, &[]).unwrap();
            assert_eq!(bytes.len() < 8 * numbers.len(), is_compressed, "{height} rows");
            let table = ParquetTable::decode(bytes, path).unwrap();
            let read: Option<Vec<f64>> = table.f64s("number").unwrap().collect();
            assert_eq!(read, Some(numbers));
        }
    }

    #[test]
    fn empty_cells_stay_empty() {
        let path = Path::new("table.parquet");
        let columns = vec![
            ("word", Values::MaybeText(vec![Some("a"), None])),
            ("count", Values::MaybeU64(vec![None, Some(2)])),
            ("whole", Values::MaybeI64(vec![Some(-1), None])),
            ("number", Values::MaybeF64(vec![None, Some(0.5)])),
            ("flag", Values::MaybeBool(vec![Some(true), None])),
            ("nothing", Values::MaybeF64(vec![None, None])),
        ];
        let table = ParquetTable::decode(encode(path, columns, &[]).unwrap(), path).unwrap();
        assert_eq!(
            table.texts("word").unwrap().collect::<Vec<_>>(),
            [Some("a"), None]
        );
        assert_eq!(table.u64s("count").unwrap().collect::<Vec<_>>(), [None, Some(2)]);
        assert_eq!(table.i64s("whole").unwrap().collect::<Vec<_>>(), [Some(-1), None]);
        assert_eq!(
            table.f64s("number").unwrap().collect::<Vec<_>>(),
            [None, Some(0.5)]
        );
        assert_eq!(
            table.bools("flag").unwrap().collect::<Vec<_>>(),
            [Some(true), None]
        );
        assert_eq!(table.f64s("nothing").unwrap().collect::<Vec<_>>(), [None, None]);
    }

    #[test]
    fn another_kind_a_missing_column_and_another_file_are_damage() {
        let path = Path::new("table.parquet");
        let table = ParquetTable::decode(encode(path, columns(), &[]).unwrap(), path).unwrap();
        assert!(matches!(table.u64s("word").err(), Some(Error::Damaged { .. })));
        assert!(matches!(
            table.vectors("number").err(),
            Some(Error::Damaged { .. })
        ));
        assert!(matches!(table.f64s("nothing").err(), Some(Error::Damaged { .. })));
        assert!(matches!(
            ParquetTable::decode(b"no table".to_vec(), path).err(),
            Some(Error::Damaged { .. })
        ));
    }
}
