//! The file with everything that a learning agent needs to continue to the same bits.

use contract::Error;
use numerics::{
    equations::{network::Network, state_file},
    policy_file::{self, Head, Ports},
    tensor_file::{TensorFile, TensorFileError},
};
use plan::State;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::json;
use std::path::Path;

/// Name of the file within the folder of a checkpoint.
pub const FILE_NAME: &str = "agent.safetensors";
const COUNTERS: &str = "counters";

/// Writes tensors and counters into `dir`.
///
/// # Errors
/// [`Error::File`] where the operating system refuses.
pub fn write(
    agent: &'static str,
    dir: &Path,
    mut file: TensorFile,
    counters: &impl Serialize,
) -> Result<(), Error> {
    let counters = serde_json::to_value(counters).map_err(|source| misfit(agent, source))?;
    file.header[COUNTERS] = counters;
    file.write(&dir.join(FILE_NAME)).map_err(error_of(agent))
}

/// Reads tensors and counters from `dir`.
///
/// # Errors
/// [`Error::File`] or [`Error::Checkpoint`] where a file is missing or damaged.
pub fn read<C: DeserializeOwned>(agent: &'static str, dir: &Path) -> Result<(TensorFile, C), Error> {
    let file = TensorFile::read(&dir.join(FILE_NAME)).map_err(error_of(agent))?;
    let counters =
        serde_json::from_value(file.header[COUNTERS].clone()).map_err(|source| misfit(agent, source))?;
    Ok((file, counters))
}

/// Implements `updates`, `save` and `load` for a learner that trains from a replay buffer by a schedule. The
/// learner has the fields `state`, `replay` and `schedule`, a `config` with `learning_starts` and
/// `updates_per_step`, and the counters that are listed.
macro_rules! keeps {
    ($name:expr $(; counters: $($counter:ident),+)?) => {
        fn updates(&self) -> Option<Updates> {
            let (first, per_step) = (self.config.learning_starts, self.config.updates_per_step);
            Some(self.schedule.updates(first, per_step))
        }

        fn save(&self, dir: &Path) -> Result<(), Error> {
            let mut file = numerics::tensor_file::TensorFile::default();
            numerics::equations::state_file::store(&self.state, &mut file);
            self.replay.store(&mut file);
            checkpoint::write($name, dir, file, &checkpoint::keeps!(@save self; $($($counter),+)?))
        }

        fn load(&mut self, dir: &Path) -> Result<(), Error> {
            let (file, counters): (_, serde_json::Value) = checkpoint::read($name, dir)?;
            let misfit = checkpoint::error_of($name);
            numerics::equations::state_file::restore(&mut self.state, &file).map_err(&misfit)?;
            self.replay.restore(&file).map_err(&misfit)?;
            checkpoint::keeps!(@load self, $name, counters; $($($counter),+)?);
            Ok(())
        }
    };
    // A schedule without counters is stored without a name.
    (@save $self:ident;) => { $self.schedule };
    (@save $self:ident; $($counter:ident),+) => {
        serde_json::json!({ $(stringify!($counter): $self.$counter,)+ "schedule": $self.schedule })
    };
    (@load $self:ident, $name:expr, $counters:ident;) => {
        $self.schedule = checkpoint::counter($name, &$counters)?;
    };
    (@load $self:ident, $name:expr, $counters:ident; $($counter:ident),+) => {
        $($self.$counter = checkpoint::counter($name, &$counters[stringify!($counter)])?;)+
        $self.schedule = checkpoint::counter($name, &$counters["schedule"])?;
    };
}
pub(crate) use keeps;

/// Loads the network of the policy file in `dir` into a state; `ports` and `head` are those that the agent itself would
/// write.
///
/// # Errors
/// Those of [`read_policy`], and [`Error::Checkpoint`] for a network of another shape.
pub fn import_policy(
    agent: &'static str,
    policy: &Network,
    state: &mut State<f32>,
    dir: &Path,
    ports: &Ports,
    head: Head,
) -> Result<(), Error> {
    let file = read_policy(agent, dir, ports, head)?;
    state_file::restore_network(policy, policy_file::PREFIX, state, &file).map_err(error_of(agent))
}

/// Reads a counter of a checkpoint.
///
/// # Errors
/// [`Error::Checkpoint`] where the value has another type.
pub fn counter<C: DeserializeOwned>(agent: &'static str, value: &serde_json::Value) -> Result<C, Error> {
    C::deserialize(value).map_err(|source| misfit(agent, source))
}

/// Reads the policy file in `dir`; `ports` and `head` are those that the agent itself would write.
///
/// # Errors
/// [`Error::File`] or [`Error::Checkpoint`] where the file is missing, damaged, or describes other inputs and
/// outputs.
pub fn read_policy(agent: &'static str, dir: &Path, ports: &Ports, head: Head) -> Result<TensorFile, Error> {
    let file = TensorFile::read(&dir.join(policy_file::FILE_NAME)).map_err(error_of(agent))?;
    let Ports {
        inputs,
        center,
        spread,
        outputs,
    } = ports;
    let own = [
        ("inputs", json!(inputs)),
        ("center", json!(center)),
        ("spread", json!(spread)),
        ("outputs", json!(outputs)),
        ("head", json!(head)),
    ];
    match own.into_iter().find(|(key, value)| file.header[key] != *value) {
        None => Ok(file),
        Some((key, value)) => Err(misfit(
            agent,
            format!("`{key}` of the policy is {}, here {value}", file.header[key]),
        )),
    }
}

/// Converts an error about a tensor file to an error of the engine.
pub fn error_of(agent: &'static str) -> impl Fn(TensorFileError) -> Error {
    move |error| match error {
        TensorFileError::File { doing, path, source } => Error::File { doing, path, source },
        other => misfit(agent, other),
    }
}

fn misfit(agent: &'static str, source: impl std::fmt::Display) -> Error {
    Error::Checkpoint {
        what: agent,
        problem: source.to_string(),
    }
}

/// Converts a loss to `f64` and refuses one that is not finite.
///
/// # Errors
/// [`Error::NotFinite`] with `what` and `step`.
pub fn finite(what: &str, step: u64, value: impl Into<f64>) -> Result<f64, Error> {
    let value = value.into();
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Error::NotFinite {
            what: what.into(),
            step,
            value,
        })
    }
}
