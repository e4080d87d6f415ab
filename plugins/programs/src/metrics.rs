//! Metrics of a program, read from its output and files while it runs and when it has ended.
//!
//! A file is read as a whole whenever it changed, but the more rarely the longer its reading takes. Until the program
//! has ended, a file may be incomplete: problems count at the last reading only.

use crate::{
    ProgramConfig,
    config::{Reading, StepText},
    lines::SeenKey,
    metric_errors,
    output::{is_noted, noted},
};
use contract::{Error, own_training::Curve};
use document::reach::Reach;
use imported::{Copies, Mapping, Restart, RunPer, SameStep, matching, read};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    time::{Duration, Instant, SystemTime},
};

/// File with the line numbers at which a program continued.
const BEGINS: &str = "begins.json";
/// Time between two readings of a source, in multiples of the duration of the last reading.
const WORK_PER_READING: u32 = 20;

/// All metrics of a program, with their sources.
#[derive(Debug)]
pub struct Metrics {
    sources: Vec<MetricGroup>,
    curves: Vec<Curve>,
    folder: PathBuf,
    notes: PathBuf,
    /// Whether the program continued from a checkpoint: steps may then go back.
    goes_on: bool,
    /// Number of lines in each file where the program continued.
    begins: BTreeMap<PathBuf, BTreeSet<u64>>,
}

/// Metrics with the same files and the same steps.
#[derive(Debug)]
struct MetricGroup {
    from: String,
    step: Option<StepText>,
    /// Keys by position in the list of all metrics.
    keys: BTreeMap<usize, String>,
    seen: Vec<FileVersion>,
    read: Instant,
    cost: Duration,
}

/// A file with its length and the time of its last change.
type FileVersion = (PathBuf, u64, Option<SystemTime>);

#[expect(
    clippy::disallowed_methods,
    reason = "it decides how often files are looked at, and not what is read of them"
)]
fn now() -> Instant {
    Instant::now()
}

impl Metrics {
    /// The metrics of a program that works in a folder; nothing is read yet.
    pub fn of(config: &ProgramConfig, folder: &Path, notes: &Path, goes_on: bool) -> Self {
        let mut sources: Vec<MetricGroup> = Vec::new();
        for (place, reading) in config.readings().into_iter().enumerate() {
            let Reading { key, from, step, .. } = reading;
            let known = sources.iter_mut().find(|it| it.from == from && it.step == step);
            match known {
                Some(source) => drop(source.keys.insert(place, key)),
                None => sources.push(MetricGroup::new(from, step, place, key)),
            }
        }
        let curve = |Reading { name, last, .. }: Reading| Curve {
            metric: config.metric(&name),
            last,
            values: Vec::new(),
        };
        Self {
            sources,
            curves: config.readings().into_iter().map(curve).collect(),
            folder: folder.to_owned(),
            notes: notes.to_owned(),
            goes_on,
            begins: fs::read(notes.join(BEGINS))
                .ok()
                .and_then(|text| serde_json::from_slice(&text).ok())
                .unwrap_or_default(),
        }
    }

    /// Marks that the program continues from a checkpoint: rows after the lines that its files have now replace earlier
    /// rows at the same and later steps.
    ///
    /// # Errors
    /// [`Error::File`] where the mark cannot be written.
    pub fn mark_continuation(&mut self) -> Result<(), Error> {
        for source in &self.sources {
            for path in self
                .files(source)?
                .into_iter()
                .filter(|_| !is_noted(&source.from))
            {
                let text = fs::read(&path).map_err(Error::file("read", &path))?;
                let lines = text.iter().filter(|byte| **byte == b'\n').count() as u64;
                self.begins.entry(path).or_default().insert(lines);
            }
        }
        let path = self.notes.join(BEGINS);
        let text = serde_json::to_vec(&self.begins).map_err(std::io::Error::from);
        text.and_then(|text| fs::write(&path, text))
            .map_err(Error::file("write", &path))
    }

    /// The values so far.
    pub fn now(&mut self) -> &[Curve] {
        for place in 0..self.sources.len() {
            // A file that cannot be read may still be completed.
            let _ = self.look(place, false);
        }
        &self.curves
    }

    /// All values, once the program has ended; `seen` holds the keys of its output.
    ///
    /// # Errors
    /// [`Error::Input`] for a file that cannot be read, and for a metric without a value.
    pub fn last(&mut self, seen: &[SeenKey]) -> Result<&[Curve], Error> {
        for place in 0..self.sources.len() {
            self.look(place, true)
                .map_err(|error| self.refusal(&self.sources[place], error, seen))?;
        }
        for source in &self.sources {
            for (place, key) in &source.keys {
                if self.curves[*place].values.is_empty() {
                    return Err(self.missing(source, *place, key, seen));
                }
            }
        }
        Ok(&self.curves)
    }

    fn missing(&self, source: &MetricGroup, place: usize, key: &str, seen: &[SeenKey]) -> Error {
        let name = &self.curves[place].metric.name;
        let files = self.files(source).unwrap_or_default();
        metric_errors::missing(name, key, &source.from, &files, seen)
    }

    /// An error of reading. A metric that no line of the output has lacks a value.
    fn refusal(&self, source: &MetricGroup, error: Error, seen: &[SeenKey]) -> Error {
        let lacks = match &error {
            Error::Input {
                column, line: None, ..
            } if is_noted(&source.from) => column.as_ref(),
            _ => None,
        };
        let metric = lacks.and_then(|column| source.keys.iter().find(|(_, key)| *key == column));
        match metric {
            Some((place, key)) => self.missing(source, *place, key, seen),
            None => error,
        }
    }

    fn look(&mut self, place: usize, is_last: bool) -> Result<(), Error> {
        let files = self.files(&self.sources[place])?;
        let seen: Vec<FileVersion> = files.iter().map(|path| seen(path)).collect();
        let source = &self.sources[place];
        let is_costly = source.read.elapsed() < source.cost * WORK_PER_READING;
        if !is_last && (seen == source.seen || is_costly) {
            return Ok(());
        }
        let begun = now();
        let found = self.read(source, &files);
        let source = &mut self.sources[place];
        (source.read, source.cost, source.seen) = (now(), begun.elapsed(), seen);
        for (place, values) in found? {
            self.curves[place].values = values;
        }
        Ok(())
    }

    /// The files of a source that exist.
    fn files(&self, source: &MetricGroup) -> Result<Vec<PathBuf>, Error> {
        if is_noted(&source.from) {
            let path = noted(&self.notes, &source.from);
            let has_lines = path.metadata().is_ok_and(|it| it.len() > 0);
            return Ok(has_lines.then_some(path).into_iter().collect());
        }
        let found = matching(&Reach::of(&self.folder), &self.folder, &source.from);
        Ok(found
            .map_err(metric_errors::unlisted)?
            .into_iter()
            .filter(|path| path.metadata().is_ok_and(|it| it.len() > 0))
            .collect())
    }

    /// The values of all metrics of a source, without those that have no value yet.
    fn read(&self, source: &MetricGroup, files: &[PathBuf]) -> Result<Vec<(usize, Vec<(u64, f64)>)>, Error> {
        if files.is_empty() {
            return Ok(Vec::new());
        }
        let all: Vec<(&usize, &String)> = source.keys.iter().collect();
        self.read_these(source, &all, files).or_else(|_| {
            let each = all.iter().map(|one| self.read_these(source, &[*one], files));
            Ok(each.collect::<Result<Vec<_>, Error>>()?.concat())
        })
    }

    fn read_these(
        &self,
        source: &MetricGroup,
        these: &[(&usize, &String)],
        files: &[PathBuf],
    ) -> Result<Vec<(usize, Vec<(u64, f64)>)>, Error> {
        let name = |place: &usize| self.curves[*place].metric.name.clone();
        let mapping = Mapping {
            metrics: these
                .iter()
                .map(|(place, key)| (name(place), key.as_str().into()))
                .collect(),
            step: source.step.as_ref().map(StepText::step).unwrap_or_default(),
            run_per: Some(RunPer::Folder),
            restart: self.goes_on.then_some(Restart::Resume),
            same_step: Some(SameStep::Mean),
            copies: Some(Copies::Count),
            is_own: true,
            begins: self.begins.clone(),
            ..Mapping::default()
        };
        let in_words = |error| metric_errors::in_words_of_the_study(error, &source.from, &self.folder);
        let mut found = read(files, &mapping).map_err(in_words)?;
        let run = match found.runs.len() {
            0 => return Ok(Vec::new()),
            1 => found.runs.remove(0),
            _ => return Err(in_words(metric_errors::several(&source.from, &found))),
        };
        let mut curves = run.curves;
        let values = |(place, _): &(&usize, &String)| Some((**place, curves.remove(&name(place))?));
        Ok(these.iter().filter_map(values).collect())
    }
}

impl MetricGroup {
    fn new(from: String, step: Option<StepText>, place: usize, key: String) -> Self {
        Self {
            from,
            step,
            keys: [(place, key)].into(),
            seen: Vec::new(),
            read: now(),
            cost: Duration::ZERO,
        }
    }
}

fn seen(path: &Path) -> FileVersion {
    let found = path.metadata().ok();
    let length = found.as_ref().map_or(0, std::fs::Metadata::len);
    (path.to_owned(), length, found.and_then(|it| it.modified().ok()))
}

#[cfg(test)]
mod tests;
