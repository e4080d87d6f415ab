//! Published curves against the study: their agents, their panels, and the contents of their files.

use super::{Names, Picked, Place};
use analysis::published_curve::{PublishedCurve, PublishedCurveError};
use document::{Node, diagnostic::suggest, reach::Outside};

impl Names<'_> {
    /// Checks the names in a published curve, and reads its file.
    pub(crate) fn curve(&mut self, curve: &PublishedCurve, place: &Place<'_>, picked: &Picked) {
        self.agent_and_panel(place, picked);
        if let Err(error) = curve.runs() {
            self.unreadable(curve, &error, place);
        }
    }

    /// Checks the agent that gives a published curve its colour, and the environment of its panel.
    fn agent_and_panel(&mut self, place: &Place<'_>, picked: &Picked) {
        let vocabulary = self.vocabulary;
        if let Some(node) = place.node.get("agent") {
            self.known(node, "agent", &vocabulary.agents, &format!("{}.agent", place.at));
        }
        let panels = || {
            picked
                .environments
                .iter()
                .map(|index| vocabulary.environments[*index].as_str())
        };
        let named = place
            .node
            .get("environment")
            .filter(|node| node.as_str().is_some());
        let Some(node) = named else {
            if picked.environments.len() > 1 {
                let message = "`environment` is missing: several are shown";
                self.say((place.key, place.at.clone()), message, suggest("", panels()));
            }
            return;
        };
        let at = format!("{}.environment", place.at);
        let index = self.known(node, "environment", &vocabulary.environments, &at);
        if let Some(index) = index.filter(|index| !picked.environments.contains(index)) {
            let message = format!("this figure has no panel of `{}`", vocabulary.environments[index]);
            self.say((node.span, at), message, suggest("", panels()));
        }
    }

    /// Reports a published curve whose file lacks the requested values, at the key that requests them.
    fn unreadable(&mut self, curve: &PublishedCurve, error: &PublishedCurveError, place: &Place<'_>) {
        match error {
            PublishedCurveError::Unreadable { file, .. } if !file.exists() => {
                let written = place.node.get("file").and_then(Node::as_str).unwrap_or_default();
                let help = format!(
                    "files are sought from the folder of the study: `{}`",
                    file.display()
                );
                self.say(
                    place.value("file"),
                    format!("there is no data file `{written}`"),
                    help,
                );
            }
            PublishedCurveError::NoColumn { column, known, .. } => {
                let keys = [
                    ("step", Some(&curve.step)),
                    ("value", Some(&curve.value)),
                    ("by", curve.by.as_ref()),
                ];
                let key = keys
                    .into_iter()
                    .find(|(_, asked)| *asked == Some(column))
                    .map(|(key, _)| key);
                let at = match (key, place.below("where")) {
                    (None, Some(rows)) => (
                        rows.node.entry(column).map_or(rows.key, |entry| entry.key_span),
                        format!("{}.{column}", rows.at),
                    ),
                    (key, _) => place.value(key.unwrap_or("file")),
                };
                self.say(
                    at,
                    error.to_string(),
                    suggest(column, known.iter().map(String::as_str)),
                );
            }
            PublishedCurveError::Outside(_) => {
                self.say(place.value("file"), error.to_string(), Outside::HELP);
            }
            PublishedCurveError::NoRow { .. } => self.say(place.value("where"), error.to_string(), ""),
            PublishedCurveError::StepTwice { .. } if curve.by.is_none() => {
                self.say(
                    place.value("step"),
                    error.to_string(),
                    "name the column that tells runs apart with `by`",
                );
            }
            _ => self.say(place.value("file"), error.to_string(), ""),
        }
    }
}
