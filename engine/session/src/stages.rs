//! The graph of a study: its entries, and the artifacts that they take from each other.

use crate::Planned;
use contract::trial::{Purpose, Trial};
use report::{Stage, Take};
use std::collections::{BTreeMap, BTreeSet};

/// The entries of a study in the order of the plan; empty if no trial takes from another one.
#[must_use]
pub fn of(one: &Planned) -> Vec<Stage> {
    let trials = &one.plan.trials;
    if !trials.iter().any(|trial| trial.key.takes()) {
        return Vec::new();
    }
    let by_id: BTreeMap<&str, &Trial> = trials.iter().map(|trial| (trial.id.as_str(), &**trial)).collect();
    let mut names: Vec<&str> = Vec::new();
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let mut takes: BTreeMap<&str, BTreeSet<Take>> = BTreeMap::new();
    for trial in trials {
        let name = entry(trial);
        if !counts.contains_key(name) {
            names.push(name);
        }
        *counts.entry(name).or_default() += 1;
        for taken in trial.key.taken_by_name() {
            let Some(source) = by_id.get(taken.trial.as_str()) else {
                continue;
            };
            let take = Take {
                from: entry(source).to_owned(),
                artifact: taken.kind.name().to_owned(),
            };
            takes.entry(name).or_default().insert(take);
        }
    }
    if takes.is_empty() {
        return Vec::new();
    }
    let depths = depths(&names, &takes);
    let stage = |name: &&str| Stage {
        name: (*name).to_owned(),
        trials: counts[name],
        depth: depths[name],
        takes: takes.get(name).into_iter().flatten().cloned().collect(),
    };
    names.iter().map(stage).collect()
}

fn entry(trial: &Trial) -> &str {
    match &trial.cell.purpose {
        Purpose::Cell | Purpose::Imported => &trial.cell.agent,
        Purpose::Tried(search) => search,
        Purpose::Prepared | Purpose::Play(_) => &trial.cell.environment,
    }
}

/// The depth of every entry: one more than the deepest entry that it takes from. An agent that takes from itself in
/// another environment adds nothing.
fn depths<'a>(names: &[&'a str], takes: &BTreeMap<&'a str, BTreeSet<Take>>) -> BTreeMap<&'a str, usize> {
    let mut depths: BTreeMap<&str, usize> = names.iter().map(|name| (*name, 0)).collect();
    // A path contains each entry at most once.
    for _ in names {
        for (name, takes) in takes {
            let below = takes
                .iter()
                .filter(|take| take.from != *name)
                .filter_map(|take| depths.get(take.from.as_str()));
            let deepest = below.max().map_or(0, |depth| depth + 1).min(names.len());
            depths.insert(name, deepest);
        }
    }
    depths
}

/// The graph for people, a line for each entry that takes something.
#[must_use]
pub fn lines(one: &Planned) -> Vec<String> {
    let stages = of(one);
    let takers = stages.iter().filter(|stage| !stage.takes.is_empty());
    let line = |stage: &Stage| {
        let takes: Vec<String> = stage
            .takes
            .iter()
            .map(|take| format!("{} of {}", take.artifact, take.from))
            .collect();
        format!("    {} takes {}", stage.name, takes.join(", "))
    };
    let lines: Vec<String> = takers.map(line).collect();
    if lines.is_empty() {
        lines
    } else {
        std::iter::once("  graph:".to_owned()).chain(lines).collect()
    }
}
