//! The trials of plays: every combination of agents over roles for every seed, after the trials that train the agents.

use super::TrialsByCell;
use crate::checked_study::Study;
use analysis::cross_play::title;
use contract::{
    cast::{Actors, Cast, Member},
    trial::{Purpose, Trial, TrialCell, TrialKey},
};
use presentation::vocabulary::{Pairs, Play, Player};
use std::{collections::BTreeMap, sync::Arc};

/// The trials of one play; `trained` are those of the study's cells, with the seeds of each in order.
pub(super) fn trials(study: &Study, play: &Play, trained: &TrialsByCell) -> Vec<Arc<Trial>> {
    let mut trials = Vec::new();
    for players in play.combinations() {
        for places in meetings(play.pairs, &players, study.seeds.len()) {
            trials.push(Arc::new(encounter(study, play, &players, &places, trained)));
        }
    }
    trials
}

/// Combinations of the study's seeds that meet, as one place in their list for each role. An agent that was not trained
/// is the same for every seed, and takes part in each meeting once.
fn meetings(pairs: Pairs, players: &[&Player], n_seeds: usize) -> Vec<Vec<usize>> {
    let matched = |at: usize| vec![at; players.len()];
    let trained: Vec<usize> = (0..players.len()).filter(|role| players[*role].learns).collect();
    if pairs == Pairs::Matched || trained.len() < 2 {
        return (0..n_seeds).map(matched).collect();
    }
    let mut all = vec![matched(0)];
    for role in trained {
        let with = |places: Vec<usize>, at: usize| {
            let place = |other: usize, it: usize| if other == role { at } else { it };
            places
                .iter()
                .enumerate()
                .map(|(other, it)| place(other, *it))
                .collect()
        };
        all = all
            .into_iter()
            .flat_map(|places| (0..n_seeds).map(move |at| with(places.clone(), at)))
            .collect();
    }
    all
}

/// One meeting. Its own seed is the latest of those that meet, so that a study that stops at some number of seeds
/// includes every meeting among them.
fn encounter(
    study: &Study,
    play: &Play,
    players: &[&Player],
    places: &[usize],
    trained: &TrialsByCell,
) -> Trial {
    let of_role = || play.roles.iter().zip(players);
    let roles: BTreeMap<String, String> = of_role()
        .map(|((role, _), player)| (role.clone(), player.name.clone()))
        .collect();
    let members = of_role().zip(places).filter_map(|(((role, seats), player), at)| {
        let member = member(seats.clone(), player, &trained[&player.cell][*at])?;
        Some((role.clone(), member))
    });
    let latest = places.iter().copied().max().unwrap_or_default();
    let key = TrialKey {
        environment: play.arena.clone().into(),
        agent: Actors::Cast(Cast {
            roles: members.collect(),
        })
        .into(),
        protocol: play.protocol.clone().into(),
        seed: study.seeds[latest],
        numerics: study.numerics,
    };
    Trial {
        id: key.id(),
        cell: TrialCell {
            combination: TrialCell::of(&play.name, title(&roles)).combination,
            purpose: Purpose::Play(roles),
        }
        .into(),
        key,
    }
}

/// A player with the policy of the trial `source`; `None` for a cast, which a play refuses.
fn member(seats: Vec<String>, player: &Player, source: &Trial) -> Option<Member> {
    let agent = source.key.agent.agent()?.clone();
    Some(Member {
        seats,
        agent,
        trial: player.learns.then(|| source.id.clone()),
    })
}
