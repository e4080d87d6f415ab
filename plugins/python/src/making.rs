//! Python code that a study names: its maker, the files that it reads, and the request to Python.

use contract::{DataFile, Error};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{borrow::Cow, collections::BTreeMap};

/// A file by its path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedFile {
    /// Path of the file, relative to the study.
    pub file: DataFile,
}

/// The maker of an environment or an agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "MakerText", into = "MakerText")]
pub enum Maker {
    /// `PACKAGE:NAME`; any other text is refused when it is used.
    Word(String),
    /// A function in a file of the user.
    Own {
        /// Path of the file, relative to the study.
        file: DataFile,
        /// Name of the class or function.
        call: String,
    },
}

/// The form in which a config writes a maker.
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "`PACKAGE:NAME`, or `FILE.py:FUNCTION`")]
enum MakerText {
    Word(String),
    Own { file: DataFile, call: String },
}

impl From<MakerText> for Maker {
    fn from(written: MakerText) -> Self {
        match written {
            MakerText::Own { file, call } => Self::Own { file, call },
            MakerText::Word(word) => match word.rsplit_once(':') {
                Some((file, call)) if file.ends_with(".py") => Self::Own {
                    file: DataFile::new(file),
                    call: call.into(),
                },
                _ => Self::Word(word),
            },
        }
    }
}

impl From<Maker> for MakerText {
    fn from(make: Maker) -> Self {
        match make {
            Maker::Word(word) => Self::Word(word),
            Maker::Own { file, call } => Self::Own { file, call },
        }
    }
}

impl JsonSchema for Maker {
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
                        "call": { "type": "string", "description": "What is called in it." },
                    },
                },
            ],
        })
    }
}

/// The request with which Python makes an environment or an agent.
#[derive(Debug, Clone)]
pub struct MakeRequest {
    /// The request as JSON, with the text of the user's files and the paths of data files.
    pub json: Value,
    /// Data files among the arguments, by the JSON pointer to their paths in `json`; Python gets copies of its
    /// own.
    pub files: Vec<(String, DataFile)>,
}

impl MakeRequest {
    /// Identity of the request: its text and the digests of its files.
    ///
    /// # Errors
    /// [`Error::File`] where a file cannot be read.
    pub fn key(&self) -> Result<String, Error> {
        let digests = self.files.iter().map(|(_, file)| Ok(file.digest()?.into_owned()));
        let digests = digests.collect::<Result<Vec<String>, Error>>()?;
        Ok(json!([self.json, digests]).to_string())
    }
}

/// The config keys that environments and agents share to name their code.
pub struct Code<'a> {
    /// The class or function that is called.
    pub make: Value,
    /// Arguments of the call, by name.
    pub arguments: &'a BTreeMap<String, Value>,
    /// Other files of the user.
    pub sources: &'a [NamedFile],
    /// The lock file of the packages.
    pub lock: Option<&'a NamedFile>,
    /// The Python interpreter.
    pub interpreter: &'a str,
}

impl Code<'_> {
    /// The request for this code, with the keys of `more` beside it.
    ///
    /// # Errors
    /// [`Error::Config`] where no lock file is named; [`Error::File`] where a file cannot be read.
    pub fn request(&self, more: Value) -> Result<MakeRequest, Error> {
        let lock = self.lock.ok_or_else(|| self.without_lock())?;
        let sources = self.sources.iter().map(|source| text_of(&source.file));
        let mut files = Vec::new();
        let arguments = passed(&json!(self.arguments), "/arguments", &mut files);
        let mut asked = json!({
            "make": self.make,
            "arguments": arguments,
            "sources": sources.collect::<Result<Vec<_>, _>>()?,
            "lock": text_of(&lock.file)?,
            "interpreter": self.interpreter,
        });
        if let (Value::Object(asked), Value::Object(more)) = (&mut asked, more) {
            asked.extend(more);
        }
        Ok(MakeRequest { json: asked, files })
    }

    fn without_lock(&self) -> Error {
        let interpreter = self.interpreter;
        Error::config(
            "lock",
            format!(
                "names no file, so that nothing says which packages compute the numbers: write one by `{interpreter} \
                 -m pip freeze > requirements.txt`, and `lock: {{ file: requirements.txt }}`"
            ),
        )
    }
}

impl Maker {
    /// The call that makes an environment.
    ///
    /// # Errors
    /// [`Error::Config`] where nothing is named; [`Error::File`] where a file cannot be read.
    pub fn of_environment(&self) -> Result<Value, Error> {
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

    /// The call that makes an agent.
    ///
    /// # Errors
    /// [`Error::Config`] if no file of the user is named; [`Error::File`] if it cannot be read.
    pub fn of_agent(&self) -> Result<Value, Error> {
        match self {
            Self::Own { file, call } => Ok(json!({ "file": text_of(file)?, "call": call })),
            Self::Word(word) => Err(Error::config(
                "make",
                format!(
                    "`{word}` names nothing that makes an agent: write `FILE.py:CLASS`, as `rules.py:Rule`, with a \
                     file of your own and a class or function in it"
                ),
            )),
        }
    }

    /// Describes the made object in words, for messages.
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

/// An argument in Python's form: a file becomes its path and is added to `files` with its JSON pointer.
fn passed(argument: &Value, place: &str, files: &mut Vec<(String, DataFile)>) -> Value {
    let named = argument.as_object().filter(|map| map.len() == 1);
    let file = named.and_then(|map| DataFile::deserialize(map.get("file")?).ok());
    let escaped = |key: &str| key.replace('~', "~0").replace('/', "~1");
    match (file, argument) {
        (Some(file), _) => {
            let path = json!(file.path());
            files.push((place.into(), file));
            path
        }
        (None, Value::Object(map)) => {
            let each = map.iter().map(|(key, value)| {
                let below = format!("{place}/{}", escaped(key));
                (key.clone(), passed(value, &below, files))
            });
            Value::Object(each.collect())
        }
        (None, Value::Array(items)) => {
            let each = items.iter().enumerate();
            each.map(|(at, value)| passed(value, &format!("{place}/{at}"), files))
                .collect()
        }
        (None, other) => other.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_among_arguments_are_passed_by_their_paths() {
        let argument =
            json!({ "table": { "file": "a.csv" }, "m/n": [{ "file": { "path": "b", "content": "1" } }] });
        let mut files = Vec::new();
        let found = passed(&argument, "", &mut files);
        assert_eq!(found, json!({ "table": "a.csv", "m/n": ["b"] }));
        for (place, file) in &files {
            assert_eq!(found.pointer(place), Some(&json!(file.path())));
        }
        assert_eq!(files.len(), 2);
        assert_eq!(
            passed(&json!({ "file": 3 }), "", &mut files),
            json!({ "file": 3 })
        );
    }

    #[test]
    fn an_agent_is_made_by_a_file_of_ones_own() {
        let word = |word: &str| serde_json::from_value::<Maker>(json!(word)).unwrap();
        let problem = word("gymnasium:Rule").of_agent().unwrap_err().to_string();
        assert!(
            problem.contains("`gymnasium:Rule` names nothing that makes an agent"),
            "{problem}"
        );
        assert!(matches!(
            word("absent.py:Rule").of_agent(),
            Err(Error::File { .. })
        ));
        assert_eq!(word("rules.py:Rule").in_words(), "rules.py:Rule");
    }
}
