//! The parts of cells, each resolved once for all cells that share it.

mod grid;

use crate::{
    cell::{Cell, Place},
    checked_sections::Sections,
    config::{self, Files, Plugin},
    overrides::Override,
    part::{ConfigOrigin, Form, ResolvedPart},
    schedule::ScheduleStretch,
    search::LocatedSearch,
    written::Target,
};
pub(crate) use grid::{Grid, points_at};

use contract::{complete_config::CompleteConfig, part::Part, sweep_point::SweepPoint};
use document::{Node, diagnostic::Diagnostic};
use std::{collections::BTreeMap, sync::Arc};

pub(crate) type PartResult = Result<Arc<ResolvedPart>, Vec<Diagnostic>>;

/// Parts that are already resolved, for all cells that share them.
pub(crate) struct PartCache<'a> {
    pub(crate) sections: &'a Sections<'a>,
    pub(crate) files: Files<'a>,
    parts: BTreeMap<ConfigOrigin, PartResult>,
    /// By the origin of the config at the first point.
    grids: BTreeMap<ConfigOrigin, Result<Arc<Grid>, Vec<Diagnostic>>>,
}

impl<'a> PartCache<'a> {
    pub(crate) fn new(sections: &'a Sections<'a>) -> Self {
        Self {
            sections,
            files: Files::new(sections.folder),
            parts: BTreeMap::new(),
            grids: BTreeMap::new(),
        }
    }

    /// The parts of an environment and an agent at every point of the sweep.
    pub(crate) fn grids(
        &mut self,
        targets: [Target; 3],
        pair: (usize, usize),
    ) -> Result<[Arc<Grid>; 3], Vec<Diagnostic>> {
        let chosen = self.sections.chosen(pair.1);
        let outcomes = [0, 1, 2].map(|place| {
            let dimensions = self.sections.concerned(&targets[place..=place]);
            let first: Vec<(usize, usize)> = dimensions.iter().map(|(index, _)| (*index, 0)).collect();
            let given = self.given(targets, pair, &first, chosen, place);
            if let Some(known) = self.grids.get(&given) {
                return known.clone();
            }
            let first = self.part(given.clone());
            let outcome =
                Grid::resolve(self.sections, &self.files, (&given, first), dimensions).map(Arc::new);
            self.grids.insert(given, outcome.clone());
            outcome
        });
        match outcomes {
            [Ok(one), Ok(two), Ok(three)] => Ok([one, two, three]),
            outcomes => Err(outcomes.into_iter().filter_map(Result::err).flatten().collect()),
        }
    }

    /// An entry of `prepare`. Overrides that select no environment and no agent, or those that it takes from
    /// the study, apply to it too.
    pub(crate) fn prepared(&mut self, index: usize, targets: [Target; 3]) -> Result<Cell, Vec<Diagnostic>> {
        let swept = self
            .sections
            .swept()
            .find(|key| targets.contains(&key.path.target));
        if let Some(key) = swept {
            let entry = &self.sections.written.prepared[index];
            let message = format!(
                "`{}` is swept, so that the entry `{}` would have several settings",
                key.swept.key, entry.name
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
        Ok(Cell::new(Place::Prepared(index), SweepPoint::default(), parts))
    }

    /// A setting that a search tries.
    pub(crate) fn tried(&mut self, search: usize, place: usize) -> Result<Cell, Vec<Diagnostic>> {
        let searched = &self.sections.searches[search];
        let pair = searched.pair();
        let parts = self.parts(Target::of_pair(pair), pair, &[], Some((search, place)))?;
        Ok(Cell::new(Place::Tried(search), searched.point(place), parts))
    }

    /// The stretches that lead a combination to the last setting of the schedule that was found for its agent; none if
    /// a single setting was found.
    pub(crate) fn leading(&mut self, environment: usize, agent: usize) -> Result<Vec<Cell>, Vec<Diagnostic>> {
        let Some((search, _)) = self.sections.chosen(agent) else {
            return Ok(Vec::new());
        };
        let targets = Target::of_pair((environment, agent));
        let searched = &self.sections.searches[search];
        let cell = |place: usize| {
            let parts = self.parts(targets, (environment, agent), &[], Some((search, place)))?;
            let point = searched.point(place);
            Ok(Cell::new(Place::Leading(environment, agent), point, parts))
        };
        searched.way_to_chosen().into_iter().map(cell).collect()
    }

    /// Refuses an entry of `prepare` with an agent whose schedule is searched.
    pub(crate) fn needs_no_schedule(&self, entry: usize, agent: Target) -> Result<(), Vec<Diagnostic>> {
        let is_of_agent =
            |it: &&LocatedSearch<'_>| Target::Agent(it.agent) == agent && it.search.is_population();
        let Some(searched) = self.sections.searches.iter().find(is_of_agent) else {
            return Ok(());
        };
        let entry = &self.sections.written.prepared[entry];
        let message = format!(
            "the entry `{}` would need the whole schedule that `{}` searches for `{}`",
            entry.name, searched.search.name, searched.search.agent
        );
        let at = format!("prepare.{}", entry.name);
        let error = self.sections.sources.error(entry.name_span, &at, message);
        Err(vec![error.help("write the agent that is meant into the entry")])
    }

    pub(crate) fn parts(
        &mut self,
        targets: [Target; 3],
        pair: (usize, usize),
        points: &[(usize, usize)],
        tried: Option<(usize, usize)>,
    ) -> Result<[Arc<ResolvedPart>; 3], Vec<Diagnostic>> {
        let [one, two, three] = [0, 1, 2].map(|place| {
            let given = self.given(targets, pair, points, tried, place);
            self.part(given)
        });
        Ok([one?, two?, three?])
    }

    /// The origin of the config of one of the parts of a pair, at a point of the sweep.
    fn given(
        &self,
        targets: [Target; 3],
        (environment, agent): (usize, usize),
        points: &[(usize, usize)],
        tried: Option<(usize, usize)>,
        place: usize,
    ) -> ConfigOrigin {
        let plugin = self.sections.written.plugin(targets[1]);
        let form = match self.sections.registry.agents.get(plugin) {
            _ if place < 2 => Form::Trained,
            Some(entry) if entry.traits.trains_itself => Form::Own(self.sections.measured(targets[1])),
            Some(_) if self.sections.learns(targets[1]) => Form::Trained,
            _ => Form::Alone,
        };
        let of_setting = |(index, place): (usize, usize)| {
            ScheduleStretch::of(index, &self.sections.searches[index], place)
        };
        let stretch = tried.and_then(of_setting);
        let target = targets[place];
        let overrides = self.sections.overrides.iter().enumerate();
        let applies = |it: &Override<'_>| it.selection.matches(environment, agent) && it.concerns(target);
        let overrides = overrides
            .filter(|(_, it)| applies(it))
            .map(|(index, _)| index)
            .collect();
        let concerned = |(index, _): &&(usize, usize)| self.sections.dimensions[*index].concerns(&[target]);
        ConfigOrigin {
            target,
            overrides,
            points: points.iter().filter(concerned).copied().collect(),
            tried: tried.filter(|_| target == Target::Agent(agent)),
            stretch: stretch.filter(|_| target == Target::Protocol),
            form,
        }
    }

    pub(crate) fn part(&mut self, given: ConfigOrigin) -> PartResult {
        if let Some(known) = self.parts.get(&given) {
            return known.clone();
        }
        let plugin = self.sections.plugin(given.target).ok_or_else(Vec::new);
        let resolved = plugin.and_then(|it| self.sections.resolve(&it, given.clone(), &mut self.files));
        let outcome = resolved.map(Arc::new);
        self.parts.insert(given, outcome.clone());
        outcome
    }
}

impl Sections<'_> {
    /// The config of a part with overrides and swept values written into it.
    #[must_use]
    pub fn assigned(&self, given: &ConfigOrigin) -> Node {
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
                key.assign(*point, &mut config);
            }
        }
        if let Some((search, point)) = given.tried {
            self.searches[search].assign(point, &mut config);
        }
        if let Some(stretch) = given.stretch {
            stretch.assign(&self.searches[stretch.search].search.name, &mut config);
        }
        config
    }

    /// Makes the complete config of a part.
    pub(crate) fn resolve(
        &self,
        plugin: &Plugin<'_>,
        given: ConfigOrigin,
        files: &mut Files<'_>,
    ) -> Result<ResolvedPart, Vec<Diagnostic>> {
        let config = self.assigned(&given);
        let mut part = config::resolve(plugin, &config, files, self.sources)?;
        let protocol = || &self.registry.protocols[plugin.name];
        let changed = match given.form {
            Form::Trained => None,
            Form::Alone => Some((protocol().without_training)(&part.config)),
            // A protocol without a form for such agents is refused together with the agent.
            Form::Own(measured) => {
                let own = protocol().own_training.as_ref();
                own.map(|changed| changed(&part.config, measured))
            }
        };
        if let Some(changed) = changed {
            part.config = changed.map_err(|error| {
                let message = format!("`{}` has no form for this agent: {error}", plugin.name);
                vec![self.sources.error(plugin.span, &plugin.at, message)]
            })?;
        }
        Ok(ResolvedPart::new(part, given))
    }
}

/// The complete config of the protocol under which settings are compared.
pub fn protocol_of(sections: &Sections<'_>, searched: &LocatedSearch<'_>) -> Option<CompleteConfig> {
    Some(parts_of(sections, searched)?[2].part.config.clone())
}

/// The complete config of the agent whose settings are compared, as it is written.
pub fn agent_of(sections: &Sections<'_>, searched: &LocatedSearch<'_>) -> Option<CompleteConfig> {
    Some(parts_of(sections, searched)?[1].part.config.clone())
}

fn parts_of(sections: &Sections<'_>, searched: &LocatedSearch<'_>) -> Option<[Arc<ResolvedPart>; 3]> {
    let mut known = PartCache::new(sections);
    let pair = searched.pair();
    known.parts(Target::of_pair(pair), pair, &[], None).ok()
}

/// The agent of a search with its keys at these shares of their ranges; `None` if it is refused.
pub(crate) fn member(sections: &Sections<'_>, searched: &LocatedSearch<'_>, shares: &[f64]) -> Option<Part> {
    let mut known = PartCache::new(sections);
    let pair = searched.pair();
    let targets = Target::of_pair(pair);
    let [_, agent, _] = known.parts(targets, pair, &[], None).ok()?;
    let mut config = sections.assigned(&agent.given);
    let keys = searched.paths.iter().zip(&searched.search.keys).zip(shares);
    for ((path, (_, range)), share) in keys {
        path.assign(&mut config, &Node::from_value(path.span, &range.at(*share)));
    }
    let plugin = sections.plugin(targets[1])?;
    config::resolve(&plugin, &config, &mut known.files, sections.sources).ok()
}
