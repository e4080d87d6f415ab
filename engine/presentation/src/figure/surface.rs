//! Filled contours of a surface, and their colour bar.

use super::{
    axes::{self, Frame, Range, TEXT},
    chart::{Chart, Scale, Shape, Surface},
    layout::text,
    paint::{Mark, Place},
    style::{INK, Rgb, blend, ramp},
    ticks,
};
use plotters::style::text_anchor::HPos;

/// Approximate number of bands of colour.
const BANDS: usize = 20;

/// The heights of all surfaces and cells of a chart, which share their colours; `None` where there is neither.
pub(super) fn heights(chart: &Chart) -> Option<Range> {
    let shapes = || {
        chart
            .panels
            .iter()
            .flat_map(|panel| &panel.series)
            .map(|series| &series.shape)
    };
    let is_colored = |shape: &Shape| matches!(shape, Shape::Surface(_) | Shape::Cells(_));
    let values = shapes().flat_map(|shape| match shape {
        Shape::Surface(surface) => surface.z.concat(),
        Shape::Cells(cells) => cells.values.iter().flatten().copied().flatten().collect(),
        _ => Vec::new(),
    });
    shapes()
        .any(is_colored)
        .then(|| Range::around(values, false, 0.0))
}

/// Paints everything in the lowest colour, then the area above each level over it, so that no seam shows.
pub(super) fn draw(surface: &Surface, heights: Option<Range>, frame: &Frame, marks: &mut Vec<Mark>) {
    let Some(heights) = heights else { return };
    let all = vec![
        (frame.left, frame.top),
        (frame.right, frame.top),
        (frame.right, frame.bottom),
        (frame.left, frame.bottom),
    ];
    marks.push(Mark::Fill {
        points: all,
        color: color(heights, heights.low),
        opacity: 1.0,
    });
    for level in levels(heights) {
        let color = color(heights, level);
        for row in 0..surface.y.len() - 1 {
            strip(surface, row, level, &mut |points: &[(f64, f64)]| {
                let points = points.iter().map(|(x, y)| frame.at(*x, *y)).collect();
                marks.push(Mark::Fill {
                    points,
                    color,
                    opacity: 1.0,
                });
            });
        }
    }
}

/// The area above a level between two rows of the grid: runs of whole cells as one rectangle, other cells as parts of
/// triangles.
fn strip(surface: &Surface, row: usize, level: f64, emit: &mut dyn FnMut(&[Place])) {
    let (x, y, z) = (&surface.x, &surface.y, &surface.z);
    let corners = |column: usize| {
        [
            z[row][column],
            z[row][column + 1],
            z[row + 1][column + 1],
            z[row + 1][column],
        ]
    };
    let mut run: Option<usize> = None;
    for column in 0..x.len() {
        let whole = column + 1 < x.len() && corners(column).iter().all(|height| *height >= level);
        match (whole, run) {
            (true, None) => run = Some(column),
            (false, Some(first)) => {
                emit(&[
                    (x[first], y[row]),
                    (x[column], y[row]),
                    (x[column], y[row + 1]),
                    (x[first], y[row + 1]),
                ]);
                run = None;
            }
            _ => {}
        }
        if !whole && column + 1 < x.len() {
            let places = [
                (x[column], y[row]),
                (x[column + 1], y[row]),
                (x[column + 1], y[row + 1]),
                (x[column], y[row + 1]),
            ];
            let heights = corners(column);
            for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                let part = above(
                    &[
                        (places[a], heights[a]),
                        (places[b], heights[b]),
                        (places[c], heights[c]),
                    ],
                    level,
                );
                if part.len() > 2 {
                    emit(&part);
                }
            }
        }
    }
}

/// The part of a triangle that lies above a level (Sutherland and Hodgman 1974).
fn above(corners: &[(Place, f64); 3], level: f64) -> Vec<Place> {
    let mut part = Vec::new();
    for index in 0..3 {
        let ((from, low), (to, high)) = (corners[index], corners[(index + 1) % 3]);
        if low >= level {
            part.push(from);
        }
        if (low >= level) != (high >= level) {
            let share = (level - low) / (high - low);
            part.push((from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1)));
        }
    }
    part
}

fn levels(heights: Range) -> Vec<f64> {
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
        let points = vec![
            (bar.left, top),
            (bar.right, top),
            (bar.right, bottom),
            (bar.left, bottom),
        ];
        marks.push(Mark::Fill {
            points,
            color: color(heights, *low),
            opacity: 1.0,
        });
    }
    // Even a low bar has a few numbers.
    let length = (bar.bottom - bar.top).max(72.0);
    for tick in axes::ticks(&Scale::default(), heights, length, false) {
        marks.push(text(
            (bar.right + 2.5, bar.at(bar.x.low, tick.value).1),
            &tick.text,
            HPos::Left,
        ));
    }
    let label = chart
        .panels
        .iter()
        .flat_map(|panel| &panel.series)
        .find_map(|series| match &series.shape {
            Shape::Surface(surface) => Some(surface.label.as_str()),
            Shape::Cells(cells) => Some(cells.label.as_str()),
            _ => None,
        });
    marks.push(Mark::Text {
        at: (bar.left + 6.0, bar.top - 8.5),
        text: label.unwrap_or_default().into(),
        size: TEXT,
        align: HPos::Center,
        upright: false,
        color: INK,
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_cut_at_the_level() {
        let corners = [((0.0, 0.0), 0.0), ((2.0, 0.0), 2.0), ((0.0, 2.0), 0.0)];
        assert_eq!(above(&corners, 1.0), [(1.0, 0.0), (2.0, 0.0), (1.0, 1.0)]);
        assert!(above(&corners, 3.0).is_empty());
        assert_eq!(above(&corners, -1.0).len(), 3);
    }

    #[test]
    fn runs_of_whole_cells_are_one_rectangle() {
        let z = vec![vec![1.0, 1.0, 1.0, 0.0]; 2];
        let surface = Surface {
            x: vec![0.0, 1.0, 2.0, 3.0],
            y: vec![0.0, 1.0],
            z,
            label: String::new(),
        };
        let mut parts = Vec::new();
        strip(&surface, 0, 0.5, &mut |part| parts.push(part.to_vec()));
        assert_eq!(parts[0], [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)]);
        assert_eq!(parts.len(), 3);
    }
}
