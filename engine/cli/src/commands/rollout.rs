//! `regimen rollout`: runs one environment with given actions, an agent or a stored trial, and writes one CSV file.

use super::{Common, complain};
use clap::Args;
use contract::Registry;
use session::{
    Exit, Failure, Settings,
    rollout::{self, Decider, EnvironmentRollout, EpisodeChoice, TrialRollout},
};
use std::path::PathBuf;

/// The environment, the source of the actions, and the file to write.
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
    /// Name of the agent that acts, with its default config or that of `--agent-config`. One that learns needs
    /// `--policy`.
    #[arg(long, value_name = "NAME", conflicts_with = "trial")]
    agent: Option<String>,
    /// YAML file with the agent's config.
    #[arg(long, value_name = "FILE.yaml", requires = "agent")]
    agent_config: Option<PathBuf>,
    /// Folder with an exported policy. Beside the `trial.json` of the trial that left it, agent and config are taken
    /// from there.
    #[arg(long, value_name = "FOLDER", conflicts_with = "trial")]
    policy: Option<PathBuf>,
    /// A trial of the store, by the first digits of its id: its environment, agent and policy, in an episode of its
    /// final measurement (`--episode`) or a new one (`--seed`).
    #[arg(long, value_name = "ID")]
    trial: Option<String>,
    /// Number of the episode in the trial's final measurement; 0 where absent.
    #[arg(long, value_name = "N", requires = "trial", conflicts_with = "seed")]
    episode: Option<u64>,
    /// Seed of the random numbers of environment and agent; 0 where absent. With `--trial`: a new episode, not a
    /// measured one.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Maximum number of decisions of an agent.
    #[arg(long, default_value_t = 100_000)]
    decisions: u64,
    /// File to write.
    #[arg(long, value_name = "FILE.csv")]
    out: PathBuf,
}

/// Plays the episode and prints the number of decisions.
pub(super) fn rollout(
    registry: &Registry,
    options: &RolloutOptions,
    common: &Common,
) -> Result<Exit, Failure> {
    let rows = match (&options.trial, &options.environment) {
        (Some(trial), environment) => {
            let store = Settings::read(registry, &common.machine())?.open(registry)?;
            let measured = EpisodeChoice::Measured(options.episode.unwrap_or(0));
            let rollout = TrialRollout {
                trial,
                environment: environment.as_deref(),
                episode: options.seed.map_or(measured, EpisodeChoice::New),
                decisions: options.decisions,
            };
            rollout::of_trial(registry, &store, &rollout)?
        }
        (None, Some(environment)) => {
            let rollout = EnvironmentRollout {
                environment,
                config: options.config.as_deref(),
                decider: &options.decider(),
                seed: options.seed.unwrap_or(0),
                decisions: options.decisions,
            };
            rollout::of_environment(registry, &rollout)?
        }
        (None, None) => return Err(Failure::refusal("give the name of an environment or `--trial`")),
    };
    let decisions = rollout::write(&rows, &options.out)?;
    complain(&format!(
        "{decisions} decisions written to {}",
        options.out.display()
    ));
    Ok(Exit::Ok)
}

impl RolloutOptions {
    fn decider(&self) -> Decider {
        match &self.actions {
            Some(path) => Decider::File(path.clone()),
            None => Decider::Agent {
                name: self.agent.clone(),
                config: self.agent_config.clone(),
                policy: self.policy.clone(),
            },
        }
    }
}
