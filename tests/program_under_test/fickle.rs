//! An agent with one number to be searched, whose trials fail where whoever runs the program says so.
//!
//! `REGIMEN_TEST_FAILS=<low>-<high>@<update>:<how>` lets every trial whose rate lies between the limits fail at
//! that update: with an error (`fail`), by a panic (`panic`), or by running for ever (`hang`). No trial's id
//! knows of it, as of a licence server that is down.

use contract::{
    Action, Agent, AgentTraits, Error, Feed, Interface, Metric, Mode, Observation, Recorder, Registry, Rng,
    Space, Transition, Updates,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Behaviour of the agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Config {
    /// Decides what it does, with the number of its updates.
    rate: f64,
    /// From this rate on its numbers are not finite after a while: the larger the rate, the sooner.
    diverges_from: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            rate: 0.5,
            diverges_from: 2.0,
        }
    }
}

impl contract::Config for Config {}

struct Fickle {
    config: Config,
    sizes: Vec<usize>,
    updates: u64,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry) {
    let traits = AgentTraits::learner(
        [Feed::Decisions],
        vec![Metric::new("tally", "", "the number of updates")],
    );
    let build = |config: Config, interface: &Interface, _: &mut Rng| -> Result<Box<dyn Agent>, Error> {
        let sizes = interface.seats.iter().map(|seat| match &seat.action {
            Space::Simplex(names) => names.len(),
            other => other.len(),
        });
        Ok(Box::new(Fickle {
            config,
            sizes: sizes.collect(),
            updates: 0,
        }))
    };
    registry.agent("fickle", 1, "Fails where it is told to.", traits, build);
}

impl Fickle {
    /// The first share of every action.
    #[allow(clippy::cast_precision_loss, reason = "few updates")]
    fn share(&self) -> f64 {
        let phase = 11.0 * self.config.rate + 0.4 * self.updates as f64 * (self.config.rate - 0.3);
        0.5 + 0.45 * phase.sin()
    }
}

impl Agent for Fickle {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        let first = self.share();
        #[allow(clippy::cast_precision_loss, reason = "few shares")]
        let shares = |size: usize| {
            let mut shares = vec![(1.0 - first) / (size.max(2) - 1) as f64; size];
            shares[0] = if size == 1 { 1.0 } else { first };
            shares
        };
        Ok(observations
            .iter()
            .map(|_| self.sizes.iter().map(|size| shares(*size)).collect())
            .collect())
    }

    fn learn(&mut self, _: &[Transition], _: &mut Rng, record: &mut Recorder) -> Result<(), Error> {
        self.updates += 1;
        #[allow(clippy::cast_precision_loss, reason = "few updates")]
        let updates = self.updates as f64;
        record.mean("tally", updates);
        if (self.config.rate - self.config.diverges_from) * updates > 2.0 {
            return Err(Error::NotFinite {
                what: "the tally".into(),
                step: self.updates,
                value: f64::NAN,
            });
        }
        misfortune(self.config.rate, self.updates)
    }

    fn updates(&self) -> Option<Updates> {
        Some(Updates {
            made: self.updates,
            first_after: 1,
        })
    }

    fn save(&self, dir: &Path) -> Result<(), Error> {
        let file = dir.join("updates");
        std::fs::write(&file, self.updates.to_string()).map_err(Error::file("write", &file))
    }

    fn load(&mut self, dir: &Path) -> Result<(), Error> {
        let file = dir.join("updates");
        let text = std::fs::read_to_string(&file).map_err(Error::file("read", &file))?;
        self.updates = text.parse().unwrap_or_default();
        Ok(())
    }
}

/// Faults that the person who runs the program allows.
#[expect(
    clippy::disallowed_methods,
    reason = "whoever runs the tests says which trials fail; no number of a trial that ends knows of it"
)]
fn misfortune(rate: f64, updates: u64) -> Result<(), Error> {
    let Some(asked) = std::env::var("REGIMEN_TEST_FAILS").ok() else {
        return Ok(());
    };
    let (limits, rest) = asked.split_once('@').expect("low-high@update:how");
    let (at, how) = rest.split_once(':').expect("low-high@update:how");
    let (low, high) = limits.split_once('-').expect("low-high@update:how");
    let [low, high, at] = [low, high, at].map(|word| word.parse::<f64>().expect("a number"));
    #[allow(clippy::cast_precision_loss, reason = "few updates")]
    let is_meant = rate >= low && rate < high && updates as f64 >= at;
    match how {
        _ if !is_meant => Ok(()),
        "panic" => panic!("it panics as asked"),
        "hang" => loop {
            std::thread::park();
        },
        _ => Err(Error::Model {
            model: "test",
            problem: "the licence server is down".into(),
        }),
    }
}
