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
            self.look(place, true)?;
        }
        for source in &self.sources {
            for (place, key) in &source.keys {
                if self.curves[*place].values.is_empty() {
                    let name = &self.curves[*place].metric.name;
                    let files = self.files(source).unwrap_or_default();
                    return Err(metric_errors::missing(name, key, &source.from, &files, seen));
                }
            }
        }
        Ok(&self.curves)
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
mod tests {
    use super::*;
    use crate::config::tests::config;
    use serde_json::{Value, json};

    struct WrittenFiles {
        folder: tempfile::TempDir,
        metrics: Metrics,
    }

    impl WrittenFiles {
        fn new(reads: Value, metrics: Value, goes_on: bool) -> Self {
            let folder = tempfile::tempdir().unwrap();
            let config = config(json!({ "reads": reads, "metrics": metrics }));
            let metrics = Metrics::of(&config, folder.path(), folder.path(), goes_on);
            Self { folder, metrics }
        }

        fn write(&self, name: &str, text: &str) {
            let path = self.folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }

        fn last(&mut self) -> Result<Vec<Vec<(u64, f64)>>, String> {
            let seen = [("lr", None), ("z", Some("\u{1b}[32m1,000\u{1b}[0m"))];
            let seen = seen.map(|(name, value)| SeenKey {
                name: name.to_owned(),
                no_number: value.map(str::to_owned),
            });
            let curves = self.metrics.last(&seen).map_err(|error| error.to_string())?;
            Ok(curves.iter().map(|it| it.values.clone()).collect())
        }
    }

    #[test]
    fn values_are_read_from_every_source_while_they_grow() {
        let metrics =
            json!({ "a": "x", "b": { "key": "r", "from": "runs/*/log.csv", "step": { "sum": "l" } } });
        let mut written = WrittenFiles::new(json!({}), metrics, false);
        assert!(written.metrics.now().iter().all(|curve| curve.values.is_empty()));
        written.write("stdout.jsonl", "{\"step\": 1, \"x\": \"0.5\"}\n");
        assert_eq!(written.metrics.now()[0].values, [(1, 0.5)]);
        written.write("runs/1/log.csv", "r,l\n1,10\n3,10\n");
        assert_eq!(written.metrics.now()[1].values, [(10, 1.0), (20, 3.0)]);
        written.write("runs/1/log.csv", "r,l\n1,10\n3,10\n3,5\n");
        assert_eq!(
            written.last(),
            Ok(vec![vec![(1, 0.5)], vec![(10, 1.0), (20, 3.0), (25, 3.0)]])
        );
    }

    #[test]
    fn a_number_that_is_none_stays_one_to_be_judged() {
        let mut written = WrittenFiles::new(json!({}), json!({ "a": "x" }), false);
        written.write(
            "stdout.jsonl",
            "{\"step\": \"1\", \"x\": \"NaN\"}\n{\"step\": \"2\", \"x\": \"inf\"}\n",
        );
        let values = written.last().unwrap().remove(0);
        assert!(values[0].1.is_nan() && values[1] == (2, f64::INFINITY));
    }

    #[test]
    fn one_metric_does_not_wait_for_another() {
        let mut written =
            WrittenFiles::new(json!({ "from": "log.csv" }), json!({ "a": "x", "b": "y" }), false);
        written.write("log.csv", "step,y\n1,2\n");
        let _ = written.metrics.now();
        let told = written.last().unwrap_err();
        assert!(told.contains("`x`"), "{told}");
    }

    #[test]
    fn a_metric_without_values_at_the_end_is_named_with_the_keys_found() {
        let mut written = WrittenFiles::new(json!({}), json!({ "a": "x" }), false);
        let told = written.last().unwrap_err();
        assert!(
            told.contains("no value of it, which is to be `a`; keys that were there: `lr`, `z`"),
            "{told}"
        );
        let mut written = WrittenFiles::new(json!({ "from": "*.csv" }), json!({ "a": "x" }), false);
        assert!(written.last().unwrap_err().contains("wrote no such file"));
        written.write("b.csv", "step,y\n1,2\n");
        let told = written.last().unwrap_err();
        assert!(told.contains("b.csv") && told.contains("`x`"), "{told}");
    }

    #[test]
    fn values_that_are_no_numbers_are_quoted_with_the_name_of_their_source() {
        let refused = |name: &str, from: &str, text: &str| {
            let mut written = WrittenFiles::new(json!({ "from": from }), json!({ "a": "z" }), false);
            written.write(name, text);
            written.last().unwrap_err()
        };
        for (line, told) in [
            (
                "",
                "`stdout`, column `z`: no value of it, which is to be `a`; its values are no numbers, as `[32m1,000[0m`, \
                 which has codes for colours",
            ),
            (
                r#"{"step": "100/1000", "z": "1"}"#,
                "`stdout`, column `step`: `100/1000` is no number; its line has `step=100/1000 z=1`",
            ),
            (
                r#"{"step": "-100", "z": "1"}"#,
                "`-100` is no whole number from 0 to 9e15",
            ),
        ] {
            let refusal = refused("stdout.jsonl", "stdout", &format!("{line}\n"));
            assert!(refusal.contains(told), "{refusal}");
        }
        for (text, told) in [
            ("step,z\n", "and no row"),
            ("step,z\n1,\n", "the cells of this column are empty"),
            (
                "step,z\n1,high\n",
                "`runs/log.csv`, line 2, column `z`: `high` is no number",
            ),
        ] {
            let refusal = refused("runs/log.csv", "runs/*.csv", text);
            assert!(refusal.contains(told), "{refusal}");
        }
    }

    #[test]
    fn lines_without_a_step_beside_others_are_named_as_the_cause() {
        let mut written = WrittenFiles::new(json!({}), json!({ "a": "x" }), false);
        let lines = [
            "{\"regimen_at\":1,\"step\":\"100\",\"x\":\"1\"}",
            "{\"regimen_at\":2,\"step\":2,\"x\":\"5\"}",
        ];
        written.write("stdout.jsonl", &format!("{}\n", lines.join("\n")));
        let told = written.last().unwrap_err();
        assert!(
            told.ends_with("its line has `x=5`; 1 of its lines with metrics have no `step` and are numbered: print it in each"),
            "{told}"
        );
    }

    #[test]
    fn a_file_outside_the_working_folder_is_refused_with_the_name_of_that_folder() {
        let mut written = WrittenFiles::new(json!({ "from": "log.csv" }), json!({ "a": "x" }), false);
        let outside = tempfile::tempdir().unwrap();
        fs::write(outside.path().join("log.csv"), "step,x\n1,2\n").unwrap();
        std::os::unix::fs::symlink(
            outside.path().join("log.csv"),
            written.folder.path().join("log.csv"),
        )
        .unwrap();
        let told = written.last().unwrap_err();
        assert!(
            told.contains("`log.csv` leads out of the working folder of the trial"),
            "{told}"
        );
    }

    #[test]
    fn steps_go_back_where_a_program_went_on_and_nowhere_else() {
        let log = "{\"step\":\"10\",\"x\":\"1\"}\n{\"step\":\"20\",\"x\":\"2\"}\n{\"step\":\"20\",\"x\":\"3\"}\n\
                   {\"step\":\"15\",\"x\":\"4\"}\n";
        let read = |goes_on| {
            let mut written = WrittenFiles::new(json!({}), json!({ "a": "x" }), goes_on);
            written.write("stdout.jsonl", log);
            written.last()
        };
        assert_eq!(read(true), Ok(vec![vec![(10, 1.0), (15, 4.0)]]));
        let told = read(false).unwrap_err();
        assert!(
            told.contains("`stdout`: step 15 comes after step 20: ")
                && told.ends_with("; its line has `step=15 x=4`"),
            "{told}"
        );
    }

    /// A program that is killed after a row that its checkpoint does not cover writes the row again.
    #[test]
    fn rows_of_a_table_that_stand_twice_behind_each_other_count_once() {
        let folder = tempfile::tempdir().unwrap();
        let config = config(json!({ "reads": { "from": "log.csv" }, "metrics": { "a": "x" } }));
        let metrics = || Metrics::of(&config, folder.path(), folder.path(), true);
        fs::write(folder.path().join("log.csv"), "step,x\n1,1\n2,10\n").unwrap();
        metrics().mark_continuation().unwrap();
        fs::write(
            folder.path().join("log.csv"),
            "step,x\n1,1\n2,10\n2,20\n3,30\n3,50\n",
        )
        .unwrap();
        let curves = metrics().last(&[]).unwrap()[0].values.clone();
        assert_eq!(curves, [(1, 1.0), (2, 20.0), (3, 30.0), (3, 50.0)]);
    }

    #[test]
    fn several_runs_are_no_trial() {
        let mut written = WrittenFiles::new(json!({ "from": "*/log.csv" }), json!({ "a": "x" }), false);
        written.write("one/log.csv", "step,x\n1,2\n");
        written.write("two/log.csv", "step,x\n1,2\n");
        let told = written.last().unwrap_err();
        assert!(told.contains("these files hold 2: `one`, `two`"), "{told}");
    }
}
