//! Every seat acts uniformly at random in its space: the least informed policy, a floor for comparisons.
//!
//! An entry of a box is uniform between its limits, shares are uniform on the simplex (see
//! [`random_allocation`]), and choices are uniform among their options. The agent draws in both modes, learns
//! nothing and records nothing. Under the protocol `search` it is random search.
//!
//! [`random_allocation`]: crate::random_allocation

use crate::shared::{allocation::uniform_shares, designs::random_design, seat::mismatch};
use contract::{
    Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Registry, Rng, Space, choice,
};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "random_action";

/// No parameters.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {}

impl contract::Config for Config {}

/// Uniformly random actions for every seat.
#[derive(Debug, Clone)]
pub struct RandomAction {
    spaces: Vec<Space>,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "every seat acts uniformly at random";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

/// Builds the policy for any number of seats.
///
/// # Errors
/// [`Error::Mismatch`] where a channel of an action has no limits to draw between.
fn build(_: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    for seat in &interface.seats {
        let Space::Box(channels) = &seat.action else {
            continue;
        };
        if let Some(open) = channels
            .iter()
            .find(|channel| !(channel.low.is_finite() && channel.high.is_finite()))
        {
            return Err(mismatch(
                NAME,
                format!("it draws between limits, and `{}` has none", open.name),
            ));
        }
    }
    Ok(Box::new(RandomAction {
        spaces: interface.seats.iter().map(|seat| seat.action.clone()).collect(),
    }))
}

impl Agent for RandomAction {
    fn act(&mut self, observations: &[Observation], _: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        let mut row = |_| self.spaces.iter().map(|space| draw(space, rng)).collect();
        Ok(observations.iter().map(&mut row).collect())
    }
}

fn draw(space: &Space, rng: &mut Rng) -> Vec<f64> {
    match space {
        Space::Box(channels) => channels
            .iter()
            .map(|channel| rng.random_range(channel.low..=channel.high))
            .collect(),
        Space::Simplex(names) => uniform_shares(names.len(), rng),
        // `u32`: the width of `usize` depends on the machine and would change the stream.
        #[allow(clippy::cast_possible_truncation, reason = "nobody names 2^32 choices")]
        Space::Discrete(names) => vec![f64::from(rng.random_range(0..names.len() as u32))],
        Space::Choices(choices) => choice::vector(choices, &random_design(choices, rng)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::{Channel, Seat};

    fn interface(actions: Vec<Space>) -> Interface {
        let seat = |action| Seat {
            name: String::new(),
            observation: Space::Box(Vec::new()),
            action,
        };
        Interface {
            seats: actions.into_iter().map(seat).collect(),
            state: Vec::new(),
        }
    }

    #[test]
    fn every_kind_of_space_is_drawn_from_uniformly() {
        let force = Space::Box(vec![Channel::new("force", "").within(-1.0, 3.0)]);
        let names = |n: usize| (0..n).map(|i| format!("entry_{i}")).collect::<Vec<_>>();
        let interface = interface(vec![force, Space::Simplex(names(4)), Space::Discrete(names(3))]);
        let mut rng = contract::random::stream(&["uniform"]);
        let mut agent = build(Config {}, &interface, &mut rng).unwrap();
        let actions = agent
            .act(&vec![Observation::default(); 20_000], Mode::Evaluate, &mut rng)
            .unwrap();
        let mean = |seat: usize, power: i32| {
            actions
                .iter()
                .map(|action| action[seat][0].powi(power))
                .sum::<f64>()
                / 20_000.0
        };
        // U(-1, 3): mean 1, second moment 7/3; a share of four: 1/4; a choice of 0, 1, 2: mean 1, second
        // moment 5/3.
        assert!((mean(0, 1) - 1.0).abs() < 0.04 && (mean(0, 2) - 7.0 / 3.0).abs() < 0.08);
        assert!((mean(1, 1) - 0.25).abs() < 0.005);
        assert!((mean(2, 1) - 1.0).abs() < 0.03 && (mean(2, 2) - 5.0 / 3.0).abs() < 0.06);
        assert!(actions.iter().all(|action| (-1.0..=3.0).contains(&action[0][0])));
    }

    #[test]
    fn a_box_without_limits_is_refused() {
        let mut rng = contract::random::stream(&[]);
        let open = interface(vec![Space::Box(vec![Channel::new("force", "")])]);
        assert!(
            build(Config {}, &open, &mut rng)
                .err()
                .unwrap()
                .to_string()
                .contains("`force` has none")
        );
    }
}
