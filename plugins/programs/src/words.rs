//! The words of a command, in which names in braces are replaced.
//!
//! A word stays one argument, whatever its value: no shell reads it.

use contract::{Error, own_training::Assignment};
use serde_json::Value;
use std::{collections::BTreeMap, path::Path};

/// A part of a word.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Piece {
    Text(String),
    Name(String),
}

/// A word of a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Word(Vec<Piece>);

/// Values of the names in braces.
#[derive(Debug, Clone, Copy)]
pub struct WordValues<'a> {
    /// The trial.
    pub assignment: &'a Assignment,
    /// Parameters of the program.
    pub parameters: &'a BTreeMap<String, Value>,
    /// Paths of the inputs, by name.
    pub inputs: &'a BTreeMap<String, String>,
    /// The working folder.
    pub folder: &'a Path,
    /// The folder in which the program saves its state.
    pub checkpoint: &'a Path,
    /// The file with all parameters.
    pub parameters_file: &'a Path,
}

impl Word {
    /// Parses a word.
    ///
    /// # Errors
    /// The mistake in the braces.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (mut pieces, mut plain, mut rest) = (Vec::new(), String::new(), text);
        while let Some(place) = rest.find(['{', '}', '\0']) {
            plain.push_str(&rest[..place]);
            rest = &rest[place..];
            if rest.starts_with("{{") || rest.starts_with("}}") {
                plain.push_str(&rest[..1]);
                rest = &rest[2..];
                continue;
            }
            let named = rest.strip_prefix('{').and_then(|inside| inside.split_once('}'));
            let Some((name, after)) = named else {
                return Err(format!(
                    "`{}` is not closed, or a byte of 0: `{{{{` and `}}}}` are braces",
                    &rest[..1]
                ));
            };
            if !plain.is_empty() {
                pieces.push(Piece::Text(std::mem::take(&mut plain)));
            }
            pieces.push(Piece::Name(name.trim().to_owned()));
            rest = after;
        }
        plain.push_str(rest);
        if !plain.is_empty() || pieces.is_empty() {
            pieces.push(Piece::Text(plain));
        }
        Ok(Self(pieces))
    }

    /// The names in braces.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.iter().filter_map(|piece| match piece {
            Piece::Name(name) => Some(name.as_str()),
            Piece::Text(_) => None,
        })
    }

    /// The word with its names replaced.
    ///
    /// # Errors
    /// The name that has no value, or whose value would become an option.
    fn filled(&self, known: &WordValues<'_>) -> Result<String, WordFault> {
        let mut argument = String::new();
        for piece in &self.0 {
            let (name, value) = match piece {
                Piece::Text(text) => {
                    argument.push_str(text);
                    continue;
                }
                Piece::Name(name) => (name, known.value(name)?),
            };
            let unfit = |problem| WordFault {
                parameter: known.parameters.contains_key(name).then(|| name.clone()),
                problem,
            };
            let text = spelled(name, &value).map_err(unfit)?;
            if argument.is_empty() && value.is_string() && text.starts_with('-') {
                return Err(unfit(format!(
                    "`{{{name}}}` is `{text}`, which a program would take for an option: write the option before it into \
                     the same word, as `--name={{{name}}}`"
                )));
            }
            argument.push_str(&text);
        }
        Ok(argument)
    }
}

/// A word that cannot be filled.
#[derive(Debug, PartialEq, Eq)]
struct WordFault {
    /// The parameter whose value is at fault.
    parameter: Option<String>,
    problem: String,
}

impl From<String> for WordFault {
    fn from(problem: String) -> Self {
        Self {
            parameter: None,
            problem,
        }
    }
}

/// A value as an argument: numbers as JSON writes them.
fn spelled(name: &str, value: &Value) -> Result<String, String> {
    let text = match value {
        Value::String(text) => text.clone(),
        Value::Number(_) | Value::Bool(_) => value.to_string(),
        _ => {
            return Err(format!(
                "`{{{name}}}` is {value}, which is no single argument: the file `{{parameters}}` holds all of them as JSON"
            ));
        }
    };
    if text.contains('\0') {
        return Err(format!("`{{{name}}}` holds a byte of 0, which no argument can"));
    }
    Ok(text)
}

impl WordValues<'_> {
    fn value(&self, name: &str) -> Result<Value, String> {
        let of = self.assignment;
        let path = |path: &Path| Value::String(path.display().to_string());
        if let Some(value) = self.parameters.get(name) {
            return Ok(value.clone());
        }
        Ok(match name {
            "seed" => of.seed.into(),
            "steps" => of.steps.into(),
            "evaluate_every" => of.evaluate_every.into(),
            "folder" => path(self.folder),
            "checkpoint" => path(self.checkpoint),
            "parameters" => path(self.parameters_file),
            _ => return self.of_others(name),
        })
    }

    fn of_others(&self, name: &str) -> Result<Value, String> {
        if let Some(input) = name.strip_prefix("input.") {
            let found = self.inputs.get(input).cloned().map(Value::String);
            return found.ok_or_else(|| format!("`{{{name}}}`: `inputs` has no file `{input}`"));
        }
        let Some(key) = name.strip_prefix("environment.") else {
            return Err(self.unknown(name));
        };
        let found = key
            .split('.')
            .try_fold(&self.assignment.environment, |value, key| value.get(key));
        found.cloned().ok_or_else(|| {
            let keys = self.assignment.environment.as_object();
            let keys: Vec<String> = keys
                .into_iter()
                .flatten()
                .map(|(key, _)| format!("`{key}`"))
                .collect();
            format!(
                "`{{{name}}}`: the environment has no value `{key}`; it has {}",
                keys.join(", ")
            )
        })
    }

    fn unknown(&self, name: &str) -> String {
        let own = self.parameters.keys().map(String::as_str);
        let all = own.chain(OTHERS).map(|name| format!("`{{{name}}}`"));
        let all: Vec<String> = all.collect();
        let hint = match name {
            "environment" => {
                "; the name of an environment in a study is no part of a trial's id: `{environment.id}` is"
            }
            _ => "",
        };
        format!(
            "`{{{name}}}` stands for nothing here; these do: {}{hint}; `{{{{` and `}}}}` write braces",
            all.join(", ")
        )
    }
}

/// Names that have a value in every trial.
pub const OTHERS: [&str; 8] = [
    "seed",
    "steps",
    "evaluate_every",
    "environment.KEY",
    "input.NAME",
    "checkpoint",
    "folder",
    "parameters",
];

/// Parses words.
///
/// # Errors
/// [`Error::Config`] at `key`.
pub fn parsed(key: &str, words: &[String]) -> Result<Vec<Word>, Error> {
    let word =
        |text: &String| Word::parse(text).map_err(|why| Error::config(key, format!("in `{text}` {why}")));
    words.iter().map(word).collect()
}

/// The words with their names replaced.
///
/// # Errors
/// [`Error::Config`] at `key`, or at the parameter whose value is no argument.
pub fn filled(key: &str, words: &[Word], known: &WordValues<'_>) -> Result<Vec<String>, Error> {
    let refused = |fault: WordFault| {
        let key = fault
            .parameter
            .map_or_else(|| key.to_owned(), |name| format!("parameters.{name}"));
        Error::config(key, fault.problem)
    };
    let word = |word: &Word| word.filled(known).map_err(refused);
    words.iter().map(word).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    fn fill(text: &str, parameters: Value) -> Result<String, String> {
        with_fault(text, parameters).map_err(|fault| fault.problem)
    }

    fn with_fault(text: &str, parameters: Value) -> Result<String, WordFault> {
        let assignment = Assignment {
            seed: 7,
            steps: 500,
            environment: json!({ "id": "CartPole-v1", "wind": { "speed": 1.5 } }),
            ..Assignment::default()
        };
        let known = WordValues {
            assignment: &assignment,
            parameters: &serde_json::from_value(parameters).unwrap(),
            inputs: &[("cases".to_owned(), "/w/cases.csv".to_owned())].into(),
            folder: Path::new("/w"),
            checkpoint: Path::new("/w/checkpoint"),
            parameters_file: Path::new("/w/parameters.json"),
        };
        Word::parse(text)?.filled(&known)
    }

    #[test]
    fn names_stand_for_what_a_trial_has() {
        for (text, argument) in [
            ("--seed={seed}", "--seed=7"),
            ("{steps}", "500"),
            ("{environment.id}", "CartPole-v1"),
            ("{environment.wind.speed}m", "1.5m"),
            ("{input.cases}", "/w/cases.csv"),
            ("{checkpoint}/last", "/w/checkpoint/last"),
            ("{lr}", "0.0003"),
            ("{flag}", "true"),
            ("{{seed}} {{}}", "{seed} {}"),
            ("", ""),
        ] {
            let parameters = json!({ "lr": 3e-4, "flag": true });
            assert_eq!(fill(text, parameters).as_deref(), Ok(argument), "{text}");
        }
    }

    #[test]
    fn an_unknown_name_is_refused_with_the_known_ones() {
        for (text, why) in [
            (
                "{sed}",
                "`{sed}` stands for nothing here; these do: `{list}`, `{lr}`, `{seed}`",
            ),
            ("{environment}", "no part of a trial's id: `{environment.id}` is"),
            ("{environment.name}", "has no value `name`; it has `id`, `wind`"),
            ("{environment.wind}", "no single argument"),
            (
                "{\"a\": 1}",
                "`{\"a\": 1}` stands for nothing here; these do: `{list}`",
            ),
            ("{\"a\": 1}", "`{{` and `}}` write braces"),
            ("{input.case}", "`inputs` has no file `case`"),
            ("{seed", "is not closed"),
            ("seed}", "is not closed"),
            ("{list}", "the file `{parameters}` holds all of them"),
        ] {
            let told = fill(text, json!({ "lr": 1, "list": [1] })).unwrap_err();
            assert!(told.contains(why), "{text}: {told}");
        }
    }

    #[test]
    fn a_value_that_is_no_argument_is_a_fault_of_its_parameter() {
        for (text, parameter) in [
            ("{list}", Some("list")),
            ("{environment.wind}", None),
            ("{x}", None),
        ] {
            let fault = with_fault(text, json!({ "list": [1] })).unwrap_err();
            assert_eq!(fault.parameter.as_deref(), parameter, "{text}");
        }
    }

    #[test]
    fn a_text_does_not_become_an_option_and_a_number_may_be_negative() {
        let parameters = || json!({ "name": "--config=/etc/passwd", "shift": -0.5 });
        assert!(
            fill("{name}", parameters())
                .unwrap_err()
                .contains("take for an option")
        );
        assert_eq!(
            fill("--name={name}", parameters()).unwrap(),
            "--name=--config=/etc/passwd"
        );
        assert_eq!(fill("{shift}", parameters()).unwrap(), "-0.5");
    }

    proptest! {
        /// Any value stays unchanged, in one argument.
        #[test]
        fn a_value_is_one_argument(value in "[^\0]*", before in "[a-z=]{1,5}") {
            let filled = fill(&format!("{before}{{value}}"), json!({ "value": value })).unwrap();
            prop_assert_eq!(filled, format!("{before}{value}"));
        }

        #[test]
        fn any_text_is_read_or_refused(text in any::<String>()) {
            let _ = Word::parse(&text);
        }
    }
}
