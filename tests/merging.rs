//! The trials of several stores in one: what is new is taken, what differs is reported, nothing is half there.

use crate::program::{Bench, forge, trial_files};
use serde_json::Value;
use std::{
    collections::BTreeMap,
    fs,
    os::unix::process::CommandExt,
    path::{Path, PathBuf},
    process::Stdio,
};

/// Learners leave policies and networks; the other agents leave metrics alone.
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

/// Seeds 0 and 1 in `one`, seeds 0 to 3 in `two`.
fn two_stores() -> Bench {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["worker", "small.yaml", "--seeds", "2", "--store", "one"]);
    bench.ok(&["worker", "small.yaml", "--store", "two"]);
    bench
}

/// Every file of the trials of a store with what it holds.
fn contents(bench: &Bench, store: &str) -> BTreeMap<PathBuf, Vec<u8>> {
    fn gather(folder: &Path, root: &Path, found: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                gather(&path, root, found);
            } else {
                found.insert(
                    path.strip_prefix(root).unwrap().to_owned(),
                    fs::read(&path).unwrap(),
                );
            }
        }
    }
    let (root, mut found) = (bench.path(store).join("trials"), BTreeMap::new());
    gather(&root, &root, &mut found);
    found
}

#[test]
fn what_is_new_is_taken_with_its_bytes_and_the_rest_was_there() {
    let bench = two_stores();
    let said = bench.ok(&["merge", "two", "--into", "one", "--dry-run"]);
    assert_eq!(said.trim(), "two: 4 trials would be taken, 4 were there");
    assert_eq!(bench.digests("one").len(), 4, "a dry run writes nothing");
    let said = bench.ok(&["merge", "two", "--into", "one"]);
    assert_eq!(said.trim(), "two: 4 trials were taken, 4 were there");
    // The half that `one` computed itself has its own times; digests are the same.
    assert_eq!(bench.digests("one"), bench.digests("two"));
    let (one, two) = (contents(&bench, "one"), contents(&bench, "two"));
    assert_eq!(one.keys().collect::<Vec<_>>(), two.keys().collect::<Vec<_>>());
    let said = bench.ok(&["merge", "two", "--into", "one"]);
    assert_eq!(said.trim(), "two: 0 trials were taken, 8 were there");
    assert!(contents(&bench, "one") == one, "nothing was written again");
    let whole = "8 trials are whole, 0 are being computed, 0 files are wrong";
    assert!(bench.ok(&["fsck", "one"]).contains(whole));
    assert!(
        bench
            .run(&["run", "small.yaml", "--store", "one"])
            .err
            .contains("every trial is in the store already")
    );
}

#[test]
fn several_stores_become_one_that_was_not_there() {
    let bench = two_stores();
    bench.ok(&["merge", "one", "two", "--into", "made/here"]);
    assert_eq!(bench.digests("made/here"), bench.digests("two"));
    let both = bench.ok(&[
        "merge",
        "one",
        "two",
        "--into",
        "other",
        "--dry-run",
        "--format",
        "json",
    ]);
    let both: Value = serde_json::from_str(&both).unwrap();
    let counts = |source: usize| both["sources"][source]["counts"].clone();
    assert_eq!(
        (counts(0)["taken"].as_u64(), counts(1)["taken"].as_u64()),
        (Some(4), Some(4))
    );
    assert_eq!(
        counts(1)["same"],
        4,
        "what the first would give is there for the second"
    );
    assert!(!bench.path("other").exists());
}

#[test]
fn other_values_are_a_conflict_with_both_digests_and_the_destination_keeps_its_own() {
    let bench = two_stores();
    let forged = trial_files(&bench.path("one")).remove(0);
    let id = forged.parent().unwrap().file_name().unwrap().to_str().unwrap();
    forge(&forged);
    let own = bench
        .digests("one")
        .into_iter()
        .find(|(other, _)| other == id)
        .unwrap()
        .1;
    let answer = bench.run(&["merge", "two", "--into", "one"]);
    assert_eq!(answer.code, 101, "{}\n{}", answer.out, answer.err);
    let (_, after) = answer.out.split_once(&format!("conflict  {id} ")).unwrap();
    let (_, after) = after.split_once("metrics.parquet ").unwrap();
    let (digests, _) = after.split_once(" here; computed by ").unwrap();
    let (there, here) = digests.split_once(" there, ").unwrap();
    assert!(
        there != here && there.len() == 32 && here.len() == 32,
        "{digests}"
    );
    assert!(
        answer
            .out
            .contains("4 trials were taken, 3 were there, 1 conflicts"),
        "{}",
        answer.out
    );
    assert!(bench.digests("one").contains(&(id.to_owned(), own)));
}

#[test]
fn damaged_and_running_trials_are_named_and_left() {
    let bench = two_stores();
    let new: Vec<PathBuf> = trial_files(&bench.path("two"))
        .into_iter()
        .filter(|file| {
            !bench
                .path("one")
                .join(file.strip_prefix(bench.path("two")).unwrap())
                .exists()
        })
        .collect();
    let metrics = new[0].with_file_name("metrics.parquet");
    let mut bytes = fs::read(&metrics).unwrap();
    bytes[9] ^= 4;
    fs::write(&metrics, &bytes).unwrap();
    // A lease of this test's own process, which lives.
    let store = execution::store::Store::at(bench.path("two"));
    let leases = execution::store::Leases::open(&store, std::time::Duration::from_secs(30)).unwrap();
    let running = new[1].parent().unwrap().file_name().unwrap().to_str().unwrap();
    leases.claim(running).unwrap();
    let answer = bench.run(&["merge", "two", "--into", "one"]);
    assert_eq!(answer.code, 106, "{}", answer.out);
    assert!(
        answer.out.contains("its hash is not the acknowledged one")
            && answer.out.contains(&format!("running   {running}"))
            && answer
                .out
                .contains("2 trials were taken, 4 were there, 1 damaged, 1 running"),
        "{}",
        answer.out
    );
    assert_eq!(fs::read(&metrics).unwrap(), bytes, "the source is left as it is");
    leases.release(running).unwrap();
    let again = bench.run(&["merge", "two", "--into", "one"]);
    assert_eq!(again.code, 106);
    assert!(
        again.out.contains("1 trial was taken, 6 were there, 1 damaged"),
        "{}",
        again.out
    );
}

#[test]
fn a_damaged_destination_is_left_until_it_is_mended() {
    let bench = two_stores();
    let metrics = trial_files(&bench.path("one"))[0].with_file_name("metrics.parquet");
    let whole = fs::read(&metrics).unwrap();
    fs::write(&metrics, "not what was acknowledged").unwrap();
    let answer = bench.run(&["merge", "two", "--into", "one"]);
    assert_eq!(answer.code, 106);
    assert!(
        answer.out.contains("in the destination: trials/"),
        "{}",
        answer.out
    );
    bench.run(&["fsck", "one"]);
    bench.ok(&["merge", "two", "--into", "one"]);
    assert_eq!(fs::read(&metrics).unwrap(), whole);
}

#[test]
fn killed_at_every_boundary_and_run_again_it_ends_as_if_nothing_had_happened() {
    let bench = two_stores();
    let mut deaths = 0;
    loop {
        let mut command = bench.misused(&["merge", "two", "--into", "killed"]);
        let mut child = command
            .env("REGIMEN_TEST_CRASHES", bench.path("crashes.log"))
            .process_group(0)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let status = child.wait().unwrap();
        if bench.path("killed/trials").exists() {
            // Whatever is acknowledged is whole.
            let store = execution::store::Store::at(bench.path("killed"));
            for file in trial_files(&bench.path("killed")) {
                let id = file.parent().unwrap().file_name().unwrap().to_str().unwrap();
                assert!(store.sound(id).unwrap().is_some(), "{id}");
            }
        }
        if status.success() {
            break;
        }
        deaths += 1;
        assert!(deaths < 2_000, "it never ends");
    }
    // Four trials of two files and four of four, each in six steps of writing.
    assert!(deaths >= 24 * 6, "{deaths} deaths");
    // Leases that a killed run left are found and set aside.
    bench.ok(&["fsck", "killed"]);
    let (made, whole) = (contents(&bench, "killed"), contents(&bench, "two"));
    assert_eq!(made.keys().collect::<Vec<_>>(), whole.keys().collect::<Vec<_>>());
    assert!(made == whole, "the bytes are those of the source");
}

#[test]
fn a_store_is_not_merged_into_itself_and_has_to_be_there() {
    let bench = two_stores();
    for (source, problem) in [
        ("nowhere", "there is no store at `nowhere`"),
        ("./one", "taken into"),
    ] {
        let answer = bench.run(&["merge", source, "--into", "one"]);
        assert_eq!(answer.code, 2);
        assert!(answer.err.contains(problem), "{}", answer.err);
    }
}

#[test]
fn verdicts_that_were_seen_of_one_store_count_as_seen_in_the_other() {
    let bench = two_stores();
    for (store, seen) in [
        ("one", "{\"verdicts\":{\"a\":[3]}}"),
        ("two", "{\"verdicts\":{\"a\":[5],\"b\":[2]}}"),
    ] {
        fs::create_dir_all(bench.path(store).join("looks")).unwrap();
        fs::write(bench.path(store).join("looks/small.json"), seen).unwrap();
    }
    bench.ok(&["merge", "two", "--into", "one"]);
    let united: Value =
        serde_json::from_slice(&fs::read(bench.path("one/looks/small.json")).unwrap()).unwrap();
    assert_eq!(united["verdicts"], serde_json::json!({"a": [3, 5], "b": [2]}));
}
