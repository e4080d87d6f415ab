//! The simulators as a Python package: the bits of the registry, of a rollout and of a trial, what is refused and in
//! which words, and the interfaces that Gymnasium and PettingZoo check.

use crate::{
    book::blocks,
    contracts::ready_made,
    other_programs::check,
    program::{Bench, repository, trial_files},
};
use contract::{Action, End, Environment, Rng, Seat, Space, choice, random};
use plugins::registry;
use rand::Rng as _;
use serde_json::{Value, json};

const MODULES: &str = "regimen, gymnasium, pettingzoo";
/// Steps of an episode that are compared.
const STEPS: usize = 60;

/// Configs that are tried: every environment with its defaults, where these cost little, and what is drawn otherwise.
fn configs() -> Vec<(&'static str, Value)> {
    let small = json!({ "critic_steps": 1, "critic_steps_per_generator_step": 1, "batch": 2, "generator_batch": 2,
        "generator_channels": 2, "discriminator_channels": 2, "latent": 2, "scored_images": 10, "reference_images": 10,
        "splits": 1, "size": 8 });
    let defaults = ready_made(&registry())
        .filter(|name| *name != "generator_search")
        .map(|name| (name, json!({})))
        .collect::<Vec<_>>();
    let others = [
        ("generator_search", small),
        ("battery", json!({ "cells": 2, "decision_interval_s": 20 })),
        ("inspection_planning", json!({ "preset": "2_of_3" })),
        ("particles", json!({ "scenario": "predator_prey" })),
    ];
    defaults.into_iter().chain(others).collect()
}

/// The numbers by which Python asks for an action, and the action.
fn drawn(seats: &[Seat], rng: &mut Rng) -> (Vec<f64>, Action) {
    let of_seat = |seat: &Seat| match &seat.action {
        Space::Box(channels) => {
            let mut entry = |low: f64, high: f64| rng.random_range(low.max(-1.0)..=high.min(1.0));
            let entries: Vec<f64> = channels.iter().map(|it| entry(it.low, it.high)).collect();
            (entries.clone(), entries)
        }
        Space::Simplex(names) => {
            let raw: Vec<f64> = names.iter().map(|_| rng.random_range(0.01..1.0)).collect();
            let sum: f64 = raw.iter().sum();
            let shares: Vec<f64> = raw.iter().map(|entry| entry / sum).collect();
            (shares.clone(), shares)
        }
        Space::Discrete(names) => {
            let taken = vec![f64::from(
                rng.random_range(0..u32::try_from(names.len()).unwrap()),
            )];
            (taken.clone(), taken)
        }
        Space::Choices(choices) => {
            let taken: Vec<usize> = choices
                .iter()
                .map(|choice| rng.random_range(0..choice.options.len()))
                .collect();
            let asked = taken.iter().map(|option| *option as f64).collect();
            (asked, choice::vector(choices, &taken))
        }
    };
    let (asked, action): (Vec<Vec<f64>>, Action) = seats.iter().map(of_seat).unzip();
    (asked.concat(), action)
}

/// Two episodes, of one random stream, as the registry plays them.
fn played(name: &str, keys: &Value, seed: u64) -> Value {
    let registry = registry();
    let entry = &registry.environments[name];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("config.yaml");
    std::fs::write(&path, keys.to_string()).unwrap();
    let part = study::load_config(name, &entry.about, Some(&path)).unwrap_or_else(|problems| {
        panic!("{name}: {}", document::diagnostic::render(&problems, false));
    });
    let mut environment = (entry.build)(&part.config).unwrap();
    let (mut rng, mut draws) = (random::rollout(seed), random::stream(&["wheel", name]));
    let episodes: Vec<Value> = (0..2)
        .map(|_| episode(&mut *environment, &mut rng, &mut draws))
        .collect();
    json!({ "name": name, "config": keys, "seed": seed, "episodes": episodes })
}

fn episode(environment: &mut dyn Environment, rng: &mut Rng, draws: &mut Rng) -> Value {
    let start = environment.reset(rng).unwrap().concat();
    let mut steps = Vec::new();
    for _ in 0..STEPS {
        let (asked, action) = drawn(environment.seats(), draws);
        let step = environment.step(&action, rng).unwrap();
        let metrics: Vec<f64> = step.metrics.iter().map(|(_, value)| *value).collect();
        steps.push(
            json!({ "asked": asked, "observations": step.observations.concat(), "rewards": step.rewards,
            "metrics": metrics, "state": environment.state(), "terminated": step.end == Some(End::Terminated),
            "truncated": step.end == Some(End::Truncated) }),
        );
        if step.end.is_some() {
            break;
        }
    }
    json!({ "start": start, "steps": steps })
}

#[test]
fn every_environment_gives_the_bits_of_the_registry_and_passes_the_checks_of_its_interface() {
    let bench = Bench::new();
    let names: Vec<&str> = registry().environments.keys().copied().collect();
    let cases: Vec<Value> = configs()
        .iter()
        .map(|(name, keys)| played(name, keys, 7))
        .collect();
    let text = json!({ "names": names, "cases": cases }).to_string();
    let file = bench.write("cases.json", &text);
    check(
        "wheel_environments.py",
        MODULES,
        &[file.to_string_lossy().into_owned()],
    );
}

const TRIAL: &str = "
study: taken
environments: { cells: { battery: { cells: 3, decision_interval_s: 20 } } }
agents: { equal: { equal_split: {} } }
protocol: { train_evaluate: { steps: 0, final_episodes: 3, trace_episodes: 0 } }
seeds: [4]
";

#[test]
fn a_seed_is_that_of_a_rollout_and_an_episode_that_of_a_trial() {
    let bench = Bench::new();
    let actions = "weight_1,weight_2,weight_3\n".to_owned() + &"0.5,0.25,0.25\n".repeat(12);
    bench.write("actions.csv", &actions);
    bench.write("cells.yaml", "cells: 3\ndecision_interval_s: 20\n");
    let rollout = [
        "rollout",
        "battery",
        "--config",
        "cells.yaml",
        "--actions",
        "actions.csv",
    ];
    bench.ok(&[&rollout[..], &["--seed", "11", "--out", "rollout.csv"]].concat());
    let forces = ["agent_0", "agent_1", "agent_2"].map(|agent| format!("{agent}.force_x,{agent}.force_y"));
    let actions = forces.join(",") + "\n" + &"0.5,-0.25,1,0,-1,0.125\n".repeat(12);
    bench.write("forces.csv", &actions);
    bench.ok(&[
        "rollout",
        "particles",
        "--actions",
        "forces.csv",
        "--seed",
        "11",
        "--out",
        "particles.csv",
    ]);
    bench.write("taken.yaml", TRIAL);
    bench.ok(&["run", "taken.yaml"]);
    let trial = trial_files(&bench.path("store")).remove(0);
    let id = trial
        .parent()
        .unwrap()
        .file_name()
        .unwrap()
        .to_string_lossy()
        .into_owned();
    for episode in ["0", "2"] {
        let out = format!("episode-{episode}.csv");
        bench.ok(&["rollout", "--trial", &id, "--episode", episode, "--out", &out]);
    }
    check(
        "wheel_rollouts.py",
        MODULES,
        &[bench.path(".").to_string_lossy().into_owned()],
    );
}

#[test]
fn a_vector_is_what_its_environments_are_alone_in_both_modes_and_lets_other_threads_go_on() {
    check("wheel_vectors.py", MODULES, &[]);
}

/// Output of `rollout` for a config, without its first words and the place of the file.
fn said(bench: &Bench, keys: &str) -> String {
    bench.write("config.yaml", keys);
    let answer = bench.run(&[
        "rollout",
        "battery",
        "--config",
        "config.yaml",
        "--agent",
        "equal_split",
        "--out",
        "o",
    ]);
    assert_eq!(answer.code, 2, "{keys}: {}", answer.err);
    answer.err.replace("config.yaml", "the config of `battery`")
}

#[test]
fn what_is_wrong_is_refused_in_the_words_of_the_program() {
    let bench = Bench::new();
    // The layout of Python's `json.dumps`, so that lines and columns are the same.
    let wrong = [
        "{\n  \"cell\": 4\n}",
        "{\n  \"cells\": -1\n}",
        "{\n  \"cells\": \"four\"\n}",
        "{\n  \"load\": {\n    \"constnat\": {\n      \"power_w\": 8.0\n    }\n  }\n}",
        "{\n  \"preset\": \"thesys\"\n}",
    ];
    let cases: Vec<Value> = wrong
        .iter()
        .map(|keys| json!({ "keys": keys, "said": said(&bench, keys) }))
        .collect();
    let file = bench.write("cases.json", &json!(cases).to_string());
    check(
        "wheel_refusals.py",
        MODULES,
        &[file.to_string_lossy().into_owned()],
    );
}

#[test]
fn what_a_study_came_to_is_collected_from_its_store() {
    let bench = Bench::new();
    let table = "tables: { returns: { caption: Return, comparison: { rows: agent, value: return } } }\n";
    let study = crate::slurm::STUDY.replace("final_episodes: 2000", "final_episodes: 5");
    let study = bench.write("study.yaml", &format!("{study}{table}"));
    bench.ok(&["run", "study.yaml", "--out", "results"]);
    let [store, seeds] = ["store", "results/tables/returns-seeds.csv"].map(|it| bench.path(it));
    let arguments = [study, store, seeds].map(|it| it.to_string_lossy().into_owned());
    check("wheel_collect.py", MODULES, &arguments);
}

#[test]
fn what_the_page_shows_runs() {
    let page = std::fs::read_to_string(repository().join("docs/src/python-package.md")).unwrap();
    let shown = blocks(&page, "python").concat();
    assert!(shown.contains("regimen.make_parallel("), "{shown}");
    let bench = Bench::new();
    let script = bench.write("page.py", &shown);
    check(script.to_str().unwrap(), MODULES, &[]);
}

#[test]
fn the_example_trains_another_librarys_agent_on_the_battery() {
    let script = repository().join("examples/stable_baselines3/battery.py");
    let arguments = [script.to_string_lossy().into_owned(), "600".into()];
    check("run_example.py", "regimen, stable_baselines3", &arguments);
}
