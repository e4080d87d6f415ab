//! Heat in proportion to what the temperature lacks, with a gain that is given (`proportional`) or tuned
//! (`tuner`): each episode tries a gain near the best one so far.

use engine::{
    Action, Agent, AgentTraits, Config, Error, Feed, Interface, Metric, Mode, Observation, Recorder,
    Registry, Rng, Transition, Updates,
};
use rand::Rng as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Parameters of both agents.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Gain {
    /// Heat per degree that the temperature lacks; where the tuner begins.
    gain: f64,
    /// Temperature that is wanted.
    #[schemars(extend("x-unit" = "degC"))]
    wanted: f64,
}

impl Default for Gain {
    fn default() -> Self {
        Self {
            gain: 0.05,
            wanted: 20.0,
        }
    }
}

impl Config for Gain {}

pub fn register(registry: &mut Registry) {
    let rule = AgentTraits::default();
    registry.agent(
        "proportional",
        1,
        "heat in proportion to what lacks",
        rule,
        |config, interface, _| build(config, interface, false),
    );
    let metrics = vec![Metric::new("gain", "", "the best gain so far")];
    let learner = AgentTraits::learner([Feed::Decisions], metrics);
    registry.agent(
        "tuner",
        1,
        "heat in proportion to what lacks, with a tuned gain",
        learner,
        |config, interface, _| build(config, interface, true),
    );
}

fn build(config: Gain, interface: &Interface, learns: bool) -> Result<Box<dyn Agent>, Error> {
    if interface.seats.len() != 1 || interface.seats[0].action.len() != 1 {
        return Err(Error::Mismatch {
            agent: "proportional",
            problem: "it needs one seat with one action".into(),
        });
    }
    let tuning = Tuning {
        best: config.gain,
        tried: config.gain,
        reward: 0.0,
        highest: f64::MIN,
        updates: 0,
    };
    Ok(Box::new(Proportional {
        wanted: config.wanted,
        learns,
        tuning,
    }))
}

struct Proportional {
    wanted: f64,
    learns: bool,
    tuning: Tuning,
}

/// Everything that changes.
#[derive(Serialize, Deserialize)]
struct Tuning {
    best: f64,
    tried: f64,
    /// Rewards of the episode so far, and the most that an episode gave.
    reward: f64,
    highest: f64,
    updates: u64,
}

impl Agent for Proportional {
    fn act(&mut self, observations: &[Observation], mode: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        let gain = if mode == Mode::Train {
            self.tuning.tried
        } else {
            self.tuning.best
        };
        let heat = |seen: &Observation| vec![vec![(gain * (self.wanted - seen.seats[0][0])).clamp(0.0, 1.0)]];
        Ok(observations.iter().map(heat).collect())
    }

    fn learn(
        &mut self,
        transitions: &[Transition],
        rng: &mut Rng,
        record: &mut Recorder,
    ) -> Result<(), Error> {
        let tuning = &mut self.tuning;
        for transition in transitions {
            tuning.reward += transition.rewards[0];
            if transition.end.is_some() {
                if tuning.reward > tuning.highest {
                    (tuning.best, tuning.highest) = (tuning.tried, tuning.reward);
                }
                tuning.tried = tuning.best * rng.random_range(0.5..2.0);
                (tuning.reward, tuning.updates) = (0.0, tuning.updates + 1);
            }
        }
        record.latest("gain", tuning.best);
        Ok(())
    }

    fn updates(&self) -> Option<Updates> {
        self.learns.then_some(Updates {
            made: self.tuning.updates,
            first_after: 1,
        })
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let path = dir.join("tuning.json");
        let text = serde_json::to_string(&self.tuning).map_err(std::io::Error::from);
        text.and_then(|text| std::fs::write(&path, text))
            .map_err(Error::file("write", &path))
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let path = dir.join("tuning.json");
        let text = std::fs::read_to_string(&path).map_err(Error::file("read", &path))?;
        let misfit = |error: serde_json::Error| Error::Checkpoint {
            what: "tuner",
            problem: error.to_string(),
        };
        self.tuning = serde_json::from_str(&text).map_err(misfit)?;
        Ok(())
    }
}
