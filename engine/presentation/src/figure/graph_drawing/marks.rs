//! The marks of a graph: frames, lines with their tips, boxes, names.

use super::{
    arrangement::Flow,
    places::{Frame, NodeBox, Places, Span},
    routes::{Point, Route},
};
use crate::figure::{
    chart::{Hue, Style},
    layout::{count, text},
    paint::{Align, Mark, Position, text_width},
    strokes::{dashed, rectangle},
    style::{INK, Rgb, blend},
};
use contract::drawing::Graph;
use std::collections::BTreeMap;

const WHITE: Rgb = (0xff, 0xff, 0xff);
const GROUND: Rgb = (0xf5, 0xf5, 0xf5);
const FRAME_LINE: Rgb = (0xb4, 0xb4, 0xb4);
const GREY: Rgb = (0x88, 0x88, 0x88);
const LINE_WIDTH: f64 = 0.8;
const DASHES: [f64; 2] = [2.6, 1.7];
/// Length of a tip, half its width, and the depth to which the line reaches into it.
const TIP: (f64, f64, f64) = (4.0, 1.8, 1.0);
const CORNER: f64 = 3.0;
/// Distance between the lines of a text in a box, in points.
const TEXT_LINE: f64 = 8.8;
const LABEL: f64 = 6.5;
/// Places of a name along its line, the best one first.
const PARTS: [f64; 5] = [0.5, 0.35, 0.65, 0.2, 0.8];
/// Colours that differ with any kind of colour vision and are not black.
const HUES: usize = 6;

/// All marks, those above others last.
pub(super) fn all(graph: &Graph, flow: Flow, places: &Places, routes: &[Route]) -> Vec<Mark> {
    let mut marks: Vec<Mark> = places.frames.iter().flat_map(|it| frame(it, flow)).collect();
    for bypass in [true, false] {
        marks.extend(
            routes
                .iter()
                .filter(|route| route.bypass == bypass)
                .flat_map(|route| line(route, flow)),
        );
    }
    let hues = hues(graph);
    for (node, place) in graph.nodes.iter().zip(&places.boxes) {
        let hue = hues.get(word(&node.label)).copied();
        marks.extend(node_box(place, hue.unwrap_or(GREY), flow));
    }
    marks.extend((0..routes.len()).flat_map(|number| label(number, routes, places, flow)));
    marks
}

/// A place on paper.
fn place(flow: Flow, (along, across): (f64, f64)) -> Position {
    match flow {
        Flow::Right => (along, across),
        Flow::Down => (across, along),
    }
}

/// Two opposite corners on paper, the upper left one first.
fn corners(flow: Flow, along: Span, across: Span) -> (Position, Position) {
    (
        place(flow, (along.low, across.low)),
        place(flow, (along.high, across.high)),
    )
}

/// Name of an operation, without its sizes.
fn word(label: &str) -> &str {
    label.split_whitespace().next().unwrap_or_default()
}

/// A colour for each of the most frequent operations, up to [`HUES`]; circles have none.
fn hues(graph: &Graph) -> BTreeMap<&str, Rgb> {
    let words = match graph.operations.as_slice() {
        [] => most_frequent(graph),
        operations => operations.iter().map(String::as_str).collect(),
    };
    let color = |index: usize| {
        let hue = Hue::Palette(index);
        Style { hue, variant: 0 }.color()
    };
    let colored = words.into_iter().take(HUES).enumerate();
    colored.map(|(index, word)| (word, color(index))).collect()
}

/// The operations of a graph, the most frequent one first; ties go by the first occurrence.
fn most_frequent(graph: &Graph) -> Vec<&str> {
    let mut words: Vec<(&str, usize)> = Vec::new();
    let boxed = graph.nodes.iter().filter(|node| node.label.chars().count() > 1);
    for word in boxed.map(|node| word(&node.label)) {
        match words.iter_mut().find(|(known, _)| *known == word) {
            Some((_, times)) => *times += 1,
            None => words.push((word, 1)),
        }
    }
    words.sort_by_key(|(_, times)| std::cmp::Reverse(*times));
    words.into_iter().map(|(word, _)| word).collect()
}

fn outlined(points: Vec<Position>, fill: Rgb, line: Rgb, width: f64) -> [Mark; 2] {
    let closed = points.iter().chain(points.first()).copied().collect();
    [
        Mark::Fill {
            points,
            color: fill,
            opacity: 1.0,
        },
        Mark::Line {
            points: closed,
            width,
            color: line,
        },
    ]
}

fn frame(frame: &Frame, flow: Flow) -> Vec<Mark> {
    let (start, end) = corners(flow, frame.along, frame.across);
    let name = text((start.0 + 4.0, start.1 + 6.0), &frame.name, Align::Left);
    let mut marks: Vec<Mark> = outlined(rounded_box(start, end, 4.0), GROUND, FRAME_LINE, 0.5).into();
    marks.push(name);
    marks
}

fn node_box(place: &NodeBox, color: Rgb, flow: Flow) -> Vec<Mark> {
    let (start, end) = corners(flow, place.along, place.across);
    let middle = (f64::midpoint(start.0, end.0), f64::midpoint(start.1, end.1));
    let mut marks: Vec<Mark> = if place.round {
        outlined(circle(middle, place.along.length() / 2.0), WHITE, INK, 0.7).into()
    } else {
        let fill = blend(color, WHITE, 0.74);
        outlined(rounded_box(start, end, 2.0), fill, blend(color, INK, 0.2), 0.7).into()
    };
    let first = middle.1 - TEXT_LINE * (count(place.lines.len()) - 1.0) / 2.0;
    for (index, line) in place.lines.iter().enumerate() {
        marks.push(text(
            (middle.0, first + TEXT_LINE * count(index)),
            line,
            Align::Center,
        ));
    }
    marks
}

/// A line with a tip at its end.
fn line(route: &Route, flow: Flow) -> Vec<Mark> {
    let color = if route.bypass {
        let hue = Hue::Palette(0);
        Style { hue, variant: 0 }.color()
    } else {
        INK
    };
    let mut points: Vec<Position> = route.points.iter().map(|point| place(flow, *point)).collect();
    let (Some(end), Some(before)) = (points.last().copied(), points.iter().rev().nth(1).copied()) else {
        return Vec::new();
    };
    let length = (end.0 - before.0).hypot(end.1 - before.1);
    let way = ((end.0 - before.0) / length, (end.1 - before.1) / length);
    let back = |by: f64, aside: f64| {
        (
            end.0 - way.0 * by - way.1 * aside,
            end.1 - way.1 * by + way.0 * aside,
        )
    };
    if let Some(last) = points.last_mut() {
        *last = back((TIP.0 - TIP.2).min(length), 0.0);
    }
    let points = if route.cornered { rounded(&points) } else { points };
    let dashes: &[f64] = if route.bypass { &DASHES } else { &[] };
    let mut marks = dashed(&points, dashes, LINE_WIDTH, color);
    marks.push(Mark::Fill {
        points: vec![end, back(TIP.0, TIP.1), back(TIP.0, -TIP.1)],
        color,
        opacity: 1.0,
    });
    marks
}

/// The name of an arrow on its longest straight piece, as near to the middle as other lines allow.
fn label(number: usize, routes: &[Route], places: &Places, flow: Flow) -> Vec<Mark> {
    let route = &routes[number];
    let longest = route.points.windows(2).max_by(|one, other| {
        let length = |ends: &[Point]| (ends[1].0 - ends[0].0).hypot(ends[1].1 - ends[0].1);
        length(one).total_cmp(&length(other))
    });
    let (Some(ends), false) = (longest, route.label.is_empty()) else {
        return Vec::new();
    };
    let runs_along = (ends[0].0 - ends[1].0).abs() > (ends[0].1 - ends[1].1).abs();
    let upright = runs_along == (flow == Flow::Down);
    let (long, short) = (text_width(&route.label, LABEL) / 2.0 + 1.5, LABEL * 0.6);
    let (dx, dy) = if upright { (short, long) } else { (long, short) };
    let others: Vec<Position> = (0..routes.len())
        .filter(|other| *other != number)
        .flat_map(|other| sampled(&routes[other], flow))
        .collect();
    let is_free = |at: &Point| {
        let middle = place(flow, *at);
        let is_under = |(x, y): &Position| (x - middle.0).abs() < dx && (y - middle.1).abs() < dy;
        !others.iter().any(is_under)
    };
    let middle = PARTS.map(|part| between(ends[0], ends[1], part));
    let middle = middle.into_iter().find(is_free).unwrap_or(middle[0]);
    let is_in = |frame: &Frame| {
        let within = |span: Span, at: f64| at > span.low && at < span.high;
        within(frame.along, middle.0) && within(frame.across, middle.1)
    };
    let color = if places.frames.iter().any(is_in) {
        GROUND
    } else {
        WHITE
    };
    let at = place(flow, middle);
    vec![
        Mark::Fill {
            points: rectangle((at.0 - dx, at.1 - dy), (at.0 + dx, at.1 + dy)),
            color,
            opacity: 1.0,
        },
        Mark::Text {
            at,
            text: route.label.clone(),
            size: LABEL,
            align: Align::Center,
            upright,
            color: INK,
        },
    ]
}

fn between(from: Point, to: Point, part: f64) -> Point {
    (from.0 + (to.0 - from.0) * part, from.1 + (to.1 - from.1) * part)
}

/// Places on a line, so close together that a name between two of them touches one.
fn sampled(route: &Route, flow: Flow) -> impl Iterator<Item = Position> + '_ {
    const PIECES: u32 = 128;
    let part = |piece: u32| f64::from(piece) / f64::from(PIECES);
    let of_piece = move |ends: &[Point]| {
        let (from, to) = (ends[0], ends[1]);
        (0..=PIECES).map(move |piece| place(flow, between(from, to, part(piece))))
    };
    route.points.windows(2).flat_map(of_piece)
}

/// A line with rounded corners.
fn rounded(points: &[Position]) -> Vec<Position> {
    let mut result: Vec<Position> = points.first().copied().into_iter().collect();
    for corner in points.windows(3) {
        let toward = |other: Position| {
            let (dx, dy) = (other.0 - corner[1].0, other.1 - corner[1].1);
            let length = dx.hypot(dy);
            let by = CORNER.min(length / 2.0) / length;
            (corner[1].0 + dx * by, corner[1].1 + dy * by)
        };
        result.extend(bend(toward(corner[0]), corner[1], toward(corner[2])));
    }
    result.extend(points.last().filter(|_| points.len() > 1));
    result
}

/// A piece of a parabola from one place to another, whose tangents meet in a corner.
fn bend(from: Position, corner: Position, to: Position) -> impl Iterator<Item = Position> {
    (0..=5).map(move |index| {
        let t = f64::from(index) / 5.0;
        let s = 1.0 - t;
        let mix = |a: f64, b: f64, c: f64| s * s * a + 2.0 * s * t * b + t * t * c;
        (mix(from.0, corner.0, to.0), mix(from.1, corner.1, to.1))
    })
}

fn rounded_box(start: Position, end: Position, radius: f64) -> Vec<Position> {
    let radius = radius.min((end.0 - start.0) / 2.0).min((end.1 - start.1) / 2.0);
    let corners = rectangle(start, end);
    let corner = |index: usize| {
        let (before, at, after) = (corners[(index + 3) % 4], corners[index], corners[(index + 1) % 4]);
        let toward = |other: Position| {
            let length = (other.0 - at.0).hypot(other.1 - at.1).max(radius);
            (
                at.0 + (other.0 - at.0) * radius / length,
                at.1 + (other.1 - at.1) * radius / length,
            )
        };
        bend(toward(before), at, toward(after))
    };
    (0..4).flat_map(corner).collect()
}

fn circle((x, y): Position, radius: f64) -> Vec<Position> {
    let angle = |index: u32| std::f64::consts::TAU * f64::from(index) / 32.0;
    (0..32)
        .map(|index| (x + radius * angle(index).sin(), y - radius * angle(index).cos()))
        .collect()
}
