//! Draws the series of a panel: lines, learning curves, marked lines, levels, points, bars, paths, crosses.

use super::{
    axes::{self, Frame, Range},
    chart::{Curve, CurveSource, Panel, Point, Series, Shape, Style},
    heat_map,
    layout::count,
    paint::{Mark, Place},
    style::{INK, Marker, Rgb, blend},
    surface,
};
use statistics::thinning;

const LINE_WIDTH: f64 = 1.2;
const PUBLISHED_WIDTH: f64 = 0.9;
const RUN_WIDTH: f64 = 0.5;
const MARKER: f64 = 2.2;
const DOT: f64 = 1.4;
const BAND_OPACITY: f64 = 0.18;

/// All series of a panel: grey lines below all others, thin lines below bands, and bands below lines, so that none is
/// hidden.
pub(super) fn draw(panel: &Panel, frame: &Frame, heights: Option<Range>, marks: &mut Vec<Mark>) {
    let (others, named): (Vec<&Series>, Vec<&Series>) =
        panel.series.iter().partition(|series| series.is_other());
    others
        .iter()
        .for_each(|series| one(series, frame, heights, marks));
    let curves: Vec<(&Curve, Style)> = named.iter().filter_map(|series| curve(series)).collect();
    runs(&curves, frame, marks);
    marks.extend(
        curves
            .iter()
            .filter(|(curve, _)| !curve.runs.is_empty())
            .flat_map(|(curve, _)| pieces(&curve.points, frame))
            .map(rim),
    );
    marks.extend(
        curves
            .iter()
            .flat_map(|(curve, style)| bands(&curve.points, frame, style.color())),
    );
    named.iter().for_each(|series| one(series, frame, heights, marks));
}

fn curve(series: &Series) -> Option<(&Curve, Style)> {
    if let Shape::Curve(curve) = &series.shape {
        Some((curve, series.style))
    } else {
        None
    }
}

fn one(series: &Series, frame: &Frame, heights: Option<Range>, marks: &mut Vec<Mark>) {
    let color = series.style.color();
    match &series.shape {
        Shape::Line(points) => {
            for piece in pieces(points, frame) {
                marks.extend(dashed(&piece, series.style.dashes(), series.style.width(), color));
            }
        }
        Shape::Curve(curve) => {
            for piece in pieces(&curve.points, frame) {
                marks.extend(line(curve, series.style, &piece));
            }
        }
        Shape::MarkedLine(points) => {
            marks.extend(whiskers(points, frame, color));
            for piece in pieces(points, frame) {
                marks.extend(dashed(&piece, series.style.dashes(), LINE_WIDTH, color));
            }
            marks.extend(
                places(points, frame)
                    .into_iter()
                    .map(|at| marker(series.style, at)),
            );
        }
        Shape::Level(level) => {
            let ends = [frame.x.low, frame.x.high].map(|x| frame.at(x, *level));
            marks.extend(dashed(&ends, series.style.short_dashes(), LINE_WIDTH, color));
        }
        Shape::Points(points) => marks.extend(
            places(points, frame)
                .into_iter()
                .map(|at| marker(series.style, at)),
        ),
        Shape::Across(points) => across(points, frame, color, marks),
        Shape::Bars(points, width) => bars(points, *width, frame, color, marks),
        Shape::Surface(surface) => surface::draw(surface, heights, frame, marks),
        Shape::Cells(cells) => heat_map::draw(cells, heights, frame, marks),
        Shape::Path(points) => path(&places(points, frame), marks),
        Shape::Crosses(points) => places(points, frame)
            .into_iter()
            .for_each(|at| marks.extend(cross(at))),
        // Shapes without axes have painters of their own and no entry in a legend.
        Shape::Images(_) | Shape::Graph(_) => {}
        Shape::Axes(axes) => axes::upright_scales(axes, frame, marks),
    }
}

/// A short piece of the series for the legend, from `at` to the right.
pub(super) fn sample(series: &Series, (x, y): Place, length: f64, marks: &mut Vec<Mark>) {
    let color = series.style.color();
    let ends = [(x, y), (x + length, y)];
    let middle = (x + length / 2.0, y);
    match &series.shape {
        Shape::Line(_) => marks.extend(dashed(&ends, series.style.dashes(), series.style.width(), color)),
        Shape::Curve(curve) => {
            if curve.points.iter().any(|point| point.interval.is_some()) {
                marks.push(Mark::Fill {
                    points: rectangle((x, y - 3.0), (x + length, y + 3.0)),
                    color,
                    opacity: BAND_OPACITY,
                });
            }
            marks.extend(line(curve, series.style, &ends));
        }
        Shape::MarkedLine(_) => {
            marks.extend(dashed(&ends, series.style.dashes(), LINE_WIDTH, color));
            marks.push(marker(series.style, middle));
        }
        Shape::Level(_) => marks.extend(dashed(&ends, series.style.short_dashes(), LINE_WIDTH, color)),
        Shape::Points(_) => marks.push(marker(series.style, middle)),
        Shape::Path(_) => {
            let points: Vec<Place> = (0..=8)
                .map(|index| (x + 2.0 + (length - 4.0) * f64::from(index) / 8.0, y))
                .collect();
            path(&points, marks);
        }
        Shape::Crosses(_) => marks.extend(cross(middle)),
        Shape::Images(_) | Shape::Graph(_) | Shape::Axes(_) => {}
        Shape::Bars(..) | Shape::Across(_) | Shape::Surface(_) | Shape::Cells(_) => {
            marks.push(Mark::Fill {
                points: rectangle((middle.0 - 4.0, y - 3.5), (middle.0 + 4.0, y + 3.5)),
                color,
                opacity: 1.0,
            });
        }
    }
}

/// The positions of points, without points that have no place on the axes.
fn places(points: &[Point], frame: &Frame) -> Vec<Place> {
    pieces(points, frame).concat()
}

/// The positions of a line in pieces, cut at points without a place on the axes. Lines of very many points are
/// thinned to those that can be told apart.
fn pieces(points: &[Point], frame: &Frame) -> Vec<Vec<Place>> {
    /// Width of the columns of a thinned line, in points: less than that of any line.
    const COLUMN: f64 = 0.5;
    let holds = |point: &Point| frame.x.holds(point.x) && frame.y.holds(point.y);
    let piece = |points: &[Point]| -> Vec<Place> {
        let places: Vec<Place> = points.iter().map(|point| frame.at(point.x, point.y)).collect();
        if places.len() <= thinning::MOST {
            return places;
        }
        #[allow(clippy::cast_possible_truncation, reason = "a place on paper")]
        let column = |place: &Place| (place.0 / COLUMN).floor() as i64;
        let kept = thinning::kept(&places, column, |place| place.1);
        kept.into_iter().map(|index| places[index]).collect()
    };
    points
        .chunk_by(|one, next| holds(one) == holds(next))
        .filter(|run| run.first().is_some_and(holds))
        .map(piece)
        .collect()
}

/// A band for each run of points that have intervals.
fn bands(points: &[Point], frame: &Frame, color: Rgb) -> Vec<Mark> {
    let runs = points.chunk_by(|one, next| one.interval.is_some() == next.interval.is_some());
    let band = |run: &[Point]| {
        let ends = |point: &Point| {
            point
                .interval
                .map(|(low, high)| (frame.at(point.x, low), frame.at(point.x, high)))
        };
        let (lows, highs): (Vec<Place>, Vec<Place>) = run.iter().filter_map(ends).unzip();
        let points: Vec<Place> = highs.into_iter().chain(lows.into_iter().rev()).collect();
        (points.len() > 3).then_some(Mark::Fill {
            points,
            color,
            opacity: BAND_OPACITY,
        })
    };
    runs.filter_map(band).collect()
}

/// The line of a learning curve; its dashes show the source of the curve.
fn line(curve: &Curve, style: Style, places: &[Place]) -> Vec<Mark> {
    match curve.of {
        CurveSource::Learner => dashed(places, style.dashes(), style.width(), style.color()),
        CurveSource::NonLearner => dashed(places, style.short_dashes(), LINE_WIDTH, style.color()),
        CurveSource::Publication => dashed(places, style.dots(), PUBLISHED_WIDTH, style.color()),
    }
}

/// The thin lines of learning curves, thinner where there are many. Runs are drawn in turns, one of each curve after
/// the other, so that no curve covers another with all its runs.
fn runs(curves: &[(&Curve, Style)], frame: &Frame, marks: &mut Vec<Mark>) {
    let most = curves
        .iter()
        .map(|(curve, _)| curve.runs.len())
        .max()
        .unwrap_or(0);
    let width = RUN_WIDTH * (10.0 / count(most.max(10))).sqrt();
    for index in 0..most {
        for (curve, style, run) in curves
            .iter()
            .filter_map(|(curve, style)| Some((curve, style, curve.runs.get(index)?)))
        {
            let dashes = if curve.of == CurveSource::Publication {
                style.dots()
            } else {
                &[]
            };
            for piece in pieces(&run.points, frame) {
                // A single value is no line.
                match piece[..] {
                    [at] => marks.push(dot(at, style.color())),
                    _ => marks.extend(dashed(&piece, dashes, width, style.light())),
                }
            }
        }
    }
}

/// A light rim that parts a line from thin lines of nearly its colour.
fn rim(places: Vec<Place>) -> Mark {
    Mark::Line {
        points: places,
        width: LINE_WIDTH + 1.0,
        color: (0xff, 0xff, 0xff),
    }
}

/// A line cut into dashes, since the painters draw full lines only.
pub(super) fn dashed(points: &[Place], dashes: &[f64], width: f64, color: Rgb) -> Vec<Mark> {
    let line = |points: Vec<Place>| Mark::Line { points, width, color };
    if dashes.is_empty() {
        return vec![line(points.to_vec())];
    }
    let mut pieces = Vec::new();
    let (mut index, mut left) = (0, dashes[0]);
    let mut piece: Vec<Place> = points.first().copied().into_iter().collect();
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

fn whiskers(points: &[Point], frame: &Frame, color: Rgb) -> Vec<Mark> {
    let whisker = |point: &Point| {
        let (low, high) = point.interval.filter(|_| frame.x.holds(point.x))?;
        let ((x, bottom), (_, top)) = (frame.at(point.x, low), frame.at(point.x, high));
        let cap = |y: f64| [(x - 1.8, y), (x + 1.8, y)];
        let lines = [
            vec![(x, bottom), (x, top)],
            cap(bottom).to_vec(),
            cap(top).to_vec(),
        ];
        Some(lines.map(|points| Mark::Line {
            points,
            width: 0.7,
            color,
        }))
    };
    points.iter().filter_map(whisker).flatten().collect()
}

fn bars(points: &[Point], width: f64, frame: &Frame, color: Rgb, marks: &mut Vec<Mark>) {
    for point in points.iter().filter(|point| point.y.is_finite()) {
        let half = width * 0.46;
        let corners = (frame.at(point.x - half, point.y), frame.at(point.x + half, 0.0));
        marks.push(Mark::Fill {
            points: rectangle(corners.0, corners.1),
            color,
            opacity: 1.0,
        });
    }
    if frame.y.low < 0.0 && frame.y.high > 0.0 {
        marks.push(Mark::Line {
            points: vec![frame.at(frame.x.low, 0.0), frame.at(frame.x.high, 0.0)],
            width: 0.6,
            color: INK,
        });
    }
    // A light rim keeps the whisker visible on a dark bar.
    marks.extend(
        whiskers(points, frame, (0xff, 0xff, 0xff))
            .into_iter()
            .map(|mark| match mark {
                Mark::Line { points, color, .. } => Mark::Line {
                    points,
                    color,
                    width: 1.7,
                },
                other => other,
            }),
    );
    marks.extend(whiskers(points, frame, INK));
}

/// Intervals as bars along the horizontal axis, each with a dark line at its value.
fn across(points: &[Point], frame: &Frame, color: Rgb, marks: &mut Vec<Mark>) {
    const HALF: f64 = 0.3;
    for point in points.iter().filter(|point| point.y.is_finite()) {
        // The value is dark on its bar, and in the colour of the agent where the bar is too narrow to be seen.
        let is_wide = point.interval.is_some_and(|(low, high)| low < high);
        if let Some((low, high)) = point.interval {
            let corners = [(low, -HALF), (high, HALF)].map(|(value, by)| frame.at(value, point.x + by));
            marks.push(Mark::Fill {
                points: rectangle(corners[0], corners[1]),
                color,
                opacity: 0.7,
            });
        }
        marks.push(Mark::Line {
            points: [-HALF, HALF].map(|by| frame.at(point.y, point.x + by)).to_vec(),
            width: LINE_WIDTH,
            color: if is_wide { INK } else { color },
        });
    }
}

pub(super) fn rectangle((left, top): Place, (right, bottom): Place) -> Vec<Place> {
    vec![(left, top), (right, top), (right, bottom), (left, bottom)]
}

fn marker(style: Style, (x, y): Place) -> Mark {
    let polygon = |corners: usize, radius: f64, turn: f64| -> Vec<Place> {
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

/// Points from light to dark with a thin rim, the last on top.
fn path(points: &[Place], marks: &mut Vec<Mark>) {
    const LIGHT: Rgb = (0xff, 0xff, 0xff);
    const DARK: Rgb = (0xb0, 0x1c, 0x1c);
    let last = count(points.len().saturating_sub(1).max(1));
    for (index, place) in points.iter().enumerate() {
        for (radius, color) in [(2.1, INK), (1.7, blend(LIGHT, DARK, count(index) / last))] {
            marks.push(Mark::Fill {
                points: disc(*place, radius),
                color,
                opacity: 1.0,
            });
        }
    }
}

/// A cross with a light rim, to be seen on any ground.
fn cross((x, y): Place) -> Vec<Mark> {
    let lines = |width: f64, color: Rgb, arm: f64| {
        let line = move |points: [Place; 2]| Mark::Line {
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

fn dot(at: Place, color: Rgb) -> Mark {
    Mark::Fill {
        points: disc(at, DOT),
        color,
        opacity: 1.0,
    }
}

fn disc((x, y): Place, radius: f64) -> Vec<Place> {
    let angle = |index: usize| std::f64::consts::TAU * count(index) / 12.0;
    (0..12)
        .map(|index| (x + radius * angle(index).sin(), y - radius * angle(index).cos()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
