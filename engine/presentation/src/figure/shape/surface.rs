//! Filled contours of a surface.

use super::{
    Form, Frame, Ground, Mark, NumberFormat, Panel, Position, Range, Rows, Style, Values, rectangle,
};
use crate::figure::{
    color_scale::{color, levels},
    data_file::of_value,
    in_words::span_of,
};

/// A surface over a full grid.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Surface {
    /// Meaning of the height, with the unit.
    pub label: String,
    /// Increasing grid positions along the horizontal axis.
    pub x: Vec<f64>,
    /// Increasing grid positions along the vertical axis.
    pub y: Vec<f64>,
    /// Heights at the grid positions, `[y][x]`.
    pub z: Vec<Vec<f64>>,
}

impl<'a> Form<'a> for &'a Surface {
    fn places(&self) -> Values<'a> {
        Box::new(self.x.iter().copied())
    }

    fn heights(&self) -> Values<'a> {
        Box::new(self.y.iter().copied())
    }

    fn padding(&self) -> f64 {
        0.0
    }

    fn fills_plot(&self) -> bool {
        true
    }

    fn color_scale(&self) -> Option<(&'a str, Values<'a>)> {
        Some((&self.label, Box::new(self.z.iter().flatten().copied())))
    }

    fn ground(&self) -> Ground {
        Ground::Colored
    }

    /// Paints everything in the lowest colour, then the area above each level over it, so that no seam shows.
    fn draw(&self, _: Style, frame: &Frame, colors: Option<Range>) -> Vec<Mark> {
        let Some(colors) = colors else {
            return Vec::new();
        };
        let all = rectangle((frame.left, frame.top), (frame.right, frame.bottom));
        let mut marks = vec![Mark::area(all, color(colors, colors.low))];
        for level in levels(colors) {
            let color = color(colors, level);
            for row in 0..self.y.len() - 1 {
                strip(self, row, level, &mut |points: &[Position]| {
                    let points = points.iter().map(|(x, y)| frame.at(*x, *y)).collect();
                    marks.push(Mark::area(points, color));
                });
            }
        }
        marks
    }

    fn nouns(&self) -> (&'static str, &'static str) {
        ("Filled contours", "Shown")
    }

    fn in_words(&self, _: &Panel, _: NumberFormat) -> Option<String> {
        span_of(&self.label, self.z.iter().flatten().copied(), |_| None)
    }

    fn rows(&self, _: &'a Panel) -> Rows<'a> {
        let rows = self.y.iter().zip(&self.z);
        Box::new(rows.flat_map(|(y, z)| {
            let cell = |(x, z): (&f64, &f64)| of_value([x.to_string(), y.to_string()], z.to_string());
            self.x.iter().zip(z).map(cell)
        }))
    }
}

/// The area above a level between two rows of the grid: runs of whole cells as one rectangle, other cells as parts of
/// triangles.
fn strip(surface: &Surface, row: usize, level: f64, emit: &mut dyn FnMut(&[Position])) {
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
fn above(corners: &[(Position, f64); 3], level: f64) -> Vec<Position> {
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
