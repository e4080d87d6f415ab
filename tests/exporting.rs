//! A study's numbers in forms that other programs read.

use crate::program::{Bench, trial_files};
use contract::Phase;
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

const STUDY: &str = "
study: small
title: Two ways to share a load
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 8, batch_size: 8, learning_starts: 16 } }
protocol: { train_evaluate: { steps: 64, environments: 8, evaluate_every: 32, episodes: 2, final_episodes: \
3 } }
seeds: 2
";

fn finished() -> Bench {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml"]);
    bench
}

/// The rows of a table, by the names of its columns. No cell of these tables holds a line break.
fn rows(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines().map(fields);
    let header = lines.next().unwrap();
    lines
        .map(|line| {
            assert_eq!(line.len(), header.len());
            header.iter().cloned().zip(line).collect()
        })
        .collect()
}

/// The fields of a line, some of which are in quotes.
fn fields(line: &str) -> Vec<String> {
    let (mut fields, mut quoted) = (vec![String::new()], false);
    for letter in line.chars() {
        match letter {
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(String::new()),
            other => fields.last_mut().unwrap().push(other),
        }
    }
    fields
}

/// Every file below a folder, by its path inside.
fn files(folder: &Path) -> BTreeSet<String> {
    fn gather(folder: &Path, root: &Path, found: &mut BTreeSet<String>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path: PathBuf = entry.unwrap().path();
            if path.is_dir() {
                gather(&path, root, found);
            } else {
                found.insert(path.strip_prefix(root).unwrap().to_str().unwrap().to_owned());
            }
        }
    }
    let mut found = BTreeSet::new();
    gather(folder, folder, &mut found);
    found
}

#[test]
fn tidy_tables_say_what_the_store_says() {
    let bench = finished();
    bench.ok(&["export", "small.yaml", "--to", "taken", "--as", "csv"]);
    let trials = rows(&bench.path("taken/trials.csv"));
    assert_eq!(trials.len(), 4);
    let learner = trials.iter().find(|row| row["agent"] == "dsac").unwrap();
    assert_eq!(
        (
            learner["agent.width"].as_str(),
            learner["environment.cells"].as_str(),
            learner["state"].as_str()
        ),
        ("8", "2", "ok")
    );
    let rule = trials.iter().find(|row| row["agent"] == "equal").unwrap();
    assert_eq!(
        (rule["agent.width"].as_str(), rule["agent.plugin"].as_str()),
        ("", "equal_split")
    );
    let measured = rows(&bench.path("taken/evaluations.csv"));
    for file in trial_files(&bench.path("store")) {
        let id = file.parent().unwrap().file_name().unwrap().to_str().unwrap();
        let table = contract::metrics_file::read(&file.with_file_name("metrics.parquet")).unwrap();
        let of = |phase: Phase, metric: &str| {
            let rows = table.rows.iter().filter(|row| row.phase == phase);
            rows.filter(|row| table.names[usize::from(row.metric)] == metric)
                .map(|row| row.value)
                .collect::<Vec<_>>()
        };
        let values = of(Phase::Final, "cycle_length");
        let mean = values.iter().sum::<f64>() / 3.0;
        let row = measured
            .iter()
            .find(|row| row["trial"] == id && row["phase"] == "final" && row["metric"] == "cycle_length")
            .unwrap();
        assert_eq!((row["value"].parse(), row["values"].as_str()), (Ok(mean), "3"));
    }
    let training = rows(&bench.path("taken/training.csv"));
    assert!(
        training
            .iter()
            .all(|row| row["phase"] == "train" && row["agent"] == "dsac")
    );
    assert!(
        training
            .iter()
            .any(|row| row["metric"] == "updates" || row["metric"].contains("loss"))
    );
    let described: Value =
        serde_json::from_slice(&fs::read(bench.path("taken/columns.json")).unwrap()).unwrap();
    let fields = described["tables"][0]["fields"].as_array().unwrap();
    let width = fields
        .iter()
        .find(|field| field["name"] == "agent.width")
        .unwrap();
    assert_eq!(width["type"], "integer");
    assert!(!width["description"].as_str().unwrap().is_empty());
    let metrics = described["metrics"].as_array().unwrap();
    assert!(metrics.iter().any(|metric| metric["name"] == "cycle_length"));
}

#[test]
fn the_same_study_makes_the_same_bytes_and_nothing_is_replaced() {
    let bench = finished();
    for form in ["parquet", "tensorboard"] {
        for to in ["one", "two"] {
            bench.ok(&[
                "export",
                "small.yaml",
                "--to",
                &format!("{form}-{to}"),
                "--as",
                form,
            ]);
        }
        let (one, two) = (
            bench.path(&format!("{form}-one")),
            bench.path(&format!("{form}-two")),
        );
        let names = files(&one);
        assert_eq!(names, files(&two));
        for name in &names {
            assert_eq!(
                fs::read(one.join(name)).unwrap(),
                fs::read(two.join(name)).unwrap(),
                "{name}"
            );
        }
        let answer = bench.run(&[
            "export",
            "small.yaml",
            "--to",
            &format!("{form}-one"),
            "--as",
            form,
        ]);
        assert_eq!(answer.code, 2);
        assert!(answer.err.contains("is not empty"), "{}", answer.err);
    }
    let runs = files(&bench.path("tensorboard-one"));
    assert_eq!(runs.iter().filter(|name| name.contains("tfevents")).count(), 4);
}

#[test]
fn a_trace_has_every_trial_once_and_no_two_at_once_in_a_lane() {
    let bench = finished();
    bench.ok(&["export", "small.yaml", "--to", "trace", "--as", "trace"]);
    let trace: Value = serde_json::from_slice(&fs::read(bench.path("trace/trace.json")).unwrap()).unwrap();
    let bars: Vec<&Value> = trace["traceEvents"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|event| event["ph"] == "X")
        .collect();
    assert_eq!(bars.len(), trial_files(&bench.path("store")).len());
    let number = |bar: &Value, key: &str| bar[key].as_f64().unwrap();
    for (index, one) in bars.iter().enumerate() {
        assert!(number(one, "ts") >= 0.0 && number(one, "dur") >= 0.0, "{one}");
        assert!(
            one["args"]["trial"].is_string() && one["args"]["end"] == "ok",
            "{one}"
        );
        for other in bars[..index].iter().filter(|other| other["tid"] == one["tid"]) {
            // Ends are whole seconds.
            let overlap = number(other, "ts") + number(other, "dur") - number(one, "ts");
            assert!(overlap <= 1e6 + 1.0, "{one} {other}");
        }
    }
}

#[test]
fn a_crate_has_what_the_specification_requires_and_describes_every_file() {
    let bench = finished();
    let unlicensed = bench.run(&["export", "small.yaml", "--to", "crate", "--as", "ro-crate"]);
    assert_eq!(unlicensed.code, 2, "{}", unlicensed.err);
    assert!(unlicensed.err.contains("--license"), "{}", unlicensed.err);
    let mut command = bench.command(&[
        "export",
        "small.yaml",
        "--to",
        "crate",
        "--as",
        "ro-crate",
        "--license",
        "CC-BY-4.0",
    ]);
    let output = command.env("SOURCE_DATE_EPOCH", "1769817600").output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let root = bench.path("crate");
    let metadata: Value =
        serde_json::from_slice(&fs::read(root.join("ro-crate-metadata.json")).unwrap()).unwrap();
    assert_eq!(metadata["@context"][0], "https://w3id.org/ro/crate/1.2/context");
    let graph = metadata["@graph"].as_array().unwrap();
    let entities: BTreeMap<&str, &Value> = graph
        .iter()
        .map(|entity| (entity["@id"].as_str().unwrap(), entity))
        .collect();
    assert_eq!(entities.len(), graph.len(), "no entity is described twice");
    holds_of_root(&entities);
    // Whatever is referred to inside the crate is described there, and nothing else is.
    let mut referred = BTreeSet::new();
    references(&metadata["@graph"], &mut referred);
    for id in referred.iter().filter(|id| !id.contains("://")) {
        assert!(entities.contains_key(id.as_str()), "{id} is not described");
    }
    let described: BTreeSet<String> = graph
        .iter()
        .filter(|entity| entity["@type"] == "File")
        .map(|entity| entity["@id"].as_str().unwrap().to_owned())
        .collect();
    let mut there = files(&root);
    there.remove("ro-crate-metadata.json");
    assert_eq!(described, there);
    assert!(
        there.contains("results/index.html") && there.contains("small.yaml"),
        "{there:?}"
    );
    for entity in graph.iter().filter(|entity| entity["@type"] == "File") {
        let size = fs::metadata(root.join(entity["@id"].as_str().unwrap()))
            .unwrap()
            .len();
        assert_eq!(entity["contentSize"], size.to_string());
        assert_eq!(entity["sha256"].as_str().unwrap().len(), 64);
    }
    holds_of_actions(&entities);
}

/// Requirements of sections 3 and 4 of the specification on the descriptor and the root.
fn holds_of_root(entities: &BTreeMap<&str, &Value>) {
    let descriptor = entities["ro-crate-metadata.json"];
    assert_eq!(descriptor["@type"], "CreativeWork");
    assert_eq!(descriptor["about"]["@id"], "./");
    assert_eq!(descriptor["conformsTo"]["@id"], "https://w3id.org/ro/crate/1.2");
    let root = entities["./"];
    assert_eq!(root["@type"], "Dataset");
    assert_eq!(root["name"], "Two ways to share a load");
    assert!(!root["description"].as_str().unwrap().is_empty());
    assert_eq!(root["datePublished"], "2026-01-31");
    let license = entities[root["license"]["@id"].as_str().unwrap()];
    assert_eq!(license["@id"], "https://spdx.org/licenses/CC-BY-4.0");
    assert!(license["name"].is_string() && license["description"].is_string());
    assert!(!root["hasPart"].as_array().unwrap().is_empty());
}

/// Requirements of the profile of process runs on actions.
fn holds_of_actions(entities: &BTreeMap<&str, &Value>) {
    let actions: Vec<&&Value> = entities
        .values()
        .filter(|entity| entity["@type"] == "CreateAction")
        .collect();
    assert_eq!(actions.len(), 1, "one program computed all trials");
    let action = actions[0];
    let program = entities[action["instrument"]["@id"].as_str().unwrap()];
    assert_eq!(program["@type"], "SoftwareApplication");
    assert!(program["name"].is_string() && program["softwareVersion"].is_string());
    assert_eq!(action["object"][0]["@id"], "small.yaml");
    assert_eq!(action["result"].as_array().unwrap().len(), 4);
    let (start, end) = (
        action["startTime"].as_str().unwrap(),
        action["endTime"].as_str().unwrap(),
    );
    assert!(start < end && end.ends_with('Z'), "{start} {end}");
    assert_eq!(entities["./"]["mentions"][0]["@id"], action["@id"]);
}

/// Every `@id` that stands in the place of an entity.
fn references(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(entries) if entries.len() == 1 && entries.contains_key("@id") => {
            found.insert(entries["@id"].as_str().unwrap().to_owned());
        }
        Value::Object(entries) => entries.values().for_each(|value| references(value, found)),
        Value::Array(items) => items.iter().for_each(|value| references(value, found)),
        _ => {}
    }
}

#[test]
fn what_is_missing_is_said_and_a_study_without_numbers_is_refused() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let nothing = bench.run(&["export", "small.yaml", "--to", "taken", "--as", "csv"]);
    assert_eq!(nothing.code, 4, "{}", nothing.err);
    assert!(!bench.path("taken").exists());
    bench.ok(&["worker", "small.yaml", "--only", "equal"]);
    let part = bench.run(&["export", "small.yaml", "--to", "taken", "--as", "csv"]);
    assert_eq!(part.code, 106);
    assert!(part.out.contains("2 of 4 trials in `taken`"), "{}", part.out);
    assert_eq!(rows(&bench.path("taken/trials.csv")).len(), 4);
}
