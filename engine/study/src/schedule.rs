//! Schedules of settings, as populations find them: every stretch of one is a cell of its own, whose protocol
//! goes on from the checkpoint that the stretch before left.

use super::{
    cell::{Cell, Place},
    cells::Sections,
    config,
    known::Known,
    path::Target,
    search::Searched,
};
use contract::part::Part;
use document::{Node, diagnostic::Diagnostic};
use serde_json::{Value, json};

/// A part of a schedule: from the checkpoint of another trial, or the first step, to a pause or the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stretch {
    /// The search, by its index.
    pub search: usize,
    /// Whether it goes on from another one.
    pub goes_on: bool,
    /// The step at which it ends, where that is not the protocol's last.
    pub until: Option<u64>,
}

impl Stretch {
    /// That of a setting of a population, by its place; `None` in other searches.
    pub(super) fn of(index: usize, searched: &Searched<'_>, place: usize) -> Option<Self> {
        let search = &searched.search;
        search.is_population().then(|| Self {
            search: index,
            goes_on: searched.parent(place).is_some(),
            until: search.compared_at(place),
        })
    }

    /// Writes it into the config of a protocol.
    pub(super) fn assign(&self, name: &str, config: &mut Node) {
        let span = config.span;
        let mut set = |key: &str, value: Value| {
            if let Some(entry) = config.entry_or_insert(key, span) {
                entry.value = Node::from_value(span, &value);
            }
        };
        if self.goes_on {
            set("go_on_from", json!({ "from": name }));
        }
        if let Some(step) = self.until {
            set("steps", json!(step));
            set("leave_checkpoint", json!(true));
        }
    }
}

impl Known<'_> {
    /// What leads a combination to the last setting of the schedule that was found for its agent: nothing where a
    /// setting was.
    pub(super) fn leading(&mut self, environment: usize, agent: usize) -> Result<Vec<Cell>, Vec<Diagnostic>> {
        let Some((search, _)) = self.sections.chosen(agent) else {
            return Ok(Vec::new());
        };
        let targets = [
            Target::Environment(environment),
            Target::Agent(agent),
            Target::Protocol,
        ];
        let way = self.sections.searches[search].way_to_chosen();
        let cell = |place: usize| {
            let parts = self.parts(targets, (environment, agent), &[], Some((search, place)))?;
            let point = self.point(search, place);
            Ok(Cell::new(Place::Leading(environment, agent), point, parts))
        };
        way.into_iter().map(cell).collect()
    }

    /// Refuses an entry of `prepare` with an agent whose schedule is searched.
    pub(super) fn needs_no_schedule(&self, entry: usize, agent: Target) -> Result<(), Vec<Diagnostic>> {
        let is_of_agent = |it: &&Searched<'_>| Target::Agent(it.agent) == agent && it.search.is_population();
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
}

/// The agent of a search with its keys at these shares of their ranges; `None` where that is refused.
pub(super) fn member(sections: &Sections<'_>, searched: &Searched<'_>, shares: &[f64]) -> Option<Part> {
    let mut known = Known::new(sections);
    let pair = (searched.environment, searched.agent);
    let targets = [
        Target::Environment(pair.0),
        Target::Agent(pair.1),
        Target::Protocol,
    ];
    let [_, agent, _] = known.parts(targets, pair, &[], None).ok()?;
    let mut config = sections.assigned(&agent.given);
    let keys = searched.paths.iter().zip(&searched.search.keys).zip(shares);
    for ((path, (_, range)), share) in keys {
        path.assign(&mut config, &Node::from_value(path.span, &range.at(*share)));
    }
    let plugin = sections.plugin(targets[1])?;
    config::resolve(&plugin, &config, &mut known.files, sections.sources).ok()
}
