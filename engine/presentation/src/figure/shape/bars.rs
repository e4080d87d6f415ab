//! Bars from zero with an interval each.

use super::{Form, Frame, Mark, NumberFormat, Panel, Point, Position, Range, Style, Values, rectangle};
use crate::figure::{
    in_words::at_names,
    strokes::{WHISKER, whiskers},
    style::INK,
};

/// Centres and heights of the bars, and their common width.
pub(super) struct Bars<'a>(pub &'a [Point], pub f64);

impl<'a> Form<'a> for Bars<'a> {
    fn points(&self) -> &'a [Point] {
        self.0
    }

    fn places(&self) -> Values<'a> {
        let half = self.1 / 2.0;
        Box::new(
            self.0
                .iter()
                .flat_map(move |point| [point.x - half, point.x + half]),
        )
    }

    fn draw(&self, style: Style, frame: &Frame, _: Option<Range>) -> Vec<Mark> {
        let half = self.1 * 0.46;
        let bar = |point: &Point| {
            let corners = (frame.at(point.x - half, point.y), frame.at(point.x + half, 0.0));
            Mark::area(rectangle(corners.0, corners.1), style.fill())
        };
        let finite = self.0.iter().filter(|point| point.y.is_finite());
        let mut marks: Vec<Mark> = finite.map(bar).collect();
        if frame.y.low < 0.0 && frame.y.high > 0.0 {
            marks.push(Mark::Line {
                points: vec![frame.at(frame.x.low, 0.0), frame.at(frame.x.high, 0.0)],
                width: 0.6,
                color: INK,
            });
        }
        // A light rim keeps the whisker visible on a dark bar.
        marks.extend(whiskers(self.0, frame, WHISKER + 1.0, (0xff, 0xff, 0xff)));
        marks.extend(whiskers(self.0, frame, WHISKER, INK));
        marks
    }

    fn sample(&self, style: Style, (x, y): Position) -> Vec<Mark> {
        let middle = x + self.sample_width() / 2.0;
        let points = rectangle((middle - 4.0, y - 3.5), (middle + 4.0, y + 3.5));
        vec![Mark::area(points, style.fill())]
    }

    fn nouns(&self) -> (&'static str, &'static str) {
        ("Bars", "Values")
    }

    fn in_words(&self, panel: &Panel, format: NumberFormat) -> Option<String> {
        Some(at_names(self.0, &panel.x, format))
    }
}
