//! Aggregates against what trials record: environments, agents, what the scores 0 and 1 stand for.

use super::{Names, Picked, Place, quoted};
use crate::{
    diagnostic::suggest,
    document::Node,
    table::{Aggregate, Normalise, SUITE_MEAN},
};
use std::collections::BTreeMap;

impl Names<'_> {
    /// Checks an aggregate; returns the names of its rows and columns.
    pub(super) fn aggregate(
        &mut self,
        spec: &Aggregate,
        place: &Place<'_>,
        published: Option<&Place<'_>>,
    ) -> (Vec<String>, Vec<String>) {
        let picked = self.pick(place);
        self.metric(&spec.value, place, "value", &picked);
        self.suite(place, &picked);
        match &spec.normalise {
            Normalise::Agents { low, high } => self.two_agents(low, high, place, &picked),
            Normalise::Numbers(numbers) => self.two_numbers(numbers, place, &picked),
        }
        if let Some(other) = &spec.relative_to {
            self.plays_everywhere(other, "relative_to", place, &picked);
        }
        self.thresholds(&spec.profile_at, place);
        let rows: Vec<String> = picked.agents.iter().map(|index| self.world.agents[*index].clone()).collect();
        let columns = spec.columns();
        let environments = picked.environments.iter().map(|index| self.world.environments[*index].clone());
        let shown: Vec<String> = columns.iter().cloned().chain(environments).chain([spec.value.clone()]).collect();
        // Agents that only set the scale are named too.
        let scale = self.world.agents.iter().filter(|name| spec.fixed().iter().any(|(fixed, _)| fixed == name));
        let others: Vec<String> = scale.filter(|name| !rows.contains(name)).cloned().collect();
        self.labels(place, &[rows.clone(), others].concat(), &shown);
        if let Some(published) = published {
            self.published_means(spec, published, &columns);
        }
        (rows, columns)
    }

    /// At least two environments, no settings to mix, and listed agents with trials everywhere.
    fn suite(&mut self, place: &Place<'_>, picked: &Picked) {
        let count = picked.environments.len();
        if count < 2 {
            let message = format!("an aggregate is over at least two environments, found {count}");
            self.say(place.value("environments"), message, "`comparison` shows one environment");
        }
        if self.world.settings.iter().any(|setting| !setting.is_empty()) {
            let message = "an aggregate pools seeds and environments, and would pool the settings of `sweep` with them";
            self.say((place.key, place.at.clone()), message, "`comparison` shows settings side by side");
        }
        for item in place.below("agents").map_or(&[][..], |list| list.node.items()) {
            let index = item.as_str().and_then(|name| self.world.agents.iter().position(|known| known == name));
            if let Some(missing) = index.and_then(|index| self.first_without(index, picked)) {
                let message = format!("the agent `{}` has no trial in `{missing}`", item.as_str().unwrap_or_default());
                self.say((item.span, format!("{}.agents", place.at)), message, "list only agents that play all environments");
            }
        }
    }

    /// The first environment in which an agent has no trial.
    fn first_without(&self, agent: usize, picked: &Picked) -> Option<String> {
        let without = |environment: &&usize| !self.world.recorded.contains_key(&(**environment, agent));
        picked.environments.iter().find(without).map(|index| self.world.environments[*index].clone())
    }

    /// Checks an agent that the others are measured by: it has a trial in every environment.
    fn plays_everywhere(&mut self, name: &str, key: &str, place: &Place<'_>, picked: &Picked) {
        let Some(index) = self.world.agents.iter().position(|known| known == name) else {
            let help = suggest(name, self.world.agents.iter().map(String::as_str));
            return self.say(place.value(key), format!("no agent is named `{name}`"), help);
        };
        if let Some(missing) = self.first_without(index, picked) {
            let message = format!("the agent `{name}` has no trial in `{missing}`, so nothing can be measured by it there");
            self.say(place.value(key), message, "choose `environments` in which it plays");
        }
    }

    fn two_agents(&mut self, low: &str, high: &str, place: &Place<'_>, picked: &Picked) {
        let Some(inner) = place.below("normalise") else { return };
        self.plays_everywhere(low, "low", &inner, picked);
        if low == high {
            return self.say(inner.value("high"), format!("`{low}` cannot stand for both 0 and 1"), "choose two agents");
        }
        self.plays_everywhere(high, "high", &inner, picked);
    }

    fn two_numbers(&mut self, numbers: &BTreeMap<String, [f64; 2]>, place: &Place<'_>, picked: &Picked) {
        let Some(inner) = place.below("normalise") else { return };
        for (name, [low, high]) in numbers {
            if !self.world.environments.contains(name) {
                let span = inner.node.entry(name).map_or(inner.key, |entry| entry.key_span);
                let help = suggest(name, self.world.environments.iter().map(String::as_str));
                self.say((span, format!("{}.{name}", inner.at)), format!("no environment is named `{name}`"), help);
            } else if low == high {
                let message = format!("{low} cannot stand for both 0 and 1");
                self.say(inner.value(name), message, "write the score of a floor and that of a ceiling, `[LOW, HIGH]`");
            }
        }
        let without: Vec<String> = picked
            .environments
            .iter()
            .map(|index| self.world.environments[*index].clone())
            .filter(|name| !numbers.contains_key(name))
            .collect();
        if !without.is_empty() {
            let message = format!("`normalise` does not say what 0 and 1 stand for in {}", quoted(&without));
            self.say((inner.key, inner.at.clone()), message, format!("write `{}: [LOW, HIGH]`", without[0]));
        }
    }

    fn thresholds(&mut self, scores: &[f64], place: &Place<'_>) {
        if let Some(pair) = scores.windows(2).find(|pair| pair[0] >= pair[1]) {
            let message = format!("scores must rise, {} follows {}", pair[1], pair[0]);
            self.say(place.value("profile_at"), message, "");
        }
    }

    /// Published values may stand beside means alone, and beside nothing that is fixed by construction.
    fn published_means(&mut self, spec: &Aggregate, published: &Place<'_>, columns: &[String]) {
        for entry in published.node.entries() {
            let row = Place::of(entry, format!("{}.{}", published.at, entry.key));
            if let Some((_, score)) = spec.fixed().iter().find(|(name, _)| *name == entry.key) {
                let message = format!("the score of `{}` is {score} by construction, so nothing can differ from it", entry.key);
                self.say((row.key, row.at), message, "remove its published values");
            } else if row.node.as_str().is_some() || is_number(row.node) {
                let help = format!("write `{}: {{ {SUITE_MEAN}: VALUE }}`", entry.key);
                self.say((row.key, row.at), "an aggregate has several columns", help);
            } else {
                for inner in row.node.entries().iter().filter(|it| it.key != SUITE_MEAN && columns.contains(&it.key)) {
                    let message = format!("published values are compared with means over seeds, and `{}` is none", inner.key);
                    self.say((inner.key_span, format!("{}.{}", row.at, inner.key)), message, format!("only `{SUITE_MEAN}` is"));
                }
            }
        }
    }
}

fn is_number(node: &Node) -> bool {
    node.to_value().is_number()
}
