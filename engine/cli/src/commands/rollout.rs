//! `regimen rollout`: one environment, given actions, an agent or a stored trial, one CSV file.

use super::{Common, complain};
use crate::rollout::{self, Actions};
use clap::Args;
use contract::{
    Agent, Environment, Registry, part::Part, plugin::About, product::Taken, random::Streams,
    registry::AgentEntry, trial_result::TrialResult,
};
use document::diagnostic;
use execution::{
    store::{Store, TrialFile},
    world::fs,
};
use serde_json::Value;
use session::{Exit, Failure, Settings, one_trial};
use std::path::{Path, PathBuf};

/// Which environment, which actions, which file.
#[derive(Debug, Clone, Args)]
pub(super) struct RolloutOptions {
    /// Name of the environment; that of the trial with `--trial`.
    #[arg(required_unless_present = "trial")]
    environment: Option<String>,
    /// YAML file with the environment's config; defaults where absent.
    #[arg(long, value_name = "FILE.yaml", conflicts_with = "trial")]
    config: Option<PathBuf>,
    /// CSV file with one column per action channel and one row per decision.
    #[arg(
        long,
        value_name = "FILE.csv",
        required_unless_present_any = ["agent", "policy", "trial"],
        conflicts_with_all = ["agent", "policy", "trial"]
    )]
    actions: Option<PathBuf>,
    /// Name of an agent that decides, with its default config or that of `--agent-config`. One that learns
    /// needs `--policy`.
    #[arg(long, value_name = "NAME", conflicts_with = "trial")]
    agent: Option<String>,
    /// YAML file with the agent's config.
    #[arg(long, value_name = "FILE.yaml", requires = "agent")]
    agent_config: Option<PathBuf>,
    /// Folder with an exported policy. Beside the `trial.json` of the trial that left it, agent and config
    /// are known.
    #[arg(long, value_name = "FOLDER", conflicts_with = "trial")]
    policy: Option<PathBuf>,
    /// A trial of the store, by the first digits of its id: its environment, its agent, its policy, in an
    /// episode of its final measurement (`--episode`) or a new one (`--seed`).
    #[arg(long, value_name = "ID")]
    trial: Option<String>,
    /// Which episode of the trial's final measurement; 0 where absent.
    #[arg(long, value_name = "N", requires = "trial", conflicts_with = "seed")]
    episode: Option<u64>,
    /// Seed of the environment's and the agent's random numbers; 0 where absent. With `--trial`: a new
    /// episode, not a measured one.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// The most decisions that an agent makes.
    #[arg(long, default_value_t = 100_000)]
    decisions: u64,
    /// Where to write.
    #[arg(long, value_name = "FILE.csv")]
    out: PathBuf,
}

/// Rolls out and says how many decisions were made.
pub(super) fn rollout(
    registry: &Registry,
    options: &RolloutOptions,
    common: &Common,
) -> Result<Exit, Failure> {
    let rows = match (&options.trial, &options.environment) {
        (Some(prefix), _) => of_trial(registry, prefix, options, common)?,
        (None, Some(name)) => of_environment(registry, name, options)?,
        (None, None) => return Err(Failure::refusal("give the name of an environment or `--trial`")),
    };
    let decisions = rollout::write(&rows, &options.out)?;
    complain(&format!(
        "{decisions} decisions written to {}",
        options.out.display()
    ));
    Ok(Exit::Ok)
}

type Rows = Vec<Vec<String>>;

fn of_environment(registry: &Registry, name: &str, options: &RolloutOptions) -> Result<Rows, Failure> {
    let entry = registry
        .environments
        .get(name)
        .ok_or_else(|| unknown("environment", name, registry.environments.keys()))?;
    let mut environment = (entry.build)(&config(name, &entry.about, options.config.as_deref())?)?;
    let mut agent;
    let actions = match &options.actions {
        Some(path) => Actions::Given(rollout::read_actions(environment.seats(), path)?),
        None => {
            agent = named_agent(registry, options, &*environment)?;
            Actions::Agent {
                agent: &mut *agent,
                decisions: options.decisions,
            }
        }
    };
    Ok(rollout::rows(
        &mut *environment,
        actions,
        options.seed.unwrap_or(0),
    )?)
}

/// The agent that the options name, with its policy where one is given.
fn named_agent(
    registry: &Registry,
    options: &RolloutOptions,
    environment: &dyn Environment,
) -> Result<Box<dyn Agent>, Failure> {
    let left_by = options.policy.as_deref().map(left_by).transpose()?.flatten();
    let name = match (&options.agent, &left_by, &options.policy) {
        (Some(name), ..) => name.as_str(),
        (None, Some(part), _) => part.plugin.as_str(),
        (None, None, Some(folder)) => {
            return Err(Failure::refusal(format!(
                "`{}` does not say whose policy it holds: give `--agent`",
                folder.display()
            )));
        }
        (None, None, None) => {
            return Err(Failure::refusal(
                "give `--actions`, `--agent`, `--policy` or `--trial`",
            ));
        }
    };
    let entry = registry
        .agents
        .get(name)
        .ok_or_else(|| unknown("agent", name, registry.agents.keys()))?;
    let config = match left_by
        .as_ref()
        .filter(|part| part.plugin == name && options.agent_config.is_none())
    {
        Some(part) => part.config.whole().into_owned(),
        None => config(name, &entry.about, options.agent_config.as_deref())?,
    };
    if entry.learns_with(&config) && options.policy.is_none() {
        return Err(untrained(name));
    }
    let mut agent = build(entry, &config, environment, options)?;
    if let Some(folder) = &options.policy {
        take_up(&mut *agent, name, folder)?;
    }
    Ok(agent)
}

fn build(
    entry: &AgentEntry,
    config: &Value,
    environment: &dyn Environment,
    options: &RolloutOptions,
) -> Result<Box<dyn Agent>, Failure> {
    let streams = Streams::new("rollout", "rollout", options.seed.unwrap_or(0));
    Ok((entry.build)(
        config,
        &environment.interface(),
        &mut streams.agent("initialise"),
    )?)
}

/// The agent of the trial that left the policy in a folder, where the folder says so.
fn left_by(folder: &Path) -> Result<Option<Part>, Failure> {
    let path = folder.join("trial.json");
    let Ok(text) = fs::read(&path) else {
        return Ok(None);
    };
    let file: TrialFile = serde_json::from_slice(&text)
        .map_err(|error| Failure::refusal(format!("`{}`: {error}", path.display())))?;
    Ok(file.key.agent.agent().cloned())
}

fn take_up(agent: &mut dyn Agent, name: &str, folder: &Path) -> Result<(), Failure> {
    match agent.import(folder) {
        Ok(true) => Ok(()),
        Ok(false) => Err(Failure::refusal(format!(
            "the agent `{name}` takes up no stored policy; leave out `--policy`"
        ))),
        Err(error) => Err(Failure::refusal(format!(
            "the policy in `{}` cannot be used: {error}",
            folder.display()
        ))),
    }
}

fn of_trial(
    registry: &Registry,
    prefix: &str,
    options: &RolloutOptions,
    common: &Common,
) -> Result<Rows, Failure> {
    let store = Settings::read(&common.machine())?.open()?;
    let trial = stored(&store, prefix)?;
    let key = &trial.trial.key;
    if let Some(name) = options
        .environment
        .as_ref()
        .filter(|name| **name != key.environment.plugin)
    {
        return Err(Failure::refusal(format!(
            "trial {} is of `{}`, not of `{name}`",
            trial.trial.id, key.environment.plugin
        )));
    }
    let find = |taken: &Taken| store.product(taken);
    let Some(seed) = options.seed else {
        let mut rows = rollout::replay(&trial, options.episode.unwrap_or(0), registry, &find)?;
        rows.truncate(
            usize::try_from(options.decisions)
                .unwrap_or(usize::MAX)
                .saturating_add(2),
        );
        return Ok(rows);
    };
    let mut environment = one_trial::environment(registry, key, &find)?;
    let streams = Streams::new("rollout", "rollout", seed);
    let mut agent = rollout::trained_agent(key, registry, &environment.interface(), &streams, &find)?;
    let actions = Actions::Agent {
        agent: &mut *agent,
        decisions: options.decisions,
    };
    Ok(rollout::rows(&mut *environment, actions, seed)?)
}

/// The only trial of the store whose id begins with `prefix`, with what it recorded; it ended `ok`.
fn stored(store: &Store, prefix: &str) -> Result<TrialResult, Failure> {
    let (id, file) = one_trial::that_ended_well(store, prefix)?;
    Ok(store.load(&one_trial::named(&id, file.key).into())?)
}

fn config(name: &str, about: &About, path: Option<&Path>) -> Result<Value, Failure> {
    let part = study::load_config(name, about, path).map_err(|problems| Failure {
        exit: Exit::BadStudy,
        text: diagnostic::render_first(&problems),
    })?;
    Ok(part.config.whole().into_owned())
}

fn untrained(name: &str) -> Failure {
    Failure::refusal(format!(
        "`{name}` learns, and an untrained network is nothing to look at: give `--trial ID`, a trial of the \
         store that trained \
         one, or `--policy FOLDER`, with the policy that it left"
    ))
}

fn unknown<'a>(kind: &str, name: &str, known: impl Iterator<Item = &'a &'static str> + Clone) -> Failure {
    let nearest = diagnostic::suggest(name, known.copied());
    Failure::refusal(format!("unknown {kind} `{name}`; {nearest}"))
}
