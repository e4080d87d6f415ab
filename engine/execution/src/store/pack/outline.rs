//! Outlines: the part of a pack from which very many ends are read without reading any `trial.json`.
//!
//! ```text
//! <outline>                                                     56 bytes per trial, in the order of the index
//! <origins>                                                     the parts that trials share, as JSON
//! outlines <their place> <length of origins> <hash of both>\n   of fixed length, before the index
//! ```
//!
//! Outlines only save time, since `trial.json` has the same information. A pack of an earlier program has none. If they
//! are damaged, or an outline cannot represent the end of a trial, its `trial.json` is read.

use super::{
    super::date::{rfc_3339_of, seconds_of},
    form::number,
};
use crate::store::StoredTrial;
use contract::{
    Build,
    digest::of_bytes as hash,
    trial_end::{EndState, TrialEnd},
};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    io::{self, Read, Seek, SeekFrom, Write},
    ops::Range,
};

pub(super) const OUTLINE_LENGTH: usize = 56;
const LINE_LENGTH: usize = "outlines ".len() + 2 * 17 + 32 + 1;

/// The origin of a trial that has no outline.
const NO_ORIGIN: u32 = u32::MAX;

/// The part that the trials of one setting share.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
struct Origin {
    parts: [String; 3],
    numerics: u32,
    build: Option<Build>,
    /// Whether the ends of its trials have a date.
    dated: bool,
    /// Device of the runs that computed its trials.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    device: Option<String>,
}

/// The part of an outline besides its origin.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Outline {
    seed: u64,
    wall_s: f64,
    /// Seconds per decision; NaN if no decision was timed.
    decision_s: f64,
    digest: u128,
    ended_at_s: u64,
    origin: u32,
}

impl Outline {
    const NONE: Self = Self {
        seed: 0,
        wall_s: 0.0,
        decision_s: f64::NAN,
        digest: 0,
        ended_at_s: 0,
        origin: NO_ORIGIN,
    };

    fn to_bytes(self) -> [u8; OUTLINE_LENGTH] {
        let mut bytes = [0; OUTLINE_LENGTH];
        bytes[..8].copy_from_slice(&self.seed.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.wall_s.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.decision_s.to_le_bytes());
        bytes[24..40].copy_from_slice(&self.digest.to_be_bytes());
        bytes[40..48].copy_from_slice(&self.ended_at_s.to_le_bytes());
        bytes[48..52].copy_from_slice(&self.origin.to_le_bytes());
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        Some(Self {
            seed: u64::from_le_bytes(bytes.get(..8)?.try_into().ok()?),
            wall_s: f64::from_le_bytes(bytes.get(8..16)?.try_into().ok()?),
            decision_s: f64::from_le_bytes(bytes.get(16..24)?.try_into().ok()?),
            digest: u128::from_be_bytes(bytes.get(24..40)?.try_into().ok()?),
            ended_at_s: u64::from_le_bytes(bytes.get(40..48)?.try_into().ok()?),
            origin: u32::from_le_bytes(bytes.get(48..52)?.try_into().ok()?),
        })
    }
}

/// Outlines of a pack that is being written.
#[derive(Debug, Default)]
pub(super) struct OutlineWriter {
    outlines: Vec<u8>,
    origins: BTreeMap<Origin, u32>,
}

impl OutlineWriter {
    /// Adds the next trial.
    pub(super) fn add(&mut self, trial: Option<StoredTrial>) {
        let outline = trial
            .and_then(|trial| self.outline(trial))
            .unwrap_or(Outline::NONE);
        self.outlines.extend(outline.to_bytes());
    }

    /// Outline of a trial; `None` if it would not reproduce the trial bit by bit.
    fn outline(&mut self, trial: StoredTrial) -> Option<Outline> {
        if trial.end.state != EndState::Ok {
            return None;
        }
        let dated = trial.ended_at.is_some();
        let ended_at_s = trial.ended_at.as_deref().map_or(Some(0), seconds_of)?;
        let mut outline = Outline {
            seed: trial.seed,
            wall_s: trial.end.wall_s,
            decision_s: trial.end.decision_s.unwrap_or(f64::NAN),
            digest: number(&trial.end.digest)?,
            ended_at_s,
            origin: NO_ORIGIN,
        };
        let origin = Origin {
            parts: trial.parts.clone(),
            numerics: trial.numerics,
            build: trial.build.clone(),
            dated,
            device: trial.end.device.clone(),
        };
        if told(&origin, &outline) != trial {
            return None;
        }
        let next = u32::try_from(self.origins.len()).ok()?;
        outline.origin = *self.origins.entry(origin).or_insert(next);
        Some(outline)
    }

    /// Writes the outlines from the offset `at` on; returns the offset of their end.
    pub(super) fn write(self, to: &mut impl Write, at: u64) -> io::Result<u64> {
        let mut origins: Vec<(u32, Origin)> = self
            .origins
            .into_iter()
            .map(|(origin, place)| (place, origin))
            .collect();
        origins.sort_unstable_by_key(|(place, _)| *place);
        let origins: Vec<Origin> = origins.into_iter().map(|(_, origin)| origin).collect();
        let origins = serde_json::to_vec(&origins)?;
        let mut bytes = self.outlines;
        bytes.extend(&origins);
        to.write_all(&bytes)?;
        writeln!(to, "outlines {at:016x} {:016x} {}", origins.len(), hash(&bytes))?;
        Ok(at + bytes.len() as u64 + LINE_LENGTH as u64)
    }
}

/// The trial that an outline describes.
fn told(origin: &Origin, outline: &Outline) -> StoredTrial {
    StoredTrial {
        parts: origin.parts.clone(),
        seed: outline.seed,
        numerics: origin.numerics,
        end: TrialEnd {
            state: EndState::Ok,
            reason: String::new(),
            wall_s: outline.wall_s,
            decision_s: Some(outline.decision_s).filter(|seconds| !seconds.is_nan()),
            device: origin.device.clone(),
            digest: format!("{:032x}", outline.digest),
        },
        ended_at: origin.dated.then(|| rfc_3339_of(outline.ended_at_s)),
        build: origin.build.clone(),
    }
}

/// Place of the outlines in an opened pack, and the origins.
#[derive(Debug, Default)]
pub(super) struct Outlines {
    at: u64,
    count: usize,
    origins: Vec<Origin>,
}

impl Outlines {
    /// The outlines of a pack of `count` trials whose index begins at `index_at`; empty if they are damaged.
    ///
    /// # Errors
    /// The error of a file that cannot be read.
    pub(super) fn open(file: &mut (impl Read + Seek), index_at: u64, count: usize) -> io::Result<Self> {
        let Some(line_at) = index_at.checked_sub(LINE_LENGTH as u64) else {
            return Ok(Self::default());
        };
        let mut line = [0; LINE_LENGTH];
        file.seek(SeekFrom::Start(line_at))?;
        file.read_exact(&mut line)?;
        let Some((at, digest)) = place(&line, line_at, count) else {
            return Ok(Self::default());
        };
        let mut bytes = Vec::new();
        file.seek(SeekFrom::Start(at))?;
        file.take(line_at - at).read_to_end(&mut bytes)?;
        let origins = bytes.get(count * OUTLINE_LENGTH..).unwrap_or_default();
        match serde_json::from_slice(origins) {
            Ok(origins) if hash(&bytes) == digest => Ok(Self { at, count, origins }),
            _ => Ok(Self::default()),
        }
    }

    /// Offset and length of some outlines in bytes; `None` if there are none.
    pub(super) fn bytes_of(&self, places: &Range<usize>) -> Option<(u64, u64)> {
        let length = (places.len() * OUTLINE_LENGTH) as u64;
        (places.end <= self.count).then(|| (self.at + (places.start * OUTLINE_LENGTH) as u64, length))
    }

    /// The trial of an outline; `None` for an empty one.
    pub(super) fn trial(&self, bytes: &[u8]) -> Option<StoredTrial> {
        let outline = Outline::from_bytes(bytes)?;
        let origin = self.origins.get(usize::try_from(outline.origin).ok()?)?;
        Some(told(origin, &outline))
    }
}

/// Offset and hash of the outlines, from the line that ends them; `None` if they do not fit the pack.
fn place(line: &[u8], line_at: u64, count: usize) -> Option<(u64, String)> {
    let line = std::str::from_utf8(line).ok()?;
    let words: Vec<&str> = line
        .strip_prefix("outlines ")?
        .strip_suffix('\n')?
        .split(' ')
        .collect();
    let &[at, origins, digest] = &words[..] else {
        return None;
    };
    let (at, origins) = (
        u64::from_str_radix(at, 16).ok()?,
        u64::from_str_radix(origins, 16).ok()?,
    );
    let length = u64::try_from(count.checked_mul(OUTLINE_LENGTH)?)
        .ok()?
        .checked_add(origins)?;
    (at.checked_add(length)? == line_at).then(|| (at, digest.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::Cursor;

    fn trials() -> impl Strategy<Value = Vec<StoredTrial>> {
        let text = || prop_oneof![Just("cpu".to_owned()), "[a-z\"\n]{0,6}"];
        let build = prop::option::of(text().prop_map(|commit| Build {
            commit,
            changed: true,
        }));
        let end = (
            prop_oneof![Just(EndState::Ok), Just(EndState::Nan)],
            prop_oneof![Just(String::new()), text()],
            0.0..1e9f64,
            prop::option::of(0.0..1.0f64),
            prop_oneof![any::<u128>().prop_map(|digest| format!("{digest:032x}")), text()],
        );
        let ended_at = prop_oneof![Just("2024-02-29T23:59:59Z".to_owned()), text()];
        let trial = (
            text(),
            any::<u64>(),
            0..3u32,
            build,
            end,
            prop::option::of(ended_at),
        )
            .prop_map(
                |(part, seed, numerics, build, (state, reason, wall_s, decision_s, digest), ended_at)| {
                    StoredTrial {
                        parts: [part.clone(), part.clone(), part],
                        seed,
                        numerics,
                        end: TrialEnd {
                            state,
                            reason,
                            wall_s,
                            decision_s,
                            device: (seed % 2 == 0).then(|| "cuda".into()),
                            digest,
                        },
                        ended_at,
                        build,
                    }
                },
            );
        prop::collection::vec(trial, 0..12)
    }

    fn written(trials: &[StoredTrial]) -> Vec<u8> {
        let mut gathered = OutlineWriter::default();
        trials.iter().for_each(|trial| gathered.add(Some(trial.clone())));
        let mut bytes = b"before".to_vec();
        let at = bytes.len() as u64;
        assert_eq!(gathered.write(&mut bytes, at).unwrap(), bytes.len() as u64);
        bytes
    }

    fn open(bytes: &[u8], count: usize) -> Outlines {
        Outlines::open(&mut Cursor::new(bytes), bytes.len() as u64, count).unwrap()
    }

    proptest! {
        #[test]
        fn an_outline_gives_its_trial_back_or_is_none(trials in trials()) {
            let bytes = written(&trials);
            let outlines = open(&bytes, trials.len());
            for (place, trial) in trials.iter().enumerate() {
                let (at, length) = outlines.bytes_of(&(place..place + 1)).unwrap();
                let at = usize::try_from(at).unwrap();
                let told = outlines.trial(&bytes[at..at + usize::try_from(length).unwrap()]);
                let plain = trial.end.state == EndState::Ok
                    && trial.end.reason.is_empty()
                    && number(&trial.end.digest).is_some()
                    && trial.ended_at.as_ref().is_none_or(|date| seconds_of(date).is_some());
                prop_assert_eq!(told, plain.then(|| trial.clone()));
            }
        }

        #[test]
        fn no_changed_byte_is_believed(trials in trials(), place in 0.0..1.0f64, by in 1u8..=255) {
            let mut bytes = written(&trials);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss,
                reason = "a place in the text")]
            let place = 6 + (place * (bytes.len() - 6) as f64) as usize;
            bytes[place] ^= by;
            prop_assert!(open(&bytes, trials.len()).bytes_of(&(0..1)).is_none());
        }
    }
}
