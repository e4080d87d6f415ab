//! A line through marked points with an error bar at each.

use super::{Form, Frame, LINE_SAMPLE, Mark, Point, Position, Range, Style, last_height};
use crate::figure::strokes::{LINE_WIDTH, WHISKER, dashed, marker, markers, stretch, through, whiskers};

/// The marked points.
pub(super) struct MarkedLine<'a>(pub &'a [Point]);

impl<'a> Form<'a> for MarkedLine<'a> {
    fn points(&self) -> &'a [Point] {
        self.0
    }

    fn last_value(&self) -> Option<f64> {
        last_height(self.0)
    }

    fn draw(&self, style: Style, frame: &Frame, _: Option<Range>) -> Vec<Mark> {
        let color = style.color();
        let mut marks = whiskers(self.0, frame, WHISKER, color);
        marks.extend(through(self.0, frame, (style.dashes(), LINE_WIDTH), color));
        marks.extend(markers(self.0, frame, style));
        marks
    }

    fn sample_width(&self) -> f64 {
        LINE_SAMPLE
    }

    fn sample(&self, style: Style, (x, y): Position) -> Vec<Mark> {
        let ends = stretch((x, y), LINE_SAMPLE);
        let mut marks = dashed(&ends, style.dashes(), LINE_WIDTH, style.color());
        marks.push(marker(style, (x + LINE_SAMPLE / 2.0, y)));
        marks
    }

    fn nouns(&self) -> (&'static str, &'static str) {
        ("Lines through marked points", "Last values")
    }
}
