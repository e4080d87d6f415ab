//! Stored trials are computed again: what was not changed is the same, what was changed is found out.

use crate::program::{Bench, forge, trial_files};
use contract::cast::Actors;
use execution::store::{Store, TrialFile};
use serde_json::Value;
use std::{fs, path::PathBuf};

/// One trial takes the networks of another one.
const STUDY: &str = "
study: small
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  sac: { dirichlet_sac: { width: 4, batch_size: 4, learning_starts: 8, updates_per_step: 0.5 } }
  tuned: { dirichlet_sac: { width: 4, batch_size: 4, learning_starts: 8, updates_per_step: 0.5, start: { \
from: sac } } }
protocol: { train_evaluate: { steps: 32, environments: 4, evaluate_every: 0, episodes: 0, final_episodes: 2 \
} }
seeds: 2
";

fn finished() -> Bench {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["worker", "small.yaml", "-j", "2"]);
    bench
}

/// The acknowledgement of a stored trial of an agent.
fn trial_of(bench: &Bench, has: impl Fn(&Value) -> bool) -> (PathBuf, String) {
    let read = |file: PathBuf| (fs::read_to_string(&file).unwrap(), file);
    let (text, file) = trial_files(&bench.path("store"))
        .into_iter()
        .map(read)
        .find(|(text, _)| has(&serde_json::from_str(text).unwrap()))
        .unwrap();
    (file, text)
}

#[test]
fn an_untouched_store_passes_and_is_left_as_it_is() {
    let bench = finished();
    let before = bench.digests("store");
    let receipt = bench.ok(&[
        "verify",
        "small.yaml",
        "-j",
        "2",
        "--format",
        "json",
        "--out",
        "receipt.json",
    ]);
    assert_eq!(fs::read_to_string(bench.path("receipt.json")).unwrap(), receipt);
    let receipt: Value = serde_json::from_str(&receipt).unwrap();
    let trials = receipt["trials"].as_array().unwrap();
    assert_eq!((trials.len(), receipt["eligible"].as_u64()), (6, Some(6)));
    for trial in trials {
        assert_eq!(trial["outcome"], "same", "{trial}");
        assert_eq!(trial["stored"]["digest"], trial["now"]["digest"]);
        assert!(trial["stored"]["digest"].as_str().unwrap().len() == 32);
        let artifacts = trial["now"]["files"].as_object().map_or(0, serde_json::Map::len);
        assert_eq!(
            artifacts,
            if trial["agent"] == "equal" { 0 } else { 2 },
            "{trial}"
        );
    }
    assert_eq!(bench.digests("store"), before);
    assert!(
        bench
            .ok(&["fsck", "store"])
            .contains("6 trials are whole, 0 are being computed, 0 files are wrong")
    );
    let whole = bench.ok(&["verify"]);
    assert!(whole.contains("6 the same, 0 different"), "{whole}");
}

#[test]
fn one_changed_and_resealed_file_is_found_out() {
    let bench = finished();
    let (file, _) = trial_of(&bench, |it| it["key"]["agent"]["plugin"] == "equal_split");
    forge(&file);
    assert!(
        bench.ok(&["fsck", "store"]).contains("6 trials are whole"),
        "nothing else can tell"
    );
    let id = file.parent().unwrap().file_name().unwrap().to_str().unwrap();
    let answer = bench.run(&["verify", "small.yaml"]);
    assert_eq!(answer.code, 101, "{}\n{}", answer.out, answer.err);
    assert!(
        answer.out.contains(&format!("DIFFERENT {id}  cells equal seed"))
            && answer.out.contains("metrics.parquet: stored ")
            && answer.out.contains("5 the same, 1 different"),
        "{}",
        answer.out
    );
}

#[test]
fn a_changed_source_is_found_out_and_what_takes_from_it_is_computed_from_what_is_stored() {
    let bench = finished();
    let is_source = |it: &Value| {
        it["key"]["agent"]["config"]["start"].is_null() && it["key"]["agent"]["plugin"] == "dirichlet_sac"
    };
    let (file, _) = trial_of(&bench, is_source);
    forge(&file);
    let answer = bench.run(&["verify", "small.yaml"]);
    assert_eq!(answer.code, 101);
    assert!(answer.out.contains("5 the same, 1 different"), "{}", answer.out);
}

#[test]
fn what_is_damaged_is_said_and_its_takers_are_not_computed() {
    let bench = finished();
    let is_source = |it: &Value| {
        it["key"]["agent"]["config"]["start"].is_null() && it["key"]["agent"]["plugin"] == "dirichlet_sac"
    };
    let (file, _) = trial_of(&bench, is_source);
    fs::write(file.with_file_name("networks.safetensors"), "x").unwrap();
    let answer = bench.run(&["verify", "small.yaml"]);
    assert_eq!(answer.code, 106, "{}", answer.out);
    assert!(
        answer
            .out
            .contains("4 the same, 0 different, 1 damaged, 1 not computed"),
        "{}",
        answer.out
    );
}

#[test]
fn a_sample_is_the_same_for_the_same_seed() {
    let bench = finished();
    let drawn = |seed: &str| {
        let text = bench.ok(&[
            "verify",
            "small.yaml",
            "--sample",
            "2",
            "--seed",
            seed,
            "--format",
            "json",
        ]);
        let receipt: Value = serde_json::from_str(&text).unwrap();
        let trials = receipt["trials"].as_array().unwrap().iter();
        trials
            .map(|trial| trial["trial"].as_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    let first = drawn("1");
    assert_eq!((first.len(), &first), (2, &drawn("1")));
    assert!(["2", "3", "4"].iter().any(|seed| drawn(seed) != first));
}

#[test]
fn a_trial_of_another_version_cannot_be_verified_and_is_named() {
    let bench = finished();
    let (file, text) = trial_of(&bench, |it| it["key"]["agent"]["plugin"] == "equal_split");
    let mut stored: TrialFile = serde_json::from_str(&text).unwrap();
    let Actors::Agent(agent) = std::sync::Arc::make_mut(&mut stored.key.agent) else {
        panic!("an agent acts")
    };
    let version = agent.version;
    agent.version += 1;
    stored.parts = Some(stored.key.part_ids());
    let (id, store) = (stored.key.id(), Store::at(bench.path("store")));
    fs::create_dir_all(store.folder(&id)).unwrap();
    fs::rename(
        file.with_file_name("metrics.parquet"),
        store.folder(&id).join("metrics.parquet"),
    )
    .unwrap();
    fs::write(store.folder(&id).join("trial.json"), stored.to_bytes().unwrap()).unwrap();
    fs::remove_dir_all(file.parent().unwrap()).unwrap();
    for arguments in [&["verify", "small.yaml"][..], &["verify"]] {
        let answer = bench.run(arguments);
        assert_eq!(answer.code, 106, "{}\n{}", answer.out, answer.err);
        let words = format!(
            "version {} of agent `equal_split` computed it, this program has version {version}",
            version + 1
        );
        assert!(
            answer.out.contains(&id) && answer.out.contains(&words) && answer.out.contains("5 the same"),
            "{}",
            answer.out
        );
    }
}
