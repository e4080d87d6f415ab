//! Which source code the program says it was built from, and where that is kept.

#[path = "../plugins/build.rs"]
#[allow(dead_code, reason = "its `main` is for cargo")]
mod build_script;

use crate::{
    needs,
    program::{Bench, repository, reseal, trial_files},
};
use std::{fs, path::Path, process::Command};

const STUDY: &str = "
study: small
environments: { cells: { battery: { cells: 2 } } }
agents: { equal: { equal_split: {} } }
protocol: { train_evaluate: { steps: 0, final_episodes: 2 } }
seeds: 3
";

fn git(folder: &Path, arguments: &[&str]) -> String {
    let identity = [
        "-c",
        "user.name=test",
        "-c",
        "user.email=test@example.org",
        "-c",
        "commit.gpgsign=false",
    ];
    let output = Command::new("git")
        .args(identity)
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "git {arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8_lossy(&output.stdout).trim().to_owned()
}

/// A folder with the files that a program is made of, and others.
fn sources() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["engine/src", "plugins", "results", "tests"] {
        fs::create_dir_all(folder.path().join(name)).unwrap();
    }
    for name in [
        "Cargo.toml",
        "Cargo.lock",
        "plugins/build.rs",
        "engine/src/lib.rs",
        "plugins/main.rs",
        "results/report.md",
        "tests/a.rs",
    ] {
        fs::write(folder.path().join(name), name).unwrap();
    }
    folder
}

/// Output of the build script for a folder: the commit, and whether files had changed.
fn told(folder: &Path) -> (String, String) {
    let lines = build_script::told(folder);
    let value = |key: &str| {
        lines
            .iter()
            .find_map(|line| line.strip_prefix(key))
            .unwrap()
            .to_owned()
    };
    (
        value("cargo::rustc-env=REGIMEN_COMMIT="),
        value("cargo::rustc-env=REGIMEN_CHANGED="),
    )
}

#[test]
fn the_build_script_knows_the_commit_and_what_changed_in_the_program() {
    let Some(_) = needs::program("git") else { return };
    let sources = sources();
    let folder = sources.path();
    assert_eq!(
        told(folder),
        (String::new(), "false".into()),
        "there is no repository"
    );
    git(folder, &["init", "--quiet"]);
    git(folder, &["add", "."]);
    git(folder, &["commit", "--quiet", "-m", "first"]);
    let commit = git(folder, &["rev-parse", "--short=12", "HEAD"]);
    assert_eq!(told(folder), (commit.clone(), "false".into()));
    for name in ["results/report.md", "tests/a.rs"] {
        fs::write(folder.join(name), "changed").unwrap();
    }
    assert_eq!(
        told(folder),
        (commit.clone(), "false".into()),
        "the program is not made of these"
    );
    fs::write(folder.join("engine/src/lib.rs"), "changed").unwrap();
    assert_eq!(told(folder), (commit.clone(), "true".into()));
    git(folder, &["commit", "--quiet", "--all", "-m", "second"]);
    let (second, changed) = told(folder);
    assert!(second != commit && changed == "false");
}

#[test]
fn the_build_script_watches_what_can_change_its_words() {
    let Some(_) = needs::program("git") else { return };
    let sources = sources();
    let folder = sources.path();
    git(folder, &["init", "--quiet"]);
    git(folder, &["add", "."]);
    git(folder, &["commit", "--quiet", "-m", "first"]);
    let lines = build_script::told(folder);
    let watched: Vec<&str> = lines
        .iter()
        .filter_map(|line| line.strip_prefix("cargo::rerun-if-changed="))
        .collect();
    for name in ["engine", "plugins", "Cargo.toml", "Cargo.lock"] {
        assert!(watched.contains(&name), "{name}: {watched:?}");
    }
    for name in [".git/HEAD", ".git/index", ".git/logs/HEAD"] {
        assert!(
            watched.iter().any(|path| path.ends_with(name)),
            "{name}: {watched:?}"
        );
    }
    let missing: Vec<_> = watched
        .iter()
        .filter(|path| !folder.join(path).exists())
        .collect();
    assert!(
        missing.is_empty(),
        "cargo would run the script each time for {missing:?}"
    );
    assert!(
        !watched
            .iter()
            .any(|path| path.contains("results") || path.contains("tests")),
        "{watched:?}"
    );
}

#[test]
fn source_code_unpacked_in_a_strangers_repository_has_no_commit() {
    let Some(_) = needs::program("git") else { return };
    let sources = sources();
    git(sources.path(), &["init", "--quiet"]);
    git(
        sources.path(),
        &["commit", "--quiet", "--allow-empty", "-m", "of another project"],
    );
    assert_eq!(told(sources.path()), (String::new(), "false".into()));
}

#[test]
fn the_program_says_what_it_was_built_from() {
    let Some(_) = needs::program("git") else { return };
    let version = Bench::new().ok(&["--version"]);
    let (commit, changed) = told(repository());
    let build = match (commit.as_str(), changed.as_str()) {
        ("", _) => "from unknown source code".into(),
        (commit, "true") => format!("{commit}, with changed files"),
        (commit, _) => commit.to_owned(),
    };
    assert_eq!(
        version.trim(),
        format!("regimen {} ({build})", env!("CARGO_PKG_VERSION"))
    );
}

#[test]
fn trials_and_reports_name_the_program_and_not_the_folder_they_were_made_in() {
    let Some(_) = needs::program("git") else { return };
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    git(&bench.path(""), &["init", "--quiet"]);
    git(
        &bench.path(""),
        &["commit", "--quiet", "--allow-empty", "-m", "of another project"],
    );
    let stranger = git(&bench.path(""), &["rev-parse", "--short=12", "HEAD"]);
    bench.ok(&["run", "small.yaml"]);
    let report = || fs::read_to_string(bench.path("results/small/report.md")).unwrap();
    assert!(!report().contains(&stranger), "{}", report());
    let (commit, changed) = told(repository());
    let build = format!(
        "{commit}{}",
        if changed == "true" {
            ", with changed files"
        } else {
            ""
        }
    );
    let (build, built) = if commit.is_empty() {
        ("a program that did not say".into(), false)
    } else {
        (build, true)
    };
    assert!(
        report().contains(&format!("- computed by: 3 trials by {build}\n")),
        "{}",
        report()
    );
    // A file of a program that did not say it is whole all the same.
    let old = &trial_files(&bench.path("store"))[0];
    let text = fs::read_to_string(old).unwrap();
    assert_eq!(text.contains("\"build\":{"), built);
    let (before, rest) = text.split_once(",\"build\":{").unwrap_or((&text, "}"));
    let after = rest.split_once('}').map_or("", |(_, after)| after);
    fs::write(
        old,
        reseal(&if built {
            format!("{before}{after}")
        } else {
            text.clone()
        }),
    )
    .unwrap();
    assert!(bench.ok(&["status", "small.yaml"]).contains("nothing is missing"));
    bench.ok(&["report", "small.yaml"]);
    if built {
        let words = format!("- computed by: 2 trials by {build}; 1 by a program that did not say\n");
        assert!(report().contains(&words), "{}", report());
    }
}
