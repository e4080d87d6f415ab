//! What is wrong in a store is found, set aside, and runs again.

use crate::program::{Bench, trial_files};
use engine::store::{Fault, Store};
use rand::Rng as _;
use std::{
    fs,
    path::{Path, PathBuf},
};

const STUDY: &str = "
study: small
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 8, batch_size: 8, learning_starts: 16 } }
protocol: { train_evaluate: { steps: 64, environments: 8, evaluate_every: 32, episodes: 1, final_episodes: 2 } }
seeds: 4
";

fn finished() -> Bench {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["worker", "small.yaml", "--store", "store"]);
    bench
}

/// Every file below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { found.extend(files(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

#[test]
fn a_whole_store_is_called_whole() {
    let bench = finished();
    let text = bench.ok(&["fsck", "store"]);
    assert_eq!(text.trim(), "8 trials are whole, 0 are being computed, 0 files are wrong");
}

#[test]
fn a_bit_flipped_anywhere_is_found_and_its_trial_is_missing() {
    let bench = finished();
    let store = Store::at(bench.path("store"));
    let mut rng = engine::random::stream(&["flip bits"]);
    let files = files(&bench.path("store/trials"));
    assert_eq!(files.len(), 20, "eight trials with two files each, and four policies");
    for round in 0..300 {
        let file = &files[rng.random_range(0..files.len())];
        let whole = fs::read(file).unwrap();
        let (byte, bit) = (rng.random_range(0..whole.len()), rng.random_range(0..8u8));
        let mut flipped = whole.clone();
        flipped[byte] ^= 1 << bit;
        fs::write(file, flipped).unwrap();
        let found = store.check(false).unwrap();
        let id = file.parent().unwrap().file_name().unwrap().to_str().unwrap();
        let noticed = found.findings.iter().any(|one| one.fault == Fault::Damaged && one.trial.as_deref() == Some(id));
        assert!(noticed, "round {round}: bit {bit} of byte {byte} in {}: {found:?}", file.display());
        assert_eq!(found.whole, 7, "only its trial is affected");
        fs::write(file, whole).unwrap();
    }
    assert_eq!(store.check(false).unwrap().findings, []);
}

#[test]
fn what_is_damaged_cut_off_orphaned_or_foreign_is_set_aside_and_runs_again() {
    let bench = finished();
    let whole = bench.digests("store");
    let trials: Vec<PathBuf> = trial_files(&bench.path("store"));
    let folder = |index: usize| trials[index].parent().unwrap();
    let metrics = folder(0).join("metrics.parquet");
    let length = fs::metadata(&metrics).unwrap().len();
    fs::OpenOptions::new().write(true).open(&metrics).unwrap().set_len(length / 2).unwrap();
    fs::remove_file(folder(1).join("trial.json")).unwrap();
    fs::remove_file(folder(2).join("metrics.parquet")).unwrap();
    fs::copy(folder(4).join("trial.json"), folder(3).join("trial.json")).unwrap();
    fs::write(folder(5).join("notes.txt"), "not ours").unwrap();
    fs::write(bench.path("store/trials/readme"), "not ours").unwrap();
    let said = bench.run(&["fsck", "store", "--dry-run"]);
    assert_eq!(said.code, 106, "{}", said.out);
    assert!(metrics.exists(), "a dry run moves nothing");
    let mended = bench.run(&["fsck", "store"]);
    assert_eq!(mended.code, 106);
    for fault in ["damaged   trials/", "orphaned  trials/", "foreign   trials/readme", "notes.txt: a trial has no such file"] {
        assert!(mended.out.contains(fault), "{fault}: {}", mended.out);
    }
    assert!(mended.out.contains("3 trials have to run again"), "{}", mended.out);
    assert!(bench.path("store/aside/1/trials/readme").exists());
    let plan: serde_json::Value = serde_json::from_str(&bench.ok(&["plan", "small.yaml", "--format", "json"])).unwrap();
    let missing = |cell: usize| plan["cells"][cell]["missing"].as_u64().unwrap();
    assert_eq!(missing(0) + missing(1), 4, "damaged, unacknowledged, without metrics, of another trial");
    bench.ok(&["worker", "small.yaml"]);
    assert_eq!(bench.digests("store"), whole);
    bench.ok(&["fsck", "store"]);
}

#[test]
fn a_store_that_is_not_there_is_said() {
    let answer = Bench::new().run(&["fsck", "nowhere"]);
    assert_eq!(answer.code, 2);
    assert!(answer.err.contains("no store at `nowhere`"), "{}", answer.err);
}
