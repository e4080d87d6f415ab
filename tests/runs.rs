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
protocol: { train_evaluate: { steps: 256, environments: 8, evaluate_every: 128, episodes: 2, \
final_episodes: 6 } }
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
fn a_learner_that_cannot_learn_is_warned_of_and_runs() {
    let bench = Bench::new();
    bench.write(
        "small.yaml",
        &STUDY.replace("learning_starts: 64", "learning_starts: 5000"),
    );
    let warning =
        "warning: `dsac` makes no update: it learns from step 5000 on, and the protocol ends after 256 steps";
    for command in [
        &["check", "small.yaml"][..],
        &["plan", "small.yaml"],
        &["run", "small.yaml", "--seeds", "1"],
    ] {
        let answer = bench.run(command);
        assert_eq!(
            (answer.code, answer.err.matches(warning).count()),
            (0, 1),
            "{command:?}: {}",
            answer.err
        );
        assert!(answer.err.contains("small.yaml:9:3"), "{}", answer.err);
    }
    bench.write("wrong.yaml", &STUDY.replace("width: 16", "wide: 16"));
    let answer = bench.run(&["check", "small.yaml", "wrong.yaml", "--format", "json"]);
    let reports: serde_json::Value = serde_json::from_str(&answer.out).unwrap();
    let severity = |index: usize| &reports[index]["problems"][0]["severity"];
    assert_eq!(
        (severity(0), severity(1), answer.code),
        (&"warning".into(), &"error".into(), 2),
        "{reports}"
    );
    assert_eq!(bench.run(&["check", "small.yaml", "--format", "json"]).code, 0);
}

#[test]
fn a_data_file_that_changes_during_a_run_fails_its_trials_until_it_is_restored() {
    let bench = Bench::new();
    let study = "study: loads\nenvironments: { cells: { battery: { cells: 2, load: { file: load.csv } } } }\n\
                 agents: { equal: { equal_split: {} } }\nprotocol: { train_evaluate: { steps: 0, \
                 final_episodes: 200 } }\nseeds: 20\n";
    bench.write("loads.yaml", study);
    bench.write("load.csv", "t_s,power_w\n0,16\n");
    bench.ok(&["run", "loads.yaml", "-j", "1", "--store", "whole"]);
    let run = bench
        .command(&["run", "loads.yaml", "-j", "1"])
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let stored = || bench.path("store/trials").exists() && !trial_files(&bench.path("store")).is_empty();
    crate::slurm::until("a trial is stored", stored);
    bench.write("load.csv", "t_s,power_w\n0,24\n");
    let answer = run.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&answer.stderr).into_owned();
    assert_eq!(answer.status.code(), Some(100), "{text}");
    let whole = bench.digests("whole");
    let ended = bench.digests("store");
    let (failed, kept): (Vec<_>, Vec<_>) = ended.iter().partition(|(_, digest)| digest.is_empty());
    assert!(!failed.is_empty() && !kept.is_empty(), "{text}");
    assert!(
        kept.iter().all(|digest| whole.contains(digest)),
        "a wrong number was stored under an old id"
    );
    bench.write("load.csv", "t_s,power_w\n0,16\n");
    let status = bench.run(&["status", "loads.yaml"]);
    assert!(
        status
            .out
            .contains("load.csv` does not hold what this trial's id names; restore it"),
        "{}",
        status.out
    );
    bench.ok(&["run", "loads.yaml", "-j", "1", "--retry-failed"]);
    assert_eq!(bench.digests("store"), whole);
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
    // An entropy out of reach drives the temperature up by a factor of e with every update, until it
    // overflows.
    let diverging = "learning_starts: 64, updates_per_step: 1, temperature_learning_rate: 1, \
                     target_entropy: { nats: 1000 } }";
    let broken = STUDY
        .replace("learning_starts: 64 }", diverging)
        .replace("seeds: 3", "seeds: 1");
    bench.write("small.yaml", &broken);
    let answer = bench.run(&["run", "small.yaml"]);
    let page = std::fs::read_to_string(bench.path("results/small/report.md")).unwrap();
    assert_eq!(answer.code, 100, "{}\n{}", answer.out, answer.err);
    assert!(page.contains("nan"), "{page}");
    assert!(page.contains("is not finite"), "{page}");
    let states: Vec<String> = trial_files(&bench.path("store"))
        .iter()
        .map(|file| {
            serde_json::from_str::<serde_json::Value>(&std::fs::read_to_string(file).unwrap()).unwrap()
        })
        .map(|trial| trial["end"]["state"].as_str().unwrap().to_owned())
        .collect();
    assert!(
        states.contains(&"ok".to_owned()) && states.contains(&"nan".to_owned()),
        "{states:?}"
    );
}

#[test]
fn a_worker_killed_from_outside_costs_one_trial_which_the_next_run_repeats() {
    let bench = Bench::new();
    bench.write("small.yaml", &STUDY.replace("steps: 256", "steps: 4096"));
    bench.ok(&["run", "small.yaml", "-j", "2", "--store", "whole"]);
    let mut child = bench
        .command(&[
            "run",
            "small.yaml",
            "-j",
            "1",
            "--store",
            "hurt",
            "--retries",
            "0",
        ])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let worker = worker_of(&child);
    assert!(
        std::process::Command::new("kill")
            .args(["-9", &worker.to_string()])
            .status()
            .unwrap()
            .success()
    );
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
    let _ = std::process::Command::new("kill")
        .args(["-9", &worker.to_string()])
        .status();
    bench.ok(&["run", "small.yaml", "--store", "hurt"]);
    assert_eq!(bench.digests("hurt"), bench.digests("whole"));
}

/// The process id of the first worker that a run has started.
fn worker_of(run: &Child) -> u32 {
    let children = format!("/proc/{0}/task/{0}/children", run.id());
    let patience = Instant::now() + Duration::from_secs(20);
    while Instant::now() < patience {
        // The worker is a child of the run, but of one of its threads.
        let tasks = std::fs::read_dir(format!("/proc/{}/task", run.id()))
            .into_iter()
            .flatten()
            .flatten();
        let lists =
            tasks.map(|task| std::fs::read_to_string(task.path().join("children")).unwrap_or_default());
        if let Some(id) = lists.collect::<String>().split_whitespace().next() {
            return id.parse().unwrap();
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("no worker appeared in {children}");
}
