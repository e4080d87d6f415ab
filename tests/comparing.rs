//! Two results side by side: what moved beyond its interval, which verdicts changed, which settings differ.

use crate::{needs, program::Bench};
use serde_json::Value;
use std::{fs, path::Path, process::Command};

const STUDY: &str = "
study: small
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  random: { random_allocation: {} }
protocol: { train_evaluate: { steps: 64, environments: 8, evaluate_every: 32, episodes: 1, final_episodes: \
2 } }
seeds: 4
tables:
  lengths: { comparison: { value: cycle_length, rows: agent, columns: environment } }
claims:
  - equal.cycle_length > random.cycle_length
";

/// The same study with weaker cells, and a claim more.
fn changed() -> String {
    let text = STUDY.replace(
        "cells: 2 }",
        "cells: [{ r_ohm: 0.25, q_mobile_c: 6000 }, { r_ohm: 0.25, q_mobile_c: 6000 }] }",
    );
    text + "  - equal.cycle_length > 0\n"
}

fn two_results() -> Bench {
    let bench = Bench::new();
    for (folder, text) in [("before", STUDY.to_owned()), ("after", changed())] {
        fs::create_dir(bench.path(folder)).unwrap();
        bench.write(&format!("{folder}/small.yaml"), &text);
        let spec = format!("{folder}/small.yaml");
        bench.ok(&[
            "run",
            &spec,
            "-o",
            &format!("{folder}/results"),
            "--store",
            &format!("{folder}/store"),
        ]);
    }
    bench
}

/// The words that hold `later` against `earlier`.
fn against<'a>(earlier: &'a str, later: &'a str, options: &[&'a str]) -> Vec<&'a str> {
    [&["report", later, "--against", earlier], options].concat()
}

fn json(bench: &Bench, earlier: &str, later: &str, options: &[&str]) -> Value {
    let said = bench.ok(&[&against(earlier, later, options)[..], &["--format", "json"]].concat());
    serde_json::from_str(&said).unwrap()
}

/// A revision never becomes an option of `git`.
#[test]
fn a_revision_is_no_option() {
    let bench = two_results();
    let revision = "--output=x:before/results/small";
    let told = bench.run(&["report", revision, "--against", "after/results"]);
    assert_eq!(told.code, 2, "{}", told.err);
    let as_value = format!("--against={revision}");
    for words in [
        ["report", "--against=after/results", "--", revision],
        ["report", "after/results", &as_value, "--all"],
    ] {
        let told = bench.run(&words);
        let is_refused = told.code == 2 && told.err.contains("is no commit");
        assert!(is_refused, "{}", told.err);
    }
    assert!(!bench.path("x").exists());
}

/// Entry of a CSV file of a table for the seeds of a row.
fn seeds(path: &Path, row: &str) -> Vec<f64> {
    let text = fs::read_to_string(path).unwrap();
    let line = |line: &str| line.strip_prefix(row)?.rsplit(',').next()?.parse().ok();
    text.lines().filter_map(line).collect()
}

#[test]
fn what_moved_changed_and_differs_is_said() {
    let bench = two_results();
    let compared = json(&bench, "before/results", "after/results", &[]);
    let cells = compared["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 2);
    let equal = cells.iter().find(|cell| cell["row"] == "equal").unwrap();
    assert_eq!(
        (&equal["table"], &equal["basis"]),
        (&"lengths".into(), &"paired".into())
    );
    // The difference is the mean of the differences of the seeds that the files hold.
    let [a, b] = ["before", "after"].map(|side| {
        seeds(
            &bench.path(side).join("results/tables/lengths-seeds.csv"),
            "equal,",
        )
    });
    assert_eq!((a.len(), b.len()), (4, 4));
    let mean = b.iter().zip(&a).map(|(b, a)| b - a).sum::<f64>() / 4.0;
    assert!(
        (equal["difference"].as_f64().unwrap() - mean).abs() < 1e-9 * mean.abs().max(1.0),
        "{equal}"
    );
    let (low, high) = (&equal["interval"]["low"], &equal["interval"]["high"]);
    let outside = low.as_f64().unwrap() > 0.0 || high.as_f64().unwrap() < 0.0;
    assert_eq!(equal["fate"] == "moved", outside, "{equal}");
    let moved = cells.iter().filter(|cell| cell["fate"] == "moved").count();
    assert_eq!(compared["counts"]["moved"], moved);
    assert!(moved > 0, "another battery has another cycle length: {compared}");
    let keys: Vec<&str> = compared["settings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|setting| setting["key"].as_str().unwrap())
        .collect();
    assert!(keys.contains(&"environments.cells.battery.cells"), "{keys:?}");
    let only = &compared["only"][0];
    let claim = "equal.cycle_length > 0 in cells";
    assert_eq!(
        (&only["side"], &only["kind"], &only["what"]),
        (&"b".into(), &"claim".into(), &claim.into())
    );
}

#[test]
fn strict_leaves_with_101_where_something_moved_alone() {
    let bench = two_results();
    let options = ["--strict", "--changes", "what.md"];
    let answer = bench.run(&against("before/results", "after/results", &options));
    assert_eq!(answer.code, 101, "{}", answer.err);
    for part in [
        "Cells that moved:\n",
        "Settings that differ:\n",
        "environments.cells.battery.cells",
        "Of 2 cells",
    ] {
        assert!(answer.out.contains(part), "{part}\n{}", answer.out);
    }
    let page = fs::read_to_string(bench.path("what.md")).unwrap();
    assert!(
        page.starts_with("# Comparison\n\nA: before/results (study small)"),
        "{page}"
    );
    assert!(page.contains("## Cells that moved\n\n| table |"), "{page}");
    let same = bench.ok(&against("before/results", "before/results", &["--strict"]));
    assert!(
        same.contains("2 are the same") && !same.contains("Cells that"),
        "{same}"
    );
    assert!(
        bench
            .ok(&against("before/results", "before/results", &["--all"]))
            .contains("Other cells:")
    );
}

/// A study with its store says what its report said, down to the settings.
#[test]
fn a_study_is_compared_as_its_report_is() {
    let bench = two_results();
    let store = ["--against-store", "before/store"];
    let same = json(&bench, "before/small.yaml", "before/results", &store);
    assert_eq!(
        (&same["counts"]["same"], &same["counts"]["judged"]),
        (&2.into(), &1.into())
    );
    assert_eq!(same["settings"], serde_json::json!([]));
    assert_eq!(same["only"], serde_json::json!([]));
    let folders = json(&bench, "before/results", "after/results", &[]);
    let stores = ["--against-store", "before/store", "--store", "after/store"];
    let studies = json(&bench, "before/small.yaml", "after/small.yaml", &stores);
    for part in ["cells", "verdicts", "claims", "only", "settings", "counts"] {
        assert_eq!(studies[part], folders[part], "{part}");
    }
    // A store that is not there is a mistake, which a strict comparison must not take for agreement; nothing is made.
    let options = ["--store", "nowhere", "--strict"];
    let answer = bench.run(&against("before/small.yaml", "before/results", &options));
    assert_eq!(answer.code, 2, "{}", answer.out);
    assert!(
        answer.err.contains("there is no store at `nowhere`") && !bench.path("nowhere").exists(),
        "{}",
        answer.err
    );
}

/// More seeds are other samples: Welch, and their own number of seeds on each side.
#[test]
fn other_seeds_are_compared_as_other_samples() {
    let bench = two_results();
    bench.ok(&[
        "report",
        "before/small.yaml",
        "--seeds",
        "3",
        "-o",
        "fewer",
        "--store",
        "before/store",
    ]);
    let compared = json(&bench, "fewer", "before/results", &[]);
    let random = compared["cells"]
        .as_array()
        .unwrap()
        .iter()
        .find(|cell| cell["row"] == "random")
        .unwrap();
    assert_eq!(
        (&random["basis"], &random["fate"]),
        (&"welch".into(), &"within".into()),
        "{random}"
    );
    assert_eq!(compared["a"]["options"][0], "--seeds 3");
    assert!(
        compared["settings"]
            .as_array()
            .unwrap()
            .iter()
            .any(|setting| setting["key"] == "seeds")
    );
}

#[test]
fn results_of_a_commit_are_read_from_it() {
    let Some(_) = needs::program("git") else { return };
    let bench = two_results();
    let git = |arguments: &[&str]| {
        let output = Command::new("git")
            .args([
                "-c",
                "user.name=somebody",
                "-c",
                "user.email=somebody@example.org",
            ])
            .args(arguments)
            .current_dir(bench.path(""))
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
    };
    let kept = bench.path("kept");
    fs::rename(bench.path("before/results"), &kept).unwrap();
    git(&["init", "-q"]);
    git(&["add", "kept"]);
    git(&["commit", "-q", "-m", "before"]);
    fs::remove_dir_all(&kept).unwrap();
    fs::rename(bench.path("after/results"), &kept).unwrap();
    let compared = json(&bench, "HEAD:kept", "kept", &[]);
    assert_eq!(
        (&compared["a"]["from"], &compared["a"]["study"]),
        (&"HEAD:kept".into(), &"small".into())
    );
    assert_eq!(compared["cells"].as_array().unwrap().len(), 2);
    assert!(compared["counts"]["moved"].as_u64() > Some(0));
    let answer = bench.run(&against("HEAD:nowhere", "kept", &[]));
    assert_eq!(answer.code, 2);
    assert!(
        answer.err.contains("commit `HEAD` has no results in `nowhere`"),
        "{}",
        answer.err
    );
    let answer = bench.run(&against("no-such-commit:kept", "kept", &[]));
    assert!(
        answer.code == 2 && answer.err.contains("git ls-tree"),
        "{}",
        answer.err
    );
}

#[test]
fn what_cannot_be_compared_is_refused_with_what_to_name() {
    let bench = two_results();
    let answer = bench.run(&against("nowhere", "before/results", &[]));
    assert_eq!(answer.code, 2);
    assert!(
        answer
            .err
            .contains("there is nothing at `nowhere`: name a study file"),
        "{}",
        answer.err
    );
    let answer = bench.run(&against("before/store", "before/results", &[]));
    assert_eq!(answer.code, 2);
    assert!(
        answer.err.contains("`before/store` is no folder of results"),
        "{}",
        answer.err
    );
    bench.write(
        "other.yaml",
        &STUDY
            .replace("lengths:", "others:")
            .replace("claims:", "")
            .replace("  - equal.cycle_length > random.cycle_length", ""),
    );
    bench.ok(&["report", "other.yaml", "--store", "before/store", "-o", "other"]);
    let answer = bench.run(&against("other", "after/results", &[]));
    assert_eq!(answer.code, 4);
    assert!(
        answer.err.contains("have no cell, verdict or claim in common"),
        "{}",
        answer.err
    );
    let two = bench.run(&["report", "other", "after/results", "--against", "before/results"]);
    assert!(two.code == 2 && two.err.contains("2 are named"), "{}", two.err);
    let folded = bench.run(&["compare", "other", "after/results", "--strict"]);
    assert_eq!(folded.code, 2);
    assert!(folded.err.contains("`report B --against A`"), "{}", folded.err);
}
