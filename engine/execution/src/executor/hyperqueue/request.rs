//! The request for one array: the tasks of its job, and the file in which the job is recorded.

use super::HyperQueueOptions;
use crate::{
    executor::{Submission, quoted},
    store::read_file,
    world::fs,
};
use contract::Error;
use serde::{Deserialize, Serialize};
use std::{
    num::NonZeroUsize,
    path::{Path, PathBuf},
};

/// The tasks of one job, which are all equal.
#[derive(Debug, Serialize)]
pub struct Request {
    /// Name that the job carries.
    name: String,
    /// Number of tasks.
    tasks: usize,
    /// Cores of each task.
    cpus: usize,
    /// Graphics cards of each task.
    gpus: usize,
    /// Time in seconds that a worker of HyperQueue must still have when it is given a task.
    min_time_s: Option<u32>,
    /// Folder in which the tasks run.
    folder: PathBuf,
    /// Command of each task: a shell and its script.
    command: [String; 3],
    /// File in which the job is recorded once the server has it.
    note: PathBuf,
}

/// A job that a server took.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Job {
    /// The server's own name.
    pub server: String,
    /// The job's number on that server.
    pub job: u64,
}

impl Job {
    /// Server and number, for users.
    #[must_use]
    pub fn text(&self) -> String {
        format!("{}@{}", self.job, self.server)
    }
}

impl Request {
    /// The request for one array of a submission.
    #[must_use]
    pub fn of(submission: &Submission, array: usize, options: &HyperQueueOptions) -> Self {
        Self {
            name: submission.job_name(),
            tasks: submission.arrays[array].tasks,
            cpus: options.cpus_per_task().get(),
            gpus: options.gpus_per_task.map_or(0, NonZeroUsize::get),
            min_time_s: options.min_time_s.map(Into::into),
            folder: submission.work.folder.clone(),
            command: ["sh".into(), "-c".into(), script(submission, array, options)],
            note: note(submission, array),
        }
    }
}

/// Shell script of a task. HyperQueue restarts it if its worker was lost; its log is then continued.
fn script(submission: &Submission, array: usize, options: &HyperQueueOptions) -> String {
    let log = submission.folder().join(log_name(array));
    let mut lines = vec![format!(
        "exec >> {}\"$HQ_TASK_ID\".log 2>&1",
        quoted(&log.to_string_lossy())
    )];
    lines.extend(options.setup.iter().flatten().cloned());
    // `exec` makes the worker the task itself, since HyperQueue ends only that process.
    lines.push(format!(
        "exec {} --submission {}",
        submission.work.command(),
        submission.id
    ));
    lines.join("\n")
}

fn log_name(array: usize) -> String {
    format!("array-{array}-task-")
}

fn note(submission: &Submission, array: usize) -> PathBuf {
    submission.folder().join(format!("array-{array}.job"))
}

/// The job of an array; `None` if no server took it.
///
/// # Errors
/// The note cannot be read.
pub fn job(submission: &Submission, array: usize) -> Result<Option<Job>, Error> {
    let path = note(submission, array);
    let damaged = |source: serde_json::Error| Error::Damaged {
        path: path.clone(),
        problem: source.to_string(),
    };
    let text = read_file(&path)?;
    text.map(|text| serde_json::from_slice(&text).map_err(damaged))
        .transpose()
}

/// Number of tasks of an array that have begun: each has a log.
#[must_use]
pub fn begun(submission: &Submission, array: usize) -> usize {
    let name = log_name(array);
    let is_log = |path: &Path| {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        file.starts_with(&name) && file.ends_with(".log")
    };
    let entries = fs::read_dir(submission.folder()).into_iter().flatten().flatten();
    entries.filter(|entry| is_log(&entry.path())).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::executor::{Array, Work, hyperqueue::HyperQueue};

    fn submission(store: &Path, options: &HyperQueueOptions) -> Submission {
        let work = Work {
            specs: vec!["table.yaml".into()],
            program: "/opt/regimen/bin/regimen".into(),
            arguments: ["worker", "/shared/my studies/table.yaml", "-j", "2"]
                .map(Into::into)
                .to_vec(),
            folder: "/shared/my studies".into(),
        };
        let queue = HyperQueue {
            options: options.clone(),
        };
        Submission::sample(store, &work, &queue, Array::divide(3, 16, 16))
    }

    #[test]
    fn a_request_says_who_it_is_and_becomes_the_worker() {
        let options: HyperQueueOptions = toml::from_str(
            "cpus_per_task = 2\ngpus_per_task = 1\nmin_time_s = 600\nsetup = [\"module load regimen\"]",
        )
        .unwrap();
        let request = Request::of(&submission(Path::new("/shared/a store"), &options), 0, &options);
        let expected = "exec >> '/shared/a store/submissions/ID/array-0-task-'\"$HQ_TASK_ID\".log 2>&1\n\
                        module load regimen\n\
                        exec /opt/regimen/bin/regimen worker '/shared/my studies/table.yaml' -j 2 --submission ID";
        assert_eq!(request.command, ["sh", "-c", expected]);
        assert_eq!(
            (request.tasks, request.cpus, request.gpus, request.min_time_s),
            (3, 2, 1, Some(600))
        );
        assert_eq!(
            request.note,
            Path::new("/shared/a store/submissions/ID/array-0.job")
        );
    }

    #[test]
    fn a_job_is_known_by_its_note_and_a_task_that_began_by_its_log() {
        let store = tempfile::tempdir().unwrap();
        let submission = submission(store.path(), &HyperQueueOptions::default());
        fs::create_dir_all(submission.folder()).unwrap();
        assert_eq!((job(&submission, 0).unwrap(), begun(&submission, 0)), (None, 0));
        for (name, text) in [
            ("array-0.job", r#"{"server": "QjNQVn", "job": 7}"#),
            ("array-0-task-0.log", ""),
            ("array-0-task-12.log", ""),
            ("array-1-task-0.log", ""),
        ] {
            fs::write(submission.folder().join(name), text).unwrap();
        }
        let found = job(&submission, 0).unwrap().unwrap();
        assert_eq!((found.text().as_str(), begun(&submission, 0)), ("7@QjNQVn", 2));
        fs::write(submission.folder().join("array-0.job"), "{").unwrap();
        assert!(job(&submission, 0).is_err());
    }
}
