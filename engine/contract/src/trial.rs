//! One trial: an environment, an agent, a protocol and a seed, with an identity made of what determines its
//! numbers.

use crate::{
    Agent, Error, Interface, Keeper, Recorder, Registry,
    cast::{Seating, Team},
    complete_config::CompleteConfig,
    data_file, digest,
    own_training::{Assignment, Simulator},
    product::{FindProduct, Taken, no_product},
    protocol::Run,
    random::Streams,
    registry::About,
    setting::Setting,
};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{borrow::Cow, collections::BTreeMap, path::Path, sync::Arc};

/// A plugin's name, version and complete config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Registered name.
    pub plugin: String,
    /// Version of the plugin's code.
    pub version: u32,
    /// Config with every default filled in; the trials of a plan share it.
    pub config: CompleteConfig,
    /// Hashes of the data files that the config names, by JSON pointer: what a file holds determines numbers,
    /// its path does not.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
    /// What the config takes from other trials, by JSON pointer: which trial leaves it determines numbers,
    /// its name in a study does not.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub products: BTreeMap<String, Taken>,
    /// Keys of the config that say where it is computed and not what, by name: they determine no numbers. The
    /// plugin's schema says `x-identity: false` of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub of_machine: Vec<String>,
}

impl Part {
    /// A part without data files and products.
    #[must_use]
    pub fn new(plugin: impl Into<String>, version: u32, config: Value) -> Self {
        let (files, products) = (BTreeMap::new(), BTreeMap::new());
        Self {
            plugin: plugin.into(),
            version,
            config: config.into(),
            files,
            products,
            of_machine: Vec::new(),
        }
    }

    /// Hash of plugin, version, config, the content of data files and the trials whose products are taken.
    #[must_use]
    pub fn id(&self) -> String {
        // The canonical text of `[plugin, version, config]`: a plan has many configs, and none is copied.
        let mut text = vec![b'['];
        written(&self.plugin, &mut text);
        text.push(b',');
        written(&self.version, &mut text);
        text.push(b',');
        canonical(&self.identity(), &mut text);
        text.extend(b",]");
        digest::of_bytes(&text)
    }

    /// Hash that keys an environment's random streams: as [`id`](Self::id), without the keys of its config that say
    /// only how it is looked at ([`About::looking_keys`]). Settings that differ in these meet the same episodes.
    #[must_use]
    pub fn stream_id(&self, about: &About) -> String {
        let mut looking = about.looking_keys().peekable();
        if looking.peek().is_none() {
            return self.id();
        }
        let mut happening = self.clone();
        if let Value::Object(config) = happening.config.make_mut() {
            looking.for_each(|key| drop(config.remove(key)));
        }
        happening.id()
    }

    /// The config with the content of data files in place of their paths, and trials in place of names, without
    /// what is of a machine: what enters the hash.
    #[must_use]
    pub fn identity(&self) -> Cow<'_, Value> {
        if self.files.is_empty() && self.products.is_empty() && self.of_machine.is_empty() {
            return self.config.whole();
        }
        let mut config = self.config.whole().into_owned();
        if let Some(keys) = config.as_object_mut() {
            keys.retain(|key, _| !self.of_machine.contains(key));
        }
        for (key, content) in &self.files {
            if let Some(path) = config.pointer_mut(key) {
                *path = json!({ "content": content });
            }
        }
        for (key, taken) in &self.products {
            if let Some(named) = config.pointer_mut(key) {
                *named = json!({ "product": taken.kind, "trial": taken.trial });
            }
        }
        Cow::Owned(config)
    }

    /// The config as its plugin is built from it: with what its data files hold, each read once and held
    /// against its hash, and with the folders of products, which `find` looks up.
    ///
    /// # Errors
    /// [`Error::DataFileChanged`], [`Error::File`] where one cannot be read, and what `find` says.
    pub fn loaded(&self, find: FindProduct<'_>) -> Result<Cow<'_, Value>, Error> {
        if self.files.is_empty() && self.products.is_empty() {
            return Ok(Cow::Borrowed(&self.config));
        }
        let mut config = self.config.whole().into_owned();
        for (key, content) in &self.files {
            let named = config.pointer_mut(key).filter(|value| value.is_string());
            let named = named
                .ok_or_else(|| Error::config(key, "names no data file, but the trial has the hash of one"))?;
            *named = data_file::read(named.as_str().unwrap_or_default(), content)?;
        }
        for (key, taken) in &self.products {
            let named = config.pointer_mut(key).filter(|value| value.is_object());
            let named = named
                .ok_or_else(|| Error::config(key, "names no product, but the trial has the source of one"))?;
            named["folder"] = json!(find(taken)?);
        }
        Ok(Cow::Owned(config))
    }
}

/// What is shared is stored as what it is.
mod shared {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use std::sync::Arc;

    pub(super) fn serialize<T: Serialize, S: Serializer>(
        value: &Arc<T>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        value.as_ref().serialize(serializer)
    }

    pub(super) fn deserialize<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Arc<T>, D::Error> {
        T::deserialize(deserializer).map(Arc::new)
    }
}

/// Id of a trial from the ids of its environment, agent and protocol.
#[must_use]
pub fn trial_id(parts: [&str; 3], seed: u64, numerics: u32, device: &str) -> String {
    // The canonical text of `[parts, seed, numerics, device]`, written at once: a plan has many trials.
    let [environment, agent, protocol] = parts;
    let device = json!(device);
    let text = format!(r#"[["{environment}","{agent}","{protocol}",],{seed},{numerics},{device},]"#);
    digest::of_bytes(text.as_bytes())
}

/// Kind of device; the trials of a plan share the word.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub struct Device(Arc<String>);

impl From<&str> for Device {
    fn from(kind: &str) -> Self {
        Self::from(kind.to_owned())
    }
}

impl From<String> for Device {
    fn from(kind: String) -> Self {
        Self(Arc::new(kind))
    }
}

impl From<Device> for String {
    fn from(kind: Device) -> Self {
        kind.to_string()
    }
}

impl std::ops::Deref for Device {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

/// Everything that determines the numbers of one trial, and nothing else. Trials of a plan that differ in their
/// seed alone share the rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialKey {
    /// The environment.
    #[serde(with = "shared")]
    pub environment: Arc<Part>,
    /// Who acts.
    #[serde(with = "shared")]
    pub agent: Arc<Seating>,
    /// The protocol.
    #[serde(with = "shared")]
    pub protocol: Arc<Part>,
    /// The replicate.
    pub seed: u64,
    /// Version of the shared numerical code.
    pub numerics: u32,
    /// Kind of device, `cpu`.
    pub device: Device,
}

impl TrialKey {
    /// The same with another seed.
    #[must_use]
    pub fn with_seed(&self, seed: u64) -> Self {
        Self { seed, ..self.clone() }
    }

    /// True where another key shares its parts in memory, so that they are equal without a look at them.
    pub fn shares_parts(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.environment, &other.environment)
            && Arc::ptr_eq(&self.agent, &other.agent)
            && Arc::ptr_eq(&self.protocol, &other.protocol)
    }

    /// The trial's id: 32 hexadecimal digits of a hash over the key.
    #[must_use]
    pub fn id(&self) -> String {
        trial_id(
            self.part_ids().each_ref().map(String::as_str),
            self.seed,
            self.numerics,
            &self.device,
        )
    }

    /// Ids of environment, agent and protocol.
    #[must_use]
    pub fn part_ids(&self) -> [String; 3] {
        [self.environment.id(), self.agent.id(), self.protocol.id()]
    }

    /// The products of other trials that it takes.
    #[must_use]
    pub fn taken(&self) -> Vec<Taken> {
        let of = |part: &Part| part.products.values().cloned().collect();
        let mut all: Vec<Taken> = [of(&self.environment), self.agent.taken(), of(&self.protocol)].concat();
        all.sort();
        all.dedup();
        all
    }

    /// The data files that its configs name, without a `./` before them, with the hashes of what they hold.
    pub fn data_files(&self) -> Vec<(&Path, &str)> {
        let parts = [&*self.environment, &*self.protocol]
            .into_iter()
            .chain(self.agent.parts());
        let files = parts.flat_map(|part| part.files.iter().map(move |(key, digest)| (part, key, digest)));
        let files = files.filter_map(|(part, key, digest)| {
            let path = part.config.pointer(key)?.as_str()?;
            let path = Path::new(path);
            Some((path.strip_prefix(".").unwrap_or(path), digest.as_str()))
        });
        files.collect()
    }

    /// True where it takes something from another trial.
    #[must_use]
    pub fn takes(&self) -> bool {
        let takes = |part: &Part| !part.products.is_empty();
        takes(&self.environment)
            || takes(&self.protocol)
            || match &*self.agent {
                Seating::Agent(part) => takes(part),
                Seating::Cast(_) => !self.agent.taken().is_empty(),
            }
    }

    /// Of these, what it takes by names of its own: a cast takes policies, and what their agents were made
    /// from is theirs.
    #[must_use]
    pub fn taken_by_name(&self) -> Vec<Taken> {
        match self.agent.cast() {
            None => self.taken(),
            Some(cast) => {
                let parts = [&self.environment, &self.protocol];
                parts
                    .into_iter()
                    .flat_map(|part| part.products.values().cloned())
                    .chain(cast.policies())
                    .collect()
            }
        }
    }

    /// The plugins of its agents, as in `dirichlet_sac` or `rommeo+tdom_ac`.
    #[must_use]
    pub fn agents_by_plugin(&self) -> String {
        let plugins: Vec<&str> = self
            .agent
            .parts()
            .iter()
            .map(|part| part.plugin.as_str())
            .collect();
        plugins.join("+")
    }

    /// Ids of the trials that must have ended `ok` before it begins, each once.
    #[must_use]
    pub fn sources(&self) -> Vec<String> {
        let mut ids: Vec<String> = self.taken().into_iter().map(|taken| taken.trial).collect();
        ids.dedup();
        ids
    }

    /// As [`run_after`](Self::run_after), for a trial that takes nothing from another one.
    ///
    /// # Errors
    /// As there, and [`Error::Source`] for a trial that takes products.
    pub fn run(
        &self,
        registry: &Registry,
        folder: Option<&Path>,
        progress: &mut dyn FnMut(u64, u64),
        keeper: &mut dyn Keeper,
    ) -> Result<Recorder, Error> {
        self.run_after(registry, &no_product, folder, progress, keeper)
    }

    /// Builds the parts and runs the protocol from what `keeper` has of this trial, or from the start;
    /// `progress` is told steps done and steps in all. `find` looks up what other trials left; what this one
    /// leaves goes into `folder`.
    ///
    /// # Errors
    /// Whatever a plugin reports, [`Error::Source`] for a product of another trial that cannot be used, and
    /// [`Error::Stopped`] where `keeper` asked the trial to stop.
    pub fn run_after(
        &self,
        registry: &Registry,
        find: FindProduct<'_>,
        folder: Option<&Path>,
        progress: &mut dyn FnMut(u64, u64),
        keeper: &mut dyn Keeper,
    ) -> Result<Recorder, Error> {
        loop {
            match self.attempt(registry, find, folder, progress, keeper) {
                // What the trial continued from does not fit it: the next attempt takes up something older or
                // begins anew.
                Err(Error::Checkpoint { .. }) if keeper.refuse() => {}
                outcome => return outcome,
            }
        }
    }

    fn attempt(
        &self,
        registry: &Registry,
        find: FindProduct<'_>,
        folder: Option<&Path>,
        progress: &mut dyn FnMut(u64, u64),
        keeper: &mut dyn Keeper,
    ) -> Result<Recorder, Error> {
        let environment = find_entry(&registry.environments, "environment", &self.environment.plugin)?;
        let protocol = find_entry(&registry.protocols, "protocol", &self.protocol.plugin)?;
        let protocol = (protocol.build)(&*self.protocol.loaded(find)?)?;
        let config = self.environment.loaded(find)?;
        let make_environment = || (environment.build)(&config);
        let streams = Streams::new(
            &self.id(),
            &self.environment.stream_id(&environment.about),
            self.seed,
        );
        // It stays until the trial ends, and with it what the environments of a trial have in common.
        let first_environment = make_environment()?;
        let interface = first_environment.interface();
        let agent = self.build_agent(registry, &interface, &streams, find)?;
        let record = Recorder::default();
        let assignment = Assignment {
            simulator: self.simulator(&streams),
            ..self.assignment((environment.names)(&config), &config)
        };
        let mut run = Run {
            make_environment: &make_environment,
            agent,
            streams,
            record,
            progress,
            assignment,
            keeper,
            folder,
        };
        let ran = protocol.run(&mut run).and_then(|()| run.record.all_finite());
        if let Err(error) = ran {
            run.keeper.fails(&run.record);
            return Err(error);
        }
        if let (Some(folder), Seating::Agent(_)) = (folder, &*self.agent) {
            run.agent.export(folder).map_err(Error::of_store)?;
        }
        Ok(run.record)
    }

    /// The task of an agent that trains itself; the protocol adds for how long.
    fn assignment(&self, names: Vec<(&str, String)>, environment: &Value) -> Assignment {
        Assignment {
            trial: self.id(),
            seed: self.seed,
            environment: with_names(environment, names),
            ..Assignment::default()
        }
    }

    /// The environment as others can make it, who need not know where the study was started.
    fn simulator(&self, streams: &Streams) -> Simulator {
        let mut config = self.environment.config.whole().into_owned();
        for key in self.environment.files.keys() {
            if let Some(Value::String(path)) = config.pointer_mut(key)
                && let Ok(absolute) = std::path::absolute(&*path)
            {
                *path = absolute.display().to_string();
            }
        }
        Simulator {
            plugin: self.environment.plugin.clone(),
            config,
            stream_id: streams.environment_id().to_owned(),
        }
    }

    /// What acts, freshly made; `find` as in [`run_after`](Self::run_after).
    ///
    /// # Errors
    /// The error of the constructor, and [`Error::Source`] for a product that cannot be used.
    pub fn build_agent(
        &self,
        registry: &Registry,
        interface: &Interface,
        streams: &Streams,
        find: FindProduct<'_>,
    ) -> Result<Box<dyn Agent>, Error> {
        match &*self.agent {
            Seating::Cast(cast) => Ok(Box::new(Team::assemble(
                cast, registry, interface, streams, find,
            )?)),
            Seating::Agent(part) => {
                let entry = find_entry(&registry.agents, "agent", &part.plugin)?;
                (entry.build)(&*part.loaded(find)?, interface, &mut streams.agent("initialise"))
            }
        }
    }
}

/// A trial of a study: its key and the names under which tables and figures speak of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Hash of `key`.
    pub id: String,
    /// What it is in the study; the trials of all seeds share it.
    #[serde(flatten, with = "shared")]
    pub cell: Arc<TrialCell>,
    /// What determines the numbers.
    pub key: TrialKey,
}

/// Environment, agent and setting, by their names in the study: what seeds are replicates of.
pub type CellName = (String, String, String);

/// What a trial is in its study: all but its seed.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct TrialCell {
    /// Name of the environment in the study.
    pub environment: String,
    /// Name of the agent in the study.
    pub agent: String,
    /// The point of the sweep, as `key=value` words; empty without a sweep.
    pub setting: String,
    /// The same with the values themselves; empty in trials that were stored before it was recorded.
    #[serde(default, skip_serializing_if = "Setting::is_empty")]
    pub point: Setting,
    /// What it is for.
    #[serde(default)]
    pub purpose: Purpose,
}

impl TrialCell {
    /// An environment and an agent that no sweep concerns.
    #[must_use]
    pub fn of(environment: impl Into<String>, agent: impl Into<String>) -> Self {
        Self {
            environment: environment.into(),
            agent: agent.into(),
            ..Self::default()
        }
    }

    /// Names of environment, agent and setting.
    #[must_use]
    pub fn names(&self) -> CellName {
        (self.environment.clone(), self.agent.clone(), self.setting.clone())
    }
}

/// What a trial is for in its study.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Purpose {
    /// It is one of a combination of environment, agent and setting, which tables, figures and claims show.
    #[default]
    Cell,
    /// It leaves what other trials take: an entry of the section `prepare`, whose name stands for the
    /// environment.
    Prepared,
    /// It measures a setting for the search with this name.
    Tried(String),
    /// It is an encounter of a play, whose name stands for the environment; the agents by role.
    Play(BTreeMap<String, String>),
    /// It is a run of another program, which tables, figures and claims show beside our own.
    Imported,
}

impl Purpose {
    /// True for a trial that measures a setting for a search.
    #[must_use]
    pub fn is_tried(&self) -> bool {
        matches!(self, Self::Tried(_))
    }
}

impl Trial {
    /// What it is in the study, to be changed for this trial alone.
    pub fn cell_mut(&mut self) -> &mut TrialCell {
        Arc::make_mut(&mut self.cell)
    }

    /// Environment, agent, setting and seed in words.
    #[must_use]
    pub fn title(&self) -> String {
        let setting = if self.cell.setting.is_empty() {
            String::new()
        } else {
            format!(" [{}]", self.cell.setting)
        };
        format!(
            "{} {}{setting} seed {}",
            self.cell.environment, self.cell.agent, self.key.seed
        )
    }
}

/// The config of an environment, with what that is called elsewhere where no key of its own has the name.
pub fn with_names(environment: &Value, names: Vec<(&str, String)>) -> Value {
    let mut named = environment.clone();
    if let Some(keys) = named.as_object_mut() {
        for (key, name) in names {
            keys.entry(key).or_insert(Value::String(name));
        }
    }
    named
}

fn find_entry<'a, T>(entries: &'a BTreeMap<&'static str, T>, kind: &str, name: &str) -> Result<&'a T, Error> {
    entries
        .get(name)
        .ok_or_else(|| Error::config(kind, format!("`{name}` is not registered in this program")))
}

/// Hash of a JSON value that does not depend on the order of keys.
#[must_use]
pub fn hash(value: &Value) -> String {
    let mut text = Vec::new();
    canonical(value, &mut text);
    digest::of_bytes(&text)
}

fn canonical(value: &Value, out: &mut Vec<u8>) {
    match value {
        Value::Object(map) => {
            let mut entries: Vec<_> = map.iter().collect();
            entries.sort_by_key(|(key, _)| *key);
            out.push(b'{');
            for (key, value) in entries {
                written(key, out);
                out.push(b':');
                canonical(value, out);
                out.push(b',');
            }
            out.push(b'}');
        }
        Value::Array(items) => {
            out.push(b'[');
            for item in items {
                canonical(item, out);
                out.push(b',');
            }
            out.push(b']');
        }
        scalar => written(scalar, out),
    }
}

fn written(scalar: &impl Serialize, out: &mut Vec<u8>) {
    // Neither a word nor a JSON value that holds no other can fail to be written into memory.
    serde_json::to_writer(out, scalar).expect("a scalar is text");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_of_keys_does_not_reach_the_hash() {
        let (one, two) = (
            r#"{"a":1,"b":[2,{"c":3,"d":4}]}"#,
            r#"{"b":[2,{"d":4,"c":3}],"a":1}"#,
        );
        let parse = |text| serde_json::from_str::<Value>(text).unwrap();
        assert_eq!(hash(&parse(one)), hash(&parse(two)));
        assert_ne!(hash(&parse("[1,2]")), hash(&parse("[2,1]")));
    }

    #[test]
    fn the_id_of_a_part_is_the_hash_of_its_canonical_text() {
        let part = Part::new(
            "odd \"name\"",
            3,
            json!({"b": [1.5, "x\n"], "a": {"c": null, "d": true}}),
        );
        assert_eq!(part.id(), hash(&json!([part.plugin, part.version, *part.config])));
        assert_eq!(part.id(), "61feced781fc19da9c518f083e51baee");
    }

    #[test]
    fn what_is_of_a_machine_does_not_reach_the_id() {
        let part = |program: &str| Part {
            of_machine: vec!["program".into()],
            ..Part::new("tank", 1, json!({ "program": program, "height": 2.0 }))
        };
        assert_eq!(part("python3").id(), part("/opt/python").id());
        assert_eq!(
            part("python3").id(),
            Part::new("tank", 1, json!({ "height": 2.0 })).id()
        );
        let stored: Part = serde_json::from_value(json!(part("python3"))).unwrap();
        assert_eq!(stored, part("python3"));
    }

    #[test]
    fn the_id_of_a_trial_is_the_hash_of_its_canonical_text() {
        let parts = ["0a", "1b", "2c"];
        assert_eq!(
            trial_id(parts, 7, 3, "cpu \"odd\""),
            hash(&json!([parts, 7, 3, "cpu \"odd\""]))
        );
    }
}
