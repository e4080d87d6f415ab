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
}

impl Rules {
    /// Rules for lines of tables, which may contain several runs.
    pub(super) fn of_tables(mapping: &Mapping) -> Self {
        Self {
            restart: mapping.restart,
            same_step: mapping.same_step,
            unit: "line",
            remedy: "name the column that tells runs apart under `run` or `seed`",
        }
    }

    /// Rules for records of event files; each file has one writer.
    pub(super) fn of_event_files(mapping: &Mapping) -> Self {
        Self {
            restart: mapping.restart,
            same_step: mapping.same_step.or(Some(SameStep::Mean)),
            unit: "record",
            remedy: "write `run_per: file` where every file is a run",
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
        let problem = format!(
            "it has steps that `{}` has, too: where these are two runs, {}; where one run went on from a checkpoint, write \
             `restart: resume`",
            one.path.display(),
            self.remedy
        );
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
        let problem = format!(
            "{told}: where another run begins here, write `restart: new_run`, or {}; where the run went on from a \
             checkpoint, write `restart: resume`",
            self.remedy
        );
        self.wrong(entry, problem, files)
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
        let problem = format!(
            "its steps go back more than {MOST_RESTARTS} times: sort it by step, or {}",
            self.remedy
        );
        file.wrong(None, problem)
    }

    fn at(&self, before: &LogValue, entry: &LogValue) -> String {
        let same = before.place.0 == entry.place.0;
        if same {
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
mod tests {
    use super::{super::content::content, *};

    fn log(files: &[&[(u64, f64)]]) -> Log {
        let mut log = Log::default();
        for (file, values) in files.iter().enumerate() {
            for ((step, value), line) in values.iter().zip(2..) {
                log.entries.push(LogValue {
                    place: (file, line),
                    step: *step,
                    slot: 0,
                    value: *value,
                });
            }
        }
        log
    }

    fn read(
        files: &[&[(u64, f64)]],
        restart: Option<Restart>,
        same_step: Option<SameStep>,
    ) -> Result<Vec<SeparatedRun>, String> {
        let mapping = Mapping {
            restart,
            same_step,
            ..Mapping::default()
        };
        let contents: Vec<Content> = (0..files.len())
            .map(|it| content(&format!("{it}.csv"), ""))
            .collect();
        let contents: Vec<&Content> = contents.iter().collect();
        let passes = Rules::of_tables(&mapping).told_apart(log(files), 1, &contents);
        passes.map_err(|error| error.to_string())
    }

    fn values(passes: &[SeparatedRun]) -> Vec<Vec<(u64, f64)>> {
        let of = |pass: &SeparatedRun| {
            pass.entries
                .iter()
                .map(|entry| (entry.step, entry.value))
                .collect()
        };
        passes.iter().map(of).collect()
    }

    const AGAIN: &[(u64, f64)] = &[(0, 1.0), (10, 2.0), (20, 3.0), (10, 4.0), (30, 5.0)];

    #[test]
    fn steps_that_go_back_are_refused_with_their_line_or_told_apart() {
        let told = read(&[AGAIN], None, None).unwrap_err();
        assert!(
            told.contains("`0.csv`, line 5: step 10 comes after step 20 (line 4)"),
            "{told}"
        );
        assert!(
            told.contains("`restart: new_run`")
                && told.contains("`restart: resume`")
                && told.contains("`run`")
        );
        let runs = read(&[AGAIN], Some(Restart::NewRun), None).unwrap();
        assert_eq!(
            values(&runs),
            [vec![(0, 1.0), (10, 2.0), (20, 3.0)], vec![(10, 4.0), (30, 5.0)]]
        );
        assert_eq!(runs[1].from, Some((0, 5)));
        let one = read(&[AGAIN], Some(Restart::Resume), None).unwrap();
        assert_eq!(values(&one), [vec![(0, 1.0), (10, 4.0), (30, 5.0)]]);
        assert_eq!(one[0].purged, 2);
    }

    #[test]
    fn steps_that_repeat_are_refused_averaged_or_replaced() {
        let twice: &[(u64, f64)] = &[(0, 1.0), (0, 3.0), (5, 2.0)];
        let told = read(&[twice], None, None).unwrap_err();
        assert!(
            told.contains("line 3: step 0 has a value already (line 2)")
                && told.contains("`same_step: mean`"),
            "{told}"
        );
        let both = read(&[twice], None, Some(SameStep::Mean)).unwrap();
        assert_eq!((values(&both)[0].len(), both[0].repeated), (3, 1));
        let last = read(&[twice], None, Some(SameStep::Last)).unwrap();
        assert_eq!(values(&last), [vec![(0, 3.0), (5, 2.0)]]);
    }

    #[test]
    fn files_go_on_in_the_order_of_their_steps_and_do_not_begin_again() {
        let (early, late): (&[(u64, f64)], &[(u64, f64)]) = (&[(0, 1.0), (10, 2.0)], &[(20, 3.0)]);
        assert_eq!(
            values(&read(&[late, early], None, None).unwrap()),
            [vec![(0, 1.0), (10, 2.0), (20, 3.0)]]
        );
        for steps in [
            &[(10, 9.0), (20, 9.0)],
            &[(0, 9.0), (5, 9.0)],
            &[(5, 9.0), (40, 9.0)],
        ] {
            let told = read(&[early, steps], None, None).unwrap_err();
            assert!(
                told.contains("it has steps that `") && told.contains("`restart: resume`"),
                "{told}"
            );
            assert_eq!(
                read(&[early, steps], Some(Restart::NewRun), None).unwrap().len(),
                2
            );
        }
        let resumed = read(&[early, &[(10, 9.0), (20, 9.0)]], Some(Restart::Resume), None).unwrap();
        assert_eq!(values(&resumed), [vec![(0, 1.0), (10, 9.0), (20, 9.0)]]);
    }

    #[test]
    fn a_log_in_another_order_is_no_log_of_restarts() {
        let down: Vec<(u64, f64)> = (0..200).rev().map(|step| (step, 0.0)).collect();
        let told = read(&[&down], Some(Restart::NewRun), None).unwrap_err();
        assert!(
            told.contains("go back more than 100 times: sort it by step"),
            "{told}"
        );
    }

    #[test]
    fn a_line_of_several_values_stays_together() {
        let entry = |line, step, slot| LogValue {
            place: (0, line),
            step,
            slot,
            value: 0.0,
        };
        // The second slot goes back in a line where the first one does not.
        let log = Log {
            entries: vec![entry(2, 5, 1), entry(3, 1, 0), entry(3, 1, 1)],
            ..Log::default()
        };
        let file = content("a.csv", "");
        let mapping = Mapping {
            restart: Some(Restart::NewRun),
            ..Mapping::default()
        };
        let runs = Rules::of_tables(&mapping).told_apart(log, 2, &[&file]).unwrap();
        assert_eq!((runs[0].entries.len(), runs[1].entries.len()), (1, 2));
    }

    proptest::proptest! {
        /// No value is lost if runs are separated, and a resumed run has the values of a naive purge.
        #[test]
        fn steps_never_go_back_in_what_is_read(steps in proptest::collection::vec(0_u64..20, 1..60)) {
            let logged: Vec<(u64, f64)> = steps.iter().zip(0_u32..).map(|(step, at)| (*step, f64::from(at))).collect();
            let runs = values(&read(&[&logged], Some(Restart::NewRun), Some(SameStep::Mean)).unwrap());
            proptest::prop_assert_eq!(runs.concat(), logged.clone());
            proptest::prop_assert!(runs.iter().all(|run| run.is_sorted_by_key(|(step, _)| *step)));
            let mut purged: Vec<(u64, f64)> = Vec::new();
            for (step, value) in logged.clone() {
                if purged.last().is_some_and(|(last, _)| *last > step) {
                    purged.retain(|(other, _)| *other < step);
                }
                purged.push((step, value));
            }
            let resumed = values(&read(&[&logged], Some(Restart::Resume), Some(SameStep::Mean)).unwrap());
            proptest::prop_assert_eq!(&resumed[..], &[purged][..]);
            let told = read(&[&logged], None, Some(SameStep::Mean));
            proptest::prop_assert_eq!(told.is_ok(), runs.len() == 1);
        }
    }
}
