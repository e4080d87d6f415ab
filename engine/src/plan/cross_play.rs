//! The trials of plays: every combination of agents over roles and every seed, after the trials that train them.

use super::DEVICE;
use crate::{
    cross_play::{Cast, Member, title},
    setting::Setting,
    spec::{Play, Player, Study},
    trial::{Trial, TrialKey},
};

/// The trials of one play; `trained` are those of the study's cells, seed after seed of each.
pub(super) fn trials(study: &Study, play: &Play, trained: &[Trial]) -> Vec<Trial> {
    let mut trials = Vec::new();
    for players in play.combinations() {
        let agent = title(play.roles.iter().zip(&players).map(|((role, _), player)| (role.as_str(), player.name.as_str())));
        for (at, &seed) in study.seeds.iter().enumerate() {
            let source = |player: &Player| &trained[player.cell * study.seeds.len() + at];
            let member = |((role, seats), player): (&(String, Vec<String>), &&Player)| {
                let source = source(player);
                let trial = player.learns.then(|| source.id.clone());
                (role.clone(), Member { seats: seats.clone(), agent: source.key.agent.clone(), trial })
            };
            let cast = Cast { roles: play.roles.iter().zip(&players).map(member).collect() };
            let key = TrialKey {
                environment: play.arena.clone(),
                agent: cast.part(),
                protocol: play.protocol.part(),
                seed,
                numerics: study.numerics,
                device: DEVICE.into(),
            };
            let (environment, agent, setting) = (play.name.clone(), agent.clone(), String::new());
            trials.push(Trial { id: key.id(), environment, agent, setting, point: Setting::default(), key });
        }
    }
    trials
}
