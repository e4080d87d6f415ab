//! Draws the series of a panel in layers.

use super::{
    axes::{Frame, Range},
    chart::{Panel, Series},
    layout::count,
    paint::{Mark, Position},
    strokes::{LINE_WIDTH, dashed, disc, pieces},
};

const RUN_WIDTH: f64 = 0.5;
const DOT: f64 = 1.4;

/// All series of a panel: grey lines below all others, thin lines below bands, and bands below lines, so that none is
/// hidden. `colors` is the range of the scale of colours.
pub(super) fn draw(panel: &Panel, frame: &Frame, colors: Option<Range>, marks: &mut Vec<Mark>) {
    let (others, named): (Vec<&Series>, Vec<&Series>) =
        panel.series.iter().partition(|series| series.is_other());
    let one = |series: &&Series| series.shape.form().draw(series.style, frame, colors);
    marks.extend(others.iter().flat_map(one));
    runs(&named, frame, marks);
    let with_runs = named.iter().filter(|series| !series.shape.runs().is_empty());
    let lines = with_runs.flat_map(|series| pieces(series.shape.points(), frame));
    marks.extend(lines.map(rim));
    let bands = |series: &&Series| series.shape.form().bands(series.style, frame);
    marks.extend(named.iter().flat_map(bands));
    marks.extend(named.iter().flat_map(one));
}

/// The thin lines of runs, thinner if there are many. Runs are drawn in turns, one of each series after the other, so
/// that no series covers another with all its runs.
fn runs(all: &[&Series], frame: &Frame, marks: &mut Vec<Mark>) {
    let counts = all.iter().map(|series| series.shape.runs().len());
    let most = counts.max().unwrap_or(0);
    let width = RUN_WIDTH * (10.0 / count(most.max(10))).sqrt();
    for index in 0..most {
        for series in all {
            let Some(run) = series.shape.runs().get(index) else {
                continue;
            };
            let (style, dashes) = (series.style, series.shape.form().run_dashes(series.style));
            for piece in pieces(&run.points, frame) {
                // A single value is no line.
                match piece[..] {
                    [at] => marks.push(Mark::area(disc(at, DOT), style.color())),
                    _ => marks.extend(dashed(&piece, dashes, width, style.light())),
                }
            }
        }
    }
}

/// A light rim that separates a line from thin lines of nearly the same colour.
fn rim(places: Vec<Position>) -> Mark {
    Mark::Line {
        points: places,
        width: LINE_WIDTH + 1.0,
        color: (0xff, 0xff, 0xff),
    }
}
