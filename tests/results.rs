//! Committed results: which program made them, and that nothing else lies beside them.

use crate::program::{Bench, repository};
use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

/// What a report says at its head where no commit reproduces it.
const IRREPRODUCIBLE: &str = "so that no commit reproduces them";

/// Folders of committed results: those of smoke profiles and of changed runs are not committed.
pub(crate) fn folders() -> Vec<PathBuf> {
    let folders = std::fs::read_dir(repository().join("results"))
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let is_committed = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy();
        path.is_dir() && !name.ends_with("-smoke") && !name.contains('+')
    };
    folders.filter(is_committed).collect()
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
        let (report, page) = (read(&folder, "report.md"), read(&folder, "index.html"));
        let head = report.lines().take(8).any(|line| line.contains(IRREPRODUCIBLE));
        let builds = builds(&report);
        let clean = builds.len() == 2
            && builds.iter().all(|line| {
                ["changed", "did not say", "unknown"]
                    .iter()
                    .all(|word| !line.contains(word))
            });
        assert_ne!(clean, head, "{}: {builds:?}", folder.display());
        assert_eq!(
            page.contains(IRREPRODUCIBLE),
            head,
            "{}: the page says something else",
            folder.display()
        );
    }
}

#[test]
fn committed_folders_hold_what_their_report_wrote_and_nothing_else() {
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
        assert_eq!(found, written, "{}", folder.display());
        seen += 1;
    }
    assert!(seen >= 6, "{seen} folders have a manifest");
}

#[test]
fn the_readme_has_the_table_that_overview_makes_of_the_results() {
    let results = repository().join("results");
    let table = Bench::new().ok(&["overview", &results.to_string_lossy()]);
    let readme = read(repository(), "README.md");
    let block = readme
        .split_once("<!-- results: begin -->\n")
        .and_then(|(_, rest)| rest.split_once("<!-- results: end -->\n"))
        .map(|(block, _)| block);
    assert_eq!(
        block.map(str::trim),
        Some(table.trim()),
        "write it anew with `regimen overview results --into README.md`"
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
