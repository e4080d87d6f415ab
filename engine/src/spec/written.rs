//! The study as written: its sections read from the document, with the positions of all names.

use super::path::{KeyPath, Target};
use crate::{
    diagnostic::{Diagnostic, Sources, Span, suggest},
    document::{Entry, Node},
};

/// A plugin with a config, under a name of the study.
#[derive(Debug, Clone)]
pub struct Named {
    /// Name in the study; `protocol` for the protocol.
    pub name: String,
    /// Where the name stands.
    pub name_span: Span,
    /// Registered name of the plugin.
    pub plugin: String,
    /// Where the plugin's name stands.
    pub plugin_span: Span,
    /// The keys that are given.
    pub config: Node,
}

/// The parts of a study that trials are made of.
#[derive(Debug, Clone)]
pub struct Written {
    /// The environments, in order.
    pub environments: Vec<Named>,
    /// The agents, in order.
    pub agents: Vec<Named>,
    /// The protocol.
    pub protocol: Named,
    /// The plays, in order.
    pub plays: Vec<Named>,
    /// The seeds: a count or a list.
    pub seeds: Option<Node>,
}

impl Written {
    /// Reads what can be read; what cannot was reported by the check against the schema.
    #[must_use]
    pub fn read(root: &Node) -> Self {
        let section = |key: &str| root.get(key).map_or_else(Vec::new, |node| node.entries().iter().map(named).collect());
        let nothing = Named {
            name: "protocol".into(),
            name_span: root.span,
            plugin: String::new(),
            plugin_span: root.span,
            config: Node::empty_mapping(root.span),
        };
        Self {
            environments: section("environments"),
            agents: section("agents"),
            protocol: root.entry("protocol").map(named).unwrap_or(nothing),
            plays: root.get("cross_play").map_or_else(Vec::new, |node| node.entries().iter().map(play).collect()),
            seeds: root.get("seeds").cloned(),
        }
    }

    /// Names of the environments and agents.
    #[must_use]
    pub fn names(&self) -> Vec<&str> {
        self.environments.iter().chain(&self.agents).map(|named| named.name.as_str()).collect()
    }

    /// The plugin of a target; empty for the seeds.
    #[must_use]
    pub fn plugin(&self, target: Target) -> &str {
        self.part(target).map_or("", |named| &named.plugin)
    }

    /// The part that a target names.
    #[must_use]
    pub fn part(&self, target: Target) -> Option<&Named> {
        match target {
            Target::Environment(index) => self.environments.get(index),
            Target::Agent(index) => self.agents.get(index),
            Target::Protocol => Some(&self.protocol),
            Target::Play(index) => self.plays.get(index),
            Target::Seeds => None,
        }
    }

    /// Replaces a value, as profiles and `--set` do.
    pub fn set(&mut self, path: &KeyPath<'_>, value: Node) {
        match path.target {
            Target::Environment(index) => path.assign(&mut self.environments[index].config, &value),
            Target::Agent(index) => path.assign(&mut self.agents[index].config, &value),
            Target::Protocol => path.assign(&mut self.protocol.config, &value),
            Target::Play(index) => path.assign(&mut self.plays[index].config, &value),
            Target::Seeds => self.seeds = Some(value),
        }
    }

    /// Names that are taken by something else: an environment and an agent of one name, or a word that begins paths.
    #[must_use]
    pub fn name_clashes(&self, sources: &Sources) -> Vec<Diagnostic> {
        let mut found = Vec::new();
        for agent in &self.agents {
            if let Some(other) = self.environments.iter().find(|environment| environment.name == agent.name) {
                let message = format!("`{}` names an environment and an agent", agent.name);
                let error = sources.error(agent.name_span, &format!("agents.{}", agent.name), message);
                let note = ("the environment is named here", sources.place(other.name_span));
                found.push(error.note(note.0, note.1).help("rename one of the two: dotted paths begin with the name"));
            }
        }
        for play in &self.plays {
            if let Some(other) = self.environments.iter().chain(&self.agents).find(|other| other.name == play.name) {
                let message = format!("`{}` names a play and something else", play.name);
                let error = sources.error(play.name_span, &format!("cross_play.{}", play.name), message);
                let help = "rename one of the two: tables, claims and `--only` speak of them by name";
                found.push(error.note("the other one is named here", sources.place(other.name_span)).help(help));
            }
        }
        for named in self.environments.iter().chain(&self.agents) {
            if ["protocol", "seeds", "environments", "agents", "cross_play"].contains(&named.name.as_str()) {
                let message = format!("`{}` cannot be a name: dotted paths begin with this word", named.name);
                found.push(sources.error(named.name_span, &named.name, message).help("choose another name"));
            }
        }
        found
    }
}

/// A play, which has no plugin.
fn play(entry: &Entry) -> Named {
    let (name, name_span) = (entry.key.clone(), entry.key_span);
    Named { name, name_span, plugin: crate::cross_play::NAME.into(), plugin_span: name_span, config: entry.value.clone() }
}

/// A named part. Where it has not exactly one plugin, which is reported elsewhere, the name alone is known.
fn named(entry: &Entry) -> Named {
    let (name, name_span) = (entry.key.clone(), entry.key_span);
    match entry.value.entries() {
        [plugin] => {
            Named { name, name_span, plugin: plugin.key.clone(), plugin_span: plugin.key_span, config: plugin.value.clone() }
        }
        _ => Named { name, name_span, plugin: String::new(), plugin_span: name_span, config: Node::empty_mapping(name_span) },
    }
}

/// Which environments and agents an entry of `exclude` or `overrides` is about; `None` stands for all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Selection {
    /// Index of the environment.
    pub environment: Option<usize>,
    /// Index of the agent.
    pub agent: Option<usize>,
}

impl Selection {
    /// Reads the keys `environment` and `agent`.
    ///
    /// # Errors
    /// Names that the study does not have.
    pub fn read(node: &Node, at: &str, written: &Written, sources: &Sources) -> Result<Self, Vec<Diagnostic>> {
        let mut found = Vec::new();
        let mut index = |key: &str, known: &[Named]| {
            let value = node.get(key)?;
            let name = value.as_str()?;
            let index = known.iter().position(|named| named.name == name);
            if index.is_none() {
                let error = sources.error(value.span, &format!("{at}.{key}"), format!("no {key} is named `{name}`"));
                found.push(error.help(suggest(name, known.iter().map(|named| named.name.as_str()))));
            }
            index
        };
        let (environment, agent) = (index("environment", &written.environments), index("agent", &written.agents));
        if found.is_empty() { Ok(Self { environment, agent }) } else { Err(found) }
    }

    /// True where the combination is meant.
    #[must_use]
    pub fn matches(&self, environment: usize, agent: usize) -> bool {
        self.environment.is_none_or(|it| it == environment) && self.agent.is_none_or(|it| it == agent)
    }
}
