//! Running, stopping and going on.

use crate::program::{Bench, trial_files};
use std::{
    process::{Child, Stdio},
    time::{Duration, Instant},
};

const STUDY: &str = "
study: small
title: A small study
source: made for this test
environments:
  cells: { battery: { cells: 2 } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64 } }
protocol: { train_evaluate: { steps: 256, environments: 8, evaluate_every: 128, episodes: 2, final_episodes: 6 } }
seeds: 3
tables:
  improvement: { improvement: { rows: agent, value: cycle_length, relative_to: equal } }
claims:
  - dsac.cycle_length > 0
";

#[test]
fn results_do_not_depend_on_the_number_of_workers_and_a_second_run_does_nothing() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml", "-j", "1", "--store", "one"]);
    bench.ok(&["run", "small.yaml", "-j", "2", "--store", "two"]);
    assert_eq!(bench.digests("one").len(), 6);
    assert_eq!(bench.digests("one"), bench.digests("two"));
    let again = bench.run(&["run", "small.yaml", "--store", "one"]);
    assert!(again.err.contains("nothing runs"), "{}", again.err);
}

#[test]
fn more_seeds_run_only_what_is_missing() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml", "--seeds", "1"]);
    let before = bench.digests("store");
    let plan = bench.ok(&["plan", "small.yaml", "--format", "json"]);
    let plan: serde_json::Value = serde_json::from_str(&plan).unwrap();
    assert_eq!(plan["cells"][0]["ok"], 1);
    assert_eq!(plan["cells"][0]["missing"], 2);
    bench.ok(&["run", "small.yaml"]);
    let after = bench.digests("store");
    assert_eq!(after.len(), 6);
    assert!(before.iter().all(|digest| after.contains(digest)));
}

#[test]
fn shards_of_a_study_together_equal_the_whole() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml", "--store", "whole"]);
    bench.ok(&["worker", "small.yaml", "--index", "0/2", "--store", "parts"]);
    assert_eq!(bench.run(&["status", "small.yaml", "--store", "parts"]).code, 106);
    bench.ok(&["worker", "small.yaml", "--index", "1/2", "--store", "parts"]);
    assert_eq!(bench.digests("whole"), bench.digests("parts"));
}

#[test]
fn a_trial_that_fails_is_a_row_and_leaves_the_rest_alone() {
    let bench = Bench::new();
    // An entropy out of reach drives the temperature up by a factor of e with every update, until it overflows.
    let diverging = "learning_starts: 64, updates_per_step: 1, temperature_learning_rate: 1, target_entropy: { nats: 1000 } }";
    let broken = STUDY.replace("learning_starts: 64 }", diverging).replace("seeds: 3", "seeds: 1");
    bench.write("small.yaml", &broken);
    let answer = bench.run(&["run", "small.yaml"]);
    let page = std::fs::read_to_string(bench.path("results/small/report.md")).unwrap();
    assert_eq!(answer.code, 100, "{}\n{}", answer.out, answer.err);
    assert!(page.contains("nan"), "{page}");
    assert!(page.contains("is not finite"), "{page}");
    let states: Vec<String> = trial_files(&bench.path("store"))
        .iter()
        .map(|file| serde_json::from_str::<serde_json::Value>(&std::fs::read_to_string(file).unwrap()).unwrap())
        .map(|trial| trial["end"]["state"].as_str().unwrap().to_owned())
        .collect();
    assert!(states.contains(&"ok".to_owned()) && states.contains(&"nan".to_owned()), "{states:?}");
}

#[test]
fn a_worker_killed_from_outside_costs_one_trial_which_the_next_run_repeats() {
    let bench = Bench::new();
    bench.write("small.yaml", &STUDY.replace("steps: 256", "steps: 4096"));
    bench.ok(&["run", "small.yaml", "-j", "2", "--store", "whole"]);
    let mut child = bench
        .command(&["run", "small.yaml", "-j", "1", "--store", "hurt", "--retries", "0"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let worker = worker_of(&child);
    assert!(std::process::Command::new("kill").args(["-9", &worker.to_string()]).status().unwrap().success());
    let left = child.wait().unwrap().code();
    assert_eq!(left, Some(106), "the killed trial is missing");
    assert_eq!(bench.digests("hurt").len(), 6, "the other trials ran");
    bench.ok(&["run", "small.yaml", "--store", "hurt"]);
    assert_eq!(bench.digests("hurt"), bench.digests("whole"));
}

#[test]
fn the_whole_run_killed_goes_on_where_it_was() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml", "--store", "whole"]);
    let mut child = bench
        .command(&["run", "small.yaml", "-j", "1", "--store", "hurt"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let worker = worker_of(&child);
    child.kill().unwrap();
    child.wait().unwrap();
    let _ = std::process::Command::new("kill").args(["-9", &worker.to_string()]).status();
    bench.ok(&["run", "small.yaml", "--store", "hurt"]);
    assert_eq!(bench.digests("hurt"), bench.digests("whole"));
}

/// The process id of the first worker that a run has started.
fn worker_of(run: &Child) -> u32 {
    let children = format!("/proc/{0}/task/{0}/children", run.id());
    let patience = Instant::now() + Duration::from_secs(20);
    while Instant::now() < patience {
        // The worker is a child of the run, but of one of its threads.
        let tasks = std::fs::read_dir(format!("/proc/{}/task", run.id())).into_iter().flatten().flatten();
        let lists = tasks.map(|task| std::fs::read_to_string(task.path().join("children")).unwrap_or_default());
        if let Some(id) = lists.collect::<String>().split_whitespace().next() {
            return id.parse().unwrap();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("no worker appeared in {children}");
}
