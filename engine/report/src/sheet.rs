//! A table about the study itself, of words and numbers that are written already; one renderer each for
//! Markdown and the page.

use super::on_paper::{Column, OnPaper};
use presentation::table::{escape_html, escape_markdown, markdown_row, prose, verdict_word};

/// What stands where there is nothing to write.
pub(super) const NONE: &str = "–";

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
    /// Where it leads; empty for nowhere.
    pub(super) link: String,
}

/// What an entry is, and how much it wants to be seen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Tone {
    /// Like any other.
    #[default]
    Plain,
    /// Less than others: it is as expected.
    Quiet,
    /// More than others: something is not well.
    Alarm,
    /// A formula that a study has so.
    Code,
    /// A verdict, in the colour of this word.
    Verdict(&'static str),
    /// Sentences with names between backticks; on a narrow page the rows of a table with such entries become
    /// lists.
    Sentence,
}

impl Entry {
    /// An entry like any other.
    pub(super) fn plain(text: impl Into<String>) -> Self {
        Self::of(Tone::Plain, text)
    }

    /// An entry of any kind.
    pub(super) fn of(tone: Tone, text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            tone,
            link: String::new(),
        }
    }

    /// The same, leading somewhere.
    pub(super) fn to(mut self, link: impl Into<String>) -> Self {
        self.link = link.into();
        self
    }
}

impl Sheet {
    /// The sheet in Markdown.
    pub(super) fn markdown(&self) -> String {
        let rule = |column: usize| if column < self.words { "---" } else { "--:" };
        let mut lines = vec![
            markdown_row(self.head.iter().map(|cell| escape_markdown(cell))),
            format!(
                "|{}|",
                (0..self.head.len()).map(rule).collect::<Vec<_>>().join("|")
            ),
        ];
        lines.extend(
            self.rows
                .iter()
                .map(|row| markdown_row(row.iter().map(Entry::markdown))),
        );
        let title = (!self.title.is_empty()).then(|| format!("### {}", prose::markdown(&self.title)));
        let notes = self.notes.iter().map(|note| prose::markdown(note));
        title
            .into_iter()
            .chain([lines.join("\n")])
            .chain(notes)
            .collect::<Vec<_>>()
            .join("\n\n")
    }

    /// The sheet in HTML.
    pub(super) fn html(&self) -> String {
        let title = if self.title.is_empty() {
            String::new()
        } else {
            format!("<h3>{}</h3>\n", prose::html(&self.title))
        };
        let notes: String = self
            .notes
            .iter()
            .map(|note| format!("<p>{}</p>\n", prose::html(note)))
            .collect();
        let notes = if notes.is_empty() {
            notes
        } else {
            format!("<div class=\"notes\">\n{notes}</div>\n")
        };
        if self.is_text() {
            let table = format!("<table class=\"text\">\n{}</table>\n", self.lines());
            return format!("<article>\n{title}{table}{notes}</article>\n");
        }
        let paper = OnPaper::of(&self.columns());
        format!(
            "<article{}>\n{title}{}\n<table>\n{}</table>\n</div>\n{notes}</article>\n",
            paper.class(),
            paper.open(),
            self.lines()
        )
    }

    fn columns(&self) -> Vec<Column> {
        let column = |(index, head): (usize, &String)| {
            let texts = self
                .rows
                .iter()
                .filter_map(|row| row.get(index))
                .map(|entry| entry.text.as_str());
            Column::of(head, texts, index < self.words)
        };
        self.head.iter().enumerate().map(column).collect()
    }

    fn is_text(&self) -> bool {
        self.rows
            .iter()
            .flatten()
            .any(|entry| entry.tone == Tone::Sentence)
    }

    fn lines(&self) -> String {
        let class = |column: usize| {
            if column < self.words {
                ""
            } else {
                " class=\"value\""
            }
        };
        let heading = |(column, cell): (usize, &String)| {
            format!("<th scope=\"col\"{}>{}</th>", class(column), escape_html(cell))
        };
        let head: String = self.head.iter().enumerate().map(heading).collect();
        // In a list each entry stands behind its heading.
        let named = |column: usize| format!(" data-heading=\"{}\"", escape_html(&self.head[column]));
        // Asked once: every entry of the sheet is looked at for it.
        let is_text = self.is_text();
        let name = |column: usize| {
            if is_text { named(column) } else { String::new() }
        };
        let cell = |(column, entry): (usize, &Entry)| match column {
            0 => format!("<th scope=\"row\"{}>{}</th>", name(0), entry.html()),
            _ => format!("<td{}{}>{}</td>", class(column), name(column), entry.html()),
        };
        let row = |row: &Vec<Entry>| {
            format!(
                "<tr>{}</tr>\n",
                row.iter().enumerate().map(cell).collect::<String>()
            )
        };
        let rows: String = self.rows.iter().map(row).collect();
        format!("<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n")
    }
}

impl Entry {
    pub(super) fn markdown(&self) -> String {
        let text = self.words_in_markdown();
        if self.link.is_empty() {
            text
        } else {
            format!("[{text}]({})", self.link)
        }
    }

    fn words_in_markdown(&self) -> String {
        match self.tone {
            Tone::Plain | Tone::Quiet | Tone::Verdict(_) => escape_markdown(&self.text),
            Tone::Alarm => format!("**{}**", escape_markdown(&self.text)),
            // A bar would end the cell, and a line the row.
            Tone::Code => format!("`{}`", self.text.replace('|', "\\|").replace(['\n', '\r'], " ")),
            Tone::Sentence => prose::markdown(&self.text),
        }
    }

    fn html(&self) -> String {
        let text = self.words_in_html();
        if self.link.is_empty() {
            text
        } else {
            format!("<a href=\"{}\">{text}</a>", escape_html(&self.link))
        }
    }

    fn words_in_html(&self) -> String {
        let text = escape_html(&self.text);
        match self.tone {
            Tone::Plain => prose::with_whole_numbers(&text),
            Tone::Quiet => format!("<span class=\"quiet\">{text}</span>"),
            Tone::Alarm => format!("<b class=\"problem\">{text}</b>"),
            Tone::Code => format!("<code>{text}</code>"),
            Tone::Verdict(word) => verdict_word(word, &self.text),
            Tone::Sentence => prose::html(&self.text),
        }
    }
}
