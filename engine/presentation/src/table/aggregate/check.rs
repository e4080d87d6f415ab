//! Checks aggregates against the names that trials record: environments, agents, and the ends of the scale of scores.

use super::{Aggregate, SUITE_MEAN};
use crate::{
    names::{Names, Place},
    table::normalised_scores::{PoolWording, normalised, plays_everywhere},
};
use document::Node;

/// Checks an aggregate; returns the names of its rows and columns.
pub(super) fn aggregate(
    spec: &Aggregate,
    names: &mut Names<'_>,
    place: &Place<'_>,
    published: Option<&Place<'_>>,
) -> (Vec<String>, Vec<String>) {
    let picked = names.pick(place);
    names.metric(&spec.value, place, "value", &picked);
    if picked.environments.len() < 2 {
        let message = format!(
            "an aggregate is over at least two environments, found {}",
            picked.environments.len()
        );
        names.say(
            place.value("environments"),
            message,
            "`comparison` shows one environment",
        );
    }
    let pooled = PoolWording {
        what: "an aggregate",
        instead: "`comparison` shows settings side by side",
    };
    normalised(&spec.normalise, &pooled, names, place, &picked);
    if let Some(other) = &spec.relative_to {
        plays_everywhere(names, other, "relative_to", place, &picked);
    }
    thresholds(names, &spec.profile_at, place);
    let rows: Vec<String> = picked
        .agents
        .iter()
        .map(|index| names.vocabulary.agents[*index].clone())
        .collect();
    let columns = spec.columns();
    let environments = picked
        .environments
        .iter()
        .map(|index| names.vocabulary.environments[*index].clone());
    let shown: Vec<String> = columns
        .iter()
        .cloned()
        .chain(environments)
        .chain([spec.value.clone()])
        .collect();
    // Agents that only set the scale may also be named.
    let scale = names
        .vocabulary
        .agents
        .iter()
        .filter(|name| spec.normalise.agents().contains(&name.as_str()));
    let others: Vec<String> = scale.filter(|name| !rows.contains(name)).cloned().collect();
    names.labels(place, &[rows.clone(), others].concat(), &shown);
    if let Some(published) = published {
        published_means(names, spec, published, &columns);
    }
    (rows, columns)
}

fn thresholds(names: &mut Names<'_>, scores: &[f64], place: &Place<'_>) {
    if let Some(pair) = scores.windows(2).find(|pair| pair[0] >= pair[1]) {
        let message = format!("scores must rise, {} follows {}", pair[1], pair[0]);
        names.say(place.value("profile_at"), message, "");
    }
}

/// Checks that published values are given only for means, and for no value that is fixed by construction.
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
