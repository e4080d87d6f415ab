//! The record: what committed results must be for a reader to trust them. The checks are functions over
//! folders, so that each is held to a folder that it must refuse.

use crate::results::{builds, folders, read};
use report::{Passed, Verdicts};
use std::path::{Path, PathBuf};

/// Sentence of a report on a program whose files no commit holds in full.
const CHANGED: &str = "with changed files";

/// Fails with the offenders, one a line.
fn none(what: &str, offenders: &[String]) {
    assert!(offenders.is_empty(), "{what}:\n{}", offenders.join("\n"));
}

/// The reports that a program with changed files made or computed a trial of.
fn of_changed_files(folders: &[PathBuf]) -> Vec<String> {
    let mut offenders = Vec::new();
    for folder in folders {
        let report = read(folder, "report.md");
        let changed = builds(&report).into_iter().filter(|line| line.contains(CHANGED));
        offenders.extend(changed.map(|line| format!("{}: {line}", name(folder))));
    }
    offenders
}

/// Judged values that differ and refuted claims of which no cause is written.
fn unexplained(folders: &[PathBuf]) -> Vec<String> {
    let mut offenders = Vec::new();
    for folder in folders {
        match verdicts(folder) {
            Err(missing) => offenders.push(missing),
            Ok(verdicts) => {
                let without = |it: &&Passed| it.is_judged() && it.differs() && it.cause.is_none();
                let lines = verdicts.verdicts.iter().filter(without);
                offenders.extend(lines.map(|it| line(folder, it)));
            }
        }
    }
    offenders
}

/// The verdicts of a folder; what to say where it has none that can be read.
fn verdicts(folder: &Path) -> Result<Verdicts, String> {
    let path = folder.join("verdicts.json");
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))
}

fn line(folder: &Path, passed: &Passed) -> String {
    format!("{}: {}: {}", name(folder), passed.about, passed.verdict)
}

fn name(folder: &Path) -> String {
    folder
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

#[test]
fn committed_results_come_from_programs_without_changed_files() {
    none(
        "run these again with a program of a commit",
        &of_changed_files(&folders()),
    );
}

#[test]
fn whatever_differs_in_committed_results_has_its_cause() {
    none(
        "write the `cause` of these into their studies",
        &unexplained(&folders()),
    );
}

/// Folders of results with these verdicts, as reports write them.
fn made(studies: &[(&str, &[Passed])]) -> (tempfile::TempDir, Vec<PathBuf>) {
    let dir = tempfile::tempdir().unwrap();
    let folders = studies.iter().map(|(study, verdicts)| {
        let folder = dir.path().join(study);
        std::fs::create_dir(&folder).unwrap();
        let verdicts = Verdicts {
            study: (*study).into(),
            verdicts: verdicts.to_vec(),
            ..Verdicts::default()
        };
        let text = serde_json::to_string_pretty(&verdicts).unwrap();
        std::fs::write(folder.join("verdicts.json"), text).unwrap();
        folder
    });
    let folders = folders.collect();
    (dir, folders)
}

fn passed(verdict: &str) -> Passed {
    Passed {
        about: "t: a".into(),
        verdict: verdict.into(),
        ..Passed::default()
    }
}

#[test]
fn a_report_of_changed_files_is_found() {
    let (_dir, folders) = made(&[("clean", &[]), ("changed", &[]), ("told", &[])]);
    let write = |folder: &PathBuf, text: &str| std::fs::write(folder.join("report.md"), text).unwrap();
    write(
        &folders[0],
        "- source code: 0123abc\n- computed by: 3 trials by 0123abc\n",
    );
    write(
        &folders[1],
        "- source code: 0123abc\n- computed by: 2 trials by 0123abc; 1 by 0123abc, with changed files\n",
    );
    // Words elsewhere in a report are no provenance.
    write(
        &folders[2],
        "- a net with changed files\n- source code: 0123abc\n",
    );
    assert_eq!(
        of_changed_files(&folders),
        ["changed: - computed by: 2 trials by 0123abc; 1 by 0123abc, with changed files"]
    );
}

#[test]
fn what_differs_without_a_cause_is_found() {
    let explained = Passed {
        cause: Some("another load".into()),
        ..passed("DIFFERS")
    };
    let exploratory = Passed {
        exploratory: true,
        ..passed("DIFFERS")
    };
    let (_dir, folders) = made(&[
        ("one", &[explained, exploratory, passed("INCONCLUSIVE")]),
        (
            "two",
            &[passed("REFUTED"), passed("DIFFERS"), passed("SUPPORTED")],
        ),
    ]);
    assert_eq!(
        unexplained(&folders),
        ["two: t: a: REFUTED", "two: t: a: DIFFERS"]
    );
}

#[test]
fn a_folder_without_verdicts_passes_no_check() {
    let (dir, mut folders) = made(&[("one", &[passed("SUPPORTED")])]);
    folders.push(dir.path().join("two"));
    let said = [unexplained(&folders)];
    for offenders in said {
        assert_eq!(offenders.len(), 1);
        assert!(
            offenders[0].contains("two/verdicts.json: No such file"),
            "{}",
            offenders[0]
        );
    }
}
