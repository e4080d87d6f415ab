//! Figures of a suite: runs of several environments as normalised scores, pooled, as Agarwal et al. 2021 ("Deep
//! reinforcement learning at the edge of the statistical precipice", arXiv:2108.13264) show them.
//!
//! Seeds are replicates and environments are tasks. An agent without a score in one of the environments is left out and
//! named, since a different set of environments would be another suite.

mod interval_estimates;
mod performance_profile;
mod probability_of_improvement;
mod sample_efficiency;
#[cfg(test)]
pub(super) mod tests;

pub use interval_estimates::IntervalEstimates;
pub use performance_profile::PerformanceProfile;
pub use probability_of_improvement::ProbabilityOfImprovement;
pub use sample_efficiency::SampleEfficiency;

use super::{
    FigureSpec,
    build::{Context, label, problem, spaced},
    chart::Style,
};
use crate::{
    names::{Names, Picked, Place},
    table::{
        Axis, Normalisation, Scope, ScoreScale,
        normalised_scores::{PoolWording, ends_in_words, normalised},
    },
};
use contract::Error;
use statistics::Bootstrap;

/// Number of seeds below which percentile intervals are markedly too narrow.
const FEW: usize = 10;

/// Options that all figures of a suite share.
#[derive(Debug, Clone, Copy)]
struct SuiteOptions<'a> {
    metric: &'a str,
    normalise: &'a Normalisation,
    agents: &'a [String],
    environments: &'a [String],
    resamples: u32,
}

/// Implements the access to the shared options, which have the same names in every figure.
macro_rules! asked {
    ($figure:ty) => {
        impl $figure {
            fn asked(&self) -> super::SuiteOptions<'_> {
                super::SuiteOptions {
                    metric: &self.metric,
                    normalise: &self.normalise,
                    agents: &self.agents,
                    environments: &self.environments,
                    resamples: self.resamples,
                }
            }
        }
    };
}
use asked;

/// A use of a figure that has no options of its own.
const EXAMPLE: &str = "{ metric: return, normalise: { low: rule, high: learner }, agents: [learner, rule], \
                       environments: [short, long] }";

impl SuiteOptions<'_> {
    /// Checks the metric, the normalisation, and that all agents have trials in all environments.
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>) -> Picked {
        let picked = names.pick(at);
        names.metric(self.metric, at, "metric", &picked);
        let pooled = PoolWording {
            what: "a figure of normalised scores",
            instead: "`grouped_lines` shows settings one by one",
        };
        normalised(self.normalise, &pooled, names, at, &picked);
        picked
    }
}

/// The scores of all agents in the environments of a figure.
struct Suite<'a> {
    asked: SuiteOptions<'a>,
    spec: &'a FigureSpec,
    scales: Vec<ScoreScale>,
    players: Vec<Player<'a>>,
    /// Reasons for agents that are left out, a sentence each.
    left_out: Vec<String>,
}

/// An agent with its scores.
struct Player<'a> {
    name: String,
    label: String,
    style: Style,
    /// Its trials in the environments of the suite.
    scope: Scope<'a>,
    /// The final scores `[environment][seed]`.
    tasks: Vec<Vec<f64>>,
    /// Number of seeds in the environment with the fewest, and number of seeds planned.
    seeds: (usize, usize),
}

impl<'a> Suite<'a> {
    /// # Errors
    /// [`Error::Render`] if settings of a sweep would be pooled, or no agent has a score everywhere.
    fn of(asked: SuiteOptions<'a>, spec: &'a FigureSpec, context: Context<'a>) -> Result<Self, Error> {
        let all = Scope::of(context.results, &[], asked.environments);
        let scope = Scope::of(context.results, asked.agents, asked.environments);
        if scope.varies(Axis::Setting) {
            return Err(problem("normalised scores of several settings are not pooled"));
        }
        let environments = scope.names(Axis::Environment, asked.environments);
        let scale = |name| ScoreScale::of(asked.normalise, asked.metric, name, &all);
        let mut suite = Self {
            asked,
            spec,
            scales: environments.into_iter().map(scale).collect(),
            players: Vec::new(),
            left_out: Vec::new(),
        };
        for agent in scope.names(Axis::Agent, asked.agents) {
            match suite.player(&agent, &scope, context) {
                Ok(player) => suite.players.push(player),
                Err(reason) => suite.left_out.push(reason),
            }
        }
        if suite.players.is_empty() {
            return Err(problem("no agent has a score in every environment"));
        }
        Ok(suite)
    }

    /// The scores of an agent; the error is a sentence on the reason why it has none.
    fn player(&self, agent: &str, scope: &Scope<'a>, context: Context<'_>) -> Result<Player<'a>, String> {
        let (scope, label) = (scope.at(Axis::Agent, agent), label(self.spec, agent));
        let tasks: Vec<Vec<f64>> = self
            .scales
            .iter()
            .map(|scale| self.finals(&scope, scale))
            .collect();
        if let Some(at) = tasks.iter().position(Vec::is_empty) {
            let environment = super::build::label(self.spec, &self.scales[at].environment);
            return Err(format!("{label} is left out: it has no score in {environment}."));
        }
        Ok(Player {
            name: agent.into(),
            label,
            style: context.style(agent),
            seeds: (tasks.iter().map(Vec::len).min().unwrap_or(0), scope.planned()),
            scope,
            tasks,
        })
    }

    fn finals(&self, scope: &Scope<'_>, scale: &ScoreScale) -> Vec<f64> {
        let here = scope.at(Axis::Environment, &scale.environment);
        let values = here.finals(self.asked.metric).into_values();
        values.filter_map(|value| scale.score(value)).collect()
    }

    fn bootstrap(&self) -> Bootstrap {
        Bootstrap {
            resamples: self.asked.resamples,
            ..Bootstrap::CURVE
        }
    }

    /// Label of an axis of scores.
    fn score(&self) -> String {
        let metric = self.asked.metric;
        let name = self
            .spec
            .labels
            .get(metric)
            .cloned()
            .unwrap_or_else(|| spaced(metric));
        format!("normalised {name}")
    }

    /// The mean score, 0 or 1, of an agent that sets one end of the scale in every environment; `None` for others.
    fn fixed(&self, player: &Player<'_>) -> Option<u8> {
        let mut fixed = self.asked.normalise.fixed().into_iter();
        let own = |(name, _): &(&str, u8)| *name == player.name;
        fixed.find(own).map(|(_, score)| score)
    }

    /// Notes on the scores 0 and 1, on intervals, and on missing seeds and agents.
    fn notes(&self) -> Vec<String> {
        let mut notes = vec![
            ends_in_words(&self.scales, |name| label(self.spec, name)),
            format!(
                "95 % intervals are percentiles of {} resamples that draw the seeds of each environment anew; \
                 what stands for 0 and 1 is held fixed.",
                self.asked.resamples
            ),
        ];
        let fewest = self
            .players
            .iter()
            .map(|player| player.seeds.0)
            .min()
            .unwrap_or(0);
        if fewest == 1 {
            notes.push("An agent with one seed in an environment has no interval.".into());
        } else if fewest < FEW {
            notes.push(format!(
                "Such intervals are too narrow for few seeds, here {fewest}."
            ));
        }
        let incomplete = self
            .players
            .iter()
            .filter(|player| player.seeds.0 < player.seeds.1);
        notes.extend(incomplete.map(|player| {
            let (n, planned) = player.seeds;
            format!("{}: {n} of {planned} seeds in an environment.", player.label)
        }));
        notes.extend(self.left_out.iter().cloned());
        notes
    }
}

impl Player<'_> {
    /// Its name, with the number of seeds if some are missing.
    fn name_with_seeds(&self) -> String {
        match self.seeds {
            (n, planned) if n < planned => format!("{} (n = {n} of {planned})", self.label),
            _ => self.label.clone(),
        }
    }
}

fn default_metric() -> String {
    "return".into()
}

fn default_resamples() -> u32 {
    Bootstrap::CURVE.resamples
}
