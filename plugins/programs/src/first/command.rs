//! The words of a command: the program, its parameters, and the seed.

use super::{
    help::{Help, HelpOption},
    options::{self, OptionPurpose, value},
    sources,
};
use serde_json::Value;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

/// A word of the command, as the study writes it and as the probe starts it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CommandWord {
    /// The word of the study, with names in braces.
    pub written: String,
    /// The word of the probe, with the values of these names.
    pub started: String,
}

/// A parameter of the program.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Name in the study.
    pub name: String,
    /// Name in the command.
    pub option: String,
    pub value: Value,
}

/// A command, parsed.
#[derive(Debug, Default, PartialEq)]
pub struct Command {
    /// Words of the command line.
    pub words: Vec<CommandWord>,
    /// Number of words of the program, all before its arguments.
    pub head: usize,
    /// The interpreter, if it is a file.
    pub interpreter: String,
    pub parameters: Vec<Parameter>,
    /// The option for the seed.
    pub seed: Option<String>,
    /// The option for the length of the training, with its value.
    pub steps: Option<(String, u64)>,
    pub task: Option<(String, String)>,
    /// Arguments that are copied unchanged.
    pub kept: Vec<String>,
    /// Files of the study's folder among the words.
    pub files: Vec<String>,
    /// Whether arguments are overrides, `key=value`.
    pub has_overrides: bool,
    /// Long names of options by their other names.
    long_names: BTreeMap<String, String>,
}

/// An argument of the program.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Argument {
    Word(String),
    Option {
        name: String,
        value: String,
        form: ValuePosition,
    },
}

/// Position of an option's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ValuePosition {
    /// In the next word.
    Apart,
    /// After an equals sign.
    Joined,
}

impl Command {
    /// Parses a command; options of `swept` become parameters whatever their names, except for a seed. Options are
    /// known by all names that the help lists.
    pub fn of(words: &[String], folder: &Path, swept: &BTreeSet<String>, help: &Help) -> Self {
        let mut command = Self {
            long_names: help.long_names(),
            ..Self::default()
        };
        let head = command.program(words, folder);
        let arguments = arguments(&words[head..]);
        command.has_overrides = arguments.iter().any(is_override);
        let longest = |it: &Argument| match it {
            Argument::Option { name, value, .. }
                if !swept.contains(name) && options::value(value).is_u64() =>
            {
                match command.purpose(name) {
                    OptionPurpose::Steps(rank) => Some(rank),
                    _ => None,
                }
            }
            _ => None,
        };
        let steps = arguments.iter().filter_map(longest).min();
        for argument in arguments {
            match argument {
                Argument::Word(word) => command.stays(word, folder),
                Argument::Option { name, value, form } => match command.purpose(&name) {
                    kind if swept.contains(&name) && kind != OptionPurpose::Seed => {
                        let (placeholder, started) = command.parameter(&name, &value);
                        command.add(&name, (&placeholder, &started), form);
                    }
                    OptionPurpose::Steps(rank) if Some(rank) != steps => {
                        command.takes(&name, &value, form, OptionPurpose::Parameter, folder);
                    }
                    kind => command.takes(&name, &value, form, kind, folder),
                },
            }
        }
        command
    }

    /// The purpose of an option, by any of its names.
    fn purpose(&self, option: &str) -> OptionPurpose {
        match options::kind(option) {
            OptionPurpose::Parameter => options::kind(self.long(option)),
            kind => kind,
        }
    }

    fn long<'a>(&'a self, option: &'a str) -> &'a str {
        self.long_names.get(option).map_or(option, String::as_str)
    }

    /// Whether an option may take a place: nothing has it, or the same option, whose last value counts.
    fn may_take(&self, place: Option<&String>, option: &str) -> bool {
        place.is_none_or(|taken| self.long(taken) == self.long(option))
    }

    /// Takes the words before the arguments, and returns their count.
    fn program(&mut self, words: &[String], folder: &Path) -> usize {
        let is_manager = words
            .first()
            .is_some_and(|first| super::MANAGERS.contains(&first.as_str()));
        // A file after a long option is its value, and not the program.
        let before = words
            .iter()
            .take_while(|word| is_manager || !word.starts_with("--"))
            .count();
        let module = words.iter().take(before.min(5)).position(|word| word == "-m");
        let script = words[..before]
            .iter()
            .position(|word| source(folder, word).is_some());
        self.head = match (module, script) {
            (Some(place), _) => (place + 2).min(words.len()),
            (None, Some(place)) => place + 1,
            (None, None) => words.len().min(1),
        };
        for (place, word) in words[..self.head].iter().enumerate() {
            let started = if place == 0 {
                self.first(word, folder)
            } else {
                word.clone()
            };
            self.words.push(CommandWord {
                written: escaped(&started),
                started,
            });
        }
        if let Some(place) = module {
            let parts = words
                .get(place + 1)
                .map_or_else(String::new, |it| it.replace('.', "/"));
            let files = [
                format!("{parts}.py"),
                format!("{parts}/__main__.py"),
                format!("{parts}/__init__.py"),
            ];
            self.files
                .extend(files.iter().filter_map(|name| sources::inside(folder, name)));
            let package = Path::new(&parts).parent().unwrap_or(Path::new(""));
            self.files.extend(sources::packages(folder, package));
        } else if let Some(word) = script.map(|place| &words[place]) {
            self.files.extend(source(folder, word));
        }
        self.head
    }

    /// The first word. An interpreter in a folder belongs to this machine and not to the command.
    fn first(&mut self, word: &str, folder: &Path) -> String {
        match Path::new(word).file_name().and_then(|name| name.to_str()) {
            Some(name) if word.contains('/') && source(folder, word).is_none() => {
                word.clone_into(&mut self.interpreter);
                name.to_owned()
            }
            _ => word.to_owned(),
        }
    }

    fn stays(&mut self, word: String, folder: &Path) {
        self.files.extend(sources::inside(folder, &word));
        if !word.starts_with('-') {
            self.kept.push(word.clone());
        }
        self.words.push(CommandWord {
            written: escaped(&word),
            started: word,
        });
    }

    fn takes(&mut self, name: &str, text: &str, form: ValuePosition, kind: OptionPurpose, folder: &Path) {
        let file = sources::inside(folder, text);
        let number = value(text).as_u64();
        let (placeholder, started) = match (kind, number) {
            _ if file.is_some() => (escaped(text), text.to_owned()),
            (OptionPurpose::Seed, _) if self.may_take(self.seed.as_ref(), name) => {
                self.seed = Some(name.to_owned());
                ("{seed}".into(), text.to_owned())
            }
            (OptionPurpose::Steps(_), Some(steps))
                if self.may_take(self.steps.as_ref().map(|it| &it.0), name) =>
            {
                self.steps = Some((name.to_owned(), steps));
                ("{steps}".into(), steps.to_string())
            }
            (OptionPurpose::Task, _) if self.may_take(self.task.as_ref().map(|it| &it.0), name) => {
                self.task = Some((name.to_owned(), text.to_owned()));
                ("{environment.id}".into(), text.to_owned())
            }
            (OptionPurpose::Stays, _) => {
                self.kept.push(format!("{name} {text}"));
                (escaped(text), text.to_owned())
            }
            _ => self.parameter(name, text),
        };
        self.files.extend(file);
        self.add(name, (&placeholder, &started), form);
    }

    fn parameter(&mut self, option: &str, text: &str) -> (String, String) {
        let (value, name) = (value(text), self.name_for(option));
        let placeholder = format!("{{{name}}}");
        let started = match &value {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        self.parameters.push(Parameter {
            name,
            option: option.to_owned(),
            value,
        });
        (placeholder, started)
    }

    /// A name that no other parameter has.
    fn name_for(&self, option: &str) -> String {
        let is_short = !option.starts_with("--");
        let mut name = options::parameter_name(if is_short { self.long(option) } else { option });
        while self.parameters.iter().any(|it| it.name == name) {
            name.push('_');
        }
        name
    }

    fn add(&mut self, name: &str, (placeholder, started): (&str, &str), form: ValuePosition) {
        let said = |written: String, started: String| CommandWord { written, started };
        match form {
            ValuePosition::Apart => {
                self.words.push(said(escaped(name), name.into()));
                self.words.push(said(placeholder.into(), started.into()));
            }
            ValuePosition::Joined => {
                let written = format!("{}={placeholder}", escaped(name));
                self.words.push(said(written, format!("{name}={started}")));
            }
        }
    }

    /// Adds the options for seed, steps and task that the program has and the command lacks. Returns the
    /// options that keep their defaults.
    pub fn complete(&mut self, help: &Help) -> Vec<HelpOption> {
        self.has_overrides |= help.is_hydra;
        let form = if self.has_overrides {
            ValuePosition::Joined
        } else {
            ValuePosition::Apart
        };
        let steps = help.options.iter().filter(|it| it.number().is_some());
        let steps = steps.filter_map(|it| options::rank_of_steps(it.name())).min();
        let is_said = |it: &HelpOption, command: &Self| it.names.iter().any(|name| command.has(name));
        let open = help.options.iter().filter(|it| !is_said(it, self));
        let open: Vec<HelpOption> = open.cloned().collect();
        let mut others = Vec::new();
        for option in open {
            let default = option.default.clone();
            match (options::kind(option.name()), default) {
                (OptionPurpose::Seed, default) if self.seed.is_none() => {
                    let seed = default.filter(|it| it.parse::<u64>().is_ok());
                    self.takes_from_help(
                        &option,
                        &seed.unwrap_or_else(|| "1".into()),
                        form,
                        OptionPurpose::Seed,
                    );
                }
                (OptionPurpose::Steps(rank), Some(default))
                    if self.steps.is_none() && Some(rank) == steps =>
                {
                    self.takes_from_help(&option, &default, form, OptionPurpose::Steps(rank));
                }
                (OptionPurpose::Task, Some(default)) if self.task.is_none() => {
                    self.takes_from_help(&option, &default, form, OptionPurpose::Task);
                }
                _ => others.push(option),
            }
        }
        others
    }

    fn takes_from_help(&mut self, option: &HelpOption, text: &str, form: ValuePosition, kind: OptionPurpose) {
        self.takes(option.name(), text, form, kind, Path::new("/nowhere"));
    }

    fn has(&self, option: &str) -> bool {
        let is_it =
            |word: &CommandWord| word.started == option || word.started.starts_with(&format!("{option}="));
        self.words[self.head..].iter().any(is_it)
    }

    /// Leaves the steps of the command unchanged, because they count something other than the steps of metrics.
    pub fn keep_steps(&mut self) {
        let Some((_, steps)) = self.steps.take() else {
            return;
        };
        for word in &mut self.words {
            word.written = word.written.replace("{steps}", &steps.to_string());
        }
    }
}

/// The program's file that a word names; an interpreter in the folder, as in `.venv/bin`, is not one.
fn source(folder: &Path, word: &str) -> Option<String> {
    let is_source = |name: &String| !name.starts_with('.') && !name.contains("/bin/");
    sources::inside(folder, word).filter(|name| !word.starts_with('-') && is_source(name))
}

/// The text with its braces escaped.
fn escaped(text: &str) -> String {
    text.replace('{', "{{").replace('}', "}}")
}

fn arguments(words: &[String]) -> Vec<Argument> {
    let mut found = Vec::new();
    let mut words = words.iter().peekable();
    while let Some(word) = words.next() {
        let is_option = word.starts_with('-') && !options::is_number(word) && word.len() > 1;
        let joined = word.split_once('=').filter(|(name, _)| is_option || is_key(name));
        if let Some((name, value)) = joined {
            found.push(option(name, value, ValuePosition::Joined));
            continue;
        }
        let is_value = |next: &&String| !next.starts_with('-') || options::is_number(next);
        let next = words.next_if(|next| is_option && word != "--" && is_value(next) && !is_pair(next));
        found.push(match next {
            Some(value) => option(word, value, ValuePosition::Apart),
            None => Argument::Word(word.clone()),
        });
    }
    found
}

fn option(name: &str, value: &str, form: ValuePosition) -> Argument {
    Argument::Option {
        name: name.to_owned(),
        value: value.to_owned(),
        form,
    }
}

/// Whether a name is the key of an override, as in Hydra.
fn is_key(name: &str) -> bool {
    let plain = name.trim_start_matches('+');
    let begins = plain.starts_with(|it: char| it.is_ascii_alphabetic() || it == '_');
    begins
        && plain
            .chars()
            .all(|it| it.is_ascii_alphanumeric() || "_./-@".contains(it))
}

fn is_pair(word: &str) -> bool {
    word.split_once('=').is_some_and(|(name, _)| is_key(name))
}

fn is_override(argument: &Argument) -> bool {
    matches!(argument, Argument::Option { name, form: ValuePosition::Joined, .. } if !name.starts_with('-'))
}

#[cfg(test)]
#[path = "command_tests.rs"]
mod tests;
