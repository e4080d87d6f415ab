//! The point of a sweep at which a trial stands.

use serde_json::Value;
use std::{cmp::Ordering, fmt, sync::Arc};

/// Swept keys with their values, in the order of the sweep; none without a sweep. It is told from other points by its
/// words, `key=value` each.
#[derive(Debug, Clone)]
pub struct SweepPoint {
    words: Arc<str>,
    entries: Arc<[Entry]>,
}

/// A swept key with its value.
#[derive(Debug, Clone)]
struct Entry {
    /// The whole key, as in `sweep`.
    key: Arc<str>,
    /// Whether the last word stands for the key in words: no other key of the setting ends with it.
    is_short: bool,
    value: Value,
}

impl Entry {
    fn shown(&self) -> &str {
        if self.is_short {
            last_word(&self.key)
        } else {
            &self.key
        }
    }
}

/// The swept keys of a setting that a name stands for.
#[derive(Debug, Clone, PartialEq)]
pub enum Found<'a> {
    /// No key has the name.
    None,
    /// The whole key, and its value.
    One(&'a str, &'a Value),
    /// The whole keys that end with the name.
    Several(Vec<&'a str>),
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
            entries: Arc::new([]),
        }
    }

    fn of(entries: impl Iterator<Item = Entry>) -> Self {
        let entries: Arc<[Entry]> = entries.collect();
        let words: Vec<String> = entries
            .iter()
            .map(|it| format!("{}={}", it.shown(), word(&it.value)))
            .collect();
        Self {
            words: words.join(" ").into(),
            entries,
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
        self.entries.iter().map(|it| &it.value).collect()
    }

    /// The key that is called so: the one whose whole name this is, else the only one that ends with this word.
    #[must_use]
    pub fn find(&self, name: &str) -> Found<'_> {
        let exact = self.entries.iter().filter(|it| &*it.key == name);
        let ending = self.entries.iter().filter(|it| last_word(&it.key) == name);
        let called: Vec<&Entry> = exact.chain(ending).collect();
        match called[..] {
            [] => Found::None,
            [one, ..] if called.len() == 1 || &*one.key == name => Found::One(&one.key, &one.value),
            _ => Found::Several(called.iter().map(|it| &*it.key).collect()),
        }
    }

    /// The value of the key that is called so; `None` where the name is that of no key or of several.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Value> {
        match self.find(name) {
            Found::One(_, value) => Some(value),
            Found::None | Found::Several(_) => None,
        }
    }

    /// The same point without the keys that [`get`](Self::get) reads. Other keys keep their words.
    #[must_use]
    pub fn without(&self, names: &[&str]) -> Self {
        let key = |name: &&str| match self.find(name) {
            Found::One(key, _) => Some(key),
            Found::None | Found::Several(_) => None,
        };
        let out: Vec<&str> = names.iter().filter_map(key).collect();
        if out.is_empty() {
            return self.clone();
        }
        Self::of(self.entries.iter().filter(|it| !out.contains(&&*it.key)).cloned())
    }
}

impl<K: Into<Arc<str>>> FromIterator<(K, Value)> for SweepPoint {
    /// The point with these whole keys, each of which stands in words as [`names`] calls it.
    fn from_iter<T: IntoIterator<Item = (K, Value)>>(values: T) -> Self {
        let (keys, values): (Vec<Arc<str>>, Vec<Value>) =
            values.into_iter().map(|(key, value)| (key.into(), value)).unzip();
        let whole: Vec<&str> = keys.iter().map(|key| &**key).collect();
        let named = keys.iter().zip(names(&whole)).zip(values);
        Self::of(named.map(|((key, name), value)| Entry {
            key: Arc::clone(key),
            is_short: name != &**key,
            value,
        }))
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
            ("plant.cells", json!(4)),
            ("load", json!("a b=c")),
        ];
        values.into_iter().collect()
    }

    #[test]
    fn a_key_is_found_by_its_whole_name_and_its_last_word() {
        for name in ["rate", "dsac.rate"] {
            assert_eq!(point().find(name), Found::One("dsac.rate", &json!(1e-4)));
        }
        for name in ["ate", "sac.rate", "dsac", ""] {
            assert_eq!((point().find(name), point().get(name)), (Found::None, None));
            assert_eq!(point().without(&[name]), point());
        }
        assert_eq!(SweepPoint::of_words("rate=1").get("rate"), None);
        assert_eq!(point().without(&["rate"]).words(), r#"cells=4 load="a b=c""#);
    }

    #[test]
    fn a_last_word_that_two_keys_share_is_the_name_of_neither() {
        let both: SweepPoint = [("dsac.rate", json!(1)), ("plant.rate", json!(2))]
            .into_iter()
            .collect();
        assert_eq!(both.words(), "dsac.rate=1 plant.rate=2");
        assert_eq!(both.find("rate"), Found::Several(vec!["dsac.rate", "plant.rate"]));
        assert_eq!(
            (both.get("rate"), both.without(&["rate"]).words()),
            (None, both.words())
        );
        assert_eq!(both.get("plant.rate"), Some(&json!(2)));
        assert_eq!(both.without(&["plant.rate"]).words(), "dsac.rate=1");
        assert_eq!(both.without(&["plant.rate", "rate"]).words(), "dsac.rate=1");
    }

    #[test]
    fn keys_side_by_side_have_their_last_words_as_far_as_these_tell_them_apart() {
        let keys = ["dsac.rate", "plant.cells", "sac.rate"];
        assert_eq!(names(&keys), ["dsac.rate", "cells", "sac.rate"]);
        assert_eq!(names(&keys[..2]), ["rate", "cells"]);
    }

    #[test]
    fn it_is_written_as_words() {
        assert_eq!(point().to_string(), r#"rate=0.0001 cells=4 load="a b=c""#);
    }
}
