//! Points of a path, from light to dark.

use super::{Form, Frame, Ground, Mark, NumberFormat, Panel, Point, Position, Range, Style};
use crate::figure::{
    in_words::number_of,
    layout::count,
    strokes::{disc, places},
    style::{INK, Rgb, blend},
};

/// Width of the sample in the legend, which shows several points.
const SAMPLE: f64 = 40.0;

/// The points in their order.
pub(super) struct Path<'a>(pub &'a [Point]);

impl<'a> Form<'a> for Path<'a> {
    fn points(&self) -> &'a [Point] {
        self.0
    }

    fn ground(&self) -> Ground {
        Ground::Colored
    }

    fn draw(&self, _: Style, frame: &Frame, _: Option<Range>) -> Vec<Mark> {
        discs(&places(self.0, frame))
    }

    fn sample_width(&self) -> f64 {
        SAMPLE
    }

    fn sample(&self, _: Style, (x, y): Position) -> Vec<Mark> {
        let place = |index: i32| (x + 2.0 + (SAMPLE - 4.0) * f64::from(index) / 8.0, y);
        discs(&(0..=8).map(place).collect::<Vec<_>>())
    }

    fn in_words(&self, _: &Panel, _: NumberFormat) -> Option<String> {
        Some(number_of(self.0))
    }
}

/// Points from light to dark with a thin rim, the last on top.
fn discs(points: &[Position]) -> Vec<Mark> {
    const LIGHT: Rgb = (0xff, 0xff, 0xff);
    const DARK: Rgb = (0xb0, 0x1c, 0x1c);
    let last = count(points.len().saturating_sub(1).max(1));
    let of_point = |(index, place): (usize, &Position)| {
        [(2.1, INK), (1.7, blend(LIGHT, DARK, count(index) / last))]
            .map(|(radius, color)| Mark::area(disc(*place, radius), color))
    };
    points.iter().enumerate().flat_map(of_point).collect()
}
