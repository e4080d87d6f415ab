//! A store of many metric rows, for timing tables and curves over it.
//!
//! usage: rows FOLDER SEEDS ROWS
//!
//! Writes `study.yaml` and a store in which every trial of it (ten agents, SEEDS seeds) has ended with ROWS
//! rows: a learning curve of 50 points with the same number of episodes at each. Prints one line of JSON.

use contract::{
    Phase, Recorder, metrics_file,
    trial_end::{EndState, TrialEnd},
};

use execution::store::{Store, TrialFile};
use rand::Rng as _;
use std::{collections::BTreeMap, path::Path};

const POINTS: u64 = 50;

#[expect(clippy::print_stdout, reason = "a benchmark prints its figure")]
fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let [folder, seeds, rows] = words.as_slice() else {
        return println!("{{}}");
    };
    let (folder, rows) = (Path::new(folder), rows.parse::<u64>().unwrap());
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("study.yaml"), study(seeds)).unwrap();
    let trials = fill(&folder.join("study.yaml"), &folder.join("store"), rows);
    println!(
        "{}",
        serde_json::json!({ "trials": trials, "rows": trials as u64 * rows })
    );
}

fn study(seeds: &str) -> String {
    let agents: Vec<String> = (0..10)
        .map(|index| {
            format!(
                "  rule_{index}: {{ rank_rule: {{ weights: [0.{index}, 0.{}] }} }}\n",
                10 - index
            )
        })
        .collect();
    let agents = agents.concat().replace("[0.0, 0.10]", "[0.05, 0.95]");
    format!(
        "study: rows\nenvironments: {{ two: {{ battery: {{ cells: 2 }} }} }}\nagents:\n{agents}\
         protocol: {{ train_evaluate: {{ steps: 0, final_episodes: 1 }} }}\nseeds: {seeds}\n\
         tables:\n  lengths: {{ comparison: {{ rows: agent, value: cycle_length, relative_to: rule_5, as: \
         ratio }} }}\n\
         figures:\n  curve: {{ learning_curve: {{ metric: cycle_length, band: sd }} }}\n"
    )
}

/// Acknowledges every trial of a study with its rows, without the flushes that a run pays for.
fn fill(study: &Path, root: &Path, rows: u64) -> usize {
    let registry = plugins::registry();
    let study = study::load(study, &registry, &study::Options::default())
        .unwrap_or_else(|problems| panic!("{problems:?}"));
    let (store, plan) = (Store::at(root), study.plan());
    let mut rng = contract::random::stream(&["rows"]);
    for trial in &plan.trials {
        let mut record = Recorder::default();
        for row in 0..rows {
            let (step, episode) = (row * POINTS / rows * 1000, row % (rows / POINTS).max(1));
            record.add(
                Phase::Evaluate,
                step,
                episode,
                0,
                "cycle_length",
                100.0 + rng.random::<f64>(),
            );
        }
        record.add(
            Phase::Final,
            POINTS * 1000,
            0,
            0,
            "cycle_length",
            100.0 + rng.random::<f64>(),
        );
        let bytes = metrics_file::encode(&record, &trial.id).unwrap();
        let end = TrialEnd {
            state: EndState::Ok,
            reason: String::new(),
            wall_s: 1.0,
            decision_s: None,
            device: None,
            digest: contract::digest::of_bytes(&bytes),
        };
        let folder = store.folder(&trial.id);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("metrics.parquet"), bytes).unwrap();
        std::fs::write(
            folder.join("trial.json"),
            TrialFile::new(trial, end, BTreeMap::new()).to_bytes().unwrap(),
        )
        .unwrap();
    }
    plan.trials.len()
}
