//! A study has the same digests in every way to compute it, and each trial is computed once: by one worker and
//! by two, by two programs at once, in shards, and by a program that is killed and started again.

use crate::program::{Bench, repository};
use std::{
    fs::File,
    os::unix::process::CommandExt as _,
    path::Path,
    process::{Child, Command, Stdio},
    time::Duration,
};

/// After so many kills a study may finish.
const KILLS: u64 = 8;

/// Ways to compute a study at once by several commands, each with its store.
const WAYS: [(&str, &[&[&str]]); 4] = [
    ("one-worker", &[&["worker", "-j", "1"]]),
    ("two-workers", &[&["worker", "-j", "2"]]),
    (
        "two-programs",
        &[
            &["run", "-j", "1", "--out", "one"],
            &["run", "-j", "1", "--out", "two"],
        ],
    ),
    (
        "three-shards",
        &[
            &["worker", "-j", "1", "--index", "0/3"],
            &["worker", "-j", "1", "--index", "1/3"],
            &["worker", "-j", "1", "--index", "2/3"],
        ],
    ),
];

#[test]
fn every_way_to_compute_a_study_gives_the_same_digests() {
    let study = repository().join("experiments/first/quickstart.yaml");
    hold("regimen", &study);
}

/// Computes the smoke profile of a study by a program in every way.
pub(crate) fn hold(program: &str, study: &Path) {
    let bench = Bench::new();
    // Often enough that a killed trial has something to continue from.
    bench.write("regimen.toml", "checkpoint_every_s = 0.02\n");
    let of = Ways {
        bench: &bench,
        program,
        study: study.to_string_lossy().into_owned(),
    };
    let mut expected = None;
    for (store, commands) in WAYS {
        let children: Vec<Child> = commands.iter().map(|words| of.start(words, store)).collect();
        for mut child in children {
            assert!(child.wait().unwrap().success(), "{store}");
        }
        let digests = bench.digests(store);
        let expected = expected.get_or_insert_with(|| digests.clone());
        assert_eq!(&digests, expected, "{store}");
        assert_eq!(of.ended(store), digests.len(), "{store}: a trial ran again");
    }
    for kill in 1..=KILLS {
        let mut child = of.start(&["worker", "-j", "2"], "killed");
        std::thread::sleep(Duration::from_millis(kill * 60));
        let group = format!("-{}", child.id());
        let killed = Command::new("kill").args(["-KILL", "--", &group]).status();
        assert!(killed.is_ok() && child.wait().is_ok());
    }
    assert!(
        of.start(&["worker", "-j", "2"], "killed")
            .wait()
            .unwrap()
            .success()
    );
    assert_eq!(Some(bench.digests("killed")), expected);
}

/// A study in a folder, and the program that computes it.
struct Ways<'a> {
    bench: &'a Bench,
    program: &'a str,
    study: String,
}

impl Ways<'_> {
    /// Starts a command in a group of its own, with what it says in `STORE.log`.
    fn start(&self, words: &[&str], store: &str) -> Child {
        let words = [words, &[&self.study, "-P", "smoke", "--store", store]].concat();
        let mut command = match self.program {
            "regimen" => self.bench.command(&words),
            other => self.bench.built(other, &words),
        };
        let log = File::options()
            .create(true)
            .append(true)
            .open(self.log(store))
            .unwrap();
        command
            .process_group(0)
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .unwrap()
    }

    fn log(&self, store: &str) -> std::path::PathBuf {
        self.bench.path(&format!("{store}.log"))
    }

    /// How many trials the commands say that they have computed.
    fn ended(&self, store: &str) -> usize {
        let said = std::fs::read_to_string(self.log(store)).unwrap();
        let is_end = |line: &&str| line.starts_with('[') && !line.contains("by another program");
        said.lines().filter(is_end).count()
    }
}
