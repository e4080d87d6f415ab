//! Names below a horizontal axis of categories: level, or upright if neighbours would overlap.

use super::{
    axes::{LINE, OVERHANG, TEXT, TICK, break_lines},
    layout::{count, text},
    paint::{Align, Mark, Position, text_width},
    style::INK,
};

/// Least room between the words of neighbours, in points.
const APART: f64 = 1.0;
/// Longest upright line that is not broken between words, in points.
const LONG: f64 = 70.0;
/// Longest upright line, in points; a longer one loses its middle.
const LONGEST: f64 = 120.0;

/// Names with the position of the tick of each, whose vertical part is the end of the axis.
pub(super) struct CategoryLabels {
    ticks: Vec<Position>,
    /// The lines of each name.
    lines: Vec<Vec<String>>,
    is_upright: bool,
    /// The right edge that no level name crosses.
    edge: f64,
}

impl CategoryLabels {
    /// Lays the names out along an axis that ends at `right`; each has `slot` points of its length.
    pub(super) fn of(names: Vec<(Position, String)>, slot: f64, right: f64) -> Self {
        let (ticks, names): (Vec<Position>, Vec<String>) = names.into_iter().unzip();
        let level = Self {
            ticks,
            lines: names.iter().map(|name| break_lines(name, slot - 4.0)).collect(),
            is_upright: false,
            edge: right + OVERHANG,
        };
        if !level.overlap() {
            return level;
        }
        Self {
            lines: names.iter().map(|name| upright_lines(name, slot)).collect(),
            is_upright: true,
            ..level
        }
    }

    /// Depth to which the names reach below the axis, in points.
    pub(super) fn depth(&self) -> f64 {
        let reach = if self.is_upright {
            let lines = self.lines.iter().flatten();
            lines.map(|line| text_width(line, TEXT)).fold(LINE, f64::max)
        } else {
            LINE * self
                .lines
                .iter()
                .map(|lines| count(lines.len()))
                .fold(1.0, f64::max)
        };
        TICK + 2.0 + reach
    }

    /// The marks of a name.
    pub(super) fn marks(&self, index: usize) -> Vec<Mark> {
        let (x, bottom) = self.ticks[index];
        let lines = &self.lines[index];
        let mark = |(place, line): (usize, &String)| {
            if self.is_upright {
                let across = LINE * (count(place) - (count(lines.len()) - 1.0) / 2.0);
                return Mark::Text {
                    at: (x + across, bottom + TICK + 2.0),
                    text: line.clone(),
                    size: TEXT,
                    align: Align::Right,
                    upright: true,
                    color: INK,
                };
            }
            let down = TICK + 2.0 + LINE * (count(place) + 0.5);
            text((self.middle(x, line), bottom + down), line, Align::Center)
        };
        lines.iter().enumerate().map(mark).collect()
    }

    /// The middle of a level line; a wide one moves to the left until it fits.
    fn middle(&self, x: f64, line: &str) -> f64 {
        x.min(self.edge - text_width(line, TEXT) / 2.0)
    }

    /// Whether lines of neighbours overlap, or touch.
    fn overlap(&self) -> bool {
        let ends = |index: usize, line: &String| {
            let (middle, half) = (
                self.middle(self.ticks[index].0, line),
                text_width(line, TEXT) / 2.0,
            );
            (middle - half, middle + half)
        };
        let touch = |index: usize| {
            let mut pairs = self.lines[index].iter().zip(&self.lines[index + 1]);
            pairs.any(|(one, next)| ends(index, one).1 + APART > ends(index + 1, next).0)
        };
        (0..self.lines.len().saturating_sub(1)).any(touch)
    }
}

/// The lines of an upright name, no more than fit side by side in its slot.
fn upright_lines(name: &str, slot: f64) -> Vec<String> {
    let broken = break_lines(name, LONG);
    if count(broken.len()) * LINE <= slot {
        return broken.iter().map(|line| shortened(line, LONGEST)).collect();
    }
    vec![shortened(name, LONGEST)]
}

/// The text without its middle, for which an ellipsis stands, if it is wider than the room in points.
pub(super) fn shortened(text: &str, room: f64) -> String {
    if text_width(text, TEXT) <= room {
        return text.into();
    }
    let letters: Vec<char> = text.chars().collect();
    let with = |kept: usize| -> String {
        let (head, tail) = (kept.div_ceil(2), kept / 2);
        let ends = (&letters[..head], &letters[letters.len() - tail..]);
        ends.0.iter().chain(&['…']).chain(ends.1).collect()
    };
    let shorter = (1..letters.len()).rev().map(with);
    let mut fitting = shorter.filter(|text| text_width(text, TEXT) <= room);
    fitting.next().unwrap_or_else(|| "…".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(names: &[&str], slot: f64) -> CategoryLabels {
        let at = |(index, name): (usize, &&str)| (((count(index) + 0.5) * slot, 100.0), (*name).to_owned());
        CategoryLabels::of(
            names.iter().enumerate().map(at).collect(),
            slot,
            slot * count(names.len()),
        )
    }

    #[test]
    fn names_that_would_overlap_stand_upright_below_the_axis() {
        let level = labels(&["four cells", "two cells"], 60.0);
        assert!(!level.is_upright);
        let names = ["value decomposition"; 6];
        let upright = labels(&names, 33.0);
        assert!(upright.is_upright);
        assert_eq!(
            upright.lines[0],
            ["value", "decomposition"],
            "two lines fit side by side"
        );
        assert_eq!(labels(&names, 16.0).lines[0], ["value decomposition"]);
        assert!(upright.depth() > TICK + 2.0 + text_width("decomposition", TEXT) - 1e-9);
        let Mark::Text {
            at, align, upright, ..
        } = &upright.marks(0)[0]
        else {
            panic!("no text")
        };
        assert_eq!((*align, *upright, at.1), (Align::Right, true, 100.0 + TICK + 2.0));
    }

    #[test]
    fn a_wide_name_beside_narrow_ones_stays_level() {
        assert!(!labels(&["a", "rather_wide", "b"], 42.0).is_upright);
        assert!(labels(&["rather_wide", "rather_wide"], 42.0).is_upright);
    }

    #[test]
    fn a_shortened_text_keeps_its_ends() {
        assert_eq!(shortened("short", 100.0), "short");
        let text = shortened("learning_rate=0.000123456789", 60.0);
        assert!(
            text.starts_with("learn") && text.ends_with("789") && text.contains('…'),
            "{text}"
        );
        assert!(text_width(&text, TEXT) <= 60.0);
        assert_eq!(shortened("anything", 0.0), "…");
    }
}
