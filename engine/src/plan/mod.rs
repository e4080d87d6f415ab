//! The plan of a study: its trials, in order, and why those that are not stored are new.

mod cross_play;
mod explain;
mod leaves;
mod novelty;
#[cfg(test)]
mod tests;

pub use explain::{explain, seed_ranges, to_json};
pub use leaves::Difference;
pub use novelty::{Novelty, Reason, StoredCell, novelties};

use crate::{
    results::CellName,
    spec::Study,
    trial::{Trial, TrialKey, trial_id},
};
use std::collections::BTreeMap;

/// The kind of device that trials run on.
const DEVICE: &str = "cpu";

/// The trials of a study: environments, then agents, settings and seeds, in the order of the study, then those of its plays.
///
/// Two trials may have the same id: where a sweep does not reach an agent (a protocol's training budget and an agent that
/// does not learn), its trials stand once in each setting, and the numbers are computed once.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the study.
    pub study: String,
    /// Its heading.
    pub title: String,
    /// The trials.
    pub trials: Vec<Trial>,
}

/// How many seeds combinations of environment, agent and setting have; those that are not named have the first look's.
pub type Wanted = BTreeMap<CellName, u32>;

impl Study {
    /// The trials that the study has whatever its results are: all of them, or those of the first look.
    #[must_use]
    pub fn plan(&self) -> Plan {
        self.plan_with(&Wanted::new())
    }

    /// The trials where some combinations have come to a later look. Those of a look follow those of the one before, so that a
    /// plan that grows keeps the order of what it had.
    #[must_use]
    pub fn plan_with(&self, wanted: &Wanted) -> Plan {
        let mut plan = self.plan_of_all_seeds();
        let Some(design) = &self.design else { return plan };
        let look = |trial: &Trial| design.looks().partition_point(|most| trial.key.seed >= u64::from(*most));
        let seeds = |trial: &Trial| {
            let cell = (trial.environment.clone(), trial.agent.clone(), trial.setting.clone());
            wanted.get(&cell).copied().unwrap_or(design.looks()[0])
        };
        plan.trials.retain(|trial| trial.key.seed < u64::from(seeds(trial)));
        plan.trials.sort_by_key(look);
        plan
    }

    /// Parts are hashed once, not once per seed.
    fn plan_of_all_seeds(&self) -> Plan {
        let mut trials = Vec::with_capacity(self.cells.len() * self.seeds.len());
        for cell in &self.cells {
            let [environment, agent, protocol] = &cell.parts;
            for &seed in &self.seeds {
                let id = trial_id([&environment.id, &agent.id, &protocol.id], seed, self.numerics, DEVICE);
                let key = TrialKey {
                    environment: environment.part.clone(),
                    agent: agent.part.clone(),
                    protocol: protocol.part.clone(),
                    seed,
                    numerics: self.numerics,
                    device: DEVICE.into(),
                };
                let (environment, agent) = (self.environments[cell.environment].clone(), self.agents[cell.agent].clone());
                trials.push(Trial { id, environment, agent, setting: cell.setting.clone(), point: cell.point.clone(), key });
            }
        }
        let plays: Vec<Trial> = self.plays.iter().flat_map(|play| cross_play::trials(self, play, &trials)).collect();
        trials.extend(plays);
        Plan { study: self.name.clone(), title: self.title.clone(), trials }
    }
}
