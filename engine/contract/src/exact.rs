//! Numbers that are read back from JSON bit by bit, including `NaN` and infinities, which JSON lacks: for `#[serde(with
//! = "contract::exact")]`. A finite number is written as a number, any other as its bits in hexadecimal digits.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};
use serde_json::Value;
use std::collections::BTreeMap;

/// A value that can be written exactly: a number, or a list or map of numbers.
pub trait Exact: Sized {
    /// The value as JSON.
    fn write(&self) -> Value;
    /// The value from JSON; `None` if it is of another kind.
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
/// Errors of the serializer.
pub fn serialize<T: Exact, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    value.write().serialize(serializer)
}

/// Reads a value that [`serialize`] wrote.
///
/// # Errors
/// The value is of another kind.
pub fn deserialize<'de, T: Exact, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    let value = Value::deserialize(deserializer)?;
    T::read(&value).ok_or_else(|| D::Error::custom(format!("no exact numbers: {value}")))
}

#[cfg(test)]
mod tests {
    use super::Exact;
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
