//! The record of a submission, on disk beside the trials.
//!
//! ```text
//! <store>/submissions/<id>/submission.json       the trials that were submitted, and the state of their jobs
//!                          array-0.sbatch        the script of each array, as its queue reads it
//!                          array-0.job           the job that took it, where a queue finds none by its name
//!                          array-0-task-0.log    output of its workers
//! <store>/submissions/lock                       held by a process while it decides and submits
//! ```
//!
//! The record is written before the jobs are submitted, so there is no job without a record. A crash in between leaves
//! a record without jobs, which the next request to the queue shows.

use super::{Queue, Work};
use crate::{
    store::{self, Fault, Finding, Findings, Store, flush_way, names, write_durably},
    world::{fs, process},
};
use contract::{Error, form_version::form_version};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{
    collections::BTreeSet,
    io::ErrorKind,
    path::{Path, PathBuf},
};

/// Version of the record's form.
const SCHEMA: u32 = 1;

/// A submission: workers for the trials that were missing at its time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Submission {
    /// Version of this record's form.
    pub schema: u32,
    /// Name that this program gave the submission. It is random and not part of any result.
    pub id: String,
    /// State of its jobs.
    pub state: SubmissionState,
    /// The command of its workers.
    pub work: Work,
    /// Name of the executor that took the submission.
    #[serde(default = "the_first")]
    pub executor: String,
    /// Options of the executor with which its workers were requested.
    pub options: Value,
    /// The job arrays of the submission.
    pub arrays: Vec<Array>,
    /// Ids of the trials that were missing; empty once the submission is closed.
    pub trials: BTreeSet<String>,
    #[serde(skip)]
    store: PathBuf,
}

/// The executor of records from before there was a choice.
fn the_first() -> String {
    "slurm".into()
}

/// State of a submission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SubmissionState {
    /// The jobs may be queued or running.
    Open,
    /// The jobs have ended.
    Ended,
    /// The submission was given up by `regimen cancel`.
    Cancelled,
    /// The executor did not take the submission.
    Refused,
}

/// One job array of a submission.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Array {
    /// Number of tasks; their indices begin at 0.
    pub tasks: usize,
    /// Number of tasks that may run at a time.
    pub at_once: usize,
    /// Id of the job, once the queue gave one. It is only shown and decides nothing.
    pub job: Option<String>,
}

impl Array {
    /// Divides `tasks` into arrays of at most `largest` tasks; `at_once` tasks of all arrays may run at a time.
    ///
    /// Every array is allowed at least one running task, so there are at most `at_once` of them. Tasks beyond that are
    /// left out: a worker pulls trials until none is left, and the process that follows the submission submits again if
    /// that was not enough.
    #[must_use]
    pub fn divide(tasks: usize, largest: usize, at_once: usize) -> Vec<Self> {
        let (largest, at_once) = (largest.max(1), at_once.max(1));
        let arrays = tasks.div_ceil(largest).min(at_once);
        let tasks = tasks.min(arrays * largest);
        let share = |of: usize, position: usize| of / arrays + usize::from(position < of % arrays);
        (0..arrays)
            .map(|position| {
                let tasks = share(tasks, position);
                Self {
                    tasks,
                    at_once: share(at_once, position).min(tasks),
                    job: None,
                }
            })
            .collect()
    }
}

impl Submission {
    /// A record that is on no disk and covers no trial, to be shown or [entered](Self::enter) into the store.
    #[must_use]
    pub fn sample(store: &Path, work: &Work, queue: &dyn Queue, arrays: Vec<Array>) -> Self {
        Self {
            schema: SCHEMA,
            id: "ID".into(),
            state: SubmissionState::Open,
            work: work.clone(),
            executor: queue.name().into(),
            options: queue.options(),
            arrays,
            trials: BTreeSet::new(),
            store: store.to_path_buf(),
        }
    }

    /// Gives the submission a name of its own and writes its record to the disk.
    ///
    /// # Errors
    /// [`Error::File`] if the store cannot be written.
    pub fn enter(&mut self) -> Result<(), Error> {
        let all = folder_of_all(&self.store);
        fs::create_dir_all(&all).map_err(Error::file("create", &all))?;
        self.id = unused_name(&all)?;
        // A job must not outlive its record, even after a loss of power.
        flush_way(&self.folder(), 2)?;
        self.save()
    }

    /// All submissions of a store, in the order of their names. Damaged records are left out and found by [`damaged`];
    /// those of a later version of the program are also left out.
    ///
    /// # Errors
    /// [`Error::File`] if a record cannot be read.
    pub fn all(store: &Path) -> Result<Vec<Self>, Error> {
        let folder = folder_of_all(store);
        let mut submissions = Vec::new();
        for name in records(&folder)? {
            match read(store, &folder.join(name)) {
                Err(Error::Damaged { .. }) => {}
                found => submissions.extend(found?),
            }
        }
        Ok(submissions)
    }

    /// The submission with an id; `None` if its record is absent or cannot be read.
    ///
    /// # Errors
    /// [`Error::File`] if the record cannot be read.
    pub fn find(store: &Path, id: &str) -> Result<Option<Self>, Error> {
        match read(store, &folder_of_all(store).join(id)) {
            Err(Error::Damaged { .. }) => Ok(None),
            found => found,
        }
    }

    /// Number of tasks of all arrays.
    #[must_use]
    pub fn tasks(&self) -> usize {
        self.arrays.iter().map(|array| array.tasks).sum()
    }

    /// Folder of the submission in the store.
    #[must_use]
    pub fn folder(&self) -> PathBuf {
        folder_of_all(&self.store).join(&self.id)
    }

    /// The name that its jobs carry.
    #[must_use]
    pub fn job_name(&self) -> String {
        format!("regimen-{}", self.id)
    }

    /// Path of the script of one array.
    #[must_use]
    pub fn script(&self, array: usize, ending: &str) -> PathBuf {
        self.folder().join(format!("array-{array}.{ending}"))
    }

    /// Writes the record.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be written.
    pub fn save(&self) -> Result<(), Error> {
        let path = self.folder().join(RECORD);
        let text = serde_json::to_vec_pretty(self).map_err(|source| Error::Damaged {
            path: path.clone(),
            problem: source.to_string(),
        })?;
        write_durably(&path, &text)
    }

    /// Records that the submission is no longer needed.
    ///
    /// # Errors
    /// [`Error::File`] if the record cannot be written.
    pub fn close(&mut self, state: SubmissionState) -> Result<(), Error> {
        self.state = state;
        self.trials.clear();
        self.save()
    }

    /// The last lines of the log that was written last; empty if there is none.
    #[must_use]
    pub fn log_tail(&self, lines: usize) -> String {
        let logs = fs::read_dir(self.folder())
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.path());
        let logs = logs.filter(|path| path.extension().is_some_and(|extension| extension == "log"));
        let written = |path: &PathBuf| fs::metadata(path).and_then(|data| data.modified()).ok();
        let Some(path) = logs.max_by_key(written) else {
            return String::new();
        };
        let bytes = fs::read(&path).unwrap_or_default();
        let text = String::from_utf8_lossy(&bytes);
        let all: Vec<&str> = text.lines().collect();
        let tail: Vec<String> = all[all.len().saturating_sub(lines)..]
            .iter()
            .map(|line| format!("\n    {line}"))
            .collect();
        format!("\n  the end of {}:{}", path.display(), tail.concat())
    }
}

pub(super) fn folder_of_all(store: &Path) -> PathBuf {
    store.join("submissions")
}

/// Names of the folders of records; an entry that is not a folder contains none.
fn records(folder: &Path) -> Result<Vec<String>, Error> {
    if is_folder(folder)? {
        names(folder)
    } else {
        Ok(Vec::new())
    }
}

/// A record that cannot be read now must not count as absent, since its jobs would be submitted again.
fn is_folder(path: &Path) -> Result<bool, Error> {
    match fs::metadata(path) {
        Ok(data) => Ok(data.is_dir()),
        Err(source) if source.kind() == ErrorKind::NotFound => Ok(false),
        Err(source) => Err(Error::file("look at", path)(source)),
    }
}

/// Damaged records of a store: paths inside it, each with the fault.
///
/// # Errors
/// [`Error::File`] if a record cannot be read.
pub fn damaged(store: &Path) -> Result<Vec<Finding>, Error> {
    let folder = folder_of_all(store);
    let mut findings = Vec::new();
    for name in records(&folder)? {
        if let Err(Error::Damaged { problem, .. }) = read(store, &folder.join(&name)) {
            findings.push(Finding {
                path: Path::new("submissions").join(&name).join(RECORD),
                fault: Fault::Damaged,
                problem: format!("{problem}; its jobs, if any live, are named regimen-{name}"),
                trial: None,
            });
        }
    }
    Ok(findings)
}

/// Sets aside damaged records, so that the others count, and returns the findings.
///
/// # Errors
/// [`Error::File`] if a record cannot be read or moved.
pub fn heal(store: &Path) -> Result<Findings, Error> {
    Store::at(store).aside(damaged(store)?)
}

const RECORD: &str = "submission.json";

/// Reads a record; `None` if a submitter died before it wrote one, or a later version of the program wrote it.
fn read(store: &Path, folder: &Path) -> Result<Option<Submission>, Error> {
    if !is_folder(folder)? {
        return Ok(None);
    }
    let path = folder.join(RECORD);
    let Some(text) = store::read_file(&path)? else {
        return Ok(None);
    };
    let damaged = |source: serde_json::Error| Error::Damaged {
        path: path.clone(),
        problem: source.to_string(),
    };
    if form_version(&text).map_err(damaged)? > SCHEMA {
        return Ok(None);
    }
    let submission: Submission = serde_json::from_slice(&text).map_err(damaged)?;
    Ok(Some(Submission {
        store: store.to_path_buf(),
        ..submission
    }))
}

/// Creates a folder under a name that no other submission has; uses the system's randomness and no clock.
fn unused_name(all: &Path) -> Result<String, Error> {
    loop {
        let random = process::random_number();
        let name = blake3::hash(&random.to_le_bytes()).to_hex()[..10].to_string();
        let folder = all.join(&name);
        match fs::create_dir(&folder) {
            Ok(()) => return Ok(name),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(source) => return Err(Error::file("create", &folder)(source)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::executor::slurm::{self, Slurm};
    use proptest::prelude::*;

    fn work() -> Work {
        Work {
            specs: vec!["a.yaml".into()],
            program: "regimen".into(),
            arguments: vec!["worker".into()],
            folder: "/".into(),
        }
    }

    fn create(store: &Path) -> Submission {
        let array = Array {
            tasks: 2,
            at_once: 1,
            job: None,
        };
        let slurm = Slurm {
            options: slurm::SlurmOptions::default(),
        };
        let mut submission = Submission::sample(store, &work(), &slurm, vec![array]);
        submission.trials.insert("t".to_owned());
        submission.enter().unwrap();
        submission
    }

    #[test]
    fn records_come_back_as_they_were_written() {
        let store = tempfile::tempdir().unwrap();
        assert_eq!(Submission::all(store.path()).unwrap(), []);
        let (mut one, other) = (create(store.path()), create(store.path()));
        assert_ne!(one.id, other.id);
        one.arrays[0].job = Some("7".into());
        one.close(SubmissionState::Ended).unwrap();
        let mut expected = vec![one, other];
        expected.sort_by(|one, other| one.id.cmp(&other.id));
        assert_eq!(Submission::all(store.path()).unwrap(), expected);
        let found = Submission::find(store.path(), &expected[1].id).unwrap();
        assert_eq!(found.as_ref(), Some(&expected[1]));
        assert_eq!(Submission::find(store.path(), "another").unwrap(), None);
    }

    #[test]
    fn a_record_that_names_no_executor_is_of_slurm() {
        let store = tempfile::tempdir().unwrap();
        let one = create(store.path());
        let mut record = serde_json::to_value(&one).unwrap();
        assert_eq!(
            record.as_object_mut().unwrap().remove("executor"),
            Some("slurm".into())
        );
        fs::write(one.folder().join("submission.json"), record.to_string()).unwrap();
        assert_eq!(Submission::all(store.path()).unwrap(), [one]);
    }

    #[test]
    fn a_folder_without_a_record_is_no_submission_and_a_damaged_record_is_named() {
        let store = tempfile::tempdir().unwrap();
        let one = create(store.path());
        fs::remove_file(one.folder().join("submission.json")).unwrap();
        assert_eq!(Submission::all(store.path()).unwrap(), []);
        let other = create(store.path());
        fs::write(one.folder().join("submission.json"), "{").unwrap();
        assert_eq!(Submission::all(store.path()).unwrap(), [other]);
        let found = heal(store.path()).unwrap();
        assert_eq!(found.aside, Some("aside/1".into()));
        let path = Path::new("submissions").join(&one.id).join("submission.json");
        assert_eq!(found.findings[0].path, path);
        assert!(store.path().join("aside/1").join(path).exists());
        assert_eq!(damaged(store.path()).unwrap(), []);
    }

    #[test]
    fn a_record_of_a_later_version_is_left_to_it() {
        let store = tempfile::tempdir().unwrap();
        let one = create(store.path());
        let later = r#"{"schema": 9, "kind": "other"}"#;
        fs::write(one.folder().join("submission.json"), later).unwrap();
        assert_eq!(Submission::all(store.path()).unwrap(), []);
        assert_eq!(damaged(store.path()).unwrap(), []);
    }

    #[test]
    fn the_tail_is_of_a_log() {
        let store = tempfile::tempdir().unwrap();
        let one = create(store.path());
        assert_eq!(one.log_tail(2), "");
        fs::write(one.folder().join("array-0-task-1.log"), "a\nb\nc\n").unwrap();
        assert!(one.log_tail(2).ends_with("array-0-task-1.log:\n    b\n    c"));
    }

    #[test]
    fn large_arrays_are_divided() {
        let sizes = |tasks, largest, at_once| -> Vec<(usize, usize)> {
            Array::divide(tasks, largest, at_once)
                .iter()
                .map(|array| (array.tasks, array.at_once))
                .collect()
        };
        assert_eq!(sizes(5, 1001, 100), [(5, 5)]);
        assert_eq!(sizes(2500, 1001, 16), [(834, 6), (833, 5), (833, 5)]);
        assert_eq!(sizes(2500, 1001, 2), [(1001, 1), (1001, 1)]);
        assert_eq!(sizes(0, 1001, 2), []);
    }

    proptest! {
        #[test]
        fn no_array_is_empty_too_large_or_too_wide(tasks in 0usize..5000, largest in 1usize..2000,
            at_once in 1usize..300) {
            let arrays = Array::divide(tasks, largest, at_once);
            prop_assert!(arrays.iter().all(|array| (1..=largest).contains(&array.tasks)));
            prop_assert!(arrays.iter().all(|array| (1..=array.tasks).contains(&array.at_once)));
            prop_assert!(arrays.iter().map(|array| array.at_once).sum::<usize>() <= at_once);
            let all: usize = arrays.iter().map(|array| array.tasks).sum();
            prop_assert!(all == tasks || arrays.len() == at_once);
        }
    }
}
