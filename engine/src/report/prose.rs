//! Sentences of a study in which words between backticks are names of its parts.

use crate::table::{escape_html, escape_markdown};

/// The sentence in HTML.
pub(super) fn html(text: &str) -> String {
    render(text, escape_html, |code| format!("<code>{}</code>", escape_html(code)))
}

/// The sentence in Markdown.
pub(super) fn markdown(text: &str) -> String {
    render(text, escape_markdown, |code| format!("`{code}`"))
}

/// Every second part between backticks is a name. A backtick without its pair is a character like any other.
fn render(text: &str, plain: fn(&str) -> String, name: fn(&str) -> String) -> String {
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
    fn names_are_marked_and_all_else_is_plain() {
        assert_eq!(html("`a_b` < <i>"), "<code>a_b</code> &lt; &lt;i&gt;");
        assert_eq!(markdown("the `a_b` of a_b *"), "the `a_b` of a\\_b \\*");
        assert_eq!(markdown("`a` and ` alone"), "`a` and \\` alone");
        assert_eq!(html("no names"), "no names");
    }
}
