//! Figures against what trials record and trace.

use super::{Names, Picked, Place};
use crate::{
    diagnostic::suggest,
    document::{Entry, Node},
    figure::{FigureSpec, KINDS, LearningCurve},
    published_curve::{PublishedCurve, PublishedCurveError},
};
use std::collections::BTreeSet;

impl Names<'_> {
    /// Checks every name in a figure.
    pub(super) fn figure(&mut self, spec: &FigureSpec, entry: &Entry) {
        let place = Place::of(entry, format!("figures.{}", entry.key));
        let given: Vec<&str> =
            KINDS.into_iter().filter(|kind| place.node.get(kind).is_some_and(|node| !node.to_value().is_null())).collect();
        let [kind] = given.as_slice() else {
            let kinds = KINDS.map(|kind| format!("`{kind}`")).join(", ");
            return self.one_kind(&format!("the figure `{}`", entry.key), &place, &given, &kinds);
        };
        let Some(inner) = place.below(kind) else { return };
        if let Some(bars) = &spec.bars {
            let of = inner.below("of").unwrap_or(inner.clone());
            self.comparison(&bars.of, &of, false);
        }
        let mut picked = self.pick(&inner);
        if spec.trajectory.is_some() || spec.contour.is_some() {
            // One environment is shown: the one that is named, else the first.
            picked.environments.truncate(1);
        }
        if let Some(curve) = &spec.learning_curve {
            self.metric(&curve.metric, &inner, "metric", &picked);
            self.published_curves(curve, &inner, &picked);
        }
        if let Some(lines) = &spec.grouped_lines {
            self.metric(&lines.metric, &inner, "metric", &picked);
            self.swept(&lines.x, &inner);
        }
        if let Some(scatter) = &spec.scatter {
            self.metric(&scatter.x, &inner, "x", &picked);
            self.metric(&scatter.y, &inner, "y", &picked);
        }
        if let Some(trajectory) = &spec.trajectory {
            self.channels(&inner, "channels", 1, usize::MAX, &picked);
            self.seed(trajectory.seed, &inner);
        }
        if let Some(contour) = &spec.contour {
            self.channels(&inner, "surface", 3, 3, &picked);
            self.path(&inner, &picked);
            self.seed(contour.seed, &inner);
        }
        self.figure_labels(&place);
    }

    fn published_curves(&mut self, spec: &LearningCurve, place: &Place<'_>, picked: &Picked) {
        let Some(list) = place.below("published") else { return };
        for (index, (curve, node)) in spec.published.iter().zip(list.node.items()).enumerate() {
            let place = Place { node, key: node.span, at: format!("{}[{index}]", list.at) };
            self.curve(curve, &place, picked);
        }
    }

    /// Checks what a published curve names, and reads it.
    pub(super) fn curve(&mut self, curve: &PublishedCurve, place: &Place<'_>, picked: &Picked) {
        self.agent_and_panel(place, picked);
        if let Err(error) = curve.runs() {
            self.unreadable(curve, &error, place);
        }
    }

    /// Whose colour a published curve takes, and in which panel it is drawn.
    fn agent_and_panel(&mut self, place: &Place<'_>, picked: &Picked) {
        let world = self.world;
        if let Some(node) = place.node.get("agent") {
            self.known(node, "agent", &world.agents, &format!("{}.agent", place.at));
        }
        let panels = || picked.environments.iter().map(|index| world.environments[*index].as_str());
        let named = place.node.get("environment").filter(|node| node.as_str().is_some());
        let Some(node) = named else {
            if picked.environments.len() > 1 {
                let message = "`environment` is missing: several are shown";
                self.say((place.key, place.at.clone()), message, suggest("", panels()));
            }
            return;
        };
        let at = format!("{}.environment", place.at);
        let index = self.known(node, "environment", &world.environments, &at);
        if let Some(index) = index.filter(|index| !picked.environments.contains(index)) {
            let message = format!("this figure has no panel of `{}`", world.environments[index]);
            self.say((node.span, at), message, suggest("", panels()));
        }
    }

    /// A published curve whose file does not hold what is asked of it, said at the key that asks.
    fn unreadable(&mut self, curve: &PublishedCurve, error: &PublishedCurveError, place: &Place<'_>) {
        match error {
            PublishedCurveError::Unreadable { file, .. } if !file.exists() => {
                let written = place.node.get("file").and_then(Node::as_str).unwrap_or_default();
                let help = format!("files are sought from the folder of the study: `{}`", file.display());
                self.say(place.value("file"), format!("there is no data file `{written}`"), help);
            }
            PublishedCurveError::NoColumn { column, known, .. } => {
                let keys = [("step", Some(&curve.step)), ("value", Some(&curve.value)), ("by", curve.by.as_ref())];
                let key = keys.into_iter().find(|(_, asked)| *asked == Some(column)).map(|(key, _)| key);
                let at = match (key, place.below("where")) {
                    (None, Some(rows)) => {
                        (rows.node.entry(column).map_or(rows.key, |entry| entry.key_span), format!("{}.{column}", rows.at))
                    }
                    (key, _) => place.value(key.unwrap_or("file")),
                };
                self.say(at, error.to_string(), suggest(column, known.iter().map(String::as_str)));
            }
            PublishedCurveError::NoRow { .. } => self.say(place.value("where"), error.to_string(), ""),
            PublishedCurveError::StepTwice { .. } if curve.by.is_none() => {
                self.say(place.value("step"), error.to_string(), "name the column that tells runs apart with `by`");
            }
            _ => self.say(place.value("file"), error.to_string(), ""),
        }
    }

    fn figure_labels(&mut self, place: &Place<'_>) {
        let Some(labels) = place.below("labels") else { return };
        let all =
            Picked { agents: (0..self.world.agents.len()).collect(), environments: (0..self.world.environments.len()).collect() };
        let mut known = self.traced(&all);
        known.extend(self.recorded(&all));
        known.extend(self.world.agents.iter().chain(&self.world.environments).chain(&self.world.settings).cloned());
        for entry in labels.node.entries().iter().filter(|entry| !known.contains(&entry.key)) {
            let message = format!("nothing in this figure is called `{}`, so its label is never printed", entry.key);
            let help = suggest(&entry.key, known.iter().map(String::as_str).filter(|name| !name.is_empty()));
            self.say((entry.key_span, format!("{}.{}", labels.at, entry.key)), message, help);
        }
    }

    fn swept(&mut self, key: &str, place: &Place<'_>) {
        if self.world.swept.is_empty() {
            self.say(place.value("x"), format!("`x` is `{key}`, but the study has no `sweep`"), "");
        } else if !self.world.swept.iter().any(|known| known == key) {
            let help = suggest(key, self.world.swept.iter().map(String::as_str));
            self.say(place.value("x"), format!("no sweep varies `{key}`"), help);
        }
    }

    fn seed(&mut self, seed: Option<u64>, place: &Place<'_>) {
        if let Some(seed) = seed.filter(|seed| !self.world.seeds.contains(seed)) {
            let seeds = self.world.seeds.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
            self.say(place.value("seed"), format!("no trial has the seed {seed}"), format!("seeds of this study: {seeds}"));
        }
    }

    /// The two metrics of a contour's path, which are measured during learning.
    fn path(&mut self, place: &Place<'_>, picked: &Picked) {
        let Some(list) = place.below("path") else { return };
        let items = list.node.items();
        if ![0, 2].contains(&items.len()) {
            self.say(place.value("path"), format!("`path` needs 2 names, but has {}", items.len()), "");
        }
        let recorded = self.recorded(picked);
        for item in items {
            if let Some(name) = item.as_str().filter(|name| !recorded.contains(*name)) {
                self.unknown_metric(name, (item.span, list.at.clone()), &recorded);
            }
        }
    }

    /// Names of traced values, where a word without a number stands for all numbered ones.
    fn channels(&mut self, place: &Place<'_>, key: &str, least: usize, most: usize, picked: &Picked) {
        let list = place.below(key);
        let items = list.as_ref().map_or(&[][..], |list| list.node.items());
        if items.len() < least || items.len() > most {
            let wanted = if least == most { most.to_string() } else { format!("at least {least}") };
            self.say(place.value(key), format!("`{key}` needs {wanted} names, but has {}", items.len()), "");
        }
        let known = self.traced(picked);
        let whole = |name: &str| {
            name.rsplit_once('_').filter(|(_, number)| number.parse::<u32>().is_ok()).map(|(word, _)| word.to_string())
        };
        let words: BTreeSet<String> = known.iter().filter_map(|name| whole(name)).collect();
        for item in items {
            let Some(name) = item.as_str().filter(|name| !known.contains(*name) && !words.contains(*name)) else { continue };
            let help = suggest(name, words.iter().chain(known.iter().filter(|name| whole(name).is_none())).map(String::as_str));
            self.say((item.span, format!("{}.{key}", place.at)), format!("no trial traces `{name}`"), help);
        }
    }
}
