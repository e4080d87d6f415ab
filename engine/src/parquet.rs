//! Tables of columns in Parquet files; the only file that names `polars`.
//!
//! The same table always makes the same bytes.

use crate::{Error, reach::quoted_names};
use polars::prelude::{
    Column, DataFrame, DataType, Float64Type, Int64Type, IntoColumn, ListBuilderTrait,
    ListPrimitiveChunkedBuilder, PolarsError,
};
use polars_io::{
    SerReader,
    parquet::{
        read::{ParallelStrategy, ParquetReader},
        write::{KeyValueMetadata, ParquetCompression, ParquetWriter},
    },
};
use std::{io::Cursor, path::Path};

/// What a column holds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Values<'a> {
    /// Words.
    Text(Vec<&'a str>),
    /// Counts.
    U64(Vec<u64>),
    /// Small counts.
    U32(Vec<u32>),
    /// Whole numbers.
    I64(Vec<i64>),
    /// Numbers.
    F64(Vec<f64>),
    /// True or false.
    Bool(Vec<bool>),
    /// A vector of numbers in every row.
    Vectors(Vec<&'a [f64]>),
    /// A vector of whole numbers in every row.
    WholeVectors(Vec<Vec<i64>>),
    /// Words, with cells that are empty.
    MaybeText(Vec<Option<&'a str>>),
    /// Counts, with cells that are empty.
    MaybeU64(Vec<Option<u64>>),
    /// Whole numbers, with cells that are empty.
    MaybeI64(Vec<Option<i64>>),
    /// Numbers, with cells that are empty.
    MaybeF64(Vec<Option<f64>>),
    /// True or false, with cells that are empty.
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

    fn into_column(self, name: &str) -> Column {
        let name = name.into();
        match self {
            Self::Text(values) => Column::new(name, values),
            Self::U64(values) => Column::new(name, values),
            Self::U32(values) => Column::new(name, values),
            Self::I64(values) => Column::new(name, values),
            Self::F64(values) => Column::new(name, values),
            Self::Bool(values) => Column::new(name, values),
            Self::MaybeText(values) => Column::new(name, values),
            Self::MaybeU64(values) => Column::new(name, values),
            Self::MaybeI64(values) => Column::new(name, values),
            Self::MaybeF64(values) => Column::new(name, values),
            Self::MaybeBool(values) => Column::new(name, values),
            Self::Vectors(rows) => {
                let entries = rows.iter().map(|row| row.len()).sum();
                let mut list = ListPrimitiveChunkedBuilder::<Float64Type>::new(
                    name,
                    rows.len(),
                    entries,
                    DataType::Float64,
                );
                rows.into_iter().for_each(|row| list.append_slice(row));
                list.finish().into_column()
            }
            Self::WholeVectors(rows) => {
                let entries = rows.iter().map(Vec::len).sum();
                let mut list =
                    ListPrimitiveChunkedBuilder::<Int64Type>::new(name, rows.len(), entries, DataType::Int64);
                rows.iter().for_each(|row| list.append_slice(row));
                list.finish().into_column()
            }
        }
    }
}

/// A file with these columns and these entries beside them; `path` is named in errors.
///
/// # Errors
/// [`Error::Damaged`] where the columns make no table.
pub(crate) fn encode(
    path: &Path,
    columns: Vec<(&str, Values<'_>)>,
    entries: &[(&str, String)],
) -> Result<Vec<u8>, Error> {
    let height = columns.first().map_or(0, |(_, values)| values.len());
    let columns = columns
        .into_iter()
        .map(|(name, values)| values.into_column(name))
        .collect();
    let mut frame = DataFrame::new(height, columns).map_err(|source| unreadable(path, &source))?;
    let entries = entries
        .iter()
        .map(|(key, value)| ((*key).into(), value.clone()))
        .collect::<Vec<(String, String)>>();
    let mut bytes = Vec::new();
    ParquetWriter::new(&mut bytes)
        .with_compression(ParquetCompression::Zstd(None))
        .with_key_value_metadata((!entries.is_empty()).then(|| KeyValueMetadata::from_static(entries)))
        .set_parallel(false)
        .finish(&mut frame)
        .map_err(|source| unreadable(path, &source))?;
    Ok(bytes)
}

/// A file that was read. Its columns are asked for by name and kind; a cell that is empty is `None`.
pub(crate) struct Table<'a> {
    frame: DataFrame,
    path: &'a Path,
}

impl<'a> Table<'a> {
    /// Reads what [`encode`] wrote.
    ///
    /// # Errors
    /// [`Error::Damaged`] where it is no such file.
    pub(crate) fn decode(bytes: Vec<u8>, path: &'a Path) -> Result<Self, Error> {
        let reader = ParquetReader::new(Cursor::new(bytes)).read_parallel(ParallelStrategy::None);
        let frame = reader.finish().map_err(|source| unreadable(path, &source))?;
        let lengths = || frame.columns().iter().map(Column::len);
        if let Some(other) = lengths().find(|length| *length != frame.height()) {
            let problem = format!("its columns have {} and {other} rows", frame.height());
            let path = path.to_path_buf();
            return Err(Error::Damaged { path, problem });
        }
        Ok(Self { frame, path })
    }

    pub(crate) fn texts(&self, name: &str) -> Result<impl Iterator<Item = Option<&str>>, Error> {
        Ok(self
            .column(name)?
            .str()
            .map_err(|source| unreadable(self.path, &source))?
            .iter())
    }

    pub(crate) fn u64s(&self, name: &str) -> Result<impl Iterator<Item = Option<u64>>, Error> {
        Ok(self
            .column(name)?
            .u64()
            .map_err(|source| unreadable(self.path, &source))?
            .iter())
    }

    pub(crate) fn u32s(&self, name: &str) -> Result<impl Iterator<Item = Option<u32>>, Error> {
        Ok(self
            .column(name)?
            .u32()
            .map_err(|source| unreadable(self.path, &source))?
            .iter())
    }

    pub(crate) fn i64s(&self, name: &str) -> Result<impl Iterator<Item = Option<i64>>, Error> {
        Ok(self
            .column(name)?
            .i64()
            .map_err(|source| unreadable(self.path, &source))?
            .iter())
    }

    pub(crate) fn f64s(&self, name: &str) -> Result<impl Iterator<Item = Option<f64>>, Error> {
        Ok(self
            .column(name)?
            .f64()
            .map_err(|source| unreadable(self.path, &source))?
            .iter())
    }

    pub(crate) fn bools(&self, name: &str) -> Result<impl Iterator<Item = Option<bool>>, Error> {
        Ok(self
            .column(name)?
            .bool()
            .map_err(|source| unreadable(self.path, &source))?
            .iter())
    }

    /// Vectors of numbers; one with an empty entry is `None`.
    pub(crate) fn vectors(&self, name: &str) -> Result<Vec<Option<Vec<f64>>>, Error> {
        let list = self
            .column(name)?
            .list()
            .map_err(|source| unreadable(self.path, &source))?;
        let mut rows = Vec::with_capacity(list.len());
        for row in list.series_iter() {
            let row = row
                .as_ref()
                .map(|row| row.f64())
                .transpose()
                .map_err(|source| unreadable(self.path, &source))?;
            rows.push(row.and_then(|row| row.iter().collect()));
        }
        Ok(rows)
    }

    /// Vectors of whole numbers; one with an empty entry is `None`.
    pub(crate) fn whole_vectors(&self, name: &str) -> Result<Vec<Option<Vec<i64>>>, Error> {
        let list = self
            .column(name)?
            .list()
            .map_err(|source| unreadable(self.path, &source))?;
        let mut rows = Vec::with_capacity(list.len());
        for row in list.series_iter() {
            let row = row
                .as_ref()
                .map(|row| row.i64())
                .transpose()
                .map_err(|source| unreadable(self.path, &source))?;
            rows.push(row.and_then(|row| row.iter().collect()));
        }
        Ok(rows)
    }

    /// A column of numbers of any kind.
    ///
    /// # Errors
    /// [`Error::Input`] where it is missing or holds something else or nothing in some row.
    pub(crate) fn numbers(&self, name: &str) -> Result<Vec<f64>, Error> {
        let wrong = |row: Option<u64>, problem: String| Error::Input {
            path: self.path.to_path_buf(),
            line: row,
            column: Some(name.into()),
            problem,
        };
        let column = self.frame.column(name).map_err(|_| {
            let known = self.frame.get_column_names();
            let known: Vec<&str> = known
                .into_iter()
                .map(polars::prelude::PlSmallStr::as_str)
                .collect();
            wrong(
                None,
                format!("is missing; there are {}", quoted_names(self.path, known)),
            )
        })?;
        let numbers = Some(column)
            .filter(|column| column.dtype().is_primitive_numeric())
            .and_then(|column| column.cast(&DataType::Float64).ok());
        let numbers = numbers.ok_or_else(|| wrong(None, "holds no numbers".into()))?;
        let values = numbers.f64().map_err(|source| unreadable(self.path, &source))?;
        let cell = |(row, value): (u64, Option<f64>)| {
            value.ok_or_else(|| wrong(Some(row), "the cell is empty".into()))
        };
        (1..).zip(values.iter()).map(cell).collect()
    }

    /// Every column of numbers, words or truth values with its cells as text, in the order of the file; an empty
    /// cell is an empty text, and columns of other kinds are passed over. Numbers read back as they are.
    ///
    /// # Errors
    /// [`Error::Damaged`] where a column cannot be read.
    pub(crate) fn as_texts(&self) -> Result<Vec<(String, Vec<String>)>, Error> {
        let wrong = |source: PolarsError| unreadable(self.path, &source);
        let mut texts = Vec::new();
        for column in self.frame.columns() {
            let cells: Vec<Option<String>> = match column.dtype() {
                DataType::String => column
                    .str()
                    .map_err(wrong)?
                    .iter()
                    .map(|it| it.map(Into::into))
                    .collect(),
                DataType::Boolean => column
                    .bool()
                    .map_err(wrong)?
                    .iter()
                    .map(|it| it.map(|it| it.to_string()))
                    .collect(),
                DataType::UInt64 => column
                    .u64()
                    .map_err(wrong)?
                    .iter()
                    .map(|it| it.map(|it| it.to_string()))
                    .collect(),
                kind if kind.is_integer() => {
                    let whole = column.cast(&DataType::Int64).map_err(wrong)?;
                    whole
                        .i64()
                        .map_err(wrong)?
                        .iter()
                        .map(|it| it.map(|it| it.to_string()))
                        .collect()
                }
                kind if kind.is_float() => {
                    let numbers = column.cast(&DataType::Float64).map_err(wrong)?;
                    numbers
                        .f64()
                        .map_err(wrong)?
                        .iter()
                        .map(|it| it.map(|it| it.to_string()))
                        .collect()
                }
                _ => continue,
            };
            let cells = cells.into_iter().map(Option::unwrap_or_default);
            texts.push((column.name().to_string(), cells.collect()));
        }
        Ok(texts)
    }

    fn column(&self, name: &str) -> Result<&Column, Error> {
        self.frame
            .column(name)
            .map_err(|source| unreadable(self.path, &source))
    }
}

fn unreadable(path: &Path, source: &PolarsError) -> Error {
    Error::Damaged {
        path: path.to_path_buf(),
        problem: source.to_string(),
    }
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
        let table = Table::decode(bytes, path).unwrap();
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
        let table = Table::decode(encode(path, columns, &[]).unwrap(), path).unwrap();
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
        let table = Table::decode(encode(path, columns(), &[]).unwrap(), path).unwrap();
        assert!(matches!(table.u64s("word").err(), Some(Error::Damaged { .. })));
        assert!(matches!(
            table.vectors("number").err(),
            Some(Error::Damaged { .. })
        ));
        assert!(matches!(table.f64s("nothing").err(), Some(Error::Damaged { .. })));
        assert!(matches!(
            Table::decode(b"no table".to_vec(), path).err(),
            Some(Error::Damaged { .. })
        ));
    }
}
