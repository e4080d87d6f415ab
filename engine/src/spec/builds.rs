//! Builds what the cells name: a plugin may refuse a config for reasons that no schema can say, and only the built
//! environment and protocol know what trials record.

use super::{
    cells::{Cell, Resolved, Sections},
    config::locate,
    cross_play::Play,
    path::Target,
};
use crate::{
    Environment, Error, Interface, Metric,
    diagnostic::{Diagnostic, in_order},
    random,
    registry::AgentEntry,
    results::{time_per_update_metric, updates_metric, wall_time_metric},
};
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
    /// What can be run and is probably not meant.
    pub warnings: Vec<Diagnostic>,
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
    experience: u64,
    steps: u64,
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
        agents: BTreeMap::new(),
        recorded: BTreeSet::new(),
        extra: 0,
        warned: BTreeSet::new(),
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
    world.warnings = in_order(world.warnings);
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

/// Notes what the trials of a cell record and trace.
fn note(cell: &Cell, facts: &Facts, measures: &Measures, entry: &AgentEntry, world: &mut World) {
    let environment = facts.metrics.iter().filter(|_| measures.of_environment);
    let updates = entry.learns.then(|| [updates_metric(), time_per_update_metric()]);
    let added = [wall_time_metric()];
    let metrics = measures.metrics.iter().chain(environment).chain(&entry.metrics);
    world.record((cell.environment, cell.agent), metrics.chain(updates.iter().flatten()).chain(&added));
    let traced = world.traced.entry(cell.environment).or_default();
    traced.extend(facts.traced.iter().cloned());
    // A protocol that measures no episodes of an environment traces what it measures.
    traced.extend(measures.metrics.iter().filter(|_| !measures.of_environment).map(|metric| metric.name.clone()));
}

struct Builder<'a> {
    sections: &'a Sections<'a>,
    /// By id; `None` where the build failed and was reported.
    environments: BTreeMap<String, Option<Facts>>,
    protocols: BTreeMap<String, Option<Measures>>,
    /// What a built agent asks for before it learns, by the addresses of environment and agent: equal parts of cells are one.
    agents: BTreeMap<(usize, usize), u64>,
    /// Environments and agents, each with the variants of environment and protocol that were noted.
    recorded: BTreeSet<(usize, usize, usize, usize)>,
    extra: usize,
    /// What warnings say: agent, steps before it learns, steps of the protocol.
    warned: BTreeSet<(usize, u64, u64)>,
}

impl Builder<'_> {
    fn cell(&mut self, cell: &Cell, world: &mut World) -> Result<(), Box<Diagnostic>> {
        let [environment, agent, protocol] = &cell.parts;
        self.environment(environment)?;
        self.protocol(protocol)?;
        let first = !world.recorded.contains_key(&(cell.environment, cell.agent));
        let (Some(Some(facts)), Some(Some(measures))) =
            (self.environments.get(&environment.id), self.protocols.get(&protocol.id))
        else {
            return Ok(());
        };
        let entry = &self.sections.registry.agents[agent.part.plugin.as_str()];
        if self.recorded.insert((cell.environment, cell.agent, address(environment), address(protocol))) {
            note(cell, facts, measures, entry, world);
        }
        self.extra += usize::from(!first);
        let addresses = (address(environment), address(agent));
        if !self.agents.contains_key(&addresses) {
            // One that is not built, or is refused, may learn from the first step on.
            self.agents.insert(addresses, 1);
            if first || self.extra <= MOST_SETTINGS_BUILT {
                if entry.learns && measures.gives_examples && !entry.learns_from_examples {
                    return Err(Box::new(self.learns_otherwise(agent, &protocol.part.plugin)));
                }
                let learns_after = self.agent(cell, &facts.interface)?;
                self.agents.insert(addresses, learns_after.max(1));
            }
        }
        let (learns_after, steps) = (self.agents[&addresses], measures.steps);
        let is_useless = entry.learns && learns_after > measures.experience;
        if is_useless && self.warned.insert((cell.agent, learns_after, steps)) {
            world.warnings.push(self.learns_nothing(agent, learns_after, steps));
        }
        Ok(())
    }

    /// Builds an agent; gives back how many transitions it needs before it can learn.
    fn agent(&self, cell: &Cell, interface: &Interface) -> Result<u64, Box<Diagnostic>> {
        let agent = &cell.parts[1];
        let build = &self.sections.registry.agents[agent.part.plugin.as_str()].build;
        let built = agent.part.loaded().and_then(|config| build(&config, interface, &mut random::stream(&["check"])));
        built.map(|agent| agent.updates().map_or(0, |updates| updates.first_after)).map_err(|error| {
            let place = self.sections.sources.place(self.sections.written.environments[cell.environment].name_span);
            let diagnostic = self.refused(agent, &error);
            let pairing = matches!(error, Error::Mismatch { .. });
            Box::new(if pairing { diagnostic.note("with this environment", place) } else { diagnostic })
        })
    }

    fn learns_nothing(&self, agent: &Resolved, learns_after: u64, steps: u64) -> Diagnostic {
        let named = self.sections.written.part(agent.given.target);
        let (name, span) = named.map_or_else(Default::default, |named| (named.name.as_str(), named.name_span));
        let (why, instead) = match learns_after {
            u64::MAX => ("it never learns with these settings".to_owned(), "let it update, or "),
            _ => {
                let why = format!("it learns from step {learns_after} on, and the protocol ends after {steps} steps");
                (why, "give the protocol more steps, let the agent learn from an earlier one, or ")
            }
        };
        let message = format!("`{name}` makes no update: {why}");
        let help = format!("{instead}call its results those of an agent that was not trained");
        self.sections.sources.warning(span, &format!("agents.{name}"), message).help(help)
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
        let built = resolved.part.loaded().and_then(|config| (entry.build)(&config));
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
        let built = resolved.part.loaded().and_then(|config| (entry.build)(&config));
        let measures = built.as_ref().ok().map(|protocol| Measures {
            metrics: protocol.metrics(),
            of_environment: protocol.records_environment_metrics(),
            gives_examples: protocol.gives_examples(),
            experience: protocol.experience(),
            steps: protocol.total_steps(),
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
