//! A trial that is stopped or killed and goes on in a fresh process ends as if nothing had happened: for
//! every agent.

use crate::{
    contracts::{acting, ready_made},
    datasets::{self, with_sources},
    shrunk::shrunk,
};
use contract::{
    Agent, Error, Keeper, NoKeeper, Phase, Recorder, Registry, cast::Actors, part::Part, trial::TrialKey,
};
use execution::store::RunningTrial;
use plugins::registry;
use serde_json::{Value, json};
use std::{
    collections::BTreeSet,
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    sync::Arc,
    time::Duration,
};

/// Values for whatever config has such a key: small networks, short episodes, wear, two blocks in the final
/// measurement.
fn small() -> Value {
    let mut small = json!({
        "width": 6, "batch_size": 4, "learning_starts": 24, "updates_per_step": 0.25, "replay_capacity": 64,
        "episode_limit": 5, "ageing": {}, "process_noise": true, "sensor_noise": true, "cells": 2,
        "steps": 72, "environments": 4, "evaluate_every": 24, "episodes": 3, "final_episodes": 260,
        "trace_episodes": 2, "decisions": 4,
        "batch": 4, "examples": 3, "final_examples": 260, "batches": 30,
        "trajectory": { "piece": 5 }, "particles": 3, "flight": { "drawn": { "interval_s": 900.0 } },
        "weights": [0.4, 0.6], "leave_checkpoint": true, "datasets": [{ "from": "given" }],
    });
    let of_searches = json!({
        "evaluations": 24, "exploration_steps": 12, "growth_at": [6, 15], "derived_designs": 2, "kept_designs": 1,
        "population": 2, "n_startup": 2, "tournament": 2,
        "images": { "shapes": { "count": 20 } }, "size": 8, "critic_steps": 1, "generator_batch": 2,
        "generator_channels": 2, "discriminator_channels": 2, "latent": 2, "scored_images": 10,
        "reference_images": 20, "splits": 1, "channels": 2,
    });
    for (key, value) in of_searches.as_object().into_iter().flatten() {
        small[key] = value.clone();
    }
    small
}

fn part(name: &str, about: &contract::plugin::About) -> Part {
    Part::new(name, about.version, shrunk(about, &small()))
}

/// Environments whose steps cost much: the blocks of a final measurement are looked at in others.
const SLOW: [&str; 3] = ["battery", "turbofan_calibration", "uav_fleet"];

/// A small trial of an agent with every environment and protocol, whether it fits them or not.
pub(crate) fn keys(registry: &Registry, agent: &str) -> Vec<TrialKey> {
    let mut keys = Vec::new();
    for environment in ready_made(registry) {
        let environment_entry = &registry.environments[environment];
        for (protocol, protocol_entry) in &registry.protocols {
            let mut key = TrialKey {
                environment: part(environment, &environment_entry.about).into(),
                agent: Actors::Agent(part(agent, &registry.agents[agent].about)).into(),
                protocol: part(protocol, &protocol_entry.about).into(),
                seed: 3,
                numerics: registry.numerics_version,
            };
            if !registry.agents[agent].traits.learns() {
                let config = (protocol_entry.without_training)(&key.protocol.config).unwrap();
                Arc::make_mut(&mut key.protocol).config = config;
            }
            let mut protocol = Arc::unwrap_or_clone(key.protocol);
            for key in ["final_episodes", "final_examples"] {
                if let (true, Some(count)) = (SLOW.contains(&environment), protocol.config.get_mut(key)) {
                    *count = 6.into();
                }
            }
            key.protocol = with_sources(protocol).into();
            keys.push(key);
        }
    }
    keys
}

/// Record of a trial, where the agent fits environment and protocol: some learn from actions, some from
/// answers, and some say by a panic that they cannot.
fn outcome(registry: &Registry, key: &TrialKey) -> Option<Outcome> {
    catch_unwind(AssertUnwindSafe(|| run(registry, key, &mut NoKeeper)))
        .ok()
        .and_then(Result::ok)
}

/// Whether an agent learned in a trial: whether it recorded what it declares.
fn learned(registry: &Registry, key: &TrialKey, outcome: &Outcome) -> bool {
    let agent = key
        .agent
        .agent()
        .map(|agent| &registry.agents[agent.plugin.as_str()]);
    let metrics = agent.map_or(&[][..], |agent| &agent.traits.metrics);
    let of_agent = |name: &String| metrics.iter().any(|metric| metric.name == *name);
    outcome.names.iter().any(of_agent)
}

/// True where every step trains networks, for agents and protocols that are looked at in other environments.
fn costs_too_much(key: &TrialKey) -> bool {
    let designs = key.agent.agent().is_some_and(|agent| agent.plugin == "e2gan");
    key.environment.plugin == "generator_search" && !(designs && key.protocol.plugin == "search")
}

/// Part of a record that must not depend on how often a trial was interrupted.
#[derive(Debug, PartialEq)]
struct Outcome {
    names: Vec<String>,
    rows: Vec<(Phase, u64, u64, u16, u16, u64)>,
    policy: Option<Vec<u8>>,
}

fn run(registry: &Registry, key: &TrialKey, keeper: &mut dyn Keeper) -> Result<Outcome, Error> {
    let folder = tempfile::tempdir().unwrap();
    let record = datasets::run(registry, key, Some(folder.path()), keeper)?;
    let bits = |row: &contract::recorder::Row| {
        (
            row.phase,
            row.step,
            row.episode,
            row.seat,
            row.metric,
            row.value.to_bits(),
        )
    };
    Ok(Outcome {
        names: record.names().to_vec(),
        rows: record.rows().iter().map(bits).collect(),
        policy: std::fs::read(folder.path().join("policy.safetensors")).ok(),
    })
}

/// How a process ends.
#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    /// It is asked to stop at this opportunity to save.
    Stopped(u64),
    /// It saves at the first opportunity and at this one, and is killed some steps later.
    Killed(u64),
    /// With the trial.
    Never,
}

/// Saves when the test says so.
struct Interrupted {
    kept: RunningTrial,
    end: End,
    opportunities: u64,
}

impl Interrupted {
    fn fresh(folder: &Path, key: &TrialKey, end: End) -> Self {
        let kept = RunningTrial::open(folder, &key.id(), Duration::MAX, std::sync::Arc::default());
        Self {
            kept,
            end,
            opportunities: 0,
        }
    }
}

impl Keeper for Interrupted {
    fn due(&mut self) -> bool {
        self.opportunities += 1;
        match self.end {
            End::Stopped(at) => self.opportunities == at,
            End::Killed(at) => self.opportunities == 1 || self.opportunities == at,
            End::Never => false,
        }
    }

    fn stopping(&self) -> bool {
        self.end == End::Stopped(self.opportunities)
    }

    fn save(&mut self, state: Value, agent: &dyn Agent, record: &mut Recorder) -> Result<(), Error> {
        self.kept.save(state, agent, record)
    }

    fn load(&mut self, agent: &mut dyn Agent, record: &mut Recorder) -> Result<Option<Value>, Error> {
        self.kept.load(agent, record)
    }

    fn note(&mut self, record: &Recorder) -> Result<(), Error> {
        self.kept.note(record)?;
        let killed = matches!(self.end, End::Killed(at) if self.opportunities > at + 2);
        if killed {
            Err(Error::Worker {
                problem: "killed".into(),
            })
        } else {
            Ok(())
        }
    }

    fn refuse(&mut self) -> bool {
        panic!("a checkpoint does not fit its own trial");
    }
}

/// Runs a trial in as many processes as there are ends; gives its outcome and how many opportunities to save
/// the last one had.
fn run_interrupted(
    registry: &Registry,
    key: &TrialKey,
    ends: impl IntoIterator<Item = End>,
) -> (Outcome, usize) {
    let folder = tempfile::tempdir().unwrap();
    for (process, end) in ends.into_iter().enumerate() {
        match run(registry, key, &mut Interrupted::fresh(folder.path(), key, end)) {
            Ok(outcome) => return (outcome, process),
            Err(Error::Stopped | Error::Worker { .. }) => {}
            Err(error) => panic!("{key:?}: {error}"),
        }
    }
    panic!("the last process ends with the trial")
}

/// States of agent, environment and protocol do not depend on each other. Every two of them that go together meet in some
/// trial that is stopped; a protocol that is new to the agent or to the environment is looked at closely.
#[test]
fn a_trial_that_is_interrupted_ends_as_one_that_is_not() {
    let registry = registry();
    let mut met = BTreeSet::new();
    for (name, _) in acting(&registry).filter(|(_, entry)| entry.traits.learns()) {
        let mut learns = false;
        // Under `track` and `gather` nothing is learned, whatever agents record.
        for key in keys(&registry, name) {
            let (environment, protocol) = (&key.environment.plugin, &key.protocol.plugin);
            let pairs = [(name, &**protocol), (environment, protocol), (name, environment)]
                .map(|(one, other)| (one.to_string(), other.to_string()));
            let is_new = pairs.each_ref().map(|pair| !met.contains(pair));
            let learns_nothing = ["track", "gather"].contains(&protocol.as_str());
            if is_new == [false; 3] || learns_nothing || costs_too_much(&key) {
                continue;
            }
            let Some(whole) = outcome(&registry, &key).filter(|it| learned(&registry, &key, it)) else {
                continue;
            };
            learns = true;
            let place = format!("{name}, {environment}, {protocol}");
            let last = opportunities(&registry, &key);
            assert!(last > 20, "{place}: {last} opportunities to save");
            stopped_again_and_again(&registry, (&key, &place), &whole, last);
            if is_new[0] || is_new[1] {
                stopped_once(&registry, (&key, &place), &whole, last);
                killed_again_and_again(&registry, (&key, &place), &whole, last);
            }
            met.extend(pairs);
        }
        assert!(learns, "no environment and protocol in which {name} learns");
    }
}

fn stopped_again_and_again(registry: &Registry, (key, place): (&TrialKey, &str), whole: &Outcome, last: u64) {
    // A process takes the place at which the one before it stopped as its first opportunity.
    let (outcome, stops) = run_interrupted(registry, key, (0..).map(|_| End::Stopped(last / 8 + 1)));
    assert!(stops >= 6 && outcome == *whole, "{place}: stopped {stops} times");
}

/// Before everything, after the first step, and around the last two: the blocks of the final measurement, if there
/// is one.
fn stopped_once(registry: &Registry, (key, place): (&TrialKey, &str), whole: &Outcome, last: u64) {
    for at in [1, 2, last - 1, last] {
        let (outcome, _) = run_interrupted(registry, key, [End::Stopped(at), End::Never]);
        assert!(outcome == *whole, "{place}: stopped once, at {at} of {last}");
    }
}

fn killed_again_and_again(registry: &Registry, (key, place): (&TrialKey, &str), whole: &Outcome, last: u64) {
    let (outcome, kills) = run_interrupted(registry, key, (0..).map(|_| End::Killed(last / 8 + 1)));
    assert!(kills >= 4 && outcome == *whole, "{place}: killed {kills} times");
}

#[test]
fn measurements_of_an_agent_that_does_not_learn_are_interrupted_without_a_trace() {
    let registry = registry();
    for (name, _) in registry.agents.iter().filter(|(_, entry)| !entry.traits.learns()) {
        for protocol in ["train_evaluate", "supervised_fit", "offline_fit"] {
            let keys = keys(&registry, name)
                .into_iter()
                .filter(|key| key.protocol.plugin == protocol);
            let first = keys
                .into_iter()
                .find_map(|key| outcome(&registry, &key).map(|outcome| (key, outcome)));
            let (key, whole) =
                first.unwrap_or_else(|| panic!("no environment takes {name} under {protocol}"));
            let measured = whole
                .rows
                .iter()
                .filter(|row| row.0 == Phase::Evaluate)
                .map(|row| row.1)
                .collect::<BTreeSet<_>>();
            assert_eq!(measured, [0, 24, 48, 72].into(), "{name}, {protocol}");
            // Before each measurement, and between the two blocks of the final one.
            let last = opportunities(&registry, &key);
            let is_slow = SLOW.contains(&key.environment.plugin.as_str());
            // An agent that remembers plays every episode alone: four times 3, and 260 at the end.
            let expected = if is_slow { [5, 4 * 3 + 6] } else { [6, 4 * 3 + 260] };
            assert!(expected.contains(&last), "{name}, {protocol}: {last}");
            for at in [1, last] {
                let (outcome, _) = run_interrupted(&registry, &key, [End::Stopped(at), End::Never]);
                assert!(
                    outcome == whole,
                    "{name}, {protocol}: stopped once, at {at} of {last}"
                );
            }
            // An agent that remembers is asked before each of 272 episodes.
            let stop = End::Stopped(last / 8 + 2);
            let (outcome, stops) = run_interrupted(&registry, &key, (0..).map(|_| stop));
            assert!(
                stops >= 4 && outcome == whole,
                "{name}, {protocol}: stopped {stops} times"
            );
        }
    }
}

/// How often an uninterrupted trial could have been saved.
fn opportunities(registry: &Registry, key: &TrialKey) -> u64 {
    let folder = tempfile::tempdir().unwrap();
    let mut keeper = Interrupted::fresh(folder.path(), key, End::Never);
    run(registry, key, &mut keeper).unwrap();
    keeper.opportunities
}
