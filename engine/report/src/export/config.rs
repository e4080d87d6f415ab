//! Every key of the configs of trials as a column: names flattened with dots, values typed.
//!
//! Data files stand under the hash of their content, and artifacts under the trial that leaves them, as in the
//! identity of a trial: no path of a machine leaves with the numbers.

use super::{
    Subject,
    table::{ExportCells, ExportColumn},
};
use contract::{cast::Actors, part::Part, plugin::About, trial::TrialKey};
use document::schema_check::View;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The values of a trial by dotted name, each with the plugin key that describes it.
type Leaves = BTreeMap<String, (Value, KeyOrigin)>;

/// The kind and name of a plugin, and the keys that lead to a value in its config.
#[derive(Debug, Clone, PartialEq)]
struct KeyOrigin {
    kind: &'static str,
    plugin: String,
    keys: Vec<String>,
}

/// One column per key that any trial has; trials without it have an empty cell.
pub(super) fn columns(subject: &Subject<'_>) -> Vec<ExportColumn<'static>> {
    let trials: Vec<Leaves> = subject
        .trials
        .iter()
        .map(|(result, _)| leaves(&result.trial.key))
        .collect();
    let mut names: BTreeMap<&str, &KeyOrigin> = BTreeMap::new();
    for (name, (_, meaning)) in trials.iter().flatten() {
        names.entry(name).or_insert(meaning);
    }
    let column = |(name, meaning): (&str, &KeyOrigin)| {
        let values: Vec<Option<&Value>> = trials
            .iter()
            .map(|leaves| leaves.get(name).map(|(value, _)| value))
            .collect();
        let (about, unit) = meaning.describe(subject);
        ExportColumn::new(name, &about, typed(&values))
            .of_trials()
            .in_unit(&unit)
    };
    names.into_iter().map(column).collect()
}

/// The values of a trial by dotted name.
pub(super) fn values(key: &TrialKey) -> Value {
    let values = leaves(key).into_iter().map(|(name, (value, _))| (name, value));
    Value::Object(values.collect())
}

fn leaves(key: &TrialKey) -> Leaves {
    let mut found = Leaves::new();
    of_part("environment", "environment", &key.environment, &mut found);
    of_part("protocol", "protocol", &key.protocol, &mut found);
    match &*key.agent {
        Actors::Agent(part) => of_part("agent", "agent", part, &mut found),
        Actors::Cast(cast) => {
            for (role, member) in &cast.roles {
                let at = format!("agent.{role}");
                of_part(&at, "agent", &member.agent, &mut found);
                let meaning = KeyOrigin::of("agent", &member.agent.plugin, &[]);
                let mut own = |name: &str, value: Value| {
                    found.insert(format!("{at}.{name}"), (value, meaning.clone()));
                };
                own("seats", json!(member.seats));
                member.trial.iter().for_each(|trial| own("trial", json!(trial)));
            }
        }
    }
    found
}

fn of_part(at: &str, kind: &'static str, part: &Part, found: &mut Leaves) {
    let meaning = KeyOrigin::of(kind, &part.plugin, &[]);
    found.insert(format!("{at}.plugin"), (json!(part.plugin), meaning.clone()));
    found.insert(format!("{at}.version"), (json!(part.version), meaning.clone()));
    for (key, value) in part.identity().as_object().into_iter().flatten() {
        flatten(&format!("{at}.{key}"), value, &meaning.below(key), found);
    }
}

fn flatten(at: &str, value: &Value, meaning: &KeyOrigin, found: &mut Leaves) {
    match value {
        Value::Object(entries) if !entries.is_empty() => {
            for (key, value) in entries {
                flatten(&format!("{at}.{key}"), value, &meaning.below(key), found);
            }
        }
        Value::Null => {}
        value => {
            found.insert(at.to_owned(), (value.clone(), meaning.clone()));
        }
    }
}

impl KeyOrigin {
    fn of(kind: &'static str, plugin: &str, keys: &[&str]) -> Self {
        Self {
            kind,
            plugin: plugin.into(),
            keys: keys.iter().map(ToString::to_string).collect(),
        }
    }

    fn below(&self, key: &str) -> Self {
        let mut below = self.clone();
        below.keys.push(key.into());
        below
    }

    /// Description of the key in the plugin's schema, and its unit.
    fn describe(&self, subject: &Subject<'_>) -> (String, String) {
        let registry = subject.registry;
        let about: Option<&About> = match self.kind {
            "environment" => registry
                .environments
                .get(self.plugin.as_str())
                .map(|it| &it.about),
            "protocol" => registry.protocols.get(self.plugin.as_str()).map(|it| &it.about),
            _ => registry.agents.get(self.plugin.as_str()).map(|it| &it.about),
        };
        let Some(about) = about else {
            return (String::new(), String::new());
        };
        if self.keys.is_empty() {
            return (about.about.to_owned(), String::new());
        }
        let schema = about.schema.as_value();
        let Ok(place) = View::new(schema, schema).descend(&self.keys) else {
            return (String::new(), String::new());
        };
        let word = |keyword: &str| place.get(keyword).and_then(Value::as_str).unwrap_or_default();
        let sentence: Vec<&str> = word("description").split_whitespace().collect();
        (sentence.join(" "), word("x-unit").to_owned())
    }
}

/// The narrowest type that holds all values of a column. Values that are no scalars, or of several types, become
/// text: words as they are, else JSON.
fn typed(values: &[Option<&Value>]) -> ExportCells<'static> {
    fn all<T>(values: &[Option<&Value>], read: impl Fn(&Value) -> Option<T>) -> Option<Vec<Option<T>>> {
        values
            .iter()
            .map(|value| value.map_or(Some(None), |value| read(value).map(Some)))
            .collect()
    }
    let text = |value: &Value| match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    all(values, Value::as_bool)
        .map(ExportCells::Flag)
        .or_else(|| all(values, Value::as_i64).map(ExportCells::Whole))
        .or_else(|| all(values, Value::as_u64).map(ExportCells::Count))
        .or_else(|| all(values, Value::as_f64).map(ExportCells::Number))
        .unwrap_or_else(|| {
            ExportCells::Text(
                values
                    .iter()
                    .map(|value| value.map(|value| text(value).into()))
                    .collect(),
            )
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::{ArtifactKind, artifact::Taken};

    #[test]
    fn a_column_has_the_narrowest_type_of_its_values() {
        let of = |values: &[Value]| typed(&values.iter().map(Some).collect::<Vec<_>>());
        assert_eq!(of(&[json!(true)]), ExportCells::Flag(vec![Some(true)]));
        assert_eq!(
            of(&[json!(1), json!(-2)]),
            ExportCells::Whole(vec![Some(1), Some(-2)])
        );
        assert_eq!(
            of(&[json!(1), json!(u64::MAX)]),
            ExportCells::Count(vec![Some(1), Some(u64::MAX)])
        );
        assert_eq!(
            of(&[json!(1), json!(0.5)]),
            ExportCells::Number(vec![Some(1.0), Some(0.5)])
        );
        assert_eq!(
            of(&[json!(1), json!("auto"), json!([1, 2])]),
            ExportCells::Text(vec![Some("1".into()), Some("auto".into()), Some("[1,2]".into())])
        );
        assert_eq!(
            typed(&[None, Some(&json!(3))]),
            ExportCells::Whole(vec![None, Some(3)])
        );
    }

    #[test]
    fn a_plugin_without_keys_is_known_by_its_name_and_version() {
        let mut found = Leaves::new();
        of_part("agent", "agent", &Part::new("rule", 1, json!({})), &mut found);
        assert_eq!(
            found.keys().collect::<Vec<_>>(),
            ["agent.plugin", "agent.version"]
        );
    }

    #[test]
    fn names_are_dotted_and_paths_and_sources_are_known_by_what_they_are() {
        let mut part = Part::new(
            "learner",
            2,
            json!({"network": {"width": 4, "bias": null}, "load": {"file": "/home/me/load.csv"}, "start": {"from": "sac"}}),
        );
        part.files.insert("/load/file".into(), "0123".into());
        let taken = Taken {
            trial: "abcd".into(),
            kind: ArtifactKind::Networks,
        };
        part.artifacts.insert("/start".into(), taken);
        let mut found = Leaves::new();
        of_part("agent", "agent", &part, &mut found);
        let names: Vec<(&str, String)> = found
            .iter()
            .map(|(name, (value, _))| (name.as_str(), value.to_string()))
            .collect();
        let expected = [
            ("agent.load.file.content", "\"0123\""),
            ("agent.network.width", "4"),
            ("agent.plugin", "\"learner\""),
            ("agent.start.product", "\"networks\""),
            ("agent.start.trial", "\"abcd\""),
            ("agent.version", "2"),
        ];
        assert_eq!(names, expected.map(|(name, value)| (name, value.to_owned())));
    }
}
