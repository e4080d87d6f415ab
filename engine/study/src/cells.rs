//! From the sections of a study to its cells.

use super::{
    cell::{Cell, Cells, Combination, Swept},
    config::{self, Files, Plugin},
    known::{Form, Given, Known, Resolved, words},
    overrides::Override,
    path::{self, Target},
    search::Searched,
    sweep::{Dimension, SweptKey},
    written::{Chosen, Named, PartKind, Prepared, Selection, Written},
};
use contract::{
    Registry, cast,
    own_training::{MEASURED, Measured},
};
use document::{
    Node,
    diagnostic::{Diagnostic, Sources, Span, suggest},
    schema_check::View,
};
use execution::{limits::Limits, store::Announcements};
use serde_json::Value;
use std::{path::Path, sync::Arc};

/// Largest number of trials of one study.
pub const MOST_TRIALS: u64 = 1_000_000;

/// All that cells are made of.
pub struct Sections<'a> {
    /// The named parts.
    pub written: &'a Written,
    /// The plugins.
    pub registry: &'a Registry,
    /// The schema of a study.
    pub schema: &'a Value,
    /// The texts.
    pub sources: &'a Sources,
    /// Folder of the study.
    pub folder: &'a Path,
    /// Values for some combinations.
    pub overrides: &'a [Override<'a>],
    /// The sweep.
    pub dimensions: &'a [Dimension<'a>],
    /// The searches.
    pub searches: &'a [Searched<'a>],
    /// Combinations that are left out.
    pub excluded: &'a [Selection],
    /// What one trial may use.
    pub limits: &'a Limits,
    /// What environments announced before, where that is known.
    pub announced: Option<&'a Announcements>,
    /// True without a profile and options of the command line.
    pub is_as_written: bool,
}

impl Sections<'_> {
    /// All cells: combinations in the order of environments, agents and points, then the entries of
    /// `prepare`, then the settings that searches try.
    ///
    /// # Errors
    /// Configs that a plugin refuses, and names in `prepare` that the study does not have.
    pub fn cells(&self) -> Result<Cells, Vec<Diagnostic>> {
        let (mut combinations, mut others, mut found) = (Vec::new(), Vec::new(), Vec::new());
        let mut known = Known::new(self);
        let values = self.values();
        for pair in self.pairs() {
            let targets = [
                Target::Environment(pair.0),
                Target::Agent(pair.1),
                Target::Protocol,
            ];
            match known.grids(targets, pair) {
                Ok(parts) => combinations.push(Combination {
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
    fn parts_of(&self, index: usize, entry: &Prepared) -> Result<[Target; 3], Vec<Diagnostic>> {
        let mut found = Vec::new();
        let mut target = |kind, chosen: &Chosen, known: &[Named], of_study: fn(usize) -> Target| match chosen
        {
            Chosen::Own(_) => Target::Prepared(index, kind),
            Chosen::OfStudy(name, span) => {
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
        entry: &Prepared,
        kind: PartKind,
        name: &str,
        span: Span,
        known: &[Named],
    ) -> Diagnostic {
        let at = format!("prepare.{}.{}", entry.name, kind.name());
        let error = self
            .sources
            .error(span, &at, format!("no {} is named `{name}`", kind.name()));
        error.help(suggest(name, known.iter().map(|it| it.name.as_str())))
    }

    /// Number of cells, without making them.
    #[must_use]
    pub fn count(&self) -> u64 {
        let points = |(environment, agent): (usize, usize)| {
            let targets = [
                Target::Environment(environment),
                Target::Agent(agent),
                Target::Protocol,
            ];
            let relevant = self
                .dimensions
                .iter()
                .filter(|dimension| dimension.concerns(&targets));
            relevant.fold(1u64, |count, dimension| {
                count.saturating_mul(dimension.n_points() as u64)
            })
        };
        self.pairs()
            .map(points)
            .fold(self.written.prepared.len() as u64, u64::saturating_add)
    }

    /// Environments and agents that meet.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let agents = self.written.agents.len();
        let all = (0..self.written.environments.len())
            .flat_map(move |environment| (0..agents).map(move |agent| (environment, agent)));
        all.filter(|(environment, agent)| !self.excluded.iter().any(|it| it.matches(*environment, *agent)))
    }

    /// The dimensions that concern these targets, by their places, with how many points each has.
    pub(super) fn concerned(&self, targets: &[Target]) -> Vec<(usize, usize)> {
        let all = self.dimensions.iter().enumerate();
        all.filter(|(_, it)| it.concerns(targets))
            .map(|(index, it)| (index, it.n_points()))
            .collect()
    }

    /// A warning for samples that came to the same setting.
    pub fn repeats(&self) -> impl Iterator<Item = Diagnostic> {
        self.dimensions
            .iter()
            .filter_map(|dimension| dimension.repeats(self.sources))
    }

    /// The config of a part with overrides and swept values written into it.
    #[must_use]
    pub fn assigned(&self, given: &Given) -> Node {
        let mut config = self
            .written
            .part(given.target)
            .map_or_else(|| Node::empty_mapping(Default::default()), |it| it.config.clone());
        for index in &given.overrides {
            for (_, path, value) in self.overrides[*index]
                .set
                .iter()
                .filter(|(_, path, _)| path.target == given.target)
            {
                path.assign(&mut config, value);
            }
        }
        for (index, point) in &given.points {
            for key in self.dimensions[*index]
                .keys
                .iter()
                .filter(|key| key.path.target == given.target)
            {
                key.path.assign(&mut config, &key.values[*point]);
            }
        }
        if let Some((search, point)) = given.tried {
            let searched = &self.searches[search];
            let values = searched.paths.iter().zip(&searched.points[point]);
            values.for_each(|(path, value)| path.assign(&mut config, value));
        }
        if let Some(stretch) = given.stretch {
            stretch.assign(&self.searches[stretch.search].search.name, &mut config);
        }
        config
    }

    /// Makes the complete config of a part.
    pub(super) fn resolve(
        &self,
        plugin: &Plugin<'_>,
        given: Given,
        files: &mut Files<'_>,
    ) -> Result<Resolved, Vec<Diagnostic>> {
        let config = self.assigned(&given);
        let mut part = config::resolve(plugin, &config, files, self.sources)?;
        let protocol = || &self.registry.protocols[plugin.name];
        let changed = match given.form {
            Form::Trained => None,
            Form::Alone => Some((protocol().without_training)(&part.config)),
            // A protocol that has nothing for such an agent is refused with it.
            Form::Own(measured) => {
                let own = protocol().own_training.as_ref();
                own.map(|changed| changed(&part.config, measured))
            }
        };
        if let Some(changed) = changed {
            let config = changed.map_err(|error| {
                let message = format!("`{}` has no form for this agent: {error}", plugin.name);
                vec![self.sources.error(plugin.span, &plugin.at, message)]
            })?;
            part.config = config.into();
        }
        Ok(Resolved::new(part, given))
    }

    /// Whether an agent learns, as it is written.
    pub(super) fn learns(&self, agent: Target) -> bool {
        let named = self.written.part(agent);
        named.is_some_and(|named| {
            let entry = self.registry.agents.get(named.plugin.as_str());
            entry.is_some_and(|entry| match entry.traits.by_config {
                None => entry.traits.learns,
                Some(_) => entry.learns_with(&named.config.to_value()),
            })
        })
    }

    /// How an agent that trains itself is measured, as it is written.
    pub(super) fn measured(&self, agent: Target) -> Option<Measured> {
        let said = self.written.part(agent)?.config.get(MEASURED)?;
        // Another word is refused where the agent's own config is read.
        serde_json::from_value(said.to_value()).ok()
    }

    /// The setting that was chosen for an agent: the search and its place there.
    pub(super) fn chosen(&self, agent: usize) -> Option<(usize, usize)> {
        let search = self.searches.iter().position(|it| it.agent == agent)?;
        Some((search, self.searches[search].chosen?))
    }

    /// The values of all swept keys, by dimension.
    fn values(&self) -> Vec<Vec<Arc<[Value]>>> {
        let of_key = |key: &SweptKey<'_>| key.values.iter().map(Node::to_value).collect();
        let of_dimension = |it: &Dimension<'_>| it.keys.iter().map(of_key).collect();
        self.dimensions.iter().map(of_dimension).collect()
    }

    /// The swept keys of these targets, with the words that they have in settings.
    fn swept(&self, targets: &[Target], values: &[Vec<Arc<[Value]>>]) -> Vec<Swept> {
        let all = self.dimensions.iter().zip(values).enumerate();
        let all = all.flat_map(|(index, (dimension, values))| {
            let keys = dimension.keys.iter().zip(values);
            keys.map(move |(key, values)| (index, key, values))
        });
        let concerned: Vec<_> = all
            .filter(|(_, key, _)| targets.contains(&key.path.target))
            .collect();
        let texts: Vec<&str> = concerned.iter().map(|(_, key, _)| key.text.as_str()).collect();
        let with_word = |((dimension, _, values), word): ((usize, _, &Arc<[Value]>), _)| Swept {
            dimension,
            word,
            values: Arc::clone(values),
        };
        concerned.into_iter().zip(words(&texts)).map(with_word).collect()
    }

    /// The plugin of a part.
    #[must_use]
    pub fn plugin(&self, target: Target) -> Option<Plugin<'_>> {
        let named = self.written.part(target)?;
        let (kind, at) = match target {
            Target::Environment(_) => (PartKind::Environment, format!("environments.{}", named.name)),
            Target::Agent(_) => (PartKind::Agent, format!("agents.{}", named.name)),
            Target::Protocol => (PartKind::Protocol, "protocol".into()),
            Target::Prepared(_, kind) => (kind, format!("prepare.{}.{}", named.name, kind.name())),
            Target::Play(_) | Target::Search(_) | Target::Seeds => return None,
        };
        let about = match kind {
            PartKind::Environment => &self.registry.environments.get(named.plugin.as_str())?.about,
            PartKind::Agent => {
                cast::agents(self.registry)
                    .find(|(name, _)| *name == named.plugin)?
                    .1
            }
            PartKind::Protocol => &self.registry.protocols.get(named.plugin.as_str())?.about,
        };
        let schema = path::config_schema(View::new(self.schema, self.schema), target, &named.plugin)?;
        Some(Plugin {
            name: &named.plugin,
            about,
            schema,
            at: format!("{at}.{}", named.plugin),
            span: named.plugin_span,
        })
    }
}
