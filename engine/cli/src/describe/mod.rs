//! Names that a study may use, described for people, for programs and for the reference: plugins, kinds of tables and
//! figures, sections, samplers, relations and aggregates of claims, artifacts, executors.
//!
//! A [`Subject`] is data; [`text`] and [`markdown`] write it. Keys come from the schemas with which `check` checks
//! studies, so descriptions and checks agree.

mod group;
mod interface;
mod key;
#[cfg(test)]
mod kinds_contract;
pub mod markdown;
mod plugin;
mod sections;
#[cfg(test)]
mod tests;
pub mod text;

pub use group::Group;
pub use interface::{Channels, SeatFacts, SpaceFacts};
pub use key::{Key, Notation};
pub use plugin::{AgentFacts, EnvironmentFacts, ProtocolFacts, Takes};
pub use study::fit::{FitOptions, Unfit};

use analysis::claim::{Aggregate, forms};
use contract::{ArtifactKind, Better, Metric, PerEpisode, Preset, Registry};
use document::{diagnostic, schema_check::View};
use execution::executor::{self, ExecutorKind, Way};
use presentation::{kinds::Kind, request::Kinds};
use schemars::SchemaGenerator;
use serde::Serialize;
use serde_json::{Map, Value};
use study::fit;

/// Version of the JSON form of subjects. New keys do not change it; a key that is removed or changes its meaning raises
/// it.
pub const FORMAT: u32 = 1;

/// The error for a name that a study cannot use.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("nothing is named `{name}`; {}", advice(nearest.as_deref()))]
pub struct UnknownName {
    /// The unknown name.
    pub name: String,
    /// The most similar known name.
    pub nearest: Option<String>,
}

fn advice(nearest: Option<&str>) -> String {
    match nearest {
        Some(nearest) => format!("did you mean `{nearest}`?"),
        None => "`regimen describe` says what has a name".into(),
    }
}

/// One subject that a study may name. Fields that do not apply are empty, and absent from JSON.
#[derive(Debug, Clone, Serialize)]
pub struct Subject {
    /// Its name.
    pub name: String,
    /// The group that it belongs to.
    pub group: Group,
    /// Description in a sentence or two.
    pub about: String,
    /// Version of a plugin, raised with every change of code that changes numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub version: Option<u32>,
    /// Uses of it in a study: `written` names the case, `example` is YAML.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub examples: Vec<Notation>,
    /// The grammar of claims.
    #[serde(skip_serializing_if = "str::is_empty")]
    pub grammar: &'static str,
    /// The forms of a claim, each with an example.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub forms: Vec<Notation>,
    /// Names that may stand there and are described as subjects of their own.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub choice: Vec<String>,
    /// Its keys.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub keys: Vec<Key>,
    /// The value of a section.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<Key>,
    /// Named settings of a plugin.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub presets: Vec<Preset>,
    /// Metrics that it records, by the names that tables, figures and claims use.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<MetricFacts>,
    /// Further properties of an environment.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<EnvironmentFacts>,
    /// Further properties of an agent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub agent: Option<AgentFacts>,
    /// Further properties of a protocol.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub protocol: Option<ProtocolFacts>,
}

impl Subject {
    fn new(name: &str, group: Group) -> Self {
        Self {
            name: name.into(),
            group,
            about: String::new(),
            version: None,
            examples: Vec::new(),
            grammar: "",
            forms: Vec::new(),
            choice: Vec::new(),
            keys: Vec::new(),
            value: None,
            presets: Vec::new(),
            metrics: Vec::new(),
            environment: None,
            agent: None,
            protocol: None,
        }
    }

    /// All its keys, dotted if they are nested.
    #[must_use]
    pub fn paths(&self) -> Vec<String> {
        let own = self.keys.iter().flat_map(Key::paths);
        own.chain(self.value.iter().flat_map(Key::paths)).collect()
    }
}

/// A metric, described.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MetricFacts {
    /// Its name, as studies write it.
    pub name: String,
    /// SI unit; empty where there is none.
    pub unit: String,
    /// Description in a sentence or two.
    pub about: String,
    /// `less` if less is better; `more` if more is better or no direction is given.
    pub better: &'static str,
    /// Reduction of the steps of an episode to its value: `sum`, `mean` or `last`.
    pub per_episode: &'static str,
}

impl From<&Metric> for MetricFacts {
    fn from(metric: &Metric) -> Self {
        Self {
            name: metric.name.clone(),
            unit: metric.unit.clone(),
            about: metric.about.clone(),
            better: match metric.better {
                Better::Higher => "more",
                Better::Lower => "less",
            },
            per_episode: match metric.per_episode {
                PerEpisode::Sum => "sum",
                PerEpisode::Mean => "mean",
                PerEpisode::Last => "last",
                PerEpisode::Max => "largest",
                PerEpisode::Min => "smallest",
            },
        }
    }
}

/// All subjects with this name, of any group; `asked` selects the facts that require building plugins.
///
/// # Errors
/// An unknown name, with the most similar one.
pub fn find(registry: &Registry, name: &str, asked: FitOptions) -> Result<Vec<Subject>, UnknownName> {
    let all: Vec<(Group, Vec<String>)> = Group::ALL
        .into_iter()
        .map(|group| (group, names(registry, group)))
        .collect();
    let groups = all
        .iter()
        .filter(|(_, names)| names.iter().any(|known| known == name));
    let found: Vec<Subject> = groups
        .filter_map(|(group, _)| subject(registry, *group, name, asked))
        .collect();
    if !found.is_empty() {
        return Ok(found);
    }
    let known: Vec<&str> = all
        .iter()
        .flat_map(|(_, names)| names)
        .map(String::as_str)
        .collect();
    Err(UnknownName {
        name: name.into(),
        nearest: diagnostic::nearest(name, &known).map(Into::into),
    })
}

/// The names of a group.
#[must_use]
pub fn names(registry: &Registry, group: Group) -> Vec<String> {
    let entries = group.entries(registry).into_iter();
    entries.map(|(name, _)| name).collect()
}

/// One name of a group; `None` where the group does not have it.
#[must_use]
pub fn subject(registry: &Registry, group: Group, name: &str, asked: FitOptions) -> Option<Subject> {
    match group {
        Group::Sections => sections::subject(registry, name),
        Group::Environments => plugin::environment(registry, name, asked),
        Group::Agents => plugin::agent(registry, name, asked),
        Group::Protocols => plugin::protocol(registry, name),
        Group::Tables => of_kind(&Kinds::of(registry).of_tables(), "tables", group, name),
        Group::Figures => of_kind(&Kinds::of(registry).of_figures(), "figures", group, name),
        Group::Samplers => {
            let (name, form) = sections::samplers()
                .into_iter()
                .find(|(known, _)| known == name)?;
            Some(sections::sampler(&name, form))
        }
        Group::Relations => relation(name),
        Group::Aggregates => aggregate(name),
        Group::Artifacts => artifact(name),
        Group::Executors => executor(&executor::find(registry, name)?),
    }
}

fn of_kind(kinds: &[Kind], section: &str, group: Group, name: &str) -> Option<Subject> {
    let kind = kinds.iter().find(|kind| kind.name == name)?;
    let mut generator = SchemaGenerator::default();
    let mut schema = (kind.schema)(&mut generator).to_value();
    schema["$defs"] = Value::Object(generator.take_definitions(true));
    let view = View::new(&schema, &schema);
    let example = Notation {
        example: format!(
            "{section}:\n  {}:\n    {name}: {}",
            name.replace('_', "-"),
            (kind.example)()
        ),
        ..Notation::default()
    };
    Some(Subject {
        about: kind.about.into(),
        examples: vec![example],
        keys: key::keys(&view, &Value::Object(Map::new())),
        ..Subject::new(name, group)
    })
}

fn claim(example: &str) -> Vec<Notation> {
    vec![Notation {
        example: format!("claims:\n  - {example}"),
        ..Notation::default()
    }]
}

fn relation(name: &str) -> Option<Subject> {
    let form = forms::RELATIONS.iter().find(|form| form.written == name)?;
    Some(Subject {
        about: form.about.into(),
        examples: claim(form.example),
        ..Subject::new(name, Group::Relations)
    })
}

fn aggregate(name: &str) -> Option<Subject> {
    let aggregate = Aggregate::ALL.into_iter().find(|it| it.name() == name)?;
    Some(Subject {
        about: aggregate.about().into(),
        examples: claim(&format!("{name}(learner.return) > {name}(rule.return)")),
        ..Subject::new(name, Group::Aggregates)
    })
}

fn artifact(name: &str) -> Option<Subject> {
    let kind = ArtifactKind::ALL.into_iter().find(|it| it.name() == name)?;
    Some(Subject {
        about: kind.about().into(),
        ..Subject::new(name, Group::Artifacts)
    })
}

fn executor(kind: &ExecutorKind) -> Option<Subject> {
    let schema = kind.options().map(|options| options.schema.clone().to_value());
    let keys = schema.map_or_else(Vec::new, |schema| {
        key::keys(&View::new(&schema, &schema), &Value::Object(Map::new()))
    });
    let about = match &kind.way {
        Way::Here | Way::Hosts(_) | Way::Queue(_) => format!("{}.", kind.about),
        Way::Written(_, command) => format!("{}; hand it over with `{command}`.", kind.about),
    };
    let keys = keys.into_iter().map(|key| Key {
        // The description of the sampler states the default.
        default: None,
        ..key
    });
    Some(Subject {
        about,
        keys: keys.collect(),
        ..Subject::new(kind.name, Group::Executors)
    })
}
