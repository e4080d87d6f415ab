//! Points marked by a cross.

use super::{Form, Frame, Mark, NumberFormat, Panel, Point, Position, Range, Style};
use crate::figure::{
    in_words::number_of,
    strokes::places,
    style::{INK, Rgb},
};

/// The marked points.
pub(super) struct Crosses<'a>(pub &'a [Point]);

impl<'a> Form<'a> for Crosses<'a> {
    fn points(&self) -> &'a [Point] {
        self.0
    }

    fn draw(&self, _: Style, frame: &Frame, _: Option<Range>) -> Vec<Mark> {
        places(self.0, frame).into_iter().flat_map(cross).collect()
    }

    fn sample(&self, _: Style, (x, y): Position) -> Vec<Mark> {
        cross((x + self.sample_width() / 2.0, y))
    }

    fn in_words(&self, _: &Panel, _: NumberFormat) -> Option<String> {
        Some(number_of(self.0))
    }
}

/// A cross with a light rim, visible on any ground.
fn cross((x, y): Position) -> Vec<Mark> {
    let lines = |width: f64, color: Rgb, arm: f64| {
        let line = move |points: [Position; 2]| Mark::Line {
            points: points.to_vec(),
            width,
            color,
        };
        [
            line([(x - arm, y - arm), (x + arm, y + arm)]),
            line([(x - arm, y + arm), (x + arm, y - arm)]),
        ]
    };
    [lines(2.2, (0xff, 0xff, 0xff), 3.4), lines(1.0, INK, 3.0)].concat()
}
