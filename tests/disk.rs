//! A disk that fills up ends with a clear error, and everything acknowledged stays.

use crate::{needs, program::Bench};
use std::process::Command;

const STUDY: &str = "
study: big
environments: { cells: { battery: { cells: 2 } } }
agents: { dsac: { dirichlet_sac: { width: 96, batch_size: 8, learning_starts: 16 } } }
protocol: { train_evaluate: { steps: 64, environments: 8, evaluate_every: 32, episodes: 1, final_episodes: \
4, trace_episodes: 4 } }
seeds: 60
";

/// A small file system of its own for the store, gone at the end; `None`, after a line, where none can be mounted.
struct SmallDisk<'a>(&'a Bench);

impl<'a> SmallDisk<'a> {
    fn mount(bench: &'a Bench) -> Option<Self> {
        let folder = bench.path("small");
        std::fs::create_dir(&folder).unwrap();
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", "size=3m", "none"]).arg(&folder);
        needs::right("mount a tmpfs", &mut mount).map(|()| Self(bench))
    }

    fn resize(&self, size: &str) {
        let option = format!("remount,size={size}");
        assert!(
            Command::new("mount")
                .args(["-o", &option])
                .arg(self.0.path("small"))
                .status()
                .unwrap()
                .success()
        );
    }
}

impl Drop for SmallDisk<'_> {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path("small")).status();
    }
}

#[test]
fn a_full_disk_is_said_and_loses_nothing() {
    let bench = Bench::new();
    let Some(disk) = SmallDisk::mount(&bench) else {
        return;
    };
    bench.write("big.yaml", STUDY);
    bench.ok(&["worker", "big.yaml", "-j", "2", "--store", "whole"]);
    let answer = bench.run(&["run", "big.yaml", "-j", "2", "--store", "small/store"]);
    assert_eq!(answer.code, 106, "{}", answer.err);
    assert!(
        answer.err.contains("No space left on device") && answer.err.contains("the store cannot be written"),
        "{}",
        answer.err
    );
    let (kept, whole) = (bench.digests("small/store"), bench.digests("whole"));
    assert!(!kept.is_empty() && kept.len() < 60, "{} trials fit", kept.len());
    assert!(
        kept.iter().all(|trial| whole.contains(trial)),
        "what was acknowledged is intact"
    );
    disk.resize("200m");
    bench.ok(&["fsck", "small/store"]);
    bench.ok(&["worker", "big.yaml", "-j", "2", "--store", "small/store"]);
    assert_eq!(bench.digests("small/store"), whole);
}

#[test]
fn results_that_do_not_fit_on_the_disk_are_said_in_words() {
    let bench = Bench::new();
    let Some(disk) = SmallDisk::mount(&bench) else {
        return;
    };
    let shown = "tables: { life: { comparison: { rows: environment, columns: agent, value: return } } }\n\
                 figures: { curve: { learning_curve: { metric: return } } }\n";
    let study = STUDY
        .replace("seeds: 60", "seeds: 2")
        .replace("width: 96", "width: 8");
    bench.write("big.yaml", &format!("{study}{shown}"));
    bench.ok(&["worker", "big.yaml"]);
    for size in ["8k", "40k", "80k", "120k", "160k"] {
        disk.resize(size);
        let told = bench.run(&["report", "big.yaml", "-o", "small/results"]);
        assert_ne!(told.code, 0, "{size}");
        assert!(
            told.err.contains("No space left on device"),
            "{size}: {}",
            told.err
        );
        assert!(
            !told.err.contains("IoError") && !told.err.contains("kind:"),
            "{size}: {}",
            told.err
        );
        let _ = std::fs::remove_dir_all(bench.path("small/results"));
    }
}

#[test]
fn what_cannot_be_said_is_no_success() {
    let bench = Bench::new();
    let full = std::fs::File::options().write(true).open("/dev/full");
    let Ok(full) = full else { return };
    let ended = bench.command(&["list"]).stdout(full).output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(106), "{said}");
    assert!(
        said.contains("standard output could not be written: No space left"),
        "{said}"
    );
    // A reader that has what it wanted is none.
    let mut child = bench
        .command(&["schema"])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    assert_eq!(child.wait().unwrap().code(), Some(0));
}
