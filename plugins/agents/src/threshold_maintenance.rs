//! Maintenance beyond a threshold, the most worn seats first and a limited number at once: a rule for a
//! fleet.
//!
//! The rule has two thresholds on two channels of the full state that every seat has. A seat whose
//! `all_channel` is at or above `all_from` takes the choice `all`; another one whose `worst_channel` is at or
//! above `worst_from` takes the choice `worst`. At most `at_once` of these seats are maintained, those that
//! exceed their threshold by the largest part of it; the others wait and take `nothing`. On a counted charge
//! this is maintenance at intervals, on a health it is condition-based; `at_once` keeps a fleet available.
//!
//! The agent learns nothing and records nothing.

use crate::shared::{
    choice_seat::{choice, state_of_seats},
    state_rule::{RuleAgent, StateRule},
};
use contract::{Action, Agent, AgentTraits, Error, Interface, Registry, Rng};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "threshold_maintenance";

/// Thresholds and choices of the rule.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The channel `<seat>.<name>` of the full state that decides on all parts of a seat.
    pub all_channel: String,
    /// Smallest value at which the choice `all` is taken; never if absent.
    pub all_from: Option<f64>,
    /// Name of that choice.
    pub all: String,
    /// The channel `<seat>.<name>` of the full state that decides on the worst part of a seat.
    pub worst_channel: String,
    /// Smallest value at which the choice `worst` is taken; never if absent.
    pub worst_from: Option<f64>,
    /// Name of that choice.
    pub worst: String,
    /// Largest number of seats that are maintained in one step.
    #[schemars(range(min = 1, max = 100_000))]
    pub at_once: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            all_channel: "mean_resistance_ohm".into(),
            all_from: Some(0.18),
            all: "replace_all".into(),
            worst_channel: "worst_resistance_ohm".into(),
            worst_from: None,
            worst: "replace_worst".into(),
            at_once: 1,
        }
    }
}

impl contract::Config for Config {}

/// The rule for all seats.
#[derive(Debug, Clone)]
struct ThresholdMaintenance {
    at_once: usize,
    seats: Vec<RuleSeat>,
}

/// Thresholds of a seat, of which the first that is reached applies, and its choice below all of them.
#[derive(Debug, Clone)]
struct RuleSeat {
    nothing: Vec<f64>,
    thresholds: Vec<Threshold>,
}

#[derive(Debug, Clone)]
struct Threshold {
    channel: usize,
    from: f64,
    choice: Vec<f64>,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "maintain what is worn beyond a threshold, the most worn first, never too many at once";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

/// Builds the rule for seats with the choice `nothing` and those that it names.
///
/// # Errors
/// [`Error::Mismatch`] where a choice or a channel of the full state is missing; [`Error::Config`] for a
/// threshold that is not above 0 and for `at_once: 0`.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    if config.at_once == 0 {
        return Err(Error::config("at_once", "it is at least 1"));
    }
    let mut seats = Vec::new();
    for seat in &interface.seats {
        seats.push(RuleSeat {
            nothing: choice(NAME, seat, "nothing")?,
            thresholds: Vec::new(),
        });
    }
    for (key, from, channel, name) in [
        ("all_from", config.all_from, &config.all_channel, &config.all),
        (
            "worst_from",
            config.worst_from,
            &config.worst_channel,
            &config.worst,
        ),
    ] {
        let Some(from) = from else { continue };
        if !(from.is_finite() && from > 0.0) {
            return Err(Error::config(key, format!("{from} is not above 0")));
        }
        let channels = state_of_seats(NAME, interface, channel)?;
        for ((one, seat), channel) in seats.iter_mut().zip(&interface.seats).zip(channels) {
            let choice = choice(NAME, seat, name)?;
            one.thresholds.push(Threshold {
                channel,
                from,
                choice,
            });
        }
    }
    Ok(Box::new(RuleAgent(ThresholdMaintenance {
        at_once: config.at_once,
        seats,
    })))
}

impl StateRule for ThresholdMaintenance {
    fn decide(&self, state: &[f64]) -> Action {
        let mut action: Action = self.seats.iter().map(|seat| seat.nothing.clone()).collect();
        let mut due: Vec<(f64, usize, &[f64])> = self
            .seats
            .iter()
            .enumerate()
            .filter_map(|(at, seat)| seat.due(state).map(|(excess, choice)| (excess, at, choice)))
            .collect();
        due.sort_by(|one, other| other.0.total_cmp(&one.0));
        for (_, seat, choice) in due.into_iter().take(self.at_once) {
            action[seat] = choice.to_vec();
        }
        action
    }
}

impl RuleSeat {
    /// Excess of the value over the first threshold that is reached, in parts of the threshold, and its
    /// choice.
    fn due(&self, state: &[f64]) -> Option<(f64, &[f64])> {
        let reached = self.thresholds.iter().find(|it| state[it.channel] >= it.from)?;
        Some((state[reached.channel] / reached.from, &reached.choice))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::choice_seat::tests::interface;
    use contract::{Mode, Observation, random::stream};
    use serde_json::json;

    const CHOICES: [&str; 3] = ["nothing", "replace_worst", "replace_all"];
    const CHANNELS: [&str; 2] = ["mean_resistance_ohm", "worst_resistance_ohm"];

    fn agent(values: serde_json::Value, choices: &[&str]) -> Result<Box<dyn Agent>, Error> {
        let config = serde_json::from_value(values).unwrap();
        build(config, &interface(3, choices, &CHANNELS), &mut stream(&[]))
    }

    /// Choices for means and worst values of three seats.
    fn decided(values: serde_json::Value, mean: [f64; 3], worst: [f64; 3]) -> Vec<f64> {
        let of_seats = mean.iter().zip(worst).flat_map(|(mean, worst)| [*mean, worst]);
        let seen = Observation {
            seats: vec![vec![0.0]; 3],
            state: [7.0].into_iter().chain(of_seats).collect(),
        };
        let mut agent = agent(values, &CHOICES).unwrap();
        assert!(agent.reads_state());
        agent.act(&[seen], Mode::Evaluate, &mut stream(&[])).unwrap()[0].concat()
    }

    #[test]
    fn the_most_worn_go_first_and_the_rest_wait() {
        let mean = [0.19, 0.25, 0.1];
        assert_eq!(decided(json!({}), mean, [0.0; 3]), [0.0, 2.0, 0.0]);
        assert_eq!(decided(json!({ "at_once": 3 }), mean, [0.0; 3]), [2.0, 2.0, 0.0]);
        // At the threshold, and the first of equals.
        assert_eq!(decided(json!({}), [0.18, 0.18, 0.0], [0.0; 3]), [2.0, 0.0, 0.0]);
    }

    #[test]
    fn a_worst_part_is_replaced_where_not_all_are() {
        let both = json!({ "worst_from": 0.2, "at_once": 2 });
        // Excess of the first 0.3 / 0.2, of the second 0.36 / 0.18, of the third 0.21 / 0.2.
        assert_eq!(decided(both, [0.1, 0.36, 0.1], [0.3, 0.4, 0.21]), [1.0, 2.0, 0.0]);
        let worst_alone = json!({ "all_from": null, "worst_from": 0.2 });
        assert_eq!(decided(worst_alone, [9.0; 3], [0.1, 0.2, 0.1]), [0.0, 1.0, 0.0]);
    }

    #[test]
    fn misfits_are_refused() {
        let refused = |values, choices: &[&str]| agent(values, choices).err().unwrap().to_string();
        assert!(refused(json!({ "at_once": 0 }), &CHOICES).contains("`at_once`"));
        assert!(refused(json!({ "all_from": 0.0 }), &CHOICES).contains("`all_from`: 0 is not above 0"));
        let text = refused(json!({}), &CHOICES[..2]);
        assert!(text.contains("no choice `replace_all`"), "{text}");
        let text = refused(json!({ "all_channel": "age" }), &CHOICES);
        assert!(text.contains("`unit_0.age`"), "{text}");
    }
}
