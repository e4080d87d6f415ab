//! Byte format of a pack.
//!
//! ```text
//! regimen pack 1\n
//! trial <id> <length of trial.json> <length of metrics.parquet> <check of this line>\n   once per trial, in the
//! <trial.json><metrics.parquet>                                                          order of ids
//! ...
//! <how trials ended>                                          see `outline`
//! <id, place, both lengths>                                   the index: 32 bytes per trial
//! index <its place> <number of trials> <hash of the index>\n  the end, of fixed length
//! ```
//!
//! Lengths, places and the checksum (CRC-32C) are hexadecimal digits. The index only saves time: the bytes before it
//! contain the same information, so that a pack with a damaged end still gives every intact trial.

use super::{
    super::index::parse,
    outline::{OutlineWriter, Outlines},
};
use contract::digest::of_bytes as hash;
use std::io::{self, BufRead, Read, Seek, SeekFrom, Write};

pub(super) const BEGIN: &[u8] = b"regimen pack 1\n";
const HEAD_LENGTH: usize = "trial ".len() + 32 + 3 * " 01234567".len() + 1;
const END_LENGTH: usize = "index ".len() + 2 * 17 + 32 + 1;
const ENTRY_LENGTH: usize = 32;

/// Entry of a trial in the index of a pack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PackEntry {
    /// Id of the trial, as a number.
    pub(super) id: u128,
    /// Offset of its `trial.json`, in bytes; its metrics follow.
    pub(super) at: u64,
    pub(super) acknowledgement: u32,
    pub(super) metrics: u32,
}

impl PackEntry {
    /// Length of both files in bytes.
    pub(super) fn length(&self) -> u64 {
        u64::from(self.acknowledgement) + u64::from(self.metrics)
    }

    fn to_bytes(self) -> [u8; ENTRY_LENGTH] {
        let mut bytes = [0; ENTRY_LENGTH];
        bytes[..16].copy_from_slice(&self.id.to_be_bytes());
        bytes[16..24].copy_from_slice(&self.at.to_le_bytes());
        bytes[24..28].copy_from_slice(&self.acknowledgement.to_le_bytes());
        bytes[28..].copy_from_slice(&self.metrics.to_le_bytes());
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        Some(Self {
            id: u128::from_be_bytes(bytes.get(..16)?.try_into().ok()?),
            at: u64::from_le_bytes(bytes.get(16..24)?.try_into().ok()?),
            acknowledgement: u32::from_le_bytes(bytes.get(24..28)?.try_into().ok()?),
            metrics: u32::from_le_bytes(bytes.get(28..ENTRY_LENGTH)?.try_into().ok()?),
        })
    }
}

/// The id of a trial as a number; `None` if the text is no id.
pub(super) fn number(id: &str) -> Option<u128> {
    let digits = id.len() == 32 && id.bytes().all(|byte| byte.is_ascii_hexdigit());
    digits.then(|| u128::from_str_radix(id, 16).ok()).flatten()
}

/// Id of a trial from its [`number`].
pub(super) fn id_of(number: u128) -> String {
    format!("{number:032x}")
}

/// Writes a pack, trial by trial in the order of ids.
pub(super) struct Writer<W: Write> {
    to: W,
    at: u64,
    entries: Vec<PackEntry>,
    outlines: OutlineWriter,
}

impl<W: Write> Writer<W> {
    pub(super) fn begin(mut to: W) -> io::Result<Self> {
        to.write_all(BEGIN)?;
        Ok(Self {
            to,
            at: BEGIN.len() as u64,
            entries: Vec::new(),
            outlines: OutlineWriter::default(),
        })
    }

    /// Adds a trial.
    ///
    /// # Errors
    /// The error of the output, and one for a file of 4 GiB or more.
    pub(super) fn add(&mut self, id: u128, acknowledgement: &[u8], metrics: &[u8]) -> io::Result<()> {
        let length = |bytes: &[u8]| u32::try_from(bytes.len()).map_err(io::Error::other);
        let entry = PackEntry {
            id,
            at: self.at + HEAD_LENGTH as u64,
            acknowledgement: length(acknowledgement)?,
            metrics: length(metrics)?,
        };
        for bytes in [head(&entry).as_bytes(), acknowledgement, metrics] {
            self.to.write_all(bytes)?;
        }
        self.at = entry.at + entry.length();
        self.entries.push(entry);
        self.outlines.add(parse(acknowledgement).ok());
        Ok(())
    }

    /// Writes the index; returns the output and the entries.
    pub(super) fn end(mut self) -> io::Result<(W, Vec<PackEntry>)> {
        let at = self.outlines.write(&mut self.to, self.at)?;
        let index: Vec<u8> = self.entries.iter().flat_map(|entry| entry.to_bytes()).collect();
        self.to.write_all(&index)?;
        let n = self.entries.len();
        writeln!(self.to, "index {at:016x} {n:016x} {}", hash(&index))?;
        Ok((self.to, self.entries))
    }
}

fn head(entry: &PackEntry) -> String {
    let said = format!(
        "trial {} {:08x} {:08x}",
        id_of(entry.id),
        entry.acknowledgement,
        entry.metrics
    );
    let check = crc32c::crc32c(said.as_bytes());
    format!("{said} {check:08x}\n")
}

/// The trial that a line announces, with its payload at `at`.
fn announced(line: &[u8], at: u64) -> Option<PackEntry> {
    let line = std::str::from_utf8(line).ok()?;
    let words: Vec<&str> = line
        .strip_prefix("trial ")?
        .strip_suffix('\n')?
        .split(' ')
        .collect();
    let &[id, acknowledgement, metrics, _] = &words[..] else {
        return None;
    };
    let entry = PackEntry {
        id: number(id)?,
        at,
        acknowledgement: u32::from_str_radix(acknowledgement, 16).ok()?,
        metrics: u32::from_str_radix(metrics, 16).ok()?,
    };
    (head(&entry) == line).then_some(entry)
}

/// Index of a pack, in the order of ids.
#[derive(Debug)]
pub(super) struct Index {
    pub(super) entries: Vec<PackEntry>,
    pub(super) outlines: Outlines,
    /// Whether the end of the pack is intact; false if the trials were searched for one by one.
    pub(super) is_whole: bool,
}

/// Reads the index of a pack; if it is damaged, searches for every trial.
///
/// # Errors
/// The error of a file that cannot be read.
pub(super) fn index(file: &mut (impl BufRead + Seek)) -> io::Result<Index> {
    let length = file.seek(SeekFrom::End(0))?;
    if let Some((entries, at)) = written_index(file, length)? {
        return Ok(Index {
            outlines: Outlines::open(file, at, entries.len())?,
            entries,
            is_whole: true,
        });
    }
    let mut entries = found(file, length)?;
    entries.sort_by_key(|entry| entry.id);
    Ok(Index {
        entries,
        outlines: Outlines::default(),
        is_whole: false,
    })
}

/// Entries of an intact index, and the offset at which it begins.
fn written_index(file: &mut (impl Read + Seek), length: u64) -> io::Result<Option<(Vec<PackEntry>, u64)>> {
    let Some(end_at) = length.checked_sub(END_LENGTH as u64) else {
        return Ok(None);
    };
    let mut end = [0; END_LENGTH];
    file.seek(SeekFrom::Start(end_at))?;
    file.read_exact(&mut end)?;
    let Some((at, digest)) = place_of_index(&end, end_at) else {
        return Ok(None);
    };
    file.seek(SeekFrom::Start(at))?;
    let mut bytes = Vec::new();
    file.take(end_at - at).read_to_end(&mut bytes)?;
    if hash(&bytes) != digest {
        return Ok(None);
    }
    let entries: Option<Vec<PackEntry>> = bytes.chunks(ENTRY_LENGTH).map(PackEntry::from_bytes).collect();
    let inside = |entry: &PackEntry| entry.at.checked_add(entry.length()).is_some_and(|end| end <= at);
    let ordered = |entries: &Vec<PackEntry>| entries.is_sorted_by(|one, next| one.id < next.id);
    let entries = entries.filter(|entries| entries.iter().all(inside) && ordered(entries));
    Ok(entries.map(|entries| (entries, at)))
}

/// Offset and hash of the index, from the end of a pack; `None` if they do not fit the file.
fn place_of_index(end: &[u8], end_at: u64) -> Option<(u64, String)> {
    let end = std::str::from_utf8(end).ok()?;
    let words: Vec<&str> = end
        .strip_prefix("index ")?
        .strip_suffix('\n')?
        .split(' ')
        .collect();
    let &[at, n, digest] = &words[..] else { return None };
    let (at, n) = (
        u64::from_str_radix(at, 16).ok()?,
        u64::from_str_radix(n, 16).ok()?,
    );
    let fits = n.checked_mul(ENTRY_LENGTH as u64)?.checked_add(at)? == end_at;
    fits.then(|| (at, digest.to_owned()))
}

/// Searches a whole pack for lines that announce a trial.
fn found(file: &mut (impl BufRead + Seek), length: u64) -> io::Result<Vec<PackEntry>> {
    let (mut entries, mut at) = (Vec::new(), 0);
    file.seek(SeekFrom::Start(0))?;
    let mut line = Vec::new();
    loop {
        line.clear();
        let read = file.read_until(b'\n', &mut line)? as u64;
        if read == 0 {
            return Ok(entries);
        }
        at += read;
        // The bytes before a line that announces a trial need not end with a line break.
        let last = line.len().saturating_sub(HEAD_LENGTH);
        let Some(entry) = announced(&line[last..], at) else {
            continue;
        };
        if entry.length() <= length - at {
            entries.push(entry);
            at = file.seek(SeekFrom::Start(at + entry.length()))?;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::Cursor;

    fn pack(trials: &[(u128, Vec<u8>, Vec<u8>)]) -> Vec<u8> {
        let mut writer = Writer::begin(Vec::new()).unwrap();
        for (id, acknowledgement, metrics) in trials {
            writer.add(*id, acknowledgement, metrics).unwrap();
        }
        writer.end().unwrap().0
    }

    fn read(bytes: &[u8]) -> Index {
        index(&mut Cursor::new(bytes)).unwrap()
    }

    fn payload<'a>(bytes: &'a [u8], entry: &PackEntry) -> (&'a [u8], &'a [u8]) {
        let at = usize::try_from(entry.at).unwrap();
        let (middle, end) = (
            at + entry.acknowledgement as usize,
            at + usize::try_from(entry.length()).unwrap(),
        );
        (&bytes[at..middle], &bytes[middle..end])
    }

    fn trials() -> impl Strategy<Value = Vec<(u128, Vec<u8>, Vec<u8>)>> {
        let bytes = || prop::collection::vec(prop_oneof![Just(b'\n'), any::<u8>()], 0..40);
        prop::collection::btree_map(any::<u128>(), (bytes(), bytes()), 0..12)
            .prop_map(|all| all.into_iter().map(|(id, (one, two))| (id, one, two)).collect())
    }

    proptest! {
        #[test]
        fn what_was_packed_comes_back(trials in trials()) {
            let bytes = pack(&trials);
            let index = read(&bytes);
            prop_assert!(index.is_whole);
            prop_assert_eq!(index.entries.len(), trials.len());
            for (entry, (id, one, two)) in index.entries.iter().zip(&trials) {
                prop_assert_eq!(entry.id, *id);
                prop_assert_eq!(payload(&bytes, entry), (&one[..], &two[..]));
            }
        }

        #[test]
        fn without_its_end_a_pack_gives_every_trial_that_is_there(trials in trials(), cut in 0.0..1.0f64) {
            let bytes = pack(&trials);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss,
                reason = "a place in the pack")]
            let kept = &bytes[..(cut * (bytes.len() - 1) as f64) as usize];
            let whole = read(&bytes).entries;
            let there = whole.iter().filter(|entry| entry.at + entry.length() <= kept.len() as u64);
            let index = read(kept);
            prop_assert!(!index.is_whole);
            prop_assert!(there.eq(&index.entries));
        }

        #[test]
        fn a_changed_byte_costs_one_trial_at_most(
            trials in trials(), place in 0.0..1.0f64, by in 1u8..=255,
        ) {
            let mut bytes = pack(&trials);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss,
                reason = "a place in the pack")]
            let place = (place * bytes.len() as f64) as usize;
            bytes[place] ^= by;
            let index = read(&bytes);
            let same = |(id, one, two): &&(u128, Vec<u8>, Vec<u8>)| {
                let entry = index.entries.iter().find(|entry| entry.id == *id);
                entry.is_some_and(|entry| payload(&bytes, entry) == (&one[..], &two[..]))
            };
            prop_assert!(trials.iter().filter(same).count() + 1 >= trials.len());
        }
    }
}
