//! Pace of the trials of a study: seconds per step of an agent in an environment, from trials that ended successfully.

use contract::{
    trial::TrialCell,
    trial_end::{EndState, TrialEnd},
};
use std::collections::BTreeMap;

/// Seconds per step of agents in environments, by their names in a study.
///
/// Steps of one environment may cost a thousand times those of another, so each pair has its own pace.
#[derive(Debug, Clone, Default)]
pub struct Paces<'a> {
    /// Total seconds and steps, by agent and environment.
    sums: BTreeMap<(&'a str, &'a str), (f64, f64)>,
}

impl<'a> Paces<'a> {
    /// The paces of trials, from their numbers of steps and their ends.
    #[must_use]
    pub fn of_ended<'e>(
        trials: impl IntoIterator<Item = (&'a TrialCell, u64, Option<&'e TrialEnd>)>,
    ) -> Self {
        let mut paces = Self::default();
        for (cell, cost, end) in trials {
            if let Some(end) = end.filter(|end| end.state == EndState::Ok) {
                paces.add(cell, cost, end.wall_s);
            }
        }
        paces
    }

    /// Adds a trial of `cost` steps that took `wall_s` seconds.
    pub fn add(&mut self, cell: &'a TrialCell, cost: u64, wall_s: f64) {
        let sum = self.sums.entry((&cell.agent, &cell.environment)).or_default();
        *sum = (sum.0 + wall_s, sum.1 + steps(cost));
    }

    /// Seconds per step of this agent in this environment.
    #[must_use]
    pub fn of(&self, cell: &TrialCell) -> Option<f64> {
        self.sums
            .get(&(cell.agent.as_str(), cell.environment.as_str()))
            .map(pace)
    }

    /// Seconds per step in the environment in which this agent is slowest.
    #[must_use]
    pub fn slowest_of_agent(&self, agent: &str) -> Option<f64> {
        let of_agent = self.sums.range((agent, "")..);
        let paces = of_agent.take_while(|((name, _), _)| *name == agent);
        paces.map(|(_, sum)| pace(sum)).reduce(f64::max)
    }

    /// The largest number of seconds per step.
    #[must_use]
    pub fn slowest(&self) -> Option<f64> {
        self.sums.values().map(pace).reduce(f64::max)
    }
}

/// Number of steps by which seconds are divided: one more than the trial's own, since a trial without training still
/// has its episodes.
#[must_use]
#[allow(clippy::cast_precision_loss, reason = "an estimate")]
pub fn steps(cost: u64) -> f64 {
    cost as f64 + 1.0
}

fn pace((wall_s, steps): &(f64, f64)) -> f64 {
    wall_s / steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_pair_of_agent_and_environment_has_its_own() {
        let cells = [("cheap", "dsac"), ("dear", "dsac"), ("dear", "dsac_wide")];
        let cells = cells.map(|(environment, agent)| TrialCell::of(environment, agent));
        let end = |state, wall_s| TrialEnd {
            state,
            reason: String::new(),
            wall_s,
            decision_s: None,
            device: None,
            digest: String::new(),
        };
        let [well, dear, failed] = [
            end(EndState::Ok, 10.0),
            end(EndState::Ok, 1000.0),
            end(EndState::Nan, 9e9),
        ];
        let ended = [(0, &well), (0, &failed), (1, &dear), (1, &dear)];
        let paces = Paces::of_ended(ended.map(|(cell, end)| (&cells[cell], 99, Some(end))));
        assert_eq!(
            cells.each_ref().map(|cell| paces.of(cell)),
            [Some(0.1), Some(10.0), None]
        );
        assert_eq!(paces.slowest_of_agent("dsac"), Some(10.0));
        assert_eq!(
            (paces.slowest_of_agent("dsac_wide"), paces.slowest()),
            (None, Some(10.0))
        );
    }
}
