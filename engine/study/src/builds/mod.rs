//! Builds the parts that cells name. A plugin may refuse a config for reasons that no schema can state, and only the
//! built environment and protocol know the metrics of trials.

mod facts;
mod going_on;
mod own_training;
mod refusals;
mod stubs;
mod tried;

use crate::{
    cell::Cell,
    cells::Cells,
    checked_sections::Sections,
    part::{self, Form},
    written::{NamedPart, Target},
};
use contract::{
    Agent, Error, Feed, Interface, Metric, Protocol, panics, protocol, random,
    recorder::MOST_METRICS,
    registry::AgentEntry,
    standard_metrics::{
        EPISODE_LENGTH, time_per_decision_metric, time_per_update_metric, updates_metric, wall_time_metric,
    },
};
use document::diagnostic::{Diagnostic, in_order, say_once};
use execution::patience;
use facts::Facts;
use presentation::vocabulary::{KnownSearch, Vocabulary};
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};
use stubs::Stubs;
use tried::key;

/// Largest number of settings for which agents are built besides one for each named pair; building networks takes time.
const MOST_SETTINGS_BUILT: usize = 200;
/// Step from which an agent that is not built, or is refused, is assumed to learn.
const FROM_THE_FIRST_STEP: u64 = 1;

/// Metrics of a built protocol.
struct ProtocolMetrics {
    metrics: Vec<Metric>,
    of_environment: bool,
    feed: Feed,
    experience: u64,
    steps: u64,
    protocol: Box<dyn Protocol>,
}

impl ProtocolMetrics {
    fn of(protocol: Box<dyn Protocol>) -> Self {
        Self {
            metrics: protocol.metrics(),
            of_environment: protocol.records_environment_metrics(),
            feed: protocol.feed(),
            experience: protocol.experience(),
            steps: protocol.total_steps(),
            protocol,
        }
    }

    /// Whether an agent that learns may run under the protocol: its feed teaches the agent, or it gives nothing to
    /// learn from. A protocol of examples also measures by its examples, so its feed counts even if it trains nothing.
    fn teaches(&self, entry: &AgentEntry) -> bool {
        let gives_nothing = self.experience == 0 && self.feed != Feed::Examples;
        gives_nothing || self.feed.teaches(&entry.traits.learns_from)
    }
}

/// Whether an agent can learn from the feed of a protocol, or does not learn at all.
pub fn can_learn(entry: &AgentEntry, protocol: Box<dyn Protocol>) -> bool {
    !entry.traits.learns() || ProtocolMetrics::of(protocol).teaches(entry)
}

/// Builds the cells' parts.
///
/// # Errors
/// Errors of plugins, at the key that they name.
pub fn build(sections: &Sections<'_>, cells: &Cells, seeds: &[u64]) -> Result<Vocabulary, Vec<Diagnostic>> {
    let names = |list: &[NamedPart]| list.iter().map(|named| named.name.clone()).collect();
    let mut vocabulary = Vocabulary {
        environments: names(&sections.written.environments),
        agents: names(&sections.written.agents),
        seeds: seeds.to_vec(),
        searches: sections
            .searches
            .iter()
            .map(|it| KnownSearch {
                name: it.search.name.clone(),
                metric: it.search.metric.clone(),
                keys: it.search.key_names().into_iter().map(Into::into).collect(),
                ends: it.search.n_ends(),
            })
            .collect(),
        settings: cells.settings(),
        swept: sections.swept().map(|key| Arc::clone(&key.swept)).collect(),
        together: cells.together(),
        ..Vocabulary::default()
    };
    let mut builder = Builder {
        sections,
        cells,
        stubs: Stubs::default(),
        environments: BTreeMap::new(),
        protocols: BTreeMap::new(),
        agents: BTreeMap::new(),
        recorded: BTreeSet::new(),
        accepted: BTreeSet::new(),
        extra: 0,
        warned: BTreeSet::new(),
        doubts: Vec::new(),
        is_recalled: false,
        announced: BTreeMap::new(),
    };
    let mut found = Vec::new();
    for cell in cells.iter() {
        if let Err(error) = builder.cell(&cell, &mut vocabulary) {
            say_once(&mut found, *error);
        }
    }
    for searched in sections.searches {
        if let Err(error) = builder.members_fit(searched) {
            found.push(*error);
        }
    }
    (vocabulary.is_recalled, vocabulary.announced) = (builder.is_recalled, builder.announced);
    vocabulary.warnings.append(&mut builder.doubts);
    vocabulary.warnings = in_order(vocabulary.warnings);
    if found.is_empty() {
        Ok(vocabulary)
    } else {
        Err(found)
    }
}

/// The origins of the configs of a cell's environment and agent, which tell its agent from others.
fn given(cell: &Cell) -> [part::ConfigOrigin; 2] {
    [0, 1].map(|part| cell.parts[part].given.clone())
}

/// The ids of the environment and the protocol of a cell.
fn ids(cell: &Cell) -> [String; 2] {
    [0, 2].map(|part| cell.parts[part].id().to_owned())
}

/// Notes the metrics and traces of the trials of a pair; `of_protocol` and `of_agent` are the metrics of these two.
fn note(
    pair: (usize, usize),
    facts: &Facts,
    measures: &ProtocolMetrics,
    [of_protocol, of_agent]: [&[Metric]; 2],
    vocabulary: &mut Vocabulary,
) {
    let of_environment = measures.protocol.metrics_of_environment(&facts.metrics);
    let of_interface = measures.protocol.metrics_of_interface(&facts.interface);
    let decides = measures.metrics.iter().any(|it| it.name == EPISODE_LENGTH);
    let per_decision = decides.then(time_per_decision_metric);
    let added: Vec<Metric> = [wall_time_metric()].into_iter().chain(per_decision).collect();
    vocabulary.record(
        pair,
        of_protocol
            .iter()
            .chain(&of_interface)
            .chain(&of_environment)
            .chain(of_agent)
            .chain(&added),
    );
    vocabulary
        .left
        .entry(pair)
        .or_default()
        .extend(measures.protocol.leaves());
    let traced = vocabulary.traced.entry(pair.0).or_default();
    traced.extend(facts.traced.iter().cloned());
    vocabulary.units.extend(facts.units.clone());
    // A protocol that measures no episodes of an environment traces its own measurements.
    traced.extend(
        measures
            .metrics
            .iter()
            .filter(|_| !measures.of_environment)
            .map(|metric| metric.name.clone()),
    );
}

struct Builder<'a> {
    sections: &'a Sections<'a>,
    cells: &'a Cells,
    stubs: Stubs,
    /// By id; `None` if the build failed and was reported.
    environments: BTreeMap<String, Option<Arc<Facts>>>,
    protocols: BTreeMap<String, Option<ProtocolMetrics>>,
    /// Steps that a built agent needs before it learns, by the origins of environment and agent.
    agents: BTreeMap<[part::ConfigOrigin; 2], u64>,
    /// Environments and agents, each with the ids of environment and protocol that were noted.
    recorded: BTreeSet<((usize, usize), [String; 2])>,
    /// Ids of environments and protocols that were checked against each other.
    accepted: BTreeSet<[String; 2]>,
    extra: usize,
    /// Warnings that were given: agent, steps before it learns, steps of the protocol.
    warned: BTreeSet<(Target, u64, u64)>,
    /// Faults in the values that environments return, measured against their own declarations.
    doubts: Vec<Diagnostic>,
    is_recalled: bool,
    /// Announcements of environments that were tried out, by id.
    announced: BTreeMap<String, Value>,
}

/// A result whose error is a diagnostic with its position.
type BuildResult<T> = Result<T, Box<Diagnostic>>;

/// The result of building a plugin; a panic is its error.
fn built<T>(build: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    panics::caught(build).unwrap_or_else(|said| Err(Error::Panicked { said }))
}

impl<'a> Builder<'a> {
    fn cell(&mut self, cell: &Cell, vocabulary: &mut Vocabulary) -> BuildResult<()> {
        // A refused source is reported at the source.
        if !self.sources_are_there(cell)? {
            return Ok(());
        }
        self.environment(cell)?;
        self.protocol(cell, vocabulary)?;
        let first = cell
            .pair()
            .is_none_or(|pair| !vocabulary.recorded.contains_key(&pair));
        let Some(facts) = self.accepted(cell)? else {
            return Ok(());
        };
        self.build_once(cell, &facts.interface, first, vocabulary)?;
        self.goes_on_well(cell, &facts.interface)?;
        if let (Some(pair), Some(entry)) = (
            cell.pair(),
            self.entry(cell).filter(|it| !it.traits.trains_itself),
        ) {
            let config = &cell.parts[1].part.config;
            let learns = entry.learns_with(config);
            let updates = || learns.then(|| [updates_metric(), time_per_update_metric()]);
            let of_agent = || {
                let metrics = entry.metrics_with(config);
                metrics.into_iter().chain(updates().into_iter().flatten())
            };
            self.note(cell, pair, || of_agent().collect(), vocabulary)?;
        }
        self.warn_of_short_training(cell, vocabulary);
        Ok(())
    }

    /// The registry's entry of the cell's agent; `None` for a policy of another trial.
    fn entry(&self, cell: &Cell) -> Option<&'a AgentEntry> {
        let sections = self.sections;
        sections.registry.agents.get(cell.parts[1].part.plugin.as_str())
    }

    /// Facts on the cell's environment, once its protocol has accepted the environment and gives the agent values to
    /// learn from; `None` if one of the two could not be built, which was reported.
    fn accepted(&mut self, cell: &Cell) -> BuildResult<Option<Arc<Facts>>> {
        let [_, agent, protocol] = &cell.parts;
        let (Some(facts), Some(Some(measures))) = (self.facts(cell), self.protocols.get(protocol.id()))
        else {
            return Ok(None);
        };
        let lets_train = self.sections.registry.protocols[protocol.part.plugin.as_str()]
            .own_training
            .is_some();
        let learns = |entry: &AgentEntry| match entry.traits.trains_itself {
            true => lets_train,
            false => !entry.learns_with(&agent.part.config) || measures.teaches(entry),
        };
        if let Some(entry) = self.entry(cell).filter(|entry| !learns(entry)) {
            let given = (&*protocol.part.plugin, measures.feed);
            return Err(Box::new(self.learns_otherwise(agent, entry, given)));
        }
        if self.accepted.insert(ids(cell)) {
            let accepts = measures.protocol.accepts(&facts.interface, &facts.metrics);
            accepts.map_err(|error| Box::new(self.refused(protocol, &error)))?;
        }
        Ok(Some(facts))
    }

    /// Builds an agent in an environment, unless that was done or too many settings of its pair were built.
    fn build_once(
        &mut self,
        cell: &Cell,
        interface: &Interface,
        first: bool,
        vocabulary: &mut Vocabulary,
    ) -> BuildResult<()> {
        let given = given(cell);
        self.learns_as_written(cell)?;
        if self.agents.contains_key(&given) {
            return Ok(());
        }
        if let Some(learns_after) = self.sections.known.learns_after(&key(cell)) {
            self.agents.insert(given, learns_after);
            return Ok(());
        }
        if !first && self.extra >= MOST_SETTINGS_BUILT {
            return Ok(());
        }
        self.extra += usize::from(!first);
        self.agents.insert(given.clone(), FROM_THE_FIRST_STEP);
        if self.was_tried(cell) {
            return Ok(());
        }
        let limits = self.sections.limits;
        let mut built = patience::under(limits, || self.agent(cell, interface))?;
        patience::under(limits, || self.try_out(cell, &mut *built))?;
        if self.entry(cell).is_some_and(|it| it.traits.trains_itself) {
            return self.note_own_training(cell, &mut *built, vocabulary);
        }
        let learns_after = built.updates().map_or(0, |updates| updates.first_after).max(1);
        self.agents.insert(given, learns_after);
        match self.entry(cell) {
            Some(entry) if entry.traits.by_config.is_none() => {
                self.sections.known.add(key(cell), learns_after);
            }
            Some(_) => {}
            None => {
                if let Some(pair) = cell.pair() {
                    self.note(cell, pair, || built.decision_metrics(), vocabulary)?;
                }
            }
        }
        Ok(())
    }

    /// Warns of a learner whose protocol ends before it begins to learn, once for each agent and length.
    fn warn_of_short_training(&mut self, cell: &Cell, vocabulary: &mut Vocabulary) {
        let [_, agent, protocol] = &cell.parts;
        let learns_after = self.agents.get(&given(cell)).copied();
        let learns_after = learns_after.unwrap_or(FROM_THE_FIRST_STEP);
        let Some(Some(measures)) = self.protocols.get(protocol.id()) else {
            return;
        };
        if measures.protocol.compares_untrained() {
            return;
        }
        let (steps, experience) = (measures.steps, measures.experience);
        let learns = self
            .entry(cell)
            .is_some_and(|it| it.learns_with(&agent.part.config));
        let is_useless = learns && learns_after > experience;
        if is_useless && self.warned.insert((agent.given.target, learns_after, steps)) {
            vocabulary
                .warnings
                .push(self.learns_nothing(agent, learns_after, steps));
        }
    }

    /// Notes the metrics of the trials of a pair, once for each variant of environment and protocol.
    fn note(
        &mut self,
        cell: &Cell,
        pair: (usize, usize),
        of_agent: impl FnOnce() -> Vec<Metric>,
        vocabulary: &mut Vocabulary,
    ) -> BuildResult<()> {
        let [environment, _, protocol] = &cell.parts;
        let known = (self.facts(cell), self.protocols.get(protocol.id()));
        if let (Some(facts), Some(Some(measures))) = known
            && self.recorded.insert((pair, ids(cell)))
        {
            let of_agent = of_agent();
            if cell.parts[2].given.form == Form::Own(None) {
                vocabulary.record(pair, of_agent.iter().chain(&[wall_time_metric()]));
                return Ok(());
            }
            let metrics = measures.metrics.len() + facts.metrics.len() + of_agent.len();
            if metrics > MOST_METRICS {
                return Err(Box::new(self.records_too_much(environment, metrics)));
            }
            let measured = protocol::measurement_metrics();
            let of_protocol = match cell.parts[2].given.form {
                // The protocol measures the agent but does not see its training.
                Form::Own(_) => &measured,
                _ => &measures.metrics,
            };
            note(pair, &facts, measures, [of_protocol, &of_agent], vocabulary);
        }
        Ok(())
    }

    /// Builds the agent of a cell for the seats of its environment.
    fn agent(&mut self, cell: &Cell, interface: &Interface) -> BuildResult<Box<dyn Agent>> {
        if cell.is_policy() {
            return self.policy(cell, interface);
        }
        let agent = &cell.parts[1];
        let build = &self.sections.registry.agents[agent.part.plugin.as_str()].build;
        let built = self
            .config(cell, 1)
            .and_then(|config| built(|| build(&config, interface, &mut random::stream(&["check"]))));
        built.map_err(|error| {
            let place = cell
                .pair()
                .map(|pair| self.sections.written.environments[pair.0].name_span);
            let place = place.filter(|_| matches!(error, Error::Mismatch { .. }));
            let diagnostic = self.refused(agent, &error);
            Box::new(match place {
                Some(span) => diagnostic
                    .note("with this environment", self.sections.sources.place(span))
                    .help(self.fitting(interface)),
                None => diagnostic,
            })
        })
    }

    fn protocol(&mut self, cell: &Cell, vocabulary: &mut Vocabulary) -> BuildResult<()> {
        let resolved = &cell.parts[2];
        if self.protocols.contains_key(resolved.id()) {
            return Ok(());
        }
        let entry = &self.sections.registry.protocols[resolved.part.plugin.as_str()];
        let built = self
            .config(cell, 2)
            .and_then(|config| built(|| (entry.build)(&config)));
        let (measures, refusal) = match built {
            Ok(protocol) => {
                // A value that an override gives to some combinations is taken to be deliberate.
                let doubt = protocol.doubt().filter(|_| resolved.given.overrides.is_empty());
                let doubt = doubt.map(|doubt| self.refused(resolved, &doubt));
                vocabulary.warnings.extend(doubt.map(Diagnostic::as_warning));
                (Some(ProtocolMetrics::of(protocol)), None)
            }
            Err(error) => (None, Some(Box::new(self.refused(resolved, &error)))),
        };
        self.protocols.insert(resolved.id().to_owned(), measures);
        refusal.map_or(Ok(()), Err)
    }
}
