//! The study as written: its sections read from the document, with the positions of all names.

use document::{
    Entry, Node,
    diagnostic::{Diagnostic, Sources, Span, suggest},
};

/// A plugin with a config, under a name of the study.
#[derive(Debug, Clone)]
pub struct NamedPart {
    /// Name in the study; `protocol` for the protocol.
    pub name: String,
    /// Position of the name in the text.
    pub name_span: Span,
    /// Registered name of the plugin.
    pub plugin: String,
    /// Position of the plugin's name.
    pub plugin_span: Span,
    /// Keys of the config that the study gives.
    pub config: Node,
}

/// An entry of the section `prepare`: a trial that leaves an artifact for others.
#[derive(Debug, Clone)]
pub struct PreparedTrial {
    /// Name of the entry.
    pub name: String,
    /// Position of the name in the text.
    pub name_span: Span,
    /// Environment of the trial.
    pub environment: PreparedPart,
    /// Agent of the trial.
    pub agent: PreparedPart,
    /// Its protocol; that of the study if absent.
    pub protocol: Option<NamedPart>,
}

/// A part of an entry of `prepare`.
#[derive(Debug, Clone)]
pub enum PreparedPart {
    /// One of the study's own, by its name.
    OfStudy(String, Span),
    /// One that is written in the entry.
    Own(NamedPart),
}

/// The kinds of parts that a trial has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PartKind {
    /// The environment.
    Environment,
    /// The agent.
    Agent,
    /// The protocol.
    Protocol,
}

impl PartKind {
    /// All kinds, in the order of a trial's key.
    pub const ALL: [Self; 3] = [Self::Environment, Self::Agent, Self::Protocol];

    /// Name of the kind in studies.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Environment => "environment",
            Self::Agent => "agent",
            Self::Protocol => "protocol",
        }
    }
}

/// A section or an entry of a study, as the target of a dotted path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Target {
    /// The environment with this index.
    Environment(usize),
    /// The agent with this index.
    Agent(usize),
    /// The protocol.
    Protocol,
    /// The play with this index.
    Play(usize),
    /// The search with this index.
    Search(usize),
    /// A part that is written in the entry of `prepare` with this index.
    Prepared(usize, PartKind),
    /// The seeds.
    Seeds,
}

impl Target {
    /// The parts of the trials of an environment and an agent, by their indices.
    #[must_use]
    pub fn of_pair((environment, agent): (usize, usize)) -> [Self; 3] {
        [Self::Environment(environment), Self::Agent(agent), Self::Protocol]
    }
}

impl PreparedTrial {
    /// The part that is written in the entry; `None` for one of the study's.
    #[must_use]
    pub fn own(&self, kind: PartKind) -> Option<&NamedPart> {
        match kind {
            PartKind::Environment => self.environment.own(),
            PartKind::Agent => self.agent.own(),
            PartKind::Protocol => self.protocol.as_ref(),
        }
    }

    pub(super) fn own_mut(&mut self, kind: PartKind) -> Option<&mut NamedPart> {
        match (kind, &mut self.environment, &mut self.agent) {
            (PartKind::Environment, PreparedPart::Own(named), _)
            | (PartKind::Agent, _, PreparedPart::Own(named)) => Some(named),
            (PartKind::Protocol, ..) => self.protocol.as_mut(),
            _ => None,
        }
    }
}

impl PreparedPart {
    /// The part that is written in the entry; `None` for one of the study's.
    #[must_use]
    pub fn own(&self) -> Option<&NamedPart> {
        match self {
            Self::OfStudy(..) => None,
            Self::Own(named) => Some(named),
        }
    }
}

/// The parts of a study from which trials are made.
#[derive(Debug, Clone)]
pub struct Written {
    /// The environments, in order.
    pub environments: Vec<NamedPart>,
    /// The agents, in order.
    pub agents: Vec<NamedPart>,
    /// The protocol.
    pub protocol: NamedPart,
    /// The plays, in order.
    pub plays: Vec<NamedPart>,
    /// The searches, in order.
    pub searches: Vec<NamedPart>,
    /// The entries of `prepare`, in order.
    pub prepared: Vec<PreparedTrial>,
    /// The seeds: a count or a list.
    pub seeds: Option<Node>,
}

impl Written {
    /// Reads the sections that can be read; the check against the schema reported the others.
    #[must_use]
    pub fn read(root: &Node) -> Self {
        let section = |key: &str| {
            root.get(key)
                .map_or_else(Vec::new, |node| node.entries().iter().map(named).collect())
        };
        let nothing = NamedPart {
            name: "protocol".into(),
            name_span: root.span,
            plugin: String::new(),
            plugin_span: root.span,
            config: Node::empty_mapping(root.span),
        };
        let without_plugin = |key: &'static str| {
            let entries = root.get(key).map_or(&[][..], Node::entries);
            entries.iter().map(|entry| alone(entry, key)).collect()
        };
        Self {
            environments: section("environments"),
            agents: section("agents"),
            protocol: root.entry("protocol").map(named).unwrap_or(nothing),
            plays: without_plugin("cross_play"),
            searches: without_plugin("tune"),
            prepared: root
                .get("prepare")
                .map_or_else(Vec::new, |node| node.entries().iter().map(prepared).collect()),
            seeds: root.get("seeds").cloned(),
        }
    }

    /// Names of the environments and agents.
    #[must_use]
    pub fn names(&self) -> Vec<&str> {
        self.environments
            .iter()
            .chain(&self.agents)
            .map(|named| named.name.as_str())
            .collect()
    }

    /// The plugin of a target; empty for the seeds.
    #[must_use]
    pub fn plugin(&self, target: Target) -> &str {
        self.part(target).map_or("", |named| &named.plugin)
    }

    /// The part that a target names.
    #[must_use]
    pub fn part(&self, target: Target) -> Option<&NamedPart> {
        match target {
            Target::Environment(index) => self.environments.get(index),
            Target::Agent(index) => self.agents.get(index),
            Target::Protocol => Some(&self.protocol),
            Target::Play(index) => self.plays.get(index),
            Target::Search(index) => self.searches.get(index),
            Target::Prepared(index, kind) => self.prepared.get(index)?.own(kind),
            Target::Seeds => None,
        }
    }

    /// Reports clashes of names: an environment and an agent with the same name, or a name that is a word at the
    /// beginning of paths.
    #[must_use]
    pub fn name_clashes(&self, sources: &Sources) -> Vec<Diagnostic> {
        let parts = || self.environments.iter().chain(&self.agents);
        let agents = self.agents.iter().map(|agent| NameClash {
            name: (&agent.name, agent.name_span),
            section: "agents",
            taken_by: self.environments.iter().find(|other| other.name == agent.name),
            words: [
                "names an environment and an agent",
                "the environment is named here",
                PATHS,
            ],
        });
        let plays = self.plays.iter().map(|play| NameClash {
            name: (&play.name, play.name_span),
            section: "cross_play",
            taken_by: parts().find(|other| other.name == play.name),
            words: ["names a play and something else", OTHER, TABLES],
        });
        let prepared = self.prepared.iter().map(|entry| NameClash {
            name: (&entry.name, entry.name_span),
            section: "prepare",
            taken_by: parts().chain(&self.plays).find(|other| other.name == entry.name),
            words: ["names an entry of `prepare` and something else", OTHER, SOURCES],
        });
        let clashes = agents
            .chain(plays)
            .chain(prepared)
            .filter_map(|clash| clash.told(sources));
        clashes
            .chain(parts().filter_map(|named| reserved(named, sources)))
            .collect()
    }
}

const PATHS: &str = "rename one of the two: dotted paths begin with the name";
const TABLES: &str = "rename one of the two: tables, claims and `--only` speak of them by name";
const SOURCES: &str = "rename one of the two: `from` and `--only` speak of them by name";
const OTHER: &str = "the other one is named here";

/// Words that begin dotted paths.
const RESERVED: [&str; 7] = [
    "protocol",
    "seeds",
    "environments",
    "agents",
    "cross_play",
    "tune",
    "prepare",
];

/// A name and the thing that already has it.
struct NameClash<'a> {
    name: (&'a str, Span),
    section: &'static str,
    taken_by: Option<&'a NamedPart>,
    /// The mistake, the remark on the other place, and the advice.
    words: [&'static str; 3],
}

impl NameClash<'_> {
    fn told(&self, sources: &Sources) -> Option<Diagnostic> {
        let ((name, span), [problem, other, help]) = (self.name, self.words);
        let place = sources.place(self.taken_by?.name_span);
        let error = sources.error(
            span,
            &format!("{}.{name}", self.section),
            format!("`{name}` {problem}"),
        );
        Some(error.note(other, place).help(help))
    }
}

/// Reports a name that is a word at the beginning of dotted paths.
fn reserved(named: &NamedPart, sources: &Sources) -> Option<Diagnostic> {
    let NamedPart { name, name_span, .. } = named;
    let message = format!("`{name}` cannot be a name: dotted paths begin with this word");
    let error = || {
        sources
            .error(*name_span, name, message)
            .help("choose another name")
    };
    RESERVED.contains(&name.as_str()).then(error)
}

/// A play or a search; neither has a plugin.
fn alone(entry: &Entry, section: &str) -> NamedPart {
    let (name, name_span) = (entry.key.clone(), entry.key_span);
    NamedPart {
        name,
        name_span,
        plugin: section.into(),
        plugin_span: name_span,
        config: entry.value.clone(),
    }
}

/// An entry of `prepare`. Keys that it lacks are reported elsewhere.
fn prepared(entry: &Entry) -> PreparedTrial {
    let (name, name_span) = (entry.key.clone(), entry.key_span);
    let part = |kind: PartKind| entry.value.entry(kind.name());
    let chosen = |kind: PartKind| match part(kind) {
        Some(part) => match part.value.as_str() {
            Some(name) => PreparedPart::OfStudy(name.into(), part.value.span),
            None => PreparedPart::Own(NamedPart {
                name: name.clone(),
                ..named(part)
            }),
        },
        None => PreparedPart::OfStudy(String::new(), name_span),
    };
    let (environment, agent) = (chosen(PartKind::Environment), chosen(PartKind::Agent));
    let protocol = part(PartKind::Protocol).map(|entry| NamedPart {
        name: name.clone(),
        ..named(entry)
    });
    PreparedTrial {
        name,
        name_span,
        environment,
        agent,
        protocol,
    }
}

/// A named part. Only the name is known if it does not have exactly one plugin, which is reported elsewhere.
fn named(entry: &Entry) -> NamedPart {
    let (name, name_span) = (entry.key.clone(), entry.key_span);
    match entry.value.entries() {
        [plugin] => NamedPart {
            name,
            name_span,
            plugin: plugin.key.clone(),
            plugin_span: plugin.key_span,
            config: plugin.value.clone(),
        },
        _ => NamedPart {
            name,
            name_span,
            plugin: String::new(),
            plugin_span: name_span,
            config: Node::empty_mapping(name_span),
        },
    }
}

/// The environments and agents that an entry of `exclude` or `overrides` selects; `None` stands for all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Selection {
    /// Index of the environment; `None` for all.
    pub environment: Option<usize>,
    /// Index of the agent; `None` for all.
    pub agent: Option<usize>,
}

impl Selection {
    /// Whether it selects every combination.
    #[must_use]
    pub fn is_of_all(&self) -> bool {
        self.environment.is_none() && self.agent.is_none()
    }

    /// The parts that the keys `environment` and `agent` of `node` name.
    ///
    /// # Errors
    /// Names that the study does not have.
    pub fn of(
        [environment, agent]: [&Option<String>; 2],
        node: &Node,
        at: &str,
        written: &Written,
        sources: &Sources,
    ) -> Result<Self, Vec<Diagnostic>> {
        let mut found = Vec::new();
        let mut index = |key: &str, name: &Option<String>, known: &[NamedPart]| {
            let name = name.as_ref()?;
            let index = known.iter().position(|named| named.name == *name);
            if index.is_none() {
                let error = sources.error(
                    node.get(key)?.span,
                    &format!("{at}.{key}"),
                    format!("no {key} is named `{name}`"),
                );
                found.push(error.help(suggest(name, known.iter().map(|named| named.name.as_str()))));
            }
            index
        };
        let (environment, agent) = (
            index("environment", environment, &written.environments),
            index("agent", agent, &written.agents),
        );
        if found.is_empty() {
            Ok(Self { environment, agent })
        } else {
            Err(found)
        }
    }

    /// Whether the combination is selected.
    #[must_use]
    pub fn matches(&self, environment: usize, agent: usize) -> bool {
        self.environment.is_none_or(|it| it == environment) && self.agent.is_none_or(|it| it == agent)
    }
}
