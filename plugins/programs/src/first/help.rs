//! The options of a program, parsed from its `--help`: the formats of argparse, tyro and click, and the config
//! that Hydra prints.

use super::{options::value, yaml};
use serde_json::Value;
use std::collections::BTreeMap;

/// An option of a program.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HelpOption {
    /// Names as they are written, the first long one first.
    pub names: Vec<String>,
    /// Default value, where there is one.
    pub default: Option<String>,
}

impl HelpOption {
    /// The preferred name.
    pub fn name(&self) -> &str {
        self.names.first().map_or("", String::as_str)
    }

    /// The default as a whole number.
    pub fn number(&self) -> Option<u64> {
        value(self.default.as_ref()?).as_u64()
    }
}

/// All options of a program.
#[derive(Debug, Default, PartialEq)]
pub struct Help {
    pub options: Vec<HelpOption>,
    /// Whether options are written as Hydra's overrides, `key=value`.
    pub is_hydra: bool,
}

/// The line of Hydra's help before the config.
const CONFIG: &str = "== Config ==";
/// The line that ends Hydra's help.
const HYDRA: &str = "Powered by Hydra";

impl Help {
    /// Parses the output of `--help`.
    pub fn read(text: &str) -> Self {
        if text.contains(HYDRA) && text.contains(CONFIG) {
            return Self::of_hydra(text);
        }
        let mut options: Vec<(Vec<String>, String)> = Vec::new();
        for line in text.lines() {
            let line = line.trim_matches(|letter: char| letter.is_whitespace() || is_box(letter));
            match names(line) {
                Some(names) => options.push((names, line.to_owned())),
                None => {
                    if let Some((_, about)) = options.last_mut().filter(|_| !line.is_empty()) {
                        about.push(' ');
                        about.push_str(line);
                    }
                }
            }
        }
        let mut read = Self::default();
        for (names, about) in options {
            let is_known = read.options.iter().any(|it| it.names[0] == names[0]);
            if names[0] != "--help" && !is_known {
                let default = default(&about);
                read.options.push(HelpOption { names, default });
            }
        }
        read
    }

    /// The first long name of each option by its other names.
    pub fn long_names(&self) -> BTreeMap<String, String> {
        let of = |it: &HelpOption| {
            let long = it.name().to_owned();
            let others = it.names.iter().skip(1).cloned();
            others.map(move |name| (name, long.clone())).collect::<Vec<_>>()
        };
        self.options.iter().flat_map(of).collect()
    }

    fn of_hydra(text: &str) -> Self {
        let after = text.split(CONFIG).nth(1).unwrap_or_default();
        let config = after.split(HYDRA).next().unwrap_or_default();
        // The first line is a title.
        let lines = config
            .lines()
            .filter(|line| !line.starts_with("Override anything"));
        let config: Vec<&str> = lines.collect();
        let mut options = Vec::new();
        if let Ok(value) = yaml::read("--help", &config.join("\n")) {
            flatten("", &value, &mut options);
        }
        Self {
            options,
            is_hydra: true,
        }
    }
}

/// Scalars by their dotted keys.
fn flatten(key: &str, value: &Value, into: &mut Vec<HelpOption>) {
    let mut add = |default| {
        into.push(HelpOption {
            names: vec![key.to_owned()],
            default,
        });
    };
    match value {
        Value::Object(entries) => {
            for (name, value) in entries {
                let key = if key.is_empty() {
                    name.clone()
                } else {
                    format!("{key}.{name}")
                };
                flatten(&key, value, into);
            }
        }
        Value::Array(_) => {}
        Value::Null => add(None),
        Value::String(text) => add(Some(text.clone())),
        other => add(Some(other.to_string())),
    }
}

/// Whether a character is part of a box, as tyro draws them.
fn is_box(letter: char) -> bool {
    ('\u{2500}'..='\u{257f}').contains(&letter)
}

/// The names of the option at the beginning of a line, the first long one first; `None` without a long name.
fn names(line: &str) -> Option<Vec<String>> {
    if !line.starts_with('-') {
        return None;
    }
    // The description follows two spaces.
    let names = line.split("  ").next().unwrap_or_default();
    let is_name = |word: &&str| {
        let plain = word.trim_start_matches('-');
        let is_plain = plain.starts_with(|it: char| it.is_ascii_alphabetic());
        word.starts_with('-')
            && is_plain
            && plain
                .chars()
                .all(|it| it.is_ascii_alphanumeric() || "-_.".contains(it))
    };
    let words = names.split([' ', ',', '=', '[', '/', '|']).filter(is_name);
    let mut names: Vec<String> = words.map(str::to_owned).collect();
    let first = names.iter().position(|name| name.starts_with("--"))?;
    let first = names.remove(first);
    names.insert(0, first);
    Some(names)
}

/// The default that an option's description mentions.
fn default(about: &str) -> Option<String> {
    let after = about
        .split("default:")
        .nth(1)
        .or_else(|| about.split("default=").nth(1))?;
    let mut depth = 0;
    let mut text = String::new();
    for letter in after.trim_start().chars() {
        match letter {
            '(' | '[' => depth += 1,
            ')' | ']' if depth == 0 => break,
            ')' | ']' => depth -= 1,
            ';' if depth == 0 => break,
            _ => {}
        }
        text.push(letter);
    }
    let text = text.trim().trim_matches('\'').to_owned();
    (!text.is_empty() && text != "None").then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<(String, String)> {
        let help = Help::read(text);
        let shown = |it: HelpOption| (it.names.join(" "), it.default.unwrap_or_default());
        help.options.into_iter().map(shown).collect()
    }

    fn pairs(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
        pairs
            .iter()
            .map(|(a, b)| ((*a).to_owned(), (*b).to_owned()))
            .collect()
    }

    #[test]
    fn argparse() {
        let text = include_str!("../../fixtures/argparse.txt");
        let options = [
            ("--seed", "1"),
            ("--learning-rate --lr", "0.0003"),
            ("--total-timesteps", "500000"),
            ("--env-id -e", "CartPole-v1"),
            ("--track", "False"),
            ("--tag", ""),
        ];
        assert_eq!(read(text), pairs(&options));
    }

    #[test]
    fn tyro() {
        let text = include_str!("../../fixtures/tyro.txt");
        let options = [
            ("--seed", "1"),
            ("--learning-rate", "0.0003"),
            ("--env-id", "CartPole-v1"),
            ("--track --no-track", "False"),
            ("--layers", "64 64"),
        ];
        assert_eq!(read(text), pairs(&options));
    }

    #[test]
    fn click() {
        let text = include_str!("../../fixtures/click.txt");
        let options = [
            ("--seed", "1"),
            ("--lr", "0.0003"),
            ("--track --no-track", "no-track"),
            ("--layers", "2"),
        ];
        assert_eq!(read(text), pairs(&options));
    }

    #[test]
    fn hydra() {
        let text = include_str!("../../fixtures/hydra.txt");
        assert!(Help::read(text).is_hydra);
        assert_eq!(
            read(text),
            pairs(&[
                ("lr", "0.001"),
                ("optim.beta", "0.9"),
                ("optim.name", "adam"),
                ("seed", "1")
            ])
        );
    }

    #[test]
    fn text_that_is_no_help_has_no_options() {
        assert_eq!(
            Help::read("Traceback (most recent call last):\n- no\n--- a/b\n+++\n-- \n"),
            Help::default()
        );
    }
}
