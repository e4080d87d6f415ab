//! Ends of the trials of a study as JSON, for programs that watch runs: counts, and trials that did not end well.

use contract::{
    trial::Trial,
    trial_end::{EndState, TrialEnd},
};
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Ends of the trials of one study.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Name of the study.
    pub study: String,
    /// Its trials with their ends; `None` where a trial has not run.
    pub trials: Vec<(Arc<Trial>, Option<TrialEnd>)>,
}

/// The word for a trial that has not run.
pub const MISSING: &str = "missing";

impl Outcome {
    /// Number of trials by end state, in the order of [`EndState`], and of those that have not run; zeros
    /// included.
    #[must_use]
    pub fn counts(&self) -> [(&'static str, usize); 8] {
        use EndState::{Failed, Killed, Nan, Ok, Oom, Panicked, Timeout};
        let states = [Ok, Failed, Panicked, Timeout, Oom, Nan, Killed]
            .map(Some)
            .into_iter()
            .chain([None]);
        let mut counts = [(MISSING, 0); 8];
        for (count, state) in counts.iter_mut().zip(states) {
            let number = self
                .trials
                .iter()
                .filter(|(_, end)| end.as_ref().map(|end| end.state) == state)
                .count();
            *count = (word(state), number);
        }
        counts
    }
}

fn word(state: Option<EndState>) -> &'static str {
    state.map_or(MISSING, EndState::name)
}

/// All studies of a command as one object: exit code, wall-clock time in seconds, and per study the counts by
/// end state and each trial that did not end `ok`, with its reason.
#[must_use]
pub fn outcomes_as_json(outcomes: &[Outcome], wall_s: f64, exit_code: u8) -> Value {
    let studies: Vec<Value> = outcomes.iter().map(study_as_json).collect();
    json!({"exit_code": exit_code, "wall_s": wall_s, "studies": studies})
}

fn study_as_json(outcome: &Outcome) -> Value {
    let counts: Map<String, Value> = outcome
        .counts()
        .into_iter()
        .map(|(word, count)| (word.to_owned(), json!(count)))
        .collect();
    let ended_well = |end: &Option<TrialEnd>| end.as_ref().is_some_and(|end| end.state == EndState::Ok);
    let not_ok: Vec<Value> = outcome
        .trials
        .iter()
        .filter(|(_, end)| !ended_well(end))
        .map(trial_as_json)
        .collect();
    json!({"study": outcome.study, "trials": outcome.trials.len(), "counts": counts, "not_ok": not_ok})
}

fn trial_as_json((trial, end): &(Arc<Trial>, Option<TrialEnd>)) -> Value {
    json!({
        "id": trial.id, "environment": trial.cell.environment, "agent": trial.cell.agent, "setting": trial.cell.point.words(),
        "seed": trial.key.seed,
        "state": word(end.as_ref().map(|end| end.state)), "reason": end.as_ref().map_or("",
        |end| &end.reason),
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use contract::{
        cast::Actors,
        part::Part,
        trial::{Combination, TrialKey},
    };

    /// A study with one trial of every end, and one that has not run.
    pub(crate) fn one_of_each() -> Outcome {
        use EndState::{Failed, Killed, Nan, Ok, Oom, Panicked, Timeout};
        let states = [Ok, Failed, Panicked, Timeout, Oom, Nan, Killed]
            .map(Some)
            .into_iter()
            .chain([None]);
        let trial = |(seed, state): (u64, Option<EndState>)| {
            let part = |plugin: &str| Part::new(plugin, 1, json!({}));
            let (environment, agent, protocol) =
                (part("battery"), part("equal_split"), part("train_evaluate"));
            let agent = Actors::Agent(agent);
            let key = TrialKey {
                environment: environment.into(),
                agent: agent.into(),
                protocol: protocol.into(),
                seed,
                numerics: 1,
            };
            let setting = if seed == 1 { "rate=0.1 note=\"<&>\"" } else { "" };
            let trial = Trial {
                id: format!("{seed:032}"),
                cell: Arc::new(Combination::of_words("four", "equal", setting).into()),
                key,
            };
            let reason = if state == Some(Ok) {
                String::new()
            } else {
                "5 < 3 & \"so on\" \u{1b}[31m]]>\u{0}\u{fffe}".into()
            };
            (
                Arc::new(trial),
                state.map(|state| TrialEnd {
                    state,
                    reason,
                    wall_s: 1.5,
                    decision_s: None,
                    device: None,
                    digest: String::new(),
                }),
            )
        };
        Outcome {
            study: "small & <odd>".into(),
            trials: (0..).zip(states).map(trial).collect(),
        }
    }

    #[test]
    fn every_state_is_counted_and_every_trial_that_is_not_ok_is_listed() {
        let json = outcomes_as_json(&[one_of_each()], 12.5, 106);
        assert_eq!((&json["exit_code"], &json["wall_s"]), (&json!(106), &json!(12.5)));
        let study = &json["studies"][0];
        assert_eq!(study["counts"].as_object().unwrap().len(), 8);
        assert!(
            study["counts"]
                .as_object()
                .unwrap()
                .values()
                .all(|count| *count == 1),
            "{study}"
        );
        let states: Vec<&str> = study["not_ok"]
            .as_array()
            .unwrap()
            .iter()
            .map(|it| it["state"].as_str().unwrap())
            .collect();
        assert_eq!(
            states,
            ["failed", "panicked", "timeout", "oom", "nan", "killed", "missing"]
        );
        assert_eq!(study["not_ok"][6]["reason"], "");
        assert!(
            study["not_ok"][0]["reason"]
                .as_str()
                .unwrap()
                .starts_with("5 < 3")
        );
    }
}
