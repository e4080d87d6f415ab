//! Builds what the cells name: a plugin may refuse a config for reasons that no schema can say, and only the built
//! environment and protocol know what trials record.

use super::{
    cells::{Cell, Resolved, Sections},
    config::locate,
    cross_play::Play,
    path::Target,
};
use crate::{Environment, Error, Interface, Metric, diagnostic::Diagnostic, random};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// Agents are built for each named pair, and for this many further settings; building networks takes time.
const MOST_SETTINGS_BUILT: usize = 200;

/// What the trials of a study record, and the names they have.
#[derive(Debug, Default)]
pub struct World {
    /// Names of the environments.
    pub environments: Vec<String>,
    /// Names of the agents.
    pub agents: Vec<String>,
    /// Metrics by environment and agent; pairs without trials are absent.
    pub recorded: BTreeMap<(usize, usize), BTreeSet<String>>,
    /// Names of what traces hold, by environment.
    pub traced: BTreeMap<usize, BTreeSet<String>>,
    /// Points of the sweep, in order; one empty point without a sweep.
    pub settings: Vec<String>,
    /// The swept keys, each as its last word and as a whole.
    pub swept: Vec<String>,
    /// The seeds.
    pub seeds: Vec<u64>,
    /// Everything that is recorded, each name once.
    pub metrics: Vec<Metric>,
    /// The plays of these agents.
    pub plays: Vec<Play>,
}

impl World {
    fn record<'a>(&mut self, pair: (usize, usize), metrics: impl Iterator<Item = &'a Metric>) {
        let recorded = self.recorded.entry(pair).or_default();
        for metric in metrics {
            recorded.insert(metric.name.clone());
            if !self.metrics.iter().any(|known| known.name == metric.name) {
                self.metrics.push(metric.clone());
            }
        }
    }
}

/// What is known of a built environment.
struct Facts {
    interface: Interface,
    metrics: Vec<Metric>,
    traced: BTreeSet<String>,
}

/// What is known of a built protocol.
struct Measures {
    metrics: Vec<Metric>,
    of_environment: bool,
    gives_examples: bool,
}

/// Builds the cells' parts.
///
/// # Errors
/// What plugins refuse, at the key that they name.
pub fn build(sections: &Sections<'_>, cells: &[Cell], seeds: &[u64]) -> Result<World, Vec<Diagnostic>> {
    let names = |list: &[super::written::Named]| list.iter().map(|named| named.name.clone()).collect();
    let mut world = World {
        environments: names(&sections.written.environments),
        agents: names(&sections.written.agents),
        seeds: seeds.to_vec(),
        ..World::default()
    };
    for key in sections.dimensions.iter().flat_map(|dimension| &dimension.keys) {
        // Settings write a key with its last word, or as a whole where that is not unique.
        let last = key.text.rsplit('.').next().unwrap_or_default().to_string();
        for name in [last, key.text.clone()] {
            if !world.swept.contains(&name) {
                world.swept.push(name);
            }
        }
    }
    let mut builder = Builder {
        sections,
        environments: BTreeMap::new(),
        protocols: BTreeMap::new(),
        agents: BTreeSet::new(),
        recorded: BTreeSet::new(),
        extra: 0,
    };
    let (mut settings, mut found) = (BTreeSet::new(), Vec::new());
    for cell in cells {
        if settings.insert(cell.setting.clone()) {
            world.settings.push(cell.setting.clone());
        }
        if let Err(error) = builder.cell(cell, &mut world) {
            found.push(*error);
        }
    }
    if found.is_empty() { Ok(world) } else { Err(found) }
}

/// Names of what an environment traces.
fn traced(environment: &dyn Environment) -> BTreeSet<String> {
    let channels = environment.trace_channels().into_iter().map(|channel| channel.name);
    channels.chain(environment.reward_surface().into_iter().flat_map(|surface| surface.names)).collect()
}

fn address(part: &Arc<Resolved>) -> usize {
    Arc::as_ptr(part).addr()
}

struct Builder<'a> {
    sections: &'a Sections<'a>,
    /// By id; `None` where the build failed and was reported.
    environments: BTreeMap<String, Option<Facts>>,
    protocols: BTreeMap<String, Option<Measures>>,
    /// Pairs of environment and agent that were built, by address: equal parts of cells are one.
    agents: BTreeSet<(usize, usize)>,
    /// Environments and agents, each with the variants of environment and protocol that were noted.
    recorded: BTreeSet<(usize, usize, usize, usize)>,
    extra: usize,
}

impl Builder<'_> {
    fn cell(&mut self, cell: &Cell, world: &mut World) -> Result<(), Box<Diagnostic>> {
        let [environment, agent, protocol] = &cell.parts;
        self.environment(environment)?;
        self.protocol(protocol)?;
        let pair = (cell.environment, cell.agent);
        let first = !world.recorded.contains_key(&pair);
        let (Some(Some(facts)), Some(Some(measures))) =
            (self.environments.get(&environment.id), self.protocols.get(&protocol.id))
        else {
            return Ok(());
        };
        let entry = &self.sections.registry.agents[agent.part.plugin.as_str()];
        if self.recorded.insert((cell.environment, cell.agent, address(environment), address(protocol))) {
            let environment = facts.metrics.iter().filter(|_| measures.of_environment);
            world.record(pair, measures.metrics.iter().chain(environment).chain(&entry.metrics));
            let traced = world.traced.entry(cell.environment).or_default();
            traced.extend(facts.traced.iter().cloned());
            // A protocol that measures no episodes of an environment traces what it measures.
            traced.extend(measures.metrics.iter().filter(|_| !measures.of_environment).map(|metric| metric.name.clone()));
        }
        self.extra += usize::from(!first);
        let new = self.agents.insert((address(environment), address(agent)));
        if !new || !first && self.extra > MOST_SETTINGS_BUILT {
            return Ok(());
        }
        if entry.learns && measures.gives_examples && !entry.learns_from_examples {
            return Err(Box::new(self.learns_otherwise(agent, &protocol.part.plugin)));
        }
        let built = (entry.build)(&agent.part.config, &facts.interface, &mut random::stream(&["check"]));
        built.map(drop).map_err(|error| {
            let place = self.sections.sources.place(self.sections.written.environments[cell.environment].name_span);
            let diagnostic = self.refused(agent, &error);
            let pairing = matches!(error, Error::Mismatch { .. });
            Box::new(if pairing { diagnostic.note("with this environment", place) } else { diagnostic })
        })
    }

    fn learns_otherwise(&self, agent: &Resolved, protocol: &str) -> Diagnostic {
        let (sections, target) = (self.sections, agent.given.target);
        let (at, span) = sections.plugin(target).map_or_else(Default::default, |plugin| (plugin.at, plugin.span));
        let named = sections.written.part(target).map_or("", |named| &named.name);
        let others = sections.registry.agents.iter().filter(|(_, entry)| entry.learns && entry.learns_from_examples);
        let others: Vec<String> = others.map(|(name, _)| format!("`{name}`")).collect();
        let message =
            format!("the agent `{named}` learns from its decisions and their rewards; `{protocol}` gives examples alone");
        let instead =
            if others.is_empty() { String::new() } else { format!("; agents that learn from examples: {}", others.join(", ")) };
        sections.sources.error(span, &at, message).help(format!("the protocol `train_evaluate` gives it decisions{instead}"))
    }

    fn environment(&mut self, resolved: &Resolved) -> Result<(), Box<Diagnostic>> {
        if self.environments.contains_key(&resolved.id) {
            return Ok(());
        }
        let entry = &self.sections.registry.environments[resolved.part.plugin.as_str()];
        let built = (entry.build)(&resolved.part.config);
        let facts = built.as_ref().ok().map(|environment| Facts {
            traced: traced(&**environment),
            metrics: environment.metrics().to_vec(),
            interface: environment.interface(),
        });
        self.environments.insert(resolved.id.clone(), facts);
        built.map(drop).map_err(|error| Box::new(self.refused(resolved, &error)))
    }

    fn protocol(&mut self, resolved: &Resolved) -> Result<(), Box<Diagnostic>> {
        if self.protocols.contains_key(&resolved.id) {
            return Ok(());
        }
        let entry = &self.sections.registry.protocols[resolved.part.plugin.as_str()];
        let built = (entry.build)(&resolved.part.config);
        let measures = built.as_ref().ok().map(|protocol| Measures {
            metrics: protocol.metrics(),
            of_environment: protocol.records_environment_metrics(),
            gives_examples: protocol.gives_examples(),
        });
        self.protocols.insert(resolved.id.clone(), measures);
        built.map(drop).map_err(|error| Box::new(self.refused(resolved, &error)))
    }

    /// A refusal, placed at the key that the plugin names where the study gives it.
    fn refused(&self, resolved: &Resolved, error: &Error) -> Diagnostic {
        let (sections, target) = (self.sections, resolved.given.target);
        let plugin = sections.plugin(target);
        let (at, plugin_span) = plugin.map_or_else(Default::default, |plugin| (plugin.at, plugin.span));
        match error {
            Error::Config { key, problem } => {
                let given = locate(&sections.assigned(&resolved.given), key);
                let span = given.unwrap_or(plugin_span);
                let error = sections.sources.error(span, &format!("{at}.{key}"), format!("`{key}`: {problem}"));
                let default = resolved.part.config.pointer(&format!("/{}", key.replace('.', "/")));
                match default.filter(|_| given.is_none()) {
                    Some(value) => error.help(format!("`{key}` is not given here; its value is {value}")),
                    None => error,
                }
            }
            Error::Mismatch { problem, .. } => {
                let named = sections.written.part(target).map_or("", |named| &named.name);
                let what = if matches!(target, Target::Agent(_)) { "agent" } else { "part" };
                sections.sources.error(plugin_span, &at, format!("the {what} `{named}` cannot be used here: {problem}"))
            }
            other => sections.sources.error(plugin_span, &at, other.to_string()),
        }
    }
}
