//! Drawings that trials leave: kept with the trial, drawn in figures, missed where they are damaged.

use crate::program::{Bench, trial_files};
use std::fs;

const STUDY: &str = "
study: painted
environments:
  full: { painter: { images: 5 } }
  empty: { painter: { images: 0 } }
agents:
  equal: { equal_split: {} }
protocol: { paint: {} }
seeds: 2
figures:
  samples: { images: { agents: [equal], environment: full, rows: 2, columns: 2 } }
  design: { graph: { agents: [equal], environment: full, seed: 1 } }
  nothing: { graph: { environment: empty } }
";

fn ran() -> Bench {
    let bench = Bench::new();
    bench.write("painted.yaml", STUDY);
    let ran = bench.run_misused(&["run", "painted.yaml", "--store", "store"]);
    // One figure has nothing to show.
    assert_eq!(ran.code, 102, "{}\n{}", ran.out, ran.err);
    bench
}

#[test]
fn drawings_are_acknowledged_and_shown() {
    let bench = ran();
    let leave = trial_files(&bench.path("store")).into_iter().filter(|file| {
        let text = fs::read_to_string(file).unwrap();
        let trial: serde_json::Value = serde_json::from_str(&text).unwrap();
        let files = trial["files"].as_object().cloned().unwrap_or_default();
        let names: Vec<&str> = files.keys().map(String::as_str).collect();
        assert!(
            names.is_empty() || names == ["graph.json", "images.png"],
            "{names:?}"
        );
        !names.is_empty()
    });
    // One environment has nothing to draw.
    assert_eq!(leave.count(), 2);
    let report = fs::read_to_string(bench.path("results/painted/report.md")).unwrap();
    for words in [
        "The first 4 of 5 images of seed 0 in full.",
        "The design of seed 1 in full.",
        "no trial has left a graph: equal is missing: its trial left no graph.",
    ] {
        assert!(report.contains(words), "{words}\n{report}");
    }
    let figures = bench.path("results/painted/figures");
    let svg = fs::read_to_string(figures.join("samples.svg")).unwrap();
    assert_eq!(svg.matches("href=\"data:image/png;base64,").count(), 4);
    let csv = fs::read_to_string(figures.join("design.csv")).unwrap();
    assert!(csv.contains("1,edge,1,,,,,1,2,false"), "{csv}");
    assert!(
        fs::read_to_string(figures.join("design.svg"))
            .unwrap()
            .contains("brush")
    );
}

#[test]
fn a_damaged_drawing_is_found_not_shown_and_made_again() {
    let bench = ran();
    let files = trial_files(&bench.path("store"));
    let mut images = files.iter().map(|file| file.with_file_name("images.png"));
    let path = images.find(|path| path.exists()).unwrap();
    let whole = fs::read(&path).unwrap();
    let mut bytes = whole.clone();
    bytes[40] ^= 1;
    fs::write(&path, &bytes).unwrap();
    let report = bench.run_misused(&["report", "painted.yaml", "--store", "store"]);
    assert!(
        report.err.contains("images.png") && report.err.contains("not shown"),
        "{}",
        report.err
    );
    let found = bench.run_misused(&["fsck", "store"]);
    assert!(found.out.contains("images.png"), "{}", found.out);
    let again = bench.run_misused(&["run", "painted.yaml", "--store", "store"]);
    assert_eq!(again.code, 102, "{}\n{}", again.out, again.err);
    assert!(fs::read(&path).unwrap() == whole);
}

#[test]
fn a_study_whose_protocol_leaves_no_drawings_is_refused() {
    let bench = Bench::new();
    let study = STUDY.replace("paint: {}", "train_evaluate: { steps: 0 }");
    bench.write("painted.yaml", &study);
    let checked = bench.run_misused(&["check", "painted.yaml"]);
    let said = checked.out + &checked.err;
    assert!(
        checked.code != 0
            && said.contains("no trial of `equal` leaves images")
            && said.contains("figures.samples"),
        "{said}"
    );
}
