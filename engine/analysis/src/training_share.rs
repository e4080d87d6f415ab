//! Training behind a result, as a share of the training behind the published number.
//!
//! A policy that learned for a hundredth of the steps of the source can show that the source's result is reached. It
//! cannot show that it is not reached: below half of the steps, a value that differs and a claim that is refuted are
//! NOT AT THIS BUDGET.

use crate::results::Results;
use contract::{
    trial::{Purpose, Trial, TrialKey},
    trial_result::TrialResult,
};
use statistics::TrainingShare;
use std::collections::BTreeSet;

/// The smallest share among some trials; `None` if the study names no budget, or none of its agents was trained in
/// them.
#[must_use]
pub fn behind(trials: &[&TrialResult], results: &Results) -> Option<TrainingShare> {
    let budget = results.paper_budget.as_ref()?;
    let counts = |name: &String| budget.agents.is_empty() || budget.agents.contains(name);
    let trained = trials.iter().flat_map(|trial| trainings(trial, results));
    let own = trained
        .filter(|(agent, _)| counts(agent))
        .map(|(_, steps)| steps)
        .min()?;
    Some(TrainingShare {
        own,
        paper: budget.steps,
    })
}

/// The agents of some trials that learned there, or in trials whose policies are played there.
#[must_use]
pub fn trained(trials: &[&TrialResult], results: &Results) -> BTreeSet<String> {
    let trained = trials.iter().flat_map(|trial| trainings(trial, results));
    trained.map(|(agent, _)| agent).collect()
}

/// The trainings behind a trial: the agent's name in the study, and its steps.
fn trainings(trial: &TrialResult, results: &Results) -> Vec<(String, u64)> {
    let Trial { cell, key, .. } = &*trial.trial;
    let own = trial.trains().then(|| steps(key)).flatten();
    let roles = key.agent.cast().into_iter().flat_map(|cast| &cast.roles);
    let played = roles.filter_map(|(role, member)| {
        let trained = trial_of(results, member.trial.as_deref()?)?;
        let agent = match &cell.purpose {
            Purpose::Play(agents) => agents.get(role)?,
            _ => &cell.agent,
        };
        Some((agent.clone(), steps(&trained.trial.key)?))
    });
    let own = own.map(|steps| (cell.agent.clone(), steps));
    own.into_iter().chain(played).collect()
}

fn trial_of<'r>(results: &'r Results, id: &str) -> Option<&'r TrialResult> {
    let mut all = results
        .prepared
        .iter()
        .chain(&results.tried)
        .chain(&results.trials);
    all.find(|trial| trial.trial.id == id)
}

/// The steps that a trial's protocol plans for learning.
fn steps(key: &TrialKey) -> Option<u64> {
    key.protocol.config.get("steps")?.as_u64()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::PaperBudget;
    use contract::{Phase, standard_metrics::UPDATES};
    use testing::synthetic::trial;

    fn learner(agent: &str, planned: u64) -> TrialResult {
        let mut it = trial(
            "field",
            agent,
            "",
            0,
            &vec![(Phase::Final, planned, 0, UPDATES, 1.0)],
        );
        let mut protocol = (*it.trial.key.protocol).clone();
        protocol.config = serde_json::json!({ "steps": planned }).into();
        it.trial_mut().key.protocol = protocol.into();
        it
    }

    #[test]
    fn the_smallest_training_of_the_agents_that_count_is_the_share() {
        let of = |agents: &[&str]| {
            let trials = vec![
                learner("a", 400),
                learner("b", 100),
                trial("field", "rule", "", 0, &Vec::new()),
            ];
            let results = Results {
                paper_budget: Some(PaperBudget {
                    steps: 1000,
                    agents: agents.iter().map(|it| (*it).to_owned()).collect(),
                }),
                ..Results::of(trials)
            };
            let all: Vec<_> = results.trials.iter().collect();
            assert_eq!(behind(&all[2..], &results), None);
            assert_eq!(trained(&all, &results), ["a", "b"].map(str::to_owned).into());
            behind(&all, &results).map(|share| share.own)
        };
        assert_eq!((of(&[]), of(&["a"]), of(&["c"])), (Some(100), Some(400), None));
    }

    #[test]
    fn half_of_the_steps_are_enough() {
        let share = |own| TrainingShare { own, paper: 1000 };
        assert!(share(499).is_too_small() && !share(500).is_too_small());
        assert_eq!(
            [4, 32, 500].map(|own| share(own).percent()),
            ["0.40 %", "3.2 %", "50 %"]
        );
        assert_eq!(
            share(32).to_string(),
            "trained for 32 of the source's 1000 steps (3.2 %)"
        );
    }
}
