//! Layout of the vectors of an episode: the entries of all seats, one seat after the other.

use super::Episode;
use crate::{Error, Interface, Observation, Seat, Space, Transition};

/// Layout of the vectors of a dataset's episodes.
#[derive(Debug)]
pub(super) struct Layout<'a> {
    interface: &'a Interface,
    /// Whether all seats observe a choice, and whether they make one.
    pub(super) sees_choices: bool,
    pub(super) makes_choices: bool,
}

impl<'a> Layout<'a> {
    /// Layout of an environment.
    ///
    /// # Errors
    /// [`Error::MixedSeats`] if some seats choose and others do not.
    pub(super) fn of(interface: &'a Interface) -> Result<Self, Error> {
        let choices = |what: &'static str, space: fn(&Seat) -> &Space| {
            let mut are = interface
                .seats
                .iter()
                .map(|seat| matches!(space(seat), Space::Discrete(_)));
            let first = are.next().ok_or(Error::NoSeats)?;
            if are.all(|other| other == first) {
                Ok(first)
            } else {
                Err(Error::MixedSeats { what })
            }
        };
        Ok(Self {
            interface,
            sees_choices: choices("observations", |seat| &seat.observation)?,
            makes_choices: choices("actions", |seat| &seat.action)?,
        })
    }

    pub(super) fn seats(&self) -> &'a [Seat] {
        &self.interface.seats
    }

    /// Whether the rewards of each seat, and the full state, are kept.
    pub(super) fn is_of_several(&self) -> bool {
        self.seats().len() > 1
    }

    /// Number of entries of the full state that are kept.
    pub(super) fn n_state(&self) -> usize {
        if self.is_of_several() {
            self.interface.state.len()
        } else {
            0
        }
    }

    pub(super) fn observations(&self) -> Vec<&'a Space> {
        self.seats().iter().map(|seat| &seat.observation).collect()
    }

    pub(super) fn actions(&self) -> Vec<&'a Space> {
        self.seats().iter().map(|seat| &seat.action).collect()
    }

    /// The decisions of an episode that fits, in order.
    pub(super) fn transitions(&self, episode: &Episode) -> Vec<Transition> {
        let (observations, actions) = (self.observations(), self.actions());
        let observe = |at: usize| Observation {
            seats: split(&episode.observations[at], &observations),
            state: episode.states.get(at).cloned().unwrap_or_default(),
        };
        let last = episode.actions.len().saturating_sub(1);
        let rewards = episode.rewards.chunks(self.seats().len());
        let decisions = episode.actions.iter().zip(rewards).enumerate();
        decisions
            .map(|(at, (action, rewards))| Transition {
                observation: observe(at),
                action: split(action, &actions),
                rewards: rewards.to_vec(),
                next_observation: observe(at + 1),
                end: (at == last).then_some(episode.end),
            })
            .collect()
    }

    /// The fault in the lengths of an episode; `None` if they fit.
    pub(super) fn misfit(&self, episode: &Episode) -> Option<String> {
        let n = episode.actions.len();
        if n == 0 {
            return Some("an episode has no decision".into());
        }
        if episode.observations.len() != n + 1 || episode.rewards.len() != n * self.seats().len() {
            let (seen, earned) = (episode.observations.len(), episode.rewards.len());
            return Some(format!(
                "{n} decisions have {seen} observations and {earned} rewards"
            ));
        }
        let states = if self.n_state() == 0 { 0 } else { n + 1 };
        if episode.states.len() != states {
            let found = episode.states.len();
            return Some(format!("{n} decisions have {found} states instead of {states}"));
        }
        let of_other_length = |what: &str, vectors: &[Vec<f64>], expected: usize| {
            let wrong = vectors.iter().find(|vector| vector.len() != expected)?;
            Some(format!(
                "{what} has {} entries instead of {expected}",
                wrong.len()
            ))
        };
        of_other_length(
            "an observation",
            &episode.observations,
            length(&self.observations()),
        )
        .or_else(|| of_other_length("an action", &episode.actions, length(&self.actions())))
        .or_else(|| of_other_length("a state", &episode.states, self.n_state()))
    }
}

/// Entries of a vector of these spaces.
pub(super) fn length(spaces: &[&Space]) -> usize {
    spaces.iter().map(|space| space.len()).sum()
}

/// The part of a vector for each space.
fn split(vector: &[f64], spaces: &[&Space]) -> Vec<Vec<f64>> {
    let mut rest = vector;
    let take = |space: &&Space| {
        let (own, others) = rest.split_at(space.len());
        rest = others;
        own.to_vec()
    };
    spaces.iter().map(take).collect()
}
