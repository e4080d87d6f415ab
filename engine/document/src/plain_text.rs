//! Text from outside, made safe to show: without characters that control a terminal, that change the order of letters,
//! or that no document may contain.
//!
//! All output of this program goes through [`message`] or [`printable`]; colours are added last ([`coloured`]), so that
//! none comes from a text. Failure reports of other programs are shortened when they are received ([`brief`]).

use serde::{Deserialize, Deserializer};
use std::borrow::Cow;

/// Whether a character is not text: one that controls a terminal, changes the direction of the text around it, or is
/// invalid in XML.
#[must_use]
pub fn is_unprintable(letter: char) -> bool {
    letter.is_control() && !matches!(letter, '\n' | '\t')
        || is_direction(letter)
        || matches!(letter, '\u{fffe}' | '\u{ffff}')
}

/// Marks, embeddings, overrides and isolates of Unicode's bidirectional algorithm, which make a text look different
/// from its content. Letters of languages that are written from right to left need none.
fn is_direction(letter: char) -> bool {
    matches!(letter, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// The text with a replacement sign for every character that is not text.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    if text.contains(is_unprintable) {
        Cow::Owned(text.replace(is_unprintable, "\u{fffd}"))
    } else {
        Cow::Borrowed(text)
    }
}

/// Longest line of a message, in characters.
const LONGEST_LINE: usize = 4000;
/// Largest number of lines of a message.
const MOST_LINES: usize = 2000;
/// Longest failure report of another program, in characters.
const LONGEST_BRIEF: usize = 1000;
/// Longest end of an output that a failure quotes, in characters. It is shorter than [`LONGEST_BRIEF`] by the length of
/// a long sentence.
const LONGEST_LAST_WORDS: usize = 800;

/// A message for a terminal: printable, and of limited length.
#[must_use]
pub fn message(text: &str) -> Cow<'_, str> {
    let is_short = text.len() <= LONGEST_LINE || text.lines().all(|line| line.len() <= LONGEST_LINE);
    if is_short && text.lines().nth(MOST_LINES).is_none() {
        return printable(text);
    }
    let mut shown: Vec<Cow<'_, str>> = text
        .lines()
        .take(MOST_LINES)
        .map(|line| cut(line, LONGEST_LINE))
        .collect();
    if let Some(more @ 1..) = text.lines().count().checked_sub(MOST_LINES) {
        shown.push(format!("… and {more} more lines").into());
    }
    Cow::Owned(printable(&shown.join("\n")).into_owned())
}

/// The beginning of a line with this number of characters, the last one an ellipsis.
#[must_use]
pub fn cut(line: &str, longest: usize) -> Cow<'_, str> {
    match line.char_indices().nth(longest) {
        Some(_) => {
            let kept: String = line.chars().take(longest - 1).collect();
            Cow::Owned(kept + "…")
        }
        None => Cow::Borrowed(line),
    }
}

/// A failure report of another program, as it is kept and shown: one line, printable, not long.
#[must_use]
pub fn brief(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    cut(&printable(&line), LONGEST_BRIEF).into_owned()
}

/// The end of an output on one line, short enough that [`brief`] keeps the end of a sentence that quotes it.
#[must_use]
pub fn last_words(output: &str) -> String {
    // Python marks the position in a line on a line of its own, which has no meaning on a single line.
    let is_mark = |word: &&str| word.trim_matches(['^', '~']).is_empty();
    let words = output.split_whitespace().filter(|word| !is_mark(word));
    let line = words.collect::<Vec<_>>().join(" ");
    match line.char_indices().rev().nth(LONGEST_LAST_WORDS - 1) {
        Some((start @ 1.., _)) => format!("…{}", &line[start..]),
        _ => line,
    }
}

/// Reads a text and shortens it like [`brief`], since another program may have stored it.
///
/// # Errors
/// There is no text.
pub fn read_brief<'de, D: Deserializer<'de>>(reader: D) -> Result<String, D::Error> {
    Ok(brief(&String::deserialize(reader)?))
}

/// A message with colours for severities, the frames of positions, and the marks under them.
#[must_use]
pub fn coloured(message: &str) -> String {
    let lines: Vec<String> = message.split('\n').map(coloured_line).collect();
    lines.join("\n")
}

fn coloured_line(line: &str) -> String {
    let with = |code: &str, text: &str| match text {
        "" => String::new(),
        text => format!("\u{1b}[{code}m{text}\u{1b}[0m"),
    };
    for (word, code) in [("error", RED), ("warning", YELLOW), ("note", BLUE)] {
        if let Some(rest) = line.strip_prefix(word).filter(|rest| rest.starts_with(": ")) {
            let (colon, said) = rest.split_at(2);
            let said = if word == "note" {
                said.to_owned()
            } else {
                with(BOLD, said)
            };
            return format!("{}{colon}{said}", with(code, word));
        }
    }
    let inner = line.trim_start();
    let margin = &line[..line.len() - inner.len()];
    if let Some(place) = inner.strip_prefix("--> ") {
        return format!("{margin}{} {place}", with(BLUE, "-->"));
    }
    if let Some((word, said)) = inner.strip_prefix("= ").and_then(|rest| rest.split_once(": ")) {
        return format!("{margin}{} {}: {said}", with(BLUE, "="), with(BOLD, word));
    }
    let number = inner.trim_start_matches(|letter: char| letter.is_ascii_digit());
    if let Some(shown) = number.trim_start().strip_prefix('|') {
        let gutter = &line[..line.len() - shown.len()];
        let marks = shown.trim_start();
        let is_marked = !marks.is_empty() && marks.trim_end_matches(['^', '-']).is_empty();
        let blank = &shown[..shown.len() - marks.len()];
        let shown = if is_marked {
            format!("{blank}{}", with(RED, marks))
        } else {
            shown.to_owned()
        };
        return with(BLUE, gutter) + &shown;
    }
    line.to_owned()
}

const RED: &str = "1;31";
const YELLOW: &str = "1;33";
const BLUE: &str = "1;34";
const BOLD: &str = "1";

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_no_text_is_replaced_by_a_sign() {
        assert_eq!(printable("größe\t1\n\r"), "größe\t1\n\u{fffd}");
        assert_eq!(
            printable("a\u{1b}[2Jb\u{0}\u{9b}\u{ffff}"),
            "a\u{fffd}[2Jb\u{fffd}\u{fffd}\u{fffd}"
        );
        assert_eq!(printable("a\u{202e}b\u{2066}c"), "a\u{fffd}b\u{fffd}c");
        assert_eq!(printable("שלום 1"), "שלום 1");
    }

    #[test]
    fn the_end_of_an_output_stands_in_a_brief_sentence() {
        let output = format!(
            "{}\nZeroDivisionError: division by zero\n",
            "a line of a traceback\n".repeat(100)
        );
        let quoted = last_words(&output);
        let kept = brief(&format!(
            "`python3 {}` left with exit code 1; it said last: {quoted}",
            "a".repeat(100)
        ));
        assert!(
            quoted.starts_with('…') && kept.ends_with("ZeroDivisionError: division by zero"),
            "{kept}"
        );
        assert_eq!(last_words("it\n ~~^^\n broke"), "it broke");
    }

    #[test]
    fn colours_are_this_programs_own() {
        let text = "error: \u{1b}[31mred\u{1b}[0m is no number\n --> a.yaml:3:5\n  |\n3 | a: red\n  |    ^^^\n  = help: \
                    write a number";
        let shown = coloured(&message(text));
        assert!(
            shown.starts_with("\u{1b}[1;31merror\u{1b}[0m: \u{1b}[1m\u{fffd}[31mred"),
            "{shown:?}"
        );
        for piece in [
            "\u{1b}[1;34m-->\u{1b}[0m a.yaml",
            "\u{1b}[1;34m3 |\u{1b}[0m a: red",
            "\u{1b}[1;31m^^^\u{1b}[0m",
        ] {
            assert!(shown.contains(piece), "{shown:?}");
        }
        assert!(
            shown.contains("\u{1b}[1mhelp\u{1b}[0m: write a number"),
            "{shown:?}"
        );
        assert_eq!(coloured("3 trials ended"), "3 trials ended");
    }

    #[test]
    fn what_nobody_reads_to_its_end_is_cut() {
        let long = message(&"z".repeat(100_000)).into_owned();
        assert_eq!((long.chars().count(), long.ends_with("z…")), (LONGEST_LINE, true));
        let many = message(&"z\n".repeat(100_000)).into_owned();
        assert!(many.ends_with("… and 98000 more lines"));
        let said = brief(&format!("boom\n\u{1b}[31m  {}", "z".repeat(100_000)));
        assert_eq!(said.chars().count(), LONGEST_BRIEF);
        assert!(said.starts_with("boom \u{fffd}[31m zzz"), "{said}");
        assert_eq!(brief(&said), said);
    }

    proptest! {
        #[test]
        fn no_message_has_a_character_that_a_terminal_acts_on(text in "(?s).*", wild in any::<Vec<char>>()) {
            let text = text + &wild.into_iter().collect::<String>();
            for shown in [message(&text).into_owned(), brief(&text)] {
                prop_assert!(!shown.contains(|letter: char| letter.is_control() && !"\n\t".contains(letter)));
            }
            // Apart from its colours, a coloured message is the message.
            let plain = message(&text);
            let without = [RED, YELLOW, BLUE, BOLD, "0"].iter().fold(coloured(&plain), |text, code| {
                text.replace(&format!("\u{1b}[{code}m"), "")
            });
            prop_assert_eq!(without, plain.into_owned());
        }
    }
}
