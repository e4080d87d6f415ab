//! A stop by the user is no failure of a trial, and what a trial reads is what its id says.

use super::*;
use std::{os::unix::process::CommandExt as _, time::Duration};

fn lease_is_taken(place: &Place, store: &str) -> bool {
    let entries = |folder: PathBuf| {
        fs::read_dir(folder)
            .into_iter()
            .flatten()
            .flatten()
            .map(|it| it.path())
    };
    entries(place.bench.path(store).join("trials"))
        .flat_map(entries)
        .any(|trial| trial.join("lease").exists())
}

/// How the trials of a store ended.
fn states(place: &Place, store: &str) -> Vec<String> {
    let state = |file: PathBuf| {
        let trial: Value = serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
        trial["end"]["state"].as_str().unwrap().to_owned()
    };
    crate::program::trial_files(&place.bench.path(store))
        .into_iter()
        .map(state)
        .collect()
}

/// A study of four trials of a second.
fn four(place: &Place, make: &str, arguments: &str) {
    let study = place.study(
        make,
        arguments,
        LEARNER,
        "train_evaluate: { steps: 300, environments: 2, evaluate_every: 100, episodes: 2, final_episodes: 3 }",
    );
    let text = fs::read_to_string(&study).unwrap();
    fs::write(&study, text + "seeds: 4\n").unwrap();
}

#[test]
fn a_signal_to_all_processes_while_python_starts_is_no_failure() {
    let Some(place) = Place::new() else { return };
    four(&place, "own.py:Slow", "");
    for (signal, wait_ms) in ["INT", "TERM"]
        .into_iter()
        .flat_map(|it| [0, 20, 40, 80, 160, 250].map(|ms| (it, ms)))
    {
        let store = format!("{signal}-{wait_ms}");
        let mut run = place
            .bench
            .command(&["run", "study.yaml", "-j", "2", "--store", &store]);
        let run = run.stdout(Stdio::null()).stderr(Stdio::null()).process_group(0);
        let mut child = run.spawn().unwrap();
        until("a trial begins", || lease_is_taken(&place, &store));
        std::thread::sleep(Duration::from_millis(wait_ms));
        // As a batch system stops a job: every process of it, not the one that was started alone.
        let ids = std::iter::once(child.id()).chain(processes_of(&place));
        let ids: Vec<String> = ids.map(|id| id.to_string()).collect();
        Command::new("kill")
            .arg("-s")
            .arg(signal)
            .args(&ids)
            .stderr(Stdio::null())
            .status()
            .unwrap();
        child.wait().unwrap();
        let found = states(&place, &store);
        assert!(
            found.iter().all(|state| state == "ok"),
            "{signal} after {wait_ms} ms: {found:?}"
        );
    }
    until("Python is gone", || processes_of(&place).is_empty());
}

#[test]
fn a_file_among_the_arguments_that_changes_in_mid_trial_changes_nothing() {
    let Some(place) = Place::new() else { return };
    place.bench.write("load.txt", "30");
    four(&place, "own.py:Load", "profile: { file: load.txt }");
    place
        .bench
        .ok(&["run", "study.yaml", "-j", "2", "--store", "whole"]);
    let mut run = place
        .bench
        .command(&["run", "study.yaml", "-j", "2", "--store", "changed"]);
    let mut child = run.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    until("a trial begins", || lease_is_taken(&place, "changed"));
    std::thread::sleep(Duration::from_millis(700));
    place.bench.write("load.txt", "45");
    child.wait().unwrap();
    place.bench.write("load.txt", "30");
    let (whole, changed) = (place.bench.digests("whole"), place.bench.digests("changed"));
    let ended_well: Vec<_> = changed.iter().filter(|(_, digest)| !digest.is_empty()).collect();
    assert!(
        ended_well.iter().all(|it| whole.contains(it)),
        "{whole:?} {changed:?}"
    );
    assert!(
        !ended_well.is_empty(),
        "the trials that had begun went on with what they had"
    );
}
