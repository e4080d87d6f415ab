//! The point of a sweep at which a trial stands.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{fmt, sync::Arc};

/// Swept keys with their values, in the order of the sweep; none without a sweep. Its display is `key=value`
/// words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "Vec<(String, Value)>", into = "Vec<(String, Value)>")]
pub struct Setting(Arc<[(Arc<str>, Value)]>);

impl Default for Setting {
    fn default() -> Self {
        Self::from_iter([])
    }
}

impl Setting {
    /// The point with these keys and values, in this order.
    #[must_use]
    pub fn new(values: Vec<(String, Value)>) -> Self {
        values
            .into_iter()
            .map(|(key, value)| (key.into(), value))
            .collect()
    }

    /// Whether the point has no keys: there is no sweep.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The values, in the order of the keys.
    #[must_use]
    pub fn values(&self) -> Vec<&Value> {
        self.0.iter().map(|(_, value)| value).collect()
    }

    /// The value of a key, which may be given with its last word alone, as it may stand here.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&Value> {
        self.0
            .iter()
            .find(|(name, _)| is_called(name, key))
            .map(|(_, value)| value)
    }

    /// The same point without a key.
    #[must_use]
    pub fn without(&self, key: &str) -> Self {
        self.0
            .iter()
            .filter(|(name, _)| !is_called(name, key))
            .cloned()
            .collect()
    }
}

impl FromIterator<(Arc<str>, Value)> for Setting {
    fn from_iter<T: IntoIterator<Item = (Arc<str>, Value)>>(values: T) -> Self {
        Self(values.into_iter().collect())
    }
}

impl From<Vec<(String, Value)>> for Setting {
    fn from(values: Vec<(String, Value)>) -> Self {
        Self::new(values)
    }
}

impl From<Setting> for Vec<(String, Value)> {
    fn from(setting: Setting) -> Self {
        let own = |(key, value): &(Arc<str>, Value)| (key.to_string(), value.clone());
        setting.0.iter().map(own).collect()
    }
}

fn is_called(name: &str, key: &str) -> bool {
    let last = |text: &str| text.rsplit('.').next().unwrap_or_default().to_owned();
    name == key || last(name) == key || name == last(key)
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (key, value)) in self.0.iter().enumerate() {
            let space = if index > 0 { " " } else { "" };
            write!(f, "{space}{key}={}", word(value))?;
        }
        Ok(())
    }
}

/// A value as a word.
#[must_use]
pub fn word(value: &Value) -> String {
    match value {
        Value::String(text) if !text.is_empty() && !text.contains([' ', '=', '"']) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn point() -> Setting {
        let values = [
            ("dsac.rate", json!(1e-4)),
            ("cells", json!(4)),
            ("load", json!("a b=c")),
        ];
        Setting::new(values.map(|(key, value)| (key.to_owned(), value)).into())
    }

    #[test]
    fn a_key_is_found_by_its_last_word() {
        assert_eq!(
            (point().get("rate"), point().get("dsac.rate")),
            (Some(&json!(1e-4)), Some(&json!(1e-4)))
        );
        assert_eq!(point().get("plant.cells"), Some(&json!(4)));
        let unknown = [
            point().get("ate").cloned(),
            point().get("sac.rate").cloned(),
            Setting::default().get("rate").cloned(),
        ];
        assert_eq!(unknown, [None, None, None]);
        assert_eq!(point().without("rate").to_string(), r#"cells=4 load="a b=c""#);
    }

    #[test]
    fn it_is_written_as_words_and_stored_with_its_values() {
        assert_eq!(point().to_string(), r#"dsac.rate=0.0001 cells=4 load="a b=c""#);
        assert_eq!(
            serde_json::from_value::<Setting>(json!(point())).unwrap(),
            point()
        );
    }
}
