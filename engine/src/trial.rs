//! One trial: an environment, an agent, a protocol and a seed, with an identity made of what determines its numbers.

use crate::{
    Agent, Error, Interface, Keeper, Protocol, Recorder, Registry,
    cross_play::{self, Cast, Team},
    data_file,
    protocol::{CrossPlay, Run},
    random::Streams,
    setting::Setting,
};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{
    borrow::Cow,
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

/// A plugin's name, version and complete config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Registered name.
    pub plugin: String,
    /// Version of the plugin's code.
    pub version: u32,
    /// Config with every default filled in; the trials of a plan share it.
    #[serde(with = "shared")]
    pub config: Arc<Value>,
    /// Hashes of the data files that the config names, by JSON pointer: what a file holds determines numbers, its path does not.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
}

impl Part {
    /// A part without data files.
    #[must_use]
    pub fn new(plugin: impl Into<String>, version: u32, config: Value) -> Self {
        Self { plugin: plugin.into(), version, config: Arc::new(config), files: BTreeMap::new() }
    }

    /// Hash of plugin, version, config and the content of data files.
    #[must_use]
    pub fn id(&self) -> String {
        hash(&json!([self.plugin, self.version, *self.identity()]))
    }

    /// The config with the content of data files in place of their paths: what enters the hash.
    #[must_use]
    pub fn identity(&self) -> Cow<'_, Value> {
        if self.files.is_empty() {
            return Cow::Borrowed(&self.config);
        }
        let mut config = (*self.config).clone();
        for (key, content) in &self.files {
            if let Some(path) = config.pointer_mut(key) {
                *path = json!({ "content": content });
            }
        }
        Cow::Owned(config)
    }

    /// The config as its plugin is built from it: with what its data files hold, each read once and held against its hash.
    ///
    /// # Errors
    /// [`Error::DataFileChanged`], and [`Error::File`] where one cannot be read.
    pub fn loaded(&self) -> Result<Cow<'_, Value>, Error> {
        if self.files.is_empty() {
            return Ok(Cow::Borrowed(&self.config));
        }
        let mut config = (*self.config).clone();
        for (key, content) in &self.files {
            let named = config.pointer_mut(key).filter(|value| value.is_string());
            let named = named.ok_or_else(|| Error::config(key, "names no data file, but the trial has the hash of one"))?;
            *named = data_file::read(named.as_str().unwrap_or_default(), content)?;
        }
        Ok(Cow::Owned(config))
    }
}

/// A shared value is stored as the value itself.
mod shared {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use serde_json::Value;
    use std::sync::Arc;

    pub(super) fn serialize<S: Serializer>(value: &Arc<Value>, serializer: S) -> Result<S::Ok, S::Error> {
        value.as_ref().serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Arc<Value>, D::Error> {
        Value::deserialize(deserializer).map(Arc::new)
    }
}

/// Id of a trial from the ids of its environment, agent and protocol.
#[must_use]
pub fn trial_id(parts: [&str; 3], seed: u64, numerics: u32, device: &str) -> String {
    // The canonical text of `[parts, seed, numerics, device]`, written at once: a plan has many trials.
    let [environment, agent, protocol] = parts;
    let device = json!(device);
    hash_text(&format!(r#"[["{environment}","{agent}","{protocol}",],{seed},{numerics},{device},]"#))
}

/// Everything that determines the numbers of one trial, and nothing else.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrialKey {
    /// The environment.
    pub environment: Part,
    /// The agent.
    pub agent: Part,
    /// The protocol.
    pub protocol: Part,
    /// The replicate.
    pub seed: u64,
    /// Version of the shared numerical code.
    pub numerics: u32,
    /// Kind of device, `cpu`.
    pub device: String,
}

impl TrialKey {
    /// The trial's id: 32 hexadecimal digits of a hash over the key.
    #[must_use]
    pub fn id(&self) -> String {
        trial_id(self.part_ids().each_ref().map(String::as_str), self.seed, self.numerics, &self.device)
    }

    /// Ids of environment, agent and protocol.
    #[must_use]
    pub fn part_ids(&self) -> [String; 3] {
        [self.environment.id(), self.agent.id(), self.protocol.id()]
    }

    /// Hash of the environment alone, which keys the environment's random streams.
    #[must_use]
    pub fn environment_id(&self) -> String {
        self.environment.id()
    }

    /// As [`run_after`](Self::run_after), for a trial that plays no policy of another one.
    ///
    /// # Errors
    /// As there, and [`Error::Source`] for a trial of cross-play.
    pub fn run(
        &self,
        registry: &Registry,
        policy_dir: Option<&Path>,
        progress: &mut dyn FnMut(u64, u64),
        keeper: &mut dyn Keeper,
    ) -> Result<Recorder, Error> {
        let none = |trial: &str| Err(Error::Source { trial: trial.into(), problem: "there is no store to find it in".into() });
        self.run_after(registry, &none, policy_dir, progress, keeper)
    }

    /// Builds the parts and runs the protocol from what `keeper` has of this trial, or from the start; `progress` is told
    /// steps done and steps in all. `policies` finds the folder of a policy that a trial left, by the trial's id.
    ///
    /// # Errors
    /// Whatever a plugin reports, [`Error::Source`] for a policy of another trial that cannot be used, and [`Error::Stopped`]
    /// where `keeper` asked the trial to stop.
    pub fn run_after(
        &self,
        registry: &Registry,
        policies: &dyn Fn(&str) -> Result<PathBuf, Error>,
        policy_dir: Option<&Path>,
        progress: &mut dyn FnMut(u64, u64),
        keeper: &mut dyn Keeper,
    ) -> Result<Recorder, Error> {
        loop {
            match self.attempt(registry, policies, policy_dir, progress, keeper) {
                // What the trial continued from does not fit it: the next attempt takes up something older or begins anew.
                Err(Error::Checkpoint { .. }) if keeper.refuse() => {}
                outcome => return outcome,
            }
        }
    }

    fn attempt(
        &self,
        registry: &Registry,
        policies: &dyn Fn(&str) -> Result<PathBuf, Error>,
        policy_dir: Option<&Path>,
        progress: &mut dyn FnMut(u64, u64),
        keeper: &mut dyn Keeper,
    ) -> Result<Recorder, Error> {
        let environment = find(&registry.environments, "environment", &self.environment.plugin)?;
        let protocol = self.build_protocol(registry)?;
        let config = self.environment.loaded()?;
        let make_environment = || (environment.build)(&config);
        let streams = Streams::new(&self.id(), &self.environment_id(), self.seed);
        let interface = make_environment()?.interface();
        let agent = self.build_agent(registry, &interface, &streams, policies)?;
        let record = Recorder::default();
        let mut run = Run { make_environment: &make_environment, agent, streams, record, progress, keeper };
        protocol.run(&mut run)?;
        run.record.all_finite()?;
        if let Some(dir) = policy_dir {
            run.agent.export(dir).map_err(Error::of_store)?;
        }
        Ok(run.record)
    }

    fn build_protocol(&self, registry: &Registry) -> Result<Box<dyn Protocol>, Error> {
        if self.protocol.plugin == cross_play::NAME {
            let config = CrossPlay::deserialize(&*self.protocol.config);
            return config.map(|it| Box::new(it) as _).map_err(|source| Error::config("protocol", source.to_string()));
        }
        (find(&registry.protocols, "protocol", &self.protocol.plugin)?.build)(&*self.protocol.loaded()?)
    }

    /// The agent, freshly initialised; `policies` as in [`run_after`](Self::run_after).
    pub(crate) fn build_agent(
        &self,
        registry: &Registry,
        interface: &Interface,
        streams: &Streams,
        policies: &dyn Fn(&str) -> Result<PathBuf, Error>,
    ) -> Result<Box<dyn Agent>, Error> {
        if let Some(cast) = Cast::of(self) {
            return Ok(Box::new(Team::assemble(&cast, registry, interface, streams, policies)?));
        }
        let entry = find(&registry.agents, "agent", &self.agent.plugin)?;
        (entry.build)(&*self.agent.loaded()?, interface, &mut streams.agent("initialise"))
    }
}

/// A trial of a study: its key and the names under which tables and figures speak of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Hash of `key`.
    pub id: String,
    /// Name of the environment in the study.
    pub environment: String,
    /// Name of the agent in the study.
    pub agent: String,
    /// The point of the sweep, as `key=value` words; empty without a sweep.
    pub setting: String,
    /// The same with the values themselves; empty in trials that were stored before it was recorded.
    #[serde(default, skip_serializing_if = "Setting::is_empty")]
    pub point: Setting,
    /// What determines the numbers.
    pub key: TrialKey,
}

impl Trial {
    /// Environment, agent, setting and seed in words.
    #[must_use]
    pub fn title(&self) -> String {
        let setting = if self.setting.is_empty() { String::new() } else { format!(" [{}]", self.setting) };
        format!("{} {}{setting} seed {}", self.environment, self.agent, self.key.seed)
    }
}

fn find<'a, T>(entries: &'a BTreeMap<&'static str, T>, kind: &str, name: &str) -> Result<&'a T, Error> {
    entries.get(name).ok_or_else(|| Error::config(kind, format!("`{name}` is not registered in this program")))
}

/// Hash of a JSON value that does not depend on the order of keys.
#[must_use]
pub fn hash(value: &Value) -> String {
    let mut text = String::new();
    canonical(value, &mut text);
    hash_text(&text)
}

fn hash_text(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex()[..32].to_string()
}

fn canonical(value: &Value, out: &mut String) {
    match value {
        Value::Object(map) => {
            let mut entries: Vec<_> = map.iter().collect();
            entries.sort_by_key(|(key, _)| *key);
            out.push('{');
            for (key, value) in entries {
                out.push_str(&json!(key).to_string());
                out.push(':');
                canonical(value, out);
                out.push(',');
            }
            out.push('}');
        }
        Value::Array(items) => {
            out.push('[');
            for item in items {
                canonical(item, out);
                out.push(',');
            }
            out.push(']');
        }
        scalar => out.push_str(&scalar.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_of_keys_does_not_reach_the_hash() {
        let (one, two) = (r#"{"a":1,"b":[2,{"c":3,"d":4}]}"#, r#"{"b":[2,{"d":4,"c":3}],"a":1}"#);
        let parse = |text| serde_json::from_str::<Value>(text).unwrap();
        assert_eq!(hash(&parse(one)), hash(&parse(two)));
        assert_ne!(hash(&parse("[1,2]")), hash(&parse("[2,1]")));
    }

    #[test]
    fn the_id_of_a_trial_is_the_hash_of_its_canonical_text() {
        let parts = ["0a", "1b", "2c"];
        assert_eq!(trial_id(parts, 7, 3, "cpu \"odd\""), hash(&json!([parts, 7, 3, "cpu \"odd\""])));
    }
}
