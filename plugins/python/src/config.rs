//! What a study says of an environment in Python.

use engine::{DataFile, Error};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{borrow::Cow, collections::BTreeMap};

/// Settings of the `python` environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PythonConfig {
    /// What makes the environment: `gymnasium:ID`; `pettingzoo:MODULE`, whose `parallel_env` is called; or
    /// `FILE.py:FUNCTION`, a file beside the study and what is called in it.
    pub make: Make,
    /// Arguments by name for what makes it. In place of a value, `{ file: PATH }` passes the path of a file whose
    /// content enters the trial's id.
    pub arguments: BTreeMap<String, Value>,
    /// Other files of your own that it imports, each as the module with the file's name.
    pub sources: Vec<NamedFile>,
    /// The lock file of its packages, as `python3 -m pip freeze` writes one: what is installed must be what it says.
    pub lock: Option<NamedFile>,
    /// The Python that runs it: a program on the path, or its place. No part of a trial's id.
    #[schemars(extend("x-identity" = false))]
    pub interpreter: String,
}

impl Default for PythonConfig {
    fn default() -> Self {
        Self {
            make: Make::Word(String::new()),
            arguments: BTreeMap::new(),
            sources: Vec::new(),
            lock: None,
            interpreter: "python3".into(),
        }
    }
}

impl engine::Config for PythonConfig {}

/// A file by its path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedFile {
    /// The file, as seen from the study.
    pub file: DataFile,
}

/// What makes an environment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "Written", into = "Written")]
pub enum Make {
    /// `PACKAGE:NAME`, or what nobody knows.
    Word(String),
    /// A function of a person's own file.
    Own {
        /// The file.
        file: DataFile,
        /// The function in it.
        call: String,
    },
}

/// What stands in a config.
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "`PACKAGE:NAME`, or `FILE.py:FUNCTION`")]
enum Written {
    Word(String),
    Own { file: DataFile, call: String },
}

impl From<Written> for Make {
    fn from(written: Written) -> Self {
        match written {
            Written::Own { file, call } => Self::Own { file, call },
            Written::Word(word) => match word.rsplit_once(':') {
                Some((file, call)) if file.ends_with(".py") => Self::Own {
                    file: DataFile::new(file),
                    call: call.into(),
                },
                _ => Self::Word(word),
            },
        }
    }
}

impl From<Make> for Written {
    fn from(make: Make) -> Self {
        match make {
            Make::Word(word) => Self::Word(word),
            Make::Own { file, call } => Self::Own { file, call },
        }
    }
}

impl JsonSchema for Make {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "Make".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "anyOf": [
                { "type": "string" },
                {
                    "type": "object", "additionalProperties": false, "required": ["file", "call"],
                    "properties": {
                        "file": { "type": "string", "description": "A file of your own, as seen from the study." },
                        "call": { "type": "string", "description": "What is called in it to make an environment." },
                    },
                },
            ],
        })
    }
}

impl PythonConfig {
    /// What Python is told, with the texts of files.
    ///
    /// # Errors
    /// [`Error::Config`] for a config that names nothing to make or no lock file, and [`Error::File`] where a file
    /// cannot be read.
    pub fn told(&self) -> Result<Value, Error> {
        let make = self.make.told()?;
        let lock = self.lock.as_ref().ok_or_else(|| self.without_lock())?;
        let sources = self.sources.iter().map(|source| text_of(&source.file));
        let arguments = self.arguments.iter();
        let arguments: BTreeMap<&String, Value> =
            arguments.map(|(name, value)| (name, passed(value))).collect();
        Ok(json!({
            "make": make,
            "arguments": arguments,
            "sources": sources.collect::<Result<Vec<_>, _>>()?,
            "lock": text_of(&lock.file)?,
            "interpreter": self.interpreter,
        }))
    }

    fn without_lock(&self) -> Error {
        let interpreter = &self.interpreter;
        Error::config(
            "lock",
            format!(
                "names no file, so that nothing says which packages compute the numbers: write one by `{interpreter} \
                 -m pip freeze > requirements.txt`, and `lock: {{ file: requirements.txt }}`"
            ),
        )
    }
}

impl Make {
    fn told(&self) -> Result<Value, Error> {
        match self {
            Self::Own { file, call } => Ok(json!({ "file": text_of(file)?, "call": call })),
            Self::Word(word) => match word.split_once(':') {
                Some((package @ ("gymnasium" | "pettingzoo"), name)) if !name.is_empty() => {
                    Ok(json!({ "package": package, "name": name }))
                }
                _ => Err(Error::config(
                    "make",
                    format!(
                        "`{word}` names nothing that makes an environment: write `gymnasium:ID`, as \
                         `gymnasium:Pendulum-v1`, `pettingzoo:MODULE`, or `FILE.py:FUNCTION` with a file of your own"
                    ),
                )),
            },
        }
    }

    /// What it makes, in words.
    pub fn in_words(&self) -> String {
        match self {
            Self::Word(word) => word.clone(),
            Self::Own { file, call } => format!("{}:{call}", file.path().display()),
        }
    }
}

fn text_of(file: &DataFile) -> Result<Value, Error> {
    Ok(json!({ "path": file.path(), "text": file.text()? }))
}

/// An argument as Python gets it: a file by its path.
fn passed(argument: &Value) -> Value {
    let named = argument.as_object().filter(|map| map.len() == 1);
    let file = named.and_then(|map| DataFile::deserialize(map.get("file")?).ok());
    match (file, argument) {
        (Some(file), _) => json!(file.path()),
        (None, Value::Object(map)) => map
            .iter()
            .map(|(key, value)| (key.clone(), passed(value)))
            .collect(),
        (None, Value::Array(items)) => items.iter().map(passed).collect(),
        (None, other) => other.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(value: Value) -> PythonConfig {
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn a_file_of_ones_own_is_written_as_a_file_so_that_its_content_enters_the_id() {
        let own = config(json!({ "make": "envs/tank.py:make" }));
        assert_eq!(
            json!(own)["make"],
            json!({ "file": "envs/tank.py", "call": "make" })
        );
        assert_eq!(config(json!(own)), own);
        let package = config(json!({ "make": "gymnasium:ale_py:ALE/Pong-v5" }));
        assert_eq!(json!(package)["make"], "gymnasium:ale_py:ALE/Pong-v5");
        let told = package.make.told().unwrap();
        assert_eq!(
            told,
            json!({ "package": "gymnasium", "name": "ale_py:ALE/Pong-v5" })
        );
    }

    #[test]
    fn what_makes_nothing_and_what_has_no_lock_file_is_refused() {
        for word in ["", "gymnasium:", "gym:CartPole-v1", "tank.py", "make"] {
            let problem = config(json!({ "make": word })).told().unwrap_err().to_string();
            assert!(
                problem.contains(&format!("`make`: `{word}` names nothing")),
                "{problem}"
            );
        }
        let problem = config(json!({ "make": "gymnasium:CartPole-v1" }))
            .told()
            .unwrap_err();
        assert!(problem.to_string().contains("`lock`: names no file"), "{problem}");
    }

    #[test]
    fn files_among_arguments_are_passed_by_their_paths() {
        let argument =
            json!({ "table": { "file": "a.csv" }, "more": [{ "file": { "path": "b", "content": "1" } }] });
        assert_eq!(passed(&argument), json!({ "table": "a.csv", "more": ["b"] }));
        assert_eq!(passed(&json!({ "file": 3 })), json!({ "file": 3 }));
    }
}
