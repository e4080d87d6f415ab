//! Plugins with their configs, as parts of a trial.

use crate::{
    Error,
    artifact::{FindArtifact, Taken},
    complete_config::CompleteConfig,
    data_file, digest,
    plugin::About,
};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{borrow::Cow, collections::BTreeMap};

/// A plugin's name, version and complete config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Registered name.
    pub plugin: String,
    /// Version of the plugin's code.
    pub version: u32,
    /// Config with every default filled in; the trials of a plan share it.
    pub config: CompleteConfig,
    /// Hashes of the data files that the config names, by JSON pointer: the content of a file determines numbers, its
    /// path does not.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
    /// Artifacts of other trials that the config takes, by JSON pointer: the trial that leaves one determines numbers,
    /// its name in a study does not.
    #[serde(rename = "products", default, skip_serializing_if = "BTreeMap::is_empty")]
    pub artifacts: BTreeMap<String, Taken>,
    /// Names of keys of the config that only decide where it is computed; they determine no numbers. The plugin's
    /// schema marks them with `x-identity: false`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub of_machine: Vec<String>,
}

impl Part {
    /// A part without data files and artifacts.
    #[must_use]
    pub fn new(plugin: impl Into<String>, version: u32, config: impl Into<CompleteConfig>) -> Self {
        let (files, artifacts) = (BTreeMap::new(), BTreeMap::new());
        Self {
            plugin: plugin.into(),
            version,
            config: config.into(),
            files,
            artifacts,
            of_machine: Vec::new(),
        }
    }

    /// Hash of plugin, version, config, the content of data files and the trials whose artifacts are taken.
    #[must_use]
    pub fn id(&self) -> String {
        // The canonical text of `[plugin, version, config]`. A plan has many configs, and none is copied.
        let mut text = vec![b'['];
        digest::write_scalar(&self.plugin, &mut text);
        text.push(b',');
        digest::write_scalar(&self.version, &mut text);
        text.push(b',');
        digest::write_canonical(&self.identity(), &mut text);
        text.extend(b",]");
        digest::of_bytes(&text)
    }

    /// Hash that keys an environment's random streams: like [`id`](Self::id), but without the keys of its config that
    /// only concern observation ([`About::looking_keys`]). Settings that differ only in these keys have the same
    /// episodes.
    #[must_use]
    pub fn stream_id(&self, about: &About) -> String {
        let mut looking = about.looking_keys().peekable();
        if looking.peek().is_none() {
            return self.id();
        }
        let mut happening = self.clone();
        if let Value::Object(config) = &mut *happening.config {
            looking.for_each(|key| drop(config.remove(key)));
        }
        happening.id()
    }

    /// The hashed form of the config: with the content of data files instead of their paths, with trials instead of
    /// names, and without keys of the machine.
    #[must_use]
    pub fn identity(&self) -> Cow<'_, Value> {
        if self.files.is_empty() && self.artifacts.is_empty() && self.of_machine.is_empty() {
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
        for (key, taken) in &self.artifacts {
            if let Some(named) = config.pointer_mut(key) {
                *named = json!({ "product": taken.kind, "trial": taken.trial });
            }
        }
        Cow::Owned(config)
    }

    /// The config from which its plugin is built: with the content of its data files, each read once and compared with
    /// its hash, and with the folders of artifacts, which `find` looks up.
    ///
    /// # Errors
    /// [`Error::DataFileChanged`], [`Error::File`] if one cannot be read, and the errors of `find`.
    pub fn loaded(&self, find: FindArtifact<'_>) -> Result<CompleteConfig, Error> {
        if self.files.is_empty() && self.artifacts.is_empty() {
            return Ok(self.config.clone());
        }
        let mut config = self.config.whole().into_owned();
        for (key, content) in &self.files {
            let named = config.pointer_mut(key).filter(|value| value.is_string());
            let named = named
                .ok_or_else(|| Error::config(key, "names no data file, but the trial has the hash of one"))?;
            *named = data_file::read(named.as_str().unwrap_or_default(), content)?;
        }
        for (key, taken) in &self.artifacts {
            let named = config.pointer_mut(key).filter(|value| value.is_object());
            let named = named.ok_or_else(|| {
                Error::config(key, "names no artifact, but the trial has the source of one")
            })?;
            named["folder"] = json!(find(taken)?);
        }
        Ok(config.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_id_of_a_part_is_the_hash_of_its_canonical_text() {
        let part = Part::new(
            "odd \"name\"",
            3,
            json!({"b": [1.5, "x\n"], "a": {"c": null, "d": true}}),
        );
        assert_eq!(
            part.id(),
            digest::of_json(&json!([part.plugin, part.version, *part.config]))
        );
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
}
