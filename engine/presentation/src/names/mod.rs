//! Names that trials record, for checks of tables, figures and claims.

mod place;
mod published_curves;

pub use place::{Picked, Place};

use crate::vocabulary::{KnownSearch, Vocabulary};
use contract::ArtifactKind;
use document::{
    Node,
    diagnostic::{Diagnostic, Sources, Span, suggest},
};
use std::collections::{BTreeMap, BTreeSet};

/// Checker of tables, figures and claims against the names that trials record; collects their mistakes.
pub struct Names<'a> {
    /// Names that trials may record.
    pub vocabulary: &'a Vocabulary,
    pub(crate) sources: &'a Sources,
    /// Rows and columns of the tables by name; none if a table cannot be read.
    pub(crate) shown: BTreeMap<String, (Vec<String>, Vec<String>)>,
    pub(crate) found: Vec<Diagnostic>,
}

impl<'a> Names<'a> {
    /// A checker that has found no mistake yet.
    #[must_use]
    pub fn new(vocabulary: &'a Vocabulary, sources: &'a Sources) -> Self {
        Self {
            vocabulary,
            sources,
            shown: BTreeMap::new(),
            found: Vec::new(),
        }
    }

    /// The search whose name stands under `search`; reports a name that no search has.
    pub fn search(&mut self, name: &str, at: &Place<'_>) -> Option<&'a KnownSearch> {
        let known = &self.vocabulary.searches;
        let found = known.iter().find(|it| it.name == name);
        if found.is_none() {
            let help = suggest(name, known.iter().map(|it| it.name.as_str()));
            self.say(at.value("search"), format!("no search is named `{name}`"), help);
        }
        found
    }

    /// The mistakes that were found.
    #[must_use]
    pub fn into_found(self) -> Vec<Diagnostic> {
        self.found
    }
}

impl Names<'_> {
    /// Notes a mistake at a place.
    pub fn say(&mut self, (span, at): (Span, String), message: impl Into<String>, help: impl Into<String>) {
        let help = help.into();
        let error = self.sources.error(span, &at, message);
        self.found
            .push(if help.is_empty() { error } else { error.help(help) });
    }

    /// All agents and environments.
    pub fn all(&self) -> Picked {
        let vocabulary = self.vocabulary;
        Picked {
            agents: (0..vocabulary.agents.len()).collect(),
            environments: (0..vocabulary.environments.len()).collect(),
        }
    }

    /// Names that traces of these environments contain.
    #[must_use]
    pub fn traced(&self, picked: &Picked) -> BTreeSet<String> {
        picked
            .environments
            .iter()
            .filter_map(|index| self.vocabulary.traced.get(index))
            .flatten()
            .cloned()
            .collect()
    }

    /// Metrics that some trial of these agents and environments records.
    #[must_use]
    pub fn recorded(&self, picked: &Picked) -> BTreeSet<String> {
        let pairs = picked
            .environments
            .iter()
            .flat_map(|environment| picked.agents.iter().map(move |agent| (*environment, *agent)));
        pairs
            .filter_map(|pair| self.vocabulary.recorded.get(&pair))
            .flatten()
            .cloned()
            .collect()
    }

    /// Reports a missing metric, or one that no such trial records.
    pub fn metric(&mut self, name: &str, place: &Place<'_>, key: &str, picked: &Picked) {
        if name.is_empty() {
            return self.say(
                (place.key, place.at.clone()),
                format!("`{key}` is missing: it names a metric"),
                "",
            );
        }
        let recorded = self.recorded(picked);
        if !recorded.contains(name) && !recorded.is_empty() {
            self.unknown_metric(name, place.value(key), &recorded);
        }
    }

    /// Reports that no trial records a metric, and lists the recorded ones.
    pub fn unknown_metric(&mut self, name: &str, place: (Span, String), recorded: &BTreeSet<String>) {
        let list = recorded.iter().map(String::as_str).collect::<Vec<_>>();
        let known = list
            .iter()
            .map(|name| format!("`{name}`"))
            .collect::<Vec<_>>()
            .join(", ");
        let help = match document::diagnostic::nearest(name, &list) {
            Some(near) => format!("did you mean `{near}`? recorded here: {known}"),
            None => format!("recorded here: {known}"),
        };
        self.say(place, format!("no trial records `{name}`"), help);
    }

    /// The agents and environments that a table or figure names; without names, all that have trials.
    pub fn pick(&mut self, place: &Place<'_>) -> Picked {
        let vocabulary = self.vocabulary;
        let one = |key: &str| {
            place
                .node
                .entry(key)
                .filter(|entry| entry.value.as_str().is_some())
        };
        let mut environments = self.listed(place, "environments", "environment", &vocabulary.environments);
        if let Some(entry) = one("environment") {
            environments = self
                .known(&entry.value, "environment", &vocabulary.environments, &place.at)
                .into_iter()
                .collect();
        }
        let agents = self.listed(place, "agents", "agent", &vocabulary.agents);
        let all = |n: usize| (0..n).collect::<Vec<_>>();
        let picked = Picked {
            agents: if agents.is_empty() {
                all(vocabulary.agents.len())
            } else {
                agents.clone()
            },
            environments: if environments.is_empty() {
                all(vocabulary.environments.len())
            } else {
                environments.clone()
            },
        };
        let before = self.found.len();
        for agent in agents {
            self.meets(place, &picked, ("agents", "agent", agent));
        }
        // Agents and environments without common trials need only one message.
        if before == self.found.len() {
            for environment in environments {
                self.meets(place, &picked, ("environments", "environment", environment));
            }
        }
        picked
    }

    /// Reports a named agent or environment without a trial among those that are picked.
    fn meets(&mut self, place: &Place<'_>, picked: &Picked, (key, kind, index): (&str, &str, usize)) {
        let vocabulary = self.vocabulary;
        let has_trial = |pair| vocabulary.recorded.contains_key(&pair);
        let (name, others, meets) = if kind == "agent" {
            let mut environments = picked.environments.iter();
            let meets = environments.any(|environment| has_trial((*environment, index)));
            (&vocabulary.agents[index], "environments", meets)
        } else {
            let mut agents = picked.agents.iter();
            (
                &vocabulary.environments[index],
                "agents",
                agents.any(|agent| has_trial((index, *agent))),
            )
        };
        if !meets {
            let message = format!("no trial feeds the {kind} `{name}` here");
            let help = format!("`exclude` leaves out its combinations with these {others}");
            self.say(place.value(key), message, help);
        }
    }

    fn listed(&mut self, place: &Place<'_>, key: &str, kind: &str, known: &[String]) -> Vec<usize> {
        let Some(list) = place.below(key) else {
            return Vec::new();
        };
        let mut indices = Vec::new();
        for item in list.node.items() {
            let Some(index) = self.known(item, kind, known, &list.at) else {
                continue;
            };
            if indices.contains(&index) {
                self.say(
                    (item.span, list.at.clone()),
                    format!("`{}` is listed twice", known[index]),
                    "remove one of the two",
                );
            } else {
                indices.push(index);
            }
        }
        indices
    }

    /// The index of a name among the known ones; reports an unknown name.
    pub fn known(&mut self, item: &Node, kind: &str, known: &[String], at: &str) -> Option<usize> {
        let name = item.as_str()?;
        let index = known.iter().position(|it| it == name);
        if index.is_none() {
            let help = suggest(name, known.iter().map(String::as_str));
            self.say(
                (item.span, at.into()),
                format!("no {kind} is named `{name}`"),
                help,
            );
        }
        index
    }

    /// Checks that a seed is one of the study's.
    pub(crate) fn seed(&mut self, seed: Option<u64>, place: &Place<'_>) {
        if let Some(seed) = seed.filter(|seed| !self.vocabulary.seeds.contains(seed)) {
            let seeds = self
                .vocabulary
                .seeds
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>()
                .join(", ");
            self.say(
                place.value("seed"),
                format!("no trial has the seed {seed}"),
                format!("seeds of this study: {seeds}"),
            );
        }
    }

    /// Checks that protocols leave the artifacts that a figure shows: the protocol of every named agent, or any
    /// protocol if no agent is named.
    pub(crate) fn leaves(&mut self, kind: ArtifactKind, place: &Place<'_>, picked: &Picked) {
        let vocabulary = self.vocabulary;
        let what = match kind {
            ArtifactKind::Images => kind.to_string(),
            _ => format!("a {kind}"),
        };
        let leaves = |agent: usize| {
            let mut pairs = picked
                .environments
                .iter()
                .map(|environment| (*environment, agent));
            pairs.any(|pair| {
                vocabulary
                    .left
                    .get(&pair)
                    .is_some_and(|left| left.contains(&kind))
            })
        };
        let runs = |agent: &usize| {
            let mut pairs = picked
                .environments
                .iter()
                .map(|environment| (*environment, *agent));
            pairs.any(|pair| vocabulary.left.contains_key(&pair))
        };
        let help = format!("a protocol that leaves {what} has to run it");
        let named = place
            .node
            .entry("agents")
            .is_some_and(|list| !list.value.items().is_empty());
        let agents: Vec<usize> = picked.agents.iter().copied().filter(runs).collect();
        if named {
            for agent in agents.into_iter().filter(|agent| !leaves(*agent)) {
                let message = format!("no trial of `{}` leaves {what}", vocabulary.agents[agent]);
                self.say(place.value("agents"), message, help.clone());
            }
        } else if !agents.is_empty() && !agents.into_iter().any(leaves) {
            let message = format!("no trial here leaves {what}");
            self.say((place.key, place.at.clone()), message, help);
        }
    }

    /// Names of traced values, where a word without a number stands for all numbered ones.
    pub(crate) fn channels(
        &mut self,
        place: &Place<'_>,
        key: &str,
        least: usize,
        most: usize,
        picked: &Picked,
    ) {
        let list = place.below(key);
        let items = list.as_ref().map_or(&[][..], |list| list.node.items());
        if items.len() < least || items.len() > most {
            let wanted = if least == most {
                most.to_string()
            } else if items.len() > most {
                format!("at most {most}")
            } else {
                format!("at least {least}")
            };
            self.say(
                place.value(key),
                format!("`{key}` needs {wanted} names, but has {}", items.len()),
                "",
            );
        }
        let known = self.traced(picked);
        let whole = |name: &str| {
            name.rsplit_once('_')
                .filter(|(_, number)| number.parse::<u32>().is_ok())
                .map(|(word, _)| word.to_string())
        };
        let words: BTreeSet<String> = known.iter().filter_map(|name| whole(name)).collect();
        for item in items {
            let Some(name) = item
                .as_str()
                .filter(|name| !known.contains(*name) && !words.contains(*name))
            else {
                continue;
            };
            let help = suggest(
                name,
                words
                    .iter()
                    .chain(known.iter().filter(|name| whole(name).is_none()))
                    .map(String::as_str),
            );
            self.say(
                (item.span, format!("{}.{key}", place.at)),
                format!("no trial traces `{name}`"),
                help,
            );
        }
    }

    pub(crate) fn labels(&mut self, place: &Place<'_>, rows: &[String], columns: &[String]) {
        let Some(labels) = place.below("labels") else {
            return;
        };
        let known: Vec<&str> = rows.iter().chain(columns).map(String::as_str).collect();
        for entry in labels
            .node
            .entries()
            .iter()
            .filter(|entry| !known.contains(&entry.key.as_str()))
        {
            let message = format!(
                "`{}` is no row or column, so its label is never printed",
                entry.key
            );
            self.say(
                (entry.key_span, format!("{}.{}", labels.at, entry.key)),
                message,
                suggest(&entry.key, known.iter().copied()),
            );
        }
    }
}

/// Names in backticks, with commas.
#[must_use]
pub fn quoted(names: &[String]) -> String {
    names
        .iter()
        .map(|name| format!("`{name}`"))
        .collect::<Vec<_>>()
        .join(", ")
}
