//! Points without a line between them.

use super::{Form, Frame, Mark, NumberFormat, Panel, Point, Position, Range, Style, last_height};
use crate::figure::{
    in_words::number_of,
    strokes::{marker, markers},
};

/// The points.
pub(super) struct Points<'a>(pub &'a [Point]);

impl<'a> Form<'a> for Points<'a> {
    fn points(&self) -> &'a [Point] {
        self.0
    }

    fn last_value(&self) -> Option<f64> {
        last_height(self.0)
    }

    fn padding(&self) -> f64 {
        0.06
    }

    fn draw(&self, style: Style, frame: &Frame, _: Option<Range>) -> Vec<Mark> {
        markers(self.0, frame, style)
    }

    fn sample(&self, style: Style, (x, y): Position) -> Vec<Mark> {
        vec![marker(style, (x + self.sample_width() / 2.0, y))]
    }

    fn is_dimmable(&self) -> bool {
        true
    }

    fn nouns(&self) -> (&'static str, &'static str) {
        ("Points", "Shown")
    }

    fn in_words(&self, _: &Panel, _: NumberFormat) -> Option<String> {
        Some(number_of(self.0))
    }
}
