//! Runs one environment with given actions, a registered agent or the policy of a stored trial, and writes one row for
//! each decision.
//!
//! Columns: `decision`, the environment's trace channels, the action channels that the trace does not hold already,
//! `reward` (one per seat), `end` (`terminated`, `truncated` or empty). Row 0 is the start, if the trace has values for
//! it. If seats have names, each column of a seat begins with its name, as in `agent_0.reward`, and its observations
//! follow the rewards, as `agent_0.obs_0`, ...

mod columns;
mod given;
mod play;
mod replay;

pub use play::{Actions, rows, write};
pub use replay::trained_agent;

pub(crate) use play::episode;

use crate::{Exit, Failure, one_trial};
use contract::{
    Agent, Environment, Registry, artifact::Taken, complete_config::CompleteConfig, part::Part,
    plugin::About, random::Streams, registry::AgentEntry, trial_result::TrialResult,
};
use document::diagnostic;
use execution::{
    store::{Store, TrialFile},
    world::fs,
};
use std::path::{Path, PathBuf};

/// An episode in an environment that belongs to no trial.
pub struct EnvironmentRollout<'a> {
    /// Name of the environment.
    pub environment: &'a str,
    /// YAML file with its config; defaults where absent.
    pub config: Option<&'a Path>,
    /// The source of the actions.
    pub decider: &'a Decider,
    /// Seed of the environment's and the agent's random numbers.
    pub seed: u64,
    /// The most decisions that an agent makes.
    pub decisions: u64,
}

/// The source of the actions in an environment.
#[derive(Debug, Clone)]
pub enum Decider {
    /// A CSV file with one column per action channel and one row per decision.
    File(PathBuf),
    /// A registered agent; one that learns needs a policy.
    Agent {
        /// Its name; `None` to use the name in the `trial.json` beside the policy.
        name: Option<String>,
        /// YAML file with its config.
        config: Option<PathBuf>,
        /// Folder with an exported policy.
        policy: Option<PathBuf>,
    },
}

/// An episode of a stored trial: its environment, its agent, its policy.
pub struct TrialRollout<'a> {
    /// First digits of its id.
    pub trial: &'a str,
    /// Name of the expected environment of the trial; any where absent.
    pub environment: Option<&'a str>,
    /// The episode.
    pub episode: EpisodeChoice,
    /// Maximum number of rows for decisions.
    pub decisions: u64,
}

/// An episode of a trial.
#[derive(Debug, Clone, Copy)]
pub enum EpisodeChoice {
    /// An episode of its final measurement, by number.
    Measured(u64),
    /// A new episode, by its seed.
    New(u64),
}

/// Header and rows of a rollout.
pub type Rows = Vec<Vec<String>>;

/// Plays an episode of an environment.
///
/// # Errors
/// An unknown environment or agent, a mistake in a file, an agent that learns and has no policy.
pub fn of_environment(registry: &Registry, rollout: &EnvironmentRollout<'_>) -> Result<Rows, Failure> {
    let name = rollout.environment;
    let entry = registry
        .environments
        .get(name)
        .ok_or_else(|| unknown("environment", name, registry.environments.keys()))?;
    let mut environment = (entry.build)(&config(name, &entry.about, rollout.config)?)?;
    let mut agent;
    let actions = match rollout.decider {
        Decider::File(path) => Actions::Given(given::read_actions(environment.seats(), path)?),
        Decider::Agent { name, config, policy } => {
            let asked = AskedAgent {
                name: name.as_deref(),
                config: config.as_deref(),
                policy: policy.as_deref(),
            };
            agent = asked.build(registry, &*environment, rollout.seed)?;
            Actions::Agent {
                agent: &mut *agent,
                decisions: rollout.decisions,
            }
        }
    };
    Ok(rows(&mut *environment, actions, rollout.seed)?)
}

/// An agent as the command line names it.
struct AskedAgent<'a> {
    name: Option<&'a str>,
    config: Option<&'a Path>,
    policy: Option<&'a Path>,
}

impl AskedAgent<'_> {
    /// The agent, with its policy if one is given.
    fn build(
        &self,
        registry: &Registry,
        environment: &dyn Environment,
        seed: u64,
    ) -> Result<Box<dyn Agent>, Failure> {
        let left_by = self.policy.map(left_by).transpose()?.flatten();
        let name = self.name_or(left_by.as_ref())?;
        let entry = registry
            .agents
            .get(name)
            .ok_or_else(|| unknown("agent", name, registry.agents.keys()))?;
        let config = match left_by
            .as_ref()
            .filter(|part| part.plugin == name && self.config.is_none())
        {
            Some(part) => part.config.clone(),
            None => config(name, &entry.about, self.config)?,
        };
        if entry.learns_with(&config) && self.policy.is_none() {
            return Err(untrained(name));
        }
        let mut agent = build(entry, &config, environment, seed)?;
        if let Some(folder) = self.policy {
            take_up(&mut *agent, name, folder)?;
        }
        Ok(agent)
    }

    fn name_or<'b>(&'b self, left_by: Option<&'b Part>) -> Result<&'b str, Failure> {
        match (self.name, left_by, self.policy) {
            (Some(name), ..) => Ok(name),
            (None, Some(part), _) => Ok(&part.plugin),
            (None, None, Some(folder)) => Err(Failure::refusal(format!(
                "`{}` does not say whose policy it holds: give `--agent`",
                folder.display()
            ))),
            (None, None, None) => Err(Failure::refusal(
                "give `--actions`, `--agent`, `--policy` or `--trial`",
            )),
        }
    }
}

fn build(
    entry: &AgentEntry,
    config: &CompleteConfig,
    environment: &dyn Environment,
    seed: u64,
) -> Result<Box<dyn Agent>, Failure> {
    let streams = Streams::new("rollout", "rollout", seed);
    Ok((entry.build)(
        config,
        &environment.interface(),
        &mut streams.agent("initialise"),
    )?)
}

/// The agent of the trial that left the policy in a folder; `None` if the folder does not name it.
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

/// Plays an episode of a trial.
///
/// # Errors
/// Fails if the store holds no such trial, if the trial has another environment or plugin version, or if it left no
/// policy.
pub fn of_trial(registry: &Registry, store: &Store, rollout: &TrialRollout<'_>) -> Result<Rows, Failure> {
    let trial = stored(store, rollout.trial)?;
    let key = &trial.trial.key;
    if let Some(name) = rollout.environment.filter(|name| *name != key.environment.plugin) {
        return Err(Failure::refusal(format!(
            "trial {} is of `{}`, not of `{name}`",
            trial.trial.id, key.environment.plugin
        )));
    }
    let find = |taken: &Taken| store.artifact(taken);
    let seed = match rollout.episode {
        EpisodeChoice::Measured(episode) => {
            let mut rows = replay::replay(&trial, episode, registry, &find)?;
            let kept = usize::try_from(rollout.decisions).unwrap_or(usize::MAX);
            rows.truncate(kept.saturating_add(2));
            return Ok(rows);
        }
        EpisodeChoice::New(seed) => seed,
    };
    let mut environment = one_trial::environment(registry, key, &find)?;
    let streams = Streams::new("rollout", "rollout", seed);
    let mut agent = trained_agent(key, registry, &environment.interface(), &streams, &find)?;
    let actions = Actions::Agent {
        agent: &mut *agent,
        decisions: rollout.decisions,
    };
    Ok(rows(&mut *environment, actions, seed)?)
}

/// The only trial of the store whose id begins with `prefix`, with its record; it ended `ok`.
fn stored(store: &Store, prefix: &str) -> Result<TrialResult, Failure> {
    let (id, file) = one_trial::that_ended_well(store, prefix)?;
    Ok(store.load(&one_trial::named(&id, file.key).into())?)
}

fn config(name: &str, about: &About, path: Option<&Path>) -> Result<CompleteConfig, Failure> {
    let part = study::load_config(name, about, path).map_err(|problems| Failure {
        exit: Exit::BadStudy,
        text: diagnostic::render_first(&problems),
    })?;
    Ok(part.config)
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
