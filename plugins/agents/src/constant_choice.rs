//! Every seat always takes the choice of one name, such as doing nothing or the same to every part: floors
//! for comparisons.
//!
//! The agent observes nothing, learns nothing and records nothing.

use crate::shared::choice_seat::choice;
use contract::{Action, Agent, AgentTraits, Error, Interface, Mode, Observation, Registry, Rng};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "constant_choice";

/// The choice to take.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Name of the choice, which every seat must have.
    pub choice: String,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            choice: "nothing".into(),
        }
    }
}

impl contract::Config for Config {}

/// Takes one choice in every seat.
#[derive(Debug, Clone)]
struct ConstantChoice {
    action: Action,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "every seat always takes the choice of one name, as in doing nothing";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

/// Builds the policy for any number of seats.
///
/// # Errors
/// [`Error::Mismatch`] where a seat has no such choice.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let seats = interface.seats.iter();
    let action = seats.map(|seat| choice(NAME, seat, &config.choice));
    Ok(Box::new(ConstantChoice {
        action: action.collect::<Result<_, Error>>()?,
    }))
}

impl Agent for ConstantChoice {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        Ok(vec![self.action.clone(); observations.len()])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::choice_seat::tests::interface;
    use contract::random::stream;

    #[test]
    fn all_seats_of_all_rows_take_the_choice() {
        let interface = interface(2, &["nothing", "repair"], &[]);
        let config = Config {
            choice: "repair".into(),
        };
        let mut agent = build(config, &interface, &mut stream(&[])).unwrap();
        let rows = vec![Observation::default(); 2];
        let actions = agent.act(&rows, Mode::Evaluate, &mut stream(&[])).unwrap();
        assert_eq!(actions, vec![vec![vec![1.0]; 2]; 2]);
    }

    #[test]
    fn a_choice_that_a_seat_does_not_have_is_refused() {
        let interface = interface(1, &["left", "right"], &[]);
        let refusal = build(Config::default(), &interface, &mut stream(&[]))
            .err()
            .unwrap();
        assert!(
            refusal
                .to_string()
                .contains("no choice `nothing`; there are: left, right")
        );
    }
}
