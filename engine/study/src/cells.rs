//! From the sections of a study to its cells.

use super::{
    cell::{Cell, Cells, PairGrid, SettingKey},
    checked_sections::Sections,
    known::{PartCache, words},
    sweep::{Dimension, SweptKey},
    written::{NamedPart, PartKind, PreparedPart, PreparedTrial, Target},
};
use document::{
    Node,
    diagnostic::{Diagnostic, Span, suggest},
};
use serde_json::Value;
use std::sync::Arc;

impl Sections<'_> {
    /// All cells: combinations in the order of environments, agents and points, then the entries of
    /// `prepare`, then the settings that searches try.
    ///
    /// # Errors
    /// Configs that a plugin refuses, and names in `prepare` that the study does not have.
    pub fn cells(&self) -> Result<Cells, Vec<Diagnostic>> {
        let (mut combinations, mut others, mut found) = (Vec::new(), Vec::new(), Vec::new());
        let mut known = PartCache::new(self);
        let values = self.values();
        for pair in self.pairs() {
            let targets = [
                Target::Environment(pair.0),
                Target::Agent(pair.1),
                Target::Protocol,
            ];
            match known.grids(targets, pair) {
                Ok(parts) => combinations.push(PairGrid {
                    pair,
                    dimensions: self.concerned(&targets),
                    keys: self.swept(&targets, &values),
                    parts,
                }),
                Err(errors) => found.extend(errors),
            }
        }
        let mut keep = |made: Result<Cell, Vec<Diagnostic>>| match made {
            Ok(cell) => others.push(cell),
            Err(errors) => found.extend(errors),
        };
        for (index, entry) in self.written.prepared.iter().enumerate() {
            let targets = self.parts_of(index, entry);
            keep(targets.and_then(|targets| known.prepared(index, targets)));
        }
        for (index, searched) in self.searches.iter().enumerate() {
            (0..searched.points.len()).for_each(|point| keep(known.tried(index, point)));
        }
        for (environment, agent) in self.pairs() {
            match known.leading(environment, agent) {
                Ok(leading) => others.extend(leading),
                Err(errors) => found.extend(errors),
            }
        }
        if found.is_empty() {
            Ok(Cells::new(combinations, others))
        } else {
            Err(found)
        }
    }

    /// Where the parts of an entry of `prepare` are written.
    fn parts_of(&self, index: usize, entry: &PreparedTrial) -> Result<[Target; 3], Vec<Diagnostic>> {
        let mut found = Vec::new();
        let mut target =
            |kind, chosen: &PreparedPart, known: &[NamedPart], of_study: fn(usize) -> Target| match chosen {
                PreparedPart::Own(_) => Target::Prepared(index, kind),
                PreparedPart::OfStudy(name, span) => {
                    let place = known.iter().position(|it| it.name == *name);
                    if place.is_none() {
                        found.push(self.no_such(entry, kind, name, *span, known));
                    }
                    of_study(place.unwrap_or_default())
                }
            };
        let (environments, agents) = (&self.written.environments, &self.written.agents);
        let environment = target(
            PartKind::Environment,
            &entry.environment,
            environments,
            Target::Environment,
        );
        let agent = target(PartKind::Agent, &entry.agent, agents, Target::Agent);
        let protocol = match entry.protocol {
            Some(_) => Target::Prepared(index, PartKind::Protocol),
            None => Target::Protocol,
        };
        if found.is_empty() {
            Ok([environment, agent, protocol])
        } else {
            Err(found)
        }
    }

    fn no_such(
        &self,
        entry: &PreparedTrial,
        kind: PartKind,
        name: &str,
        span: Span,
        known: &[NamedPart],
    ) -> Diagnostic {
        let at = format!("prepare.{}.{}", entry.name, kind.name());
        let error = self
            .sources
            .error(span, &at, format!("no {} is named `{name}`", kind.name()));
        error.help(suggest(name, known.iter().map(|it| it.name.as_str())))
    }

    /// The values of all swept keys, by dimension.
    fn values(&self) -> Vec<Vec<Arc<[Value]>>> {
        let of_key = |key: &SweptKey<'_>| key.values.iter().map(Node::to_value).collect();
        let of_dimension = |it: &Dimension<'_>| it.keys.iter().map(of_key).collect();
        self.dimensions.iter().map(of_dimension).collect()
    }

    /// The swept keys of these targets, with the words that they have in settings.
    fn swept(&self, targets: &[Target], values: &[Vec<Arc<[Value]>>]) -> Vec<SettingKey> {
        let all = self.dimensions.iter().zip(values).enumerate();
        let all = all.flat_map(|(index, (dimension, values))| {
            let keys = dimension.keys.iter().zip(values);
            keys.map(move |(key, values)| (index, key, values))
        });
        let concerned: Vec<_> = all
            .filter(|(_, key, _)| targets.contains(&key.path.target))
            .collect();
        let texts: Vec<&str> = concerned.iter().map(|(_, key, _)| key.text.as_str()).collect();
        let with_word = |((dimension, _, values), word): ((usize, _, &Arc<[Value]>), _)| SettingKey {
            dimension,
            word,
            values: Arc::clone(values),
        };
        concerned.into_iter().zip(words(&texts)).map(with_word).collect()
    }
}
