//! Splits a command line into words, like a shell without expansions.

use super::error::DraftRefusal;
use std::collections::BTreeMap;

/// Signs that mean something to a shell only.
const SIGNS: [char; 9] = ['|', '&', ';', '<', '>', '$', '`', '*', '('];

/// The words of a command line.
///
/// # Errors
/// [`DraftRefusal::OpenQuote`], [`DraftRefusal::Shell`] for signs that only a shell understands, and
/// [`DraftRefusal::Nothing`].
pub fn words(command: &str) -> Result<Vec<String>, DraftRefusal> {
    let (mut words, mut word) = (Vec::new(), None::<String>);
    let mut letters = command.chars();
    while let Some(letter) = letters.next() {
        match letter {
            '\'' | '"' => {
                let word = word.get_or_insert_default();
                quoted(&mut letters, letter, word).ok_or_else(|| DraftRefusal::OpenQuote(command.into()))?;
            }
            '\\' => word.get_or_insert_default().extend(letters.next()),
            _ if letter.is_whitespace() => words.extend(word.take()),
            sign if SIGNS.contains(&sign) => {
                return Err(DraftRefusal::Shell {
                    command: command.into(),
                    sign,
                });
            }
            _ => word.get_or_insert_default().push(letter),
        }
    }
    words.extend(word);
    if words.is_empty() {
        return Err(DraftRefusal::Nothing);
    }
    Ok(words)
}

/// Takes the assignments before a program, as in `LR=3 python train.py`, out of the words.
///
/// # Errors
/// [`DraftRefusal::Nothing`] where no program follows them.
pub fn take_variables(words: &mut Vec<String>) -> Result<BTreeMap<String, String>, DraftRefusal> {
    let is_name = |name: &str| {
        name.starts_with(|it: char| it.is_ascii_alphabetic() || it == '_')
            && name.chars().all(|it| it.is_ascii_alphanumeric() || it == '_')
    };
    let assignment = |word: &String| {
        let (name, value) = word.split_once('=').filter(|(name, _)| is_name(name))?;
        Some((name.to_owned(), value.to_owned()))
    };
    let all: Vec<(String, String)> = words.iter().map_while(assignment).collect();
    if all.len() == words.len() {
        return Err(DraftRefusal::Nothing);
    }
    words.drain(..all.len());
    Ok(all.into_iter().collect())
}

/// Reads up to the closing quote; `None` where it is missing.
fn quoted(letters: &mut std::str::Chars<'_>, quote: char, word: &mut String) -> Option<()> {
    loop {
        match letters.next()? {
            letter if letter == quote => return Some(()),
            '\\' if quote == '"' => word.push(letters.next()?),
            letter => word.push(letter),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_those_of_a_shell() {
        let read = |text| words(text).unwrap();
        assert_eq!(
            read("python train.py  --lr 3e-4"),
            ["python", "train.py", "--lr", "3e-4"]
        );
        assert_eq!(
            read(r#"a 'b c' "d\"e" f\ g --x='' h"i"j"#),
            ["a", "b c", "d\"e", "f g", "--x=", "hij"]
        );
        assert_eq!(read("a 'choice(1,2)' '$HOME'"), ["a", "choice(1,2)", "$HOME"]);
    }

    #[test]
    fn assignments_before_the_program_are_variables() {
        let mut all = words("LR=3 NAME='a b' python train.py x=1").unwrap();
        let variables = take_variables(&mut all).unwrap();
        let expected =
            [("LR", "3"), ("NAME", "a b")].map(|(name, value)| (name.to_owned(), value.to_owned()));
        assert_eq!(variables, expected.into());
        assert_eq!(all, ["python", "train.py", "x=1"]);
        assert!(take_variables(&mut vec!["LR=3".into()]).is_err());
    }

    #[test]
    fn a_command_for_a_shell_is_refused_by_its_sign() {
        let told = |text| words(text).unwrap_err().to_string();
        assert!(told("a | tee log").contains("`|` in `a | tee log`"));
        assert!(told("a --out $HOME").contains("`$`"));
        assert!(told("a 'b").contains("a quote without an end"));
        assert!(told("  ").contains("names no program"));
    }
}
