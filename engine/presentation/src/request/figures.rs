//! Figures against what trials record and trace.

use super::{Names, Picked, Place};
use crate::figure::{FigureKind, FigureSpec};
use contract::ProductKind;
use document::{Entry, diagnostic::suggest};
use std::{collections::BTreeSet, path::Path};

impl Names<'_> {
    /// Reads a figure and checks every name in it; `None` where it is of no kind, or cannot be read, which
    /// was said.
    pub(super) fn figure(&mut self, entry: &Entry, folder: &Path) -> Option<FigureSpec> {
        let place = Place::of(entry, format!("figures.{}", entry.key));
        let (mut spec, kind) =
            self.kind::<FigureSpec>(&format!("the figure `{}`", entry.key), &place, FigureKind::ALL)?;
        spec.seek_from(folder);
        spec.kind.check(self, &place.below(kind.name)?);
        self.figure_labels(&place);
        Some(spec)
    }

    fn figure_labels(&mut self, place: &Place<'_>) {
        let Some(labels) = place.below("labels") else {
            return;
        };
        let all = self.all();
        let mut known = self.traced(&all);
        known.extend(self.recorded(&all));
        known.extend(
            self.vocabulary
                .agents
                .iter()
                .chain(&self.vocabulary.environments)
                .cloned(),
        );
        known.extend(self.vocabulary.settings.iter().map(ToString::to_string));
        for entry in labels
            .node
            .entries()
            .iter()
            .filter(|entry| !known.contains(&entry.key))
        {
            let message = format!(
                "nothing in this figure is called `{}`, so its label is never printed",
                entry.key
            );
            let help = suggest(
                &entry.key,
                known.iter().map(String::as_str).filter(|name| !name.is_empty()),
            );
            self.say(
                (entry.key_span, format!("{}.{}", labels.at, entry.key)),
                message,
                help,
            );
        }
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

    /// Checks that protocols leave what a figure shows: that of every agent that is named, or of any where
    /// none is.
    pub(crate) fn leaves(&mut self, kind: ProductKind, place: &Place<'_>, picked: &Picked) {
        let vocabulary = self.vocabulary;
        let what = match kind {
            ProductKind::Images => kind.to_string(),
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
}
