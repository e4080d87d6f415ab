//! The trials behind a cell or a line, and the value of each seed.

use super::{Axis, MissingReason, MissingSeeds};
use crate::axis::listed_first;
use analysis::results::Results;
use contract::{
    Phase, standard_metrics::UPDATES, trial::Purpose, trial_end::EndState, trial_result::TrialResult,
};
use std::collections::BTreeMap;

/// Trials that share an agent, an environment or a setting.
#[derive(Debug, Clone)]
pub struct Scope<'a> {
    /// The trials, in the order of the plan.
    pub trials: Vec<&'a TrialResult>,
}

impl<'a> Scope<'a> {
    /// The trials of some agents and environments, without those of cross-play; an empty list stands for all.
    #[must_use]
    pub fn of(results: &'a Results, agents: &[String], environments: &[String]) -> Self {
        let listed = |list: &[String], name: &str| list.is_empty() || list.iter().any(|item| item == name);
        let wanted = |trial: &&TrialResult| {
            listed(agents, &trial.trial.cell.agent) && listed(environments, &trial.trial.cell.environment)
        };
        let usual =
            |trial: &&TrialResult| matches!(trial.trial.cell.purpose, Purpose::Cell | Purpose::Imported);
        Self {
            trials: results.trials.iter().filter(usual).filter(wanted).collect(),
        }
    }

    /// The trials at one place on an axis.
    #[must_use]
    pub fn at(&self, axis: Axis, name: &str) -> Self {
        Self {
            trials: self
                .trials
                .iter()
                .copied()
                .filter(|trial| axis.of(trial) == name)
                .collect(),
        }
    }

    /// The trials of seeds below a number.
    #[must_use]
    pub fn until(&self, limit: u64) -> Self {
        let is_early = |trial: &&&TrialResult| trial.trial.key.seed < limit;
        Self {
            trials: self.trials.iter().filter(is_early).copied().collect(),
        }
    }

    /// The names along an axis: first the listed ones, then the others in the order of the plan.
    #[must_use]
    pub fn names(&self, axis: Axis, listed: &[String]) -> Vec<String> {
        listed_first(listed, self.trials.iter().map(|trial| axis.of(trial)))
    }

    /// Whether the trials differ along an axis.
    #[must_use]
    pub fn varies(&self, axis: Axis) -> bool {
        self.names(axis, &[]).len() > 1
    }

    /// Number of seeds planned.
    #[must_use]
    pub fn planned(&self) -> usize {
        self.trials
            .iter()
            .map(|trial| trial.trial.key.seed)
            .collect::<std::collections::BTreeSet<_>>()
            .len()
    }

    /// Whether the agent learns; rules and bounds record neither updates nor steps of their own.
    #[must_use]
    pub fn learns(&self) -> bool {
        self.trials.iter().any(|trial| trial.trains())
    }

    /// Whether other programs made the runs.
    #[must_use]
    pub fn is_imported(&self) -> bool {
        self.trials.iter().any(|trial| trial.is_imported())
    }

    /// Environment steps and updates of an agent that learns, as in `240000 steps, 15000 updates`; `None` for other
    /// agents.
    #[must_use]
    pub fn budget(&self) -> Option<String> {
        let updates = ends(self.trials.iter().filter_map(|trial| trial.updates()).collect())?;
        let steps = self
            .trials
            .iter()
            .flat_map(|trial| trial.select(Phase::Final, UPDATES))
            .map(|row| row.step);
        #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
        let steps = ends(steps.map(|step| step as f64).collect())?;
        Some(format!("{steps} steps, {updates} updates"))
    }

    /// The final value of each seed: the mean over its episodes.
    #[must_use]
    pub fn finals(&self, metric: &str) -> BTreeMap<u64, f64> {
        let value = |trial: &&TrialResult| Some((trial.trial.key.seed, trial.mean(Phase::Final, metric)?));
        self.trials
            .iter()
            .filter(|trial| trial.is_ok())
            .filter_map(value)
            .collect()
    }

    /// Number of trials that ended unsuccessfully.
    #[must_use]
    pub fn failed(&self) -> usize {
        self.trials
            .iter()
            .filter(|trial| trial.end.is_some() && !trial.is_ok())
            .count()
    }

    /// Reasons for trials without a number, each with its count: first end states, then trials that have not run.
    #[must_use]
    pub fn absences(&self) -> Vec<MissingSeeds> {
        let mut ended: BTreeMap<&'static str, (usize, EndState)> = BTreeMap::new();
        for end in self
            .trials
            .iter()
            .filter(|trial| !trial.is_ok())
            .filter_map(|trial| trial.end.as_ref())
        {
            // `failed` is listed before failures with a name.
            let name = if end.state == EndState::Failed {
                ""
            } else {
                end.state.name()
            };
            ended.entry(name).or_insert((0, end.state)).0 += 1;
        }
        let unrun = self.trials.iter().filter(|trial| trial.end.is_none()).count();
        let ended = ended
            .into_values()
            .map(|(count, state)| MissingReason::Ended(count, state));
        ended
            .chain((unrun > 0).then_some(MissingReason::NotRun(unrun)))
            .map(MissingSeeds::of)
            .collect()
    }
}

/// The smallest and largest of some numbers, as one if they are equal; `None` if there is none.
fn ends(numbers: Vec<f64>) -> Option<String> {
    let (low, high) = (
        numbers.iter().copied().reduce(f64::min)?,
        numbers.into_iter().reduce(f64::max)?,
    );
    Some(if low == high {
        format!("{low}")
    } else {
        format!("{low} to {high}")
    })
}
