//! A computed figure: panels with series, as data.

use super::ticks::Tick;
use contract::drawing::{Graph, Image};

/// A figure as data: what the drawing and the CSV file read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chart {
    /// The panels, row by row.
    pub panels: Vec<Panel>,
    /// Panels in a row.
    pub columns: usize,
    /// True where all panels of a column have one horizontal axis, written under the lowest.
    pub shared_x: bool,
    /// True where all panels of a row have one vertical axis, written beside the first.
    pub shared_y: bool,
    /// Sentences under the figure.
    pub notes: Vec<String>,
    /// How wide it is on paper, and how large its text.
    pub paper: Paper,
}

/// What a study says of a figure's size; what it does not say is chosen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Paper {
    /// Width in millimetres.
    pub width_mm: Option<f64>,
    /// Size of all text in points.
    pub font_pt: Option<f64>,
}

/// One pair of axes with what is drawn between them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Panel {
    /// What stands above it.
    pub title: String,
    /// The horizontal axis.
    pub x: Scale,
    /// The vertical axis.
    pub y: Scale,
    /// What is drawn, the first at the bottom.
    pub series: Vec<Series>,
}

/// An axis.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scale {
    /// What it shows, with the unit.
    pub label: String,
    /// Logarithmic.
    pub log: bool,
    /// Names at 0, 1, 2, ... in place of numbers; empty on an axis of numbers.
    pub categories: Vec<String>,
    /// Always part of the axis, as the zero of bars is.
    pub includes: Vec<f64>,
}

/// One line, set of points, set of bars or surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Its name in the legend; empty where it has no entry.
    pub label: String,
    /// Seeds it rests on and seeds that are planned.
    pub seeds: Option<(usize, usize)>,
    /// Colour, dash and marker.
    pub style: Style,
    /// The data.
    pub shape: Shape,
}

/// How a series looks. Equal numbers look equal in every figure of a study.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Style {
    /// Which hue: the agent's place in the study.
    pub hue: Hue,
    /// Which dash and marker.
    pub variant: usize,
}

/// Where a colour comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hue {
    /// The n-th colour of the palette.
    Palette(usize),
    /// The i-th of n steps from dark to light, for things that are no agents.
    Ramp(usize, usize),
    /// Dark grey, for thresholds.
    Grey,
    /// Pale grey and wide, for what lines are held against: it shows behind a line that covers it.
    Behind,
    /// Pale grey, for the lines of a crowded chart that are not among the best ones.
    Other,
}

impl Default for Hue {
    fn default() -> Self {
        Self::Palette(0)
    }
}

/// A learning curve: what is shown of all runs, and each of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Whose curve it is, which is seen from the kind of dashes.
    pub of: CurveOf,
    /// The line, with a band around it where low and high are given.
    pub points: Vec<Point>,
    /// Runs that are drawn as thin lines; empty where only the line is.
    pub runs: Vec<RunLine>,
    /// Runs that are not drawn: a page shows them to those who ask.
    pub undrawn: Vec<RunLine>,
    /// The statistic of the line over the last values of the runs, where not all of them end where the line does.
    pub at_the_ends: Option<f64>,
}

impl Curve {
    /// All runs, drawn or not.
    pub fn all_runs(&self) -> impl Iterator<Item = &RunLine> {
        self.runs.iter().chain(&self.undrawn)
    }
}

/// Whose learning curve it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CurveOf {
    /// Of an agent that learns.
    Learner,
    /// Of an agent that does not.
    NonLearner,
    /// Of a publication.
    Publication,
}

/// One run of a learning curve.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunLine {
    /// The seed, or the name that a publication gives the run.
    pub name: String,
    /// Id of its trial; empty for a publication.
    pub trial: String,
    /// Its line.
    pub points: Vec<Point>,
}

/// The data of a series.
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
    /// Points that are not joined.
    Points(Vec<Point>),
    /// Bars from zero with an interval each: centre, height, and the width of all.
    Bars(Vec<Point>, f64),
    /// Bars along the horizontal axis from one end of the interval to the other, with a line at the value. The
    /// axes are swapped: `x` is the row of the point on the vertical axis.
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
    /// Upright axes in place of those of the panel: one over each name of the horizontal axis, with ticks at places
    /// from 0 to 1.
    Axes(Vec<Vec<Tick>>),
}

/// Images in rows.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tiles {
    /// Id of the trial that left them, in whose folder the file with all of them lies.
    pub trial: String,
    /// The images that are shown, all of one size.
    pub images: Vec<Image>,
    /// How many stand in a row, at least one.
    pub columns: usize,
    /// The side of an image on paper in millimetres; as large as there is room where absent.
    pub size_mm: Option<f64>,
}

/// A point, with the interval of its vertical value where there is one.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Point {
    /// Horizontal value.
    pub x: f64,
    /// Vertical value.
    pub y: f64,
    /// Lower and upper end of the interval.
    pub interval: Option<(f64, f64)>,
}

/// Coloured cells over two axes of names.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cells {
    /// What the colours are, with the unit.
    pub label: String,
    /// The values `[row][column]`, the first row the highest; `None` where there is none.
    pub values: Vec<Vec<Option<f64>>>,
    /// What is written into the cells.
    pub texts: Vec<Vec<String>>,
}

/// A surface over a full grid.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Surface {
    /// What its height is, with the unit.
    pub label: String,
    /// Increasing grid positions.
    pub x: Vec<f64>,
    /// Increasing grid positions.
    pub y: Vec<f64>,
    /// Heights, `[y][x]`.
    pub z: Vec<Vec<f64>>,
}

impl Shape {
    /// The points of a series, without single runs; none for a level, a surface and what has no axes.
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

    /// The value at which a line, or a row of points, ends; `None` for other shapes.
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

    /// The single runs of a learning curve, as far as they are drawn.
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

    /// True for a line that a crowded chart shows in grey.
    pub(super) fn is_other(&self) -> bool {
        self.style.hue == Hue::Other
    }
}

impl Panel {
    /// What it is called in files: its title, or its number from 1.
    pub(super) fn name(&self, index: usize) -> String {
        if self.title.is_empty() {
            (index + 1).to_string()
        } else {
            self.title.clone()
        }
    }

    /// The upright axes that stand in place of those of the panel; none where it has axes of its own.
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
