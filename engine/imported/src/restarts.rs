//! Logs whose steps go back: two runs in one log, or a run that resumed from a checkpoint. The entry of the study
//! defines how to separate them; without that they are refused.

use super::{
    content::Content,
    mapping::{Mapping, Restart, SameStep},
};
use contract::Error;
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of times that the steps of a log may go back. A log that goes back more often is not ordered by
/// steps.
const MOST_RESTARTS: usize = 100;

/// A value as it was logged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LogValue {
    /// The index of the file, and the line or record in it.
    pub(super) place: (usize, u64),
    pub(super) step: u64,
    /// The column or tag of the value.
    pub(super) slot: usize,
    pub(super) value: f64,
}

/// The values of a run in its files, one file after the other.
#[derive(Debug, Default)]
pub(super) struct Log {
    pub(super) entries: Vec<LogValue>,
    /// Places at which another log certainly begins, for example because the names of the columns are repeated.
    pub(super) begins: BTreeSet<(usize, u64)>,
}

/// A run that was separated from others in its log.
#[derive(Debug, Default, PartialEq)]
pub(super) struct SeparatedRun {
    /// The place at which it begins; `None` at the beginning of the log.
    pub(super) from: Option<(usize, u64)>,
    pub(super) entries: Vec<LogValue>,
    /// Number of values at a step that has another value.
    pub(super) repeated: usize,
    /// Number of values that were purged.
    pub(super) purged: usize,
}

/// The rules by which logs are read.
pub(super) struct Rules {
    restart: Option<Restart>,
    same_step: Option<SameStep>,
    /// The name of a place in a file.
    pub(super) unit: &'static str,
    /// The option that separates runs, for messages.
    remedy: &'static str,
    /// Whether the log is that of an own trial, which is one run.
    is_own: bool,
}

impl Rules {
    /// Rules for lines of tables, which may contain several runs.
    pub(super) fn of_tables(mapping: &Mapping) -> Self {
        Self {
            restart: mapping.restart,
            same_step: mapping.same_step,
            unit: "line",
            remedy: "name the column that tells runs apart under `run` or `seed`",
            is_own: mapping.is_own,
        }
    }

    /// Rules for records of event files; each file has one writer.
    pub(super) fn of_event_files(mapping: &Mapping) -> Self {
        Self {
            restart: mapping.restart,
            same_step: mapping.same_step.or(Some(SameStep::Mean)),
            unit: "record",
            remedy: "write `run_per: file` where every file is a run",
            is_own: mapping.is_own,
        }
    }

    /// The runs in a log, judged by the values of `slots`.
    ///
    /// # Errors
    /// [`Error::Input`] with the place at which steps go back or repeat, if the study does not define the meaning.
    pub(super) fn told_apart(
        &self,
        mut log: Log,
        slots: usize,
        files: &[&Content],
    ) -> Result<Vec<SeparatedRun>, Error> {
        match overlap(&log.entries) {
            // The files of a run may be named in any order.
            None => by_steps(&mut log.entries),
            Some(pair) if self.restart.is_none() => return Err(self.two_files(pair.map(|file| files[file]))),
            Some(_) => {}
        }
        let (mut passes, mut pass) = (Vec::new(), SeparatedRun::default());
        let mut last: Vec<Option<LogValue>> = vec![None; slots];
        let (mut begins, mut restarts) = (log.begins.iter().peekable(), 0);
        for entry in log.entries {
            let begins_again = begins.next_if(|place| **place <= entry.place).is_some();
            let before = last[entry.slot];
            let back = before.filter(|before| entry.goes_back(before));
            if back.is_some() || begins_again {
                restarts += 1;
                if restarts > MOST_RESTARTS {
                    return Err(self.unsorted(files[entry.place.0]));
                }
                match self.restart {
                    None => return Err(self.goes_back(&entry, back, files)),
                    Some(Restart::NewRun) => passes.push(pass.split(&entry)),
                    Some(Restart::Resume) => pass.purge(&entry),
                }
                last = pass.last(slots);
            } else if let Some(before) = before.filter(|before| before.step == entry.step) {
                match self.same_step {
                    None => return Err(self.repeats(&entry, &before, files)),
                    Some(SameStep::Mean) => {}
                    Some(SameStep::Last) => pass.remove_last(entry.slot),
                }
                pass.repeated += 1;
            }
            pass.entries.push(entry);
            last[entry.slot] = Some(entry);
        }
        passes.push(pass);
        passes.retain(|pass| !pass.entries.is_empty());
        Ok(passes)
    }

    fn two_files(&self, [one, other]: [&Content; 2]) -> Error {
        let advice = if self.is_own {
            "a trial is one run, so name one file under `from`, or write steps that rise from file to file"
                .into()
        } else {
            format!(
                "where these are two runs, {}; where one run went on from a checkpoint, write `restart: resume`",
                self.remedy
            )
        };
        let problem = format!("it has steps that `{}` has, too: {advice}", one.path.display());
        other.wrong(None, problem)
    }

    fn goes_back(&self, entry: &LogValue, back: Option<LogValue>, files: &[&Content]) -> Error {
        let told = match back {
            Some(before) => format!(
                "step {} comes after step {}{}",
                entry.step,
                before.step,
                self.at(&before, entry)
            ),
            None => "another log begins here".into(),
        };
        let advice = if self.is_own {
            "the steps of a trial rise, so print a running total where the program counts anew".into()
        } else {
            format!(
                "where another run begins here, write `restart: new_run`, or {}; where the run went on from a checkpoint, \
                 write `restart: resume`",
                self.remedy
            )
        };
        self.wrong(entry, format!("{told}: {advice}"), files)
    }

    fn repeats(&self, entry: &LogValue, before: &LogValue, files: &[&Content]) -> Error {
        let problem = format!(
            "step {} has a value already{}: where several runs stand in the file, {}; where one run logged several values \
             at a step, write `same_step: mean` or `same_step: last`",
            entry.step,
            self.at(before, entry),
            self.remedy
        );
        self.wrong(entry, problem, files)
    }

    fn unsorted(&self, file: &Content) -> Error {
        let advice = if self.is_own {
            "write steps that rise".into()
        } else {
            format!("sort it by step, or {}", self.remedy)
        };
        let problem = format!("its steps go back more than {MOST_RESTARTS} times: {advice}");
        file.wrong(None, problem)
    }

    fn at(&self, before: &LogValue, entry: &LogValue) -> String {
        let same = before.place.0 == entry.place.0;
        if same && !self.is_own {
            format!(" ({} {})", self.unit, before.place.1)
        } else {
            String::new()
        }
    }

    fn wrong(&self, entry: &LogValue, problem: String, files: &[&Content]) -> Error {
        let (file, line) = (files[entry.place.0], entry.place.1);
        match self.unit {
            "line" => file.wrong(Some(line), problem),
            unit => file.wrong(None, format!("{unit} {line}: {problem}")),
        }
    }
}

impl LogValue {
    /// Whether its step is not above that of an earlier value. An equal step in another file was logged after a new
    /// start of the program.
    fn goes_back(&self, before: &Self) -> bool {
        let is_other_file = self.place.0 != before.place.0;
        self.step < before.step || is_other_file && self.step == before.step
    }
}

impl SeparatedRun {
    /// Ends the run before the line of an entry; the next run begins there.
    fn split(&mut self, entry: &LogValue) -> Self {
        let of_line = self
            .entries
            .iter()
            .rev()
            .take_while(|other| other.place == entry.place)
            .count();
        let next = Self {
            from: Some(entry.place),
            entries: self.entries.split_off(self.entries.len() - of_line),
            ..Self::default()
        };
        std::mem::replace(self, next)
    }

    /// Removes the values from the step of an entry on, except those of its own line.
    fn purge(&mut self, entry: &LogValue) {
        let before = self.entries.len();
        self.entries
            .retain(|other| other.step < entry.step || other.place == entry.place);
        self.purged += before - self.entries.len();
    }

    fn remove_last(&mut self, slot: usize) {
        let last = self.entries.iter().rposition(|other| other.slot == slot);
        last.map(|place| self.entries.remove(place));
    }

    fn last(&self, slots: usize) -> Vec<Option<LogValue>> {
        let mut last = vec![None; slots];
        for entry in &self.entries {
            last[entry.slot] = Some(*entry);
        }
        last
    }
}

/// Two files with the same steps of a slot.
fn overlap(entries: &[LogValue]) -> Option<[usize; 2]> {
    let mut spans: BTreeMap<(usize, usize), (u64, u64)> = BTreeMap::new();
    for entry in entries {
        let span = spans
            .entry((entry.slot, entry.place.0))
            .or_insert((entry.step, entry.step));
        *span = (span.0.min(entry.step), span.1.max(entry.step));
    }
    let mut spans: Vec<(usize, (u64, u64), usize)> = spans
        .into_iter()
        .map(|((slot, file), span)| (slot, span, file))
        .collect();
    spans.sort_unstable();
    let both = |pair: &[(usize, (u64, u64), usize)]| pair[0].0 == pair[1].0 && pair[1].1.0 <= pair[0].1.1;
    let pair = spans.windows(2).find(|pair| both(pair))?;
    Some([pair[0].2, pair[1].2])
}

/// Sorts the files by their first steps.
fn by_steps(entries: &mut [LogValue]) {
    let mut first: BTreeMap<usize, u64> = BTreeMap::new();
    for entry in entries.iter() {
        let step = first.entry(entry.place.0).or_insert(entry.step);
        *step = entry.step.min(*step);
    }
    entries.sort_by_key(|entry| (first[&entry.place.0], entry.place.0));
}

#[cfg(test)]
mod tests;
