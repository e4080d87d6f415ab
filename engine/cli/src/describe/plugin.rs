//! Environments, agents and protocols: their keys, and facts that are found by building them with their defaults.

use super::{
    FitOptions, Key, MetricFacts, Subject, Unfit, fit,
    group::Group,
    interface::{self, Channels, SeatFacts},
    key::{self, Notation},
    text::as_yaml,
};

use contract::{
    Agent, ArtifactKind, Metric, Protocol, Registry, cast,
    plugin::About,
    registry::{AgentEntry, ProtocolEntry},
    standard_metrics::{time_per_decision_metric, time_per_update_metric, updates_metric, wall_time_metric},
};
use document::schema_check::View;
use serde::Serialize;
use serde_json::{Value, json};

/// Properties of an environment with its defaults.
#[derive(Debug, Clone, Serialize)]
pub struct EnvironmentFacts {
    /// Seats; those with the same observations and actions are listed together.
    pub seats: Vec<SeatFacts>,
    /// Quantities of a traced episode in addition to actions and rewards, for trajectory figures.
    pub traces: Vec<Channels>,
    /// The full state, which informed controllers and centralised critics read.
    pub state: Vec<Channels>,
    /// Agents that learn and fit it.
    pub learners: Vec<String>,
    /// Agents that do not learn and fit it.
    pub rules: Vec<String>,
    /// Agents that do not fit, with reasons, if they were requested.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unfit: Vec<Unfit>,
}

/// Properties of an agent with its defaults.
#[derive(Debug, Clone, Serialize)]
pub struct AgentFacts {
    /// False for rules and bounds.
    pub learns: bool,
    /// Protocols with the feed that it learns from.
    pub protocols: Vec<String>,
    /// Whether it reads the full state of an environment.
    pub reads_state: bool,
    /// Artifacts of other trials that a config can name.
    pub takes: Vec<Takes>,
    /// Artifacts that a trial of it leaves, without those that its protocol adds.
    pub leaves: Vec<String>,
    /// Environments that it fits.
    pub environments: Vec<String>,
    /// Environments that it does not fit, with reasons, if they were requested.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unfit: Vec<Unfit>,
}

/// A key that takes an artifact of another trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Takes {
    /// The key, dotted.
    pub key: String,
    /// Name of the artifact that it takes.
    #[serde(rename = "product")]
    pub artifact: String,
}

/// Properties of a protocol with its defaults.
#[derive(Debug, Clone, Serialize)]
pub struct ProtocolFacts {
    /// Feed of agents that learn: `decisions`, `examples`, `datasets`, `designs` or `nothing`.
    pub gives: &'static str,
    /// Artifacts that a trial of it leaves in addition to those of its agent.
    pub leaves: Vec<String>,
}

pub(super) fn environment(registry: &Registry, name: &str, asked: FitOptions) -> Option<Subject> {
    let about = &registry.environments.get(name)?.about;
    let example = format!("environments:\n  plant: {{ {name}: {{}} }}");
    let mut subject = of_plugin(name, Group::Environments, about, example);
    // For a plugin that refuses its own defaults, only the keys are known.
    let Some(built) = fit::environment(registry, name) else {
        return Some(subject);
    };
    let face = built.interface();
    let fitting = if asked.fits {
        fit::agents(registry, &face)
    } else {
        fit::Fitting::default()
    };
    subject.metrics = facts(built.metrics());
    subject.environment = Some(EnvironmentFacts {
        seats: interface::seats(&face),
        traces: interface::channels(&built.trace_channels()),
        state: interface::channels(&face.state),
        learners: fitting.learners,
        rules: fitting.rules,
        unfit: if asked.why { fitting.unfit } else { Vec::new() },
    });
    Some(subject)
}

pub(super) fn agent(registry: &Registry, name: &str, asked: FitOptions) -> Option<Subject> {
    if name == cast::POLICY {
        let example = format!("agents:\n  again: {{ {name}: {{ from: learner }} }}");
        return Some(of_plugin(name, Group::Agents, cast::about_policy(), example));
    }
    let entry = registry.agents.get(name)?;
    let example = format!("agents:\n  mine: {{ {name}: {{}} }}");
    let mut subject = of_plugin(name, Group::Agents, &entry.about, example);
    let of_learners = entry
        .traits
        .learns()
        .then(|| [updates_metric(), time_per_update_metric()]);
    let metrics: Vec<Metric> = entry
        .traits
        .metrics
        .iter()
        .cloned()
        .chain(of_learners.into_iter().flatten())
        .collect();
    subject.metrics = facts(&metrics);
    let mut facts = AgentFacts {
        learns: entry.traits.learns(),
        protocols: protocols(registry, entry),
        reads_state: false,
        takes: subject.keys.iter().flat_map(|key| takes(key, "")).collect(),
        leaves: Vec::new(),
        environments: Vec::new(),
        unfit: Vec::new(),
    };
    if asked.fits {
        try_everywhere(registry, entry, asked, &mut facts);
    }
    subject.agent = Some(facts);
    Some(subject)
}

/// Builds an agent in every environment; the first environment that it fits determines the artifacts that it leaves.
fn try_everywhere(registry: &Registry, entry: &AgentEntry, asked: FitOptions, facts: &mut AgentFacts) {
    for name in registry.environments.keys() {
        let Some(environment) = fit::environment(registry, name) else {
            continue;
        };
        match fit::agent(entry, &environment.interface()) {
            Ok(agent) => {
                if facts.environments.is_empty() {
                    facts.reads_state = agent.reads_state();
                    facts.leaves = leaves(&*agent);
                }
                facts.environments.push((*name).to_owned());
            }
            Err(reason) if asked.why => facts.unfit.push(Unfit {
                name: (*name).to_owned(),
                reason,
            }),
            Err(_) => {}
        }
    }
}

/// Artifacts that the untrained agent exports; none for an agent that makes no updates, as in a trial.
fn leaves(agent: &dyn Agent) -> Vec<String> {
    let exported = || {
        let folder = tempfile::tempdir().ok()?;
        agent.export(folder.path()).ok()?;
        let left = ArtifactKind::ALL
            .into_iter()
            .filter(|kind| kind.lies_in(folder.path()));
        Some(left.map(|kind| kind.name().to_owned()).collect())
    };
    agent.updates().and_then(|_| exported()).unwrap_or_default()
}

/// The protocols from which an agent that learns can learn; none for others.
fn protocols(registry: &Registry, entry: &AgentEntry) -> Vec<String> {
    let suits = |protocol: &ProtocolEntry| {
        let built = with_artifacts(protocol).map(|(built, _)| built);
        built.is_some_and(|built| built.experience() > 0 && study::can_learn(entry, built))
    };
    let all = registry
        .protocols
        .iter()
        .filter(|(_, protocol)| entry.traits.learns() && suits(protocol));
    all.map(|(name, _)| (*name).to_owned()).collect()
}

pub(super) fn protocol(registry: &Registry, name: &str) -> Option<Subject> {
    let entry = registry.protocols.get(name)?;
    let built = with_artifacts(entry);
    let given = built
        .as_ref()
        .map_or_else(|| json!({}), |(_, given)| given.clone());
    let example = format!("protocol: {{ {name}: {} }}", as_yaml(&given));
    let mut subject = of_plugin(name, Group::Protocols, &entry.about, example);
    if let Some((built, _)) = built {
        let decides = built
            .metrics()
            .iter()
            .any(|it| it.name == contract::standard_metrics::EPISODE_LENGTH);
        let added = [wall_time_metric()]
            .into_iter()
            .chain(decides.then(time_per_decision_metric));
        let metrics: Vec<Metric> = built.metrics().into_iter().chain(added).collect();
        subject.metrics = facts(&metrics);
        subject.protocol = Some(facts_of_protocol(&*built));
    }
    Some(subject)
}

/// A protocol with its defaults, and with a placeholder for each artifact that it requires; beside it the config that
/// was used.
fn with_artifacts(entry: &ProtocolEntry) -> Option<(Box<dyn Protocol>, Value)> {
    if let Ok(built) = (entry.build)(&entry.about.defaults) {
        return Some((built, json!({})));
    }
    let schema = entry.about.schema.as_value();
    let (mut config, mut given) = (entry.about.defaults.clone(), json!({}));
    for key in key::keys(&View::new(schema, schema), &entry.about.defaults) {
        if takes(&key, "").is_empty() {
            continue;
        }
        let source = json!({ "from": "gathered" });
        let value = if key.entries.is_some() {
            json!([source])
        } else {
            source
        };
        config[&key.name] = value.clone();
        given[&key.name] = value;
    }
    Some(((entry.build)(&config).ok()?, given))
}

fn facts_of_protocol(protocol: &dyn Protocol) -> ProtocolFacts {
    ProtocolFacts {
        gives: if protocol.experience() == 0 {
            "nothing"
        } else {
            protocol.feed().name()
        },
        leaves: protocol
            .leaves()
            .into_iter()
            .map(|kind| kind.name().to_owned())
            .collect(),
    }
}

fn of_plugin(name: &str, group: Group, about: &About, example: String) -> Subject {
    let schema = about.schema.as_value();
    Subject {
        about: about.about.into(),
        version: Some(about.version),
        examples: vec![Notation {
            example,
            ..Notation::default()
        }],
        keys: key::keys(&View::new(schema, schema), &about.defaults),
        presets: about.presets.clone(),
        ..Subject::new(name, group)
    }
}

fn facts(metrics: &[Metric]) -> Vec<MetricFacts> {
    metrics.iter().map(MetricFacts::from).collect()
}

/// The artifacts that a key and the keys below it take.
fn takes(key: &Key, above: &str) -> Vec<Takes> {
    let path = [above, &key.name].into_iter().filter(|part| !part.is_empty());
    let path = path.collect::<Vec<_>>().join(".");
    if let Some(artifact) = artifact(&key.keys) {
        return vec![Takes { key: path, artifact }];
    }
    let forms = key.forms.iter();
    if let Some(artifact) = forms.clone().find_map(|form| artifact(&form.keys)) {
        return vec![Takes { key: path, artifact }];
    }
    let of_forms = forms.flat_map(|form| form.keys.iter().chain(form.entries.as_deref()));
    let below = key.keys.iter().chain(of_forms).chain(key.entries.as_deref());
    below.flat_map(|below| takes(below, &path)).collect()
}

/// The artifact that a mapping with these keys names.
fn artifact(keys: &[Key]) -> Option<String> {
    let key = keys.iter().find(|key| key.name == "product")?;
    let named = |kind: &ArtifactKind| key.expected == format!("`{}`", kind.name());
    let is_reference = keys.iter().any(|key| key.name == "from" && key.required);
    let kind = ArtifactKind::ALL
        .into_iter()
        .find(named)
        .filter(|_| is_reference)?;
    Some(json!(kind).as_str()?.to_owned())
}
