//! A digest of the values in a file. It is the same for the same columns with the same cells in the same order,
//! independent of the library, codec and version that wrote the file.

use super::{NullableValues, ParquetColumn, ParquetTable};
use crate::{Error, digest, panics};
use std::path::Path;

/// Name and version of the hashed form, the first bytes of the hash's input.
const FORMAT: &[u8] = b"regimen values 1\n";

/// The [digest](digest::of_bytes) of the values in the bytes of a file.
///
/// # Errors
/// [`Error::Damaged`] if it is no such file.
pub fn values_digest(bytes: Vec<u8>, path: &Path) -> Result<String, Error> {
    let table = panics::or_damaged(path, || ParquetTable::decode(bytes, path))?;
    let mut values = FORMAT.to_vec();
    for (name, column) in &table.columns {
        push_bytes(&mut values, name.as_bytes());
        push_bytes(&mut values, column.kind().as_bytes());
        push_column(&mut values, column);
    }
    Ok(digest::of_bytes(&values))
}

fn push_column(to: &mut Vec<u8>, column: &ParquetColumn) {
    match column {
        ParquetColumn::Text(cells) => push_cells(to, cells, |to, it| push_bytes(to, it.data())),
        ParquetColumn::U64(cells) => push_cells(to, cells, |to, it| to.extend(it.to_le_bytes())),
        ParquetColumn::U32(cells) => push_cells(to, cells, |to, it| to.extend(it.to_le_bytes())),
        ParquetColumn::I64(cells) => push_cells(to, cells, |to, it| to.extend(it.to_le_bytes())),
        ParquetColumn::F64(cells) => push_cells(to, cells, |to, it| to.extend(it.to_le_bytes())),
        ParquetColumn::Bool(cells) => push_cells(to, cells, |to, it| to.push(u8::from(*it))),
        ParquetColumn::Vectors(rows) => push_rows(to, rows, |it| it.to_le_bytes()),
        ParquetColumn::WholeVectors(rows) => push_rows(to, rows, |it| it.to_le_bytes()),
        ParquetColumn::Other(_) => {}
    }
}

/// The number of cells, then 0 for each empty cell, and 1 and the value for each other cell.
fn push_cells<T>(to: &mut Vec<u8>, cells: &NullableValues<T>, value: impl Fn(&mut Vec<u8>, &T)) {
    push_count(to, cells.len());
    for cell in cells.iter() {
        to.push(u8::from(cell.is_some()));
        if let Some(cell) = cell {
            value(to, cell);
        }
    }
}

fn push_rows<T>(to: &mut Vec<u8>, rows: &[Option<Vec<T>>], value: impl Fn(&T) -> [u8; 8]) {
    push_count(to, rows.len());
    for row in rows {
        to.push(u8::from(row.is_some()));
        let entries = row.as_deref().unwrap_or_default();
        push_count(to, entries.len());
        to.extend(entries.iter().flat_map(&value));
    }
}

/// Bytes after their count.
fn push_bytes(to: &mut Vec<u8>, bytes: &[u8]) {
    push_count(to, bytes.len());
    to.extend_from_slice(bytes);
}

fn push_count(to: &mut Vec<u8>, count: usize) {
    to.extend((count as u64).to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parquet::{Values, encode};

    fn digest(columns: Vec<(&str, Values<'_>)>) -> String {
        let path = Path::new("table.parquet");
        let entries = [("version", columns.len().to_string())];
        values_digest(encode(path, columns, &entries).unwrap(), path).unwrap()
    }

    /// Receipts of verifications contain the digest, so a changed digest requires a new [`FORMAT`].
    #[test]
    fn the_digest_of_a_table_stays() {
        let columns = vec![
            ("word", Values::Text(vec!["a", "b"])),
            ("number", Values::MaybeF64(vec![Some(0.5), None])),
            ("vector", Values::Vectors(vec![&[1.0, -0.0], &[]])),
        ];
        assert_eq!(digest(columns), "292551baaebaba505b33307818c5d1ef");
    }

    #[test]
    fn every_value_name_kind_and_order_counts_and_room_for_empty_cells_does_not() {
        let of = |values| digest(vec![("a", values)]);
        let known = of(Values::F64(vec![0.0, 1.0]));
        assert_eq!(of(Values::MaybeF64(vec![Some(0.0), Some(1.0)])), known);
        let others = [
            of(Values::F64(vec![-0.0, 1.0])),
            of(Values::F64(vec![1.0, 0.0])),
            of(Values::F64(vec![0.0, 1.0, 1.0])),
            of(Values::MaybeF64(vec![Some(0.0), None])),
            of(Values::I64(vec![0, 1])),
            digest(vec![("b", Values::F64(vec![0.0, 1.0]))]),
        ];
        assert!(others.iter().all(|other| *other != known));
    }

    #[test]
    fn another_file_is_damage() {
        let refused = values_digest(b"no table".to_vec(), Path::new("table.parquet"));
        assert!(matches!(refused, Err(Error::Damaged { .. })));
    }
}
