//! Sentences in which words between backticks are names of parts of a study: captions, notes, deviations,
//! reasons.

use super::{latex::escape as escape_latex, markdown::escape as escape_markdown};
use document::plain_text::printable;
use maud::{Markup, html};

/// The sentence in HTML.
#[must_use]
pub fn html(text: &str) -> Markup {
    let pieces = pieces(text, with_whole_numbers, |name| html! { code { (name) } });
    html! { @for piece in pieces { (piece) } }
}

/// Text in HTML without line breaks inside a number, at its sign or at the sign of its exponent.
#[must_use]
pub fn with_whole_numbers(text: &str) -> Markup {
    let is_of_number = |letter: char| letter.is_ascii_digit() || "eE.,;:+-()[]%".contains(letter);
    let is_broken = |word: &str| word.contains('-') && word.len() > 1 && word.chars().all(is_of_number);
    html! {
        @for (index, word) in text.split(' ').enumerate() {
            @if index > 0 { " " }
            @if is_broken(word) { span.number { (word) } } @else { (word) }
        }
    }
}

/// The sentence in Markdown.
#[must_use]
pub fn markdown(text: &str) -> String {
    pieces(text, escape_markdown, |name| format!("`{name}`")).concat()
}

/// The sentence in LaTeX.
#[must_use]
pub fn latex(text: &str) -> String {
    let name = |name: &str| format!("\\texttt{{{}}}", escape_latex(name));
    pieces(text, escape_latex, name).concat()
}

/// Splits a sentence at backticks; every second part is a name. A backtick without its pair is an ordinary character.
fn pieces<T>(text: &str, plain: fn(&str) -> T, name: fn(&str) -> T) -> Vec<T> {
    let text = printable(text);
    let parts: Vec<&str> = text.split('`').collect();
    let paired = parts.len() - 1 - (parts.len() - 1) % 2;
    let part = |(index, part): (usize, &&str)| match index {
        index if index > paired => plain(&format!("`{part}")),
        index if index % 2 == 1 => name(part),
        _ => plain(part),
    };
    parts.iter().enumerate().map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stay_whole_and_names_are_broken() {
        assert_eq!(
            html("e2e of a-1: (2.5e-3 against 4)").into_string(),
            "e2e of a-1: <span class=\"number\">(2.5e-3</span> against 4)"
        );
    }

    #[test]
    fn names_are_marked_and_all_else_is_plain() {
        assert_eq!(
            html("`a_b` < <i>").into_string(),
            "<code>a_b</code> &lt; &lt;i&gt;"
        );
        assert_eq!(markdown("the `a_b` of a_b *"), "the `a_b` of a\\_b \\*");
        assert_eq!(latex("the `a_b` of 5 %"), "the \\texttt{a\\_b} of 5 \\%");
        assert_eq!(markdown("`a` and ` alone"), "`a` and \\` alone");
        assert_eq!(html("no names").into_string(), "no names");
    }
}
