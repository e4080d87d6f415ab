//! Draws graphs of designs: boxes along a flow, arrows between them, frames around groups.
//!
//! The flow runs to the right in one line if that fits the paper. Otherwise it runs down, folded into stacks side by
//! side. A stack begins where a group begins, so that each group is seen as a whole. Arrows are led around boxes in
//! their way.

mod arrangement;
mod marks;
mod places;
mod routes;
#[cfg(test)]
pub(super) mod tests;
mod ways;

use super::{
    chart::Chart,
    drawn::shapes,
    layout::{DOUBLE, SINGLE, text},
    paint::{Align, Drawing, Extent, Mark},
    shape::Shape,
};
use arrangement::Arrangement;
use contract::drawing::Graph;
use places::Places;
use ways::Routing;

/// Height of a title with its room, room around a drawing, and room between two drawings.
const TITLE: f64 = 12.0;
const MARGIN: f64 = 4.0;
const GAP: f64 = 10.0;
/// Height of a page; taller drawings are scaled down.
const TALLEST: f64 = 640.0;

/// A chart of graphs, one below the other, at the requested width; `None` for another chart.
pub(super) fn draw(chart: &Chart, asked: Option<f64>) -> Option<Drawing> {
    let room = asked.unwrap_or(DOUBLE) - 2.0 * MARGIN;
    let sketches: Vec<(&str, Sketch)> = shapes(chart)
        .filter_map(|(_, panel, shape)| match shape {
            Shape::Graph(graph) => Some((panel.title.as_str(), Sketch::of(graph, room))),
            _ => None,
        })
        .collect();
    let widest = sketches.iter().map(|(_, sketch)| sketch.width).reduce(f64::max)?;
    let usual = if widest + 2.0 * MARGIN <= SINGLE {
        SINGLE
    } else {
        DOUBLE
    };
    let width = asked.unwrap_or(usual);
    let (mut marks, mut top) = (Vec::new(), MARGIN);
    for (title, sketch) in sketches {
        if !title.is_empty() {
            marks.push(text((width / 2.0, top + TITLE / 2.0 - 1.0), title, Align::Center));
            top += TITLE;
        }
        let by = ((width - sketch.width) / 2.0, top);
        marks.extend(sketch.marks.iter().map(|mark| mark.moved(1.0, by)));
        top += sketch.height + GAP;
    }
    Some(Drawing {
        width,
        height: top - GAP + MARGIN,
        marks,
    })
}

/// A drawn graph, with its upper left corner at the origin.
struct Sketch {
    marks: Vec<Mark>,
    width: f64,
    height: f64,
}

impl Sketch {
    /// The first arrangement that fits the room; the last one, scaled down, if none fits.
    fn of(graph: &Graph, room: f64) -> Self {
        let mut sketches = Arrangement::all(graph).map(|arrangement| Self::arranged(graph, &arrangement));
        let mut chosen = sketches.next().unwrap_or(Self {
            marks: Vec::new(),
            width: 0.0,
            height: 0.0,
        });
        while chosen.width > room {
            match sketches.next() {
                Some(next) => chosen = next,
                None => break,
            }
        }
        let scale = (room / chosen.width).min(TALLEST / chosen.height);
        chosen.shrunk(scale)
    }

    fn arranged(graph: &Graph, arrangement: &Arrangement) -> Self {
        let ways = Routing::of(graph, arrangement);
        let places = Places::of(graph, arrangement, &ways);
        let routes = routes::all(graph, arrangement, &ways, &places);
        let marks = marks::all(graph, arrangement.flow, &places, &routes);
        let extent = marks.iter().filter_map(Mark::extent);
        let Some(extent) = extent.reduce(Extent::with) else {
            return Self {
                marks,
                width: 0.0,
                height: 0.0,
            };
        };
        let by = (-extent.left, -extent.top);
        Self {
            marks: marks.iter().map(|mark| mark.moved(1.0, by)).collect(),
            width: extent.right - extent.left,
            height: extent.bottom - extent.top,
        }
    }

    fn shrunk(self, scale: f64) -> Self {
        if scale >= 1.0 || !scale.is_finite() {
            return self;
        }
        Self {
            marks: self
                .marks
                .iter()
                .map(|mark| mark.moved(scale, (0.0, 0.0)))
                .collect(),
            width: self.width * scale,
            height: self.height * scale,
        }
    }
}
