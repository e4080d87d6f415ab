//! The keys of two resolved studies that differ.

use super::Setting;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// Every leaf of a study by its dotted key. A list without mappings is one value; claims are named by their words, so
/// that one more claim moves none of the others.
#[must_use]
pub fn flat(study: &Value) -> BTreeMap<String, Value> {
    let mut leaves = BTreeMap::new();
    gather(String::new(), study, &mut leaves);
    leaves
}

fn gather(key: String, value: &Value, leaves: &mut BTreeMap<String, Value>) {
    match value {
        Value::Object(map) if !map.is_empty() => {
            for (name, value) in map {
                let below = if key.is_empty() {
                    name.clone()
                } else {
                    format!("{key}.{name}")
                };
                gather(below, value, leaves);
            }
        }
        Value::Array(items) if items.iter().any(Value::is_object) => {
            for (place, item) in items.iter().enumerate() {
                let claim = item.get("claim").and_then(Value::as_str);
                let by_words = claim.map(|claim| format!("{key}[{claim}]"));
                let free = by_words.filter(|name| !leaves.contains_key(&format!("{name}.claim")));
                gather(free.unwrap_or_else(|| format!("{key}[{place}]")), item, leaves);
            }
        }
        leaf => drop(leaves.insert(key, leaf.clone())),
    }
}

/// The keys that differ, in their order.
pub(super) fn differing(a: &BTreeMap<String, Value>, b: &BTreeMap<String, Value>) -> Vec<Setting> {
    let keys: BTreeMap<&String, ()> = a.keys().chain(b.keys()).map(|key| (key, ())).collect();
    let pairs = keys.into_keys().map(|key| (key, a.get(key), b.get(key)));
    pairs
        .filter(|(_, first, second)| !is_equal(*first, *second))
        .map(|(key, first, second)| Setting {
            key: key.clone(),
            a: first.cloned(),
            b: second.cloned(),
        })
        .collect()
}

/// Sections of a study that determine the results of its trials.
const OF_TRIALS: [&str; 8] = [
    "environments",
    "agents",
    "protocol",
    "prepare",
    "sweep",
    "overrides",
    "cross_play",
    "tune",
];

/// The keys of the trials whose values differ now. A key in the present study alone is skipped: it is a newer option
/// with its default, or replaces keys that are listed themselves.
#[must_use]
pub fn changed_keys(before: &Value, now: &Value) -> Vec<String> {
    let of_trials = |key: &str| {
        let section = key.split('.').next().unwrap_or(key);
        OF_TRIALS.contains(&section)
    };
    let differing = differing(&flat(before), &flat(now)).into_iter();
    let changed = differing.filter(|it| {
        let (Some(before), now) = (&it.a, &it.b) else {
            return false;
        };
        of_trials(&it.key) && !now.as_ref().is_some_and(|now| is_same_file(before, now))
    });
    changed.map(|it| it.key).collect()
}

/// Whether two paths name the same file from two folders.
fn is_same_file(a: &Value, b: &Value) -> bool {
    let name = |value: &Value| {
        let (_, name) = value.as_str()?.rsplit_once('/')?;
        Some(name.to_owned())
    };
    name(a).is_some() && name(a) == name(b)
}

/// Whether two settings are equal: `1` and `1.0` are one number, and an empty list or mapping equals an absent
/// setting.
fn is_equal(a: Option<&Value>, b: Option<&Value>) -> bool {
    let is_nothing = |value: Option<&Value>| {
        value.is_none_or(|value| *value == Value::Array(Vec::new()) || *value == Value::Object(Map::new()))
    };
    match (a, b) {
        (Some(Value::Number(first)), Some(Value::Number(second))) => {
            first == second || first.as_f64().map(f64::to_bits) == second.as_f64().map(f64::to_bits)
        }
        (first, second) => first == second || is_nothing(first) && is_nothing(second),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn keys(a: &Value, b: &Value) -> Vec<String> {
        differing(&flat(a), &flat(b))
            .into_iter()
            .map(|setting| setting.key)
            .collect()
    }

    #[test]
    fn leaves_have_dotted_keys() {
        let a =
            json!({"agents": {"x": {"sac": {"discount": 0.9, "layers": [1, 2]}}}, "seeds": 5, "sweep": {}});
        let b = json!({"agents": {"x": {"sac": {"discount": 0.99, "layers": [1, 3]}}, "y": {"rule": {"on": 1}}},
            "seeds": 5.0});
        assert_eq!(
            keys(&a, &b),
            ["agents.x.sac.discount", "agents.x.sac.layers", "agents.y.rule.on"]
        );
        assert_eq!(differing(&flat(&a), &flat(&b))[2].a, None);
    }

    #[test]
    fn trials_are_told_by_what_determines_them_and_newer_options_are_none_of_it() {
        let study = |agent: &Value, file: &str| {
            json!({"agents": {"x": agent}, "environments": {"e": {"file": file}}, "claims": [{"claim": file}],
                "seeds": [1, 2]})
        };
        let before = study(&json!({"rate": 0.1, "old": 1}), "../data/a.csv");
        let newer = study(&json!({"rate": 0.1, "old": 1, "new": 2}), "../../data/a.csv");
        assert_eq!(changed_keys(&before, &newer), [""; 0]);
        let other = study(&json!({"rate": 0.2}), "../data/b.csv");
        assert_eq!(
            changed_keys(&before, &other),
            ["agents.x.old", "agents.x.rate", "environments.e.file"]
        );
    }

    #[test]
    fn one_more_claim_moves_none_of_the_others() {
        let claim = |words: &str| json!({"claim": words, "about": "x"});
        let a = json!({"claims": [claim("p > q"), claim("r > s")]});
        let b = json!({"claims": [claim("new"), claim("p > q"), claim("r > s")]});
        assert_eq!(keys(&a, &b), ["claims[new].about", "claims[new].claim"]);
        let twice = json!({"claims": [claim("p > q"), claim("p > q")]});
        assert_eq!(keys(&twice, &twice).len(), 0);
        assert_eq!(flat(&twice).len(), 4);
    }
}
