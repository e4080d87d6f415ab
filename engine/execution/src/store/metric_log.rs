//! The log of a running trial: its rows so far, in frames that are only ever appended.
//!
//! | bytes of a frame | content |
//! |---|---|
//! | 4 | length of the payload |
//! | 8 | number of the frame, from 0 |
//! | 8 | the first bytes of a BLAKE3 hash over the twelve bytes before and the payload |
//! | length | payload |
//!
//! The payload of frame 0 is the version of this form and the trial's id. The payload of every other frame
//! holds the new names and rows: a count of names, each with its length in front; a count of rows, each a
//! byte for the phase, then step, episode, seat and index of the metric, then the eight bytes of the value.
//! Counts and whole numbers are written in seven-bit groups (LEB128), everything else with the low byte
//! first.

use crate::world::fs::{self, File, OpenOptions};
use contract::{
    Error, Recorder, digest,
    metrics_file::MetricsTable,
    recorder::{Phase, Row},
};
use serde::{Deserialize, Serialize};
use std::{
    io::Write,
    path::{Path, PathBuf},
};

const HEADER: usize = 20;
const VERSION: &str = "regimen metric log 1\n";
/// Largest number of rows of one frame, so that a reader never waits for a large one.
const ROWS_PER_FRAME: usize = 1 << 16;

/// Content of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct LogContents {
    /// Id of the log's trial; empty if even the first frame is incomplete.
    pub trial: String,
    /// All rows before the end or the damage.
    pub table: MetricsTable,
    /// State of the log's end.
    pub end: LogEnd,
}

/// State of a log's end; offsets are bytes from the start of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogEnd {
    /// The log ends with a complete frame.
    Whole,
    /// The last frame was not written to its end, or is still being written.
    Torn {
        /// Offset at which that frame begins.
        offset: usize,
    },
    /// Bytes were changed: complete frames follow a damaged one.
    Damaged {
        /// Offset at which the first changed frame begins.
        offset: usize,
    },
}

/// A position in a log, identified by the content before it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogPosition {
    bytes: u64,
    digest: String,
}

/// Reads a log, which may still be in the process of being written.
///
/// # Errors
/// [`Error::File`] if the file cannot be read. Damage is not an error, see [`LogContents::end`].
pub fn read(path: &Path) -> Result<LogContents, Error> {
    bytes_of(path)
        .map(|bytes| decode(&bytes))
        .map_err(Error::file("read", path))
}

/// Bytes of a log's file; an entry of another kind is not opened.
fn bytes_of(path: &Path) -> std::io::Result<Vec<u8>> {
    if fs::symlink_metadata(path)?.is_file() {
        fs::read(path)
    } else {
        let what = "it is no file";
        Err(std::io::Error::new(std::io::ErrorKind::InvalidData, what))
    }
}

/// Whether a log still has its content up to a position; the log is not changed.
pub(super) fn holds(path: &Path, position: &LogPosition) -> bool {
    let bytes = bytes_of(path).unwrap_or_default();
    let end = usize::try_from(position.bytes).ok();
    let before = end.and_then(|end| bytes.get(..end));
    before.is_some_and(|before| digest::of_bytes(before) == position.digest)
}

/// A log that is being written.
#[derive(Debug)]
pub struct MetricLog {
    path: PathBuf,
    file: File,
    frames: u64,
    bytes: u64,
    hasher: blake3::Hasher,
    names: usize,
    rows: usize,
}

impl MetricLog {
    /// Begins a log; an existing one is lost.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be written.
    pub fn create(path: &Path, trial: &str) -> Result<Self, Error> {
        File::create(path).map_err(Error::file("create", path))?;
        let mut log = Self::at_end(path, &[], &MetricsTable::default(), 0)?;
        log.write(&[VERSION.as_bytes(), trial.as_bytes()].concat())?;
        Ok(log)
    }

    /// Continues at a position and returns the rows before it; the rest of the file is cut off. `None` if the log no
    /// longer has its content at that position.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be read or written.
    pub fn resume(
        path: &Path,
        trial: &str,
        position: &LogPosition,
    ) -> Result<Option<(Self, MetricsTable)>, Error> {
        let Ok(bytes) = bytes_of(path) else {
            return Ok(None);
        };
        let Some(before) = usize::try_from(position.bytes)
            .ok()
            .and_then(|end| bytes.get(..end))
        else {
            return Ok(None);
        };
        let (contents, frames) = decode_counted(before);
        let fits = digest::of_bytes(before) == position.digest
            && contents.end == LogEnd::Whole
            && contents.trial == trial;
        if !fits {
            return Ok(None);
        }
        let log = Self::at_end(path, before, &contents.table, frames)?;
        log.file
            .set_len(position.bytes)
            .map_err(Error::file("cut", path))?;
        Ok(Some((log, contents.table)))
    }

    fn at_end(path: &Path, before: &[u8], table: &MetricsTable, frames: u64) -> Result<Self, Error> {
        let file = OpenOptions::new()
            .append(true)
            .open(path)
            .map_err(Error::file("open", path))?;
        let mut hasher = blake3::Hasher::new();
        hasher.update(before);
        let (names, rows) = (table.names.len(), table.rows.len());
        Ok(Self {
            path: path.into(),
            file,
            frames,
            bytes: before.len() as u64,
            hasher,
            names,
            rows,
        })
    }

    /// Number of rows in the log.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Appends the rows that were recorded since the last time.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be written.
    pub fn append(&mut self, record: &Recorder) -> Result<(), Error> {
        for rows in record.rows()[self.rows..].chunks(ROWS_PER_FRAME) {
            let payload = encode(&record.names()[self.names..], rows);
            self.write(&payload)?;
            (self.names, self.rows) = (record.names().len(), self.rows + rows.len());
        }
        Ok(())
    }

    /// Flushes the log to the disk.
    ///
    /// # Errors
    /// The error of the system.
    pub fn flush(&self) -> Result<(), Error> {
        self.file.sync_data().map_err(Error::file("flush", &self.path))
    }

    /// Position of the end of the log.
    #[must_use]
    pub fn position(&self) -> LogPosition {
        LogPosition {
            bytes: self.bytes,
            digest: digest::of_hash(&self.hasher.finalize()),
        }
    }

    fn write(&mut self, payload: &[u8]) -> Result<(), Error> {
        let frame = frame(self.frames, payload);
        self.file
            .write_all(&frame)
            .map_err(Error::file("write", &self.path))?;
        self.hasher.update(&frame);
        self.frames += 1;
        self.bytes += frame.len() as u64;
        Ok(())
    }
}

fn frame(number: u64, payload: &[u8]) -> Vec<u8> {
    // A frame holds at most 65536 rows of at most 35 bytes, and names.
    let length = u32::try_from(payload.len()).unwrap_or(u32::MAX);
    let mut frame = Vec::with_capacity(HEADER + payload.len());
    frame.extend(length.to_le_bytes());
    frame.extend(number.to_le_bytes());
    frame.extend(checksum(&frame, payload));
    frame.extend(payload);
    frame
}

fn checksum(length_and_number: &[u8], payload: &[u8]) -> [u8; 8] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(length_and_number).update(payload);
    let mut first = [0; 8];
    first.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    first
}

fn encode(names: &[String], rows: &[Row]) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 + 20 * rows.len());
    integer(names.len() as u64, &mut out);
    for name in names {
        integer(name.len() as u64, &mut out);
        out.extend(name.as_bytes());
    }
    integer(rows.len() as u64, &mut out);
    for row in rows {
        out.push(row.phase as u8);
        for whole in [row.step, row.episode, row.seat.into(), row.metric.into()] {
            integer(whole, &mut out);
        }
        out.extend(row.value.to_bits().to_le_bytes());
    }
    out
}

fn integer(mut value: u64, out: &mut Vec<u8>) {
    while value >= 0x80 {
        out.push((value & 0x7f) as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn decode(bytes: &[u8]) -> LogContents {
    decode_counted(bytes).0
}

/// Content of a log, and the number of its complete frames.
fn decode_counted(bytes: &[u8]) -> (LogContents, u64) {
    let mut contents = LogContents {
        trial: String::new(),
        table: MetricsTable::default(),
        end: LogEnd::Whole,
    };
    let (mut offset, mut number) = (0, 0);
    while offset < bytes.len() {
        let payload = frame_at(bytes, offset)
            .filter(|(found, _)| *found == number)
            .map(|(_, payload)| payload);
        match payload.filter(|payload| contents.take_in(number, payload).is_some()) {
            Some(payload) => (offset, number) = (offset + HEADER + payload.len(), number + 1),
            None => {
                contents.end = how_it_ends(bytes, offset, number);
                break;
            }
        }
    }
    (contents, number)
}

/// Number and payload of the frame at `offset`, if a complete one begins there.
fn frame_at(bytes: &[u8], offset: usize) -> Option<(u64, &[u8])> {
    let rest = &bytes[offset..];
    let (header, rest) = rest.split_at_checked(HEADER)?;
    let length = u32::from_le_bytes(header[..4].try_into().ok()?);
    let payload = rest.get(..usize::try_from(length).ok()?)?;
    let number = u64::from_le_bytes(header[4..12].try_into().ok()?);
    // A frame number that is impossible for a file of this size makes hashing unnecessary.
    let possible = number <= (bytes.len() / HEADER) as u64;
    (possible && checksum(&header[..12], payload) == header[12..]).then_some((number, payload))
}

/// State of the end if frame `number` does not begin at this place: complete frames after it show that the frame
/// existed.
fn how_it_ends(bytes: &[u8], offset: usize, number: u64) -> LogEnd {
    let is_later = |place| frame_at(bytes, place).is_some_and(|(found, _)| found >= number);
    if (offset..bytes.len()).any(is_later) {
        LogEnd::Damaged { offset }
    } else {
        LogEnd::Torn { offset }
    }
}

impl LogContents {
    /// Adds the rows of a complete frame; `None`, without a change, for a malformed one.
    fn take_in(&mut self, number: u64, payload: &[u8]) -> Option<()> {
        if number == 0 {
            let trial = payload.strip_prefix(VERSION.as_bytes())?;
            self.trial = String::from_utf8(trial.to_vec()).ok()?;
            return Some(());
        }
        let mut payload = Payload(payload);
        let names = (0..payload.integer()?)
            .map(|_| payload.name())
            .collect::<Option<Vec<_>>>()?;
        let rows = (0..payload.integer()?)
            .map(|_| payload.row())
            .collect::<Option<Vec<_>>>()?;
        let known = self.table.names.len() + names.len();
        let most = usize::from(u16::MAX) + 1;
        if known > most || !payload.0.is_empty() || rows.iter().any(|row| usize::from(row.metric) >= known) {
            return None;
        }
        self.table.names.extend(names);
        self.table.rows.extend(rows);
        Some(())
    }
}

/// The unread rest of a payload.
struct Payload<'a>(&'a [u8]);

impl<'a> Payload<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn integer(&mut self) -> Option<u64> {
        let mut value = 0u64;
        for shift in (0..64).step_by(7) {
            let byte = self.take(1)?[0];
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(value);
            }
        }
        None
    }

    fn name(&mut self) -> Option<String> {
        let length = usize::try_from(self.integer()?).ok()?;
        String::from_utf8(self.take(length)?.to_vec()).ok()
    }

    fn row(&mut self) -> Option<Row> {
        let phase = *Phase::ALL.get(usize::from(self.take(1)?[0]))?;
        let (step, episode) = (self.integer()?, self.integer()?);
        let (seat, metric) = (
            u16::try_from(self.integer()?).ok()?,
            u16::try_from(self.integer()?).ok()?,
        );
        let value = f64::from_bits(u64::from_le_bytes(self.take(8)?.try_into().ok()?));
        Some(Row {
            phase,
            step,
            episode,
            seat,
            metric,
            value,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Records `count` rows, some under names that were not there before.
    fn record(record: &mut Recorder, count: u64) {
        for _ in 0..count {
            let index = record.rows().len() as u64;
            let phase = Phase::ALL[index as usize % 4];
            let value = [0.1, f64::NAN, -0.0, 1e300][index as usize % 4] * index as f64;
            record.add(
                phase,
                index * 1000,
                index / 3,
                index as usize % 5,
                &format!("metric_{}", index / 4),
                value,
            );
        }
    }

    /// A log with a frame per entry of `counts`, and its record.
    fn written(path: &Path, counts: &[u64]) -> (MetricLog, Recorder) {
        let (mut log, mut recorder) = (MetricLog::create(path, "trial").unwrap(), Recorder::default());
        for count in counts {
            record(&mut recorder, *count);
            log.append(&recorder).unwrap();
        }
        (log, recorder)
    }

    fn bits(rows: &[Row]) -> Vec<(Phase, u64, u64, u16, u16, u64)> {
        rows.iter()
            .map(|row| {
                (
                    row.phase,
                    row.step,
                    row.episode,
                    row.seat,
                    row.metric,
                    row.value.to_bits(),
                )
            })
            .collect()
    }

    /// Rows of the frames that lie wholly before `offset`.
    fn rows_before(counts: &[u64], offset: usize) -> usize {
        let (mut recorder, mut end, mut names) = (
            Recorder::default(),
            frame(0, &[VERSION.as_bytes(), b"trial"].concat()).len(),
            0,
        );
        for (number, count) in counts.iter().filter(|count| **count > 0).enumerate() {
            let before = recorder.rows().len();
            record(&mut recorder, *count);
            end += frame(
                number as u64 + 1,
                &encode(&recorder.names()[names..], &recorder.rows()[before..]),
            )
            .len();
            names = recorder.names().len();
            if end > offset {
                return before;
            }
        }
        recorder.rows().len()
    }

    #[test]
    fn a_log_continues_at_a_position_and_forgets_what_came_after() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.log");
        let (mut log, mut recorder) = written(&path, &[3, 0, 5]);
        let position = log.position();
        log.flush().unwrap();
        record(&mut recorder, 4);
        log.append(&recorder).unwrap();
        let (mut log, table) = MetricLog::resume(&path, "trial", &position).unwrap().unwrap();
        assert_eq!(
            (log.position(), bits(&table.rows)),
            (position.clone(), bits(&recorder.rows()[..8]))
        );
        let mut again = Recorder::resumed(table.names, table.rows, recorder.running().clone());
        record(&mut again, 4);
        log.append(&again).unwrap();
        let contents = read(&path).unwrap();
        assert_eq!((contents.trial.as_str(), contents.end), ("trial", LogEnd::Whole));
        assert_eq!(
            (bits(&contents.table.rows), contents.table.names.as_slice()),
            (bits(recorder.rows()), recorder.names())
        );
        assert!(MetricLog::resume(&path, "another", &position).unwrap().is_none());
        let elsewhere = LogPosition {
            bytes: position.bytes - 1,
            ..position
        };
        assert!(MetricLog::resume(&path, "trial", &elsewhere).unwrap().is_none());
    }

    #[test]
    fn many_rows_are_several_frames() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.log");
        let mut recorder = Recorder::default();
        (0..70_000).for_each(|step| recorder.add(Phase::Final, step, 0, 0, "return", step as f64));
        MetricLog::create(&path, "trial")
            .unwrap()
            .append(&recorder)
            .unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let (contents, frames) = decode_counted(&bytes);
        assert_eq!((frames, bits(&contents.table.rows)), (3, bits(recorder.rows())));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn what_is_cut_off_is_a_torn_end(counts in proptest::collection::vec(0..6u64, 1..6),
            part in 0.0..1.0f64) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("metrics.log");
            let (_, recorder) = written(&path, &counts);
            let mut bytes = std::fs::read(&path).unwrap();
            bytes.truncate((bytes.len() as f64 * part) as usize);
            let contents = decode(&bytes);
            prop_assert_eq!(bits(&contents.table.rows), bits(&recorder.rows()[..rows_before(&counts,
                bytes.len())]));
            let is_damage = matches!(contents.end, LogEnd::Damaged { .. });
            prop_assert!(!is_damage);
        }

        #[test]
        fn changed_bits_are_noticed(
            counts in proptest::collection::vec(1..6u64, 1..6),
            flips in proptest::collection::vec((0.0..1.0f64, 0..8u8), 1..4),
        ) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("metrics.log");
            let (log, recorder) = written(&path, &counts);
            let original = std::fs::read(&path).unwrap();
            let mut bytes = original.clone();
            flips.iter().for_each(|(part, bit)| bytes[(original.len() as f64 * part) as usize] ^= 1 << bit);
            let Some(first) = original.iter().zip(&bytes).position(|(one,
                two)| one != two) else { return Ok(()) };
            let contents = decode(&bytes);
            prop_assert_eq!(bits(&contents.table.rows), bits(&recorder.rows()[..rows_before(&counts,
                first)]));
            prop_assert_ne!(contents.end, LogEnd::Whole);
            let last_change = original.iter().zip(&bytes).rposition(|(one, two)| one != two).unwrap();
            // A complete frame after the changed ones shows that the change is no torn end.
            let changed_to_the_end = rows_before(&counts,
                last_change) + *counts.last().unwrap() as usize == recorder.rows().len();
            let is_damage = matches!(contents.end, LogEnd::Damaged { .. });
            prop_assert!(changed_to_the_end || is_damage);
            std::fs::write(&path, bytes).unwrap();
            prop_assert!(MetricLog::resume(&path, "trial", &log.position()).unwrap().is_none());
        }
    }
}
