//! Programs as trials: what is read of them, what determines their numbers, how they end, and what happens to
//! those that are stopped or killed. The programs here need `sh`, `awk` and `kill` alone.

mod coming_from;
mod consent;
mod ends;
mod identity;
mod measured;
mod new_from;
mod reading;
mod rehearsing;
mod resuming;
mod sharing;
mod trial;
mod unheard;

use crate::{
    book::blocks,
    program::{Answer, Bench, trial_files},
    slurm::until,
};
use serde_json::Value;
use std::{fs, path::PathBuf};

/// A learner whose return grows with its rate, and has noise of its seed: lines of JSON on standard output.
pub(crate) const WALKER: &str = r#"#!/bin/sh
# train.sh RATE SEED STEPS
awk -v rate="$1" -v seed="$2" -v steps="$3" 'BEGIN {
  for (step = 100; step <= steps; step += 100) {
    noise = (seed * 7919 + step * 31) % 100 / 1000
    printf "{\"global_step\": %d, \"charts\": {\"return\": %.6f}}\n", step, rate * (step / steps + noise)
  }
}'
"#;

/// A study of one program, whose words, metrics and further keys are given.
pub(crate) fn study_of(run: &str, metrics: &str, more: &str) -> String {
    format!(
        "study: one\nenvironments:\n  task: {{ named: {{ id: Walk-v0 }} }}\nagents:\n  mine:\n    program:\n      run: {run}\n      \
         sources: [\"*.sh\"]\n      lock: none\n      metrics: {metrics}\n{more}\nprotocol: {{ train_evaluate: {{ steps: 1000, \
         evaluate_every: 200 }} }}\nseeds: 1\n"
    )
}

/// A folder with a program `a.sh` and a study of it.
struct Place {
    bench: Bench,
}

impl Place {
    fn new(program: &str, metrics: &str, more: &str) -> Self {
        let bench = Bench::new();
        bench.write("a.sh", program);
        bench.write(
            "study.yaml",
            &study_of("[sh, a.sh, \"{seed}\", \"{steps}\"]", metrics, more),
        );
        Self { bench }
    }

    /// Writes other text into the study.
    fn edit(&self, from: &str, to: &str) {
        let study = fs::read_to_string(self.bench.path("study.yaml")).unwrap();
        assert!(study.contains(from), "{from} is not in\n{study}");
        self.bench.write("study.yaml", &study.replace(from, to));
    }

    fn run(&self, options: &[&str]) -> Answer {
        self.bench
            .run(&[&["run", "study.yaml", "-j", "1", "--yes"], options].concat())
    }

    /// The record of the only trial, as lines of tidy tables with the names above.
    fn rows(&self) -> Vec<String> {
        self.bench
            .ok(&["export", "study.yaml", "--to", "taken", "--as", "csv"]);
        let read = |name: &str| fs::read_to_string(self.bench.path(&format!("taken/{name}.csv"))).unwrap();
        let rows = [read("evaluations"), read("training")].concat();
        fs::remove_dir_all(self.bench.path("taken")).unwrap();
        rows.lines().map(str::to_owned).collect()
    }

    /// The text of the acknowledgement of the only trial.
    fn trial(&self) -> Value {
        let files = trial_files(&self.bench.path("store"));
        let [file] = &files[..] else { panic!("{files:?}") };
        serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap()
    }

    /// Processes that work for a trial in this folder.
    fn processes(&self) -> Vec<u32> {
        let folder = fs::canonicalize(self.bench.path("")).unwrap();
        let mut found = Vec::new();
        for entry in fs::read_dir("/proc").unwrap().flatten() {
            let pid = entry.file_name().to_string_lossy().parse::<u32>();
            let cwd = fs::read_link(entry.path().join("cwd"));
            if let (Ok(pid), Ok(cwd)) = (pid, cwd)
                && cwd.starts_with(&folder)
                && cwd.to_string_lossy().contains("/running/work")
            {
                found.push(pid);
            }
        }
        found
    }

    /// The working folder of the only trial.
    fn work(&self) -> PathBuf {
        let mut groups = fs::read_dir(self.bench.path("store/trials")).unwrap().flatten();
        let group = groups.next().unwrap().path();
        let trial = fs::read_dir(group).unwrap().flatten().next().unwrap().path();
        trial.join("running/work")
    }
}
