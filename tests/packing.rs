//! Short trials in one file: every command reads them there, and nothing is lost on the way.

use crate::program::{Bench, trial_files};
use execution::store::Store;
use rand::Rng as _;
use std::{
    fs,
    path::{Path, PathBuf},
    process::Stdio,
    time::Duration,
};

/// Forty short trials and twenty that leave a policy.
const STUDY: &str = "
study: short
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  random: { random_allocation: {} }
  dsac: { dirichlet_sac: { width: 8, batch_size: 8, learning_starts: 16 } }
protocol: { train_evaluate: { steps: 64, environments: 8, evaluate_every: 32, episodes: 1, final_episodes: 2 } }
seeds: 20
tables: { lengths: { comparison: { rows: agent, value: cycle_length } } }
";

const PACK: [&str; 4] = ["pack", "store", "--settle-s", "0"];

fn finished() -> Bench {
    let bench = Bench::new();
    bench.write("short.yaml", STUDY);
    bench.ok(&["run", "short.yaml", "--store", "store", "-o", "results"]);
    bench
}

fn packs(bench: &Bench) -> Vec<PathBuf> {
    let there = fs::read_dir(bench.path("store/packs")).into_iter().flatten();
    let mut found: Vec<PathBuf> = there.map(|entry| entry.unwrap().path()).collect();
    found.sort();
    found
}

fn table(bench: &Bench, results: &str) -> String {
    fs::read_to_string(bench.path(results).join("tables/lengths.csv")).unwrap()
}

fn folders(store: &Path) -> usize {
    trial_files(store).len()
}

#[test]
fn packed_trials_count_as_before_and_only_those_that_leave_more_keep_folders() {
    let bench = finished();
    let before = table(&bench, "results");
    let said = bench.ok(&PACK);
    assert!(
        said.contains("40 trials lie in `packs/") && said.contains("20 trials keep"),
        "{said}"
    );
    assert_eq!((packs(&bench).len(), folders(&bench.path("store"))), (1, 20));
    let again = bench.ok(&["run", "short.yaml", "--store", "store", "-o", "again"]);
    assert_eq!(folders(&bench.path("store")), 20, "nothing ran again: {again}");
    assert_eq!(table(&bench, "again"), before);
    let fsck = bench.ok(&["fsck", "store"]);
    assert_eq!(
        fsck.trim(),
        "60 trials are whole, 0 are being computed, 0 files are wrong"
    );
    bench.ok(&[
        "export",
        "short.yaml",
        "--store",
        "store",
        "--to",
        "crate",
        "--as",
        "ro-crate",
        "--license",
        "MIT",
    ]);
    let crated = fs::read_dir(bench.path("crate/trials")).unwrap().count();
    assert_eq!(crated, 60, "a crate holds packed trials as others");
    bench.ok(&["merge", "store", "--into", "other"]);
    assert_eq!(folders(&bench.path("other")), 60);
    let said = bench.ok(&["pack", "store", "--settle-s", "0", "--format", "json"]);
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert_eq!(
        (&said["pack"], &said["kept"]),
        (&serde_json::Value::Null, &20.into())
    );
}

#[test]
fn killed_at_any_instant_packing_loses_nothing_and_ends_later() {
    let bench = finished();
    let whole = table(&bench, "results");
    let digests = bench.digests("store");
    let mut rng = contract::random::stream(&["kill packing"]);
    let mut kills = 0;
    while kills < 40 {
        let mut child = bench
            .command(&PACK)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_micros(rng.random_range(1_000..40_000)));
        kills += usize::from(child.try_wait().unwrap().is_none());
        let _ = child.kill();
        child.wait().unwrap();
        let store = Store::at(bench.path("store"));
        for (id, digest) in &digests {
            let end = store.end(id).unwrap().unwrap_or_else(|| panic!("{id} is gone"));
            assert_eq!(end.digest, *digest);
        }
        if packs(&bench).len() > 3 {
            // From the start: every trial in a folder of its own.
            fs::remove_dir_all(bench.path("other")).ok();
            bench.ok(&["merge", "store", "--into", "other"]);
            fs::remove_dir_all(bench.path("store")).unwrap();
            fs::rename(bench.path("other"), bench.path("store")).unwrap();
        }
    }
    bench.ok(&PACK);
    bench.ok(&["fsck", "store"]);
    assert_eq!(folders(&bench.path("store")), 20);
    bench.ok(&["report", "short.yaml", "--store", "store", "-o", "later"]);
    assert_eq!(table(&bench, "later"), whole);
}

#[test]
fn a_damaged_pack_costs_its_damaged_trial_which_runs_again() {
    let bench = finished();
    let before = table(&bench, "results");
    bench.ok(&PACK);
    let pack = packs(&bench).remove(0);
    let mut bytes = fs::read(&pack).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    fs::write(&pack, bytes).unwrap();
    let found = bench.run(&["fsck", "store"]);
    assert_eq!(found.code, 106, "{}", found.err);
    assert!(
        found.out.contains("59 trials are whole") && found.out.contains("1 trial has to run again"),
        "{}",
        found.out
    );
    bench.ok(&["run", "short.yaml", "--store", "store", "-o", "again"]);
    assert_eq!(table(&bench, "again"), before);
    assert_eq!(folders(&bench.path("store")), 21);
}

/// A thousand trials of one episode each.
const MANY: &str = "
study: many
environments: { cells: { battery: { cells: 2 } } }
agents: { equal: { equal_split: {} }, random: { random_allocation: {} } }
protocol: { train_evaluate: { steps: 0, final_episodes: 1, trace_episodes: 0 } }
seeds: 500
tables: { lengths: { comparison: { rows: agent, value: cycle_length } } }
";

/// A store with these trials, as workers leave it.
fn many() -> Bench {
    let bench = Bench::new();
    bench.write("many.yaml", MANY);
    bench.ok(&["worker", "many.yaml", "--store", "store", "-j", "2"]);
    bench
}

/// Files and folders of the store.
fn inodes(folder: &Path) -> usize {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    let each = entries.map(|entry| match entry.file_type().unwrap().is_dir() {
        true => 1 + inodes(&entry.path()),
        false => 1,
    });
    each.sum()
}

/// The answers of commands that read the store.
fn answers(bench: &Bench, to: &str) -> Vec<String> {
    let export = [
        "export",
        "many.yaml",
        "--store",
        "store",
        "--to",
        to,
        "--as",
        "csv",
    ];
    bench.ok(&export);
    bench.ok(&["report", "many.yaml", "--store", "store", "-o", "results"]);
    let mut exported: Vec<PathBuf> = fs::read_dir(bench.path(to))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "csv"))
        .collect();
    exported.sort();
    assert!(!exported.is_empty());
    exported.extend(["report.md", "tables/lengths.csv"].map(|name| bench.path("results").join(name)));
    let mut said: Vec<String> = exported
        .iter()
        .map(|path| fs::read_to_string(path).unwrap())
        .collect();
    for verb in ["status", "plan"] {
        said.push(bench.ok(&[verb, "many.yaml", "--store", "store"]));
    }
    said.push(bench.ok(&["fsck", "store"]));
    said.push(bench.ok(&["verify", "many.yaml", "--store", "store", "--sample", "3"]));
    said
}

#[test]
fn a_run_of_very_many_short_trials_leaves_few_files_and_every_answer_stays() {
    let bench = many();
    let before = answers(&bench, "before");
    assert!(inodes(&bench.path("store")) > 3000);
    let ran = bench.run(&["run", "many.yaml", "--store", "store", "-o", "results"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(
        ran.err.contains("1000 short trials lie in `store/packs` now"),
        "{}",
        ran.err
    );
    let left = inodes(&bench.path("store"));
    assert!(left < 300, "{left} files and folders");
    assert_eq!(answers(&bench, "after"), before);
    let again = bench.run(&["run", "many.yaml", "--store", "store", "-o", "results"]);
    assert!(
        again.code == 0 && !again.err.contains("short trials"),
        "{}",
        again.err
    );
}

#[test]
fn a_run_that_is_killed_while_it_packs_loses_nothing_and_the_next_one_ends_it() {
    let bench = many();
    let digests = bench.digests("store");
    let mut rng = contract::random::stream(&["kill a run that packs"]);
    let mut kills = 0;
    while folders(&bench.path("store")) > 0 && kills < 8 {
        let before = folders(&bench.path("store"));
        let mut child = bench
            .command(&["run", "many.yaml", "--store", "store", "-o", "results"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let has_begun = || !packs(&bench).is_empty() && folders(&bench.path("store")) < before;
        while child.try_wait().unwrap().is_none() && !has_begun() {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_micros(rng.random_range(0..20_000)));
        kills += usize::from(child.try_wait().unwrap().is_none());
        let _ = child.kill();
        child.wait().unwrap();
        let store = Store::at(bench.path("store"));
        for (id, digest) in &digests {
            let end = store.end(id).unwrap().unwrap_or_else(|| panic!("{id} is gone"));
            assert_eq!(end.digest, *digest);
        }
    }
    assert!(kills > 0, "it packs faster than it can be killed");
    let ran = bench.run(&["run", "many.yaml", "--store", "store", "-o", "results"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(ran.err.contains("nothing runs"), "{}", ran.err);
    assert!(inodes(&bench.path("store")) < 300);
    bench.ok(&["fsck", "store"]);
}

#[test]
fn without_a_store_there_is_nothing_to_pack() {
    let answer = Bench::new().run(&["pack", "nowhere"]);
    assert_eq!(answer.code, 2);
    assert!(
        answer.err.contains("there is no store at `nowhere`"),
        "{}",
        answer.err
    );
}
