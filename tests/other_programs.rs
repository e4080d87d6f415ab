//! Other programs read what this one writes: metrics with Polars for Python, policies with NumPy, manifests with a validator.

use crate::program::{Bench, repository, trial_files};
use std::process::Command;

const STUDY: &str = "
study: readable
title: A study to be read by other programs
source: made for this test
environments:
  cells: { battery: { cells: 4 } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64 } }
  alike: { dirichlet_sac: { network: equivariant, width: 16, batch_size: 16, learning_starts: 64 } }
  sac: { gaussian_softmax_sac: { width: 16, batch_size: 16, learning_starts: 64 } }
protocol: { train_evaluate: { steps: 256, environments: 8, evaluate_every: 128, episodes: 2, final_episodes: 4, trace_episodes: 1 } }
seeds: 1
";

/// A Python with the modules, or `None` (which the caller says).
fn python(modules: &str) -> Option<&'static str> {
    let candidates = [concat!(env!("CARGO_MANIFEST_DIR"), "/target/python/bin/python"), "python3"];
    candidates.into_iter().find(|python| {
        Command::new(python).args(["-c", &format!("import {modules}")]).output().is_ok_and(|output| output.status.success())
    })
}

fn check(script: &str, modules: &str, arguments: &[String]) {
    let Some(python) = python(modules) else {
        assert!(std::env::var_os("CI").is_none(), "no Python with {modules}: .ci/run installs it");
        return;
    };
    let script = repository().join("tests/python").join(script);
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}\n{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
}

#[test]
fn polars_for_python_reads_the_metrics() {
    let bench = Bench::new();
    bench.write("readable.yaml", STUDY);
    bench.ok(&["run", "readable.yaml"]);
    let files = trial_files(&bench.path("store"));
    let metrics =
        files.iter().map(|file| file.with_file_name("metrics.parquet").to_string_lossy().into_owned()).collect::<Vec<_>>();
    assert_eq!(metrics.len(), 4);
    check("read_metrics.py", "polars", &metrics);
}

#[test]
fn numpy_evaluates_an_exported_policy_to_the_same_allocation() {
    let bench = Bench::new();
    bench.write("readable.yaml", STUDY);
    bench.ok(&["run", "readable.yaml"]);
    let policies: Vec<String> = trial_files(&bench.path("store"))
        .iter()
        .map(|file| file.with_file_name("policy.safetensors"))
        .filter(|file| file.exists())
        .map(|file| file.to_string_lossy().into_owned())
        .collect();
    assert_eq!(policies.len(), 3, "three agents learn");
    check("evaluate_policy.py", "numpy, polars", &policies);
}

#[test]
fn a_kubernetes_manifest_holds_against_the_schema_of_its_kind() {
    let bench = Bench::new();
    bench.write("readable.yaml", STUDY);
    bench.write("regimen.toml", "[kubernetes]\nimage = \"registry.example/regimen:1\"\nclaim = \"shared\"\nmemory_mb = 2000\n");
    bench.ok(&["submit", "readable.yaml", "--executor", "kubernetes", "--dry-run", "--out", "job.yaml"]);
    let schema = repository().join("tests/fixtures/kubernetes/job-batch-v1.json");
    let files = [bench.path("job.yaml"), schema].map(|path| path.to_string_lossy().into_owned());
    check("check_manifest.py", "jsonschema, yaml", &files);
    let live = bench.run(&["submit", "readable.yaml", "--executor", "kubernetes"]);
    assert_eq!(live.code, 2);
    assert!(live.err.contains("kubectl apply"), "{}", live.err);
}
