//! Complete configs of plugins. A study may have a million of them that differ in a few values: each holds only its
//! differences from a common one.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;
use std::{
    borrow::Cow,
    ops::Deref,
    sync::{Arc, OnceLock},
};

/// A config with every default filled in; clones share it.
#[derive(Debug, Clone)]
pub struct CompleteConfig(Arc<ConfigLayers>);

#[derive(Debug)]
struct ConfigLayers {
    /// The config without the changes.
    base: Arc<Value>,
    changes: Box<[Arc<Change>]>,
    /// The whole config, once it was asked for.
    whole: OnceLock<Box<Value>>,
}

impl ConfigLayers {
    fn written_out(&self) -> Value {
        let mut whole = Value::clone(&self.base);
        for change in &self.changes {
            if let Some(place) = whole.pointer_mut(&change.pointer) {
                *place = change.value.clone();
            }
        }
        whole
    }
}

/// A value that differs from that of a common config.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// JSON pointer to the value.
    pub pointer: String,
    /// The changed value.
    pub value: Value,
}

impl CompleteConfig {
    /// The config `base` with some changes.
    #[must_use]
    pub fn changed(base: &Self, changes: Box<[Arc<Change>]>) -> Self {
        let base = match &*base.0 {
            ConfigLayers { base, changes, .. } if changes.is_empty() => Arc::clone(base),
            _ => Arc::new(Value::clone(base)),
        };
        let whole = OnceLock::new();
        Self(Arc::new(ConfigLayers { base, changes, whole }))
    }

    /// The config, to be changed; configs that share it stay as they are.
    pub fn make_mut(&mut self) -> &mut Value {
        let is_plain = self.0.changes.is_empty() && Arc::strong_count(&self.0.base) == 1;
        if !is_plain || Arc::get_mut(&mut self.0).is_none() {
            *self = Self::from(Value::clone(self));
        }
        // A config that was just made shares nothing.
        let form = Arc::get_mut(&mut self.0).expect("not shared");
        Arc::get_mut(&mut form.base).expect("not shared")
    }

    /// The config for one look at it: unlike by [`Deref`], the whole is not kept.
    #[must_use]
    pub fn whole(&self) -> Cow<'_, Value> {
        let form = &*self.0;
        match form.whole.get() {
            _ if form.changes.is_empty() => Cow::Borrowed(&form.base),
            Some(whole) => Cow::Borrowed(whole),
            None => Cow::Owned(form.written_out()),
        }
    }

    /// Whether both are one in memory.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// Address that tells the config from all others in memory.
    #[must_use]
    pub fn address(&self) -> usize {
        Arc::as_ptr(&self.0).addr()
    }
}

impl Deref for CompleteConfig {
    type Target = Value;

    fn deref(&self) -> &Value {
        let form = &*self.0;
        if form.changes.is_empty() {
            return &form.base;
        }
        form.whole.get_or_init(|| Box::new(form.written_out()))
    }
}

impl From<Value> for CompleteConfig {
    fn from(value: Value) -> Self {
        Self(Arc::new(ConfigLayers {
            base: Arc::new(value),
            changes: Box::default(),
            whole: OnceLock::new(),
        }))
    }
}

impl PartialEq for CompleteConfig {
    fn eq(&self, other: &Self) -> bool {
        self.is_same(other) || **self == **other
    }
}

impl Serialize for CompleteConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Value::serialize(self, serializer)
    }
}

impl<'de> Deserialize<'de> for CompleteConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Value::deserialize(deserializer).map(Self::from)
    }
}

/// The changes that turn `base` into `value`.
#[must_use]
pub fn changes(base: &Value, value: &Value) -> Vec<Change> {
    let mut found = Vec::new();
    compare(base, value, &mut String::new(), &mut found);
    found
}

fn compare(base: &Value, value: &Value, at: &mut String, found: &mut Vec<Change>) {
    if base == value {
        return;
    }
    match (base, value) {
        (Value::Object(one), Value::Object(other))
            if one.len() == other.len() && one.keys().eq(other.keys()) =>
        {
            let differ = one
                .iter()
                .zip(other.values())
                .filter(|((_, one), other)| one != other);
            for ((key, one), other) in differ {
                let length = at.len();
                at.push('/');
                at.push_str(&key.replace('~', "~0").replace('/', "~1"));
                compare(one, other, at, found);
                at.truncate(length);
            }
        }
        _ => found.push(Change {
            pointer: at.clone(),
            value: value.clone(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    fn any_value() -> impl Strategy<Value = Value> {
        let leaf = prop_oneof![
            Just(Value::Null),
            any::<i64>().prop_map(|it| json!(it)),
            (-1e9..1e9f64).prop_map(|it| json!(it)),
            "[a-z]{0,3}".prop_map(|it| json!(it)),
        ];
        leaf.prop_recursive(3, 24, 4, |inner| {
            prop_oneof![
                prop::collection::vec(inner.clone(), 0..4).prop_map(Value::Array),
                prop::collection::btree_map("[a-c/~]{1,2}", inner, 0..4)
                    .prop_map(|map| Value::Object(map.into_iter().collect())),
            ]
        })
    }

    proptest! {
        #[test]
        fn a_base_and_its_changes_are_the_whole(base in any_value(), value in any_value()) {
            let changes = changes(&base, &value).into_iter().map(Arc::new).collect();
            let mut config = CompleteConfig::changed(&CompleteConfig::from(base.clone()), changes);
            prop_assert_eq!(&*config, &value);
            prop_assert_eq!(json!(config), value.clone());
            let shared = config.clone();
            *config.make_mut() = json!(7);
            prop_assert_eq!((&*config, &*shared), (&json!(7), &value));
        }
    }

    #[test]
    fn what_differs_is_all_that_is_held() {
        let base = json!({ "rate": 0.1, "net": { "width": 8, "layers": [1, 2] } });
        let mut value = base.clone();
        value["net"]["width"] = json!(16);
        let found = changes(&base, &value);
        assert_eq!((found.len(), found[0].pointer.as_str()), (1, "/net/width"));
        assert!(changes(&base, &base).is_empty());
    }
}
