//! Starts the real program in a folder of its own.

use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
};
use tempfile::TempDir;

/// A folder with the program's store and results in it; gone at the end.
pub(crate) struct Bench {
    folder: TempDir,
}

/// Output of a command, and its exit code.
pub(crate) struct Answer {
    /// Exit code.
    pub(crate) code: i32,
    /// Standard output.
    pub(crate) out: String,
    /// Standard error.
    pub(crate) err: String,
}

impl Bench {
    /// An empty folder.
    pub(crate) fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
        }
    }

    /// A path inside the folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file into the folder.
    pub(crate) fn write(&self, name: &str, text: &str) -> PathBuf {
        std::fs::write(self.path(name), text).unwrap();
        self.path(name)
    }

    /// The command, ready to start, in the folder.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_regimen"));
        command
            .args(arguments)
            .current_dir(self.folder.path())
            .env("XDG_STATE_HOME", self.path("state"))
            .env("XDG_CONFIG_HOME", self.path("config"))
            .env_remove("CUDA_VISIBLE_DEVICES")
            .env_remove("REGIMEN_STORE")
            .env_remove("REGIMEN_JOBS");
        command
    }

    /// The command of the program that tests misuse, ready to start in the folder.
    pub(crate) fn misused(&self, arguments: &[&str]) -> Command {
        self.built("program-under-test", arguments)
    }

    /// The command of another program that is built with the tests, ready to start in the folder.
    pub(crate) fn built(&self, program: &str, arguments: &[&str]) -> Command {
        let beside = Path::new(env!("CARGO_BIN_EXE_regimen"))
            .parent()
            .unwrap()
            .join("examples");
        let mut command = Command::new(beside.join(program));
        command
            .args(arguments)
            .current_dir(self.folder.path())
            .env("XDG_STATE_HOME", self.path("state"))
            .env("XDG_CONFIG_HOME", self.path("config"))
            .env_remove("CUDA_VISIBLE_DEVICES")
            .env_remove("REGIMEN_STORE")
            .env_remove("REGIMEN_JOBS");
        command
    }

    /// Runs the program that tests misuse to its end.
    pub(crate) fn run_misused(&self, arguments: &[&str]) -> Answer {
        answer(&self.misused(arguments).output().unwrap())
    }

    /// Runs the program to its end.
    pub(crate) fn run(&self, arguments: &[&str]) -> Answer {
        answer(&self.command(arguments).output().unwrap())
    }

    /// Runs the program and expects it to succeed.
    pub(crate) fn ok(&self, arguments: &[&str]) -> String {
        let answer = self.run(arguments);
        assert_eq!(answer.code, 0, "{arguments:?}\n{}\n{}", answer.out, answer.err);
        answer.out
    }

    /// Hash of the metrics file of every trial in a store, by trial id, as acknowledged.
    pub(crate) fn digests(&self, store: &str) -> Vec<(String, String)> {
        let mut digests = Vec::new();
        for file in trial_files(&self.path(store)) {
            let text = std::fs::read_to_string(&file).unwrap();
            let trial: serde_json::Value = serde_json::from_str(&text).unwrap();
            let id = file
                .parent()
                .unwrap()
                .file_name()
                .unwrap()
                .to_string_lossy()
                .into_owned();
            digests.push((id, trial["end"]["digest"].as_str().unwrap().to_owned()));
        }
        digests.sort();
        digests
    }
}

/// Every `trial.json` under a store.
pub(crate) fn trial_files(store: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for group in std::fs::read_dir(store.join("trials")).unwrap() {
        for trial in std::fs::read_dir(group.unwrap().path()).unwrap() {
            let file = trial.unwrap().path().join("trial.json");
            if file.exists() {
                files.push(file);
            }
        }
    }
    files
}

/// The text of a `trial.json` that was changed, with a check that holds.
pub(crate) fn reseal(text: &str) -> String {
    let object = text
        .split_once(",\"check\":\"")
        .map_or(text, |(object, _)| object);
    format!(
        "{object},\"check\":\"{}\"}}",
        contract::digest::of_bytes(object.as_bytes())
    )
}

/// Changes the values that a trial recorded a little, with a `trial.json` that fits: `file` is that of the trial.
pub(crate) fn forge(file: &Path) {
    let path = file.with_file_name("metrics.parquet");
    let table = contract::metrics_file::read(&path).unwrap();
    let mut record = contract::Recorder::default();
    for row in &table.rows {
        let (metric, seat) = (&table.names[usize::from(row.metric)], row.seat.into());
        record.add(row.phase, row.step, row.episode, seat, metric, row.value + 1e-12);
    }
    let id = file.parent().unwrap().file_name().unwrap().to_str().unwrap();
    let bytes = contract::metrics_file::encode(&record, id).unwrap();
    let text = std::fs::read_to_string(file).unwrap();
    let before: serde_json::Value = serde_json::from_str(&text).unwrap();
    let digest = before["end"]["digest"].as_str().unwrap();
    let text = text.replace(digest, &contract::digest::of_bytes(&bytes));
    std::fs::write(path, &bytes).unwrap();
    std::fs::write(file, reseal(&text)).unwrap();
}

/// Answer of a finished command.
pub(crate) fn answer(output: &Output) -> Answer {
    Answer {
        code: output.status.code().unwrap_or(-1),
        out: String::from_utf8_lossy(&output.stdout).into_owned(),
        err: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

/// The repository's root.
pub(crate) fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}
