//! Learners on a device: the same bits as on cores, and a device that is lost or missing.
//!
//! The device of these tests is the processor, which runs the text of the kernels for a card.

use crate::{
    needs,
    program::{Bench, answer},
    slurm::until,
};
use std::{
    os::unix::process::CommandExt as _,
    process::{Command, Stdio},
    time::Duration,
};

const STUDY: &str = "\
study: small
environments: { two: { battery: { cells: 2, episode_limit: 12 } } }
agents:
  dsac: { dirichlet_sac: { width: 8, batch_size: 16, learning_starts: 32, replay_capacity: 512 } }
  ddpg: { ddpg: { width: 8, batch_size: 16, learning_starts: 32, replay_capacity: 512 } }
  equal: { equal_split: {} }
protocol: { train_evaluate: { steps: 96, environments: 4, evaluate_every: 48, episodes: 3, final_episodes: 6 } }
seeds: 3
tables:
  lives: { comparison: { rows: agent, value: cycle_length } }
";

fn on_cores() -> Vec<(String, String)> {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml"]);
    bench.digests("store")
}

#[test]
fn trials_on_a_device_have_the_digests_of_trials_on_cores() {
    if needs::program("c++").is_none() {
        return;
    }
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let ran = bench.run_misused(&["run", "small.yaml", "--device", "literal"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert!(
        ran.err.contains("worker processes and a literal processor;"),
        "{}",
        ran.err
    );
    assert_eq!(bench.digests("store"), on_cores());
    // The learners were there, not in the worker processes.
    let folders = std::fs::read_dir(bench.path(".")).unwrap();
    let folders = folders.map(|entry| entry.unwrap().path());
    let programs: Vec<_> = folders
        .filter(|path| path.to_string_lossy().contains("programs-"))
        .collect();
    assert_eq!(programs.len(), 1, "{programs:?}");
    let compiled = std::fs::read_dir(&programs[0]).unwrap().count();
    assert!(compiled >= 8, "{compiled} files of programs");
}

/// Trials that a device computes many of at once take longer each: their times tell nothing of cores.
#[test]
fn a_plan_says_how_long_missing_trials_take_on_cores_and_on_the_device() {
    if needs::program("c++").is_none() {
        return;
    }
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let ran = bench.run_misused(&["run", "small.yaml", "--seeds", "1", "--device", "literal"]);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    let plan = bench.ok(&["plan", "small.yaml"]);
    assert!(
        plan.contains("6 missing: no stored trial tells how long"),
        "{plan}"
    );
    assert!(plan.contains("with --device literal: about"), "{plan}");
    bench.ok(&["run", "small.yaml", "--seeds", "2"]);
    let plan = bench.ok(&["plan", "small.yaml"]);
    assert!(plan.contains("3 missing: about"), "{plan}");
    let json: serde_json::Value =
        serde_json::from_str(&bench.ok(&["plan", "small.yaml", "--format", "json"])).unwrap();
    let (cores, device) = (&json["estimate"], &json["estimate_on_devices"][0]);
    assert_eq!(
        (&device["device"], &device["missing"]),
        (&"literal".into(), &3.into())
    );
    assert_ne!(cores["worker_s"], device["worker_s"], "{json}");
}

#[test]
fn a_lost_device_loses_no_trial_and_cores_go_on_to_the_same_digests() {
    if needs::program("c++").is_none() {
        return;
    }
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.write(
        "regimen.toml",
        "device = \"short-lived\"\ncheckpoint_every_s = 0\n",
    );
    let lost = bench.run_misused(&["run", "small.yaml"]);
    assert_ne!(lost.code, 0, "{}\n{}", lost.out, lost.err);
    assert!(
        lost.err.contains("the card is lost: it fell off the bus"),
        "{}",
        lost.err
    );
    let ends = bench.digests("store").len();
    assert!(ends < 9, "{ends} trials have ended");
    let again = bench.run_misused(&["run", "small.yaml", "--device", "processor"]);
    assert_eq!(again.code, 0, "{}\n{}", again.out, again.err);
    assert_eq!(bench.digests("store"), on_cores());
}

/// Ctrl-C reaches every process of a terminal, that of the device among them.
#[test]
fn trials_save_what_the_device_holds_when_all_processes_are_interrupted() {
    if needs::program("c++").is_none() {
        return;
    }
    let bench = Bench::new();
    let study = STUDY
        .replace("steps: 96,", "steps: 9600,")
        .replace("evaluate_every: 48", "evaluate_every: 4800");
    bench.write("small.yaml", &study);
    let mut command = bench.misused(&["run", "small.yaml", "--device", "literal"]);
    let run = command
        .process_group(0)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let groups = || {
        std::fs::read_dir(bench.path("store/trials"))
            .into_iter()
            .flatten()
            .flatten()
    };
    until("trials have begun", || groups().count() > 3);
    // Learning has begun by now, and the first regular checkpoint is far off.
    std::thread::sleep(Duration::from_secs(2));
    let group = format!("-{}", run.id());
    assert!(
        Command::new("kill")
            .args(["-INT", "--", &group])
            .status()
            .unwrap()
            .success()
    );
    let stopped = answer(&run.wait_with_output().unwrap());
    assert_eq!(stopped.code, 106, "{}", stopped.err);
    assert!(!stopped.err.contains("cannot go on"), "{}", stopped.err);
    let checkpoints = groups().flat_map(|group| std::fs::read_dir(group.path()).unwrap());
    let checkpoints = checkpoints.filter(|trial| trial.as_ref().unwrap().path().join("running").exists());
    assert!(checkpoints.count() > 0, "{}", stopped.err);
    bench.ok(&["run", "small.yaml"]);
    let other = Bench::new();
    other.write("small.yaml", &study);
    other.ok(&["run", "small.yaml"]);
    assert_eq!(bench.digests("store"), other.digests("store"));
}

#[test]
fn a_machine_without_a_card_says_in_one_sentence_what_it_lacks() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let mut command = bench.command(&["run", "small.yaml", "--device", "cuda"]);
    // A card of the machine is hidden.
    let refused = answer(&command.env("CUDA_VISIBLE_DEVICES", "").output().unwrap());
    assert_eq!(refused.code, 2, "{}\n{}", refused.out, refused.err);
    let known = ["this machine has no driver of NVIDIA", "the driver finds no card"];
    assert!(
        known.iter().any(|words| refused.err.contains(words)),
        "{}",
        refused.err
    );
    let rest = "without `--device cuda` the trials run on cores, with the same bits";
    assert!(refused.err.contains(rest), "{}", refused.err);
    assert!(!bench.path("store/trials").exists(), "nothing has run");
    // A report of trials that are there needs no card.
    bench.ok(&["run", "small.yaml"]);
    let mut command = bench.command(&["run", "small.yaml", "--device", "cuda"]);
    let again = answer(&command.env("CUDA_VISIBLE_DEVICES", "").output().unwrap());
    assert_eq!(again.code, 0, "{}", again.err);
}

#[test]
fn a_device_of_this_machine_is_refused_where_others_compute() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let answer = bench.run(&["run", "small.yaml", "--executor", "slurm", "--device", "cuda"]);
    assert_eq!(answer.code, 2, "{}", answer.err);
    assert!(
        answer
            .err
            .contains("write `device = \"cuda\"` in the regimen.toml that they read"),
        "{}",
        answer.err
    );
}

#[test]
fn an_unknown_device_is_refused_with_those_that_are_known() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let answer = bench.run(&["run", "small.yaml", "--device", "gpu"]);
    assert_ne!(answer.code, 0);
    assert!(
        answer
            .err
            .contains("there is no device `gpu`; known: processor, cuda"),
        "{}",
        answer.err
    );
}
