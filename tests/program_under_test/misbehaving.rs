//! An agent that misbehaves as its config says.

use contract::{
    Action, Agent, AgentTraits, Artifact, Error, Feed, Interface, Mode, Observation, Recorder, Registry, Rng,
    Space, Transition, Updates, artifact::Policy,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const POLICY_FILE: &str = "policy.safetensors";

/// Kinds of misbehaviour.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum How {
    /// Nothing.
    #[default]
    Nothing,
    /// An error is returned.
    Fail,
    /// An error is returned that is long and colours what a terminal shows.
    Shout,
    /// The code panics.
    Panic,
    /// The process aborts.
    Abort,
    /// It never comes back.
    Loop,
    /// It takes memory without end.
    Allocate,
    /// It computes something that is no number.
    Nan,
    /// It ends its own process with SIGKILL.
    Kill,
}

/// A misbehaviour, and its time.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
struct Config {
    /// The misbehaviour.
    how: How,
    /// It goes wrong only while this file is not there, and is created then: once.
    once: Option<PathBuf>,
    /// Whether it leaves a policy, which acts as it does.
    leaves_policy: bool,
    /// A policy of another trial, which must be there.
    #[serde(skip_serializing_if = "Option::is_none")]
    start: Option<Artifact<Policy>>,
}

impl contract::Config for Config {}

struct Misbehaving {
    config: Config,
    sizes: Vec<usize>,
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry) {
    let traits = AgentTraits::learner([Feed::Decisions], Vec::new());
    registry.agent("misbehaving", 1, "Misbehaves as its config says.", traits, build);
}

fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    if let Some(start) = &config.start {
        let file = start.folder()?.join(POLICY_FILE);
        std::fs::metadata(&file).map_err(Error::file("find", &file))?;
    }
    let sizes = interface.seats.iter().map(|seat| match &seat.action {
        Space::Simplex(names) => names.len(),
        other => other.len(),
    });
    Ok(Box::new(Misbehaving {
        config,
        sizes: sizes.collect(),
    }))
}

impl Agent for Misbehaving {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        #[allow(clippy::cast_precision_loss, reason = "few shares")]
        let equal = |size: usize| vec![1.0 / size as f64; size];
        Ok(observations
            .iter()
            .map(|_| self.sizes.iter().map(|size| equal(*size)).collect())
            .collect())
    }

    fn export(&self, dir: &Path) -> Result<bool, Error> {
        if self.config.leaves_policy {
            let file = dir.join(POLICY_FILE);
            std::fs::write(&file, "equal shares").map_err(Error::file("write", &file))?;
        }
        Ok(self.config.leaves_policy)
    }

    fn import(&mut self, dir: &Path) -> Result<bool, Error> {
        Ok(dir.join(POLICY_FILE).is_file())
    }

    fn learn(&mut self, _: &[Transition], _: &mut Rng, _: &mut Recorder) -> Result<(), Error> {
        if let Some(file) = &self.config.once {
            if file.exists() {
                return Ok(());
            }
            std::fs::write(file, "").map_err(Error::file("write", file))?;
        }
        misbehave(self.config.how)
    }

    fn updates(&self) -> Option<Updates> {
        Some(Updates {
            made: 0,
            first_after: 1,
        })
    }
}

fn misbehave(how: How) -> Result<(), Error> {
    match how {
        How::Nothing => Ok(()),
        How::Fail => Err(Error::Model {
            model: "test",
            problem: "it fails as asked".into(),
        }),
        How::Shout => Err(Error::Model {
            model: "test",
            problem: format!("boom \u{1b}[31mred\u{202e} {}", "z".repeat(100_000)),
        }),
        How::Panic => panic!("it panics as asked"),
        How::Abort => std::process::abort(),
        How::Loop => loop {
            std::thread::sleep(std::time::Duration::from_secs(1));
        },
        How::Allocate => {
            let mut held: Vec<Vec<u8>> = Vec::new();
            loop {
                // Written memory is held, reserved memory is not.
                held.push(vec![1; 4 << 20]);
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
        }
        How::Nan => Err(Error::NotFinite {
            what: "the loss".into(),
            step: 1,
            value: f64::NAN,
        }),
        How::Kill => {
            let id = std::process::id().to_string();
            let _ = std::process::Command::new("kill").args(["-KILL", &id]).status();
            loop {
                std::thread::park();
            }
        }
    }
}
