//! The view of a study while its trials run and after it, as text and as a page; nothing in the store changes.

use crate::{program::Bench, slurm::until};
use serde_json::Value;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::SystemTime,
};

/// A trial that learns for some seconds, and one that is done at once.
const STUDY: &str = "
study: long
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 128, learning_starts: 64 } }
protocol: { train_evaluate: { steps: 64000, environments: 8, evaluate_every: 1000, episodes: 1, \
final_episodes: 2 } }
figures:
  learning: { learning_curve: { metric: cycle_length } }
";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("long.yaml", STUDY);
    bench
}

fn start(bench: &Bench, arguments: &[&str]) -> Child {
    bench
        .command(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

fn seen(bench: &Bench) -> Value {
    let said = bench.ok(&["watch", "long.yaml", "--once", "--format", "json"]);
    serde_json::from_str(&said).unwrap()
}

/// Every file below a folder with its bytes and when it was changed.
fn files(folder: &Path) -> BTreeMap<PathBuf, (Vec<u8>, SystemTime)> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            let changed = fs::metadata(&path).unwrap().modified().unwrap();
            found.insert(path.clone(), (fs::read(&path).unwrap(), changed));
        }
    }
    found
}

/// How many measurements of the learner are seen.
fn measured(view: &Value) -> usize {
    let lines = view["studies"][0]["panels"][0]["lines"].as_array().unwrap();
    let learner = lines.iter().find(|line| line["agent"] == 1);
    learner.map_or(0, |line| line["curves"]["cycle_length"].as_array().unwrap().len())
}

/// The running trial as data and as text.
fn is_seen_running(bench: &Bench, process: u32) {
    let view = seen(bench);
    let running = &view["studies"][0]["running"][0];
    assert_eq!(
        (&running["title"], &running["steps"]),
        (&"cells dsac seed 0".into(), &64000.into())
    );
    let by = running["by"].as_str().unwrap();
    assert!(by.starts_with(&format!("process {process} on ")), "{running}");
    assert_eq!(
        view["metrics"][0], "cycle_length",
        "the metric of the learning curve comes first"
    );
    let text = bench.ok(&["watch", "long.yaml"]);
    for part in [
        "long  ",
        "1/2 trials",
        "1 ok, 1 running",
        "  best so far equal: cycle_length",
        "  dsac ",
        "cells: cycle_length, every seed",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
}

/// The stopped trial as data and as a page; the store stays as it is.
fn is_seen_stopped(bench: &Bench) {
    let before = files(&bench.path("store"));
    let stopped = seen(bench);
    let study = &stopped["studies"][0];
    assert_eq!(
        (&study["missing"], study["running"][0].is_null()),
        (&1.into(), true)
    );
    assert!(measured(&stopped) > 1, "what was logged is there");
    bench.ok(&["watch", "long.yaml"]);
    bench.ok(&["watch", "long.yaml", "--once", "--html", "made/here/page.html"]);
    assert!(files(&bench.path("store")) == before, "watching changes nothing");
    let page = fs::read_to_string(bench.path("made/here/page.html")).unwrap();
    assert!(
        page.contains("1 of 2 trials: 1 ok, 1 missing") && !page.contains("http-equiv"),
        "{page}"
    );
}

#[test]
fn a_run_is_seen_while_it_goes_on_and_a_stopped_one_is_left_as_it_is() {
    let bench = bench();
    let mut run = start(&bench, &["run", "long.yaml", "-j", "2"]);
    until("measurements of the running trial are seen", || {
        let view = seen(&bench);
        view["studies"][0]["running"][0]["step"].as_u64() > Some(0) && measured(&view) > 1
    });
    is_seen_running(&bench, run.id());
    let mut kill = Command::new("kill");
    assert!(
        kill.args(["-INT", &run.id().to_string()])
            .status()
            .unwrap()
            .success()
    );
    assert_eq!(run.wait().unwrap().code(), Some(106));
    is_seen_stopped(&bench);
}

#[test]
fn a_page_is_renewed_until_no_trial_is_left() {
    let bench = bench();
    let mut run = start(&bench, &["run", "long.yaml", "-j", "2"]);
    let mut watch = start(
        &bench,
        &["watch", "long.yaml", "--html", "page.html", "--every-s", "0.2"],
    );
    let page = || fs::read_to_string(bench.path("page.html")).unwrap_or_default();
    until("the page shows the running trial", || {
        let page = page();
        assert!(
            page.is_empty() || page.ends_with("</html>\n"),
            "a page appears whole"
        );
        page.contains("1 running") && page.contains("<progress value=\"0.")
    });
    assert!(page().contains("<meta http-equiv=\"refresh\" content=\"1\">"));
    assert_eq!(run.wait().unwrap().code(), Some(0));
    assert_eq!(watch.wait().unwrap().code(), Some(0));
    let last = page();
    assert!(last.contains("2 of 2 trials: 2 ok") && last.contains("<svg") && !last.contains("http-equiv"));
    assert!(
        !last.contains("<script") && !last.contains("src="),
        "it needs nothing from elsewhere"
    );
    let before = files(&bench.path("store"));
    let text = bench.ok(&["watch", "long.yaml", "--once"]);
    assert!(
        text.contains("2/2 trials") && text.contains("  2 ok\n") && text.contains("equal"),
        "{text}"
    );
    assert!(files(&bench.path("store")) == before);
}

#[test]
fn a_store_that_is_not_there_is_seen_as_empty_and_not_made() {
    let bench = bench();
    let text = bench.ok(&["watch", "long.yaml"]);
    assert!(
        text.contains("0/2 trials") && text.contains("2 missing; no stored trial tells how long"),
        "{text}"
    );
    assert!(!bench.path("store").exists());
    let wrong = bench.run(&["watch", "nowhere.yaml"]);
    assert!(
        wrong.code == 2 && wrong.err.contains("nowhere.yaml"),
        "{}",
        wrong.err
    );
    let wrong = bench.run(&["watch", "long.yaml", "--every-s", "0"]);
    assert!(
        wrong.code == 2 && wrong.err.contains("write a number from 0.1 to 3600"),
        "{}",
        wrong.err
    );
}

#[test]
fn a_metric_that_no_trial_records_is_refused() {
    let bench = bench();
    let refused = bench.run(&["watch", "long.yaml", "--once", "--metric", "cycle_lenght"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    let said = "no trial records `cycle_lenght`: did you mean `cycle_length`?";
    assert!(refused.err.contains(said), "{}", refused.err);
}
