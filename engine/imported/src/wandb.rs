//! Offline runs of W&B: `run-ID.wandb`, a log in LevelDB's format with records in Protocol Buffers.
//!
//! The file begins with `:W&B`, two bytes and a version, followed by blocks of 32768 bytes. A block holds fragments: a
//! CRC-32 of kind and data (u32), the length of the data (u16, both little endian), the kind (whole, first, middle,
//! last) and the data. If the end of a block is shorter than a fragment's head, it is padding. Numbers of fields are
//! those of `wandb/proto/wandb_internal.proto`.

use super::{
    content::Content,
    table::{LogLine, LogTable},
};
use contract::Error;
use csv::StringRecord;
use prost::Message;
use serde_json::Value;
use std::collections::BTreeMap;

/// The column with the steps of `wandb.log`.
const STEP: &str = "_step";

const FILE_HEAD: usize = 7;
const BLOCK: usize = 32_768;
const FRAGMENT_HEAD: usize = 7;

#[derive(Clone, PartialEq, Message)]
struct Record {
    /// The values of one call of `wandb.log`.
    #[prost(message, optional, tag = "2")]
    history: Option<History>,
}

#[derive(Clone, PartialEq, Message)]
struct History {
    #[prost(message, repeated, tag = "1")]
    item: Vec<Item>,
    #[prost(message, optional, tag = "2")]
    step: Option<Step>,
}

#[derive(Clone, PartialEq, Message)]
struct Item {
    #[prost(string, tag = "1")]
    key: String,
    /// The parts of a nested name, from outer to inner, instead of `key`.
    #[prost(string, repeated, tag = "2")]
    nested_key: Vec<String>,
    #[prost(string, tag = "16")]
    value_json: String,
}

#[derive(Clone, PartialEq, Message)]
struct Step {
    #[prost(int64, tag = "1")]
    num: i64,
}

/// The table of a run: a line for every call of `wandb.log`, a column for every name, nested ones joined by `/`.
pub(super) fn table(file: &Content) -> Result<LogTable, Error> {
    let (records, is_torn) = records(file)?;
    let mut names: Vec<String> = Vec::new();
    let mut places: BTreeMap<String, usize> = BTreeMap::new();
    let mut lines = Vec::new();
    for data in records {
        let record = Record::decode(&data[..])
            .map_err(|error| file.wrong(None, format!("a record is none of W&B: {error}")))?;
        let Some(history) = record.history else { continue };
        let mut cells = Vec::new();
        for (name, text) in values(&history) {
            let place = *places.entry(name).or_insert_with_key(|name| {
                names.push(name.clone());
                names.len() - 1
            });
            if cells.len() <= place {
                cells.resize(place + 1, String::new());
            }
            cells[place] = text;
        }
        lines.push(LogLine {
            number: lines.len() as u64 + 1,
            begins_again: false,
            cells: StringRecord::from(cells),
        });
    }
    let torn = format!(
        "the last record of `{}` was not written to its end and is left out",
        file.name()
    );
    Ok(LogTable {
        path: file.path.clone(),
        names,
        lines,
        notes: is_torn.then_some(torn).into_iter().collect(),
        ..LogTable::default()
    })
}

/// The values of a call, by name.
fn values(history: &History) -> Vec<(String, String)> {
    let named = |item: &Item| match item.nested_key.is_empty() {
        true => item.key.clone(),
        false => item.nested_key.join("/"),
    };
    let value = |item: &Item| Some((named(item), text(&item.value_json)?));
    let mut values: Vec<_> = history.item.iter().filter_map(value).collect();
    if let Some(step) = &history.step
        && !values.iter().any(|(name, _)| name == STEP)
    {
        values.push((STEP.into(), step.num.to_string()));
    }
    values
}

/// A value as the cell of a table; `None` for lists and objects such as pictures and histograms.
fn text(json: &str) -> Option<String> {
    match serde_json::from_str(json) {
        Ok(Value::Array(_) | Value::Object(_) | Value::Null) => None,
        Ok(Value::String(text)) => Some(text),
        Ok(Value::Bool(is_true)) => Some(u8::from(is_true).to_string()),
        // `NaN` and `Infinity` are not valid JSON, and numbers keep their notation.
        Ok(Value::Number(_)) | Err(_) => Some(json.trim().to_owned()),
    }
}

/// The records of a log, and whether the last one is incomplete.
fn records(file: &Content) -> Result<(Vec<Vec<u8>>, bool), Error> {
    let bytes = &file.bytes;
    let (mut all, mut begun) = (Vec::new(), None::<Vec<u8>>);
    let mut at = FILE_HEAD;
    while at < bytes.len() {
        let left = BLOCK - at % BLOCK;
        if left < FRAGMENT_HEAD {
            at += left;
            continue;
        }
        let Some((kind, data)) = fragment(&bytes[at..]) else {
            return Ok((all, true));
        };
        let end = at + FRAGMENT_HEAD + data.len();
        if !is_intact(&bytes[at..end]) {
            if end == bytes.len() {
                return Ok((all, true));
            }
            return Err(file.wrong(
                None,
                format!("it is damaged at byte {at}: the checksum is another one"),
            ));
        }
        match (kind, begun.as_mut()) {
            (1, None) => all.push(data.to_vec()),
            (2, None) => begun = Some(data.to_vec()),
            (3, Some(record)) => record.extend(data),
            (4, Some(record)) => {
                record.extend(data);
                all.extend(begun.take());
            }
            _ => {
                return Err(file.wrong(
                    None,
                    format!("it is damaged at byte {at}: no record goes on here"),
                ));
            }
        }
        at = end;
    }
    Ok((all, begun.is_some()))
}

/// The kind and the data of the first fragment; `None` if it is incomplete.
fn fragment(bytes: &[u8]) -> Option<(u8, &[u8])> {
    let head = bytes.get(..FRAGMENT_HEAD)?;
    let length = usize::from(u16::from_le_bytes([head[4], head[5]]));
    Some((head[6], bytes.get(FRAGMENT_HEAD..FRAGMENT_HEAD + length)?))
}

/// Whether a fragment matches its checksum.
fn is_intact(fragment: &[u8]) -> bool {
    let said = u32::from_le_bytes([fragment[0], fragment[1], fragment[2], fragment[3]]);
    crc32fast::hash(&fragment[FRAGMENT_HEAD - 1..]) == said
}

#[cfg(test)]
mod tests {
    use super::{super::content::content, *};

    /// Written by W&B 0.31.0 with 40 calls of `wandb.log`: numbers, a nested dictionary, a text, and NaN at step 70.
    const RUN: &[u8] = include_bytes!("fixtures/run.wandb");

    fn read(bytes: &[u8]) -> Result<LogTable, String> {
        table(&content("run-1.wandb", bytes)).map_err(|error| error.to_string())
    }

    fn column(table: &LogTable, name: &str) -> Vec<String> {
        let place = table.column(name).unwrap();
        table
            .lines
            .iter()
            .map(|line| table.cell(line, place).to_owned())
            .collect()
    }

    #[test]
    fn a_run_is_a_table_with_a_line_for_each_call() {
        let table = read(RUN).unwrap();
        assert_eq!(table.lines.len(), 40);
        let steps: Vec<String> = (0..40).map(|call| (call * 10).to_string()).collect();
        assert_eq!(column(&table, "_step"), steps);
        let returns = column(&table, "charts/return");
        assert_eq!((&*returns[0], &*returns[39]), ("0", "19.5"));
        assert_eq!(column(&table, "loss")[7], "NaN");
        let scores = column(&table, "eval/score");
        assert_eq!((&*scores[0], &*scores[1], &*scores[20]), ("0", "", "2"));
        assert_eq!(column(&table, "eval/ok")[0], "1");
        assert_eq!(column(&table, "note")[8], "text");
        assert!(table.notes.is_empty());
    }

    #[test]
    fn a_run_that_is_being_written_is_read_up_to_its_last_whole_record() {
        for end in [RUN.len() - 1, RUN.len() - 400, 9] {
            let table = read(&RUN[..end]).unwrap();
            assert!(table.lines.len() <= 40);
            assert!(
                table.notes[0].contains("was not written to its end"),
                "{:?}",
                table.notes
            );
        }
        let mut torn = RUN.to_vec();
        *torn.last_mut().unwrap() ^= 1;
        assert_eq!(read(&torn).unwrap().notes.len(), 1);
    }

    #[test]
    fn a_damaged_run_is_refused_with_the_place() {
        let mut damaged = RUN.to_vec();
        damaged[40] ^= 1;
        assert!(read(&damaged).unwrap_err().contains("it is damaged at byte 7"));
    }

    /// A record across three blocks, and padding that is shorter than a fragment's head.
    #[test]
    fn records_go_on_over_blocks() {
        let long = History {
            item: vec![Item {
                key: "x".repeat(70_000),
                nested_key: Vec::new(),
                value_json: "1".into(),
            }],
            step: Some(Step { num: 3 }),
        };
        let records = [
            Record { history: Some(long) }.encode_to_vec(),
            // Leaves five bytes of a block.
            vec![0; 0],
            Record::default().encode_to_vec(),
        ];
        let bytes = written(&records);
        let (read, is_torn) = super::records(&content("a", &bytes)).unwrap();
        assert_eq!((read, is_torn), (records.to_vec(), false));
        let table = table(&content("a", &bytes)).unwrap();
        assert_eq!((table.lines.len(), table.names[1].as_str()), (1, "_step"));
    }

    /// A log as W&B writes it.
    fn written(records: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = b":W&B\xe1\xbe\0".to_vec();
        for record in records {
            let mut left = &record[..];
            let mut first = true;
            loop {
                let room = BLOCK - bytes.len() % BLOCK;
                if room < FRAGMENT_HEAD {
                    bytes.resize(bytes.len() + room, 0);
                    continue;
                }
                let (now, later) = left.split_at(left.len().min(room - FRAGMENT_HEAD));
                let kind = match (first, later.is_empty()) {
                    (true, true) => 1,
                    (true, false) => 2,
                    (false, false) => 3,
                    (false, true) => 4,
                };
                let checked = [&[kind], now].concat();
                bytes.extend(crc32fast::hash(&checked).to_le_bytes());
                bytes.extend(u16::try_from(now.len()).unwrap().to_le_bytes());
                bytes.extend(checked);
                (left, first) = (later, false);
                if left.is_empty() {
                    break;
                }
            }
        }
        bytes
    }
}
