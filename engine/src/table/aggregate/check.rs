//! Aggregates against what trials record: environments, agents, what the scores 0 and 1 stand for.

use super::{Aggregate, Normalise, SUITE_MEAN};
use crate::{
    diagnostic::suggest,
    document::Node,
    spec::names::{Names, Picked, Place, quoted},
};
use std::collections::BTreeMap;

/// Checks an aggregate; returns the names of its rows and columns.
pub(super) fn aggregate(
    spec: &Aggregate,
    names: &mut Names<'_>,
    place: &Place<'_>,
    published: Option<&Place<'_>>,
) -> (Vec<String>, Vec<String>) {
    let picked = names.pick(place);
    names.metric(&spec.value, place, "value", &picked);
    suite(names, place, &picked);
    match &spec.normalise {
        Normalise::Agents { low, high } => two_agents(names, low, high, place, &picked),
        Normalise::Numbers(numbers) => two_numbers(names, numbers, place, &picked),
    }
    if let Some(other) = &spec.relative_to {
        plays_everywhere(names, other, "relative_to", place, &picked);
    }
    thresholds(names, &spec.profile_at, place);
    let rows: Vec<String> = picked
        .agents
        .iter()
        .map(|index| names.world.agents[*index].clone())
        .collect();
    let columns = spec.columns();
    let environments = picked
        .environments
        .iter()
        .map(|index| names.world.environments[*index].clone());
    let shown: Vec<String> = columns
        .iter()
        .cloned()
        .chain(environments)
        .chain([spec.value.clone()])
        .collect();
    // Agents that only set the scale are named too.
    let scale = names
        .world
        .agents
        .iter()
        .filter(|name| spec.fixed().iter().any(|(fixed, _)| fixed == name));
    let others: Vec<String> = scale.filter(|name| !rows.contains(name)).cloned().collect();
    names.labels(place, &[rows.clone(), others].concat(), &shown);
    if let Some(published) = published {
        published_means(names, spec, published, &columns);
    }
    (rows, columns)
}

/// At least two environments, no settings to mix, and listed agents with trials everywhere.
fn suite(names: &mut Names<'_>, place: &Place<'_>, picked: &Picked) {
    let count = picked.environments.len();
    if count < 2 {
        let message = format!("an aggregate is over at least two environments, found {count}");
        names.say(
            place.value("environments"),
            message,
            "`comparison` shows one environment",
        );
    }
    if names.world.settings.iter().any(|setting| !setting.is_empty()) {
        let message =
            "an aggregate pools seeds and environments, and would pool the settings of `sweep` with them";
        names.say(
            (place.key, place.at.clone()),
            message,
            "`comparison` shows settings side by side",
        );
    }
    for item in place.below("agents").map_or(&[][..], |list| list.node.items()) {
        let index = item
            .as_str()
            .and_then(|name| names.world.agents.iter().position(|known| known == name));
        if let Some(missing) = index.and_then(|index| first_without(names, index, picked)) {
            let message = format!(
                "the agent `{}` has no trial in `{missing}`",
                item.as_str().unwrap_or_default()
            );
            names.say(
                (item.span, format!("{}.agents", place.at)),
                message,
                "list only agents that play all environments",
            );
        }
    }
}

/// The first environment in which an agent has no trial.
fn first_without(names: &Names<'_>, agent: usize, picked: &Picked) -> Option<String> {
    let without = |environment: &&usize| !names.world.recorded.contains_key(&(**environment, agent));
    picked
        .environments
        .iter()
        .find(without)
        .map(|index| names.world.environments[*index].clone())
}

/// Checks an agent that the others are measured by: it has a trial in every environment.
fn plays_everywhere(names: &mut Names<'_>, name: &str, key: &str, place: &Place<'_>, picked: &Picked) {
    let Some(index) = names.world.agents.iter().position(|known| known == name) else {
        let help = suggest(name, names.world.agents.iter().map(String::as_str));
        return names.say(place.value(key), format!("no agent is named `{name}`"), help);
    };
    if let Some(missing) = first_without(names, index, picked) {
        let message =
            format!("the agent `{name}` has no trial in `{missing}`, so nothing can be measured by it there");
        names.say(
            place.value(key),
            message,
            "choose `environments` in which it plays",
        );
    }
}

fn two_agents(names: &mut Names<'_>, low: &str, high: &str, place: &Place<'_>, picked: &Picked) {
    let Some(inner) = place.below("normalise") else {
        return;
    };
    plays_everywhere(names, low, "low", &inner, picked);
    if low == high {
        return names.say(
            inner.value("high"),
            format!("`{low}` cannot stand for both 0 and 1"),
            "choose two agents",
        );
    }
    plays_everywhere(names, high, "high", &inner, picked);
}

fn two_numbers(
    names: &mut Names<'_>,
    numbers: &BTreeMap<String, [f64; 2]>,
    place: &Place<'_>,
    picked: &Picked,
) {
    let Some(inner) = place.below("normalise") else {
        return;
    };
    for (name, [low, high]) in numbers {
        if !names.world.environments.contains(name) {
            let span = inner.node.entry(name).map_or(inner.key, |entry| entry.key_span);
            let help = suggest(name, names.world.environments.iter().map(String::as_str));
            names.say(
                (span, format!("{}.{name}", inner.at)),
                format!("no environment is named `{name}`"),
                help,
            );
        } else if low == high {
            let message = format!("{low} cannot stand for both 0 and 1");
            names.say(
                inner.value(name),
                message,
                "write the score of a floor and that of a ceiling, `[LOW, HIGH]`",
            );
        }
    }
    let without: Vec<String> = picked
        .environments
        .iter()
        .map(|index| names.world.environments[*index].clone())
        .filter(|name| !numbers.contains_key(name))
        .collect();
    if !without.is_empty() {
        let message = format!(
            "`normalise` does not say what 0 and 1 stand for in {}",
            quoted(&without)
        );
        names.say(
            (inner.key, inner.at.clone()),
            message,
            format!("write `{}: [LOW, HIGH]`", without[0]),
        );
    }
}

fn thresholds(names: &mut Names<'_>, scores: &[f64], place: &Place<'_>) {
    if let Some(pair) = scores.windows(2).find(|pair| pair[0] >= pair[1]) {
        let message = format!("scores must rise, {} follows {}", pair[1], pair[0]);
        names.say(place.value("profile_at"), message, "");
    }
}

/// Published values may stand beside means alone, and beside nothing that is fixed by construction.
fn published_means(names: &mut Names<'_>, spec: &Aggregate, published: &Place<'_>, columns: &[String]) {
    for entry in published.node.entries() {
        let row = Place::of(entry, format!("{}.{}", published.at, entry.key));
        if let Some((_, score)) = spec.fixed().iter().find(|(name, _)| *name == entry.key) {
            let message = format!(
                "the score of `{}` is {score} by construction, so nothing can differ from it",
                entry.key
            );
            names.say((row.key, row.at), message, "remove its published values");
        } else if row.node.as_str().is_some() || is_number(row.node) {
            let help = format!("write `{}: {{ {SUITE_MEAN}: VALUE }}`", entry.key);
            names.say((row.key, row.at), "an aggregate has several columns", help);
        } else {
            for inner in row
                .node
                .entries()
                .iter()
                .filter(|it| it.key != SUITE_MEAN && columns.contains(&it.key))
            {
                let message = format!(
                    "published values are compared with means over seeds, and `{}` is none",
                    inner.key
                );
                names.say(
                    (inner.key_span, format!("{}.{}", row.at, inner.key)),
                    message,
                    format!("only `{SUITE_MEAN}` is"),
                );
            }
        }
    }
}

fn is_number(node: &Node) -> bool {
    node.to_value().is_number()
}
