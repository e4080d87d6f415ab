//! `regimen rollout`: one environment, given actions or an agent, one CSV file.

use super::{BAD_SPEC, Failure, OK, colour, complain};
use crate::{
    Registry, diagnostic,
    random::Streams,
    registry::About,
    rollout::{self, Actions},
    spec,
};
use clap::Args;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Which environment, which actions, which file.
#[derive(Debug, Clone, Args)]
pub(super) struct RolloutOptions {
    /// Name of the environment.
    environment: String,
    /// YAML file with the environment's config; defaults where absent.
    #[arg(long, value_name = "FILE.yaml")]
    config: Option<PathBuf>,
    /// CSV file with one column per action channel and one row per decision.
    #[arg(long, value_name = "FILE.csv", required_unless_present = "agent", conflicts_with = "agent")]
    actions: Option<PathBuf>,
    /// Name of an agent that decides, with its default config or that of `--agent-config`.
    #[arg(long, value_name = "NAME")]
    agent: Option<String>,
    /// YAML file with the agent's config.
    #[arg(long, value_name = "FILE.yaml", requires = "agent")]
    agent_config: Option<PathBuf>,
    /// Seed of the environment's and the agent's random numbers.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The most decisions that an agent makes.
    #[arg(long, default_value_t = 100_000)]
    decisions: u64,
    /// Where to write.
    #[arg(long, value_name = "FILE.csv")]
    out: PathBuf,
}

/// Rolls out and says how many decisions were made.
pub(super) fn rollout(registry: &Registry, options: &RolloutOptions) -> Result<u8, Failure> {
    let name = &options.environment;
    let entry =
        registry.environments.get(name.as_str()).ok_or_else(|| unknown("environment", name, registry.environments.keys()))?;
    let mut environment = (entry.build)(&config(name, &entry.about, options.config.as_deref())?)?;
    let mut agent;
    let actions = match (&options.actions, &options.agent) {
        (Some(path), _) => Actions::Given(rollout::read_actions(environment.seats(), path)?),
        (None, Some(name)) => {
            agent = build_agent(registry, name, options, &*environment)?;
            Actions::Agent { agent: &mut *agent, decisions: options.decisions }
        }
        (None, None) => return Err(Failure { code: BAD_SPEC, text: "error: give --actions or --agent".into() }),
    };
    let decisions = rollout::write(&mut *environment, actions, options.seed, &options.out)?;
    complain(&format!("{decisions} decisions written to {}", options.out.display()));
    Ok(OK)
}

fn build_agent(
    registry: &Registry,
    name: &str,
    options: &RolloutOptions,
    environment: &dyn crate::Environment,
) -> Result<Box<dyn crate::Agent>, Failure> {
    let entry = registry.agents.get(name).ok_or_else(|| unknown("agent", name, registry.agents.keys()))?;
    let config = config(name, &entry.about, options.agent_config.as_deref())?;
    let streams = Streams::new("rollout", "rollout", options.seed);
    Ok((entry.build)(&config, &environment.interface(), &mut streams.agent("initialise"))?)
}

fn config(name: &str, about: &About, path: Option<&Path>) -> Result<Value, Failure> {
    let part = spec::load_config(name, about, path)
        .map_err(|problems| Failure { code: BAD_SPEC, text: diagnostic::render(&problems, colour()) })?;
    Ok((*part.config).clone())
}

fn unknown<'a>(kind: &str, name: &str, known: impl Iterator<Item = &'a &'static str> + Clone) -> Failure {
    let nearest = diagnostic::suggest(name, known.copied());
    Failure { code: BAD_SPEC, text: format!("error: unknown {kind} `{name}`; {nearest}") }
}
