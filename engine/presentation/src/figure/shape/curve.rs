//! A learning curve: the line over all runs, and each run.

use super::{
    Form, Frame, LINE_SAMPLE, Map, Mark, Panel, Point, Position, Range, Rows, Style, Value, data_file,
    last_height, rectangle,
};
use crate::figure::{
    plot_data,
    strokes::{LINE_WIDTH, MARKER, WHISKER, dashed, disc, places, stretch, through, whiskers},
};
use serde_json::json;
use statistics::thinning;

const PUBLISHED_WIDTH: f64 = 0.9;
const BAND_OPACITY: f64 = 0.18;

/// A learning curve: the line over all runs, and each run.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Source of the curve, shown by the kind of dashes.
    pub of: CurveSource,
    /// The line, with a band around it where points have intervals.
    pub points: Vec<Point>,
    /// Runs that are drawn as thin lines; empty if only the line is drawn.
    pub runs: Vec<RunLine>,
    /// Runs that are not drawn; the page shows them on request.
    pub undrawn: Vec<RunLine>,
    /// The statistic of the line over the last values of the runs, if some runs continue after the line ends.
    pub at_the_ends: Option<f64>,
}

/// Source of a learning curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CurveSource {
    /// An agent that learns.
    Learner,
    /// An agent that does not learn.
    NonLearner,
    /// A publication.
    Publication,
}

/// One run of a learning curve.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunLine {
    /// The seed, or the name of the run in its publication.
    pub name: String,
    /// Id of the trial; empty for a publication.
    pub trial: String,
    /// Points of the line, by rising steps.
    pub points: Vec<Point>,
}

impl Curve {
    /// All runs, drawn or not.
    pub fn all_runs(&self) -> impl Iterator<Item = &RunLine> {
        self.runs.iter().chain(&self.undrawn)
    }

    /// Whether the line has one point, so that a stroke through it would be invisible.
    pub(crate) fn is_point(&self) -> bool {
        self.points.len() == 1
    }

    /// Dashes and width of the line, which show the source of the curve.
    fn stroke(&self, style: Style) -> (&'static [f64], f64) {
        match self.of {
            CurveSource::Learner => (style.dashes(), style.width()),
            CurveSource::NonLearner => (style.short_dashes(), LINE_WIDTH),
            CurveSource::Publication => (style.dots(), PUBLISHED_WIDTH),
        }
    }
}

impl<'a> Form<'a> for &'a Curve {
    fn points(&self) -> &'a [Point] {
        &self.points
    }

    fn runs(&self) -> &'a [RunLine] {
        &self.runs
    }

    fn last_value(&self) -> Option<f64> {
        self.at_the_ends.or_else(|| last_height(&self.points))
    }

    fn draw(&self, style: Style, frame: &Frame, _: Option<Range>) -> Vec<Mark> {
        if !self.is_point() {
            return through(&self.points, frame, self.stroke(style), style.color());
        }
        let mut marks = whiskers(&self.points, frame, WHISKER, style.color());
        let places = places(&self.points, frame).into_iter();
        marks.extend(places.map(|at| Mark::area(disc(at, MARKER), style.color())));
        marks
    }

    /// A band for each stretch of points that have intervals.
    fn bands(&self, style: Style, frame: &Frame) -> Vec<Mark> {
        let has_interval = |point: &Point| point.interval.is_some();
        let stretches = self
            .points
            .chunk_by(|one, next| has_interval(one) == has_interval(next));
        let band = |points: &[Point]| {
            let ends = |point: &Point| {
                let (low, high) = point.interval?;
                Some((frame.at(point.x, low), frame.at(point.x, high)))
            };
            let (lows, highs): (Vec<Position>, Vec<Position>) = points.iter().filter_map(ends).unzip();
            let points: Vec<Position> = highs.into_iter().chain(lows.into_iter().rev()).collect();
            (points.len() > 3).then_some(Mark::Fill {
                points,
                color: style.color(),
                opacity: BAND_OPACITY,
            })
        };
        stretches.filter_map(band).collect()
    }

    fn run_dashes(&self, style: Style) -> &'static [f64] {
        if self.is_published() { style.dots() } else { &[] }
    }

    fn sample_width(&self) -> f64 {
        LINE_SAMPLE
    }

    fn sample(&self, style: Style, (x, y): Position) -> Vec<Mark> {
        let mut marks = Vec::new();
        if !self.is_point() && self.points.iter().any(|point| point.interval.is_some()) {
            marks.push(Mark::Fill {
                points: rectangle((x, y - 3.0), (x + LINE_SAMPLE, y + 3.0)),
                color: style.color(),
                opacity: BAND_OPACITY,
            });
        }
        let (dashes, width) = self.stroke(style);
        marks.extend(dashed(
            &stretch((x, y), LINE_SAMPLE),
            dashes,
            width,
            style.color(),
        ));
        if self.is_point() {
            marks.push(Mark::area(
                disc((x + LINE_SAMPLE / 2.0, y), MARKER),
                style.color(),
            ));
        }
        marks
    }

    fn is_published(&self) -> bool {
        self.of == CurveSource::Publication
    }

    fn is_dimmable(&self) -> bool {
        self.of == CurveSource::Learner
    }

    fn nouns(&self) -> (&'static str, &'static str) {
        ("Curves", "Last values")
    }

    /// The line, the drawn runs, and those whose line leaves out some of their points.
    fn rows(&self, panel: &'a Panel) -> Rows<'a> {
        let is_long = |run: &&RunLine| run.points.len() > thinning::MOST;
        let runs = self.runs.iter().chain(self.undrawn.iter().filter(is_long));
        let of_run = |run: &'a RunLine| data_file::of_points(&run.points, &panel.x, &run.name);
        Box::new(data_file::of_points(&self.points, &panel.x, "").chain(runs.flat_map(of_run)))
    }

    fn plot_data(&self, style: Style, log: bool) -> Option<Map<String, Value>> {
        let mut data = plot_data::line(&self.points, log);
        let runs: Vec<Value> = self
            .all_runs()
            .map(|run| plot_data::run(run, &data["x"], log))
            .collect();
        data.insert("runs".into(), json!(runs));
        data.insert("drawn".into(), json!(!self.runs.is_empty()));
        data.insert("dash".into(), json!(self.stroke(style).0));
        Some(data)
    }
}
