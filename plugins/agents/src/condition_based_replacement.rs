//! Replacement by the last reading: failed components at once, worn ones at fixed intervals.
//!
//! The two baselines of imprl (github.com/omniscientoctopus/imprl): "failure-replace", which replaces failed
//! components, and TPI-CBM, "time-periodic inspections with condition-based maintenance".
//!
//! | imprl | here |
//! |---|---|
//! | t | `step` of the full state |
//! | last observation of a component | `<seat>.reading` of the full state; the largest value is failure |
//! | inspection interval | `interval`; never where absent |
//! | action by observation (0,0), (0,1), (1,1) | `replace_from` 3, 2, 1 |
//!
//! *Departure, which is the published behaviour*: the released TPI-CBM charges an inspection of every
//! component that has not failed at t > 0 with t a multiple of the interval, but never sends it to the
//! system. In the same step it acts on a reading that is uniform noise among the working states.
//! `inspections: unread` does the same in an environment with the choices `inspect_unread` and
//! `replace_and_inspect_unread`. `inspections: read` sends the inspection and acts on its result in the next
//! step.
//!
//! The agent learns nothing and records nothing.

use crate::shared::{
    choice_seat::{choice, state_channel, state_of_seats},
    state_rule::{RuleAgent, StateRule},
};
use contract::{Action, Agent, AgentTraits, Error, Interface, Preset, Registry, Rng, Seat};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

const NAME: &str = "condition_based_replacement";
/// Reading of a failed component.
const FAILED: u32 = 3;

/// Whether inspections yield readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Inspections {
    /// Inspections are made; the rule acts on their results in the next step.
    #[default]
    Read,
    /// Inspections are paid and not made; the rule acts at once on earlier readings.
    Unread,
}

/// Intervals of inspections and limits of replacement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Steps between two rounds of inspections; null for none, which replaces failed components alone.
    #[schemars(range(min = 1, max = 100_000), extend("x-source" = "imprl, 5 of 5 components: 5"))]
    pub interval: Option<u32>,
    /// Smallest reading at which a round replaces: 1 or 2, or 3 for failed components alone.
    #[schemars(range(min = 1, max = 3), extend("x-source" = "imprl, 5 of 5 components: 1"))]
    pub replace_from: u32,
    /// Whether inspections yield readings.
    pub inspections: Inspections,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            interval: None,
            replace_from: FAILED,
            inspections: Inspections::default(),
        }
    }
}

impl contract::Config for Config {
    fn presets() -> Vec<Preset> {
        let preset = |name, about, values| Preset { name, about, values };
        vec![
            preset(
                "failure_replace",
                "replaces what has failed (the defaults)",
                json!({}),
            ),
            preset(
                "published_5_of_5",
                "TPI-CBM as released, with the best of its 150 settings for 5 of 5 components",
                json!({ "interval": 5, "replace_from": 1, "inspections": "unread" }),
            ),
        ]
    }
}

/// The rule for all seats.
#[derive(Debug, Clone)]
struct ConditionBasedReplacement {
    config: Config,
    step: usize,
    seats: Vec<RuleSeat>,
}

/// Channel and choices of a seat.
#[derive(Debug, Clone)]
struct RuleSeat {
    reading: usize,
    nothing: Vec<f64>,
    replace: Vec<f64>,
    /// Choice in a round of inspections for components that stay; the next field is that for replaced ones.
    inspect: Vec<f64>,
    inspect_and_replace: Vec<f64>,
}

impl RuleSeat {
    fn new(config: &Config, seat: &Seat, reading: usize) -> Result<Self, Error> {
        let of = |name: &str| choice(NAME, seat, name);
        let (nothing, replace) = (of("nothing")?, of("replace")?);
        let (inspect, inspect_and_replace) = match (config.interval, config.inspections) {
            (None, _) => (nothing.clone(), replace.clone()),
            (_, Inspections::Read) => (of("inspect")?, replace.clone()),
            (_, Inspections::Unread) => (of("inspect_unread")?, of("replace_and_inspect_unread")?),
        };
        Ok(Self {
            reading,
            nothing,
            replace,
            inspect,
            inspect_and_replace,
        })
    }
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "replace what has failed, and at fixed intervals what reads as worn";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

/// Builds the rule for seats with the choices `nothing` and `replace`, and those that its inspections need.
///
/// # Errors
/// [`Error::Mismatch`] where a choice or a channel of the full state is missing; [`Error::Config`] for numbers outside
/// their ranges.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    if config.interval == Some(0) {
        return Err(Error::config("interval", "it is at least 1"));
    }
    if !(1..=FAILED).contains(&config.replace_from) {
        return Err(Error::config(
            "replace_from",
            format!("{} is not in 1 to 3", config.replace_from),
        ));
    }
    let readings = state_of_seats(NAME, interface, "reading")?;
    let seats = interface.seats.iter().zip(readings);
    let seats = seats.map(|(seat, reading)| RuleSeat::new(&config, seat, reading));
    Ok(Box::new(RuleAgent(ConditionBasedReplacement {
        step: state_channel(NAME, &interface.state, "step")?,
        seats: seats.collect::<Result<_, Error>>()?,
        config,
    })))
}

impl StateRule for ConditionBasedReplacement {
    fn decide(&self, state: &[f64]) -> Action {
        let step = state[self.step];
        let after = |lag: f64| {
            self.config
                .interval
                .is_some_and(|interval| is_round(step - lag, interval))
        };
        let (inspects, acts) = match self.config.inspections {
            Inspections::Read => (after(0.0), after(1.0)),
            Inspections::Unread => (after(0.0), after(0.0)),
        };
        let of = |seat: &RuleSeat| self.choose(seat, state[seat.reading], inspects, acts).to_vec();
        self.seats.iter().map(of).collect()
    }
}

impl ConditionBasedReplacement {
    fn choose<'a>(&self, seat: &'a RuleSeat, reading: f64, inspects: bool, acts: bool) -> &'a [f64] {
        let reads_as = |least: u32| reading > f64::from(least) - 0.5;
        let replaces = acts && reads_as(self.config.replace_from);
        match (inspects, replaces) {
            _ if reads_as(FAILED) => &seat.replace,
            (true, true) => &seat.inspect_and_replace,
            (false, true) => &seat.replace,
            (true, false) => &seat.inspect,
            (false, false) => &seat.nothing,
        }
    }
}

fn is_round(step: f64, interval: u32) -> bool {
    step > 0.5 && step % f64::from(interval) < 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::choice_seat::tests::interface;
    use contract::{Mode, Observation, random::stream};

    const CHOICES: [&str; 5] = [
        "nothing",
        "replace",
        "inspect",
        "inspect_unread",
        "replace_and_inspect_unread",
    ];

    fn agent(values: serde_json::Value, choices: &[&str]) -> Result<Box<dyn Agent>, Error> {
        let config = serde_json::from_value(values).unwrap();
        build(config, &interface(4, choices, &["reading"]), &mut stream(&[]))
    }

    /// Choices of seats that read 0, 1, 2 and 3.
    fn decided(agent: &mut dyn Agent, step: f64) -> Vec<f64> {
        let seen = Observation {
            seats: vec![vec![0.0]; 4],
            state: vec![step, 0.0, 1.0, 2.0, 3.0],
        };
        agent.act(&[seen], Mode::Evaluate, &mut stream(&[])).unwrap()[0].concat()
    }

    #[test]
    fn failed_components_are_replaced_and_nothing_else_without_an_interval() {
        let mut agent = agent(json!({ "replace_from": 1 }), &CHOICES[..3]).unwrap();
        for step in [0.0, 1.0, 10.0] {
            assert_eq!(decided(&mut *agent, step), [0.0, 0.0, 0.0, 1.0]);
        }
    }

    #[test]
    fn the_released_rule_pays_for_inspections_that_it_does_not_make() {
        let of = |replace_from: u32| {
            agent(
                json!({ "interval": 5, "replace_from": replace_from, "inspections": "unread" }),
                &CHOICES,
            )
            .unwrap()
        };
        assert_eq!(decided(&mut *of(1), 0.0), [0.0, 0.0, 0.0, 1.0]);
        assert_eq!(decided(&mut *of(1), 4.0), [0.0, 0.0, 0.0, 1.0]);
        // A failed component is replaced without an inspection.
        assert_eq!(decided(&mut *of(1), 5.0), [3.0, 4.0, 4.0, 1.0]);
        assert_eq!(decided(&mut *of(2), 10.0), [3.0, 3.0, 4.0, 1.0]);
        assert_eq!(decided(&mut *of(3), 10.0), [3.0, 3.0, 3.0, 1.0]);
    }

    #[test]
    fn an_inspection_that_is_made_is_acted_upon_a_step_later() {
        let mut agent = agent(json!({ "interval": 5, "replace_from": 2 }), &CHOICES[..3]).unwrap();
        assert_eq!(decided(&mut *agent, 5.0), [2.0, 2.0, 2.0, 1.0]);
        assert_eq!(decided(&mut *agent, 6.0), [0.0, 0.0, 1.0, 1.0]);
        assert_eq!(decided(&mut *agent, 1.0), [0.0, 0.0, 0.0, 1.0]);
        assert_eq!(decided(&mut *agent, 7.0), [0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn misfits_are_refused() {
        let refused = |values, choices: &[&str]| agent(values, choices).err().unwrap().to_string();
        assert!(refused(json!({ "interval": 0 }), &CHOICES).contains("`interval`"));
        assert!(
            refused(json!({ "replace_from": 4 }), &CHOICES).contains("`replace_from`: 4 is not in 1 to 3")
        );
        let unread = json!({ "interval": 5, "inspections": "unread" });
        assert!(refused(unread, &CHOICES[..3]).contains("no choice `inspect_unread`"));
        let no_reading = build(
            Config::default(),
            &interface(1, &CHOICES, &["wear"]),
            &mut stream(&[]),
        );
        assert!(no_reading.err().unwrap().to_string().contains("`unit_0.reading`"));
    }
}
