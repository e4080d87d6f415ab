//! Episodes of a stored trial are taken away as a dataset that Minari reads, and the book's lines about exports work.

use crate::{
    needs,
    other_programs::check,
    program::{Bench, repository, trial_files},
};
use contract::{Dataset, End, dataset::Episode};
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

const LEARNED: &str = "
study: learned
environments: { cells: { battery: { cells: 3 } } }
agents: { dsac: { dirichlet_sac: { width: 8, batch_size: 16, learning_starts: 64 } } }
protocol: { train_evaluate: { steps: 128, environments: 8, evaluate_every: 0, final_episodes: 1 } }
seeds: 1
";

const GATHERED: &str = "
study: gathered
environments: { cells: { battery: { cells: 3 } } }
prepare:
  by_rule: { environment: cells, agent: { equal_split: {} }, protocol: { gather: { episodes: 3 } } }
agents: { learner: { behaviour_cloning: { width: 8 } } }
protocol: { offline_fit: { datasets: [{ from: by_rule }], steps: 4, batch: 8, evaluate_every: 0 } }
seeds: 1
";

const RECORDS: &str = "
study: records
environments: { cracks: { inspection_planning: { components: 3, required: 2, horizon: 4 } } }
prepare:
  records: { environment: cracks, agent: { interval_inspection: { interval: 2, components: 2 } }, protocol: { gather: { episodes: 3 } } }
agents: { learner: { value_decomposition: { width: 8, conservatism: 1.0, learning_starts: 8, batch_size: 8 } } }
protocol: { offline_fit: { datasets: [{ from: records }], steps: 4, batch: 8, evaluate_every: 0, final_episodes: 1 } }
seeds: 1
";

const PARTICLES: &str = "
study: particles
environments: { particles: { particles: {} } }
agents: { walkers: { random_action: {} } }
protocol: { train_evaluate: { steps: 0, final_episodes: 1, trace_episodes: 0 } }
seeds: 1
";

/// Folder of the only trial in the store whose agent is `plugin`.
fn trial(bench: &Bench, plugin: &str) -> PathBuf {
    let of_agent = |file: &PathBuf| {
        let text: serde_json::Value = serde_json::from_slice(&fs::read(file).unwrap()).unwrap();
        text["key"]["agent"]["plugin"] == plugin
    };
    let file = trial_files(&bench.path("store"))
        .into_iter()
        .find(of_agent)
        .unwrap();
    file.parent().unwrap().to_path_buf()
}

fn id(trial: &Path) -> &str {
    trial.file_name().unwrap().to_str().unwrap()
}

/// Lets Minari hold every number of the dataset in `<folder>/dataset` against what the engine reads of it.
fn hold(folder: &Path) -> Dataset {
    let dataset = Dataset::read_from(&folder.join("dataset")).unwrap();
    let expected = serde_json::json!({ "episodes": dataset.episodes }).to_string();
    fs::write(folder.join("expected.json"), expected).unwrap();
    check(
        "read_dataset.py",
        "minari, pyarrow, PIL",
        &[folder.to_string_lossy().into_owned()],
    );
    dataset
}

/// The cells of one column of a rollout, but for the row of the start.
fn column(csv: &str, name: &str) -> Vec<f64> {
    let mut lines = csv.lines();
    let at = lines
        .next()
        .unwrap()
        .split(',')
        .position(|cell| cell == name)
        .unwrap();
    lines
        .filter_map(|line| line.split(',').nth(at)?.parse().ok())
        .collect()
}

/// The arguments that take three episodes away that a stored policy plays.
fn played<'a>(trial: &'a Path, to: &'a str) -> [&'a str; 9] {
    [
        "export",
        "--minari",
        id(trial),
        "--episodes",
        "3",
        "--seed",
        "5",
        "--to",
        to,
    ]
}

/// A stored policy, trained for a moment.
fn learned() -> (Bench, PathBuf) {
    let bench = Bench::new();
    bench.write("learned.yaml", LEARNED);
    bench.ok(&["run", "learned.yaml"]);
    let folder = trial(&bench, "dirichlet_sac");
    (bench, folder)
}

/// Holds an episode of a dataset against what `rollout` writes of it.
fn is_rolled_out(bench: &Bench, trial: &Path, seed: u64, dataset: &Dataset, episode: &Episode) {
    let seed = seed.to_string();
    bench.ok(&[
        "rollout",
        "--trial",
        id(trial),
        "--seed",
        &seed,
        "--out",
        "rollout.csv",
    ]);
    let csv = fs::read_to_string(bench.path("rollout.csv")).unwrap();
    assert_eq!(column(&csv, "reward"), episode.rewards);
    let names = dataset.interface.seats[0].action.names();
    for (at, name) in names.iter().enumerate() {
        let played: Vec<f64> = episode.actions.iter().map(|action| action[at]).collect();
        assert_eq!(column(&csv, name), played, "{name}");
    }
    let word = match episode.end {
        End::Terminated => "terminated",
        End::Truncated => "truncated",
    };
    assert!(csv.trim_end().ends_with(word), "{csv}");
}

#[test]
fn what_a_policy_plays_is_what_a_rollout_writes_and_minari_reads_it() {
    let (bench, folder) = learned();
    let said = bench.ok(&played(&folder, "taken/dataset"));
    assert!(said.contains("3 episodes of "), "{said}");
    let dataset = hold(&bench.path("taken"));
    assert_eq!(dataset.interface.seats[0].observation.names().len(), 7);
    for (episode, seed) in dataset.episodes.iter().zip(5..) {
        is_rolled_out(&bench, &folder, seed, &dataset, episode);
    }
    bench.ok(&played(&folder, "again"));
    assert_eq!(Dataset::read_from(&bench.path("again")).unwrap(), dataset);
}

#[test]
fn minari_lists_and_loads_what_is_exported_below_its_root() {
    let (bench, folder) = learned();
    let said = bench.ok(&played(&folder, "datasets/regimen/pack-v0"));
    assert!(said.contains("its id is `regimen/pack-v0`"), "{said}");
    let in_root = [
        &played(&folder, "datasets/alone-v1")[..],
        &["--minari-root", "datasets"],
    ]
    .concat();
    assert!(bench.ok(&in_root).contains("its id is `alone-v1`"));
    assert!(
        bench
            .ok(&played(&folder, "taken"))
            .contains("Minari lists it by no name")
    );
    for id in ["regimen/pack-v0", "alone-v1"] {
        let data = bench.path("datasets").join(id).join("data");
        let text = fs::read_to_string(data.join("metadata.json")).unwrap();
        let metadata: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(metadata["dataset_id"], id);
        let size = |episode: u64, file: &str| {
            fs::metadata(data.join(episode.to_string()).join(file))
                .unwrap()
                .len()
        };
        let bytes: u64 = (0..3)
            .map(|at| size(at, "part-0.parquet") + size(at, "metadata.json"))
            .sum();
        assert_eq!(metadata["dataset_size"], bytes as f64 / 1e6);
    }
    let root = bench.path("datasets").to_string_lossy().into_owned();
    check(
        "list_datasets.py",
        "minari, pyarrow, PIL",
        &[root, "regimen/pack-v0".into(), "alone-v1".into()],
    );
}

#[test]
fn episodes_are_counted_by_who_asks_and_nothing_is_written_over() {
    let (bench, folder) = learned();
    let refused = |arguments: &[&str], said: &str| {
        let answer = bench.run(arguments);
        assert_eq!(answer.code, 2, "{}", answer.err);
        assert!(answer.err.contains(said), "{}", answer.err);
    };
    refused(
        &["export", "--minari", id(&folder), "--to", "third"],
        "say with `--episodes` how many",
    );
    bench.ok(&played(&folder, "there"));
    refused(&played(&folder, "there"), "is not empty");
    for of_a_study in ["--profile", "--set", "--seeds", "--only", "--license"] {
        let value = if of_a_study == "--seeds" { "1" } else { "a=1" };
        for taken in ["--minari", "--onnx"] {
            let arguments = ["export", taken, id(&folder), "--to", "no", of_a_study, value];
            refused(&arguments, "cannot be used with");
        }
    }
}

#[test]
fn what_a_trial_gathered_is_copied_and_a_changed_byte_is_found() {
    let bench = Bench::new();
    bench.write("gathered.yaml", GATHERED);
    bench.ok(&["run", "gathered.yaml"]);
    let folder = trial(&bench, "equal_split");
    bench.ok(&["export", "--minari", &id(&folder)[..10], "--to", "taken/dataset"]);
    assert_eq!(hold(&bench.path("taken")), Dataset::read(&folder).unwrap());
    for file in ["interface.json", "data/2/metadata.json", "data/2/part-0.parquet"] {
        let read = |root: &Path| fs::read(root.join("dataset").join(file)).unwrap();
        assert_eq!(read(&bench.path("taken")), read(&folder), "{file}");
    }
    let more = bench.run(&[
        "export",
        "--minari",
        id(&folder),
        "--episodes",
        "2",
        "--to",
        "more",
    ]);
    assert_eq!(more.code, 2);
    assert!(
        more.err.contains("is taken as it is; leave out `--episodes`"),
        "{}",
        more.err
    );
    let part = folder.join("dataset/data/1/part-0.parquet");
    let mut bytes = fs::read(&part).unwrap();
    bytes[40] ^= 1;
    fs::write(&part, bytes).unwrap();
    let damaged = bench.run(&["export", "--minari", id(&folder), "--to", "damaged"]);
    assert_eq!(damaged.code, 2);
    assert!(
        damaged.err.contains("part-0.parquet` is damaged or not there"),
        "{}",
        damaged.err
    );
    assert!(!bench.path("damaged").exists());
}

#[test]
fn a_team_is_one_agent_to_minari_and_its_seats_come_apart_here() {
    let bench = Bench::new();
    for (file, study) in [("records.yaml", RECORDS), ("particles.yaml", PARTICLES)] {
        bench.write(file, study);
        bench.ok(&["run", file]);
    }
    let folder = trial(&bench, "interval_inspection");
    bench.ok(&["export", "--minari", id(&folder), "--to", "choices/dataset"]);
    let choices = hold(&bench.path("choices"));
    let transitions = choices.transitions().unwrap();
    assert_eq!(transitions.len(), 12);
    for one in &transitions {
        assert!(one.action.len() == 3 && one.rewards.len() == 3 && !one.observation.state.is_empty());
    }
    // An agent that learned from it leaves a policy as any other.
    let learner = trial(&bench, "value_decomposition");
    bench.ok(&["export", "--onnx", id(&learner), "--to", "graphs"]);

    let folder = trial(&bench, "random_action");
    bench.ok(&[
        "export",
        "--minari",
        id(&folder),
        "--episodes",
        "2",
        "--to",
        "boxes/dataset",
    ]);
    let boxes = hold(&bench.path("boxes"));
    let seats = boxes.interface.seats.len();
    assert!(seats > 1);
    assert!(
        boxes
            .transitions()
            .unwrap()
            .iter()
            .all(|one| one.action.len() == seats)
    );
}

#[test]
fn the_lines_of_the_book_use_what_was_taken_away() {
    let page = fs::read_to_string(repository().join("docs/src/exporting.md")).unwrap();
    let (bench, folder) = learned();
    bench.ok(&["export", "--onnx", id(&folder), "--to", "policy"]);
    bench.ok(&[
        "export",
        "--minari",
        id(&folder),
        "--episodes",
        "2",
        "--to",
        "datasets/regimen/pack-v0",
    ]);
    let blocks = page
        .split("```python\n")
        .skip(1)
        .map(|rest| rest.split("```").next().unwrap());
    let script = bench.write("book.py", &blocks.collect::<Vec<_>>().concat());
    let Some(python) = needs::python("onnxruntime, minari, pyarrow, PIL") else {
        return;
    };
    let mut command = Command::new(python);
    command
        .arg(script)
        .current_dir(bench.path(""))
        .env("MINARI_DATASETS_PATH", bench.path("datasets"));
    let output = command.output().unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("weight_1") && said.contains("2 episodes"), "{said}");
}
