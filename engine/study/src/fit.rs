//! Fit of agents and environments. Both are built with their defaults, as `check` builds those that a study names.

use contract::{Agent, Environment, Error, Interface, Registry, random, registry::AgentEntry};
use serde::Serialize;

/// Options of `describe`: facts that it finds by building plugins.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FitOptions {
    /// Whether to find the agents that fit an environment, and the environments that fit an agent.
    pub fits: bool,
    /// Whether to find the reason why each of the others does not fit.
    pub why: bool,
}

/// An agent or an environment that cannot be used, and the reason.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Unfit {
    /// The agent, or the environment.
    pub name: String,
    /// Reason, as a phrase.
    pub reason: String,
}

/// The environment of this name with its defaults; `None` if there is none or if it refuses them.
pub fn environment(registry: &Registry, name: &str) -> Option<Box<dyn Environment>> {
    let entry = registry.environments.get(name)?;
    (entry.build)(&entry.about.defaults).ok()
}

/// An agent with its defaults for the seats of an environment.
///
/// # Errors
/// The reason why the agent cannot be used there.
pub fn agent(entry: &AgentEntry, interface: &Interface) -> Result<Box<dyn Agent>, String> {
    let built = (entry.build)(
        &entry.about.defaults,
        interface,
        &mut random::stream(&["describe"]),
    );
    built.map_err(|error| match error {
        Error::Mismatch { problem, .. } => problem,
        other => other.to_string(),
    })
}

/// The agents sorted by fit to an environment: those that learn, those that do not, and the unfit ones with their
/// reasons.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Fitting {
    /// Agents that fit and learn.
    pub learners: Vec<String>,
    /// Agents that fit and do not learn.
    pub rules: Vec<String>,
    /// Agents that do not fit.
    pub unfit: Vec<Unfit>,
}

/// Sorts the registered agents by their fit to an interface.
#[must_use]
pub fn agents(registry: &Registry, interface: &Interface) -> Fitting {
    let mut all = Fitting::default();
    for (name, entry) in &registry.agents {
        let name = (*name).to_owned();
        match agent(entry, interface) {
            Ok(_) if entry.traits.learns() => all.learners.push(name),
            Ok(_) => all.rules.push(name),
            Err(reason) => all.unfit.push(Unfit { name, reason }),
        }
    }
    all
}
