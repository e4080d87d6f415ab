//! Axes of one panel: ranges, ticks, grid and labels.

use super::{
    category_labels::CategoryLabels,
    chart::{Panel, Scale},
    layout::{count, text},
    paint::{Align, Mark, Position, text_width},
    style::{FAINT, INK},
    ticks::{self, Tick},
};

/// Size of all text, in points: readable at the width of a paper's column.
pub(super) const TEXT: f64 = 7.5;
/// Width of the lines of axes and of their ticks.
pub(super) const AXIS_WIDTH: f64 = 0.6;
pub(super) const TICK: f64 = 2.5;
/// Room right of a panel, for the half of its last tick label that stands out.
pub(super) const OVERHANG: f64 = 9.0;
/// Height of a line of text.
pub(super) const LINE: f64 = 8.8;
/// The smallest positive number.
const SMALLEST: f64 = f64::from_bits(1);

/// Lower and upper end of an axis, and whether it is logarithmic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    pub low: f64,
    pub high: f64,
    pub log: bool,
}

/// The area between the axes of a panel, in points, with the values at its ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub left: f64,
    pub right: f64,
    pub top: f64,
    pub bottom: f64,
    pub x: Range,
    pub y: Range,
}

impl Range {
    /// The range that holds all finite values (all positive ones if logarithmic), widened by a part of itself on each
    /// side. Both ends are finite and differ, and are positive if the range is logarithmic.
    pub(super) fn around(values: impl Iterator<Item = f64>, log: bool, padding: f64) -> Self {
        /// Distance below which two values share one place, since differences of smaller numbers vanish.
        const CLOSEST: f64 = 1e-300;
        let usable = values
            .filter(|value| value.is_finite() && (!log || *value > 0.0))
            .map(|value| if log { value.log10() } else { value });
        let (low, high) = usable.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        });
        let least = (1e-12 * high.abs().max(low.abs())).max(CLOSEST);
        let (low, high) = match (low <= high, high - low > least) {
            (false, _) => (0.0, 1.0),
            (true, false) => (low - 0.5 * low.abs().max(0.1), low + 0.5 * low.abs().max(0.1)),
            (true, true) => (low - padding * (high - low), high + padding * (high - low)),
        };
        let (low, high) = if log {
            (10f64.powf(low).max(SMALLEST), 10f64.powf(high))
        } else {
            (low.max(f64::MIN), high)
        };
        Self {
            low,
            high: high.min(f64::MAX),
            log,
        }
    }

    /// Whether a value has a place on the axis: a finite number, and a positive one if the axis is logarithmic.
    pub(super) fn holds(self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0)
    }

    /// Position of a value as a part of the axis: 0 at the lower end, 1 at the upper one, clamped to both. NaN lies at
    /// the lower end.
    pub(super) fn part(self, value: f64) -> f64 {
        let part = if self.log {
            (value.max(SMALLEST).ln() - self.low.ln()) / (self.high.ln() - self.low.ln())
        } else if (self.high - self.low).is_finite() {
            (value - self.low) / (self.high - self.low)
        } else {
            (value / 2.0 - self.low / 2.0) / (self.high / 2.0 - self.low / 2.0)
        };
        if part.is_nan() { 0.0 } else { part.clamp(0.0, 1.0) }
    }
}

impl Frame {
    /// Position of a pair of values on paper.
    pub(super) fn at(&self, x: f64, y: f64) -> Position {
        (
            self.left + self.x.part(x) * (self.right - self.left),
            self.bottom - self.y.part(y) * (self.bottom - self.top),
        )
    }
}

/// Ticks that fit on `length` points.
pub(super) fn ticks(scale: &Scale, range: Range, length: f64, horizontal: bool) -> Vec<Tick> {
    if !scale.categories.is_empty() {
        let tick = |(index, name): (usize, &String)| Tick {
            value: count(index),
            text: name.replace('_', " "),
        };
        return scale.categories.iter().enumerate().map(tick).collect();
    }
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a length on paper"
    )]
    let mut wanted = (length / if horizontal { 34.0 } else { 24.0 }).max(2.0) as usize;
    loop {
        let ticks = if range.log {
            ticks::logarithmic(range.low, range.high, wanted)
        } else {
            ticks::linear(range.low, range.high, wanted)
        };
        let room: f64 = ticks
            .iter()
            .filter(|tick| !tick.text.is_empty())
            .map(|tick| text_width(&tick.text, TEXT) + 8.0)
            .sum();
        if wanted <= 1 || !horizontal || room <= length + 8.0 {
            return ticks;
        }
        wanted -= 1;
    }
}

/// Faint lines at the ticks.
pub(super) fn background(frame: &Frame, panel: &Panel, grid: bool, marks: &mut Vec<Mark>) {
    if !grid {
        return;
    }
    let faint = |points: Vec<Position>| Mark::Line {
        points,
        width: 0.4,
        color: FAINT,
    };
    for tick in ticks(&panel.y, frame.y, frame.bottom - frame.top, false)
        .iter()
        .filter(|tick| !tick.text.is_empty())
    {
        let (_, y) = frame.at(frame.x.low, tick.value);
        marks.push(faint(vec![(frame.left, y), (frame.right, y)]));
    }
    for tick in ticks(&panel.x, frame.x, frame.right - frame.left, true)
        .iter()
        .filter(|tick| !tick.text.is_empty() && panel.x.categories.is_empty())
    {
        let (x, _) = frame.at(tick.value, frame.y.low);
        marks.push(faint(vec![(x, frame.top), (x, frame.bottom)]));
    }
}

/// The lines of both axes.
pub(super) fn border(frame: &Frame, marks: &mut Vec<Mark>) {
    let points = vec![
        (frame.left, frame.top),
        (frame.left, frame.bottom),
        (frame.right, frame.bottom),
    ];
    marks.push(Mark::Line {
        points,
        width: AXIS_WIDTH,
        color: INK,
    });
}

/// Ticks and numbers of the vertical axis.
pub(super) fn vertical(frame: &Frame, scale: &Scale, marks: &mut Vec<Mark>) {
    for tick in ticks(scale, frame.y, frame.bottom - frame.top, false) {
        let (_, y) = frame.at(frame.x.low, tick.value);
        let length = if tick.text.is_empty() { TICK * 0.6 } else { TICK };
        marks.push(Mark::Line {
            points: vec![(frame.left - length, y), (frame.left, y)],
            width: AXIS_WIDTH,
            color: INK,
        });
        marks.push(text((frame.left - TICK - 2.0, y), &tick.text, Align::Right));
    }
}

/// Ticks and numbers or names of the horizontal axis; returns the depth to which they reach.
pub(super) fn horizontal(frame: &Frame, scale: &Scale, marks: &mut Vec<Mark>) -> f64 {
    let ticks = ticks(scale, frame.x, frame.right - frame.left, true);
    let slot = (frame.right - frame.left) / count(scale.categories.len().max(1));
    let place = |tick: &Tick| (frame.at(tick.value, frame.y.low).0, frame.bottom);
    let categories = (!scale.categories.is_empty()).then(|| {
        let names = ticks.iter().map(|tick| (place(tick), tick.text.clone()));
        CategoryLabels::of(names.collect(), slot, frame.right)
    });
    for (index, tick) in ticks.iter().enumerate() {
        let (x, bottom) = place(tick);
        let length = if tick.text.is_empty() { TICK * 0.6 } else { TICK };
        marks.push(Mark::Line {
            points: vec![(x, bottom), (x, bottom + length)],
            width: AXIS_WIDTH,
            color: INK,
        });
        if let Some(names) = &categories {
            marks.extend(names.marks(index));
            continue;
        }
        // A wide number moves to the left until it fits.
        let most = frame.right + OVERHANG - text_width(&tick.text, TEXT) / 2.0;
        let down = TICK + 2.0 + LINE * 0.5;
        marks.push(text((x.min(most), bottom + down), &tick.text, Align::Center));
    }
    categories.map_or(TICK + 2.0 + LINE, |names| names.depth())
}

/// An upright label in one line, or in several if it is longer than the room; `x` is the middle of the first line.
pub(super) fn upright(label: &str, (x, y): Position, room: f64, marks: &mut Vec<Mark>) {
    for (index, line) in break_lines(label, room).into_iter().enumerate() {
        let at = (x + LINE * count(index), y);
        marks.push(Mark::Text {
            at,
            text: line,
            size: TEXT,
            align: Align::Center,
            upright: true,
            color: INK,
        });
    }
}

/// Text broken between words so that each line fits, if its words are short enough.
pub(super) fn break_lines(text: &str, room: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line} {word}"), TEXT) <= room => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.into()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_hold_their_values_and_are_never_empty() {
        let range = Range::around([1.0, 3.0, f64::NAN].into_iter(), false, 0.1);
        assert_eq!((range.low, range.high), (0.8, 3.2));
        assert_eq!((range.part(0.5), range.part(9.0)), (0.0, 1.0));
        assert!((range.part(2.0) - 0.5).abs() < 1e-12);
        let flat = Range::around(std::iter::once(4.0), false, 0.1);
        assert!(flat.low < 4.0 && flat.high > 4.0);
        let log = Range::around([0.01, 1.0, -5.0].into_iter(), true, 0.0);
        assert!((log.part(0.1) - 0.5).abs() < 1e-12);
        assert_eq!(
            Range::around(std::iter::empty(), false, 0.1),
            Range {
                low: 0.0,
                high: 1.0,
                log: false
            }
        );
    }

    #[test]
    fn long_names_are_broken_between_words() {
        assert_eq!(break_lines("four cells", 30.0), ["four", "cells"]);
        assert_eq!(break_lines("four cells", 300.0), ["four cells"]);
    }

    #[test]
    fn the_last_tick_is_whole() {
        let range = Range::around([0.0, 123_400.0].into_iter(), false, 0.0);
        let frame = Frame {
            left: 0.0,
            right: 20.0,
            top: 0.0,
            bottom: 10.0,
            x: range,
            y: range,
        };
        let scale = Scale {
            categories: vec![String::new(), "unbreakable_and_wide".into()],
            ..Scale::default()
        };
        for scale in [Scale::default(), scale] {
            let mut marks = Vec::new();
            horizontal(&frame, &scale, &mut marks);
            let ends = marks.iter().filter_map(|mark| match mark {
                Mark::Text { at, text, .. } => Some(at.0 + text_width(text, TEXT) / 2.0),
                _ => None,
            });
            assert!(ends.fold(0.0, f64::max) <= frame.right + OVERHANG + 1e-9);
        }
    }
}
