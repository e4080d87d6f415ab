//! Arrays of NumPy in an archive (`.npz`), as the evaluation callback of Stable-Baselines3 writes them: arrays of the
//! same length are the columns of a table. The column of an array with further axes is the mean over them.

use super::{
    content::Content,
    table::{LogLine, LogTable},
};
use contract::Error;
use csv::StringRecord;
use document::{count::count, input_file};
use std::{collections::BTreeMap, io::Cursor};
use zip::ZipArchive;

/// An array of numbers.
#[derive(Debug, PartialEq)]
struct Array {
    shape: Vec<usize>,
    /// Its entries, the last axis fastest.
    values: Vec<f64>,
}

/// Arrays by name.
type NamedArrays = Vec<(String, Array)>;

/// The table of an archive.
pub(super) fn table(file: &Content) -> Result<LogTable, Error> {
    let (arrays, mut notes) = arrays(file)?;
    let mut lengths: BTreeMap<usize, usize> = BTreeMap::new();
    for (_, array) in &arrays {
        if let Some(length) = array.shape.first() {
            *lengths.entry(*length).or_default() += 1;
        }
    }
    let Some((&lines, _)) = lengths.iter().max_by_key(|(length, arrays)| (**arrays, **length)) else {
        return Err(file.wrong(None, "it has no array of numbers with an axis".into()));
    };
    let (columns, others): (Vec<_>, Vec<_>) = arrays
        .into_iter()
        .partition(|(_, array)| array.shape.first() == Some(&lines));
    let name = file.name();
    for (array, _) in others {
        notes.push(format!(
            "`{array}` of `{name}` has another length and is passed over"
        ));
    }
    for (array, it) in &columns {
        let of_line = it.values.len() / lines.max(1);
        if of_line > 1 {
            let values = count(of_line, "value");
            notes.push(format!(
                "`{array}` of `{name}` has {values} on a line, of which the mean counts"
            ));
        }
    }
    let line = |place: usize| LogLine {
        number: place as u64 + 1,
        begins_again: false,
        cells: columns
            .iter()
            .map(|(_, array)| array.mean_of(place).to_string())
            .collect::<StringRecord>(),
    };
    Ok(LogTable {
        path: file.path.clone(),
        lines: (0..lines).map(line).collect(),
        names: columns.iter().map(|(name, _)| name.clone()).collect(),
        notes,
        ..LogTable::default()
    })
}

/// The arrays of numbers by name, with a sentence on each other array.
fn arrays(file: &Content) -> Result<(NamedArrays, Vec<String>), Error> {
    let damaged = |problem: &dyn std::fmt::Display| {
        let kind = "a ZIP archive, as Excel (.xlsx) and NumPy (.npz) write";
        file.wrong(
            None,
            format!("it is {kind}, and cannot be read ({problem}): save the table as CSV"),
        )
    };
    let mut archive = ZipArchive::new(Cursor::new(&file.bytes[..])).map_err(|error| damaged(&error))?;
    let is_array = |name: Result<std::borrow::Cow<'_, str>, _>| name.is_ok_and(|name| name.ends_with(".npy"));
    if archive.is_empty() || !archive.file_names().all(is_array) {
        let problem =
            "it is a ZIP archive, as Excel (.xlsx) writes, without arrays of NumPy: save the table as CSV";
        return Err(file.wrong(None, problem.into()));
    }
    let (mut arrays, mut notes) = (Vec::new(), Vec::new());
    for place in 0..archive.len() {
        let entry = archive.by_index(place).map_err(|error| damaged(&error))?;
        let name = entry.name().map_err(|error| damaged(&error))?;
        let name = name.trim_end_matches(".npy").to_owned();
        let bytes = input_file::rest(entry, Vec::new(), input_file::Use::Text);
        let bytes = bytes.map_err(|error| damaged(&format!("`{name}`: {error}")))?;
        match parsed(&bytes) {
            Ok(array) => arrays.push((name, array)),
            Err(Refusal::Kind(kind)) => {
                notes.push(format!(
                    "`{name}` of `{}` is of kind {kind} and is passed over",
                    file.name()
                ));
            }
            Err(Refusal::Damaged) => return Err(damaged(&format!("`{name}` is no whole array"))),
        }
    }
    Ok((arrays, notes))
}

/// The reason why bytes are not an array of numbers.
#[derive(Debug, PartialEq)]
enum Refusal {
    /// Its entries are not numbers.
    Kind(String),
    /// The array is cut off or malformed.
    Damaged,
}

/// Reads an array: `\x93NUMPY`, a version, the length of the head, the head (a dictionary of Python), the entries.
fn parsed(bytes: &[u8]) -> Result<Array, Refusal> {
    let version = *bytes
        .get(6)
        .filter(|_| bytes.starts_with(b"\x93NUMPY"))
        .ok_or(Refusal::Damaged)?;
    let (start, length): (usize, usize) = match (version, bytes.get(8..12)) {
        (1, Some(size)) => (10, usize::from(u16::from_le_bytes([size[0], size[1]]))),
        (_, Some(size)) => (
            12,
            u32::from_le_bytes([size[0], size[1], size[2], size[3]]) as usize,
        ),
        _ => return Err(Refusal::Damaged),
    };
    let end = start
        .checked_add(length)
        .filter(|end| *end <= bytes.len())
        .ok_or(Refusal::Damaged)?;
    let head = std::str::from_utf8(&bytes[start..end]).map_err(|_| Refusal::Damaged)?;
    let (kind, shape) = (said(head, "descr")?, said(head, "shape")?);
    let shape: Vec<usize> = shape
        .trim_matches(['(', ')'])
        .split(',')
        .map(str::trim)
        .filter(|length| !length.is_empty())
        .map(|length| length.parse().map_err(|_| Refusal::Damaged))
        .collect::<Result<_, _>>()?;
    let values = entries(&bytes[end..], kind.trim_matches(['\'', '"']))?;
    let entries = shape
        .iter()
        .try_fold(1_usize, |all, length| all.checked_mul(*length));
    if entries != Some(values.len()) {
        return Err(Refusal::Damaged);
    }
    let is_fortran = said(head, "fortran_order")? == "True";
    let values = if is_fortran {
        last_fastest(&shape, &values)
    } else {
        values
    };
    Ok(Array { shape, values })
}

/// The value of a key in the head of an array.
fn said<'a>(head: &'a str, key: &str) -> Result<&'a str, Refusal> {
    let at = head.find(&format!("'{key}':")).ok_or(Refusal::Damaged)?;
    let value = head[at + key.len() + 3..].trim_start();
    let end = match value.as_bytes().first() {
        Some(b'(') => value.find(')').map(|end| end + 1),
        Some(b'[') => value.find(']').map(|end| end + 1),
        _ => value.find([',', '}']),
    };
    Ok(value[..end.ok_or(Refusal::Damaged)?].trim())
}

/// The entries, read as a type such as `<f8`.
fn entries(bytes: &[u8], kind: &str) -> Result<Vec<f64>, Refusal> {
    let (is_big, name) = match kind.as_bytes().first() {
        Some(b'>') => (true, &kind[1..]),
        Some(b'<' | b'|' | b'=') => (false, &kind[1..]),
        _ => (false, kind),
    };
    #[allow(
        clippy::cast_precision_loss,
        reason = "numbers are read as f64 wherever they stand"
    )]
    let number: fn([u8; 8]) -> f64 = match name {
        "f8" => f64::from_le_bytes,
        "f4" => |it| f64::from(f32::from_le_bytes([it[0], it[1], it[2], it[3]])),
        "i8" => |it| i64::from_le_bytes(it) as f64,
        "i4" => |it| f64::from(i32::from_le_bytes([it[0], it[1], it[2], it[3]])),
        "i2" => |it| f64::from(i16::from_le_bytes([it[0], it[1]])),
        "i1" => |it| f64::from(i8::from_le_bytes([it[0]])),
        "u8" => |it| u64::from_le_bytes(it) as f64,
        "u4" => |it| f64::from(u32::from_le_bytes([it[0], it[1], it[2], it[3]])),
        "u2" => |it| f64::from(u16::from_le_bytes([it[0], it[1]])),
        "u1" | "b1" => |it| f64::from(it[0]),
        _ => return Err(Refusal::Kind(kind.to_owned())),
    };
    // Every known name ends in its size.
    let size = usize::from(name.as_bytes()[1] - b'0');
    let entry = |part: &[u8]| {
        let mut bytes = [0; 8];
        bytes[..size].copy_from_slice(part);
        if is_big {
            bytes[..size].reverse();
        }
        number(bytes)
    };
    let parts = bytes.chunks_exact(size);
    if !parts.remainder().is_empty() {
        return Err(Refusal::Damaged);
    }
    Ok(parts.map(entry).collect())
}

/// Reorders entries whose first axis varies fastest so that the last one does.
fn last_fastest(shape: &[usize], values: &[f64]) -> Vec<f64> {
    let mut at = vec![0; shape.len()];
    let mut ordered = Vec::with_capacity(values.len());
    for _ in values {
        let place = at
            .iter()
            .zip(shape)
            .rev()
            .fold(0, |place, (at, length)| place * length + at);
        ordered.push(values[place]);
        for axis in (0..shape.len()).rev() {
            at[axis] += 1;
            if at[axis] < shape[axis] {
                break;
            }
            at[axis] = 0;
        }
    }
    ordered
}

impl Array {
    /// The mean of the entries at a place of the first axis.
    #[allow(clippy::cast_precision_loss, reason = "numbers of entries are far below 2^52")]
    fn mean_of(&self, place: usize) -> f64 {
        let of_line = self.values.len() / self.shape[0];
        let entries = &self.values[place * of_line..(place + 1) * of_line];
        entries.iter().sum::<f64>() / entries.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::{super::content::content, *};

    /// `numpy.savez_compressed` of NumPy 2.4.6: `timesteps` (i8, 3), `results` (f8, 3 x 4), `ep_lengths` (i4, 3
    /// x 4, the first axis fastest), `best` (f4, no axis), `names` (text, 3) and `seen` (b1, 7).
    const EVALUATIONS: &[u8] = include_bytes!("fixtures/evaluations.npz");

    fn read(bytes: &[u8]) -> Result<LogTable, String> {
        table(&content("evaluations.npz", bytes)).map_err(|error| error.to_string())
    }

    #[test]
    fn arrays_of_one_length_are_columns_and_further_axes_are_averaged() {
        let table = read(EVALUATIONS).unwrap();
        assert_eq!(table.names, ["timesteps", "results", "ep_lengths"]);
        let cells: Vec<Vec<&str>> = table
            .lines
            .iter()
            .map(|line| line.cells.iter().collect())
            .collect();
        assert_eq!(
            cells,
            [
                ["1000", "1.5", "10"],
                ["2000", "5.5", "20"],
                ["3000", "9.5", "30"]
            ]
        );
        let notes = table.notes.join("\n");
        for says in [
            "`results` of `evaluations.npz` has 4 values on a line, of which the mean counts",
            "`seen` of `evaluations.npz` has another length",
            "`names` of `evaluations.npz` is of kind <U2",
        ] {
            assert!(notes.contains(says), "{notes}");
        }
    }

    #[test]
    fn every_kind_of_number_is_read_in_either_order_of_bytes() {
        let array = |kind: &str, shape: &str, data: &[u8]| {
            let head = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n");
            let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
            bytes.extend(u16::try_from(head.len()).unwrap().to_le_bytes());
            bytes.extend(head.bytes());
            bytes.extend(data);
            parsed(&bytes)
        };
        let one = |kind: &str, data: &[u8]| array(kind, "(1,)", data).unwrap().values[0].to_string();
        assert_eq!(one("<f8", &2.5_f64.to_le_bytes()), "2.5");
        assert_eq!(one(">f8", &2.5_f64.to_be_bytes()), "2.5");
        assert_eq!(one("<f4", &2.5_f32.to_le_bytes()), "2.5");
        assert_eq!(one(">i4", &(-7_i32).to_be_bytes()), "-7");
        assert_eq!(one("<i8", &(-7_i64).to_le_bytes()), "-7");
        assert_eq!(one("<i2", &(-7_i16).to_le_bytes()), "-7");
        assert_eq!(one("|i1", &(-7_i8).to_le_bytes()), "-7");
        assert_eq!(one("<u8", &7_u64.to_le_bytes()), "7");
        assert_eq!(one("<u4", &7_u32.to_le_bytes()), "7");
        assert_eq!(one("<u2", &7_u16.to_le_bytes()), "7");
        assert_eq!(one("|b1", &[1]), "1");
        assert_eq!(array("|O", "(1,)", &[0; 8]), Err(Refusal::Kind("|O".into())));
        assert_eq!(array("<f8", "(2,)", &[0; 8]), Err(Refusal::Damaged));
        assert_eq!(array("<f8", "(1,)", &[0; 9]), Err(Refusal::Damaged));
    }

    #[test]
    fn what_is_no_archive_of_arrays_is_refused_with_a_reason() {
        let torn = read(&EVALUATIONS[..EVALUATIONS.len() / 2]).unwrap_err();
        assert!(torn.contains("NumPy (.npz) write, and cannot be read"), "{torn}");
        let mut other = Vec::new();
        let mut archive = zip::ZipWriter::new(Cursor::new(&mut other));
        let options = zip::write::SimpleFileOptions::default();
        archive.start_file("xl/workbook.xml", options).unwrap();
        archive.finish().unwrap();
        assert!(
            read(&other)
                .unwrap_err()
                .contains("without arrays of NumPy: save the table as CSV")
        );
    }
}
