//! Every asset always gets the same share: the baseline of the thesis (section 3.5.2) to which its
//! improvements relate.
//!
//! `a_i = 1 / N`. The agent observes nothing, learns nothing and records nothing.

use crate::shared::{allocation::equal_shares, seat};
use contract::{Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Registry, Rng};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "equal_split";

/// No parameters.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {}

impl contract::Config for Config {}

/// Equal shares for every seat.
#[derive(Debug, Clone)]
pub struct EqualSplit {
    action: Action,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "every asset gets the same share";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

/// Builds the rule for any number of seats that act on simplexes.
///
/// # Errors
/// [`Error::Mismatch`] where a seat's action is not on a simplex.
fn build(_: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let action = interface
        .seats
        .iter()
        .map(|seat| Ok(equal_shares(seat::simplex(NAME, seat)?.len())));
    Ok(Box::new(EqualSplit {
        action: action.collect::<Result<_, Error>>()?,
    }))
}

impl Agent for EqualSplit {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(vec![self.action.clone(); observations.len()])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::seat::tests::allocation;

    #[test]
    fn four_assets_get_a_quarter_each() {
        let mut rng = contract::random::stream(&["test"]);
        let mut agent = build(Config {}, &allocation(&["voltage_1"], &[], 4), &mut rng).unwrap();
        let actions = agent
            .act(
                &[Observation::default(), Observation::default()],
                Mode::Evaluate,
                &mut rng,
            )
            .unwrap();
        assert_eq!(actions, vec![vec![vec![0.25; 4]]; 2]);
    }
}
