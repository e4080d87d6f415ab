//! Bad ends are said and tried again, damaged files are set aside and computed again, both also where
//! a run is killed.

use crate::{
    program::{Bench, trial_files},
    slurm::until,
};
use serde_json::Value;
use std::{
    fs,
    os::unix::process::CommandExt,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// One misbehaving trial, and one that is well.
fn study(how: &str) -> String {
    format!(
        "
study: misbehaving
environments: {{ cells: {{ battery: {{ cells: 2 }} }} }}
agents:
  equal: {{ equal_split: {{}} }}
  odd: {{ misbehaving: {how} }}
protocol: {{ train_evaluate: {{ steps: 16, environments: 8, evaluate_every: 0, episodes: 0, final_episodes: \
1 }} }}
profiles: {{ smoke: {{ seeds: 1 }} }}
"
    )
}

/// The command in backquotes that retries, as its words.
fn shown(text: &str) -> Vec<String> {
    let command = text
        .split('`')
        .find(|part| part.starts_with("regimen run "))
        .unwrap_or_else(|| panic!("no command: {text}"));
    command
        .split(' ')
        .skip(1)
        .map(|word| word.trim_matches('\'').to_owned())
        .collect()
}

#[test]
fn what_ended_badly_is_counted_and_the_command_that_tries_it_again_does() {
    let bench = Bench::new();
    bench.write("study.yaml", &study("{ how: panic, once: mark }"));
    let options = [
        "study.yaml",
        "--profile",
        "smoke",
        "--set",
        "protocol.final_episodes=2",
    ];
    let first = bench.run_misused(&[&["run"][..], &options].concat());
    let words = "1 trial did not end ok (1 panicked): `regimen run study.yaml --profile smoke --set \
                 protocol.final_episodes=2 --retry-failed` runs it again";
    assert_eq!(first.code, 100);
    assert!(first.err.contains(words), "{}", first.err);
    let second = bench.run_misused(&[&["run"][..], &options].concat());
    assert_eq!(second.code, 100);
    assert!(
        second.err.contains("no trial is missing, so nothing runs") && second.err.contains(words),
        "{}",
        second.err
    );
    for verb in ["status", "plan"] {
        let told = bench.run_misused(&[&[verb][..], &options].concat());
        assert!(
            told.out.contains("nothing is missing, but 1 did not end ok"),
            "{}",
            told.out
        );
        assert!(told.out.contains(words), "{}", told.out);
    }
    let again = shown(&second.err);
    let again = bench.run_misused(&again.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(again.code, 0, "{}", again.err);
    assert!(
        bench
            .run_misused(&[&["run"][..], &options].concat())
            .err
            .contains("every trial is in the store already")
    );
}

#[test]
fn a_retry_that_is_killed_is_gone_on_with() {
    let bench = Bench::new();
    bench.write("study.yaml", &study("{ how: loop }"));
    let limited = ["run", "study.yaml", "--wall-time-s", "0.3"];
    assert_eq!(bench.run_misused(&limited).code, 100);
    let odd = trial_files(&bench.path("store")).into_iter().find(|file| {
        let trial: Value = serde_json::from_slice(&fs::read(file).unwrap()).unwrap();
        trial["end"]["state"] == "timeout"
    });
    let odd = odd.unwrap();
    let mut retry = bench.misused(&["run", "study.yaml", "--retry-failed", "--wall-time-s", "60"]);
    let mut retry = retry
        .process_group(0)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    until("the retry has begun", || {
        odd.with_file_name("lease").exists() && !odd.exists()
    });
    assert!(
        Command::new("kill")
            .args(["-KILL", "--", &format!("-{}", retry.id())])
            .status()
            .unwrap()
            .success()
    );
    retry.wait().unwrap();
    let status = bench.run_misused(&["status", "study.yaml"]);
    assert_eq!(status.code, 106, "{}", status.out);
    assert!(
        status
            .out
            .contains("cells odd seed 0: ended as timeout before and is tried again"),
        "{}",
        status.out
    );
    let found = bench.run_misused(&["fsck", "store"]);
    assert!(found.out.contains("1 trial is whole"), "{}", found.out);
    let plain = bench.run_misused(&limited);
    assert!(
        plain.err.contains("running 1 trial of 2") && plain.err.contains("timeout  cells odd"),
        "{}",
        plain.err
    );
    assert!(
        !bench
            .run_misused(&["status", "study.yaml"])
            .out
            .contains("tried again"),
        "it has ended anew"
    );
    assert!(
        bench
            .run_misused(&["fsck", "store"])
            .out
            .contains("2 trials are whole, 0 are being computed, 0 files are wrong")
    );
}

const STUDY: &str = "
study: small
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  random: { random_allocation: {} }
protocol: { train_evaluate: { steps: 0, final_episodes: 2 } }
seeds: 3
";

/// Flips a bit in the middle of a file, and answers what it was.
fn damage(file: &Path) -> Vec<u8> {
    let whole = fs::read(file).unwrap();
    let (mut bytes, middle) = (whole.clone(), whole.len() / 2);
    bytes[middle] ^= 1;
    fs::write(file, bytes).unwrap();
    whole
}

#[test]
fn a_run_sets_aside_what_is_damaged_and_computes_it_again() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml"]);
    let whole = bench.digests("store");
    let trials: Vec<PathBuf> = trial_files(&bench.path("store"));
    let metrics = trials[0].with_file_name("metrics.parquet");
    damage(&metrics);
    damage(&trials[1]);
    fs::remove_file(trials[2].with_file_name("metrics.parquet")).unwrap();
    for verb in ["status", "plan", "report"] {
        let told = bench.run(&[verb, "small.yaml"]);
        assert!(
            told.err.contains("is damaged") && told.err.contains("`regimen run small.yaml`"),
            "{verb}: {}",
            told.err
        );
    }
    let (damaged, aside) = (fs::read(&metrics).unwrap(), bench.path("store/aside/1"));
    let run = bench.run(&["run", "small.yaml"]);
    assert_eq!(run.code, 0, "{}\n{}", run.out, run.err);
    assert!(
        run.err
            .contains("set aside in `aside/1` of the store; 3 damaged trials run again"),
        "{}",
        run.err
    );
    assert!(
        run.err.contains("running 3 trials") && !run.err.contains("counts as missing"),
        "{}",
        run.err
    );
    assert_eq!(
        fs::read(aside.join(metrics.strip_prefix(bench.path("store")).unwrap())).unwrap(),
        damaged,
        "nothing is lost"
    );
    assert_eq!(bench.digests("store"), whole);
    assert!(
        bench
            .run(&["run", "small.yaml"])
            .err
            .contains("every trial is in the store already; nothing runs")
    );
    assert!(
        bench
            .ok(&["fsck", "store"])
            .contains("6 trials are whole, 0 are being computed, 0 files are wrong")
    );
}

#[test]
fn a_worker_loses_no_damaged_file_either() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["worker", "small.yaml"]);
    let (whole, trial) = (
        bench.digests("store"),
        trial_files(&bench.path("store")).remove(0),
    );
    damage(&trial);
    let damaged = fs::read(&trial).unwrap();
    bench.ok(&["worker", "small.yaml"]);
    assert_eq!(bench.digests("store"), whole);
    let aside = bench
        .path("store/aside/1")
        .join(trial.strip_prefix(bench.path("store")).unwrap());
    assert_eq!(fs::read(aside).unwrap(), damaged);
}

#[test]
fn a_trial_that_calls_itself_older_is_not_believed() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml"]);
    let (whole, file) = (
        bench.digests("store"),
        trial_files(&bench.path("store")).remove(0),
    );
    let text = fs::read_to_string(&file).unwrap();
    let changed = text
        .replace("\"schema\":2", "\"schema\":1")
        .replace("\"state\":\"ok\"", "\"state\":\"nan\"");
    assert_ne!(changed, text);
    fs::write(&file, changed).unwrap();
    let found = bench.run(&["fsck", "store", "--dry-run"]);
    assert_eq!(found.code, 106);
    assert!(
        found
            .out
            .contains("an earlier program made it, or it was changed"),
        "{}",
        found.out
    );
    bench.ok(&["run", "small.yaml"]);
    assert_eq!(bench.digests("store"), whole);
}
