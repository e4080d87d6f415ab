//! Damage in a store is found, set aside, and the trials run again.

use crate::program::{Bench, reseal, trial_files};
use execution::store::{Fault, Store};
use rand::Rng as _;
use std::{
    fs,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
};

const STUDY: &str = "
study: small
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 8, batch_size: 8, learning_starts: 16 } }
protocol: { train_evaluate: { steps: 64, environments: 8, evaluate_every: 32, episodes: 1, final_episodes: \
2 } }
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
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(path);
        }
    }
    found.sort();
    found
}

#[test]
fn a_whole_store_is_called_whole() {
    let bench = finished();
    let text = bench.ok(&["fsck", "store"]);
    assert_eq!(
        text.trim(),
        "8 trials are whole, 0 are being computed, 0 files are wrong"
    );
}

#[test]
fn a_bit_flipped_anywhere_is_found_and_its_trial_is_missing() {
    let bench = finished();
    let store = Store::at(bench.path("store"));
    let mut rng = contract::random::stream(&["flip bits"]);
    let files = files(&bench.path("store/trials"));
    assert_eq!(
        files.len(),
        24,
        "eight trials with two files each, and four policies with their networks"
    );
    for round in 0..300 {
        let file = &files[rng.random_range(0..files.len())];
        let whole = fs::read(file).unwrap();
        let (byte, bit) = (rng.random_range(0..whole.len()), rng.random_range(0..8u8));
        let mut flipped = whole.clone();
        flipped[byte] ^= 1 << bit;
        fs::write(file, flipped).unwrap();
        let found = store.check(false, Vec::new()).unwrap();
        let id = file.parent().unwrap().file_name().unwrap().to_str().unwrap();
        let noticed = found
            .findings
            .iter()
            .any(|one| one.fault == Fault::Damaged && one.trial.as_deref() == Some(id));
        assert!(
            noticed,
            "round {round}: bit {bit} of byte {byte} in {}: {found:?}",
            file.display()
        );
        assert_eq!(found.whole, 7, "only its trial is affected");
        fs::write(file, whole).unwrap();
    }
    assert_eq!(store.check(false, Vec::new()).unwrap().findings, []);
}

#[test]
fn what_is_damaged_cut_off_orphaned_or_foreign_is_set_aside_and_runs_again() {
    let bench = finished();
    let whole = bench.digests("store");
    let trials: Vec<PathBuf> = trial_files(&bench.path("store"));
    let folder = |index: usize| trials[index].parent().unwrap();
    let metrics = folder(0).join("metrics.parquet");
    let length = fs::metadata(&metrics).unwrap().len();
    fs::OpenOptions::new()
        .write(true)
        .open(&metrics)
        .unwrap()
        .set_len(length / 2)
        .unwrap();
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
    for fault in [
        "damaged   trials/",
        "orphaned  trials/",
        "foreign   trials/readme",
        "notes.txt: a trial has no such file",
    ] {
        assert!(mended.out.contains(fault), "{fault}: {}", mended.out);
    }
    assert!(
        mended.out.contains("3 trials have to run again"),
        "{}",
        mended.out
    );
    assert!(bench.path("store/aside/1/trials/readme").exists());
    let plan: serde_json::Value =
        serde_json::from_str(&bench.ok(&["plan", "small.yaml", "--format", "json"])).unwrap();
    let missing = |cell: usize| plan["cells"][cell]["missing"].as_u64().unwrap();
    assert_eq!(
        missing(0) + missing(1),
        4,
        "damaged, unacknowledged, without metrics, of another trial"
    );
    bench.ok(&["worker", "small.yaml"]);
    assert_eq!(bench.digests("store"), whole);
    bench.ok(&["fsck", "store"]);
}

#[test]
fn names_that_lead_out_of_a_trials_folder_are_not_believed() {
    let bench = finished();
    let outside = bench.write("outside.safetensors", "not the store's");
    let trials = trial_files(&bench.path("store"));
    let names = [
        "../../../../outside.safetensors",
        outside.to_str().unwrap(),
        "seat/../../../../../outside.safetensors",
    ];
    for (file, name) in trials.iter().zip(names) {
        let text = fs::read_to_string(file).unwrap();
        let (object, _) = text.split_once(",\"check\":").unwrap();
        let object = object.split(",\"files\":").next().unwrap();
        let named = format!("{object},\"files\":{{\"{name}\":\"{}\"}}", "0".repeat(32));
        fs::write(file, reseal(&named)).unwrap();
    }
    // Nobody believes them, not only `fsck`.
    let commands: [&[&str]; 3] = [
        &["report"],
        &["status"],
        &["export", "--to", "taken", "--as", "csv"],
    ];
    for command in commands {
        let told = bench.run(&[command, &["small.yaml"]].concat());
        let said = format!("{command:?}, {}: {}{}", told.code, told.out, told.err);
        assert!(told.code != 0 && said.contains("none of a trial's"), "{said}");
    }
    let found = bench.run(&["fsck", "store"]);
    assert_eq!(found.code, 106, "{}", found.out);
    assert!(
        found.out.contains("it names a file that is none of a trial's"),
        "{}",
        found.out
    );
    assert_eq!(fs::read_to_string(&outside).unwrap(), "not the store's");
    assert!(found.out.contains("3 trials have to run again"), "{}", found.out);
    bench.ok(&["worker", "small.yaml"]);
    assert!(
        bench
            .ok(&["fsck", "store"])
            .contains("8 trials are whole, 0 are being computed, 0 files are wrong")
    );
}

#[test]
fn links_are_reported_and_set_aside_and_never_followed() {
    let bench = finished();
    let whole = bench.digests("store");
    fs::create_dir(bench.path("outside")).unwrap();
    for name in ["a.txt", "policy.safetensors", "metrics.log"] {
        bench.write(&format!("outside/{name}"), "not the store's");
    }
    let trials = trial_files(&bench.path("store"));
    let folder = |index: usize| trials[index].parent().unwrap();
    let outside = bench.path("outside");
    symlink("..", folder(0).join("loop")).unwrap();
    symlink(&outside, folder(1).join("seat")).unwrap();
    symlink(&outside, folder(2).join("running")).unwrap();
    fs::rename(
        folder(3).join("metrics.parquet"),
        bench.path("outside/metrics.parquet"),
    )
    .unwrap();
    symlink(
        bench.path("outside/metrics.parquet"),
        folder(3).join("metrics.parquet"),
    )
    .unwrap();
    symlink(&outside, bench.path("store/trials/ff")).unwrap_or(());
    symlink("..", bench.path("store/loop")).unwrap();
    symlink("..", folder(4).parent().unwrap().join("0".repeat(32))).unwrap();
    let found = bench.run(&["fsck", "store"]);
    assert_eq!(found.code, 106, "{}\n{}", found.out, found.err);
    assert!(
        found.out.matches("it is a link, which is not followed").count() >= 5,
        "{}",
        found.out
    );
    assert!(found.out.contains("1 trial has to run again"), "{}", found.out);
    for name in ["a.txt", "policy.safetensors", "metrics.log", "metrics.parquet"] {
        assert!(
            bench.path(&format!("outside/{name}")).exists(),
            "{name} is not the store's to move"
        );
    }
    assert!(
        bench
            .path("store/aside/1/loop")
            .symlink_metadata()
            .unwrap()
            .is_symlink(),
        "the link itself is moved"
    );
    bench.ok(&["worker", "small.yaml"]);
    assert_eq!(bench.digests("store"), whole);
    assert!(
        bench
            .ok(&["fsck", "store"])
            .contains("8 trials are whole, 0 are being computed, 0 files are wrong")
    );
}

#[test]
fn a_store_whose_folders_are_links_is_left_alone() {
    for name in ["trials", "aside"] {
        let bench = finished();
        let (linked, real) = (bench.path(&format!("store/{name}")), bench.path("real"));
        fs::create_dir_all(&linked).unwrap();
        fs::rename(&linked, &real).unwrap();
        symlink(&real, &linked).unwrap();
        bench.write("store/foreign", "not ours");
        let found = bench.run(&["fsck", "store"]);
        assert_ne!(found.code, 0);
        assert!(
            found.err.contains("name the store that it leads into"),
            "{}",
            found.err
        );
        assert!(bench.path("store/foreign").exists());
    }
}

#[test]
fn a_store_that_is_not_there_is_said() {
    let answer = Bench::new().run(&["fsck", "nowhere"]);
    assert_eq!(answer.code, 2);
    assert!(answer.err.contains("no store at `nowhere`"), "{}", answer.err);
}

/// `fsck` sets nothing aside in a folder that is no store, by whichever name it is given.
#[test]
fn a_folder_that_is_no_store_is_left_as_it_is() {
    let bench = Bench::new();
    std::fs::create_dir_all(bench.path("work/.git")).unwrap();
    bench.write("work/notes.txt", "mine");
    for command in [
        &["fsck", "work"][..],
        &["pack", "work"],
        &["merge", "work", "--into", "store"],
    ] {
        let refused = bench.run(command);
        assert!(
            refused.code == 2 && refused.err.contains("`work` is no store: it has other files"),
            "{command:?}: {}",
            refused.err
        );
    }
    let mut names: Vec<_> = std::fs::read_dir(bench.path("work"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, [".git", "notes.txt"]);
}
