//! How long one update of a learning algorithm takes, beside another one's on the same transitions (thesis, table 4.1).
//!
//! Two algorithms learn side by side in one trial: every transition is given to both, and which one goes first alternates, so that
//! whatever else the machine does slows both alike. The measured algorithm also acts. An update is what `learn` does with one
//! transition: where the algorithm updates once per environment step, the update of all seats and of their targets, with the
//! draw of the minibatches.
//!
//! This agent reads a clock, which nothing else below a trial may: what it records are times, other ones in every run and on
//! every machine. Its registration says so ([`engine::AgentTraits::measures_time`]), its trials are not pinned, and a measurement
//! that was stopped begins anew rather than going on in another process.
//!
//! Departures from the thesis: wall-clock time of one thread, not CPU time; the first `warm_up` transitions are not timed, so
//! that all minibatches are full.
//!
//! Metrics: `update_s`, `reference_update_s` (means over the timed transitions), `update_time_ratio` (of these two).

use engine::{
    Action, Agent, AgentTraits, Error, Interface, Metric, Mode, Observation, Recorder, Registry, Rng, Transition, Updates,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{path::Path, time::Instant};

/// Name of the agent.
const NAME: &str = "update_timing";

/// What to time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Name of the agent that is timed.
    pub algorithm: String,
    /// Name of the agent that it is compared with.
    pub reference: String,
    /// Preset that both use; their defaults where null.
    pub setting: Option<String>,
    /// Transitions before the first that is timed.
    #[schemars(extend("x-unit" = "steps"))]
    pub warm_up: u64,
}

impl Default for Config {
    fn default() -> Self {
        Self { algorithm: "tdom_ac".into(), reference: "tdom_ac".into(), setting: None, warm_up: 600 }
    }
}

impl engine::Config for Config {}

fn metrics() -> Vec<Metric> {
    let time = |name: &str, about: &str| Metric::new(name, "s", about).lower_is_better();
    vec![
        time("update_s", "time of one update of the timed algorithm, mean"),
        time("reference_update_s", "time of one update of the reference, mean"),
        Metric::new("update_time_ratio", "", "time of one update over that of the reference").lower_is_better(),
    ]
}

/// Two agents that learn from the same transitions, and the seconds that each took.
pub struct UpdateTiming {
    timed: Box<dyn Agent>,
    reference: Box<dyn Agent>,
    warm_up: u64,
    seen: u64,
    timed_s: f64,
    reference_s: f64,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about = "times one update of an algorithm beside another's: its numbers are times, and differ from run to run";
    let traits = AgentTraits { learns: true, metrics: metrics(), measures_time: true, ..AgentTraits::default() };
    registry.agent(NAME, version, about, traits, build);
}

/// Builds both algorithms for an environment that both can be used with.
///
/// # Errors
/// [`Error::Config`] for a name that is not known, and whatever the algorithms refuse.
fn build(config: Config, interface: &Interface, rng: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let mut registry = Registry::default();
    crate::register(&mut registry);
    let setting = config.setting.as_deref();
    Ok(Box::new(UpdateTiming {
        timed: algorithm(&registry, ("algorithm", &config.algorithm), setting, interface, rng)?,
        reference: algorithm(&registry, ("reference", &config.reference), setting, interface, rng)?,
        warm_up: config.warm_up,
        seen: 0,
        timed_s: 0.0,
        reference_s: 0.0,
    }))
}

fn algorithm(
    registry: &Registry,
    (key, name): (&str, &str),
    setting: Option<&str>,
    interface: &Interface,
    rng: &mut Rng,
) -> Result<Box<dyn Agent>, Error> {
    let known = |name: &str| registry.agents.get(name).filter(|entry| entry.learns && !entry.measures_time);
    let Some(entry) = known(name) else {
        return Err(Error::config(key, format!("`{name}` is no agent that learns")));
    };
    let values = match setting {
        None => entry.about.defaults.clone(),
        Some(setting) => match entry.about.presets.iter().find(|preset| preset.name == setting) {
            Some(preset) => preset.values.clone(),
            None => return Err(Error::config("setting", format!("`{name}` has no preset `{setting}`"))),
        },
    };
    // A preset that does not resolve is a mistake of the program, which the tests of all presets find; it is reported all the same.
    let config = (entry.about.resolve)(&values).map_err(|source| Error::config("setting", source.to_string()))?;
    (entry.build)(&config, interface, rng)
}

impl UpdateTiming {
    /// Gives one transition to both, in alternating order.
    fn take_in(&mut self, transition: &Transition, rng: &mut Rng) -> Result<(), Error> {
        let one = std::slice::from_ref(transition);
        let (timed_s, reference_s) = if self.seen.is_multiple_of(2) {
            (seconds(&mut *self.timed, one, rng)?, seconds(&mut *self.reference, one, rng)?)
        } else {
            let reference_s = seconds(&mut *self.reference, one, rng)?;
            (seconds(&mut *self.timed, one, rng)?, reference_s)
        };
        self.seen += 1;
        if self.seen > self.warm_up {
            self.timed_s += timed_s;
            self.reference_s += reference_s;
        }
        Ok(())
    }
}

/// Seconds that an agent needs to learn from a transition. What it records is dropped.
fn seconds(agent: &mut dyn Agent, one: &[Transition], rng: &mut Rng) -> Result<f64, Error> {
    let mut dropped = Recorder::default();
    let start = Instant::now();
    agent.learn(one, rng, &mut dropped)?;
    Ok(start.elapsed().as_secs_f64())
}

impl Agent for UpdateTiming {
    fn act(&mut self, observations: &[Observation], mode: Mode, rng: &mut Rng) -> Result<Vec<Action>, Error> {
        self.timed.act(observations, mode, rng)
    }

    fn learn(&mut self, transitions: &[Transition], rng: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        for transition in transitions {
            self.take_in(transition, rng)?;
        }
        if self.seen > self.warm_up {
            #[allow(clippy::cast_precision_loss, reason = "steps are far below 2^52")]
            let count = (self.seen - self.warm_up) as f64;
            record.latest("update_s", self.timed_s / count);
            record.latest("reference_update_s", self.reference_s / count);
            record.latest("update_time_ratio", self.timed_s / self.reference_s);
        }
        Ok(())
    }

    fn reads_state(&self) -> bool {
        self.timed.reads_state() || self.reference.reads_state()
    }

    fn updates(&self) -> Option<Updates> {
        self.timed.updates()
    }

    fn load(&mut self, _dir: &Path) -> Result<(), Error> {
        let problem = "times of another process say nothing here: the measurement begins anew".into();
        Err(Error::Checkpoint { what: NAME, problem })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::coordination;
    use engine::random::stream;

    fn timing(config: Config) -> Result<Box<dyn Agent>, Error> {
        build(config, &coordination::game(), &mut stream(&["initialise"]))
    }

    fn transition() -> Transition {
        let seats = coordination::game().seats;
        let observation =
            Observation { seats: seats.iter().map(|seat| vec![0.5; seat.observation.len()]).collect(), state: Vec::new() };
        let action: Action = seats.iter().map(|seat| vec![0.1; seat.action.len()]).collect();
        let rewards = vec![1.0; seats.len()];
        Transition { next_observation: observation.clone(), observation, action, rewards, end: None }
    }

    fn latest(record: &mut Recorder) -> Vec<(String, f64)> {
        record.record_latest(engine::Phase::Final, 1);
        record.rows().iter().map(|row| (record.names()[usize::from(row.metric)].clone(), row.value)).collect()
    }

    #[test]
    fn times_are_recorded_after_the_warm_up_and_declared() {
        let mut agent = timing(Config { algorithm: "maddpg".into(), warm_up: 4, ..Config::default() }).unwrap();
        let (mut rng, mut record) = (stream(&["learn"]), Recorder::default());
        agent.learn(&vec![transition(); 4], &mut rng, &mut record).unwrap();
        assert!(latest(&mut record).is_empty());
        agent.learn(&vec![transition(); 3], &mut rng, &mut record).unwrap();
        let values: std::collections::BTreeMap<String, f64> = latest(&mut record).into_iter().collect();
        assert!(values.values().all(|value| *value > 0.0), "{values:?}");
        let ratio = values["update_s"] / values["reference_update_s"];
        assert!((values["update_time_ratio"] / ratio - 1.0).abs() < 1e-9, "{values:?}");
        let declared: std::collections::BTreeSet<String> = metrics().into_iter().map(|metric| metric.name).collect();
        assert!(values.into_keys().collect::<std::collections::BTreeSet<_>>() == declared);
    }

    #[test]
    fn what_cannot_be_timed_is_refused() {
        let message = |config| timing(config).err().unwrap().to_string();
        for name in ["nobody", "zero_action", NAME] {
            assert!(message(Config { algorithm: name.into(), ..Config::default() }).contains(name));
        }
        assert!(message(Config { setting: Some("unheard_of".into()), ..Config::default() }).contains("unheard_of"));
    }

    #[test]
    fn a_stopped_measurement_begins_anew() {
        let mut agent = timing(Config::default()).unwrap();
        assert!(matches!(agent.load(Path::new("")), Err(Error::Checkpoint { .. })));
    }
}
