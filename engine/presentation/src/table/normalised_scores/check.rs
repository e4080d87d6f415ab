//! Checks normalised scores against the names that trials record: environments, agents, and settings that would be
//! pooled.

use super::{Bound, Normalisation};
use crate::names::{Names, Picked, Place, quoted};
use document::diagnostic::suggest;
use std::collections::BTreeMap;

/// Words for a table or figure that pools normalised scores, for messages.
pub(crate) struct PoolWording {
    /// The table or figure, as in `an aggregate`.
    pub(crate) what: &'static str,
    /// The table or figure that shows settings one by one.
    pub(crate) instead: &'static str,
}

/// Checks the ends of the scale in every environment, that no settings are mixed, and that listed agents have trials
/// in all environments.
pub(crate) fn normalised(
    normalise: &Normalisation,
    pooled: &PoolWording,
    names: &mut Names<'_>,
    place: &Place<'_>,
    picked: &Picked,
) {
    suite(normalise, pooled, names, place, picked);
    match normalise {
        Normalisation::Agents { low, high } => two_agents(names, low, high, place, picked),
        Normalisation::ByEnvironment(bounds) => by_environment(names, bounds, place, picked),
    }
}

fn suite(
    normalise: &Normalisation,
    pooled: &PoolWording,
    names: &mut Names<'_>,
    place: &Place<'_>,
    picked: &Picked,
) {
    // The settings of an agent at an end of the scale would be pooled too.
    let ends = normalise.agents();
    let known = names.vocabulary.agents.iter().enumerate();
    let ends = known.filter(|(_, name)| ends.contains(&name.as_str()));
    let behind: Vec<usize> = ends
        .map(|(index, _)| index)
        .chain(picked.agents.iter().copied())
        .collect();
    if names.vocabulary.sweeps_any(&behind) {
        let message = format!(
            "{} pools seeds and environments, and would pool the settings of `sweep` with them",
            pooled.what
        );
        names.say((place.key, place.at.clone()), message, pooled.instead);
    }
    for item in place.below("agents").map_or(&[][..], |list| list.node.items()) {
        let index = item
            .as_str()
            .and_then(|name| names.vocabulary.agents.iter().position(|known| known == name));
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
    let without = |environment: &&usize| !names.vocabulary.recorded.contains_key(&(**environment, agent));
    picked
        .environments
        .iter()
        .find(without)
        .map(|index| names.vocabulary.environments[*index].clone())
}

/// Checks that an agent at an end of the scale has a trial in every environment.
pub(crate) fn plays_everywhere(
    names: &mut Names<'_>,
    name: &str,
    key: &str,
    place: &Place<'_>,
    picked: &Picked,
) {
    let Some(index) = names.vocabulary.agents.iter().position(|known| known == name) else {
        let help = suggest(name, names.vocabulary.agents.iter().map(String::as_str));
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

fn by_environment(
    names: &mut Names<'_>,
    bounds: &BTreeMap<String, [Bound; 2]>,
    place: &Place<'_>,
    picked: &Picked,
) {
    let Some(inner) = place.below("normalise") else {
        return;
    };
    for (name, ends) in bounds {
        let environment = names
            .vocabulary
            .environments
            .iter()
            .position(|known| known == name);
        if let Some(environment) = environment {
            two_ends(names, ends, &inner, (name, environment));
        } else {
            let span = inner.node.entry(name).map_or(inner.key, |entry| entry.key_span);
            let help = suggest(name, names.vocabulary.environments.iter().map(String::as_str));
            names.say(
                (span, format!("{}.{name}", inner.at)),
                format!("no environment is named `{name}`"),
                help,
            );
        }
    }
    let without: Vec<String> = picked
        .environments
        .iter()
        .map(|index| names.vocabulary.environments[*index].clone())
        .filter(|name| !bounds.contains_key(name))
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

/// Checks floor and ceiling of one environment: they differ, and agents at them have trials there.
fn two_ends(names: &mut Names<'_>, ends: &[Bound; 2], inner: &Place<'_>, (name, environment): (&str, usize)) {
    let [low, high] = ends;
    if low == high {
        let low = match low {
            Bound::Number(number) => number.to_string(),
            Bound::Agent(agent) => format!("`{agent}`"),
        };
        return names.say(
            inner.value(name),
            format!("{low} cannot stand for both 0 and 1"),
            "write the score of a floor and that of a ceiling, `[LOW, HIGH]`",
        );
    }
    let vocabulary = names.vocabulary;
    let items = inner.below(name).map_or(&[][..], |list| list.node.items());
    for item in items
        .iter()
        .filter(|item| ends.iter().any(|end| end.agent() == item.as_str()))
    {
        let at = format!("{}.{name}", inner.at);
        let agents = &vocabulary.agents;
        if let Some(agent) = names.known(item, "agent", agents, &at)
            && !names.vocabulary.recorded.contains_key(&(environment, agent))
        {
            let message = format!(
                "the agent `{}` has no trial in `{name}`",
                names.vocabulary.agents[agent]
            );
            names.say(
                (item.span, at),
                message,
                "name one that plays there, or write a number",
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vocabulary::{SweptKey, Vocabulary};
    use document::{
        Node,
        diagnostic::{Sources, Span},
    };

    /// Number of messages on an aggregate over these agents, scaled between `low` and `equal`, where the rate of `r` is
    /// swept.
    fn messages(agents: &[&str], low: &str) -> usize {
        let agent_names = ["equal", "water", "r"].map(String::from).to_vec();
        let swept = SweptKey {
            key: "agents.r.rate".into(),
            agent: Some(2),
            values: vec![0.1.into(), 0.2.into()].into(),
        };
        let vocabulary = Vocabulary {
            environments: vec!["e".into()],
            recorded: (0..3)
                .map(|agent| ((0, agent), ["return".into()].into()))
                .collect(),
            agents: agent_names,
            settings: vec!["".into(), "rate=0.1".into(), "rate=0.2".into()],
            swept: vec![swept.into()],
            ..Vocabulary::default()
        };
        let mut sources = Sources::default();
        sources.add_file("study.yaml", "");
        let span = Span {
            line: 1,
            column: 1,
            length: 1,
            ..Span::default()
        };
        let node = Node::from_value(
            span,
            &serde_json::json!({ "agents": agents, "normalise": { "low": low, "high": "equal" } }),
        );
        let place = Place {
            node: &node,
            key: span,
            at: "tables.t.aggregate".into(),
        };
        let mut names = Names::new(&vocabulary, &sources);
        let picked = names.pick(&place);
        let normalise = Normalisation::Agents {
            low: low.into(),
            high: "equal".into(),
        };
        let pooled = PoolWording {
            what: "an aggregate",
            instead: "",
        };
        normalised(&normalise, &pooled, &mut names, &place, &picked);
        names.into_found().len()
    }

    #[test]
    fn only_settings_of_agents_behind_the_scores_are_refused() {
        assert_eq!(messages(&["equal", "water"], "water"), 0);
        assert_eq!(messages(&["equal", "r"], "water"), 1);
        assert_eq!(messages(&[], "water"), 1, "all agents are picked");
        assert_eq!(
            messages(&["equal", "water"], "r"),
            1,
            "the end of the scale is swept"
        );
    }
}
