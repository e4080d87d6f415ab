//! Shapes of series: each draws, describes and lists its own data.
//!
//! A new shape is a file in this folder and an entry in the list below. The layout, the legend, the files and the
//! descriptions use [`Form`] and know no shape by name.

mod across;
mod bars;
mod cells;
mod crosses;
mod curve;
mod graph;
mod level;
mod line;
mod marked_line;
mod path;
mod points;
mod surface;
mod tiles;
mod upright_axes;

pub use cells::Cells;
pub use curve::{Curve, CurveSource, RunLine};
pub use surface::Surface;
pub use tiles::Tiles;

use super::{
    axes::{Frame, Range},
    chart::{Chart, Panel, Point, Style},
    data_file::{self, Rows},
    on_dark::Ground,
    paint::{Drawing, Mark, Position},
    strokes::rectangle,
    ticks::Tick,
};
use crate::table::NumberFormat;
use contract::drawing::Graph;
use serde_json::{Map, Value};

/// Declares the shapes, and the form of each.
macro_rules! shapes {
    ($($(#[$doc:meta])* $name:ident($($data:ident: $type:ty),+) => $form:expr,)+) => {
        /// The data of a series in the form of their drawing.
        #[derive(Debug, Clone, PartialEq)]
        pub enum Shape {
            $($(#[$doc])* $name($($type),+),)+
        }

        impl Shape {
            /// The shape as the interface that the pipeline uses.
            pub(super) fn form(&self) -> Box<dyn Form<'_> + '_> {
                match self {
                    $(Self::$name($($data),+) => Box::new($form),)+
                }
            }
        }
    };
}

shapes! {
    /// A line through points.
    Line(points: Vec<Point>) => line::Line(points),
    /// A learning curve.
    Curve(curve: Curve) => curve,
    /// A line through marked points with an error bar at each.
    MarkedLine(points: Vec<Point>) => marked_line::MarkedLine(points),
    /// A horizontal dashed line across the panel.
    Level(value: f64) => level::Level(*value),
    /// Points without a line between them.
    Points(points: Vec<Point>) => points::Points(points),
    /// Bars from zero with an interval each: the points are centres and heights, the number is the width of all bars.
    Bars(points: Vec<Point>, width: f64) => bars::Bars(points, *width),
    /// Bars along the horizontal axis from one end of the interval to the other, with a line at the value. The axes
    /// are swapped: `x` is the row of the point on the vertical axis.
    Across(points: Vec<Point>) => across::Across(points),
    /// A surface over a full grid.
    Surface(surface: Surface) => surface,
    /// Coloured cells over two axes of names.
    Cells(cells: Cells) => cells,
    /// Points of a path, from light to dark.
    Path(points: Vec<Point>) => path::Path(points),
    /// Points marked by a cross.
    Crosses(points: Vec<Point>) => crosses::Crosses(points),
    /// Images in rows, without axes.
    Images(tiles: Tiles) => tiles,
    /// Boxes and arrows, without axes.
    Graph(graph: Graph) => graph,
    /// Upright axes that replace those of the panel: one over each name of the horizontal axis, with ticks at places
    /// from 0 to 1.
    Axes(axes: Vec<Vec<Tick>>) => upright_axes::UprightAxes(axes),
}

/// Values of an axis or of a scale of colours.
pub(super) type Values<'a> = Box<dyn Iterator<Item = f64> + 'a>;

/// Header and lines of a data file.
pub(super) type Sheet = (&'static [&'static str], Vec<Vec<String>>);

/// Width of a line in the legend that shows its dashes, in points.
const LINE_SAMPLE: f64 = 20.0;

/// Interface between the pipeline and the data of a shape. The default methods fit most shapes.
pub(super) trait Form<'a> {
    /// Points of the series, without single runs.
    fn points(&self) -> &'a [Point] {
        &[]
    }

    /// Runs that are drawn as thin lines.
    fn runs(&self) -> &'a [RunLine] {
        &[]
    }

    /// Points of the series and of its drawn runs.
    fn all_points(&self) -> Box<dyn Iterator<Item = &'a Point> + 'a> {
        let of_runs = self.runs().iter().flat_map(|run| &run.points);
        Box::new(self.points().iter().chain(of_runs))
    }

    /// Last value of a line or of a row of points.
    fn last_value(&self) -> Option<f64> {
        None
    }

    /// Horizontal values that the axis must hold.
    fn places(&self) -> Values<'a> {
        Box::new(self.all_points().map(|point| point.x))
    }

    /// Vertical values that the axis must hold, ends of intervals included.
    fn heights(&self) -> Values<'a> {
        Box::new(self.all_points().flat_map(Point::ends).flatten())
    }

    /// Room on either side of the horizontal axis, as a part of its range.
    fn padding(&self) -> f64 {
        0.02
    }

    /// Whether it fills its plot; such a plot is about square and has no room around its values.
    fn fills_plot(&self) -> bool {
        false
    }

    /// Whether it is drawn between axes.
    fn has_axes(&self) -> bool {
        true
    }

    /// Upright axes that replace those of its panel.
    fn upright_axes(&self) -> &'a [Vec<Tick>] {
        &[]
    }

    /// Meaning and values of its colours; `None` if its colour is that of its series.
    fn color_scale(&self) -> Option<(&'a str, Values<'a>)> {
        None
    }

    /// Ground under its marks, for a dark page.
    fn ground(&self) -> Ground {
        Ground::Paper
    }

    /// Marks of the series over its runs and bands; `colors` is the range of the scale of colours.
    fn draw(&self, _style: Style, _frame: &Frame, _colors: Option<Range>) -> Vec<Mark> {
        Vec::new()
    }

    /// Bands around its line, which lie below all lines.
    fn bands(&self, _style: Style, _frame: &Frame) -> Vec<Mark> {
        Vec::new()
    }

    /// Dashes of its runs; empty for full lines.
    fn run_dashes(&self, _: Style) -> &'static [f64] {
        &[]
    }

    /// The complete drawing of a chart of such shapes without axes, in points, at the requested width; `None` for a
    /// shape with axes.
    fn paint(&self, _chart: &Chart, _asked: Option<f64>) -> Option<Drawing> {
        None
    }

    /// Width of its sample in the legend, in points.
    fn sample_width(&self) -> f64 {
        8.0
    }

    /// Its sample in the legend, from a place to the right.
    fn sample(&self, style: Style, (x, y): Position) -> Vec<Mark> {
        let middle = x + self.sample_width() / 2.0;
        let points = rectangle((middle - 4.0, y - 3.5), (middle + 4.0, y + 3.5));
        vec![Mark::area(points, style.color())]
    }

    /// Whether it is a value that other series are compared with. It describes a chart or a name only if there is
    /// nothing else.
    fn is_reference(&self) -> bool {
        false
    }

    /// Whether it comes from a publication; such series have legend entries of their own.
    fn is_published(&self) -> bool {
        false
    }

    /// Whether it may become grey in a chart with more names than a legend can hold.
    fn is_dimmable(&self) -> bool {
        false
    }

    /// Nouns for the drawing and for its values, at the beginning of a sentence.
    fn nouns(&self) -> (&'static str, &'static str) {
        ("Lines", "Last values")
    }

    /// Values whose sizes decide the number of decimals in texts.
    fn told_values(&self) -> Values<'a> {
        Box::new(self.points().iter().map(|point| point.y))
    }

    /// Its values as text; `None` if there are none to describe.
    fn in_words(&self, _panel: &Panel, format: NumberFormat) -> Option<String> {
        self.last_value().map(|value| format.write(value))
    }

    /// Its lines in the data file of a chart with axes.
    fn rows(&self, panel: &'a Panel) -> Rows<'a> {
        data_file::of_points(self.points(), &panel.x, "")
    }

    /// Header and lines of the data file of a chart without axes; the pipeline adds the name of the panel to each line.
    fn sheet(&self) -> Option<Sheet> {
        None
    }

    /// Fields of its series in the page's own plot; `None` if that plot cannot show it.
    fn plot_data(&self, _style: Style, _log: bool) -> Option<Map<String, Value>> {
        None
    }
}

impl Shape {
    /// The points of a series, without single runs; empty for a level, a surface and shapes without axes.
    #[must_use]
    pub fn points(&self) -> &[Point] {
        self.form().points()
    }

    /// The last value of a line or of a row of points; `None` for other shapes.
    #[must_use]
    pub fn last_value(&self) -> Option<f64> {
        self.form().last_value()
    }

    /// The drawn runs of a learning curve; empty for other shapes.
    #[must_use]
    pub fn runs(&self) -> &[RunLine] {
        self.form().runs()
    }

    /// All vertical values that the axis must hold, bands and single runs included.
    pub fn heights(&self) -> impl Iterator<Item = f64> + '_ {
        self.form().heights()
    }

    /// All horizontal values that the axis must hold, widths of bars included.
    pub fn places(&self) -> impl Iterator<Item = f64> + '_ {
        self.form().places()
    }
}

/// The last finite height of some points.
fn last_height(points: &[Point]) -> Option<f64> {
    let mut heights = points.iter().map(|point| point.y);
    heights.rfind(|value| value.is_finite())
}
