//! Trials of a play.

use crate::synthetic::trial;
use contract::{
    Phase,
    cast::{Actors, Cast, Member},
    part::Part,
    trial::Purpose,
    trial_result::TrialResult,
};
use std::collections::BTreeMap;

/// A trial of the play `pursuit`; the agent `still` was not trained.
pub fn encounter(prey: &str, predators: &str, seed: u64, score: f64) -> TrialResult {
    let roles = BTreeMap::from(
        [("predators", predators), ("prey", prey)].map(|(role, it)| (role.to_string(), it.to_string())),
    );
    let mut result = trial(
        "pursuit",
        &format!("predators:{predators} prey:{prey}"),
        "",
        seed,
        &vec![(Phase::Final, 0, 0, "score", score)],
    );
    let member = |agent: &str| Member {
        seats: Vec::new(),
        agent: Part::new("x", 1, serde_json::Value::Null),
        trial: (agent != "still").then(|| format!("{agent}-{seed}")),
    };
    let cast = Cast {
        roles: [
            ("predators".into(), member(predators)),
            ("prey".into(), member(prey)),
        ]
        .into(),
    };
    result.trial_mut().key.agent = Actors::Cast(cast).into();
    result.trial_mut().cell_mut().purpose = Purpose::Play(roles);
    result
}

/// Trainings of `a` and `b`, whose policies the members of [`crossed`] play.
pub fn trained(n: u64) -> impl Iterator<Item = TrialResult> {
    let one = |agent: &str, seed| {
        let mut result = trial("tag", agent, "", seed, &vec![(Phase::Final, 0, 0, "score", 0.0)]);
        result.trial_mut().id = format!("{agent}-{seed}");
        result
    };
    (0..n).flat_map(move |seed| ["a", "b"].map(|agent| one(agent, seed)))
}

/// Meetings of every seed of one agent as prey with every seed of another as predators: 1 + a_i + b_j.
pub fn crossed([prey, predators]: [&str; 2], [a, b]: [&[f64]; 2]) -> Vec<TrialResult> {
    let mut meetings = Vec::new();
    for (i, x) in (0..).zip(a) {
        for (j, y) in (0..).zip(b) {
            let mut met = encounter(prey, predators, i.max(j), 1.0 + x + y);
            if let Actors::Cast(cast) = std::sync::Arc::make_mut(&mut met.trial_mut().key.agent) {
                for (role, id) in [
                    ("prey", format!("{prey}-{i}")),
                    ("predators", format!("{predators}-{j}")),
                ] {
                    cast.roles
                        .entry(role.into())
                        .and_modify(|member| member.trial = Some(id));
                }
            }
            meetings.push(met);
        }
    }
    meetings
}
