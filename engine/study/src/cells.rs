//! From the sections of a study to its cells.

use super::{
    cell::{Cell, Cells, PairGrid, SettingKey},
    checked_sections::Sections,
    known::PartCache,
    sweep::{Dimension, SweptKey},
    written::{NamedPart, PartKind, PreparedPart, PreparedTrial, Target},
};
use contract::sweep_point::names;
use document::{
    Node,
    diagnostic::{Diagnostic, Span, suggest},
};

impl Sections<'_> {
    /// All cells: combinations in the order of environments, agents and points, then the entries of
    /// `prepare`, then the settings that searches try.
    ///
    /// # Errors
    /// Configs that a plugin refuses, and names in `prepare` that the study does not have.
    pub fn cells(&self) -> Result<Cells, Vec<Diagnostic>> {
        let (mut combinations, mut others, mut found) = (Vec::new(), Vec::new(), Vec::new());
        let mut known = PartCache::new(self);
        let swept = self.swept();
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
                    keys: of_targets(&targets, &swept),
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

    /// All swept keys as they are written, with their targets.
    fn swept(&self) -> Vec<(Target, SettingKey)> {
        let of_dimension = |(dimension, it): (usize, &Dimension<'_>)| {
            let of_key = |key: &SweptKey<'_>| SettingKey {
                dimension,
                name: key.text.as_str().into(),
                values: key.values.iter().map(Node::to_value).collect(),
            };
            let keys = it.keys.iter().map(|key| (key.path.target, of_key(key)));
            keys.collect::<Vec<_>>()
        };
        self.dimensions
            .iter()
            .enumerate()
            .flat_map(of_dimension)
            .collect()
    }
}

/// The swept keys of some targets, with the names that they have in settings.
fn of_targets(targets: &[Target], swept: &[(Target, SettingKey)]) -> Vec<SettingKey> {
    let own = swept.iter().filter(|(target, _)| targets.contains(target));
    let own: Vec<&SettingKey> = own.map(|(_, key)| key).collect();
    let written: Vec<&str> = own.iter().map(|key| &*key.name).collect();
    let named = |(key, name): (&SettingKey, &str)| SettingKey {
        name: name.into(),
        ..key.clone()
    };
    own.into_iter().zip(names(&written)).map(named).collect()
}
