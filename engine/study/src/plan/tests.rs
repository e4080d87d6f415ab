//! Reasons computed from keys, without a store or a registry.

use super::{Estimate, Novelty, Reason, StoredCell, Took, estimate, explain, novelties, to_json};
use contract::{
    cast::Actors,
    part::Part,
    trial::{Trial, TrialCell, TrialKey},
    trial_end::{EndState, TrialEnd},
};
use serde_json::{Value, json};
use std::{collections::BTreeSet, sync::Arc};

/// A key that tests change in one place.
fn key() -> TrialKey {
    TrialKey {
        environment: Part::new("battery", 1, json!({"cells": 4, "start": {"charge": 0.9}})).into(),
        agent: Actors::Agent(Part::new(
            "dirichlet_sac",
            1,
            json!({"widths": [64, 64], "learning_rate": 0.001}),
        ))
        .into(),
        protocol: Part::new("train_evaluate", 1, json!({"steps": 60000, "episodes": 50})).into(),
        seed: 0,
        numerics: 1,
    }
}

fn agent(key: &mut TrialKey) -> &mut Part {
    match Arc::make_mut(&mut key.agent) {
        Actors::Agent(part) => part,
        Actors::Cast(_) => unreachable!("these keys have agents"),
    }
}

fn stored(key: TrialKey, seeds: &[u64]) -> StoredCell {
    StoredCell {
        key,
        seeds: seeds.iter().copied().collect(),
        device: None,
        took: Took::default(),
    }
}

fn planned(key: &TrialKey, seeds: std::ops::Range<u64>) -> Vec<Trial> {
    let trial = |seed| {
        let key = TrialKey { seed, ..key.clone() };
        Trial {
            id: key.id(),
            cell: TrialCell::of("four", "dsac").into(),
            key,
        }
    };
    seeds.map(trial).collect()
}

/// The reasons of trials that have not run.
fn reasons(key: &TrialKey, seeds: std::ops::Range<u64>, stored: &[StoredCell]) -> Vec<String> {
    let trials = planned(key, seeds);
    let line = |it: &Novelty| format!("{}: {}", document::count::seed_ranges(&it.seeds), it.reason);
    novelties(&trials, &vec![None; trials.len()], stored)
        .iter()
        .map(line)
        .collect()
}

fn edited(part: fn(&mut TrialKey) -> &mut Part, pointer: &str, value: Value) -> TrialKey {
    let mut key = key();
    *part(&mut key).config.pointer_mut(pointer).unwrap() = value;
    key
}

#[test]
fn each_kind_of_change_is_named() {
    let known = [stored(key(), &[0, 1, 2])];
    let one = |key: &TrialKey| reasons(key, 0..1, &known).join("\n");
    assert_eq!(reasons(&key(), 3..5, &known), ["3-4: new seed (stored: 0-2)"]);
    assert_eq!(
        one(&edited(
            |key| Arc::make_mut(&mut key.protocol),
            "/steps",
            json!(240_000)
        )),
        "0: protocol.steps: 60000 -> 240000"
    );
    assert_eq!(
        one(&edited(
            |key| Arc::make_mut(&mut key.environment),
            "/cells",
            json!(8)
        )),
        "0: environment battery.cells: 4 -> 8"
    );
    assert_eq!(
        one(&edited(
            |key| Arc::make_mut(&mut key.environment),
            "/start/charge",
            json!("full")
        )),
        "0: environment battery.start.charge: 0.9 -> full"
    );
    assert_eq!(
        one(&edited(agent, "/widths", json!([64, 64, 64]))),
        "0: agent dirichlet_sac.widths: [64,64] -> [64,64,64]"
    );
    let mut raised = key();
    agent(&mut raised).version = 2;
    assert_eq!(one(&raised), "0: agent version 1 -> 2");
    assert_eq!(
        one(&TrialKey { numerics: 2, ..key() }),
        "0: numerics version 1 -> 2"
    );
    let mut other = key();
    other.agent = Actors::Agent(Part::new("ddpg", 1, json!({}))).into();
    assert_eq!(one(&other), "0: agent plugin dirichlet_sac -> ddpg");
    other.environment = Part::new("particles", 1, json!({})).into();
    assert_eq!(one(&other), "0: nothing like it is stored");
    assert_eq!(reasons(&key(), 0..2, &[]), ["0-1: nothing like it is stored"]);
}

#[test]
fn keys_that_came_or_went_are_named() {
    let known = [stored(key(), &[0])];
    let mut longer = key();
    Arc::make_mut(&mut longer.protocol).config =
        json!({"steps": 60000, "episodes": 50, "trace": {"every": 5}}).into();
    assert_eq!(
        reasons(&longer, 0..1, &known),
        ["0: protocol.trace.every: absent -> 5"]
    );
    assert_eq!(
        reasons(&key(), 0..1, &[stored(longer, &[0])]),
        ["0: protocol.trace.every: 5 -> absent"]
    );
}

#[test]
fn the_content_of_a_data_file_counts_and_its_path_does_not() {
    let with = |path: &str, content: &str| {
        let mut key = key();
        key.environment = Part::new("battery", 1, json!({ "demand": { "file": path } })).into();
        Arc::make_mut(&mut key.environment)
            .files
            .insert("/demand/file".into(), content.into());
        key
    };
    let known = [stored(with("a.csv", "aa"), &[0])];
    assert_eq!(
        reasons(&with("moved/a.csv", "aa"), 1..2, &known),
        ["1: new seed (stored: 0)"]
    );
    assert_eq!(
        reasons(&with("a.csv", "bb"), 0..1, &known),
        ["0: environment battery.demand.file.content: aa -> bb"]
    );
}

#[test]
fn the_nearest_is_the_one_with_the_fewest_differing_leaves() {
    let mut far = edited(|key| Arc::make_mut(&mut key.protocol), "/steps", json!(1));
    agent(&mut far).version = 7;
    let near = edited(|key| Arc::make_mut(&mut key.protocol), "/episodes", json!(10));
    let known = [stored(far, &[0, 1, 2, 3]), stored(near, &[0, 1])];
    // A seed counts as one leaf: even so, the near one has fewer differences.
    assert_eq!(
        reasons(&key(), 0..3, &known),
        [
            "0-1: protocol.episodes: 10 -> 50",
            "2: protocol.episodes: 10 -> 50, new seed (stored: 0-1)"
        ]
    );
    // Among equally near ones, the one that has the seed is chosen.
    let other = edited(|key| Arc::make_mut(&mut key.protocol), "/steps", json!(9));
    let near = edited(|key| Arc::make_mut(&mut key.protocol), "/episodes", json!(10));
    let known = [stored(other, &[2]), stored(near, &[0, 1])];
    assert_eq!(
        reasons(&key(), 0..3, &known),
        [
            "0-1: protocol.episodes: 10 -> 50",
            "2: protocol.steps: 9 -> 60000"
        ]
    );
}

#[test]
fn end_states_are_reasons_of_their_own() {
    let trials = planned(&key(), 0..4);
    let end = |state| {
        Some(TrialEnd {
            state,
            reason: String::new(),
            wall_s: 1.0,
            decision_s: None,
            device: None,
            digest: String::new(),
        })
    };
    let ends = [end(EndState::Ok), end(EndState::Killed), end(EndState::Nan), None];
    let found = novelties(&trials, &ends, &[stored(key(), &[0, 1, 2])]);
    let seeds: Vec<_> = found.iter().map(|it| it.seeds.clone()).collect();
    assert_eq!(seeds, [[1], [2], [3]]);
    assert_eq!(found[0].reason, Reason::Killed);
    assert_eq!(found[1].reason, Reason::Failed(EndState::Nan));
    assert_eq!(
        found[2].reason,
        Reason::NewSeed {
            stored: BTreeSet::from([0, 1, 2])
        }
    );
}

/// Novelties of several cells, as a plan prints them.
fn several() -> Vec<Novelty> {
    let named = |agent: &str, setting: &str, seeds: &[u64], reason| Novelty {
        environment: "four".into(),
        agent: agent.into(),
        setting: setting.into(),
        seeds: seeds.to_vec(),
        reason,
    };
    let trials = planned(
        &edited(|key| Arc::make_mut(&mut key.protocol), "/steps", json!(240_000)),
        0..1,
    );
    let changed = novelties(&trials, &[None], &[stored(key(), &[0])])[0]
        .reason
        .clone();
    vec![
        named(
            "equal",
            "",
            &[3, 4],
            Reason::NewSeed {
                stored: BTreeSet::from([0, 1, 2]),
            },
        ),
        named("dsac", "learning_rate=0.001", &[0, 1, 2, 3, 4], changed),
        named("dsac", "learning_rate=0.01", &[0], Reason::Failed(EndState::Oom)),
        named("dsac", "learning_rate=0.01", &[1], Reason::Killed),
        named("dsac", "learning_rate=0.1", &[0, 2], Reason::NothingLikeIt),
    ]
}

#[test]
fn the_printed_reasons() {
    insta::assert_snapshot!("reasons", explain(&several()));
}

#[test]
fn the_reasons_for_programs() {
    insta::assert_snapshot!(
        "reasons_as_json",
        serde_json::to_string_pretty(&to_json(&several())).unwrap()
    );
}

#[test]
fn one_reason_for_all_cells_is_one_line() {
    let alike: Vec<Novelty> = (0..12)
        .map(|cell| Novelty {
            environment: "four".into(),
            agent: format!("agent{cell}"),
            setting: String::new(),
            seeds: vec![0, 1],
            reason: Reason::NothingLikeIt,
        })
        .collect();
    assert_eq!(
        explain(&alike),
        "  why:\n    each of 12 cells  seeds 0-1  nothing like it is stored"
    );
    assert_eq!(explain(&[]), "");
}

/// An estimate for two trials from one stored trial of 60 s and `others`.
fn estimated(key: &TrialKey, others: &[StoredCell]) -> Estimate {
    let timed = |key, wall_s| StoredCell {
        took: Took::once(wall_s),
        ..stored(key, &[0])
    };
    let stored: Vec<_> = std::iter::once(timed(self::key(), 60.0))
        .chain(others.iter().cloned())
        .collect();
    let steps = |key: &TrialKey| key.protocol.config["steps"].as_u64().unwrap_or(0);
    let trials = planned(key, 5..7);
    estimate(
        trials.iter().map(|trial| (trial, steps(key))),
        None,
        &stored,
        steps,
    )
}

#[test]
fn times_on_a_device_and_on_processors_are_told_apart() {
    let timed = |device: Option<&str>, wall_s| StoredCell {
        device: device.map(Into::into),
        took: Took::once(wall_s),
        ..stored(key(), &[0])
    };
    let stored = [timed(None, 60.0), timed(Some("cuda"), 600.0)];
    let trials = planned(&key(), 5..7);
    let on = |device: Option<&str>| {
        let estimate = estimate(trials.iter().map(|trial| (trial, 1)), device, &stored, |_| 1);
        (estimate.unknown, estimate.worker_s)
    };
    assert_eq!((on(None), on(Some("cuda"))), ((0, 120.0), (0, 1200.0)));
    assert_eq!(on(Some("other")), (2, 0.0));
}

#[test]
fn the_most_alike_stored_trial_tells_how_long_the_missing_ones_take() {
    let near = |worker_s: f64, estimate: Estimate| {
        let Estimate {
            missing,
            unknown,
            worker_s: said,
        } = estimate;
        assert_eq!((missing, unknown), (2, 0));
        assert!(
            (said - worker_s).abs() < 0.01,
            "{said} s in place of {worker_s} s"
        );
    };
    near(120.0, estimated(&key(), &[]));
    let longer = edited(|key| Arc::make_mut(&mut key.protocol), "/steps", json!(120_000));
    near(240.0, estimated(&longer, &[]));
    // Wider layers are nearer than other layers and other steps.
    let wider = edited(agent, "/widths/0", json!(128));
    near(120.0, estimated(&wider, &[]));
    let same = StoredCell {
        took: Took {
            trials: 4,
            wall_s: 400.0,
        },
        ..stored(wider.clone(), &[1, 2, 3, 4])
    };
    near(200.0, estimated(&wider, &[same]));
    let failed = stored(wider.clone(), &[1]);
    near(120.0, estimated(&wider, &[failed]));
}

#[test]
fn a_trial_in_another_environment_does_not_tell_how_long_it_takes() {
    let mut elsewhere = key();
    Arc::make_mut(&mut elsewhere.environment).plugin = "turbofan".into();
    let unknown = Estimate {
        missing: 2,
        unknown: 2,
        worker_s: 0.0,
    };
    assert_eq!(estimated(&elsewhere, &[]), unknown);
}
