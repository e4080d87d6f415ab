//! Ctrl-C once: running trials save a checkpoint and the run stops; twice: at once. SIGTERM is as Ctrl-C.

use crate::{
    program::{Bench, trial_files},
    slurm::until,
};
use std::{
    path::PathBuf,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

/// A trial that learns for some seconds.
const STUDY: &str = "
study: long
environments: { cells: { battery: { cells: 2 } } }
agents: { dsac: { dirichlet_sac: { width: 128, learning_starts: 64 } } }
protocol: { train_evaluate: { steps: 64000, environments: 8, evaluate_every: 1000, episodes: 1, \
final_episodes: 2 } }
";

fn send(signal: &str, child: &Child) {
    assert!(
        Command::new("kill")
            .args([signal, &child.id().to_string()])
            .status()
            .unwrap()
            .success()
    );
}

/// The folder in which a running trial keeps its state.
fn running(bench: &Bench) -> Option<PathBuf> {
    let entries = |folder: PathBuf| {
        std::fs::read_dir(folder)
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.path())
    };
    let trials = entries(bench.path("store/trials")).flat_map(entries);
    trials
        .map(|trial| trial.join("running"))
        .find(|folder| folder.exists())
}

fn start(mut command: Command) -> Child {
    command
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

#[test]
fn one_signal_saves_a_checkpoint_and_the_next_run_ends_the_same() {
    let bench = Bench::new();
    bench.write("long.yaml", STUDY);
    bench.ok(&["worker", "long.yaml", "--store", "whole"]);
    for signal in ["-INT", "-TERM", "-USR1"] {
        let mut child = start(bench.command(&["run", "long.yaml", "-j", "1"]));
        // Rows reach the log after a second, so that the trial is in the middle of its training then.
        until("the trial has begun", || running(&bench).is_some());
        let line = format!("running  cells dsac seed 0: process {} on ", child.id());
        until("status says who computes it", || {
            bench.run(&["status", "long.yaml"]).out.contains(&line)
        });
        send(signal, &child);
        assert_eq!(child.wait().unwrap().code(), Some(106), "{signal}");
        let kept: Vec<_> = std::fs::read_dir(running(&bench).unwrap())
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        assert!(
            kept.iter()
                .any(|name| name.to_string_lossy().starts_with("checkpoint-")),
            "{signal}: {kept:?}"
        );
        let status = bench.run(&["status", "long.yaml"]).out;
        let line = "begun    cells dsac seed 0: goes on from a checkpoint, logged up to step ";
        assert!(status.contains(line), "{signal}: {status}");
    }
    bench.ok(&["run", "long.yaml", "-j", "1"]);
    assert_eq!(bench.digests("store"), bench.digests("whole"));
    assert_eq!(running(&bench), None, "nothing is kept of a trial that has ended");
}

#[test]
fn a_second_signal_ends_at_once_what_does_not_come_to_a_checkpoint() {
    let bench = Bench::new();
    let study = STUDY.replace(
        "dirichlet_sac: { width: 128, learning_starts: 64 }",
        "misbehaving: { how: loop }",
    );
    bench.write("long.yaml", &study);
    let mut child = start(bench.misused(&["run", "long.yaml", "-j", "1"]));
    until("the trial has begun", || bench.path("store/trials").exists());
    std::thread::sleep(Duration::from_millis(500));
    send("-INT", &child);
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(child.try_wait().unwrap(), None, "the trial has not stopped yet");
    let asked = Instant::now();
    send("-INT", &child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(asked.elapsed() < Duration::from_secs(5));
}

/// A search whose generations are one trial each, which learns nothing.
const SEARCH: &str = "
study: tuned
environments: { cells: { battery: { cells: 2 } } }
agents: { dsac: { dirichlet_sac: { width: 8 } } }
protocol: { train_evaluate: { steps: 0, final_episodes: 1, trace_episodes: 0 } }
tune:
  rates:
    over: { dsac.actor_learning_rate: { log_uniform: { low: 0.0001, high: 0.1 } } }
    metric: cycle_length
    settings: 1000
    method: { tree_parzen: { startup: 4, batch: 1 } }
";

#[test]
fn one_signal_stops_a_search_between_two_generations() {
    let bench = Bench::new();
    bench.write("tuned.yaml", SEARCH);
    let has_begun = || bench.path("store/trials").exists();
    let ended = || {
        if has_begun() {
            trial_files(&bench.path("store")).len()
        } else {
            0
        }
    };
    for _ in 0..3 {
        let before = ended();
        let mut child = start(bench.command(&["run", "tuned.yaml", "-j", "1"]));
        until("some generations are over", || ended() > before + 8);
        send("-INT", &child);
        assert_eq!(child.wait().unwrap().code(), Some(106));
    }
    assert!(ended() < 1000);
}
