//! Results made by formulas, for the tests of tables, figures and the report.

use analysis::results::Results;
use contract::{
    Phase,
    cast::Actors,
    part::Part,
    recorder::Row,
    standard_metrics::UPDATES,
    sweep_point::SweepPoint,
    trial::{Combination, Trial, TrialCell, TrialKey},
    trial_end::{EndState, TrialEnd},
    trial_result::TrialResult,
};
use serde_json::Value;

/// The rows that a synthetic trial records: phase, step, episode, metric and value.
pub type Rows = Vec<(Phase, u64, u64, &'static str, f64)>;

/// A trial that ended successfully and recorded some rows.
pub fn trial(environment: &str, agent: &str, setting: &str, seed: u64, rows: &Rows) -> TrialResult {
    let part = |plugin: &str| Part::new(plugin, 1, Value::Null);
    let key = TrialKey {
        environment: part(environment).into(),
        agent: Actors::Agent(part(agent)).into(),
        protocol: part("train_evaluate").into(),
        seed,
        numerics: 1,
    };
    let trial = Trial {
        id: format!("{environment}-{agent}-{seed}"),
        cell: TrialCell::from(Combination {
            environment: environment.into(),
            agent: agent.into(),
            point: point(setting),
        })
        .into(),
        key,
    };
    let mut names: Vec<String> = Vec::new();
    let mut index = |name: &str| {
        names.iter().position(|known| known == name).unwrap_or_else(|| {
            names.push(name.into());
            names.len() - 1
        })
    };
    let row = |&(phase, step, episode, name, value): &(Phase, u64, u64, &str, f64)| Row {
        phase,
        step,
        episode,
        seat: 0,
        metric: u16::try_from(index(name)).unwrap(),
        value,
    };
    let rows = rows.iter().map(row).collect();
    TrialResult {
        trial: trial.into(),
        end: Some(end(EndState::Ok, "").into()),
        names: names.into(),
        rows,
    }
}

/// The point with these `key=value` words.
fn point(words: &str) -> SweepPoint {
    let pair = |word: &str| {
        let (key, value) = word.split_once('=').unwrap();
        (
            key.to_owned(),
            serde_json::from_str(value).unwrap_or_else(|_| value.into()),
        )
    };
    words.split_whitespace().map(pair).collect()
}

/// The same trial with another end.
pub fn ended(mut trial: TrialResult, state: EndState, reason: &str) -> TrialResult {
    trial.end = Some(end(state, reason).into());
    trial.rows.clear();
    trial
}

fn end(state: EndState, reason: &str) -> TrialEnd {
    TrialEnd {
        state,
        reason: reason.into(),
        wall_s: 1.0,
        decision_s: None,
        device: None,
        digest: String::new(),
    }
}

/// A number in -1..1 that looks random and is a function of its arguments.
pub fn noise(a: u64, b: u64, c: u64) -> f64 {
    let mut x = a.wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ b.wrapping_mul(0xbf58_476d_1ce4_e5b9)
        ^ c.wrapping_mul(0x94d0_49bb_1331_11eb);
    for _ in 0..3 {
        x ^= x >> 31;
        x = x.wrapping_mul(0xd6e8_feb8_6659_fd93);
    }
    (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Agents of [`study`], in its order.
pub const AGENTS: [&str; 4] = ["equal", "dsac", "ddpg", "bound"];

/// Two environments, four agents (two of which learn), five seeds; one trial of `ddpg` ran out of memory and
/// one has not run.
pub fn study() -> Results {
    let mut trials = Vec::new();
    for (place, environment) in ["four_cells", "eight_cells"].into_iter().enumerate() {
        for (index, agent) in AGENTS.into_iter().enumerate() {
            for seed in 0..5 {
                trials.push(one(environment, place as u64, agent, index as u64, seed));
            }
        }
    }
    Results::of(trials)
}

fn one(environment: &str, place: u64, agent: &str, index: u64, seed: u64) -> TrialResult {
    let top = [10.0, 11.6, 11.1, 12.4][index as usize] * (1.0 + place as f64);
    let common = 0.3 * noise(place, 9, seed);
    let last = top + common + 0.12 * noise(place, index, seed) * f64::from(u8::from(index != 0));
    let mut rows: Rows = (0..4)
        .map(|episode| {
            (
                Phase::Final,
                60_000,
                episode,
                "cycle_length",
                last + 0.1 * (episode as f64 - 1.5),
            )
        })
        .collect();
    if index == 1 || index == 2 {
        rows.push((Phase::Final, 60_000, 0, UPDATES, 3_750.0));
        for step in (0..=60_000).step_by(2000) {
            let grown = 1.0 - (-(step as f64) / (8000.0 + 6000.0 * index as f64)).exp();
            let value = top * (0.7 + 0.3 * grown) + common + 0.5 * noise(step, index, seed) * (1.2 - grown);
            rows.push((Phase::Evaluate, step, 0, "cycle_length", value));
        }
    }
    trace(&mut rows, index, seed);
    let trial = trial(environment, agent, "", seed, &rows);
    match (place, agent, seed) {
        (1, "ddpg", 3) => ended(trial, EndState::Oom, "used 3.1 GiB of 3.0 GiB <allowed>"),
        (1, "ddpg", 4) => TrialResult {
            end: None,
            rows: Vec::new(),
            ..trial
        },
        _ => trial,
    }
}

fn trace(rows: &mut Rows, index: u64, seed: u64) {
    const VOLTAGES: [&str; 4] = ["voltage_1", "voltage_2", "voltage_3", "voltage_4"];
    for step in 0..60 + 10 * index {
        let hour = step as f64 / 60.0;
        for (cell, name) in VOLTAGES.into_iter().enumerate() {
            let spread = (cell as f64 - 1.5) * 0.05 * (1.0 - 0.25 * index as f64);
            rows.push((
                Phase::Trace,
                step,
                0,
                name,
                4.1 - 0.75 * hour + spread * hour - 0.02 * noise(step, cell as u64, seed).abs(),
            ));
        }
        rows.push((
            Phase::Trace,
            step,
            0,
            "load",
            30.0 + 12.0 * (hour * 9.0).sin() + 3.0 * noise(step, 77, seed),
        ));
    }
}
