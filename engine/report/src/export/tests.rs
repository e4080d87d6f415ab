//! A small study in every form, read back.

use super::*;
use contract::{parquet::ParquetTable as Read, recorder::Phase, trial_end::EndState};
use std::path::PathBuf;
use testing::{
    synthetic::{ended, trial},
    toys::toys,
};

fn results() -> Vec<TrialResult> {
    let rows = |base: f64| {
        vec![
            (Phase::Train, 10, 0, "loss", base / 3.0),
            (Phase::Evaluate, 10, 0, "return", base),
            (Phase::Evaluate, 10, 1, "return", base + 1.0),
            (Phase::Final, 20, 0, "return", -base),
        ]
    };
    vec![
        trial("cells", "equal", "", 0, &rows(1.0)),
        trial("cells", "=learner", "rate=0.1", 1, &rows(4.0)),
        ended(
            trial("cells", "equal", "", 1, &Vec::new()),
            EndState::Nan,
            "=told",
        ),
    ]
}

/// The study with these results.
fn with<T>(results: &[TrialResult], then: impl FnOnce(&Subject<'_>) -> T) -> T {
    let registry = toys();
    let units = BTreeMap::from([("return".to_owned(), "s".to_owned())]);
    let metrics = [Metric::new("return", "s", "time until the end")];
    then(&Subject {
        name: "small",
        title: "A small study",
        source: "",
        metrics: &metrics,
        units: &units,
        registry: &registry,
        trials: results.iter().map(|result| (result, None)).collect(),
    })
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("taken");
    (folder, path)
}

#[test]
fn parquet_tables_hold_means_by_step_with_typed_columns() {
    let (results, (_guard, path)) = (results(), folder());
    let names = with(&results, |subject| write_tables(subject, false, &path).unwrap());
    assert_eq!(
        names,
        [
            "evaluations.parquet",
            "training.parquet",
            "trials.parquet",
            "columns.json"
        ]
    );
    let file = path.join("evaluations.parquet");
    let table = Read::decode(fs::read(&file).unwrap(), &file).unwrap();
    assert_eq!(
        table.f64s("value").unwrap().collect::<Vec<_>>(),
        [Some(1.5), Some(-1.0), Some(4.5), Some(-4.0)]
    );
    assert_eq!(
        table.u64s("values").unwrap().collect::<Vec<_>>(),
        [Some(2), Some(1), Some(2), Some(1)]
    );
    assert_eq!(table.texts("unit").unwrap().collect::<Vec<_>>(), [Some("s"); 4]);
    assert_eq!(
        table.u64s("seed").unwrap().collect::<Vec<_>>(),
        [Some(0), Some(0), Some(1), Some(1)]
    );
    let trials = path.join("trials.parquet");
    let trials = Read::decode(fs::read(&trials).unwrap(), &trials).unwrap();
    assert_eq!(
        trials.texts("reason").unwrap().collect::<Vec<_>>(),
        [None, None, Some("=told")]
    );
}

#[test]
fn every_column_is_described_and_every_described_column_is_there() {
    let (results, (_guard, path)) = (results(), folder());
    with(&results, |subject| write_tables(subject, true, &path).unwrap());
    let described: Value = serde_json::from_slice(&fs::read(path.join("columns.json")).unwrap()).unwrap();
    for table in described["tables"].as_array().unwrap() {
        let mut reader = csv::Reader::from_path(path.join(table["file"].as_str().unwrap())).unwrap();
        let header: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
        let fields = table["fields"].as_array().unwrap();
        let names: Vec<&str> = fields
            .iter()
            .map(|field| field["name"].as_str().unwrap())
            .collect();
        assert_eq!(header, names);
        for name in [
            "trial",
            "environment",
            "agent",
            "seed",
            "environment.plugin",
            "agent.version",
        ] {
            assert!(names.contains(&name), "{name}: {names:?}");
        }
        assert_eq!(reader.records().count() as u64, table["rows"].as_u64().unwrap());
        assert!(fields.iter().all(|field| {
            ["string", "integer", "number", "boolean"].contains(&field["type"].as_str().unwrap())
        }));
    }
    let text = fs::read_to_string(path.join("evaluations.csv")).unwrap();
    assert!(
        text.contains(",'=learner,") && !text.contains(",=learner,"),
        "{text}"
    );
    assert!(text.contains(",-4,"), "numbers keep their sign: {text}");
}

#[test]
fn a_run_of_tensorboard_holds_scalars_by_step() {
    let (results, (_guard, path)) = (results(), folder());
    with(&results, |subject| write_event_files(subject, &path).unwrap());
    let runs: Value = serde_json::from_slice(&fs::read(path.join("runs.json")).unwrap()).unwrap();
    let runs = runs["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 2, "a trial that did not end ok has no run");
    let run = path.join(runs[1]["folder"].as_str().unwrap());
    let file = fs::read_dir(&run).unwrap().next().unwrap().unwrap();
    assert!(file.file_name().to_string_lossy().contains("tfevents"));
    let events = imported::event_file::events(&fs::read(file.path()).unwrap()).unwrap();
    assert_eq!(events[0].file_version.as_deref(), Some("brain.Event:2"));
    let scalars: Vec<(i64, String, f32)> = events[1..]
        .iter()
        .flat_map(|event| {
            let values = &event.summary.as_ref().unwrap().value;
            values
                .iter()
                .map(|value| (event.step, value.tag.clone(), value.simple_value.unwrap()))
        })
        .collect();
    assert_eq!(
        scalars,
        [
            (10, "train/loss".to_owned(), 4.0 / 3.0),
            (10, "evaluate/return".to_owned(), 4.5),
            (20, "final/return".to_owned(), -4.0)
        ]
    );
}

#[test]
fn what_a_crate_must_have_it_has() {
    let (results, (_guard, path)) = (results(), folder());
    fs::create_dir_all(path.join("trials/a")).unwrap();
    fs::write(path.join("my study.yaml"), "study: small\n").unwrap();
    fs::write(path.join("trials/a/metrics.parquet"), "numbers").unwrap();
    let piece = |path: &str, trial: Option<&str>| Piece {
        path: path.into(),
        about: "a file".into(),
        trial: trial.map(Into::into),
    };
    let described = Crate {
        folder: path.clone(),
        pieces: vec![
            piece("my study.yaml", None),
            piece("trials/a/metrics.parquet", Some("a")),
        ],
        study: "my study.yaml".into(),
        license: "CC-BY-4.0".into(),
        date: "2026-01-31".into(),
    };
    with(&results, |subject| described.describe(subject).unwrap());
    let metadata: Value =
        serde_json::from_slice(&fs::read(path.join("ro-crate-metadata.json")).unwrap()).unwrap();
    let graph = metadata["@graph"].as_array().unwrap();
    let entity = |id: &str| graph.iter().find(|it| it["@id"] == id).unwrap();
    assert_eq!(entity("ro-crate-metadata.json")["about"]["@id"], "./");
    assert_eq!(
        entity("./")["license"]["@id"],
        "https://spdx.org/licenses/CC-BY-4.0"
    );
    assert_eq!(entity("my%20study.yaml")["name"], "my study.yaml");
    // Of `printf numbers | sha256sum`.
    assert_eq!(
        entity("trials/a/metrics.parquet")["sha256"],
        "f3c7807d475073ba009bf4801b2d934e9f0126cb96dd19a27dbffcae23a7f5a3"
    );
    assert_eq!(
        entity("trials/a/")["hasPart"][0]["@id"],
        "trials/a/metrics.parquet"
    );
}
