//! Text from outside as people see it: nothing that a terminal acts on, and nothing that no document may hold.

use std::borrow::Cow;

/// True for characters that are no text: those that control a terminal, and those that XML does not know.
#[must_use]
pub fn is_unprintable(letter: char) -> bool {
    letter.is_control() && !matches!(letter, '\n' | '\t') || matches!(letter, '\u{fffe}' | '\u{ffff}')
}

/// The text with a sign in the place of every character that is none.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    if text.contains(is_unprintable) {
        Cow::Owned(text.replace(is_unprintable, "\u{fffd}"))
    } else {
        Cow::Borrowed(text)
    }
}

/// As [`printable`]; codes that colour what follows stay, and whatever else a terminal obeys does not.
#[must_use]
pub fn for_terminal(text: &str) -> Cow<'_, str> {
    if !text.contains('\u{1b}') {
        return printable(text);
    }
    let mut pieces = text.split('\u{1b}');
    let mut out = printable(pieces.next().unwrap_or_default()).into_owned();
    for piece in pieces {
        out.push(if is_colour(piece) { '\u{1b}' } else { '\u{fffd}' });
        out.push_str(&printable(piece));
    }
    Cow::Owned(out)
}

/// True where a text begins with what an escape character makes a colour of.
fn is_colour(text: &str) -> bool {
    let digits = text
        .strip_prefix('[')
        .map(|rest| rest.trim_start_matches(|letter: char| letter.is_ascii_digit() || letter == ';'));
    digits.is_some_and(|rest| rest.starts_with('m'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_text_is_replaced_by_a_sign() {
        assert_eq!(printable("größe\t1\n\r"), "größe\t1\n\u{fffd}");
        assert_eq!(
            printable("a\u{1b}[2Jb\u{0}\u{9b}\u{ffff}"),
            "a\u{fffd}[2Jb\u{fffd}\u{fffd}\u{fffd}"
        );
    }

    #[test]
    fn of_what_a_terminal_obeys_colours_stay() {
        let text = "\u{1b}[1;31merror\u{1b}[0m: \u{1b}[2J\u{1b}]0;title\u{7}";
        let expected = "\u{1b}[1;31merror\u{1b}[0m: \u{fffd}[2J\u{fffd}]0;title\u{fffd}";
        assert_eq!(for_terminal(text), expected);
    }
}
