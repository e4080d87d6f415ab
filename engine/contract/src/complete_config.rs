//! Complete configs of plugins. A study may have a million of them that differ in a few values; each holds only its
//! differences from a common one.

use crate::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::DeserializeOwned};
use serde_json::Value;
use std::{
    any::Any,
    borrow::Cow,
    ops::{Deref, DerefMut},
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
    /// The whole config, computed on the first request.
    whole: OnceLock<Box<Value>>,
    /// The plugin's own struct, read from the config on the first request.
    typed: OnceLock<Box<dyn Any + Send + Sync>>,
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
    /// A config from the plugin's own struct.
    ///
    /// # Errors
    /// Maps whose keys are no strings.
    pub fn of<C: Serialize + Any + Send + Sync>(config: C) -> Result<Self, serde_json::Error> {
        let made = Self::from(serde_json::to_value(&config)?);
        made.0.typed.get_or_init(|| Box::new(config));
        Ok(made)
    }

    /// A complete config from one that is given: the plugin's own struct is read from it, with its defaults.
    ///
    /// # Errors
    /// A config that does not fit the struct.
    pub fn read<C: Serialize + DeserializeOwned + Any + Send + Sync>(
        given: &Value,
    ) -> Result<Self, serde_json::Error> {
        Self::of(C::deserialize(given)?)
    }

    /// The plugin's own struct, to build the plugin with.
    ///
    /// # Errors
    /// [`Error::Config`] where the config does not fit the struct.
    pub fn expected<C: DeserializeOwned + Clone + Any + Send + Sync>(&self) -> Result<C, Error> {
        self.typed()
            .map_err(|source| Error::config("config", source.to_string()))
    }

    /// The plugin's own struct. It is read once for all clones, unless plugins of several types read one config.
    ///
    /// # Errors
    /// A config that does not fit the struct.
    pub fn typed<C: DeserializeOwned + Clone + Any + Send + Sync>(&self) -> Result<C, serde_json::Error> {
        if let Some(known) = self.0.typed.get().and_then(|it| it.downcast_ref::<C>()) {
            return Ok(known.clone());
        }
        let config = C::deserialize(&*self.whole())?;
        self.0.typed.get_or_init(|| Box::new(config.clone()));
        Ok(config)
    }

    /// The config `base` with some changes.
    #[must_use]
    pub fn changed(base: &Self, changes: Box<[Arc<Change>]>) -> Self {
        let base = match &*base.0 {
            ConfigLayers { base, changes, .. } if changes.is_empty() => Arc::clone(base),
            _ => Arc::new(Value::clone(base)),
        };
        Self::layered(base, changes)
    }

    fn layered(base: Arc<Value>, changes: Box<[Arc<Change>]>) -> Self {
        Self(Arc::new(ConfigLayers {
            base,
            changes,
            whole: OnceLock::new(),
            typed: OnceLock::new(),
        }))
    }

    /// Stores the config as its changes to `base`; the struct that it was read as is kept.
    pub fn rebase(&mut self, base: &Self, changes: Box<[Arc<Change>]>) {
        let mut rebased = Self::changed(base, changes);
        // A config that is shared with others is read again.
        if let (Some(new), Some(old)) = (Arc::get_mut(&mut rebased.0), Arc::get_mut(&mut self.0)) {
            new.typed = std::mem::take(&mut old.typed);
        }
        *self = rebased;
    }

    /// The config for a single read; unlike with [`Deref`], the whole is not kept.
    #[must_use]
    pub fn whole(&self) -> Cow<'_, Value> {
        let form = &*self.0;
        match form.whole.get() {
            _ if form.changes.is_empty() => Cow::Borrowed(&form.base),
            Some(whole) => Cow::Borrowed(whole),
            None => Cow::Owned(form.written_out()),
        }
    }

    /// Whether both share one place in memory.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }

    /// Address that distinguishes the config from all others in memory.
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

impl DerefMut for CompleteConfig {
    /// The config, for modification; configs that share it do not change.
    fn deref_mut(&mut self) -> &mut Value {
        let is_plain = self.0.changes.is_empty() && Arc::strong_count(&self.0.base) == 1;
        if !is_plain || Arc::get_mut(&mut self.0).is_none() {
            *self = Self::from(Value::clone(self));
        }
        // A new config is not shared.
        let form = Arc::get_mut(&mut self.0).expect("not shared");
        form.typed = OnceLock::new();
        Arc::get_mut(&mut form.base).expect("not shared")
    }
}

impl From<Value> for CompleteConfig {
    fn from(value: Value) -> Self {
        Self::layered(Arc::new(value), Box::default())
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
    use std::sync::atomic::{AtomicUsize, Ordering};

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
            *config = json!(7);
            prop_assert_eq!((&*config, &*shared), (&json!(7), &value));
        }
    }

    #[derive(Clone, Serialize, Deserialize)]
    struct Plain {
        rate: f64,
    }

    static READ: AtomicUsize = AtomicUsize::new(0);

    /// Counts the number of times that it is read.
    #[derive(Clone, Serialize, Deserialize)]
    #[serde(from = "Plain")]
    struct Counted {
        rate: f64,
    }

    impl From<Plain> for Counted {
        fn from(plain: Plain) -> Self {
            READ.fetch_add(1, Ordering::Relaxed);
            Self { rate: plain.rate }
        }
    }

    #[test]
    fn a_config_is_read_once_for_everything_that_is_built_from_it() {
        let read = |config: &CompleteConfig| {
            let rate = config.typed::<Counted>().unwrap().rate;
            (rate, READ.load(Ordering::Relaxed))
        };
        let made = CompleteConfig::of(Counted { rate: 1.0 }).unwrap();
        assert_eq!((read(&made), read(&made.clone())), ((1.0, 0), (1.0, 0)));
        let mut stored = CompleteConfig::from(json!({ "rate": 2.0 }));
        assert_eq!((read(&stored), read(&stored.clone())), ((2.0, 1), (2.0, 1)));
        let differs = changes(&made, &stored).into_iter().map(Arc::new).collect();
        stored.rebase(&made, differs);
        assert_eq!((read(&stored), &*stored), ((2.0, 1), &json!({ "rate": 2.0 })));
        // A change is read again, and other structs read the same config.
        stored["rate"] = json!(3.0);
        assert_eq!((read(&stored), read(&made)), ((3.0, 2), (1.0, 2)));
        assert_eq!(made.typed::<Plain>().unwrap().rate, 1.0);
        assert!(CompleteConfig::from(json!({})).typed::<Plain>().is_err());
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
