//! Inspection of the components most likely to fail at fixed intervals, and repair of detected damage: the
//! published rule for inspection planning.
//!
//! P. Leroy, P. G. Morato, J. Pisane, A. Kolios and D. Ernst, "IMP-MARL: a suite of environments for large-scale
//! infrastructure management planning via MARL", NeurIPS 2023, section 4.2, the "expert-based heuristic policy".
//!
//! | paper | here |
//! |---|---|
//! | t | `step` of the full state |
//! | inspection interval | `interval` |
//! | number of components to inspect | `components` |
//! | failure probability of a component | `<seat>.failure_probability` of the full state |
//! | outcome of its last inspection | `<seat>.detected` of the full state, 1 where damage was found |
//!
//! At every step a component whose inspection in the step before found damage is repaired. At steps t > 0
//! with t a multiple of the interval the components with the highest failure probabilities are inspected,
//! except those that are repaired; the first of equals come first. The agent learns nothing and records
//! nothing.

use crate::shared::{
    choice_seat::{choice, state_channel, state_of_seats},
    state_rule::{RuleAgent, StateRule},
};
use contract::{Action, Agent, AgentTraits, Error, Interface, Registry, Rng};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "interval_inspection";

/// Interval and size of the rounds of inspections.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Steps between two rounds of inspections.
    #[schemars(range(min = 1, max = 100_000), extend("x-source" = "IMP-MARL, 4 of 5 components: 10"))]
    pub interval: u32,
    /// Components that a round inspects; all where there are fewer.
    #[schemars(range(min = 1, max = 100_000), extend("x-source" = "IMP-MARL, 4 of 5 components: 5"))]
    pub components: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            interval: 10,
            components: 5,
        }
    }
}

impl contract::Config for Config {}

/// The rule for all seats.
#[derive(Debug, Clone)]
struct IntervalInspection {
    config: Config,
    step: usize,
    seats: Vec<RuleSeat>,
}

/// Channels and choices of a seat.
#[derive(Debug, Clone)]
struct RuleSeat {
    failure: usize,
    detected: usize,
    nothing: Vec<f64>,
    inspect: Vec<f64>,
    repair: Vec<f64>,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "inspect the likeliest to fail at fixed intervals, repair what was found";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

/// Builds the rule for seats with the choices `nothing`, `inspect` and `repair`.
///
/// # Errors
/// [`Error::Mismatch`] where a choice or a channel of the full state is missing; [`Error::Config`] for a 0.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    for (key, is_zero) in [
        ("interval", config.interval == 0),
        ("components", config.components == 0),
    ] {
        if is_zero {
            return Err(Error::config(key, "it is at least 1"));
        }
    }
    let failure = state_of_seats(NAME, interface, "failure_probability")?;
    let detected = state_of_seats(NAME, interface, "detected")?;
    let seats = interface.seats.iter().zip(failure.into_iter().zip(detected));
    let seats = seats.map(|(seat, (failure, detected))| {
        Ok(RuleSeat {
            failure,
            detected,
            nothing: choice(NAME, seat, "nothing")?,
            inspect: choice(NAME, seat, "inspect")?,
            repair: choice(NAME, seat, "repair")?,
        })
    });
    Ok(Box::new(RuleAgent(IntervalInspection {
        config,
        step: state_channel(NAME, &interface.state, "step")?,
        seats: seats.collect::<Result<_, Error>>()?,
    })))
}

impl StateRule for IntervalInspection {
    fn decide(&self, state: &[f64]) -> Action {
        let mut action: Action = self.seats.iter().map(|seat| seat.nothing.clone()).collect();
        if self.is_round(state[self.step]) {
            for seat in self.likeliest(state) {
                action[seat] = self.seats[seat].inspect.clone();
            }
        }
        for (seat, action) in self.seats.iter().zip(&mut action) {
            if state[seat.detected] > 0.5 {
                *action = seat.repair.clone();
            }
        }
        action
    }
}

impl IntervalInspection {
    fn is_round(&self, step: f64) -> bool {
        step > 0.5 && step % f64::from(self.config.interval) < 0.5
    }

    /// Indices of the seats that a round inspects.
    fn likeliest(&self, state: &[f64]) -> Vec<usize> {
        let failure = |seat: usize| state[self.seats[seat].failure];
        let mut seats: Vec<usize> = (0..self.seats.len()).collect();
        seats.sort_by(|one, other| failure(*other).total_cmp(&failure(*one)));
        seats.truncate(self.config.components);
        seats
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::choice_seat::tests::interface;
    use contract::{Mode, Observation, random::stream};

    const CHOICES: [&str; 3] = ["nothing", "inspect", "repair"];
    const CHANNELS: [&str; 2] = ["failure_probability", "detected"];

    fn agent(interval: u32, components: usize) -> Result<Box<dyn Agent>, Error> {
        let config = Config { interval, components };
        build(config, &interface(3, &CHOICES, &CHANNELS), &mut stream(&[]))
    }

    /// Choices at a step for failure probabilities and findings of three seats.
    fn decided(agent: &mut dyn Agent, step: f64, failure: [f64; 3], detected: [f64; 3]) -> Vec<f64> {
        let of_seats = failure
            .iter()
            .zip(detected)
            .flat_map(|(failure, detected)| [*failure, detected]);
        let seen = Observation {
            seats: vec![vec![0.0]; 3],
            state: [step].into_iter().chain(of_seats).collect(),
        };
        agent.act(&[seen], Mode::Evaluate, &mut stream(&[])).unwrap()[0].concat()
    }

    #[test]
    fn a_round_inspects_the_likeliest_and_findings_are_repaired_at_once() {
        let mut agent = agent(5, 2).unwrap();
        let mut at = |step: f64, detected| decided(&mut *agent, step, [0.1, 0.3, 0.2], detected);
        assert_eq!(at(0.0, [0.0; 3]), [0.0, 0.0, 0.0]);
        assert_eq!(at(4.0, [0.0; 3]), [0.0, 0.0, 0.0]);
        assert_eq!(at(5.0, [0.0; 3]), [0.0, 1.0, 1.0]);
        assert_eq!(at(6.0, [0.0, 1.0, 0.0]), [0.0, 2.0, 0.0]);
        // A repair replaces the inspection, and no other seat moves up.
        assert_eq!(at(10.0, [0.0, 1.0, 0.0]), [0.0, 2.0, 1.0]);
    }

    #[test]
    fn of_equals_the_first_are_inspected_and_never_more_than_there_are() {
        let equal = [0.2; 3];
        assert_eq!(
            decided(&mut *agent(1, 2).unwrap(), 1.0, equal, [0.0; 3]),
            [1.0, 1.0, 0.0]
        );
        assert_eq!(
            decided(&mut *agent(1, 9).unwrap(), 1.0, equal, [0.0; 3]),
            [1.0; 3]
        );
    }

    #[test]
    fn misfits_are_refused() {
        assert!(agent(0, 1).err().unwrap().to_string().contains("`interval`"));
        assert!(agent(1, 0).err().unwrap().to_string().contains("`components`"));
        let refused = |choices: &[&str], channels: &[&str]| {
            let built = build(
                Config::default(),
                &interface(3, choices, channels),
                &mut stream(&[]),
            );
            built.err().unwrap().to_string()
        };
        assert!(refused(&["nothing", "inspect"], &CHANNELS).contains("no choice `repair`"));
        assert!(refused(&CHOICES, &["detected"]).contains("`unit_0.failure_probability`"));
    }
}
