//! Every seat does nothing: all entries of all actions are 0, a floor for comparisons.
//!
//! The agent observes nothing, learns nothing and records nothing.

use crate::shared::seat::mismatch;
use contract::{Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Registry, Rng, Seat, Space};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "zero_action";

/// No parameters.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {}

impl contract::Config for Config {}

/// Zero actions for every seat.
#[derive(Debug, Clone)]
pub struct ZeroAction {
    action: Action,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    registry.agent(
        NAME,
        version,
        "every seat does nothing",
        AgentTraits::default(),
        build,
    );
}

/// Builds the policy for any number of seats that act in boxes.
///
/// # Errors
/// [`Error::Mismatch`] where 0 is no action of a seat.
fn build(_: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let action = interface.seats.iter().map(zeros).collect::<Result<_, _>>()?;
    Ok(Box::new(ZeroAction { action }))
}

fn zeros(seat: &Seat) -> Result<Vec<f64>, Error> {
    let Space::Box(channels) = &seat.action else {
        return Err(mismatch(
            NAME,
            "it does nothing, which only actions in a box allow",
        ));
    };
    match channels
        .iter()
        .find(|channel| channel.low > 0.0 || channel.high < 0.0)
    {
        Some(channel) => Err(mismatch(
            NAME,
            format!("0 lies outside the limits of `{}`", channel.name),
        )),
        None => Ok(vec![0.0; channels.len()]),
    }
}

impl Agent for ZeroAction {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(vec![self.action.clone(); observations.len()])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::seat::tests::allocation;
    use contract::Channel;

    fn agent(channel: Channel) -> Result<Box<dyn Agent>, Error> {
        let action = Space::Box(vec![channel.clone(), channel]);
        let seat = Seat {
            name: String::new(),
            observation: Space::Box(Vec::new()),
            action,
        };
        build(
            Config {},
            &Interface {
                seats: vec![seat.clone(), seat],
                state: Vec::new(),
            },
            &mut contract::random::stream(&[]),
        )
    }

    #[test]
    fn all_seats_of_all_rows_rest() {
        let mut agent = agent(Channel::new("force", "").within(-1.0, 1.0)).unwrap();
        let rows = [Observation::default(), Observation::default()];
        let actions = agent
            .act(&rows, Mode::Train, &mut contract::random::stream(&[]))
            .unwrap();
        assert_eq!(actions, vec![vec![vec![0.0; 2]; 2]; 2]);
    }

    #[test]
    fn a_seat_without_a_zero_action_is_refused() {
        assert!(
            agent(Channel::new("speed", "").within(0.5, 1.0))
                .err()
                .unwrap()
                .to_string()
                .contains("`speed`")
        );
        assert!(
            build(
                Config {},
                &allocation(&[], &[], 2),
                &mut contract::random::stream(&[])
            )
            .is_err()
        );
    }
}
