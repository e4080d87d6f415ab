//! The scale of colours that all panels of a chart share, and its bar.

use super::{
    axes::{self, Frame, Range},
    chart::{Chart, Scale},
    layout::text,
    paint::{Align, Mark},
    shape::Values,
    strokes::rectangle,
    style::{Rgb, blend, ramp},
    ticks,
};

/// Approximate number of bands of colour.
const BANDS: usize = 20;

/// The range of all values that colours show; `None` if they show none.
pub(super) fn heights(chart: &Chart) -> Option<Range> {
    let mut scales = scales(chart).map(|(_, values)| values).peekable();
    scales.peek()?;
    Some(Range::around(scales.flatten(), false, 0.0))
}

fn scales(chart: &Chart) -> impl Iterator<Item = (&str, Values<'_>)> {
    let series = chart.panels.iter().flat_map(|panel| &panel.series);
    series.filter_map(|series| series.shape.form().color_scale())
}

/// Ends of the bands of colour, from the second band on.
pub(super) fn levels(heights: Range) -> Vec<f64> {
    ticks::linear(heights.low, heights.high, BANDS)
        .into_iter()
        .map(|tick| tick.value)
        .collect()
}

/// A colour for heights from `level` on, lighter than the scale itself, so that a path stands out.
pub(super) fn color(heights: Range, level: f64) -> Rgb {
    blend(ramp(heights.part(level)), (255, 255, 255), 0.25)
}

/// The colours with numbers, right of the last panel.
pub(super) fn color_bar(chart: &Chart, heights: Range, last: &Frame, marks: &mut Vec<Mark>) {
    let bar = Frame {
        left: last.right + 8.0,
        right: last.right + 15.0,
        y: heights,
        ..*last
    };
    let ends: Vec<f64> = std::iter::once(heights.low).chain(levels(heights)).collect();
    for (index, low) in ends.iter().enumerate() {
        let high = ends.get(index + 1).copied().unwrap_or(heights.high);
        let (bottom, top) = (bar.at(bar.x.low, *low).1, bar.at(bar.x.low, high).1);
        let points = rectangle((bar.left, top), (bar.right, bottom));
        marks.push(Mark::area(points, color(heights, *low)));
    }
    // Even a low bar has a few numbers.
    let length = (bar.bottom - bar.top).max(72.0);
    for tick in axes::ticks(&Scale::default(), heights, length, false) {
        marks.push(text(
            (bar.right + 2.5, bar.at(bar.x.low, tick.value).1),
            &tick.text,
            Align::Left,
        ));
    }
    let label = scales(chart).map(|(label, _)| label).next();
    marks.push(text(
        (bar.left + 6.0, bar.top - 8.5),
        label.unwrap_or_default(),
        Align::Center,
    ));
}
