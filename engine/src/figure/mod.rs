//! Figures: what a study asks for, and how it is computed from the results.

mod axes;
mod build;
mod chart;
mod contour;
mod groups;
mod layout;
mod learning_curve;
mod legend;
mod paint;
mod series;
mod style;
mod surface;
#[cfg(test)]
mod tests;
mod ticks;
mod trajectory;

pub use build::{Context, build};
pub use chart::{Chart, Hue, Panel, Point, Scale, Series, Shape, Style, Surface};

use crate::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One figure of a study. Exactly one of the kinds is given.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FigureSpec {
    /// What the figure shows, in one sentence.
    pub caption: String,
    /// A metric against training steps, one line per agent with a band over seeds.
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

/// A metric against training steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LearningCurve {
    /// The metric.
    pub metric: String,
    /// What the band around the mean shows.
    pub band: Band,
    /// Which agents, in this order; all where empty. Agents that do not learn become horizontal lines.
    pub agents: Vec<String>,
    /// Which environments, one panel each; all where empty.
    pub environments: Vec<String>,
    /// Vertical axis on a logarithmic scale.
    pub log_y: bool,
    /// Weight of the past in a moving average y' = smooth y' + (1 - smooth) y of the mean over seeds, for drawing only; the
    /// band is that of the values themselves.
    #[schemars(range(min = 0.0, max = 0.999))]
    pub smooth: f64,
    /// Measurements before this step are left out, of the moving average too: what an untrained agent does may dwarf the rest.
    pub from_step: u64,
}

impl Default for LearningCurve {
    fn default() -> Self {
        Self {
            metric: "return".into(),
            band: Band::Sd,
            agents: Vec::new(),
            environments: Vec::new(),
            log_y: false,
            smooth: 0.0,
            from_step: 0,
        }
    }
}

/// What a band around a mean over seeds shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Band {
    /// One standard deviation to each side.
    Sd,
    /// 95 % bootstrap interval of the mean.
    Interval,
    /// Smallest to largest seed.
    Range,
    /// No band.
    None,
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
pub fn png(chart: &Chart, path: &std::path::Path) -> Result<(), Error> {
    paint::png(&layout::draw(chart), path)
}
