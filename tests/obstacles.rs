//! A file in the place of another one in a store costs one trial, is said, and is set aside by `fsck`.

use crate::program::{Answer, Bench, reseal, trial_files};
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

const STUDY: &str = "
study: small
environments: { cells: { battery: { cells: 2 } } }
agents: { equal: { equal_split: {} } }
protocol: { train_evaluate: { steps: 0, final_episodes: 2 } }
seeds: 4
";

/// A finished store, and the folder of its first trial.
fn finished() -> (Bench, PathBuf) {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["worker", "small.yaml", "--store", "store"]);
    let folder = trial_files(&bench.path("store")).remove(0);
    let folder = folder.parent().unwrap().to_owned();
    (bench, folder)
}

fn pipe(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

fn run(bench: &Bench) -> Answer {
    bench.run(&["run", "small.yaml", "-j", "2"])
}

#[test]
fn what_stands_in_the_way_of_one_trial_costs_that_trial_alone() {
    let ways: [(&str, fn(&Path)); 5] = [
        ("", |folder| fs::write(folder, "no folder").unwrap()),
        ("lease", |folder| {
            fs::create_dir_all(folder.join("lease")).unwrap();
        }),
        ("lease", |folder| {
            fs::create_dir_all(folder).unwrap();
            pipe(&folder.join("lease"));
        }),
        ("running", |folder| {
            fs::create_dir_all(folder).unwrap();
            fs::write(folder.join("running"), "no folder").unwrap();
        }),
        ("running/metrics.log", |folder| {
            fs::create_dir_all(folder.join("running")).unwrap();
            pipe(&folder.join("running/metrics.log"));
        }),
    ];
    for (name, put) in ways {
        let (bench, folder) = finished();
        let whole = bench.digests("store");
        fs::remove_dir_all(bench.path("store/trials")).unwrap();
        fs::create_dir_all(folder.parent().unwrap()).unwrap();
        put(&folder);
        let ran = run(&bench);
        assert_eq!(
            (ran.code, bench.digests("store").len()),
            (106, 3),
            "{name}: {}",
            ran.err
        );
        for words in [
            "passed over cells equal",
            name,
            "`regimen fsck store` sets it aside",
        ] {
            assert!(ran.err.contains(words), "{words}: {}", ran.err);
        }
        let found = bench.run(&["fsck", "store"]);
        assert!(found.out.contains("3 trials are whole"), "{name}: {}", found.out);
        let again = run(&bench);
        assert_eq!(again.code, 0, "{name}: {}", again.err);
        assert_eq!(bench.digests("store"), whole);
        assert!(bench.ok(&["fsck", "store"]).contains("0 files are wrong"));
    }
}

#[test]
fn a_pipe_or_a_folder_for_a_file_is_never_opened() {
    for name in ["trial.json", "metrics.parquet"] {
        let (bench, folder) = finished();
        let whole = bench.digests("store");
        let put: [fn(&Path); 2] = [pipe, |path| fs::create_dir(path).unwrap()];
        for put in put {
            fs::remove_file(folder.join(name)).unwrap();
            put(&folder.join(name));
            let found = bench.run(&["fsck", "store", "--dry-run"]);
            assert_eq!(found.code, 106, "{}", found.out);
            assert!(found.out.contains("damaged"), "{}", found.out);
            bench.run(&["status", "small.yaml"]);
            bench.run(&["report", "small.yaml"]);
            let ran = run(&bench);
            assert_eq!(ran.code, 0, "{name}: {}", ran.err);
            assert_eq!(bench.digests("store"), whole);
        }
    }
}

#[test]
fn files_in_place_of_the_stores_folders_are_named_and_set_aside() {
    for name in ["owners", "submissions", "looks"] {
        let (bench, _) = finished();
        let path = bench.path(&format!("store/{name}"));
        if path.is_dir() {
            fs::remove_dir_all(&path).unwrap();
        }
        fs::write(&path, "no folder").unwrap();
        if name == "owners" {
            fs::remove_dir_all(bench.path("store/trials")).unwrap();
            let refused = run(&bench);
            assert_ne!(refused.code, 0);
            let words = "`regimen fsck store` sets it aside";
            assert!(refused.err.contains(words), "{}", refused.err);
        }
        let found = bench.run(&["fsck", "store"]);
        let words = format!("foreign   {name}: the store keeps a folder of this name");
        assert!(found.out.contains(&words), "{}", found.out);
        assert_eq!(run(&bench).code, 0);
    }
}

#[test]
fn what_a_newer_program_stored_is_left_as_it_is() {
    let (bench, folder) = finished();
    let file = folder.join("trial.json");
    let text = fs::read_to_string(&file).unwrap();
    let newer = reseal(
        &text
            .replacen("\"schema\":2", "\"schema\":9", 1)
            .replacen("\"key\"", "\"clef\"", 1),
    );
    fs::write(&file, &newer).unwrap();
    let ran = run(&bench);
    assert_eq!(ran.code, 106, "{}", ran.err);
    for words in [
        "passed over cells equal",
        "was written by a newer program (version 9 of its form)",
    ] {
        assert!(ran.err.contains(words), "{words}: {}", ran.err);
    }
    let checked = bench.ok(&["fsck", "store"]);
    for words in [
        "newer ",
        "version 9 of its form",
        "3 trials are whole",
        "0 files are wrong",
    ] {
        assert!(checked.contains(words), "{words}: {checked}");
    }
    bench.run(&["run", "small.yaml", "--retry-failed"]);
    assert_eq!(fs::read_to_string(&file).unwrap(), newer);
    assert!(folder.join("metrics.parquet").exists() && !bench.path("store/aside").exists());
}
