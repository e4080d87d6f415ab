//! Every study of the repository: checked as it is, and run through its smoke profile to the report.

use crate::{
    needs,
    program::{Bench, answer, repository},
};
use std::{
    ffi::OsString,
    fs,
    path::{Path, PathBuf},
};

/// The studies that can run with a Python, with a line for each that cannot for want of what its lock file pins.
pub(crate) fn studies_with(python: &str) -> Vec<String> {
    let can_run = |study: &String| {
        let locks = locks(Path::new(study)).into_iter();
        let missing = locks.filter_map(|lock| Some((needs::differs_from_lock(python, &lock)?, lock)));
        let missing: Vec<(String, PathBuf)> = missing.collect();
        for (differs, lock) in &missing {
            let lock = lock.strip_prefix(repository()).unwrap_or(lock).display();
            let remedy = format!("`python3 -m pip install -r {lock}` installs it");
            let name = Path::new(study).file_stem().unwrap().to_string_lossy();
            needs::skip_part(&name, differs, &remedy);
        }
        missing.is_empty()
    };
    every_study().into_iter().filter(can_run).collect()
}

/// The lock files of the environments in Python of a study and of those that it includes.
fn locks(study: &Path) -> Vec<PathBuf> {
    let beside = |name: &str| study.with_file_name(name.trim_matches(['"', '\'']));
    let text = fs::read_to_string(study).unwrap();
    let of_line = |line: &str| match line.strip_prefix("include: ") {
        Some(name) => locks(&beside(name)),
        None => line
            .split_once("lock: { file: ")
            .and_then(|(_, rest)| rest.split_once(" }"))
            .map(|(name, _)| beside(name))
            .into_iter()
            .collect(),
    };
    text.lines().flat_map(of_line).collect()
}

/// The studies that can run here, and the path on which they find their programs.
fn studies() -> (Vec<String>, OsString) {
    let python = needs::any_python();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let beside = Path::new(python).parent().filter(|folder| folder.is_absolute());
    let folders = beside.map(PathBuf::from).into_iter();
    let path = std::env::join_paths(folders.chain(std::env::split_paths(&path)));
    (studies_with(python), path.unwrap())
}

/// The studies of the repository; those that run programs of others have tests of their own.
pub(crate) fn every_study() -> Vec<String> {
    let inside = |folder: PathBuf| {
        let entries = std::fs::read_dir(folder).unwrap();
        entries.map(|entry| entry.unwrap().path()).collect::<Vec<_>>()
    };
    let groups = inside(repository().join("experiments")).into_iter();
    let mut names: Vec<String> = groups
        .filter(|path| path.is_dir() && !path.ends_with("programs"))
        .flat_map(inside)
        .filter(|path| path.extension().is_some_and(|extension| extension == "yaml"))
        .map(|path| path.to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn a_study_with_an_environment_in_python_is_known_by_its_lock_file() {
    let of = |name: &str| locks(&repository().join("experiments/first").join(name)).len();
    for (study, count) in [("python-pendulum", 1), ("python-spread", 1), ("python-rule", 3)] {
        assert_eq!(of(&format!("{study}.yaml")), count, "{study}");
    }
    assert_eq!(of("quickstart.yaml"), 0);
}

#[test]
fn every_study_and_every_profile_passes_the_check() {
    let bench = Bench::new();
    let (studies, path) = studies();
    assert!(studies.len() >= 8, "{studies:?}");
    assert!(
        studies.iter().any(|study| study.contains("maintenance/")),
        "{studies:?}"
    );
    for profile in [None, Some("smoke"), Some("paper")] {
        let mut arguments = vec!["check"];
        arguments.extend(profile.iter().flat_map(|profile| ["--profile", profile]));
        arguments.extend(studies.iter().map(String::as_str));
        let answer = answer(&bench.command(&arguments).env("PATH", &path).output().unwrap());
        assert_eq!(answer.code, 0, "{}", answer.err);
        assert!(!answer.err.contains("warning"), "{profile:?}: {}", answer.err);
    }
}

/// The page without what images are encoded as, where any letters may follow each other.
fn without_images(page: &str) -> String {
    let mut pieces = page.split("base64,");
    let first = pieces.next().unwrap_or_default().to_owned();
    pieces.fold(first, |text, piece| {
        text + piece.split_once('"').map_or("", |(_, rest)| rest)
    })
}

#[test]
fn every_study_runs_its_smoke_profile_to_the_report() {
    let bench = Bench::new();
    let (studies, path) = studies();
    let run = |words: &[&str]| {
        let arguments: Vec<&str> = words
            .iter()
            .copied()
            .chain(studies.iter().map(String::as_str))
            .collect();
        answer(&bench.command(&arguments).env("PATH", &path).output().unwrap())
    };
    let first = run(&["run", "--profile", "smoke"]);
    assert_eq!(first.code, 0, "{}\n{}", first.out, first.err);
    for study in &studies {
        let below = Path::new(study)
            .strip_prefix(repository().join("experiments"))
            .unwrap();
        let name = below.with_extension("").to_string_lossy().into_owned();
        let folder = bench.path(&format!("results/{name}-smoke"));
        for file in ["index.html", "report.md", "resolved.yaml"] {
            assert!(
                folder.join(file).metadata().is_ok_and(|file| file.len() > 200),
                "{name}: {file}"
            );
        }
        let page = std::fs::read_to_string(folder.join("index.html")).unwrap();
        assert!(
            !without_images(&page).contains("NaN"),
            "{name}: a number that is none reached the page"
        );
    }
    // A second run would compute nothing.
    let again = run(&["plan", "--profile", "smoke"]);
    assert_eq!(again.code, 0);
    let complete = again.out.matches("nothing is missing").count();
    assert_eq!(complete, studies.len(), "{}", again.out);
}

#[test]
fn learners_that_need_decisions_are_refused_where_only_examples_are_given() {
    let bench = Bench::new();
    let study = |agent: &str| {
        format!(
            "study: fit\nenvironments:\n  points: {{ simplex_reconstruction: {{}} }}\nagents:\n  learner: \
             {{ {agent}: {{}} }}\n\
             protocol: {{ supervised_fit: {{}} }}\nseeds: 1\n"
        )
    };
    bench.write("fit.yaml", &study("dirichlet_sac"));
    let refused = bench.run(&["check", "fit.yaml"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    for part in [
        "fit.yaml:5:",
        "`learner` learns from its decisions",
        "`train_evaluate`",
        "`dirichlet_regression`",
    ] {
        assert!(refused.err.contains(part), "{part}: {}", refused.err);
    }
    bench.write("fit.yaml", &study("dirichlet_regression"));
    bench.ok(&["check", "fit.yaml"]);
}

#[test]
fn learners_that_need_examples_are_refused_where_decisions_are_given() {
    let bench = Bench::new();
    bench.write(
        "fit.yaml",
        "study: fit\nenvironments:\n  points: { simplex_reconstruction: {} }\nagents:\n\
         \x20 learner: { dirichlet_regression: {} }\n\
         protocol: { train_evaluate: { steps: 1000 } }\nseeds: 1\n",
    );
    let refused = bench.run(&["check", "fit.yaml"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    for part in [
        "fit.yaml:5:",
        "`learner` learns from examples; `train_evaluate` gives decisions",
        "`supervised_fit` gives it examples",
    ] {
        assert!(refused.err.contains(part), "{part}: {}", refused.err);
    }
}
