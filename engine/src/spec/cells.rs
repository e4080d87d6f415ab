//! The cells of a study: each combination of environment, agent and setting that is not left out, and each
//! entry of `prepare`, with its resolved parts.

use super::{
    config::{self, Files, Plugin},
    grid::{self, Grid},
    overrides::Override,
    path::{self, Target},
    schedule::Stretch,
    search::Searched,
    sweep::{Dimension, SweptKey},
    taking::Source,
    written::{Chosen, Named, PartKind, Prepared, Selection, Written},
};
use crate::{
    Registry, cast,
    complete_config::CompleteConfig,
    diagnostic::{Diagnostic, Sources, Span, suggest},
    document::Node,
    limits::Limits,
    schema_check::View,
    setting::Setting,
    store::Announcements,
    trial::Part,
};
use serde_json::Value;
use std::{collections::BTreeMap, path::Path, sync::Arc};

/// Largest number of trials of one study.
pub const MOST_TRIALS: u64 = 1_000_000;

/// What trials of different seeds have in common.
#[derive(Debug, Clone)]
pub struct Cell {
    /// What it is in the study.
    pub place: Place,
    /// The point of the sweep, as `key=value` words.
    pub setting: Arc<str>,
    /// The same with the values themselves.
    pub point: Setting,
    /// Environment, agent and protocol.
    pub parts: [Arc<Resolved>; 3],
    /// What the parts take from other cells.
    pub sources: Vec<Source>,
}

/// What a cell is in the study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A combination of an environment and an agent, by their indices.
    Combination(usize, usize),
    /// The entry of `prepare` with this index.
    Prepared(usize),
    /// A setting that the search with this index tries.
    Tried(usize),
    /// What leads an environment and an agent, by their indices, to the last setting of a schedule.
    Leading(usize, usize),
}

impl Cell {
    /// Indices of environment and agent; `None` for an entry of `prepare`.
    #[must_use]
    pub fn pair(&self) -> Option<(usize, usize)> {
        match self.place {
            Place::Combination(environment, agent) => Some((environment, agent)),
            Place::Prepared(_) | Place::Tried(_) | Place::Leading(..) => None,
        }
    }

    /// The search and the place there of the setting that the agent has.
    #[must_use]
    pub fn tried(&self) -> Option<(usize, usize)> {
        self.parts[1].given.tried
    }

    /// True where the agent is the policy of another trial.
    #[must_use]
    pub fn is_policy(&self) -> bool {
        self.parts[1].part.plugin == cast::POLICY
    }
}

/// A plugin with its complete config, hashed.
#[derive(Debug)]
pub struct Resolved {
    /// What is built.
    pub part: Arc<Part>,
    /// Its hash.
    pub id: String,
    /// What was given for it, to find the place of a mistake.
    pub given: Given,
}

/// What sets a part's config apart from what is written for it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Given {
    /// The part.
    pub target: Target,
    /// Overrides that apply, by index.
    pub overrides: Vec<usize>,
    /// Dimensions of the sweep with the point taken.
    pub points: Vec<(usize, usize)>,
    /// A search with the setting taken.
    pub tried: Option<(usize, usize)>,
    /// The part of a schedule that a protocol takes.
    pub stretch: Option<Stretch>,
    /// False for a protocol that is given to an agent which does not learn.
    pub training: bool,
}

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
}

impl Sections<'_> {
    /// All cells: combinations in the order of environments, agents and points, then the entries of
    /// `prepare`, then the settings that searches try.
    ///
    /// # Errors
    /// Configs that a plugin refuses, and names in `prepare` that the study does not have.
    pub fn cells(&self) -> Result<Vec<Cell>, Vec<Diagnostic>> {
        let (mut cells, mut found) = (Vec::new(), Vec::new());
        let mut known = Known::new(self);
        for (environment, agent) in self.pairs() {
            let targets = [
                Target::Environment(environment),
                Target::Agent(agent),
                Target::Protocol,
            ];
            let [one, two, three] = match known.grids(targets, (environment, agent)) {
                Ok(grids) => grids,
                Err(errors) => {
                    found.extend(errors);
                    continue;
                }
            };
            let dimensions = self.concerned(&targets);
            let count = dimensions.iter().map(|(_, count)| count).product();
            let words = self.words(&targets);
            cells.reserve(count);
            for place in 0..count {
                let points = grid::points(&dimensions, place);
                let parts = [one.at(&points), two.at(&points), three.at(&points)];
                let [Some(one), Some(two), Some(three)] = parts.map(Option::<&Arc<Resolved>>::cloned) else {
                    continue;
                };
                let point = self.setting(&words, &points);
                cells.push(Cell {
                    place: Place::Combination(environment, agent),
                    setting: point.to_string().into(),
                    point,
                    parts: [one, two, three],
                    sources: Vec::new(),
                });
            }
        }
        for (index, entry) in self.written.prepared.iter().enumerate() {
            match self
                .parts_of(index, entry)
                .and_then(|targets| known.prepared(index, targets))
            {
                Ok(cell) => cells.push(cell),
                Err(errors) => found.extend(errors),
            }
        }
        for (index, searched) in self.searches.iter().enumerate() {
            for point in 0..searched.points.len() {
                match known.tried(index, point) {
                    Ok(cell) => cells.push(cell),
                    Err(errors) => found.extend(errors),
                }
            }
        }
        for (environment, agent) in self.pairs() {
            match known.leading(environment, agent) {
                Ok(leading) => cells.extend(leading),
                Err(errors) => found.extend(errors),
            }
        }
        if found.is_empty() { Ok(cells) } else { Err(found) }
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
    pub(super) fn resolve(&self, given: Given, files: &mut Files<'_>) -> Result<Resolved, Vec<Diagnostic>> {
        let config = self.assigned(&given);
        let Some(plugin) = self.plugin(given.target) else {
            return Err(Vec::new());
        };
        let mut part = config::resolve(&plugin, &config, files, self.sources)?;
        if !given.training {
            let entry = &self.registry.protocols[plugin.name];
            let config = (entry.without_training)(&part.config).map_err(|error| {
                let message = format!("`{}` has no form without training: {error}", plugin.name);
                vec![self.sources.error(plugin.span, &plugin.at, message)]
            })?;
            part.config = config.into();
        }
        Ok(Resolved {
            id: part.id(),
            part: part.into(),
            given,
        })
    }

    /// The setting that was chosen for an agent: the search and its place there.
    pub(super) fn chosen(&self, agent: usize) -> Option<(usize, usize)> {
        let search = self.searches.iter().position(|it| it.agent == agent)?;
        Some((search, self.searches[search].chosen?))
    }

    /// The swept keys of these targets, each with its dimension and the word that it has in settings.
    fn words(&self, targets: &[Target]) -> Vec<(usize, &SweptKey<'_>, Arc<str>)> {
        let of_dimension = |(index, dimension): (usize, &'_ Dimension<'_>)| {
            (0..dimension.keys.len())
                .map(move |place| (index, place))
                .collect::<Vec<_>>()
        };
        let all = self.dimensions.iter().enumerate().flat_map(of_dimension);
        let keys: Vec<(usize, &SweptKey<'_>)> = all
            .map(|(index, place)| (index, &self.dimensions[index].keys[place]))
            .filter(|(_, key)| targets.contains(&key.path.target))
            .collect();
        let words = words(&keys.iter().map(|(_, key)| key.text.as_str()).collect::<Vec<_>>());
        keys.into_iter()
            .zip(words)
            .map(|((index, key), word)| (index, key, word))
            .collect()
    }

    /// The point of the sweep.
    fn setting(&self, words: &[(usize, &SweptKey<'_>, Arc<str>)], points: &[(usize, usize)]) -> Setting {
        let value = |(index, key, word): &(usize, &SweptKey<'_>, Arc<str>)| {
            let (_, point) = points.iter().find(|(dimension, _)| dimension == index)?;
            Some((Arc::clone(word), key.values[*point].to_value()))
        };
        words.iter().filter_map(value).collect()
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

/// How keys are written in a setting: each with its last word, or as a whole where that is not unique.
fn words(keys: &[&str]) -> Vec<Arc<str>> {
    let last = |text: &str| text.rsplit('.').next().unwrap_or_default().to_string();
    let word = |text: &&str| {
        let is_unique = keys.iter().filter(|other| last(other) == last(text)).count() == 1;
        if is_unique {
            last(text).into()
        } else {
            Arc::from(*text)
        }
    };
    keys.iter().map(word).collect()
}

/// The complete config of the protocol with which settings are compared.
pub fn protocol_of(sections: &Sections<'_>, searched: &Searched<'_>) -> Option<CompleteConfig> {
    let mut known = Known::new(sections);
    let targets = [
        Target::Environment(searched.environment),
        Target::Agent(searched.agent),
        Target::Protocol,
    ];
    let parts = known
        .parts(targets, (searched.environment, searched.agent), &[], None)
        .ok()?;
    Some(parts[2].part.config.clone())
}

pub(super) type Outcome = Result<Arc<Resolved>, Vec<Diagnostic>>;

/// Parts that were resolved already: a part is resolved once, however many cells share it.
pub(super) struct Known<'a> {
    pub(super) sections: &'a Sections<'a>,
    pub(super) files: Files<'a>,
    parts: BTreeMap<Given, Outcome>,
    /// By what is given at the first point.
    grids: BTreeMap<Given, Arc<Grid>>,
}

impl<'a> Known<'a> {
    pub(super) fn new(sections: &'a Sections<'a>) -> Self {
        Self {
            sections,
            files: Files::new(sections.folder),
            parts: BTreeMap::new(),
            grids: BTreeMap::new(),
        }
    }

    /// The parts of an environment and an agent at every point of the sweep.
    fn grids(
        &mut self,
        targets: [Target; 3],
        pair: (usize, usize),
    ) -> Result<[Arc<Grid>; 3], Vec<Diagnostic>> {
        let mut mistakes = Vec::new();
        let chosen = self.sections.chosen(pair.1);
        let grids = [0, 1, 2].map(|place| {
            let dimensions = self.sections.concerned(&targets[place..=place]);
            let first: Vec<(usize, usize)> = dimensions.iter().map(|(index, _)| (*index, 0)).collect();
            let given = self.given(targets, pair, &first, chosen, place);
            let grid = self.grids.get(&given).cloned().unwrap_or_else(|| {
                let grid = Arc::new(Grid::resolve(self, &given, dimensions));
                self.grids.insert(given, Arc::clone(&grid));
                grid
            });
            mistakes.extend(grid.mistakes.iter().cloned());
            grid
        });
        if mistakes.is_empty() {
            Ok(grids)
        } else {
            Err(mistakes)
        }
    }

    /// An entry of `prepare`. Overrides that select no environment and no agent, or those that it takes from
    /// the study, apply to it too.
    fn prepared(&mut self, index: usize, targets: [Target; 3]) -> Result<Cell, Vec<Diagnostic>> {
        let swept = self
            .sections
            .dimensions
            .iter()
            .flat_map(|it| &it.keys)
            .find(|key| targets.contains(&key.path.target));
        if let Some(key) = swept {
            let entry = &self.sections.written.prepared[index];
            let message = format!(
                "`{}` is swept, so that the entry `{}` would have several settings",
                key.text, entry.name
            );
            let error =
                self.sections
                    .sources
                    .error(entry.name_span, &format!("prepare.{}", entry.name), message);
            return Err(vec![error.help("write the part that is meant into the entry")]);
        }
        self.needs_no_schedule(index, targets[1])?;
        let index_of = |target| match target {
            Target::Environment(index) | Target::Agent(index) => index,
            _ => usize::MAX,
        };
        let (environment, agent) = (index_of(targets[0]), index_of(targets[1]));
        let parts = self.parts(targets, (environment, agent), &[], self.sections.chosen(agent))?;
        let (setting, point) = ("".into(), Setting::default());
        Ok(Cell {
            place: Place::Prepared(index),
            setting,
            point,
            parts,
            sources: Vec::new(),
        })
    }

    /// A setting that a search tries.
    fn tried(&mut self, search: usize, place: usize) -> Result<Cell, Vec<Diagnostic>> {
        let searched = &self.sections.searches[search];
        let (environment, agent) = (searched.environment, searched.agent);
        let targets = [
            Target::Environment(environment),
            Target::Agent(agent),
            Target::Protocol,
        ];
        let parts = self.parts(targets, (environment, agent), &[], Some((search, place)))?;
        let point = self.point(search, place);
        Ok(Cell {
            place: Place::Tried(search),
            setting: point.to_string().into(),
            point,
            parts,
            sources: Vec::new(),
        })
    }

    /// A setting of a search, with its keys as they are written.
    pub(super) fn point(&self, search: usize, place: usize) -> Setting {
        let searched = &self.sections.searches[search];
        let keys: Vec<&str> = searched
            .search
            .keys
            .iter()
            .map(|(text, _)| text.as_str())
            .collect();
        let values = searched.points[place].iter().map(Node::to_value);
        words(&keys).into_iter().zip(values).collect()
    }

    pub(super) fn parts(
        &mut self,
        targets: [Target; 3],
        pair: (usize, usize),
        points: &[(usize, usize)],
        tried: Option<(usize, usize)>,
    ) -> Result<[Arc<Resolved>; 3], Vec<Diagnostic>> {
        let [one, two, three] = [0, 1, 2].map(|place| {
            let given = self.given(targets, pair, points, tried, place);
            self.part(given)
        });
        Ok([one?, two?, three?])
    }

    /// What is given for one of the parts of a pair, at a point of the sweep.
    fn given(
        &self,
        targets: [Target; 3],
        (environment, agent): (usize, usize),
        points: &[(usize, usize)],
        tried: Option<(usize, usize)>,
        place: usize,
    ) -> Given {
        let plugin = self.sections.written.plugin(targets[1]);
        let learns = self
            .sections
            .registry
            .agents
            .get(plugin)
            .is_some_and(|entry| entry.learns);
        let of_setting =
            |(index, place): (usize, usize)| Stretch::of(index, &self.sections.searches[index], place);
        let stretch = tried.and_then(of_setting);
        let target = targets[place];
        let overrides = self.sections.overrides.iter().enumerate();
        let applies = |it: &Override<'_>| it.selection.matches(environment, agent) && it.concerns(target);
        let overrides = overrides
            .filter(|(_, it)| applies(it))
            .map(|(index, _)| index)
            .collect();
        let concerned = |(index, _): &&(usize, usize)| self.sections.dimensions[*index].concerns(&[target]);
        Given {
            target,
            overrides,
            points: points.iter().filter(concerned).copied().collect(),
            tried: tried.filter(|_| target == Target::Agent(agent)),
            stretch: stretch.filter(|_| target == Target::Protocol),
            training: learns || place < 2,
        }
    }

    pub(super) fn part(&mut self, given: Given) -> Outcome {
        if let Some(known) = self.parts.get(&given) {
            return known.clone();
        }
        let resolved = self.sections.resolve(given.clone(), &mut self.files);
        let outcome = resolved.map(Arc::new);
        self.parts.insert(given, outcome.clone());
        outcome
    }
}
