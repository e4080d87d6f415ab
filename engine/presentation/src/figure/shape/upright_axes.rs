//! Upright axes that replace those of the panel.

use super::{Form, Frame, Mark, Position, Range, Style, Tick, rectangle};
use crate::figure::{
    axes::{AXIS_WIDTH, LINE, TEXT, TICK},
    layout::{count, text},
    paint::{Align, text_width},
    style::INK,
};

/// Ticks of each axis, at places from 0 to 1.
pub(super) struct UprightAxes<'a>(pub &'a [Vec<Tick>]);

impl<'a> Form<'a> for UprightAxes<'a> {
    fn upright_axes(&self) -> &'a [Vec<Tick>] {
        self.0
    }

    fn draw(&self, _: Style, frame: &Frame, _: Option<Range>) -> Vec<Mark> {
        let axes = self.0.iter().enumerate();
        axes.flat_map(|(index, ticks)| axis(count(index), ticks, frame))
            .collect()
    }

    fn sample(&self, _: Style, _: Position) -> Vec<Mark> {
        Vec::new()
    }
}

/// An axis over a place of the horizontal one; the texts of its ticks stay readable over lines.
fn axis(place: f64, ticks: &[Tick], frame: &Frame) -> Vec<Mark> {
    let line = |points: [Position; 2]| Mark::Line {
        points: points.to_vec(),
        width: AXIS_WIDTH,
        color: INK,
    };
    let mut marks = vec![line([frame.at(place, 0.0), frame.at(place, 1.0)])];
    for tick in ticks {
        let (x, y) = frame.at(place, tick.value);
        let length = if tick.text.is_empty() { TICK * 0.6 } else { TICK };
        marks.push(line([(x - length, y), (x, y)]));
        if !tick.text.is_empty() {
            let (right, width) = (x - TICK - 1.5, text_width(&tick.text, TEXT));
            // Paper colour lets lines shine through a little.
            marks.push(Mark::Fill {
                points: rectangle(
                    (right - width - 0.8, y - LINE / 2.0),
                    (right + 0.8, y + LINE / 2.0),
                ),
                color: (0xff, 0xff, 0xff),
                opacity: 0.8,
            });
            marks.push(text((right, y), &tick.text, Align::Right));
        }
    }
    marks
}
