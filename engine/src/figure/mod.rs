//! Figures: what a study asks for, and how it is computed from the results.

mod axes;
mod build;
mod chart;
mod contour;
mod curve_notes;
#[cfg(test)]
mod curve_tests;
mod groups;
mod layout;
mod learning_curve;
mod legend;
mod over_runs;
mod paint;
mod published;
mod series;
mod style;
mod surface;
#[cfg(test)]
mod tests;
mod ticks;
mod trajectory;

pub use build::{Context, build};
pub use chart::{Chart, Curve, CurveOf, Hue, Panel, Point, RunLine, Scale, Series, Shape, Style, Surface};

use crate::{Error, published_curve::PublishedCurve};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::Path};

/// The kinds of figures, each a key of [`FigureSpec`].
pub const KINDS: [&str; 6] = ["learning_curve", "trajectory", "bars", "grouped_lines", "scatter", "contour"];

/// One figure of a study. Exactly one of the [`KINDS`] is given.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FigureSpec {
    /// What the figure shows, in one sentence.
    pub caption: String,
    /// A metric against training steps, one line per agent with its seeds or a band over them.
    pub learning_curve: Option<LearningCurve>,
    /// Step-by-step values of one recorded episode, one panel per agent.
    pub trajectory: Option<Trajectory>,
    /// One metric by groups of bars, with intervals over seeds.
    pub bars: Option<Bars>,
    /// A metric against a swept key, one line per group.
    pub grouped_lines: Option<GroupedLines>,
    /// One metric against another, a point per seed.
    pub scatter: Option<Scatter>,
    /// A surface traced as x, y, z, as filled contours, with what was measured during learning as points over it.
    pub contour: Option<Contour>,
    /// Names to print instead of the study's own.
    pub labels: BTreeMap<String, String>,
    /// Label of the horizontal axis; a sensible one where absent.
    pub x_label: Option<String>,
    /// Label of the vertical axis; a sensible one where absent.
    pub y_label: Option<String>,
    /// Sentences under the figure: departures, sources.
    pub notes: Vec<String>,
}

impl FigureSpec {
    /// Seeks the files of its published curves from `folder`.
    pub fn seek_from(&mut self, folder: &Path) {
        self.published_curves_mut().for_each(|curve| curve.seek_from(folder));
    }

    /// The published curves in it.
    pub fn published_curves_mut(&mut self) -> impl Iterator<Item = &mut PublishedCurve> {
        self.learning_curve.iter_mut().flat_map(|curve| &mut curve.published)
    }
}

/// A metric against training steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LearningCurve {
    /// The metric.
    pub metric: String,
    /// What the line of an agent shows of its seeds.
    pub line: Line,
    /// What the band around the line shows.
    pub band: Band,
    /// Whether each seed is drawn as a thin line: `true`, `false`, or `auto` for panels in which an agent has at most five.
    pub seeds: SeedLines,
    /// Which agents, in this order; all where empty. Agents that do not learn have short dashes.
    pub agents: Vec<String>,
    /// Which environments, one panel each; all where empty.
    pub environments: Vec<String>,
    /// Curves of publications, which are dotted.
    pub published: Vec<PublishedCurve>,
    /// Vertical axis on a logarithmic scale.
    pub log_y: bool,
    /// Weight of the past in a moving average y' = smooth y' + (1 - smooth) y along the curve of each seed, for drawing only;
    /// line and band are those of the averages.
    #[schemars(range(min = 0.0, max = 0.999))]
    pub smooth: f64,
    /// Measurements before this step are left out, of the moving average too: what an untrained agent does may dwarf the rest.
    pub from_step: u64,
}

impl Default for LearningCurve {
    fn default() -> Self {
        Self {
            metric: "return".into(),
            line: Line::Mean,
            band: Band::Auto,
            seeds: SeedLines::Chosen(Automatic::Auto),
            agents: Vec::new(),
            environments: Vec::new(),
            published: Vec::new(),
            log_y: false,
            smooth: 0.0,
            from_step: 0,
        }
    }
}

/// What a line shows of the seeds at each step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Line {
    /// Arithmetic mean.
    Mean,
    /// Median.
    Median,
    /// Interquartile mean: the mean without the smallest and the largest quarter.
    Iqm,
}

/// What a band around a line shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Band {
    /// The interval, but no band in panels where seeds are drawn because they are few.
    Auto,
    /// 95 % interval of what the line shows: Student-t of a mean, percentile bootstrap of a median or interquartile mean.
    Interval,
    /// One standard deviation to each side, which may leave the range of possible values.
    Sd,
    /// Smallest to largest seed.
    Range,
    /// No band.
    None,
}

/// Whether each seed is drawn as a thin line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum SeedLines {
    /// As the study says.
    Said(bool),
    /// As the number of seeds suggests.
    Chosen(Automatic),
}

/// The word for a choice that is left to the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Automatic {
    /// Seeds are drawn in panels in which an agent has at most five.
    Auto,
}

/// Step-by-step values of one recorded episode.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Trajectory {
    /// Trace channels to draw; a word without a number (`voltage`) stands for all channels `voltage_1`, `voltage_2`, ... One row of panels each.
    pub channels: Vec<String>,
    /// Which agents, one column of panels each.
    pub agents: Vec<String>,
    /// Which environment; the first where absent.
    pub environment: Option<String>,
    /// Which seed; the first where absent.
    pub seed: Option<u64>,
    /// Which recorded episode, from 0.
    pub episode: u64,
    /// A horizontal line at this value in the first row of panels.
    pub threshold: Option<f64>,
}

/// One metric by groups of bars.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Bars {
    /// The table's rows become groups, its columns bars.
    pub of: crate::table::Comparison,
}

/// A metric against a swept key.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GroupedLines {
    /// The metric on the vertical axis.
    pub metric: String,
    /// The swept key on the horizontal axis, as its last word (`learning_rate`).
    pub x: String,
    /// Which agents, one line each; all where empty.
    pub agents: Vec<String>,
    /// Which environments, one panel each; all where empty.
    pub environments: Vec<String>,
    /// Horizontal axis on a logarithmic scale.
    pub log_x: bool,
    /// Vertical axis on a logarithmic scale.
    pub log_y: bool,
}

/// One metric against another.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Scatter {
    /// The metric on the horizontal axis.
    pub x: String,
    /// The metric on the vertical axis.
    pub y: String,
    /// Which agents; all where empty.
    pub agents: Vec<String>,
    /// Which environments, one panel each; all where empty.
    pub environments: Vec<String>,
}

/// A surface that was traced, with a path over it that was measured during learning.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Contour {
    /// Trace metrics that hold x, y and z of the surface, a grid point per row.
    pub surface: Vec<String>,
    /// Metrics that hold x and y of the path, a point per measurement during learning, from light to dark.
    pub path: Vec<String>,
    /// Which agents, one panel each; all where empty.
    pub agents: Vec<String>,
    /// Which environment; the first where absent.
    pub environment: Option<String>,
    /// Which seed; the first where absent.
    pub seed: Option<u64>,
}

/// A chart as an SVG file, sized in millimetres for one or two columns of a paper.
///
/// # Errors
/// [`Error::Render`] where the drawing is refused.
pub fn svg(chart: &Chart) -> Result<String, Error> {
    paint::svg(&layout::draw(chart))
}

/// Writes a chart as a PNG file of 288 pixels per inch; the path must end in `.png`.
///
/// # Errors
/// [`Error::Render`] where the drawing is refused or the file cannot be written.
pub fn png(chart: &Chart, path: &Path) -> Result<(), Error> {
    paint::png(&layout::draw(chart), path)
}
