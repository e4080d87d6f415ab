//! Sentences in which words between backticks are names of parts of a study: captions, notes, deviations,
//! reasons.

use super::{
    html::escape as escape_html, latex::escape as escape_latex, markdown::escape as escape_markdown,
};
use document::plain_text::printable;

/// The sentence in HTML.
#[must_use]
pub fn html(text: &str) -> String {
    let plain = |words: &str| with_whole_numbers(&escape_html(words));
    render(text, plain, |code| format!("<code>{}</code>", escape_html(code)))
}

/// HTML in which no number is broken over lines at its sign or at that of its exponent.
#[must_use]
pub fn with_whole_numbers(text: &str) -> String {
    let is_of_number = |letter: char| letter.is_ascii_digit() || "eE.,;:+-()[]%".contains(letter);
    let is_broken = |word: &&str| word.contains('-') && word.len() > 1 && word.chars().all(is_of_number);
    let words = text.split(' ').map(|word| match Some(word).filter(is_broken) {
        Some(number) => format!("<span class=\"number\">{number}</span>"),
        None => word.to_owned(),
    });
    words.collect::<Vec<_>>().join(" ")
}

/// The sentence in Markdown.
#[must_use]
pub fn markdown(text: &str) -> String {
    render(text, escape_markdown, |code| format!("`{code}`"))
}

/// The sentence in LaTeX.
#[must_use]
pub fn latex(text: &str) -> String {
    render(text, escape_latex, |code| {
        format!("\\texttt{{{}}}", escape_latex(code))
    })
}

/// Every second part between backticks is a name. A backtick without its pair is a character like any other.
fn render(text: &str, plain: fn(&str) -> String, name: fn(&str) -> String) -> String {
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
            html("e2e of a-1: (2.5e-3 against 4)"),
            "e2e of a-1: <span class=\"number\">(2.5e-3</span> against 4)"
        );
    }

    #[test]
    fn names_are_marked_and_all_else_is_plain() {
        assert_eq!(html("`a_b` < <i>"), "<code>a_b</code> &lt; &lt;i&gt;");
        assert_eq!(markdown("the `a_b` of a_b *"), "the `a_b` of a\\_b \\*");
        assert_eq!(latex("the `a_b` of 5 %"), "the \\texttt{a\\_b} of 5 \\%");
        assert_eq!(markdown("`a` and ` alone"), "`a` and \\` alone");
        assert_eq!(html("no names"), "no names");
    }
}
