//! Code in Python as a study names it: its maker, the files that it reads, and the text that Python gets of them.

use contract::{DataFile, Error};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::{borrow::Cow, collections::BTreeMap};

/// A file by its path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NamedFile {
    /// The file, as seen from the study.
    pub file: DataFile,
}

/// The maker of an environment or an agent.
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

/// A maker as a config writes it.
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
                        "call": { "type": "string", "description": "What is called in it." },
                    },
                },
            ],
        })
    }
}

/// The text that Python gets.
#[derive(Debug, Clone)]
pub struct Told {
    /// With the texts of files of its own, and the paths of others.
    pub asked: Value,
    /// The files among the arguments, by where in `asked` their paths stand: Python gets copies of its own.
    pub files: Vec<(String, DataFile)>,
}

impl Told {
    /// Its identity: the text that Python gets, and the content of the files.
    ///
    /// # Errors
    /// [`Error::File`] where one cannot be read.
    pub fn key(&self) -> Result<String, Error> {
        let digests = self.files.iter().map(|(_, file)| Ok(file.digest()?.into_owned()));
        let digests = digests.collect::<Result<Vec<String>, Error>>()?;
        Ok(json!([self.asked, digests]).to_string())
    }
}

/// The keys that name the code of environments and agents alike.
pub struct Code<'a> {
    /// The class or function that is called.
    pub make: Value,
    /// Arguments by name.
    pub arguments: &'a BTreeMap<String, Value>,
    /// Other files of a person's own.
    pub sources: &'a [NamedFile],
    /// The lock file of the packages.
    pub lock: Option<&'a NamedFile>,
    /// The Python that runs it.
    pub interpreter: &'a str,
}

impl Code<'_> {
    /// The text that Python gets, with more keys beside those of the code.
    ///
    /// # Errors
    /// [`Error::Config`] where no lock file is named; [`Error::File`] where a file cannot be read.
    pub fn told(&self, more: Value) -> Result<Told, Error> {
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
        Ok(Told { asked, files })
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

impl Make {
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
    /// [`Error::Config`] where no file of a person's own is named; [`Error::File`] where it cannot be read.
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

    /// The thing that it makes, in words.
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

/// An argument as Python gets it: a file by its path, which is noted with its place.
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
        let word = |word: &str| serde_json::from_value::<Make>(json!(word)).unwrap();
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
