//! Runs in TensorBoard's event files, read as TensorBoard reads them. Every folder is a run, which may continue in
//! several files. A start of the program at a step purges the values logged from that step on
//! (`tensorboard/backend/event_processing/event_accumulator.py`, `_MaybePurgeOrphanedData`).

use super::{
    columns::{MetricColumns, MissingColumn, named},
    content::Content,
    found::RunCollection,
    group::LogGroup,
    mapping::{LeftOut, Mapping, NOT_FINITE, RunPer, Step},
    restarts::{LogValue, Rules},
};
use crate::event_file::{Event, Scalar, Tensor, events};
use contract::Error;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::PathBuf,
};

/// Adds the runs of all files, in the order of their folders.
pub(super) fn runs(files: &[&Content], mapping: &Mapping, found: &mut RunCollection) -> Result<(), Error> {
    let (Some(first), key) = (files.first(), key_of_columns(mapping)) else {
        return Ok(());
    };
    if let Some(key) = key {
        let problem = format!(
            "event files have no columns and steps of their own; leave `{key}` out, every folder is a run"
        );
        return Err(first.wrong(None, problem));
    }
    let mut logs: BTreeMap<PathBuf, Vec<usize>> = BTreeMap::new();
    for (place, file) in files.iter().enumerate() {
        let folder = file
            .path
            .parent()
            .filter(|_| mapping.run_per != Some(RunPer::File));
        let of = folder.unwrap_or(&file.path).to_owned();
        logs.entry(of).or_default().push(place);
    }
    let rules = Rules::of_event_files(mapping);
    for (of, places) in logs {
        let mut log = Log::default();
        for place in &places {
            log.read(files[*place], *place)?;
        }
        found.purged += log.purged;
        let name = format!("`{}`", of.display());
        log.group(name, (files, places[0]), mapping, found)?
            .end(&rules, files, found)?;
    }
    Ok(())
}

/// The tags of a file that hold single numbers.
pub(super) fn tags(file: &Content) -> Result<Vec<String>, Error> {
    let mut log = Log::default();
    log.read(file, 0)?;
    Ok(log.tags())
}

/// A key of the mapping that names a column.
fn key_of_columns(mapping: &Mapping) -> Option<&'static str> {
    let given = [
        ("seed", mapping.seed.is_some()),
        ("run", mapping.run.is_some()),
        ("only", !mapping.only.is_empty()),
        ("step", matches!(mapping.step, Step::Sum(_))),
    ];
    given
        .into_iter()
        .find(|(_, is_given)| *is_given)
        .map(|(key, _)| key)
}

/// A number under a tag.
struct Point {
    file: usize,
    /// The number of the record in the file.
    record: u64,
    step: i64,
    value: f64,
}

/// The files of a run, one after the other.
#[derive(Default)]
struct Log {
    points: BTreeMap<String, Vec<Point>>,
    /// Tags whose values are not single numbers.
    others: BTreeSet<String>,
    version: f64,
    /// The step of the last event, in files of a version that does not mark starts.
    recent: Option<i64>,
    purged: usize,
}

impl Log {
    fn read(&mut self, file: &Content, place: usize) -> Result<(), Error> {
        let events = events(&file.bytes).map_err(|problem| file.wrong(None, problem))?;
        for (event, record) in events.iter().zip(1..) {
            if let Some(version) = &event.file_version {
                let number = version
                    .strip_prefix("brain.Event:")
                    .and_then(|it| it.parse().ok());
                self.version = number.unwrap_or(0.0);
            }
            self.purge(event);
            for scalar in event.summary.iter().flat_map(|summary| &summary.value) {
                let tag = scalar.tag();
                if let Some(value) = number(scalar) {
                    let point = Point {
                        file: place,
                        record,
                        step: event.step,
                        value,
                    };
                    self.points.entry(tag.to_owned()).or_default().push(point);
                } else {
                    self.others.insert(tag.to_owned());
                }
            }
        }
        Ok(())
    }

    /// Removes values that a crash made void. From version 2 of the format on, the start of the program gives the step;
    /// in older files, steps that go back indicate it.
    fn purge(&mut self, event: &Event) {
        if self.version >= 2.0 {
            if event.starts() {
                self.points
                    .values_mut()
                    .for_each(|points| purge(points, event.step, &mut self.purged));
            }
            return;
        }
        match &event.summary {
            Some(summary) if self.recent.is_some_and(|recent| event.step < recent) => {
                for scalar in &summary.value {
                    if let Some(points) = self.points.get_mut(scalar.tag()) {
                        purge(points, event.step, &mut self.purged);
                    }
                }
            }
            _ => self.recent = Some(event.step),
        }
    }

    fn tags(&self) -> Vec<String> {
        self.points
            .keys()
            .filter(|tag| !self.points[*tag].is_empty())
            .cloned()
            .collect()
    }

    /// The values of the tags that the mapping names. A run with only some of the tags lacks metrics; a run with none
    /// of them is an error.
    fn group(
        self,
        name: String,
        (files, first): (&[&Content], usize),
        mapping: &Mapping,
        found: &mut RunCollection,
    ) -> Result<LogGroup, Error> {
        let file = files[first];
        let mut group = LogGroup::new(name, None, file.path.clone());
        let tags = self.tags();
        let chosen = match MetricColumns::of(&tags, mapping) {
            Ok(chosen) => chosen,
            Err(_) if tags.is_empty() || mapping.leaves_out(LeftOut::Empty) => return Ok(group),
            Err(missing) => return Err(file.wrong(None, self.lacks(&missing, &tags))),
        };
        let slots = group.slots(&chosen);
        for (of, slot) in chosen.slots.iter().zip(slots) {
            let tag = &tags[of.column];
            for point in &self.points[tag] {
                let wrong = |problem: String| {
                    let file = files[point.file];
                    file.wrong(None, format!("record {}, tag `{tag}`: {problem}", point.record))
                };
                let step = u64::try_from(point.step)
                    .map_err(|_| wrong(format!("step {} is negative", point.step)))?;
                let (place, value) = ((point.file, point.record), point.value);
                if value.is_finite() || mapping.is_own {
                    group.log.entries.push(LogValue {
                        place,
                        step,
                        slot,
                        value,
                    });
                } else if mapping.leaves_out(LeftOut::NotFinite) {
                    found.not_finite += 1;
                } else {
                    return Err(wrong(format!(
                        "`{value}` at step {step} is not finite: {NOT_FINITE}"
                    )));
                }
            }
        }
        // Entries follow the order of logging, not of tags.
        group.log.entries.sort_by_key(|entry| entry.place);
        Ok(group)
    }

    fn lacks(&self, missing: &MissingColumn, tags: &[String]) -> String {
        let name = &missing.name;
        if self.others.contains(name) {
            return format!(
                "`{name}` holds no single numbers; tags that do are {}",
                named(tags)
            );
        }
        missing
            .problem
            .replacen("there is no such column", &format!("it has no tag `{name}`"), 1)
            .replace("columns", "tags")
    }
}

fn purge(points: &mut Vec<Point>, from: i64, purged: &mut usize) {
    let before = points.len();
    points.retain(|point| point.step < from);
    *purged += before - points.len();
}

/// A scalar in the older or the newer form; `None` if it is not a single number.
fn number(scalar: &Scalar) -> Option<f64> {
    scalar
        .simple_value
        .map(f64::from)
        .or_else(|| of_tensor(scalar.tensor.as_ref()?))
}

/// The number in a tensor with one entry, by the kinds of `tensorflow/core/framework/types.proto`.
fn of_tensor(tensor: &Tensor) -> Option<f64> {
    const FLOAT: i32 = 1;
    const DOUBLE: i32 = 2;
    const INT32: i32 = 3;
    const INT64: i32 = 9;
    if tensor.entries() != 1 {
        return None;
    }
    let bytes = tensor.tensor_content.as_slice();
    #[allow(
        clippy::cast_precision_loss,
        reason = "TensorBoard shows numbers in double precision, too"
    )]
    match tensor.dtype {
        // Writers that omit the type mean single precision.
        FLOAT | 0 => match bytes.try_into() {
            Ok(bytes) => Some(f64::from(f32::from_le_bytes(bytes))),
            Err(_) => tensor
                .float_val
                .first()
                .map(|value| f64::from(*value))
                .or_else(|| tensor.double_val.first().copied()),
        },
        DOUBLE => bytes
            .try_into()
            .map(f64::from_le_bytes)
            .ok()
            .or_else(|| tensor.double_val.first().copied()),
        INT32 => bytes
            .try_into()
            .map(i32::from_le_bytes)
            .ok()
            .or_else(|| tensor.int_val.first().copied())
            .map(f64::from),
        INT64 => {
            let whole = bytes.try_into().map(i64::from_le_bytes).ok();
            whole
                .or_else(|| tensor.int64_val.first().copied())
                .map(|whole| whole as f64)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests;
