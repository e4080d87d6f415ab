//! The cells of a study: each combination of environment, agent and setting that is not left out, with its resolved parts.

use super::{
    config::{self, Files, Plugin},
    overrides::Override,
    path::{self, Target},
    sweep::Dimension,
    written::{Selection, Written},
};
use crate::{
    Registry,
    diagnostic::{Diagnostic, Sources},
    document::Node,
    schema_check::View,
    setting::Setting,
    trial::Part,
};
use serde_json::Value;
use std::{collections::BTreeMap, path::Path, sync::Arc};

/// Largest number of trials of one study.
pub const MOST_TRIALS: u64 = 1_000_000;

/// One combination of environment, agent and setting; each seed makes a trial of it.
#[derive(Debug, Clone)]
pub struct Cell {
    /// Index of the environment.
    pub environment: usize,
    /// Index of the agent.
    pub agent: usize,
    /// The point of the sweep, as `key=value` words.
    pub setting: String,
    /// The same with the values themselves.
    pub point: Setting,
    /// Environment, agent and protocol.
    pub parts: [Arc<Resolved>; 3],
}

/// A plugin with its complete config, hashed.
#[derive(Debug)]
pub struct Resolved {
    /// What is built.
    pub part: Part,
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
    /// Combinations that are left out.
    pub excluded: &'a [Selection],
}

impl Sections<'_> {
    /// All cells, in the order of environments, agents and points.
    ///
    /// # Errors
    /// Configs that a plugin refuses.
    pub fn cells(&self) -> Result<Vec<Cell>, Vec<Diagnostic>> {
        let (mut cells, mut found) = (Vec::new(), Vec::new());
        let mut known = Known { sections: self, files: Files::new(self.folder), parts: BTreeMap::new() };
        for (environment, agent) in self.pairs() {
            let targets = [Target::Environment(environment), Target::Agent(agent), Target::Protocol];
            for points in self.points(&targets) {
                match known.cell(environment, agent, &points) {
                    Ok(cell) => cells.push(cell),
                    Err(errors) => found.extend(errors),
                }
            }
        }
        if found.is_empty() { Ok(cells) } else { Err(found) }
    }

    /// Number of cells, without making them.
    #[must_use]
    pub fn count(&self) -> u64 {
        let points = |(environment, agent): (usize, usize)| {
            let targets = [Target::Environment(environment), Target::Agent(agent), Target::Protocol];
            let relevant = self.dimensions.iter().filter(|dimension| dimension.concerns(&targets));
            relevant.fold(1u64, |count, dimension| count.saturating_mul(dimension.n_points() as u64))
        };
        self.pairs().map(points).fold(0, u64::saturating_add)
    }

    /// Environments and agents that meet.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let agents = self.written.agents.len();
        let all =
            (0..self.written.environments.len()).flat_map(move |environment| (0..agents).map(move |agent| (environment, agent)));
        all.filter(|(environment, agent)| !self.excluded.iter().any(|it| it.matches(*environment, *agent)))
    }

    /// Every combination of points of the dimensions that concern these targets; the first dimension changes slowest.
    fn points(&self, targets: &[Target]) -> Vec<Vec<(usize, usize)>> {
        let mut points = vec![Vec::new()];
        for (index, dimension) in self.dimensions.iter().enumerate().filter(|(_, it)| it.concerns(targets)) {
            let longer = |head: Vec<(usize, usize)>| {
                (0..dimension.n_points()).map(move |point| head.iter().copied().chain([(index, point)]).collect())
            };
            points = points.into_iter().flat_map(longer).collect();
        }
        points
    }

    /// The config of a part with overrides and swept values written into it.
    #[must_use]
    pub fn assigned(&self, given: &Given) -> Node {
        let mut config =
            self.written.part(given.target).map_or_else(|| Node::empty_mapping(Default::default()), |it| it.config.clone());
        for index in &given.overrides {
            for (_, path, value) in self.overrides[*index].set.iter().filter(|(_, path, _)| path.target == given.target) {
                path.assign(&mut config, value);
            }
        }
        for (index, point) in &given.points {
            for key in self.dimensions[*index].keys.iter().filter(|key| key.path.target == given.target) {
                key.path.assign(&mut config, &key.values[*point]);
            }
        }
        config
    }

    /// The point of the sweep. A key is written with its last word, or as a whole where that is not unique.
    fn setting(&self, targets: &[Target], points: &[(usize, usize)]) -> Setting {
        let keys = points.iter().flat_map(|(index, point)| self.dimensions[*index].keys.iter().map(move |key| (key, *point)));
        let keys: Vec<_> = keys.filter(|(key, _)| targets.contains(&key.path.target)).collect();
        let last = |text: &str| text.rsplit('.').next().unwrap_or_default().to_string();
        let name = |text: &str| {
            let unique = keys.iter().filter(|(key, _)| last(&key.text) == last(text)).count() == 1;
            if unique { last(text) } else { text.to_string() }
        };
        Setting::new(keys.iter().map(|(key, point)| (name(&key.text), key.values[*point].to_value())).collect())
    }

    /// The plugin of a part.
    #[must_use]
    pub fn plugin(&self, target: Target) -> Option<Plugin<'_>> {
        let named = self.written.part(target)?;
        let (about, at) = match target {
            Target::Environment(_) => {
                (&self.registry.environments.get(named.plugin.as_str())?.about, format!("environments.{}", named.name))
            }
            Target::Agent(_) => (&self.registry.agents.get(named.plugin.as_str())?.about, format!("agents.{}", named.name)),
            Target::Protocol => (&self.registry.protocols.get(named.plugin.as_str())?.about, "protocol".into()),
            Target::Play(_) | Target::Seeds => return None,
        };
        let schema = path::config_schema(View::new(self.schema, self.schema), target, &named.plugin)?;
        Some(Plugin { name: &named.plugin, about, schema, at: format!("{at}.{}", named.plugin), span: named.plugin_span })
    }
}

type Outcome = Result<Arc<Resolved>, Vec<Diagnostic>>;

/// Parts that were resolved already: a part is resolved once, however many cells share it.
struct Known<'a> {
    sections: &'a Sections<'a>,
    files: Files<'a>,
    parts: BTreeMap<Given, Outcome>,
}

impl Known<'_> {
    fn cell(&mut self, environment: usize, agent: usize, points: &[(usize, usize)]) -> Result<Cell, Vec<Diagnostic>> {
        let targets = [Target::Environment(environment), Target::Agent(agent), Target::Protocol];
        let plugin = &self.sections.written.agents[agent].plugin;
        let learns = self.sections.registry.agents.get(plugin.as_str()).is_some_and(|entry| entry.learns);
        let [one, two, three] = targets.map(|target| {
            let overrides = self.sections.overrides.iter().enumerate();
            let applies = |it: &Override<'_>| it.selection.matches(environment, agent) && it.concerns(target);
            let overrides = overrides.filter(|(_, it)| applies(it)).map(|(index, _)| index).collect();
            let concerned = |(index, _): &&(usize, usize)| self.sections.dimensions[*index].concerns(&[target]);
            let points = points.iter().filter(concerned).copied().collect();
            self.part(Given { target, overrides, points, training: learns || target != Target::Protocol })
        });
        let point = self.sections.setting(&targets, points);
        Ok(Cell { environment, agent, setting: point.to_string(), point, parts: [one?, two?, three?] })
    }

    fn part(&mut self, given: Given) -> Outcome {
        if let Some(known) = self.parts.get(&given) {
            return known.clone();
        }
        let outcome = self.resolve(given.clone());
        self.parts.insert(given, outcome.clone());
        outcome
    }

    fn resolve(&mut self, given: Given) -> Outcome {
        let config = self.sections.assigned(&given);
        let Some(plugin) = self.sections.plugin(given.target) else { return Err(Vec::new()) };
        let mut part = config::resolve(&plugin, &config, &mut self.files, self.sections.sources)?;
        if !given.training {
            let entry = &self.sections.registry.protocols[plugin.name];
            let config = (entry.without_training)(&part.config).map_err(|error| {
                let message = format!("`{}` has no form without training: {error}", plugin.name);
                vec![self.sections.sources.error(plugin.span, &plugin.at, message)]
            })?;
            part.config = Arc::new(config);
        }
        Ok(Arc::new(Resolved { id: part.id(), part, given }))
    }
}
