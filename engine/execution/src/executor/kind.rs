//! The list of executors: the name and description of each, and the form of its table in `regimen.toml`.

use super::{Error, Executor, OWN};
use contract::Registry;
use schemars::{JsonSchema, Schema};
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;
use toml::de::ValueDeserializer;

/// Name that means no executor: worker processes on this machine.
pub const LOCAL: &str = "local";

/// One entry of the list.
pub struct ExecutorKind {
    /// Name of the executor as written after `--executor`; its options stand in the table of that name.
    pub name: &'static str,
    /// Name of the executor in sentences.
    pub title: &'static str,
    /// One line about the executor, for its list.
    pub about: &'static str,
    /// Way in which its workers are started.
    pub way: Way,
}

/// Way in which workers are started.
pub enum Way {
    /// This program starts them itself.
    Here,
    /// This program starts them itself, on hosts that it reaches.
    Hosts(ExecutorOptions),
    /// A queue takes them, and the program can wait for them.
    Queue(ExecutorOptions),
    /// The user submits the printed text, with a command that reads it from standard input.
    Written(ExecutorOptions, &'static str),
}

/// The options of an executor. Their type is erased once, so that settings and records hold those of any executor.
pub struct ExecutorOptions {
    /// JSON Schema of the table.
    pub schema: Schema,
    read: OptionsParser,
    build: ExecutorFactory,
}

type OptionsParser = Box<dyn Fn(ValueDeserializer<'_>) -> Result<Value, toml::de::Error>>;
type ExecutorFactory = Box<dyn Fn(&Value) -> Result<Box<dyn Executor>, Error>>;

/// Registration of executors.
pub trait RegisterExecutor {
    /// Registers an executor by the function that makes its entry.
    ///
    /// # Panics
    /// If the name is taken: a mistake in the program, found by every test.
    fn executor(&mut self, kind: fn() -> ExecutorKind);
}

/// An executor of another crate.
struct Registered(fn() -> ExecutorKind);

impl RegisterExecutor for Registry {
    fn executor(&mut self, kind: fn() -> ExecutorKind) {
        let name = kind().name;
        assert!(
            find(self, name).is_none(),
            "the executor `{name}` is registered twice"
        );
        self.extend(Registered(kind));
    }
}

/// All executors, in the order in which they are shown: those of the engine, and those that other crates registered.
#[must_use]
pub fn all(registry: &Registry) -> Vec<ExecutorKind> {
    let others = registry.extensions::<Registered>().map(|it| it.0);
    OWN.iter().copied().chain(others).map(|kind| kind()).collect()
}

/// Entry of the worker processes on this machine.
pub(super) fn local() -> ExecutorKind {
    ExecutorKind {
        name: LOCAL,
        title: "this machine",
        about: "worker processes on this machine",
        way: Way::Here,
    }
}

/// The executor of a name.
#[must_use]
pub fn find(registry: &Registry, name: &str) -> Option<ExecutorKind> {
    all(registry).into_iter().find(|kind| kind.name == name)
}

impl ExecutorKind {
    /// Options of the executor; `None` if it has none.
    #[must_use]
    pub fn options(&self) -> Option<&ExecutorOptions> {
        match &self.way {
            Way::Here => None,
            Way::Hosts(options) | Way::Queue(options) | Way::Written(options, _) => Some(options),
        }
    }

    /// Whether trials can be submitted to the executor.
    #[must_use]
    pub fn takes(&self) -> bool {
        matches!(self.way, Way::Queue(_) | Way::Written(..))
    }

    /// The key of its table that `--jobs` sets.
    #[must_use]
    pub fn key_of_jobs(&self) -> &'static str {
        match self.way {
            Way::Here | Way::Hosts(_) => "workers",
            Way::Queue(_) | Way::Written(..) => "max_tasks",
        }
    }

    /// Whether the program itself can have trials computed by the executor.
    #[must_use]
    pub fn runs(&self) -> bool {
        !matches!(self.way, Way::Written(..))
    }
}

impl ExecutorOptions {
    /// Options of type `O`, from which `build` makes the executor. A key that is absent from the table must be an
    /// `Option`, which is then `None`.
    pub fn of<O>(build: fn(O) -> Result<Box<dyn Executor>, Error>) -> Self
    where
        O: Default + Serialize + DeserializeOwned + JsonSchema + 'static,
    {
        let typed = |value: &Value| {
            // Null means a record or table without entries.
            let given = Some(value).filter(|value| !value.is_null()).map(O::deserialize);
            given
                .unwrap_or_else(|| Ok(O::default()))
                .map_err(|problem| Error::Record {
                    problem: problem.to_string(),
                })
        };
        let read = |table: ValueDeserializer<'_>| {
            serde_json::to_value(O::deserialize(table)?).map_err(serde::de::Error::custom)
        };
        Self {
            schema: schemars::schema_for!(O),
            read: Box::new(read),
            build: Box::new(move |value| build(typed(value)?)),
        }
    }

    /// A table of `regimen.toml` with every key; absent ones are null.
    ///
    /// # Errors
    /// An unknown key or a value of another type, with its position.
    pub fn read(&self, table: ValueDeserializer<'_>) -> Result<Value, toml::de::Error> {
        (self.read)(table)
    }

    /// The executor with these options, as [`read`](Self::read) returned them; null means no options.
    ///
    /// # Errors
    /// [`Error::Option`] if one cannot be used, [`Error::Record`] if they belong to another executor.
    pub fn build(&self, options: &Value) -> Result<Box<dyn Executor>, Error> {
        (self.build)(options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_executor_is_listed_with_a_sentence_and_the_keys_of_its_table() {
        let all = all(&Registry::default());
        let names: Vec<&str> = all.iter().map(|kind| kind.name).collect();
        let different: BTreeSet<&str> = names.iter().copied().collect();
        assert_eq!((names[0], different.len()), ("local", names.len()));
        assert!(
            ["ssh", "slurm", "hyperqueue", "kubernetes"]
                .iter()
                .all(|own| different.contains(own))
        );
        for kind in all.iter().filter_map(|kind| Some((kind, kind.options()?))) {
            let (kind, options) = kind;
            assert!(kind.about.len() > 20, "{}", kind.name);
            let keys = options
                .schema
                .get("properties")
                .and_then(Value::as_object)
                .unwrap();
            assert!(
                keys.values().all(|key| key["description"].is_string()),
                "{}",
                kind.name
            );
            // `--jobs` replaces this one.
            assert!(keys.contains_key(kind.key_of_jobs()), "{}", kind.name);
        }
    }

    #[test]
    fn options_of_another_executor_are_refused() {
        let slurm = find(&Registry::default(), "slurm").unwrap();
        let options = slurm.options().unwrap();
        assert!(options.build(&Value::Null).is_ok());
        let wrong = options
            .build(&serde_json::json!({ "image": "a" }))
            .unwrap_err()
            .to_string();
        assert!(wrong.contains("image"), "{wrong}");
    }
}
