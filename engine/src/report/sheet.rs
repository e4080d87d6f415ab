//! A table about the study itself, of words and numbers that are written already; one renderer each for Markdown and the page.

use crate::table::{escape_html, escape_markdown, prose};

/// A table with its notes. The first column heads the rows.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Sheet {
    /// What stands above it; empty where its section says enough.
    pub(super) title: String,
    /// Headings of the columns.
    pub(super) head: Vec<String>,
    /// How many columns, from the left, hold words; the others hold numbers.
    pub(super) words: usize,
    /// The rows, an entry per column.
    pub(super) rows: Vec<Vec<Entry>>,
    /// Sentences under the table.
    pub(super) notes: Vec<String>,
}

/// One entry of a sheet.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Entry {
    /// What is written.
    pub(super) text: String,
    /// How it is written.
    pub(super) tone: Tone,
}

/// How much an entry wants to be seen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Tone {
    /// Like any other.
    #[default]
    Plain,
    /// Less than others: it is as expected.
    Quiet,
    /// More than others: something is not well.
    Alarm,
}

impl Entry {
    /// An entry like any other.
    pub(super) fn plain(text: impl Into<String>) -> Self {
        Self { text: text.into(), tone: Tone::Plain }
    }
}

impl Sheet {
    /// The sheet in Markdown.
    pub(super) fn markdown(&self) -> String {
        let line = |cells: Vec<String>| format!("| {} |", cells.join(" | "));
        let rule = |column: usize| if column < self.words { "---" } else { "--:" };
        let mut lines = vec![
            line(self.head.iter().map(|cell| escape_markdown(cell)).collect()),
            format!("|{}|", (0..self.head.len()).map(rule).collect::<Vec<_>>().join("|")),
        ];
        lines.extend(self.rows.iter().map(|row| line(row.iter().map(Entry::markdown).collect())));
        let title = (!self.title.is_empty()).then(|| format!("### {}", prose::markdown(&self.title)));
        let notes = self.notes.iter().map(|note| prose::markdown(note));
        title.into_iter().chain([lines.join("\n")]).chain(notes).collect::<Vec<_>>().join("\n\n")
    }

    /// The sheet in HTML.
    pub(super) fn html(&self) -> String {
        let class = |column: usize| if column < self.words { "" } else { " class=\"value\"" };
        let heading = |(column, cell): (usize, &String)| format!("<th scope=\"col\"{}>{}</th>", class(column), escape_html(cell));
        let head: String = self.head.iter().enumerate().map(heading).collect();
        let cell = |(column, entry): (usize, &Entry)| match column {
            0 => format!("<th scope=\"row\">{}</th>", entry.html()),
            _ => format!("<td{}>{}</td>", class(column), entry.html()),
        };
        let row = |row: &Vec<Entry>| format!("<tr>{}</tr>\n", row.iter().enumerate().map(cell).collect::<String>());
        let rows: String = self.rows.iter().map(row).collect();
        let notes: String = self.notes.iter().map(|note| format!("<p>{}</p>\n", prose::html(note))).collect();
        let title = if self.title.is_empty() { String::new() } else { format!("<h3>{}</h3>\n", prose::html(&self.title)) };
        format!(
            "<article>\n{title}<div class=\"wide\">\n<table>\n<thead><tr>{head}</tr></thead>\n\
             <tbody>\n{rows}</tbody>\n</table>\n</div>\n\
             <div class=\"notes\">\n{notes}</div>\n</article>\n"
        )
    }
}

impl Entry {
    fn markdown(&self) -> String {
        let text = escape_markdown(&self.text);
        if self.tone == Tone::Alarm { format!("**{text}**") } else { text }
    }

    fn html(&self) -> String {
        let text = escape_html(&self.text);
        match self.tone {
            Tone::Plain => text,
            Tone::Quiet => format!("<span class=\"quiet\">{text}</span>"),
            Tone::Alarm => format!("<b class=\"problem\">{text}</b>"),
        }
    }
}
