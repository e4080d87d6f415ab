//! Reports that are made again from the record in a folder of results, without a store.

use crate::{
    program::Bench,
    results::{folders, place, read},
};
use report::Verdicts;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

const STUDY: &str = "
study: small
title: A study of everything that a record has to hold
summary: \"An equal split lives {lengths: equal} decisions; {claim 1}\"
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64 } }
protocol: { train_evaluate: { steps: 256, environments: 8, evaluate_every: 128, episodes: 2, final_episodes: 6, trace_episodes: 1 } }
seeds: { min: 3, max: 5, looks: 2 }
profiles: { short: { protocol.steps: 128 } }
tables:
  lengths: { comparison: { value: cycle_length } }
  squares: { comparison: { value: cycle_length, root_mean_square: true } }
  seconds: { comparison: { value: wall_time } }
figures:
  curve: { learning_curve: { metric: cycle_length } }
  temperature: { learning_curve: { metric: temperature, agents: [dsac] } }
  voltage: { caption: One episode, trajectory: { channels: [voltage], agents: [equal, dsac] } }
claims:
  - { claim: dsac.cycle_length > equal.cycle_length, about: learning, why: any difference counts }
  - { claim: rms(dsac.cycle_length) >= 0.5 * rms(equal.cycle_length), about: squares, why: half is much }
  - { claim: auc(dsac.cycle_length) > 1, about: while learning, why: one is little }
";

const FOLDER: &str = "results/small";

/// A bench with a report, and no store.
fn reported() -> Bench {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml"]);
    fs::rename(bench.path("store"), bench.path("put-away")).unwrap();
    bench
}

/// Every file of a folder but the manifest, which tells what was made anew from what stayed.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if !path.ends_with("manifest.json") {
                let bytes = fs::read(&path).unwrap();
                files.insert(path.strip_prefix(folder).unwrap().to_owned(), bytes);
            }
        }
    }
    files
}

fn rewrite(bench: &Bench, file: &str, change: impl Fn(String) -> String) {
    let path = bench.path(FOLDER).join(file);
    let before = fs::read(&path).unwrap();
    let text = change(String::from_utf8(before.clone()).unwrap());
    fs::write(&path, &text).unwrap();
    let manifest = bench.path(FOLDER).join("manifest.json");
    let [old, new] = [before.as_slice(), text.as_bytes()].map(contract::digest::of_bytes);
    fs::write(
        &manifest,
        fs::read_to_string(&manifest).unwrap().replace(&old, &new),
    )
    .unwrap();
}

/// Twice, since what a report from a record leaves is a record, too.
#[test]
fn a_report_from_its_record_has_the_same_bytes() {
    let bench = reported();
    let before = files(&bench.path(FOLDER));
    assert!(before.contains_key(Path::new("figures/voltage.svg")));
    for _ in 0..2 {
        let said = bench.ok(&["report", "small.yaml", "--recorded"]);
        assert!(said.contains("An equal split lives"), "{said}");
        let after = files(&bench.path(FOLDER));
        assert_eq!(
            before.keys().collect::<Vec<_>>(),
            after.keys().collect::<Vec<_>>()
        );
        for (name, bytes) in &before {
            assert_eq!(
                String::from_utf8_lossy(bytes),
                String::from_utf8_lossy(&after[name]),
                "{}",
                name.display()
            );
        }
    }
    assert!(!bench.path("store").exists());
}

#[test]
fn todays_study_judges_the_trials_of_the_record() {
    let bench = reported();
    let before = read(&bench.path(FOLDER), "verdicts.json");
    assert!(!before.contains("claim 2: dsac.cycle_length > 1e6"), "{before}");
    let study = STUDY
        .replace(
            "rms(dsac.cycle_length) >= 0.5 * rms(equal.cycle_length)",
            "dsac.cycle_length > 1e6",
        )
        .replace("title: A study", "title: Another title of a study");
    bench.write("small.yaml", &study);
    bench.ok(&["report", "small.yaml", "--recorded"]);
    let report = read(&bench.path(FOLDER), "report.md");
    assert!(
        report.contains("Another title")
            && report.contains("| `dsac.cycle_length > 1e6` | cells | REFUTED |")
    );
    assert!(!report.contains("Of an earlier version") && !report.contains("Of other settings"));
}

#[test]
fn trials_of_an_earlier_version_or_of_other_settings_say_so() {
    let bench = reported();
    rewrite(&bench, "record.json", |text| {
        text.replace("[\"environment battery\",2]", "[\"environment battery\",1]")
    });
    bench.write("small.yaml", &STUDY.replace("width: 16", "width: 32"));
    let resolved = read(&bench.path(FOLDER), "resolved.yaml");
    bench.ok(&["report", "small.yaml", "--recorded"]);
    let verdicts = read(&bench.path(FOLDER), "verdicts.json");
    let verdicts: Verdicts = serde_json::from_str(&verdicts).unwrap();
    assert_eq!(verdicts.earlier_versions, ["environment battery 1, now 2"]);
    assert_eq!(verdicts.changed_settings, ["agents.dsac.dirichlet_sac.width"]);
    for file in ["report.md", "index.html"] {
        let text = read(&bench.path(FOLDER), file);
        assert!(
            text.contains("Of an earlier version: environment battery 1, now 2."),
            "{file}"
        );
        assert!(
            text.contains("Of other settings than the study has now: agents.dsac"),
            "{file}"
        );
    }
    // The complete configs are those of the trials.
    assert_eq!(read(&bench.path(FOLDER), "resolved.yaml"), resolved);
}

#[test]
fn damage_is_an_error_that_names_the_file_and_never_a_number() {
    let bench = reported();
    let before = files(&bench.path(FOLDER));
    let refused = |what: &str, file: &str| {
        let answer = bench.run(&["report", "small.yaml", "--recorded"]);
        assert_eq!(answer.code, 2, "{what}: {}", answer.err);
        assert!(
            answer.err.contains(&format!("small/{file}`")),
            "{what}: {}",
            answer.err
        );
        answer.err
    };
    for file in [
        "record.json",
        "evaluations.parquet",
        "resolved.yaml",
        "figures/voltage.svg",
    ] {
        let path = bench.path(FOLDER).join(file);
        let whole = fs::read(&path).unwrap();
        let mut flipped = whole.clone();
        flipped[whole.len() / 2] ^= 1;
        for damaged in [&whole[..whole.len() / 2], &whole[..0], &flipped] {
            fs::write(&path, damaged).unwrap();
            let said = refused("damaged", file);
            assert!(
                said.contains("git checkout") && said.contains("from a store"),
                "{said}"
            );
        }
        fs::remove_file(&path).unwrap();
        refused("gone", file);
        fs::write(&path, whole).unwrap();
        assert_eq!(files(&bench.path(FOLDER)), before, "{file}");
    }
    rewrite(&bench, "record.json", |text| text[..text.len() / 2].to_owned());
    assert!(refused("cut before it was noted", "record.json").contains("holds no record"));
    fs::remove_file(bench.path(FOLDER).join("manifest.json")).unwrap();
    refused("no manifest", "manifest.json");
    fs::rename(bench.path(FOLDER), bench.path("elsewhere")).unwrap();
    let answer = bench.run(&["report", "small.yaml", "--recorded"]);
    assert_eq!(answer.code, 4, "{}", answer.err);
    assert!(
        answer.err.contains("small: passed over, as there is no folder"),
        "{}",
        answer.err
    );
}

/// Verdicts are the same when they are made again from the record.
#[test]
fn committed_results_are_made_again_from_their_records() {
    let bench = Bench::new();
    let mut studies = Vec::new();
    for folder in folders() {
        copy(&folder, &bench.path("results").join(place(&folder)));
        let manifest: serde_json::Value = serde_json::from_str(&read(&folder, "manifest.json")).unwrap();
        let study = folder.join(manifest["spec"].as_str().unwrap());
        studies.push(study.canonicalize().unwrap().to_string_lossy().into_owned());
    }
    let arguments = studies.iter().map(String::as_str);
    let command: Vec<&str> = ["report", "--recorded"].into_iter().chain(arguments).collect();
    let answer = bench.run(&command);
    assert!([0, 102, 106].contains(&answer.code), "{}", answer.err);
    assert!(!answer.err.contains("error:"), "{}", answer.err);
    let mut other = Vec::new();
    for folder in folders() {
        let again = bench.path("results").join(place(&folder));
        assert_eq!(words(&folder), words(&again), "{}", folder.display());
        for (table, text) in tables(&folder) {
            if tables(&again)[&table] != text {
                other.push(format!("{}/{table}", again.display()));
            }
        }
    }
    assert!(other.is_empty(), "{other:?}");
}

fn copy(from: &Path, to: &Path) {
    for (name, bytes) in files(from) {
        let path = to.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    fs::copy(from.join("manifest.json"), to.join("manifest.json")).unwrap();
    for round in (1..).map(|round| format!("confirm-{round}")) {
        if !from.join(&round).exists() {
            break;
        }
        let manifest = format!("{round}/manifest.json");
        fs::copy(from.join(&manifest), to.join(&manifest)).unwrap();
    }
}

/// Judged values and claims of a folder, with their verdicts.
fn words(folder: &Path) -> Vec<[String; 3]> {
    let verdicts: Verdicts = serde_json::from_str(&read(folder, "verdicts.json")).unwrap();
    let words = |it: report::Passed| {
        let together = it.together.unwrap_or_default();
        [it.about, it.verdict, together]
    };
    verdicts.verdicts.into_iter().map(words).collect()
}

/// The tables of a folder by the names of their files, as numbers.
fn tables(folder: &Path) -> BTreeMap<String, String> {
    let folder = folder.join("tables");
    if !folder.is_dir() {
        return BTreeMap::new();
    }
    let files = files(&folder).into_iter();
    let csv = files.filter(|(name, _)| name.extension().is_some_and(|ending| ending == "csv"));
    csv.map(|(name, bytes)| {
        let name = name.to_string_lossy().into_owned();
        (name, String::from_utf8(bytes).unwrap())
    })
    .collect()
}
