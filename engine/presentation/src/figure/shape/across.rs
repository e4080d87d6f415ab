//! Intervals as bars along the horizontal axis, each with a line at its value.

use super::{
    Form, Frame, Mark, NumberFormat, Panel, Point, Range, Rows, Style, Values, data_file, rectangle,
};
use crate::figure::{
    in_words::at_names,
    strokes::LINE_WIDTH,
    style::{INK, Rgb},
};

/// The intervals: `x` is the row on the vertical axis, `y` the value along the horizontal one.
pub(super) struct Across<'a>(pub &'a [Point]);

impl<'a> Form<'a> for Across<'a> {
    fn points(&self) -> &'a [Point] {
        self.0
    }

    fn places(&self) -> Values<'a> {
        Box::new(self.0.iter().flat_map(Point::ends).flatten())
    }

    fn heights(&self) -> Values<'a> {
        Box::new(self.0.iter().map(|point| point.x))
    }

    fn padding(&self) -> f64 {
        0.06
    }

    fn draw(&self, style: Style, frame: &Frame, _: Option<Range>) -> Vec<Mark> {
        let finite = self.0.iter().filter(|point| point.y.is_finite());
        finite
            .flat_map(|point| interval(point, frame, style.color()))
            .collect()
    }

    fn nouns(&self) -> (&'static str, &'static str) {
        ("Intervals as bars", "Values")
    }

    fn in_words(&self, panel: &Panel, format: NumberFormat) -> Option<String> {
        Some(at_names(self.0, &panel.y, format))
    }

    fn rows(&self, panel: &'a Panel) -> Rows<'a> {
        data_file::of_points(self.0, &panel.y, "")
    }
}

/// The bar of a point that has an interval, and the line at its value.
fn interval(point: &Point, frame: &Frame, color: Rgb) -> Vec<Mark> {
    const HALF: f64 = 0.3;
    let bar = point.interval.map(|(low, high)| {
        let corners = [(low, -HALF), (high, HALF)].map(|(value, by)| frame.at(value, point.x + by));
        Mark::Fill {
            points: rectangle(corners[0], corners[1]),
            color,
            opacity: 0.7,
        }
    });
    // The value is dark on its bar, and has the colour of the agent if the bar is too narrow to be seen.
    let is_wide = point.interval.is_some_and(|(low, high)| low < high);
    let value = Mark::Line {
        points: [-HALF, HALF].map(|by| frame.at(point.y, point.x + by)).to_vec(),
        width: LINE_WIDTH,
        color: if is_wide { INK } else { color },
    };
    bar.into_iter().chain([value]).collect()
}
