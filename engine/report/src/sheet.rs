//! A table about the study itself, of words and numbers that are already text; one renderer each for Markdown and the
//! page.

use super::on_paper::{ColumnWidths, PaperFit};
use maud::{Markup, html};
use presentation::table::{escape_markdown, markdown_row, prose, verdict_word};

/// Text of an empty cell.
pub(super) const NONE: &str = "–";

/// A table with its notes. The first column heads the rows.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Sheet {
    /// Title above the table; empty where the heading of the section is enough.
    pub(super) title: String,
    /// Headings of the columns.
    pub(super) head: Vec<String>,
    /// Number of columns with words, from the left; the others have numbers.
    pub(super) words: usize,
    /// The rows, an entry per column.
    pub(super) rows: Vec<Vec<SheetEntry>>,
    /// Sentences under the table.
    pub(super) notes: Vec<String>,
}

/// One entry of a sheet.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct SheetEntry {
    /// Text of the entry.
    pub(super) text: String,
    /// Kind of the entry.
    pub(super) tone: Tone,
    /// Address of its link; empty without a link.
    pub(super) link: String,
}

/// Kind of an entry, and its emphasis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Tone {
    /// An entry without emphasis.
    #[default]
    Plain,
    /// Less emphasis than others: the value is as expected.
    Quiet,
    /// More emphasis than others: something is wrong.
    Alarm,
    /// A formula in the notation of a study.
    Code,
    /// A verdict, in the colour of this word.
    Verdict(&'static str),
    /// Sentences with names between backticks; on a narrow page the rows of a table with such entries become
    /// lists.
    Sentence,
}

impl SheetEntry {
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

    /// The same entry with a link.
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
                .map(|row| markdown_row(row.iter().map(SheetEntry::markdown))),
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
    pub(super) fn html(&self) -> Markup {
        let is_text = self
            .rows
            .iter()
            .flatten()
            .any(|entry| entry.tone == Tone::Sentence);
        let paper = (!is_text).then(|| PaperFit::of(&self.columns()));
        let lines = self.lines(is_text);
        html! {
            article class=[paper.and_then(PaperFit::class)] {
                @if !self.title.is_empty() { h3 { (prose::html(&self.title)) } }
                @match paper {
                    Some(paper) => (paper.around(&html! { table { (lines) } })),
                    None => table.text { (lines) }
                }
                @if !self.notes.is_empty() {
                    div.notes {
                        @for note in &self.notes { p { (prose::html(note)) } }
                    }
                }
            }
        }
    }

    fn columns(&self) -> Vec<ColumnWidths> {
        let column = |(index, head): (usize, &String)| {
            let texts = self
                .rows
                .iter()
                .filter_map(|row| row.get(index))
                .map(|entry| entry.text.as_str());
            ColumnWidths::of(head, texts, index < self.words)
        };
        self.head.iter().enumerate().map(column).collect()
    }

    /// The rows; in a list (`is_text`) each entry stands after its heading.
    fn lines(&self, is_text: bool) -> Markup {
        let class = |column: usize| (column >= self.words).then_some("value");
        let heading = |column: usize| is_text.then(|| &self.head[column]);
        html! {
            thead {
                tr {
                    @for (column, cell) in self.head.iter().enumerate() {
                        th scope="col" class=[class(column)] { (cell) }
                    }
                }
            }
            tbody {
                @for row in &self.rows {
                    tr {
                        @for (column, entry) in row.iter().enumerate() {
                            @if column == 0 {
                                th scope="row" data-heading=[heading(0)] { (entry.html()) }
                            } @else {
                                td class=[class(column)] data-heading=[heading(column)] { (entry.html()) }
                            }
                        }
                    }
                }
            }
        }
    }
}

impl SheetEntry {
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
            // A bar would end the cell, and a line break the row.
            Tone::Code => format!("`{}`", self.text.replace('|', "\\|").replace(['\n', '\r'], " ")),
            Tone::Sentence => prose::markdown(&self.text),
        }
    }

    fn html(&self) -> Markup {
        if self.link.is_empty() {
            self.words_in_html()
        } else {
            html! { a href=(self.link) { (self.words_in_html()) } }
        }
    }

    fn words_in_html(&self) -> Markup {
        let text = &self.text;
        match self.tone {
            Tone::Plain => prose::with_whole_numbers(text),
            Tone::Quiet => html! { span.quiet { (text) } },
            Tone::Alarm => html! { b.problem { (text) } },
            Tone::Code => html! { code { (text) } },
            Tone::Verdict(word) => verdict_word(word, text),
            Tone::Sentence => prose::html(text),
        }
    }
}
