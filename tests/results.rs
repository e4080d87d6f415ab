//! Committed results: which program made them, and that nothing else lies beside them.

use crate::program::{Bench, repository};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

/// Sentence at the head of a report that no commit reproduces.
const IRREPRODUCIBLE: &str = "so that no commit reproduces them";

/// Folders of committed results: those of smoke profiles and of changed runs are not committed.
pub(crate) fn folders() -> Vec<PathBuf> {
    let inside = |folder: &Path| {
        let entries = std::fs::read_dir(folder).unwrap();
        entries
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.is_dir())
            .collect()
    };
    let groups: Vec<PathBuf> = inside(&repository().join("results"));
    let folders = groups.iter().flat_map(|group| inside(group));
    let is_committed = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy();
        !name.ends_with("-smoke") && !name.contains('+')
    };
    let mut folders: Vec<PathBuf> = folders.filter(is_committed).collect();
    folders.sort();
    folders
}

/// Where the results of a study lie below `results`.
pub(crate) fn place(folder: &Path) -> &Path {
    folder.strip_prefix(repository().join("results")).unwrap()
}

/// A file of a folder.
pub(crate) fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name))
        .unwrap_or_else(|error| panic!("{}: {error}", folder.join(name).display()))
}

/// The builds that a report names, of its trials and of itself.
pub(crate) fn builds(report: &str) -> Vec<&str> {
    report
        .lines()
        .filter(|line| {
            ["- source code: ", "- computed by: "]
                .iter()
                .any(|start| line.starts_with(start))
        })
        .collect()
}

#[test]
fn committed_results_come_from_a_commit_or_say_at_their_head_that_they_do_not() {
    let folders = folders();
    assert!(folders.len() >= 17, "{folders:?}");
    for folder in folders {
        let report = read(&folder, "report.md");
        let head = report.lines().take(8).any(|line| line.contains(IRREPRODUCIBLE));
        let builds = builds(&report);
        let clean = builds.len() == 2
            && builds.iter().all(|line| {
                ["changed", "did not say", "unknown"]
                    .iter()
                    .all(|word| !line.contains(word))
            });
        assert_ne!(clean, head, "{}: {builds:?}", folder.display());
    }
}

/// The files that a report is made of again, and the report itself.
const COMMITTED: [&str; 5] = [
    "evaluations.parquet",
    "record.json",
    "report.md",
    "resolved.yaml",
    "verdicts.json",
];

#[test]
fn committed_folders_hold_a_record_and_nothing_that_no_report_wrote() {
    // The record of a confirmation lies beside the report of its study, with a manifest of its own.
    let with_rounds = |folder: PathBuf| {
        let rounds = (1..)
            .map(|round| folder.join(format!("confirm-{round}")))
            .take_while(|path| path.exists());
        let rounds: Vec<PathBuf> = rounds.collect();
        std::iter::once(folder).chain(rounds)
    };
    let listed = folders()
        .into_iter()
        .flat_map(with_rounds)
        .filter(|folder| folder.join("manifest.json").exists());
    let mut seen = 0;
    for folder in listed {
        let manifest: serde_json::Value = serde_json::from_str(&read(&folder, "manifest.json")).unwrap();
        // Figures that were not made again stay, with their files.
        let of = |key: &str| {
            manifest[key]
                .as_object()
                .into_iter()
                .flat_map(|files| files.keys().cloned())
        };
        let written: BTreeSet<String> = of("files").chain(of("earlier")).collect();
        let mut found = BTreeSet::new();
        list(&folder, &folder, &mut found);
        found.remove("manifest.json");
        let unknown: Vec<_> = found.difference(&written).collect();
        assert!(unknown.is_empty(), "{}: {unknown:?}", folder.display());
        let is_round = folder
            .file_name()
            .unwrap()
            .to_string_lossy()
            .starts_with("confirm-");
        let needed = &COMMITTED[..if is_round { 2 } else { COMMITTED.len() }];
        let missing: Vec<_> = needed.iter().filter(|file| !found.contains(**file)).collect();
        assert!(missing.is_empty(), "{}: {missing:?}", folder.display());
        seen += 1;
    }
    assert!(seen >= 6, "{seen} folders have a manifest");
}

/// Documents with blocks that `regimen overview` writes.
const DOCUMENTS: [&str; 3] = ["README.md", "results/README.md", "experiments/README.md"];

#[test]
fn documents_have_the_blocks_that_overview_makes_of_the_results() {
    let bench = Bench::new();
    for document in DOCUMENTS {
        let path = repository().join(document);
        let before = std::fs::read_to_string(&path).unwrap();
        // Ways are written as seen from the document, so that it is written where it stands.
        let copy = path.with_extension("md.tmp");
        std::fs::write(&copy, &before).unwrap();
        let results = repository().join("results").to_string_lossy().into_owned();
        bench.ok(&["overview", &results, "--into", &copy.to_string_lossy()]);
        let after = std::fs::read_to_string(&copy).unwrap();
        std::fs::remove_file(&copy).unwrap();
        let advice = format!("write it anew with `regimen overview results --into {document}`");
        assert_eq!(before, after, "{advice}");
    }
}

#[test]
fn results_the_readme_and_the_program_stay_small() {
    const DERIVED: [&str; 4] = ["html", "png", "pdf", "tex"];
    let (mut files, mut bytes) = (0, 0);
    for folder in folders() {
        let mut found = BTreeSet::new();
        list(&folder, &folder, &mut found);
        let is_committed = |name: &&String| {
            let derived = DERIVED.iter().any(|ending| name.ends_with(ending));
            let of_tables =
                name.starts_with("tables/") && (name.ends_with(".md") || name.ends_with("-seeds.csv"));
            let of_figures = name.starts_with("figures/") && name.ends_with(".csv");
            !(derived || of_tables || of_figures)
        };
        for name in found.iter().filter(is_committed) {
            files += 1;
            bytes += std::fs::metadata(folder.join(name)).unwrap().len();
        }
    }
    assert!(
        files < 800 && bytes < 30_000_000,
        "results: {files} files, {bytes} bytes"
    );
    let program = std::fs::metadata(env!("CARGO_BIN_EXE_regimen")).unwrap().len();
    assert!(program < 40_000_000, "the program has {program} bytes");
    let readme = read(repository(), "README.md");
    assert!(
        readme.lines().count() <= 140 && readme.len() <= 8192,
        "README.md: {} bytes",
        readme.len()
    );
}

fn list(root: &Path, folder: &Path, found: &mut BTreeSet<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.join("manifest.json").exists() {
            // Its files are its own.
        } else if path.is_dir() {
            list(root, &path, found);
        } else {
            found.insert(path.strip_prefix(root).unwrap().to_string_lossy().into_owned());
        }
    }
}
