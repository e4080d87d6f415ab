//! The config of an environment, read from its name and the user's keys with the registry and the checks of the
//! program.

use crate::refusal::Refusal;
use contract::{
    Environment, Registry, artifact::no_artifact, complete_config::CompleteConfig, part::Part, plugin::About,
    registry::EnvironmentEntry,
};
use document::diagnostic;

use pyo3::prelude::*;
use std::{path::Path, sync::LazyLock};

pub static REGISTRY: LazyLock<Registry> = LazyLock::new(plugins::registry);

/// An environment with a checked config, which can be built any number of times.
pub struct ConfiguredEnvironment {
    entry: &'static EnvironmentEntry,
    config: CompleteConfig,
    /// Key of the environment's random streams in a trial.
    pub stream_id: String,
}

impl ConfiguredEnvironment {
    /// Reads the keys of the environment `name` from a JSON text or a YAML file; without either, its defaults apply.
    ///
    /// # Errors
    /// [`Refusal::Config`] with every problem, in the words of `check`.
    pub fn new(name: &str, keys: Option<&str>, file: Option<&Path>) -> Result<Self, Refusal> {
        let entry = REGISTRY.environments.get(name).ok_or_else(|| unknown(name))?;
        let part = read(name, &entry.about, keys, file)?;
        Ok(Self {
            entry,
            config: part.loaded(&no_artifact)?,
            stream_id: part.stream_id(&entry.about),
        })
    }

    /// A new environment.
    ///
    /// # Errors
    /// Refusals of the environment's constructor.
    pub fn build(&self) -> Result<Box<dyn Environment>, Refusal> {
        Ok((self.entry.build)(&self.config)?)
    }
}

fn read(name: &str, about: &About, keys: Option<&str>, file: Option<&Path>) -> Result<Part, Refusal> {
    let part = match keys {
        Some(keys) => study::read_config(
            name,
            about,
            &format!("the config of `{name}`"),
            keys,
            Path::new(""),
        ),
        None => study::load_config(name, about, file),
    };
    part.map_err(|problems| Refusal::Config(diagnostic::render_first(&problems)))
}

fn unknown(name: &str) -> Refusal {
    let nearest = diagnostic::suggest(name, REGISTRY.environments.keys().copied());
    Refusal::Config(format!("unknown environment `{name}`; {nearest}"))
}

/// Name, version and one-line description of every registered environment.
#[pyfunction]
pub fn environments() -> Vec<(&'static str, u32, &'static str)> {
    let of =
        |(name, entry): (&&'static str, &EnvironmentEntry)| (*name, entry.about.version, entry.about.about);
    REGISTRY.environments.iter().map(of).collect()
}
