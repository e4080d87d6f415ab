//! Figures against the names that trials record and trace.

use crate::{
    figure::{Figure, FigureSpec},
    kinds::Readable,
    names::{Names, Place},
};
use document::{Entry, diagnostic::suggest};
use serde_json::{Map, Value};
use std::path::Path;

impl Names<'_> {
    /// Reads a figure and checks every name in it; `None` if it has no kind or cannot be read, after a diagnostic.
    pub(super) fn figure(
        &mut self,
        (keys, entry): (&Map<String, Value>, &Entry),
        kinds: &[Readable<dyn Figure>],
        folder: &Path,
    ) -> Option<FigureSpec> {
        let place = Place::of(entry, format!("figures.{}", entry.key));
        let what = format!("the figure `{}`", entry.key);
        let (mut spec, kind) = self.kind::<FigureSpec, _>(keys, (&what, &place), kinds, folder)?;
        spec.kind = kind;
        spec.kind.check(self, &place.below(spec.kind.name)?);
        self.figure_labels(&spec, &place);
        Some(spec)
    }

    fn figure_labels(&mut self, spec: &FigureSpec, place: &Place<'_>) {
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
        known.extend(spec.kind.further_names(self.vocabulary));
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
}
