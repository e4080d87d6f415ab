//! Reads the columns of a Parquet file, including files of other programs: pandas, Spark, polars.

use super::ParquetColumn;
use bytes::Bytes;
use parquet::{
    basic::{Compression, ConvertedType, LogicalType, Type as Physical},
    column::reader::get_typed_column_reader,
    data_type::{BoolType, ByteArrayType, DataType, DoubleType, FloatType, Int32Type, Int64Type},
    errors::ParquetError,
    file::{
        metadata::ColumnChunkMetaData,
        reader::{FileReader, SerializedFileReader},
    },
    schema::types::{ColumnDescriptor, Type},
};

/// Values of the cells of a column; some cells may be empty.
#[derive(Debug)]
pub(super) struct NullableValues<T> {
    /// Values of the cells that are not empty.
    values: Vec<T>,
    /// Whether each cell has a value.
    filled: Vec<bool>,
}

impl<T> NullableValues<T> {
    pub(super) fn iter(&self) -> impl Iterator<Item = Option<&T>> {
        let mut values = self.values.iter();
        let cell = move |filled: &bool| if *filled { values.next() } else { None };
        self.filled.iter().map(cell)
    }

    pub(super) fn len(&self) -> usize {
        self.filled.len()
    }

    /// The cells as text; an empty one is an empty text.
    pub(super) fn as_texts(&self, text: impl Fn(&T) -> String) -> Vec<String> {
        self.iter().map(|it| it.map(&text).unwrap_or_default()).collect()
    }

    fn map<U>(self, value: impl Fn(T) -> U) -> NullableValues<U> {
        let values = self.values.into_iter().map(value).collect();
        NullableValues {
            values,
            filled: self.filled,
        }
    }
}

/// The columns of a file by their names, in its order.
pub(super) fn columns(bytes: Vec<u8>) -> Result<Vec<(String, ParquetColumn)>, ParquetError> {
    let file = SerializedFileReader::new(Bytes::from(bytes))?;
    refuse_codecs(&file)?;
    let schema = file.metadata().file_metadata().schema_descr_ptr();
    let mut columns = Vec::new();
    let mut next = 0;
    for root in schema.root_schema().get_fields() {
        let (first, count) = (next, leaves_of(root));
        next += count;
        let column = if count == 1 {
            column(&file, root, first)?
        } else {
            ParquetColumn::Other("records".into())
        };
        columns.push((root.name().to_owned(), column));
    }
    Ok(columns)
}

/// Refuses a file that uses a compression without which the program is built.
fn refuse_codecs(file: &SerializedFileReader<Bytes>) -> Result<(), ParquetError> {
    let groups = file.metadata().row_groups().iter();
    let mut codecs = groups.flat_map(|group| group.columns().iter().map(ColumnChunkMetaData::compression));
    match codecs.find(|codec| matches!(codec, Compression::BROTLI(_) | Compression::LZO)) {
        Some(codec) => Err(ParquetError::General(format!(
            "it is compressed by {codec}, which is not read: write it with zstd, snappy, gzip or lz4"
        ))),
        None => Ok(()),
    }
}

/// Number of columns of plain values in a field.
fn leaves_of(field: &Type) -> usize {
    if field.is_primitive() {
        return 1;
    }
    field.get_fields().iter().map(|it| leaves_of(it)).sum()
}

fn column(
    file: &SerializedFileReader<Bytes>,
    root: &Type,
    index: usize,
) -> Result<ParquetColumn, ParquetError> {
    let described = file.metadata().file_metadata().schema_descr().column(index);
    let kind = kind(&described);
    if root.is_primitive() && described.max_rep_level() == 0 {
        return flat(file, index, kind);
    }
    let is_list = !root.is_primitive() && is_list(root) && described.max_rep_level() == 1;
    match kind {
        ColumnType::Number if is_list => Ok(ParquetColumn::Vectors(leaf::<DoubleType>(file, index)?.lists())),
        ColumnType::Signed64 if is_list => Ok(ParquetColumn::WholeVectors(
            leaf::<Int64Type>(file, index)?.lists(),
        )),
        _ if is_list => Ok(ParquetColumn::Other("lists of another kind".into())),
        _ => Ok(ParquetColumn::Other("records".into())),
    }
}

fn is_list(field: &Type) -> bool {
    let basic = field.get_basic_info();
    basic.logical_type_ref() == Some(&LogicalType::List) || basic.converted_type() == ConvertedType::LIST
}

fn flat(
    file: &SerializedFileReader<Bytes>,
    index: usize,
    kind: ColumnType,
) -> Result<ParquetColumn, ParquetError> {
    Ok(match kind {
        ColumnType::Text => {
            let cells = leaf::<ByteArrayType>(file, index)?.cells();
            cells.values.iter().try_for_each(|it| it.as_utf8().map(drop))?;
            ParquetColumn::Text(cells)
        }
        ColumnType::Truth => ParquetColumn::Bool(leaf::<BoolType>(file, index)?.cells()),
        ColumnType::Signed32 => ParquetColumn::I64(leaf::<Int32Type>(file, index)?.cells().map(i64::from)),
        ColumnType::Unsigned32 => {
            ParquetColumn::U32(leaf::<Int32Type>(file, index)?.cells().map(i32::cast_unsigned))
        }
        ColumnType::Signed64 => ParquetColumn::I64(leaf::<Int64Type>(file, index)?.cells()),
        ColumnType::Unsigned64 => {
            ParquetColumn::U64(leaf::<Int64Type>(file, index)?.cells().map(i64::cast_unsigned))
        }
        ColumnType::ShortNumber => ParquetColumn::F64(leaf::<FloatType>(file, index)?.cells().map(f64::from)),
        ColumnType::Number => ParquetColumn::F64(leaf::<DoubleType>(file, index)?.cells()),
        ColumnType::Other(words) => ParquetColumn::Other(words),
    })
}

/// Storage form of the values of a column.
enum ColumnType {
    Text,
    Truth,
    Signed32,
    Unsigned32,
    Signed64,
    Unsigned64,
    ShortNumber,
    Number,
    Other(String),
}

fn kind(column: &ColumnDescriptor) -> ColumnType {
    let (logical, converted) = (column.logical_type_ref(), column.converted_type());
    let other = || match logical {
        Some(logical) => ColumnType::Other(format!("values of the type {logical:?}")),
        None if converted != ConvertedType::NONE => {
            ColumnType::Other(format!("values of the type {converted}"))
        }
        None => ColumnType::Other(format!("values of the type {}", column.physical_type())),
    };
    let is_signed = match (logical, converted) {
        (Some(LogicalType::Integer(kind)), _) => Some(kind.is_signed),
        (Some(_), _) => None,
        (
            None,
            ConvertedType::UINT_8 | ConvertedType::UINT_16 | ConvertedType::UINT_32 | ConvertedType::UINT_64,
        ) => Some(false),
        (
            None,
            ConvertedType::NONE
            | ConvertedType::INT_8
            | ConvertedType::INT_16
            | ConvertedType::INT_32
            | ConvertedType::INT_64,
        ) => Some(true),
        (None, _) => None,
    };
    let is_text = match logical {
        Some(logical) => matches!(
            logical,
            LogicalType::String | LogicalType::Enum | LogicalType::Json
        ),
        None => matches!(
            converted,
            ConvertedType::UTF8 | ConvertedType::ENUM | ConvertedType::JSON
        ),
    };
    match (column.physical_type(), is_signed) {
        (Physical::BOOLEAN, _) => ColumnType::Truth,
        (Physical::INT32, Some(true)) => ColumnType::Signed32,
        (Physical::INT32, Some(false)) => ColumnType::Unsigned32,
        (Physical::INT64, Some(true)) => ColumnType::Signed64,
        (Physical::INT64, Some(false)) => ColumnType::Unsigned64,
        (Physical::FLOAT, _) => ColumnType::ShortNumber,
        (Physical::DOUBLE, _) => ColumnType::Number,
        (Physical::BYTE_ARRAY, _) if is_text => ColumnType::Text,
        _ => other(),
    }
}

/// A column of plain values with its levels, which show empty cells, empty lists and the beginnings of lists.
struct Leaf<T> {
    values: Vec<T>,
    definition: Vec<i16>,
    repetition: Vec<i16>,
    rows: usize,
    /// The definition level of an existing value.
    full: i16,
    /// The definition level of an entry of a list, whether it is empty or not.
    entry: i16,
}

fn leaf<T: DataType>(file: &SerializedFileReader<Bytes>, index: usize) -> Result<Leaf<T::T>, ParquetError> {
    let metadata = file.metadata();
    let described = metadata.file_metadata().schema_descr().column(index);
    let mut leaf = Leaf {
        values: Vec::new(),
        definition: Vec::new(),
        repetition: Vec::new(),
        rows: 0,
        full: described.max_def_level(),
        entry: described.repeated_ancestor_def_level(),
    };
    for group in 0..metadata.num_row_groups() {
        let group = file.get_row_group(group)?;
        let mut reader = get_typed_column_reader::<T>(group.get_column_reader(index)?);
        let (definition, repetition) = (Some(&mut leaf.definition), Some(&mut leaf.repetition));
        let (rows, _, _) = reader.read_records(usize::MAX, definition, repetition, &mut leaf.values)?;
        leaf.rows += rows;
    }
    match usize::try_from(metadata.file_metadata().num_rows()) {
        Ok(rows) if rows == leaf.rows => Ok(leaf),
        _ => Err(ParquetError::General(format!(
            "column `{}` has {} rows and the file {}",
            described.path(),
            leaf.rows,
            metadata.file_metadata().num_rows()
        ))),
    }
}

impl<T> Leaf<T> {
    fn cells(self) -> NullableValues<T> {
        let filled = if self.full == 0 {
            vec![true; self.rows]
        } else {
            self.definition.iter().map(|level| *level == self.full).collect()
        };
        NullableValues {
            values: self.values,
            filled,
        }
    }

    /// The rows; one that is empty or has an empty entry is `None`.
    fn lists(self) -> Vec<Option<Vec<T>>> {
        let mut rows: Vec<Option<Vec<T>>> = Vec::with_capacity(self.rows);
        let mut values = self.values.into_iter();
        for (definition, repetition) in self.definition.into_iter().zip(self.repetition) {
            if repetition == 0 {
                rows.push((definition + 1 >= self.entry).then(Vec::new));
            }
            let value = (definition == self.full).then(|| values.next()).flatten();
            let Some(row) = rows.last_mut() else { continue };
            if definition >= self.entry {
                match (value, row.as_mut()) {
                    (Some(value), Some(entries)) => entries.push(value),
                    _ => *row = None,
                }
            }
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use crate::parquet::{ParquetTable, values_digest};
    use std::path::Path;

    /// Files that `fixtures/make.py` wrote of one table.
    const FILES: [(&str, &[u8]); 5] = [
        ("snappy.parquet", include_bytes!("fixtures/snappy.parquet")),
        ("gzip.parquet", include_bytes!("fixtures/gzip.parquet")),
        ("lz4.parquet", include_bytes!("fixtures/lz4.parquet")),
        ("none.parquet", include_bytes!("fixtures/none.parquet")),
        ("polars.parquet", include_bytes!("fixtures/polars.parquet")),
    ];

    #[test]
    fn files_of_other_programs_have_the_values_that_were_written() {
        for (name, bytes) in FILES {
            let table = ParquetTable::decode(bytes.to_vec(), Path::new(name)).unwrap();
            let texts = table.as_texts();
            let shown: Vec<String> = texts
                .iter()
                .map(|(name, cells)| format!("{name}: {}", cells.join(" | ")))
                .collect();
            let expected = [
                "text: a |  | ä | ",
                "category: x | y | x | ",
                "i8: -128 | 127 |  | 0",
                "i32: -2147483648 | 2147483647 | 0 | 1",
                "i64: -9223372036854775808 | 9223372036854775807 |  | 1",
                "u16: 0 | 65535 | 1 | ",
                "u32: 0 | 4294967295 | 1 | 2",
                "u64: 0 | 18446744073709551615 |  | 2",
                "f32: 0.5 |  | inf | -0",
                &format!("f64: 0.1 | NaN |  | {}", 1e300),
                "flag: true | false |  | true",
            ];
            assert_eq!(shown, expected, "{name}");
            let vectors = table.vectors("vector").unwrap();
            assert_eq!(
                vectors,
                [Some(vec![1.0, -0.0]), Some(vec![]), None, None],
                "{name}"
            );
            let choices = table.whole_vectors("choices").unwrap();
            assert_eq!(
                choices,
                [vec![3, -1], vec![], vec![7], vec![8]].map(Some),
                "{name}"
            );
            assert_eq!(table.numbers("u32").unwrap()[1], 4_294_967_295.0);
        }
    }

    #[test]
    fn the_digest_is_the_same_whichever_program_and_codec_wrote_the_file() {
        let digests = FILES.map(|(name, bytes)| values_digest(bytes.to_vec(), Path::new(name)).unwrap());
        assert!(digests.iter().all(|digest| *digest == digests[0]), "{digests:?}");
    }

    #[test]
    fn columns_of_other_kinds_say_what_they_hold() {
        let table = ParquetTable::decode(FILES[0].1.to_vec(), Path::new("snappy.parquet")).unwrap();
        let said = |name: &str| table.f64s(name).err().unwrap().to_string();
        assert!(
            said("day").contains("column `day` holds values of the type Date, not numbers"),
            "{}",
            said("day")
        );
        assert!(said("record").contains("holds records"), "{}", said("record"));
        assert!(
            said("names").contains("holds lists of another kind"),
            "{}",
            said("names")
        );
        assert!(
            said("none").contains("column `none` is missing; there are"),
            "{}",
            said("none")
        );
        let refused = table.numbers("text").unwrap_err().to_string();
        assert!(refused.contains("holds no numbers"), "{refused}");
    }

    #[test]
    fn brotli_is_refused_by_name() {
        let bytes = include_bytes!("fixtures/brotli.parquet").to_vec();
        let refused = ParquetTable::decode(bytes, Path::new("brotli.parquet"))
            .err()
            .unwrap()
            .to_string();
        assert!(
            refused.contains("it is compressed by BROTLI") && refused.contains("write it with zstd"),
            "{refused}"
        );
    }
}
