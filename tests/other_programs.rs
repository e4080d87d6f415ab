//! Other programs read what this one writes: metrics with Polars for Python, policies with NumPy, datasets
//! with Minari, manifests with a validator.

use crate::{
    needs,
    program::{Bench, repository, trial_files},
};
use plugins::registry;
use std::{
    path::{Path, PathBuf},
    process::Command,
};

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
protocol: { train_evaluate: { steps: 256, environments: 8, evaluate_every: 128, episodes: 2, \
final_episodes: 4, trace_episodes: 1 } }
seeds: 1
";

/// Lets a script in `tests/python` hold what the arguments name, in a Python with these modules.
pub(crate) fn check(script: &str, modules: &str, arguments: &[String]) {
    let Some(python) = needs::python(modules) else {
        return;
    };
    let script = repository().join("tests/python").join(script);
    let output = Command::new(python).arg(script).args(arguments).output().unwrap();
    assert!(
        output.status.success(),
        "{}\n{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn polars_for_python_reads_the_metrics() {
    let bench = Bench::new();
    bench.write("readable.yaml", STUDY);
    bench.ok(&["run", "readable.yaml"]);
    let files = trial_files(&bench.path("store"));
    let metrics = files
        .iter()
        .map(|file| {
            file.with_file_name("metrics.parquet")
                .to_string_lossy()
                .into_owned()
        })
        .collect::<Vec<_>>();
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

const GATHERED: &str = "
study: gathered
title: Datasets to be read by other programs
source: made for this test
environments: { cells: { battery: { cells: 3 } } }
prepare:
  trained: { environment: cells, agent: { dirichlet_sac: { width: 8, batch_size: 16, learning_starts: 64 } },
             protocol: { train_evaluate: { steps: 128, environments: 8, evaluate_every: 0, final_episodes: \
             1 } } }
  by_rule: { environment: cells, agent: { equal_split: {} }, protocol: { gather: { episodes: 3 } } }
  by_trained: { environment: cells, agent: { policy: { from: trained } }, protocol: { gather: { episodes: 4 \
  } } }
agents: { learner: { behaviour_cloning: { width: 8 } } }
protocol:
  offline_fit: { datasets: [{ from: by_rule }, { from: by_trained }], steps: 4, batch: 8, evaluate_every: 0 }
seeds: 1
";

#[test]
fn minari_reads_what_was_gathered() {
    let bench = Bench::new();
    bench.write("gathered.yaml", GATHERED);
    bench.ok(&["run", "gathered.yaml"]);
    let mut trials = Vec::new();
    for file in trial_files(&bench.path("store")) {
        let trial = file.parent().unwrap();
        if let Ok(dataset) = contract::Dataset::read(trial) {
            let expected = serde_json::json!({ "episodes": dataset.episodes }).to_string();
            std::fs::write(trial.join("expected.json"), expected).unwrap();
            trials.push(trial.to_string_lossy().into_owned());
        }
    }
    assert_eq!(trials.len(), 2, "two trials gather");
    check("read_dataset.py", "minari, pyarrow, PIL", &trials);
}

/// Numbers and texts that readers of an older YAML, or of a looser one, take for something else.
const AMBIGUOUS: &str = r##"
study: ambiguous
title: "1e-6"
source: "yes"
deviations: ["1:30", "0x1f", "0o17", "2001-01-01", "null", "~", "=", "<<", "- a", "a: b", "# c", " led", "trailed ", "two\nlines",
             "a tab\t", "\u00e9 \u6f22 \U0001F600", "1_000", ".inf", "1.", "+1", "[a]", "{a: b}", "!tag", "&a", "*a", "%x", "@x",
             "`x`", "'", "\"", "", "on", "N"]
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  dsac:
    dirichlet_sac:
      { actor_learning_rate: 1e-6, critic_learning_rate: 1.5e-7, first_temperature: 100,
          target_entropy: { nats: 1.0e+16 } }
protocol: { train_evaluate: { steps: 64, environments: 8, episodes: 1, final_episodes: 1 } }
"##;

#[test]
fn another_reader_of_yaml_finds_the_same_values_in_a_resolved_study() {
    let bench = Bench::new();
    let mut studies = vec![bench.write("ambiguous.yaml", AMBIGUOUS)];
    studies.extend(
        crate::experiments::studies_with("python3")
            .into_iter()
            .map(PathBuf::from),
    );
    let registry = registry();
    let load = |path: &Path| study::load(path, &registry, &study::Options::default()).unwrap();
    let ids = |path: &Path| {
        load(path)
            .plan()
            .trials
            .into_iter()
            .map(|trial| trial.id.clone())
            .collect::<Vec<_>>()
    };
    let mut files = Vec::new();
    for (number, study) in studies.iter().enumerate() {
        let text = bench.ok(&["resolve", study.to_str().unwrap()]);
        let resolved = bench.write(&format!("resolved-{number}.yaml"), &text);
        assert_eq!(ids(study), ids(&resolved), "{}", study.display());
        let mut sources = document::diagnostic::Sources::default();
        let source = sources.add_file("resolved", &text);
        let values = document::parse(&sources, source, &text).unwrap().to_value();
        let values = bench.write(&format!("values-{number}.json"), &values.to_string());
        files.extend([resolved, values].map(|path| path.to_string_lossy().into_owned()));
    }
    assert!(
        std::fs::read_to_string(bench.path("values-0.json"))
            .unwrap()
            .contains("1e-6"),
        "the ambiguous one is among them"
    );
    check("compare_values.py", "yaml", &files);
}

#[test]
fn a_kubernetes_manifest_holds_against_the_schema_of_its_kind() {
    let bench = Bench::new();
    bench.write("readable.yaml", STUDY);
    bench.write(
        "regimen.toml",
        "[kubernetes]\nimage = \"registry.example/regimen:1\"\nclaim = \"shared\"\nmemory_mb = 2000\n",
    );
    bench.ok(&[
        "submit",
        "readable.yaml",
        "--executor",
        "kubernetes",
        "--dry-run",
        "--out",
        "job.yaml",
    ]);
    let schema = repository().join("tests/fixtures/kubernetes/job-batch-v1.json");
    let files = [bench.path("job.yaml"), schema].map(|path| path.to_string_lossy().into_owned());
    check("check_manifest.py", "jsonschema, yaml", &files);
    let live = bench.run(&["submit", "readable.yaml", "--executor", "kubernetes"]);
    assert_eq!(live.code, 2);
    assert!(live.err.contains("kubectl apply"), "{}", live.err);
}

#[test]
fn the_schema_for_editors_takes_every_study_as_it_is_written() {
    let bench = Bench::new();
    let schema = bench.write("schema.json", &bench.ok(&["schema"]));
    let files = crate::experiments::every_study();
    let schema = schema.to_string_lossy().into_owned();
    check(
        "check_study_schema.py",
        "jsonschema, yaml",
        &[vec![schema], files].concat(),
    );
}
