//! The single interface through which plugins are registered: names, typed configs, constructors.
//!
//! A plugin's config is a plain struct with `Default`, serde and a JSON Schema. The registry erases the type once, so
//! the engine can fill in defaults, refuse unknown keys, print parameters and build the plugin without naming its type.
//! A [`CompleteConfig`] carries the struct that it was read as to everything that is built from it.

use crate::{
    Agent, Environment, Error, Feed, Interface, Metric, Protocol, Rng,
    complete_config::CompleteConfig,
    own_training::Measured,
    part::Part,
    plugin::{About, Config, Resolve},
    policy_form::{PolicyForm, ReadPolicies},
    resources::{NEEDS, Needs},
};
use serde_json::Value;
use std::{
    any::{Any, TypeId},
    collections::{BTreeMap, HashMap},
};

/// Like [`Resolve`], for an agent that trains itself, with the way in which it is measured.
pub type ResolveOwn =
    Box<dyn Fn(&CompleteConfig, Option<Measured>) -> Result<CompleteConfig, serde_json::Error> + Send + Sync>;
/// Whether an agent whose code is not part of this program learns, and the metrics that it records, according to its
/// config. The config may be one that is refused elsewhere.
pub type ByConfig = fn(&Value) -> (bool, Vec<Metric>);
type Build<T> = Box<dyn Fn(&CompleteConfig) -> Result<Box<T>, Error> + Send + Sync>;
type BuildAgent =
    Box<dyn Fn(&CompleteConfig, &Interface, &mut Rng) -> Result<Box<dyn Agent>, Error> + Send + Sync>;

/// A registered environment.
pub struct EnvironmentEntry {
    /// Description, defaults and schema.
    pub about: About,
    /// Makes it from a resolved config.
    pub build: Build<dyn Environment>,
    /// Names in other programs of the environment with a config, by key, for agents that train themselves.
    pub names: fn(&Value) -> Vec<(&'static str, String)>,
}

impl EnvironmentEntry {
    /// A config of the environment, to which its names in other programs are added unless one of its own keys has that
    /// name.
    #[must_use]
    pub fn named(&self, config: &Value) -> Value {
        let mut named = config.clone();
        if let Some(keys) = named.as_object_mut() {
            for (key, name) in (self.names)(config) {
                keys.entry(key).or_insert(Value::String(name));
            }
        }
        named
    }
}

/// A registered agent.
pub struct AgentEntry {
    /// Description, defaults and schema.
    pub about: About,
    /// Facts that its registration gives in addition to the constructor.
    pub traits: AgentTraits,
    /// Makes it from a resolved config for the seats of an environment.
    pub build: BuildAgent,
}

impl AgentEntry {
    /// Whether it learns with this config.
    #[must_use]
    pub fn learns_with(&self, config: &Value) -> bool {
        let told = self.traits.by_config.map(|said| said(config).0);
        told.unwrap_or_else(|| self.traits.learns())
    }

    /// The metrics that `learn` records with this config, and those that measurements record of its decisions.
    #[must_use]
    pub fn metrics_with(&self, config: &Value) -> Vec<Metric> {
        let own = || self.traits.metrics.clone();
        self.traits.by_config.map_or_else(own, |said| said(config).1)
    }
}

/// A registered protocol.
pub struct ProtocolEntry {
    /// Description, defaults and schema.
    pub about: About,
    /// Makes it from a resolved config.
    pub build: Build<dyn Protocol>,
    /// The config for an agent that does not learn. It only measures, at the steps at which learning agents are
    /// measured, so that the trials of the agent do not depend on the rest of a training budget.
    pub without_training: Resolve<CompleteConfig>,
    /// The config for an agent that trains itself: its steps, and the steps between measurements. `None` if the
    /// protocol has no form for such agents.
    pub own_training: Option<ResolveOwn>,
}

/// Raised whenever a change in the engine changes the numbers of trials under any protocol.
pub const NUMERICS_VERSION: u32 = 1;

/// All plugins by name.
pub struct Registry {
    /// Environments by name.
    pub environments: BTreeMap<&'static str, EnvironmentEntry>,
    /// Agents by name.
    pub agents: BTreeMap<&'static str, AgentEntry>,
    /// Protocols by name.
    pub protocols: BTreeMap<&'static str, ProtocolEntry>,
    /// Makes the part of a trial's key for a protocol that measures this number of whole episodes of policies that no
    /// longer learn.
    pub measuring: Option<fn(u64) -> Part>,
    /// Forms of policies that can be written for other runtimes, by name.
    pub policy_forms: BTreeMap<&'static str, PolicyForm>,
    /// Raised whenever numerical code that plugins share changes the numbers of trials: the engine's own
    /// [`NUMERICS_VERSION`], and that of every crate that [`shares`](Self::shares) with several plugins.
    pub numerics_version: u32,
    /// The source code from which the program was built; `None` if that is unknown.
    pub build: Option<crate::Build>,
    /// Environment and agent of the study that `new` writes if the command names neither.
    pub first_study: Option<(&'static str, &'static str)>,
    /// Begins the study that `new --from` writes.
    pub draft: Option<crate::draft::BeginDraft>,
    /// Entries of the crates above the contract.
    pub extensions: Extensions,
}

/// Entries whose types the contract does not know, by type: kinds of tables and figures, and executors.
#[derive(Default)]
pub struct Extensions(HashMap<TypeId, Vec<Box<dyn Any + Send + Sync>>>);

/// Facts that the registration of an agent gives in addition to the constructor.
#[derive(Debug, Clone, Default)]
pub struct AgentTraits {
    /// Things that the agent learns from; none for rules.
    pub learns_from: Vec<Feed>,
    /// Metrics that `learn` records, and that measurements record of the agent's decisions.
    pub metrics: Vec<Metric>,
    /// Whether the agent trains itself, see [`Agent::own_training`].
    pub trains_itself: bool,
    /// For code that is not part of this program: reads from a config whether it learns, and its metrics. `learns_from`
    /// then applies to the agents that learn.
    pub by_config: Option<ByConfig>,
}

impl AgentTraits {
    /// Traits of an agent that learns from one of these, and records these metrics.
    #[must_use]
    pub fn learner<const N: usize>(learns_from: [Feed; N], metrics: Vec<Metric>) -> Self {
        Self {
            learns_from: learns_from.into(),
            metrics,
            ..Self::default()
        }
    }

    /// Whether the agent learns; false for rules.
    #[must_use]
    pub fn learns(&self) -> bool {
        !self.learns_from.is_empty()
    }
}

impl Default for Registry {
    /// A registry without plugins, with the version of the engine's own numerical code.
    fn default() -> Self {
        Self {
            environments: BTreeMap::new(),
            agents: BTreeMap::new(),
            protocols: BTreeMap::new(),
            measuring: None,
            policy_forms: BTreeMap::new(),
            numerics_version: NUMERICS_VERSION,
            build: None,
            first_study: None,
            draft: None,
            extensions: Extensions::default(),
        }
    }
}

impl Registry {
    /// The entry of an agent that is a program, and trains itself; `None` for every other agent.
    #[must_use]
    pub fn program(&self, agent: &Part) -> Option<&AgentEntry> {
        let entry = self.agents.get(agent.plugin.as_str());
        entry.filter(|entry| entry.traits.trains_itself)
    }

    /// The cores and graphics cards that a trial with this agent needs.
    #[must_use]
    pub fn needs(&self, agent: Option<&Part>) -> Needs {
        let program = agent.filter(|part| self.program(part).is_some());
        let said = program.and_then(|part| part.config.get(NEEDS).cloned());
        said.and_then(|said| serde_json::from_value(said).ok())
            .unwrap_or_default()
    }

    /// Includes the version of a crate of numerical code that several plugins share. Versions only rise, so that
    /// raising any of them changes the ids of trials.
    pub fn shares(&mut self, version: u32) {
        self.numerics_version += version;
    }

    /// Registers an entry of a type that the crates above the contract know, such as a kind of figures.
    pub fn extend<T: Any + Send + Sync>(&mut self, entry: T) {
        let all = self.extensions.0.entry(TypeId::of::<T>()).or_default();
        all.push(Box::new(entry));
    }

    /// The registered entries of such a type, in the order of their registration.
    pub fn extensions<T: Any>(&self) -> impl Iterator<Item = &T> {
        let all = self.extensions.0.get(&TypeId::of::<T>());
        all.into_iter().flatten().filter_map(|entry| entry.downcast_ref())
    }

    /// Registers an environment.
    ///
    /// # Panics
    /// If the name is taken: a mistake in the program, found by every test.
    pub fn environment<C: Config>(
        &mut self,
        name: &'static str,
        version: u32,
        about: &'static str,
        build: fn(C) -> Result<Box<dyn Environment>, Error>,
    ) {
        let entry = EnvironmentEntry {
            about: describe::<C>(version, about),
            build: Box::new(move |config| build(config.expected()?)),
            names: |_| Vec::new(),
        };
        assert!(
            self.environments.insert(name, entry).is_none(),
            "environment `{name}` is registered twice"
        );
    }

    /// Registers an agent.
    ///
    /// # Panics
    /// If the name is taken: a mistake in the program, found by every test.
    pub fn agent<C: Config>(
        &mut self,
        name: &'static str,
        version: u32,
        about: &'static str,
        traits: AgentTraits,
        build: fn(C, &Interface, &mut Rng) -> Result<Box<dyn Agent>, Error>,
    ) {
        let trains_itself = traits.trains_itself;
        let entry = AgentEntry {
            about: describe::<C>(version, about),
            traits,
            build: Box::new(move |config, interface, rng| {
                if interface.seats.is_empty() && !trains_itself {
                    return Err(no_seats(name));
                }
                build(config.expected()?, interface, rng)
            }),
        };
        assert!(
            self.agents.insert(name, entry).is_none(),
            "agent `{name}` is registered twice"
        );
    }

    /// Registers a protocol. `without_training` gives the config for an agent that does not learn.
    ///
    /// # Panics
    /// If the name is taken: a mistake in the program, found by every test.
    pub fn protocol<C: Config>(
        &mut self,
        name: &'static str,
        version: u32,
        about: &'static str,
        without_training: fn(C) -> C,
        build: fn(C) -> Result<Box<dyn Protocol>, Error>,
    ) {
        let entry = ProtocolEntry {
            about: describe::<C>(version, about),
            build: Box::new(move |config| build(config.expected()?)),
            without_training: Box::new(move |config| CompleteConfig::of(without_training(config.typed()?))),
            own_training: None,
        };
        assert!(
            self.protocols.insert(name, entry).is_none(),
            "protocol `{name}` is registered twice"
        );
    }

    /// Registers the names that environments of a registered plugin have in other programs, by key.
    pub fn environment_names(&mut self, name: &str, names: fn(&Value) -> Vec<(&'static str, String)>) {
        if let Some(entry) = self.environments.get_mut(name) {
            entry.names = names;
        }
    }

    /// Registers that a protocol lets agents train themselves, with the config that such an agent gets.
    pub fn lets_train<C: Config>(&mut self, name: &str, own_training: fn(C, Option<Measured>) -> C) {
        let resolve = move |config: &CompleteConfig, measured| {
            CompleteConfig::of(own_training(config.typed()?, measured))
        };
        if let Some(entry) = self.protocols.get_mut(name) {
            entry.own_training = Some(Box::new(resolve));
        }
    }

    /// Registers a form of policy files, so that `export` can write policies of it for other runtimes.
    ///
    /// # Panics
    /// If the name is taken: a mistake in the program, found by every test.
    pub fn policy_form(&mut self, name: &'static str, read: ReadPolicies) {
        assert!(
            self.policy_forms
                .insert(name, PolicyForm { name, read })
                .is_none(),
            "the form of policies `{name}` is registered twice"
        );
    }
}

fn no_seats(agent: &'static str) -> Error {
    let problem = "the environment is named alone, and has no seats in which an agent could act: only an agent that \
                   trains itself can be used in it, as a program is";
    Error::Mismatch {
        agent,
        problem: problem.into(),
    }
}

fn describe<C: Config>(version: u32, about: &'static str) -> About {
    About {
        about,
        version,
        // A config is a struct of numbers, strings and lists with a default; serde_json refuses only maps with unusual
        // keys.
        defaults: CompleteConfig::of(C::default()).expect("a config serialises"),
        schema: schemars::schema_for!(C),
        presets: C::presets(),
        resolve: Box::new(CompleteConfig::read::<C>),
    }
}
