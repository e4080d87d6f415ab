//! The point of a sweep at which a trial stands.

use serde_json::Value;
use std::{cmp::Ordering, fmt, sync::Arc};

/// Swept keys with their values, in the order of the sweep; none without a sweep. It is told from other points by its
/// words, `key=value` each.
#[derive(Debug, Clone)]
pub struct SweepPoint {
    words: Arc<str>,
    values: Arc<[(Arc<str>, Value)]>,
}

impl Default for SweepPoint {
    fn default() -> Self {
        Self::of_words("")
    }
}

impl SweepPoint {
    /// A point of which the words alone are known.
    #[must_use]
    pub fn of_words(words: impl Into<Arc<str>>) -> Self {
        Self {
            words: words.into(),
            values: Arc::new([]),
        }
    }

    /// The keys and values as `key=value` words; empty without a sweep.
    #[must_use]
    pub fn words(&self) -> &str {
        &self.words
    }

    /// Whether the point has no keys: there is no sweep.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// The values, in the order of the keys.
    #[must_use]
    pub fn values(&self) -> Vec<&Value> {
        self.values.iter().map(|(_, value)| value).collect()
    }

    /// The value of a key, which may be given with its last word alone, as it may stand here.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&Value> {
        self.values
            .iter()
            .find(|(name, _)| is_called(name, key))
            .map(|(_, value)| value)
    }

    /// The same point without a key.
    #[must_use]
    pub fn without(&self, key: &str) -> Self {
        self.values
            .iter()
            .filter(|(name, _)| !is_called(name, key))
            .cloned()
            .collect()
    }
}

impl<K: Into<Arc<str>>> FromIterator<(K, Value)> for SweepPoint {
    fn from_iter<T: IntoIterator<Item = (K, Value)>>(values: T) -> Self {
        let values = values.into_iter().map(|(key, value)| (key.into(), value));
        let values: Arc<[(Arc<str>, Value)]> = values.collect();
        let words: Vec<String> = values
            .iter()
            .map(|(key, value)| format!("{key}={}", word(value)))
            .collect();
        Self {
            words: words.join(" ").into(),
            values,
        }
    }
}

impl PartialEq for SweepPoint {
    fn eq(&self, other: &Self) -> bool {
        self.words == other.words
    }
}

impl Eq for SweepPoint {}

impl PartialOrd for SweepPoint {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for SweepPoint {
    fn cmp(&self, other: &Self) -> Ordering {
        self.words.cmp(&other.words)
    }
}

/// Whether a swept key has this name: of both, the last word alone may be given.
#[must_use]
pub fn is_called(key: &str, name: &str) -> bool {
    key == name || last_word(key) == name || key == last_word(name)
}

/// The last word of a dotted key.
#[must_use]
pub fn last_word(key: &str) -> &str {
    key.rsplit('.').next().unwrap_or_default()
}

/// The names of keys that stand side by side: each its last word, or the whole key where that is not unique.
#[must_use]
pub fn names<'a>(keys: &[&'a str]) -> Vec<&'a str> {
    let is_unique = |word: &str| keys.iter().filter(|key| last_word(key) == word).count() == 1;
    let name = |key: &&'a str| Some(last_word(key)).filter(|word| is_unique(word)).unwrap_or(key);
    keys.iter().map(name).collect()
}

impl fmt::Display for SweepPoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.words)
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

    fn point() -> SweepPoint {
        let values = [
            ("dsac.rate", json!(1e-4)),
            ("cells", json!(4)),
            ("load", json!("a b=c")),
        ];
        values.into_iter().collect()
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
            SweepPoint::default().get("rate").cloned(),
        ];
        assert_eq!(unknown, [None, None, None]);
        assert_eq!(point().without("rate").words(), r#"cells=4 load="a b=c""#);
    }

    #[test]
    fn keys_side_by_side_have_their_last_words_as_far_as_these_tell_them_apart() {
        let keys = ["dsac.rate", "plant.cells", "sac.rate"];
        assert_eq!(names(&keys), ["dsac.rate", "cells", "sac.rate"]);
        assert_eq!(names(&keys[..2]), ["rate", "cells"]);
    }

    #[test]
    fn it_is_written_as_words() {
        assert_eq!(point().to_string(), r#"dsac.rate=0.0001 cells=4 load="a b=c""#);
    }
}
