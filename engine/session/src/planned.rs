//! A study with its trials.

use analysis::{results::SearchResult, search::Proposals};
use contract::{
    Registry,
    complete_config::CompleteConfig,
    trial::{Combination, Trial, TrialKey},
    trial_result::TrialResult,
};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
    sync::Arc,
};
use study::{
    Study,
    plan::{Plan, Wanted},
};

/// A study that passed its checks, and its trials.
pub struct Planned {
    /// Its file.
    pub path: PathBuf,
    /// The study.
    pub study: Study,
    /// Its trials, narrowed by `--only`.
    pub plan: Plan,
    /// Steps of every trial, for progress and estimates.
    pub costs: Vec<u64>,
    /// The combinations that have reached a later look, with their numbers of seeds.
    pub(crate) wanted: Wanted,
    /// Number of open verdicts of claims and published values; `None` if they were not evaluated.
    pub(crate) open: Option<usize>,
    /// Steps at which searches pause trials, by id.
    pub(crate) pauses: BTreeMap<String, u64>,
    /// Trials of searches that have reached their pause; none of them is missing.
    pub paused: Vec<Arc<Trial>>,
    set_aside: BTreeSet<String>,
    /// The confirmation that it is; `None` for an ordinary study.
    pub(crate) confirms: Option<Confirms>,
    /// The results of the searches.
    pub searched: Vec<SearchResult>,
    /// The latest proposals of each search, by name.
    pub(crate) proposals: BTreeMap<String, Proposals>,
    /// Records of tried settings that ended `ok`, which do not change, by the id of the trial.
    pub(crate) recorded: BTreeMap<String, TrialResult>,
    /// The options with which it was read.
    pub(crate) options: study::Options,
    /// Names of environments and agents whose trials are selected; all where empty.
    pub(crate) only: Vec<String>,
}

impl Planned {
    /// True for a confirmation of the study before it.
    #[must_use]
    pub fn is_confirmation(&self) -> bool {
        self.confirms.is_some()
    }

    /// A study that is not planned yet.
    pub(crate) fn of(path: &Path, study: Study, options: study::Options, only: &[String]) -> Self {
        Self {
            path: path.to_owned(),
            plan: Plan {
                study: study.name.clone(),
                title: study.title.clone(),
                trials: Vec::new(),
            },
            study,
            costs: Vec::new(),
            wanted: Wanted::new(),
            open: None,
            pauses: BTreeMap::new(),
            paused: Vec::new(),
            set_aside: BTreeSet::new(),
            confirms: None,
            searched: Vec::new(),
            proposals: BTreeMap::new(),
            recorded: BTreeMap::new(),
            options,
            only: only.to_vec(),
        }
    }

    /// Plans the study again, with other numbers of seeds.
    pub(crate) fn replan(&mut self, registry: &Registry, wanted: Wanted) {
        self.plan = self.study.plan_with(&wanted);
        self.wanted = wanted;
        if let Some(confirms) = &self.confirms {
            self.plan
                .keep(|trial| confirms.cells.contains(&trial.cell.combination));
        }
        narrow(&mut self.plan, &self.study, &self.only);
        self.pauses = self.study.pauses(&self.plan);
        let has_paused = |trial: &mut Arc<Trial>| {
            self.set_aside.contains(&trial.id) && self.pauses.contains_key(&trial.id)
        };
        self.paused = self.plan.trials.extract_if(.., has_paused).collect();
        self.costs = costs(registry, &self.plan);
    }

    /// Removes trials that have reached their pause from the plan.
    pub(crate) fn set_aside(&mut self, registry: &Registry, paused: BTreeSet<String>) {
        if paused != self.set_aside {
            self.set_aside = paused;
            let wanted = std::mem::take(&mut self.wanted);
            self.replan(registry, wanted);
        }
    }
}

/// The place of a confirmation in its study.
pub(crate) struct Confirms {
    /// Its index among the confirmations of the study.
    pub(crate) index: usize,
    /// The combinations behind the confirmed claims and values.
    pub(crate) cells: BTreeSet<Combination>,
}

/// Keeps the trials of the named environments and agents, and the trials that they take from; all if no name is given.
fn narrow(plan: &mut Plan, study: &Study, only: &[String]) {
    if only.is_empty() {
        return;
    }
    let named = |name: &String| only.contains(name);
    let trials = || plan.trials.iter().map(|trial| &trial.cell);
    // An agent that is searched has no trial in most environments before its setting is chosen.
    let by_environment =
        study.environments.iter().any(named) || trials().any(|cell| named(&cell.environment));
    let by_agent = study.agents.iter().any(named) || trials().any(|cell| named(&cell.agent));
    plan.keep(|trial| {
        let known = by_environment || by_agent;
        known
            // A search compares settings in its own environment for all others.
            && (!by_environment || trial.cell.purpose.is_tried() || named(&trial.cell.environment))
            && (!by_agent || named(&trial.cell.agent))
    });
}

/// Steps of every trial. Neighbours in a plan usually share their protocol, so few protocols are built.
pub(crate) fn costs(registry: &Registry, plan: &Plan) -> Vec<u64> {
    let mut known: Option<(&CompleteConfig, u64)> = None;
    let mut costs = Vec::with_capacity(plan.trials.len());
    for trial in &plan.trials {
        let config = &trial.key.protocol.config;
        let steps = match known {
            Some((same, steps)) if same.is_same(config) => steps,
            _ => total_steps(registry, &trial.key).unwrap_or(0),
        };
        known = Some((config, steps));
        costs.push(steps);
    }
    costs
}

/// Total steps of a trial; `None` for a protocol that this program does not know.
pub(crate) fn total_steps(registry: &Registry, key: &TrialKey) -> Option<u64> {
    let entry = registry.protocols.get(key.protocol.plugin.as_str())?;
    let protocol = (entry.build)(&key.protocol.config).ok()?;
    Some(protocol.total_steps())
}
