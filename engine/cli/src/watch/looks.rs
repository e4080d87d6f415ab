//! The look of the agents of a panel in a terminal: the best agents have names, and marks or colours.

use super::{Panel, Standing, View, short::shortened};
use ratatui::{
    style::{Color, Style},
    symbols::Marker,
    text::{Line, Span},
};

/// Colours that every terminal has, distinct on a light and on a dark background.
const COLOURS: [Color; 6] = [
    Color::Cyan,
    Color::Yellow,
    Color::Magenta,
    Color::Green,
    Color::Blue,
    Color::Red,
];
/// Marks that replace colours, with their symbols in a legend.
const MARKS: [(Marker, &str); 3] = [(Marker::Braille, "⠒"), (Marker::Dot, "•"), (Marker::Block, "█")];
/// Number of agents with names and colours. If there are more, the best ones have them, and the others are grey.
const NAMED: usize = 5;

/// The look of the agents of a panel.
pub(super) struct Looks<'a> {
    /// Agents with names, the best first.
    named: Vec<(Standing<'a>, usize)>,
    /// Number of grey agents.
    others: usize,
    colours: bool,
}

impl<'a> Looks<'a> {
    pub(super) fn of(view: &View, panel: &'a Panel, metric: &str, colours: bool) -> Self {
        let standing = view.standing(panel, metric);
        let others = if standing.len() > NAMED {
            standing.len() - NAMED
        } else {
            0
        };
        // If some agents are grey, no two of the best look alike; otherwise agents keep their look while their ranks
        // change.
        let look = |(rank, it): (usize, Standing<'a>)| {
            let look = if others > 0 { rank } else { it.agent };
            (it, look)
        };
        Self {
            named: standing.into_iter().take(NAMED).enumerate().map(look).collect(),
            others,
            colours,
        }
    }

    /// The names with their values in as many lines as they need.
    pub(super) fn legend(&self, width: usize) -> Vec<Line<'static>> {
        if self.named.is_empty() {
            return vec![Line::raw("  nothing is recorded yet")];
        }
        let values: Vec<String> = self.named.iter().map(|(it, _)| it.in_words()).collect();
        let widest = values.iter().map(String::len).max().unwrap_or(0);
        let names: Vec<&str> = self.named.iter().map(|(it, _)| it.name).collect();
        let names = shortened(&names, width.saturating_sub(widest + 5));
        let entries = names
            .iter()
            .zip(&values)
            .zip(&self.named)
            .map(|((name, value), (_, look))| {
                let (_, mark) = self.mark(*look);
                (format!("{mark} {name} {value}"), self.style(*look))
            });
        let grey = match (self.others, self.colours) {
            (0, _) => None,
            (n, true) => Some((format!("⠒ {n} others"), Style::new().fg(Color::DarkGray))),
            (n, false) => Some((format!("{n} others are not drawn"), Style::new())),
        };
        in_lines(entries.chain(grey), width)
    }

    /// The mark and the style of the lines of an agent; `None` if its lines are not drawn.
    pub(super) fn of_agent(&self, agent: usize) -> Option<(Marker, Style)> {
        let named = self.named.iter().find(|(it, _)| it.agent == agent);
        match named {
            Some((_, look)) => Some((self.mark(*look).0, self.style(*look))),
            // Without colours, lines of agents without a name would hide those with one.
            None => self
                .colours
                .then(|| (Marker::Braille, Style::new().fg(Color::DarkGray))),
        }
    }

    pub(super) fn has_name(&self, agent: usize) -> bool {
        self.named.iter().any(|(it, _)| it.agent == agent)
    }

    fn mark(&self, look: usize) -> (Marker, &'static str) {
        MARKS[if self.colours { 0 } else { look % MARKS.len() }]
    }

    fn style(&self, look: usize) -> Style {
        if self.colours {
            Style::new().fg(COLOURS[look % COLOURS.len()])
        } else {
            Style::new()
        }
    }
}

/// Texts side by side, as many in a line as fit.
fn in_lines(entries: impl Iterator<Item = (String, Style)>, width: usize) -> Vec<Line<'static>> {
    let mut lines: Vec<Line<'static>> = Vec::new();
    let mut used = usize::MAX;
    for (text, style) in entries {
        let room = text.chars().count() + 2;
        if used.saturating_add(room) > width {
            lines.push(Line::default());
            used = 0;
        }
        used += room;
        if let Some(line) = lines.last_mut() {
            line.push_span(Span::raw("  "));
            line.push_span(Span::styled(text, style));
        }
    }
    lines
}
