//! Writes a table as a Parquet file of one group of rows, which is compressed by Zstandard unless it is short.

use super::{Values, damaged, unreadable};
use crate::Error;
use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel},
    data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int32Type, Int64Type},
    errors::ParquetError,
    file::{
        metadata::KeyValue,
        properties::{EnabledStatistics, WriterProperties},
        writer::{SerializedColumnWriter, SerializedFileWriter},
    },
    schema::types::{Type, TypePtr},
};
use std::{collections::BTreeSet, path::Path, sync::Arc};

/// The writer's name in the file. It has no version, so that a newer library writes the same bytes if it can.
const WRITER: &str = "regimen";
const ZSTD_LEVEL: i32 = 3;
/// Number of rows below which a table is not compressed: it would save little, and preparing Zstandard for each page takes
/// longer than all the rest.
const FEW_ROWS: usize = 1024;

/// A file with these columns and these metadata entries; `path` is named in errors.
///
/// # Errors
/// [`Error::Damaged`] if the columns make no table.
pub fn encode(
    path: &Path,
    columns: Vec<(&str, Values<'_>)>,
    entries: &[(&str, String)],
) -> Result<Vec<u8>, Error> {
    if let Some(problem) = misfit(&columns) {
        return Err(damaged(path, problem));
    }
    file(&columns, entries).map_err(|source| unreadable(path, &source))
}

/// Reason why the columns make no table.
fn misfit(columns: &[(&str, Values<'_>)]) -> Option<String> {
    let height = columns.first().map_or(0, |(_, values)| values.len());
    if let Some((name, values)) = columns.iter().find(|(_, values)| values.len() != height) {
        let other = values.len();
        return Some(format!(
            "column `{name}` has {other} rows and the first one {height}"
        ));
    }
    let mut known = BTreeSet::new();
    let twice = columns.iter().find(|(name, _)| !known.insert(*name));
    twice.map(|(name, _)| format!("there are two columns `{name}`"))
}

fn file(columns: &[(&str, Values<'_>)], entries: &[(&str, String)]) -> Result<Vec<u8>, ParquetError> {
    let fields: Vec<TypePtr> = columns
        .iter()
        .map(|(name, values)| field(name, values).map(Arc::new))
        .collect::<Result<_, _>>()?;
    let schema = Type::group_type_builder("schema").with_fields(fields).build()?;
    let entries: Vec<KeyValue> = entries
        .iter()
        .map(|(key, value)| KeyValue::new((*key).to_owned(), value.clone()))
        .collect();
    let height = columns.first().map_or(0, |(_, values)| values.len());
    let compression = match height < FEW_ROWS {
        true => Compression::UNCOMPRESSED,
        false => Compression::ZSTD(ZstdLevel::try_new(ZSTD_LEVEL)?),
    };
    let properties = WriterProperties::builder()
        .set_compression(compression)
        .set_created_by(WRITER.into())
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_offset_index_disabled(true)
        .set_key_value_metadata((!entries.is_empty()).then_some(entries))
        .build();
    let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for (_, values) in columns {
        let Some(mut column) = group.next_column()? else {
            break;
        };
        write(&mut column, values)?;
        column.close()?;
    }
    group.close()?;
    writer.into_inner()
}

fn field(name: &str, values: &Values<'_>) -> Result<Type, ParquetError> {
    let counts = |bits| Some(LogicalType::integer(bits, false));
    let (physical, logical) = match values {
        Values::Text(_) | Values::MaybeText(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        Values::U64(_) | Values::MaybeU64(_) => (Physical::INT64, counts(64)),
        Values::U32(_) => (Physical::INT32, counts(32)),
        Values::I64(_) | Values::MaybeI64(_) => (Physical::INT64, None),
        Values::F64(_) | Values::MaybeF64(_) => (Physical::DOUBLE, None),
        Values::Bool(_) | Values::MaybeBool(_) => (Physical::BOOLEAN, None),
        Values::Vectors(_) => return list(name, Physical::DOUBLE),
        Values::WholeVectors(_) => return list(name, Physical::INT64),
    };
    let repetition = if values.may_be_empty() {
        Repetition::OPTIONAL
    } else {
        Repetition::REQUIRED
    };
    Type::primitive_type_builder(name, physical)
        .with_logical_type(logical)
        .with_repetition(repetition)
        .build()
}

/// A list in three levels, as the format's specification requires.
fn list(name: &str, of: Physical) -> Result<Type, ParquetError> {
    let element = Type::primitive_type_builder("element", of)
        .with_repetition(Repetition::REQUIRED)
        .build()?;
    let entries = Type::group_type_builder("list")
        .with_repetition(Repetition::REPEATED)
        .with_fields(vec![Arc::new(element)])
        .build()?;
    Type::group_type_builder(name)
        .with_repetition(Repetition::REQUIRED)
        .with_logical_type(Some(LogicalType::List))
        .with_fields(vec![Arc::new(entries)])
        .build()
}

fn write(column: &mut SerializedColumnWriter<'_>, values: &Values<'_>) -> Result<(), ParquetError> {
    let text = |it: &str| ByteArray::from(it);
    match values {
        Values::Text(rows) => full::<ByteArrayType, _>(column, rows, |it| text(it)),
        Values::U64(rows) => full::<Int64Type, _>(column, rows, |it| it.cast_signed()),
        Values::U32(rows) => full::<Int32Type, _>(column, rows, |it| it.cast_signed()),
        Values::I64(rows) => full::<Int64Type, _>(column, rows, |it| *it),
        Values::F64(rows) => full::<DoubleType, _>(column, rows, |it| *it),
        Values::Bool(rows) => full::<BoolType, _>(column, rows, |it| *it),
        Values::MaybeText(rows) => partly::<ByteArrayType, _>(column, rows, |it| text(it)),
        Values::MaybeU64(rows) => partly::<Int64Type, _>(column, rows, |it| it.cast_signed()),
        Values::MaybeI64(rows) => partly::<Int64Type, _>(column, rows, |it| *it),
        Values::MaybeF64(rows) => partly::<DoubleType, _>(column, rows, |it| *it),
        Values::MaybeBool(rows) => partly::<BoolType, _>(column, rows, |it| *it),
        Values::Vectors(rows) => lists::<DoubleType>(column, rows.iter().copied()),
        Values::WholeVectors(rows) => lists::<Int64Type>(column, rows.iter().map(Vec::as_slice)),
    }
}

/// A column without empty cells.
fn full<T: DataType, V>(
    column: &mut SerializedColumnWriter<'_>,
    rows: &[V],
    stored: impl Fn(&V) -> T::T,
) -> Result<(), ParquetError> {
    let values: Vec<T::T> = rows.iter().map(stored).collect();
    column.typed::<T>().write_batch(&values, None, None).map(drop)
}

/// A column whose cells may be empty.
fn partly<T: DataType, V>(
    column: &mut SerializedColumnWriter<'_>,
    rows: &[Option<V>],
    stored: impl Fn(&V) -> T::T,
) -> Result<(), ParquetError> {
    let values: Vec<T::T> = rows.iter().flatten().map(stored).collect();
    let levels: Vec<i16> = rows.iter().map(|it| i16::from(it.is_some())).collect();
    column
        .typed::<T>()
        .write_batch(&values, Some(&levels), None)
        .map(drop)
}

/// A column of lists: an entry has level 1, an empty list level 0, and only the first of a row begins one.
fn lists<'v, T: DataType>(
    column: &mut SerializedColumnWriter<'_>,
    rows: impl Iterator<Item = &'v [T::T]>,
) -> Result<(), ParquetError> {
    let (mut values, mut filled, mut goes_on) = (Vec::new(), Vec::new(), Vec::new());
    for row in rows {
        filled.extend(row.iter().map(|_| 1));
        goes_on.extend(row.iter().enumerate().map(|(index, _)| i16::from(index > 0)));
        if row.is_empty() {
            filled.push(0);
            goes_on.push(0);
        }
        values.extend_from_slice(row);
    }
    column
        .typed::<T>()
        .write_batch(&values, Some(&filled), Some(&goes_on))
        .map(drop)
}
