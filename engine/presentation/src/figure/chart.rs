//! A computed figure: panels with series, as data.

use super::ticks::Tick;
use contract::drawing::{Graph, Image};

/// A figure as data, for the drawing and for the CSV file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chart {
    /// Panels of the figure, row by row.
    pub panels: Vec<Panel>,
    /// Number of panels in a row.
    pub columns: usize,
    /// Whether all panels of a column share one horizontal axis, written under the lowest.
    pub shared_x: bool,
    /// Whether all panels of a row share one vertical axis, written beside the first.
    pub shared_y: bool,
    /// Sentences under the figure.
    pub notes: Vec<String>,
    /// Width on paper, and size of text.
    pub paper: Paper,
}

/// Size of a figure as the study states it; absent values are chosen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Paper {
    /// Width in millimetres.
    pub width_mm: Option<f64>,
    /// Size of all text in points.
    pub font_pt: Option<f64>,
}

/// One pair of axes with the series between them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Panel {
    /// Title above the panel.
    pub title: String,
    /// Horizontal axis, shared within a column where `shared_x` is set.
    pub x: Scale,
    /// Vertical axis, shared within a row where `shared_y` is set.
    pub y: Scale,
    /// Series of the panel, the first at the bottom.
    pub series: Vec<Series>,
}

/// An axis of a panel.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scale {
    /// Label: the quantity and its unit.
    pub label: String,
    /// Whether the axis is logarithmic.
    pub log: bool,
    /// Names at 0, 1, 2, ... instead of numbers; empty on an axis of numbers.
    pub categories: Vec<String>,
    /// Values that the axis always holds, such as the zero of bars.
    pub includes: Vec<f64>,
}

/// One line, set of points, set of bars or surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend; empty where the series has no entry.
    pub label: String,
    /// Number of seeds behind the series, and number of seeds planned.
    pub seeds: Option<(usize, usize)>,
    /// Colour, dash and marker.
    pub style: Style,
    /// Points or other data, with the form of their drawing.
    pub shape: Shape,
}

/// Look of a series. Equal numbers look equal in every figure of a study.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Style {
    /// Hue, from the agent's place in the study.
    pub hue: Hue,
    /// Number of the dash and of the marker.
    pub variant: usize,
}

/// Source of a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hue {
    /// The n-th colour of the palette.
    Palette(usize),
    /// The i-th of n steps from dark to light, for series that are no agents.
    Ramp(usize, usize),
    /// Dark grey, for thresholds.
    Grey,
    /// Pale grey and wide, for reference lines: it shows behind a line that covers it.
    Behind,
    /// Pale grey, for the lines of a crowded chart that are not among the best ones.
    Other,
}

impl Default for Hue {
    fn default() -> Self {
        Self::Palette(0)
    }
}

/// A learning curve: the line over all runs, and each run.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Source of the curve, shown by the kind of dashes.
    pub of: CurveSource,
    /// The line, with a band around it where points have intervals.
    pub points: Vec<Point>,
    /// Runs that are drawn as thin lines; empty where only the line is drawn.
    pub runs: Vec<RunLine>,
    /// Runs that are not drawn; the page shows them on request.
    pub undrawn: Vec<RunLine>,
    /// The statistic of the line over the last values of the runs, where some runs go on after the line ends.
    pub at_the_ends: Option<f64>,
}

impl Curve {
    /// All runs, drawn or not.
    pub fn all_runs(&self) -> impl Iterator<Item = &RunLine> {
        self.runs.iter().chain(&self.undrawn)
    }
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

/// The data of a series in the form of their drawing.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A line through points.
    Line(Vec<Point>),
    /// A learning curve.
    Curve(Curve),
    /// A line through marked points with an error bar at each.
    MarkedLine(Vec<Point>),
    /// A horizontal dashed line across the panel.
    Level(f64),
    /// Points without a line between them.
    Points(Vec<Point>),
    /// Bars from zero with an interval each: the points are centres and heights, the number is the width of all bars.
    Bars(Vec<Point>, f64),
    /// Bars along the horizontal axis from one end of the interval to the other, with a line at the value. The axes
    /// are swapped: `x` is the row of the point on the vertical axis.
    Across(Vec<Point>),
    /// A surface over a full grid.
    Surface(Surface),
    /// Coloured cells over two axes of names.
    Cells(Cells),
    /// Points of a path, from light to dark.
    Path(Vec<Point>),
    /// Points marked by a cross.
    Crosses(Vec<Point>),
    /// Images in rows, without axes.
    Images(Tiles),
    /// Boxes and arrows, without axes.
    Graph(Graph),
    /// Upright axes that replace those of the panel: one over each name of the horizontal axis, with ticks at places
    /// from 0 to 1.
    Axes(Vec<Vec<Tick>>),
}

/// Images in rows, in one panel.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tiles {
    /// Id of the trial that left the images; its folder holds the file with all of them.
    pub trial: String,
    /// The images in the figure, all of one size.
    pub images: Vec<Image>,
    /// Images in a row, at least one.
    pub columns: usize,
    /// Side of an image on paper in millimetres; `None` takes the room there is.
    pub size_mm: Option<f64>,
}

/// A point, with the interval of its vertical value where there is one.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Point {
    /// Value on the horizontal axis.
    pub x: f64,
    /// Value on the vertical axis.
    pub y: f64,
    /// Lower and upper end of the interval of `y`.
    pub interval: Option<(f64, f64)>,
}

/// Coloured cells over two axes of names.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cells {
    /// Meaning of the colours, with the unit.
    pub label: String,
    /// Values `[row][column]`, the first row the highest; `None` for a cell without a value.
    pub values: Vec<Vec<Option<f64>>>,
    /// Texts in the cells, `[row][column]`.
    pub texts: Vec<Vec<String>>,
}

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

impl Shape {
    /// The points of a series, without single runs; empty for a level, a surface and shapes without axes.
    #[must_use]
    pub fn points(&self) -> &[Point] {
        match self {
            Shape::Curve(curve) => &curve.points,
            Shape::Line(points)
            | Shape::MarkedLine(points)
            | Shape::Points(points)
            | Shape::Bars(points, _)
            | Shape::Across(points)
            | Shape::Path(points)
            | Shape::Crosses(points) => points,
            Shape::Level(_)
            | Shape::Surface(_)
            | Shape::Cells(_)
            | Shape::Images(_)
            | Shape::Graph(_)
            | Shape::Axes(_) => &[],
        }
    }

    /// The last value of a line or of a row of points; `None` for other shapes.
    #[must_use]
    pub fn last_value(&self) -> Option<f64> {
        let last = |points: &[Point]| {
            points
                .iter()
                .map(|point| point.y)
                .rfind(|value| value.is_finite())
        };
        match self {
            Shape::Curve(curve) => curve.at_the_ends.or_else(|| last(&curve.points)),
            Shape::Line(points) | Shape::MarkedLine(points) | Shape::Points(points) => last(points),
            _ => None,
        }
    }

    /// The drawn runs of a learning curve; empty for other shapes.
    #[must_use]
    pub fn runs(&self) -> &[RunLine] {
        if let Shape::Curve(curve) = self {
            &curve.runs
        } else {
            &[]
        }
    }

    fn with_runs(&self) -> impl Iterator<Item = &Point> + '_ {
        self.points()
            .iter()
            .chain(self.runs().iter().flat_map(|run| &run.points))
    }

    /// All vertical values that the axis must hold, bands and single runs included.
    pub fn heights(&self) -> impl Iterator<Item = f64> + '_ {
        let level = if let Shape::Level(level) = self {
            Some(*level)
        } else {
            None
        };
        let surface = if let Shape::Surface(surface) = self {
            surface.y.as_slice()
        } else {
            &[]
        };
        let is_across = self.is_across();
        let own = move |point: &Point| {
            if is_across {
                [Some(point.x), None, None]
            } else {
                point.ends()
            }
        };
        self.with_runs()
            .flat_map(own)
            .flatten()
            .chain(level)
            .chain(surface.iter().copied())
    }

    pub(super) fn is_across(&self) -> bool {
        matches!(self, Shape::Across(_))
    }

    /// All horizontal values that the axis must hold, widths of bars included.
    pub fn places(&self) -> impl Iterator<Item = f64> + '_ {
        let half = if let Shape::Bars(_, width) = self {
            width / 2.0
        } else {
            0.0
        };
        let surface = if let Shape::Surface(surface) = self {
            surface.x.as_slice()
        } else {
            &[]
        };
        let is_across = self.is_across();
        let own = move |point: &Point| {
            if is_across {
                point.ends()
            } else {
                [Some(point.x - half), Some(point.x + half), None]
            }
        };
        self.with_runs()
            .flat_map(own)
            .flatten()
            .chain(surface.iter().copied())
    }
}

impl Point {
    /// The value and the ends of its interval.
    fn ends(&self) -> [Option<f64>; 3] {
        let (low, high) = self.interval.unzip();
        [Some(self.y), low, high]
    }
}

impl Series {
    /// The legend's text: the name and the number of seeds.
    #[must_use]
    pub fn legend(&self) -> String {
        match self.seeds {
            Some((n, planned)) if n < planned => format!("{} (n = {n} of {planned})", self.label),
            Some((n, _)) => format!("{} (n = {n})", self.label),
            None => self.label.clone(),
        }
    }

    /// Whether the series is a line that a crowded chart shows in grey.
    pub(super) fn is_other(&self) -> bool {
        self.style.hue == Hue::Other
    }
}

impl Panel {
    /// Name of the panel in files: its title, or its number from 1.
    pub(super) fn name(&self, index: usize) -> String {
        if self.title.is_empty() {
            (index + 1).to_string()
        } else {
            self.title.clone()
        }
    }

    /// The upright axes that replace those of the panel; empty for a panel with axes of its own.
    pub(super) fn upright_axes(&self) -> &[Vec<Tick>] {
        let axes = self.series.iter().find_map(|series| match &series.shape {
            Shape::Axes(axes) => Some(axes.as_slice()),
            _ => None,
        });
        axes.unwrap_or_default()
    }
}

impl Scale {
    /// The category nearest to a place; `None` on an axis of numbers.
    #[must_use]
    pub fn name_at(&self, x: f64) -> Option<String> {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a negative place becomes 0, one beyond the end is no category"
        )]
        self.categories.get(x.round() as usize).cloned()
    }
}
