//! Lines, markers and outlines on paper, from points between axes.

use super::{
    axes::Frame,
    chart::{Point, Style},
    layout::count,
    paint::{Mark, Position},
    style::{Marker, Rgb},
};
use statistics::thinning;

/// Widths of lines and of error bars, in points.
pub(super) const LINE_WIDTH: f64 = 1.2;
pub(super) const WHISKER: f64 = 0.7;
/// Radius of a round marker, in points.
pub(super) const MARKER: f64 = 2.2;

/// The positions of points, without points that have no place on the axes.
pub(super) fn places(points: &[Point], frame: &Frame) -> Vec<Position> {
    pieces(points, frame).concat()
}

/// The positions of a line in pieces, cut at points without a place on the axes. Lines of very many points are thinned
/// to those that can be distinguished.
pub(super) fn pieces(points: &[Point], frame: &Frame) -> Vec<Vec<Position>> {
    /// Width of the columns of a thinned line, in points: less than that of any line.
    const COLUMN: f64 = 0.5;
    let holds = |point: &Point| frame.x.holds(point.x) && frame.y.holds(point.y);
    let piece = |points: &[Point]| -> Vec<Position> {
        let places: Vec<Position> = points.iter().map(|point| frame.at(point.x, point.y)).collect();
        if places.len() <= thinning::MOST {
            return places;
        }
        #[allow(clippy::cast_possible_truncation, reason = "a place on paper")]
        let column = |place: &Position| (place.0 / COLUMN).floor() as i64;
        let kept = thinning::kept(&places, column, |place| place.1);
        kept.into_iter().map(|index| places[index]).collect()
    };
    points
        .chunk_by(|one, next| holds(one) == holds(next))
        .filter(|run| run.first().is_some_and(holds))
        .map(piece)
        .collect()
}

/// Lines through points, cut at points without a place on the axes.
pub(super) fn through(
    points: &[Point],
    frame: &Frame,
    (dashes, width): (&[f64], f64),
    color: Rgb,
) -> Vec<Mark> {
    let pieces = pieces(points, frame).into_iter();
    pieces
        .flat_map(|piece| dashed(&piece, dashes, width, color))
        .collect()
}

/// A line cut into dashes, since the painters draw full lines only.
pub(super) fn dashed(points: &[Position], dashes: &[f64], width: f64, color: Rgb) -> Vec<Mark> {
    let line = |points: Vec<Position>| Mark::Line { points, width, color };
    if dashes.is_empty() {
        return vec![line(points.to_vec())];
    }
    let mut pieces = Vec::new();
    let (mut index, mut left) = (0, dashes[0]);
    let mut piece: Vec<Position> = points.first().copied().into_iter().collect();
    for ends in points.windows(2) {
        let (dx, dy) = (ends[1].0 - ends[0].0, ends[1].1 - ends[0].1);
        let length = dx.hypot(dy);
        let mut done = 0.0;
        while length - done > left {
            done += left;
            let at = (ends[0].0 + dx * done / length, ends[0].1 + dy * done / length);
            piece.push(at);
            if index % 2 == 0 {
                pieces.push(line(std::mem::take(&mut piece)));
            }
            piece = vec![at];
            index += 1;
            left = dashes[index % dashes.len()];
        }
        left -= length - done;
        piece.push(ends[1]);
    }
    if index % 2 == 0 && piece.len() > 1 {
        pieces.push(line(piece));
    }
    pieces
}

/// The ends of a level line of some length, from a place to the right.
pub(super) fn stretch((x, y): Position, length: f64) -> [Position; 2] {
    [(x, y), (x + length, y)]
}

/// Error bars with caps at the points that have an interval.
pub(super) fn whiskers(points: &[Point], frame: &Frame, width: f64, color: Rgb) -> Vec<Mark> {
    let whisker = |point: &Point| {
        let (low, high) = point.interval.filter(|_| frame.x.holds(point.x))?;
        let ((x, bottom), (_, top)) = (frame.at(point.x, low), frame.at(point.x, high));
        let cap = |y: f64| [(x - 1.8, y), (x + 1.8, y)];
        let lines = [[(x, bottom), (x, top)], cap(bottom), cap(top)];
        Some(lines.map(|points| Mark::Line {
            points: points.to_vec(),
            width,
            color,
        }))
    };
    points.iter().filter_map(whisker).flatten().collect()
}

/// Corners of a rectangle.
pub(super) fn rectangle((left, top): Position, (right, bottom): Position) -> Vec<Position> {
    vec![(left, top), (right, top), (right, bottom), (left, bottom)]
}

/// Markers at the points that have a place on the axes.
pub(super) fn markers(points: &[Point], frame: &Frame, style: Style) -> Vec<Mark> {
    let places = places(points, frame).into_iter();
    places.map(|at| marker(style, at)).collect()
}

/// The marker of a style, in its colour.
pub(super) fn marker(style: Style, (x, y): Position) -> Mark {
    let polygon = |corners: usize, radius: f64, turn: f64| -> Vec<Position> {
        let angle = |index: usize| turn + std::f64::consts::TAU * count(index) / count(corners);
        (0..corners)
            .map(|index| (x + radius * angle(index).sin(), y - radius * angle(index).cos()))
            .collect()
    };
    let points = match style.marker() {
        Marker::Circle => polygon(20, MARKER, 0.0),
        Marker::Square => polygon(4, MARKER * 1.3, std::f64::consts::FRAC_PI_4),
        Marker::Triangle => polygon(3, MARKER * 1.4, 0.0),
        Marker::Diamond => polygon(4, MARKER * 1.4, 0.0),
    };
    Mark::Fill {
        points,
        color: style.color(),
        opacity: 0.9,
    }
}

/// Corners of a disc.
pub(super) fn disc((x, y): Position, radius: f64) -> Vec<Position> {
    let angle = |index: usize| std::f64::consts::TAU * count(index) / 12.0;
    (0..12)
        .map(|index| (x + radius * angle(index).sin(), y - radius * angle(index).cos()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::style::INK;

    #[test]
    fn dashes_run_on_over_corners() {
        let pieces = dashed(&[(0.0, 0.0), (3.0, 0.0), (3.0, 9.0)], &[4.0, 2.0], 1.0, INK);
        let points: Vec<_> = pieces
            .iter()
            .map(|mark| {
                if let Mark::Line { points, .. } = mark {
                    points.clone()
                } else {
                    vec![]
                }
            })
            .collect();
        assert_eq!(
            points,
            [
                vec![(0.0, 0.0), (3.0, 0.0), (3.0, 1.0)],
                vec![(3.0, 3.0), (3.0, 7.0)]
            ]
        );
    }
}
