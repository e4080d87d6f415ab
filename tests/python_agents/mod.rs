//! Rules and learners in Python: how they act in environments of every kind, how they are trained and go on, what is
//! refused before anything runs, and what a trial comes to whose agent fails.

mod acting;
mod ends;
mod identity;
mod learning;
mod refusals;

use crate::{
    book::blocks,
    program::{Answer, repository},
    python_environments::{Place, processes_of},
    slurm::until,
};
use contract::{Agent, Environment, Error, Interface, Mode, Observation, random::stream};
use serde_json::{Value, json};
use std::fs;

/// The keys of an agent in a study.
fn agent(place: &Place, make: &str, more: &str) -> String {
    let interpreter = place.interpreter;
    format!(
        "python: {{ make: \"{make}\", {more} lock: {{ file: requirements.txt }}, interpreter: {interpreter} }}"
    )
}

/// A rule, with its arguments.
fn rule(place: &Place, make: &str, arguments: &str) -> String {
    agent(place, make, &format!("arguments: {{ {arguments} }},"))
}

const LEARNS: &str = "learns: true, metrics: [mean_reward],";
/// A study's protocol of a few steps.
const SHORT: &str = "{ steps: 160, environments: 4, evaluate_every: 80, episodes: 2, final_episodes: 3 }";

/// Writes a study of agents in one environment.
fn study(place: &Place, environment: &str, agents: &[(&str, &str)], protocol: &str) {
    let agents: String = agents
        .iter()
        .map(|(name, agent)| format!("  {name}: {{ {agent} }}\n"))
        .collect();
    let text = format!(
        "study: own\nenvironments:\n  task: {{ {environment} }}\nagents:\n{agents}protocol: {{ train_evaluate: \
         {protocol} }}\n"
    );
    place.bench.write("study.yaml", &text);
}

/// The environment of a study in Python.
fn environment(place: &Place, make: &str) -> String {
    format!("python: {}", place.with(make, ""))
}

fn words(answer: &Answer) -> String {
    answer.err.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn config(place: &Place, make: &str, more: &Value) -> Value {
    let mut config = place.config(make, json!({}));
    config["sources"] = json!([]);
    for (key, value) in more.as_object().into_iter().flatten() {
        config[key] = value.clone();
    }
    config
}

fn built(place: &Place, make: &str, more: &Value, interface: &Interface) -> Result<Box<dyn Agent>, Error> {
    let build = &plugins::registry().agents["python"].build;
    build(
        &config(place, make, more).into(),
        interface,
        &mut stream(&["agent"]),
    )
}

/// The actions of an agent in an environment that was just reset, in two rows; the environment takes them.
fn first_actions(agent: &mut dyn Agent, environment: &mut dyn Environment) -> Vec<Vec<f64>> {
    let mut rng = stream(&["act"]);
    let seats = environment.reset(&mut rng).unwrap();
    let seen = Observation {
        seats,
        state: Vec::new(),
    };
    let mut actions = agent
        .act(&[seen.clone(), seen], Mode::Evaluate, &mut rng)
        .unwrap();
    assert_eq!(actions.len(), 2);
    environment.step(&actions[0], &mut rng).unwrap();
    actions.swap_remove(1)
}

#[test]
fn the_page_of_the_book_works_as_written() {
    let Some(place) = Place::new() else { return };
    let page = fs::read_to_string(repository().join("docs/src/python-agents.md")).unwrap();
    let study = blocks(&page, "yaml")
        .into_iter()
        .find(|block| block.contains("\nprotocol:"))
        .unwrap();
    for (file, text) in ["pump.py", "rules.py"].iter().zip(blocks(&page, "python")) {
        place.bench.write(file, &text);
        let shown = file.replace("rules", "pump_agents");
        let committed = repository().join("experiments/data/python").join(shown);
        let committed = fs::read_to_string(committed).unwrap();
        assert!(
            committed.ends_with(&text),
            "{file} is not the one of the study `python-rule`"
        );
    }
    let lock = "lock: { file: requirements.txt }";
    let with_interpreter = format!("{lock}, interpreter: {}", place.interpreter);
    place
        .bench
        .write("pump.yaml", &study.replace(lock, &with_interpreter));
    place.bench.ok(&["check", "pump.yaml"]);
    let table = place.bench.ok(&["run", "pump.yaml", "-j", "2"]);
    assert!(table.contains("Claims: 2 SUPPORTED"), "{table}");
    let keys = [
        "make",
        "arguments",
        "learns",
        "metrics",
        "sources",
        "lock",
        "interpreter",
    ];
    assert!(keys.iter().all(|key| page.contains(&format!("\n| `{key}` |"))));
}
