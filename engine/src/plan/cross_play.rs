//! The trials of plays: every combination of agents over roles and every seed, after the trials that train
//! them.

use super::DEVICE;
use crate::{
    cast::{Cast, Member, Seating},
    cross_play::title,
    setting::Setting,
    spec::{Play, Player, Study},
    trial::{Purpose, Trial, TrialKey},
};
use std::collections::BTreeMap;

/// The trials of one play; `trained` are those of the study's cells, seed after seed of each.
pub(super) fn trials(study: &Study, play: &Play, trained: &[Vec<Trial>]) -> Vec<Trial> {
    let mut trials = Vec::new();
    for players in play.combinations() {
        let named = play.roles.iter().zip(&players);
        let roles: BTreeMap<String, String> = named
            .map(|((role, _), player)| (role.clone(), player.name.clone()))
            .collect();
        for (at, &seed) in study.seeds.iter().enumerate() {
            let member = |((role, seats), player): (&(String, Vec<String>), &&Player)| {
                Some((
                    role.clone(),
                    member(seats.clone(), player, &trained[player.cell][at])?,
                ))
            };
            let cast = Cast {
                roles: play.roles.iter().zip(&players).filter_map(member).collect(),
            };
            let key = TrialKey {
                environment: play.arena.clone(),
                agent: Seating::Cast(cast),
                protocol: play.protocol.clone(),
                seed,
                numerics: study.numerics,
                device: DEVICE.into(),
            };
            let (environment, agent, purpose) =
                (play.name.clone(), title(&roles), Purpose::Play(roles.clone()));
            let (setting, point) = (String::new(), Setting::default());
            trials.push(Trial {
                id: key.id(),
                environment,
                agent,
                setting,
                point,
                purpose,
                key,
            });
        }
    }
    trials
}

/// One who plays with the policy of the trial `source`; `None` for a cast, which a play refuses.
fn member(seats: Vec<String>, player: &Player, source: &Trial) -> Option<Member> {
    let agent = source.key.agent.agent()?.clone();
    Some(Member {
        seats,
        agent,
        trial: player.learns.then(|| source.id.clone()),
    })
}
