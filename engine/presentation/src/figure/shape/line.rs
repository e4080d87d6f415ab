//! A line through points.

use super::{
    Form, Frame, LINE_SAMPLE, Mark, NumberFormat, Panel, Point, Position, Range, Style, last_height,
};
use crate::figure::strokes::{dashed, stretch, through};

/// The points of a line.
pub(super) struct Line<'a>(pub &'a [Point]);

impl<'a> Form<'a> for Line<'a> {
    fn points(&self) -> &'a [Point] {
        self.0
    }

    fn last_value(&self) -> Option<f64> {
        last_height(self.0)
    }

    fn draw(&self, style: Style, frame: &Frame, _: Option<Range>) -> Vec<Mark> {
        through(self.0, frame, (style.dashes(), style.width()), style.color())
    }

    fn sample_width(&self) -> f64 {
        LINE_SAMPLE
    }

    fn sample(&self, style: Style, at: Position) -> Vec<Mark> {
        let ends = stretch(at, LINE_SAMPLE);
        dashed(&ends, style.dashes(), style.width(), style.color())
    }

    fn is_dimmable(&self) -> bool {
        true
    }

    fn in_words(&self, panel: &Panel, format: NumberFormat) -> Option<String> {
        // With named rows, the values lie along the horizontal axis.
        let value = if panel.y.categories.is_empty() {
            self.last_value()
        } else {
            self.0.last().map(|point| point.x)
        };
        value.map(|value| format.write(value))
    }
}
