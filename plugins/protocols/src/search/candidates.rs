//! The designs that a search tried, and an agent that builds one of them again.

use super::DesignValue;
use contract::{
    Action, Agent, Error, Metric, Mode, Observation, Phase, Rng, Space, Updates,
    dataset::Episode,
    design::{Design, Designs, in_words},
    exact,
    protocol::Run,
    standard_metrics::EPISODE_LENGTH,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Number of designs that a trial leaves for others.
const KEPT: usize = 10;

/// A design that was tried.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Candidate {
    /// Observations, actions and rewards.
    pub(super) episode: Episode,
    /// Sum of the rewards.
    #[serde(with = "exact")]
    pub(super) observed_return: f64,
    /// The environment's metrics, each reduced over the episode.
    #[serde(with = "exact")]
    pub(super) metrics: Vec<f64>,
    /// Whether the design is complete; false if the agent gave it up before its end.
    pub(super) whole: bool,
}

impl Candidate {
    /// Records the return and the metrics, their names with `prefix`.
    pub(super) fn record(
        &self,
        run: &mut Run<'_>,
        phase: Phase,
        step: u64,
        metrics: &[Metric],
        prefix: &str,
    ) {
        let mut add = |name: &str, value: f64| {
            run.record
                .add(phase, step, 0, 0, &format!("{prefix}{name}"), value);
        };
        add("return", self.observed_return);
        for (metric, value) in metrics.iter().zip(&self.metrics) {
            add(&metric.name, *value);
        }
        if prefix.is_empty() {
            #[allow(
                clippy::cast_precision_loss,
                reason = "a design has far fewer than 2^52 steps"
            )]
            add(EPISODE_LENGTH, self.episode.actions.len() as f64);
        }
    }
}

/// All designs that were tried, in order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Candidates(Vec<Candidate>);

impl Candidates {
    pub(super) fn add(&mut self, candidate: Candidate) {
        self.0.push(candidate);
    }

    pub(super) fn all(&self) -> &[Candidate] {
        &self.0
    }

    /// The best complete design among the last ones, by its observed value; the first of equals.
    pub(super) fn best_of_last(&self, share: f64, design_value: &DesignValue) -> Option<&Candidate> {
        #[allow(
            clippy::cast_precision_loss,
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a count is a count"
        )]
        let last = (self.0.len() as f64 * share).ceil() as usize;
        let from = self.0.len() - last.min(self.0.len());
        self.ranked(from, design_value)
            .into_iter()
            .map(|(_, candidate)| candidate)
            .next()
    }

    /// Complete designs from number `from` on, the best first.
    fn ranked(&self, from: usize, design_value: &DesignValue) -> Vec<(usize, &Candidate)> {
        let whole = self.0.iter().enumerate().skip(from);
        let mut whole: Vec<_> = whole.filter(|(_, candidate)| candidate.whole).collect();
        whole.sort_by(|(_, one), (_, other)| design_value.compare(other, one));
        whole
    }

    /// The best designs, no two of which have the same options.
    ///
    /// # Errors
    /// [`Error::Action`] for an action outside this space.
    pub(super) fn best(&self, design_value: &DesignValue, space: &Space) -> Result<Designs, Error> {
        let mut designs: Vec<Design> = Vec::new();
        for (number, candidate) in self.ranked(0, design_value) {
            let actions = candidate.episode.actions.clone();
            let options = in_words(space, &actions)?;
            let alike = |known: &Design| {
                if options.is_empty() {
                    known.actions == actions
                } else {
                    known.options == options
                }
            };
            if designs.len() < KEPT && !designs.iter().any(alike) {
                designs.push(Design {
                    candidate: number as u64,
                    observed_return: candidate.observed_return,
                    chosen_by: design_value.observed(candidate),
                    actions,
                    options,
                });
            }
        }
        Ok(Designs { designs })
    }
}

/// Builds a given design independent of its observations; for everything else it is the agent that searched.
pub(super) struct DesignReplay {
    agent: Box<dyn Agent>,
    actions: Vec<Vec<f64>>,
    at: usize,
}

impl DesignReplay {
    pub(super) fn new(agent: Box<dyn Agent>, actions: Vec<Vec<f64>>) -> Self {
        Self {
            agent,
            actions,
            at: 0,
        }
    }
}

impl Agent for DesignReplay {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        let action = self.actions.get(self.at).cloned().ok_or_else(|| Error::Action {
            problem: format!("the design has {} steps and no more", self.actions.len()),
        })?;
        self.at += 1;
        Ok(vec![vec![action]; observations.len()])
    }

    fn remembers(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.at = 0;
    }

    fn updates(&self) -> Option<Updates> {
        self.agent.updates()
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        self.agent.save(dir)
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        self.agent.load(dir)
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        self.agent.export(dir)
    }
}

/// Replaces the agent while [`DesignReplay`] owns it.
pub(super) struct PlaceholderAgent;

impl Agent for PlaceholderAgent {
    fn act(&mut self, _: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(Vec::new())
    }
}
