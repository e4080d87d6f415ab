//! How a running trial goes on in another process: what keeps its state, and numbers that JSON keeps to the
//! bit.

use crate::{Agent, Error, Recorder, own_training::Place};
use serde_json::Value;
use std::time::Duration;

/// Keeps what a running trial needs to continue in another process. Whether and how often it saves cannot
/// reach a result.
pub trait Keeper {
    /// True where the state should be saved now: the interval has passed, or the trial is asked to stop.
    fn due(&mut self) -> bool;

    /// True where the trial is asked to stop: after a save the protocol leaves with [`Error::Stopped`].
    fn stopping(&self) -> bool;

    /// Told what was recorded so far, before it is asked whether a save is due: a trial may have to pause where
    /// something was measured.
    fn look(&mut self, _record: &Recorder) {}

    /// Told what was recorded when the trial ends with an error.
    fn fails(&mut self, _record: &Recorder) {}

    /// Saves the protocol's own state, the agent and the record.
    ///
    /// # Errors
    /// Where a file cannot be written.
    fn save(&mut self, state: Value, agent: &dyn Agent, record: &mut Recorder) -> Result<(), Error>;

    /// Restores agent and record and gives the protocol's state back; `None` where there is nothing (or only
    /// damaged things) to continue from: then agent and record are as they were.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where the agent does not take what was saved; agent and record are then to be
    /// made anew.
    fn load(&mut self, agent: &mut dyn Agent, record: &mut Recorder) -> Result<Option<Value>, Error>;

    /// Told now and then, so that rows reach the log (live metrics) though no checkpoint is due.
    ///
    /// # Errors
    /// Where a file cannot be written.
    fn note(&mut self, record: &Recorder) -> Result<(), Error>;

    /// Where an agent that trains itself works; `None` where nothing is kept of the trial.
    ///
    /// # Errors
    /// Where the folder cannot be made.
    fn place(&mut self) -> Result<Option<Place>, Error> {
        Ok(None)
    }

    /// The time for which nothing may be heard of an agent that trains itself; `None` for any.
    fn patience(&self) -> Option<Duration> {
        None
    }

    /// Told what the training of such an agent printed so far.
    ///
    /// # Errors
    /// Where it cannot be kept.
    fn keep_output(&mut self, _said: &[u8]) -> Result<(), Error> {
        Ok(())
    }

    /// Told that the record is made anew from here on: what was noted of it counts no more.
    fn begin_anew(&mut self) {}

    /// Told that what [`load`](Self::load) took up last does not fit. It is not taken up again; false where
    /// there was nothing.
    fn refuse(&mut self) -> bool {
        false
    }
}

/// Never saves: for tests and rollouts.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoKeeper;

impl Keeper for NoKeeper {
    fn due(&mut self) -> bool {
        false
    }

    fn stopping(&self) -> bool {
        false
    }

    fn save(&mut self, _: Value, _: &dyn Agent, _: &mut Recorder) -> Result<(), Error> {
        Ok(())
    }

    fn load(&mut self, _: &mut dyn Agent, _: &mut Recorder) -> Result<Option<Value>, Error> {
        Ok(None)
    }

    fn note(&mut self, _: &Recorder) -> Result<(), Error> {
        Ok(())
    }
}

/// For `#[serde(with = "engine::checkpoint::exact")]`: numbers of a state that come back to the bit, also
/// `NaN` and infinities, which JSON does not know. A finite number is written as one, any other as its bits
/// in hexadecimal digits.
pub mod exact {
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};
    use serde_json::Value;
    use std::collections::BTreeMap;

    /// What can be written exactly: a number, a list or a map of such.
    pub trait Exact: Sized {
        /// As JSON.
        fn write(&self) -> Value;
        /// From JSON; `None` where it is something else.
        fn read(value: &Value) -> Option<Self>;
    }

    impl Exact for f64 {
        fn write(&self) -> Value {
            if self.is_finite() {
                (*self).into()
            } else {
                format!("{:016x}", self.to_bits()).into()
            }
        }

        fn read(value: &Value) -> Option<Self> {
            let from_bits = |digits: &str| u64::from_str_radix(digits, 16).ok().map(f64::from_bits);
            value.as_f64().or_else(|| value.as_str().and_then(from_bits))
        }
    }

    impl<T: Exact> Exact for Vec<T> {
        fn write(&self) -> Value {
            self.iter().map(T::write).collect()
        }

        fn read(value: &Value) -> Option<Self> {
            value.as_array()?.iter().map(T::read).collect()
        }
    }

    impl<T: Exact> Exact for BTreeMap<String, T> {
        fn write(&self) -> Value {
            self.iter()
                .map(|(key, value)| (key.clone(), value.write()))
                .collect()
        }

        fn read(value: &Value) -> Option<Self> {
            value
                .as_object()?
                .iter()
                .map(|(key, value)| Some((key.clone(), T::read(value)?)))
                .collect()
        }
    }

    /// Writes a value exactly.
    ///
    /// # Errors
    /// What the serializer says.
    pub fn serialize<T: Exact, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
        value.write().serialize(serializer)
    }

    /// Reads what [`serialize`] wrote.
    ///
    /// # Errors
    /// Where it is something else.
    pub fn deserialize<'de, T: Exact, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
        let value = Value::deserialize(deserializer)?;
        T::read(&value).ok_or_else(|| D::Error::custom(format!("no exact numbers: {value}")))
    }
}

#[cfg(test)]
mod tests {
    use super::exact::Exact;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_come_back_to_the_bit(bits in proptest::collection::vec(any::<u64>(), 0..8)) {
            let special = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.0, 3.0, f64::MIN_POSITIVE / 2.0];
            let values: Vec<f64> = bits.iter().copied().map(f64::from_bits).chain(special).collect();
            let text = values.write().to_string();
            let back = Vec::<f64>::read(&serde_json::from_str(&text).unwrap()).unwrap();
            let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&back), bits(&values));
        }
    }
}
