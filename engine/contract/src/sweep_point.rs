//! The point of the sweep that a trial belongs to.

use serde_json::Value;
use std::{cmp::Ordering, fmt, sync::Arc};

/// Swept keys with their values, in the order of the sweep; none without a sweep. Its words, `key=value` each,
/// distinguish it from other points.
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
    /// Whether the last word represents the key in words, which requires that no other key of the setting ends with it.
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

/// The keys of one setting that a name refers to, by their places.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum KeyMatch {
    /// No key has the name.
    None,
    /// One key has it.
    One(usize),
    /// Several keys end with it.
    Several(Vec<usize>),
}

impl KeyMatch {
    /// The key with this whole name, or else the only one that ends with this word.
    #[must_use]
    pub fn of<'k>(name: &str, keys: impl Iterator<Item = &'k str> + Clone) -> Self {
        if let Some(place) = keys.clone().position(|key| key == name) {
            return Self::One(place);
        }
        let mut ending = keys
            .enumerate()
            .filter(|(_, key)| last_word(key) == name)
            .map(|(place, _)| place);
        match (ending.next(), ending.next()) {
            (None, _) => Self::None,
            (Some(one), None) => Self::One(one),
            (Some(one), Some(other)) => Self::Several([one, other].into_iter().chain(ending).collect()),
        }
    }
}

impl Default for SweepPoint {
    fn default() -> Self {
        Self::of_words("")
    }
}

impl SweepPoint {
    /// A point known only by its words, without keys and values.
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

    /// The words of [`words`](Self::words), shared.
    #[must_use]
    pub fn into_words(self) -> Arc<str> {
        self.words
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

    fn place(&self, name: &str) -> Option<usize> {
        match KeyMatch::of(name, self.entries.iter().map(|it| &*it.key)) {
            KeyMatch::One(place) => Some(place),
            KeyMatch::None | KeyMatch::Several(_) => None,
        }
    }

    /// The value of the key with this [name](KeyMatch::of); `None` if no key or several keys have it.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Value> {
        Some(&self.entries[self.place(name)?].value)
    }

    /// The same point without the keys that [`get`](Self::get) reads. Other keys keep their words.
    #[must_use]
    pub fn without(&self, names: &[&str]) -> Self {
        let out: Vec<usize> = names.iter().filter_map(|name| self.place(name)).collect();
        if out.is_empty() {
            return self.clone();
        }
        let entries = self.entries.iter().enumerate();
        Self::of(
            entries
                .filter(|(place, _)| !out.contains(place))
                .map(|(_, it)| it.clone()),
        )
    }
}

impl<K: Into<Arc<str>>> FromIterator<(K, Value)> for SweepPoint {
    /// The point with these whole keys; [`names`] decides how each appears in words.
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

/// The names of keys that appear side by side: the last word of each, or the whole key if that word is not unique.
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

/// The words of a setting, `key=value` each. A space inside quotes does not end a word.
pub fn split_words(words: &str) -> impl Iterator<Item = &str> {
    let (mut is_quoted, mut is_escaped) = (false, false);
    words.split(move |sign: char| {
        let is_literal = std::mem::replace(&mut is_escaped, false);
        match sign {
            '\\' if is_quoted => is_escaped = !is_literal,
            '"' if !is_literal => is_quoted = !is_quoted,
            _ => {}
        }
        sign == ' ' && !is_quoted
    })
}

/// A value as a word.
#[must_use]
pub fn word(value: &Value) -> String {
    match value {
        Value::String(text) if !text.is_empty() && !text.contains([' ', '=', '"']) => text.clone(),
        other => other.to_string(),
    }
}

/// The word of a value that is written as its word or as JSON: `1e-3` and `0.001` are the same number, `fast` and
/// `"fast"` the same text.
#[must_use]
pub fn as_word(text: &str) -> String {
    serde_json::from_str(text).map_or_else(|_| text.to_owned(), |value| word(&value))
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
            assert_eq!(point().get(name), Some(&json!(1e-4)));
        }
        for name in ["ate", "sac.rate", "dsac", ""] {
            assert_eq!(point().get(name), None);
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
        let keys = ["dsac.rate", "load", "plant.rate"];
        assert_eq!(
            KeyMatch::of("rate", keys.into_iter()),
            KeyMatch::Several(vec![0, 2])
        );
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
    fn a_value_has_one_word_in_whichever_form_it_is_written() {
        for (written, meant) in [
            ("1e-3", "0.001"),
            ("0.0010", "0.001"),
            ("16", "16"),
            ("fast", "fast"),
            (r#""fast""#, "fast"),
            (r#""a b""#, r#""a b""#),
            (r#"{"watts": [8]}"#, r#"{"watts":[8]}"#),
            ("1.", "1."),
        ] {
            assert_eq!((as_word(written), as_word(meant)), (meant.into(), meant.into()));
        }
    }

    #[test]
    fn it_is_written_as_words() {
        assert_eq!(point().to_string(), r#"rate=0.0001 cells=4 load="a b=c""#);
        let quoted: SweepPoint = [
            ("a", json!(r#"say "x y" \"#)),
            ("b", json!(["p q", 1])),
            ("c", json!("z")),
        ]
        .into_iter()
        .collect();
        let words: Vec<&str> = split_words(quoted.words()).collect();
        assert_eq!(words, [r#"a="say \"x y\" \\""#, r#"b=["p q",1]"#, "c=z"]);
    }
}
