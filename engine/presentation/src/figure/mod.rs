//! Figures: their specifications, and their computation from results.

mod axes;
mod bars;
mod best_so_far;
mod build;
mod chart;
mod contour;
mod crowd;
mod curve_notes;
#[cfg(test)]
mod curve_tests;
mod data_file;
mod drawn;
#[cfg(test)]
mod drawn_tests;
mod graph;
mod graph_drawing;
mod grouped_lines;
mod heat_map;
mod image_tiles;
mod images;
mod importance;
mod in_words;
mod layout;
mod learning_curve;
mod legend;
mod letters;
mod on_dark;
mod over_runs;
mod paint;
mod parallel_coordinates;
mod pdf;
mod plot_data;
mod published;
mod scatter;
mod searched;
mod series;
mod style;
mod suite;
mod surface;
#[cfg(test)]
mod tests;
mod ticks;
mod trajectory;

pub use bars::Bars;
pub use best_so_far::BestSoFar;
pub use build::{Context, build};
pub use chart::{
    Cells, Chart, Curve, CurveSource, Hue, Panel, Paper, Point, RunLine, Scale, Series, Shape, Style,
    Surface, Tiles,
};
pub use contour::Contour;
pub use crowd::name_the_best;
pub use graph::GraphFigure;
pub use grouped_lines::GroupedLines;
pub use heat_map::HeatMap;
pub use images::Images;
pub use importance::ImportanceFigure;
pub use learning_curve::{Automatic, Band, LearningCurve, Line, SeedLines};
pub use letters::lacking;
pub use on_dark::{Ground, Shades, on_dark};
pub use parallel_coordinates::ParallelCoordinates;
pub use pdf::pdf;
pub use plot_data::plot_data;
pub use scatter::Scatter;
pub use suite::{IntervalEstimates, PerformanceProfile, ProbabilityOfImprovement, SampleEfficiency};
pub use ticks::Tick;
pub use trajectory::Trajectory;

use crate::{
    kinds::{Contradiction, kinds},
    names::{Names, Place},
};
use analysis::published_curve::PublishedCurve;
use contract::{ArtifactKind, Error};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{collections::BTreeMap, path::Path};

kinds! {
    /// Kind of a figure, with its options.
    FigureKind: Figure {
        "learning_curve" => LearningCurve(LearningCurve),
            "A metric against training steps, one line per agent with its seeds or a band over them.";
        "trajectory" => Trajectory(Trajectory),
            "Step-by-step values of one recorded episode, one panel per agent.";
        "bars" => Bars(Bars),
            "One metric by groups of bars, with intervals over seeds.";
        "grouped_lines" => GroupedLines(GroupedLines),
            "A metric against a swept key, one line per group.";
        "heat_map" => HeatMap(HeatMap),
            "A comparison as coloured cells, as over two swept keys.";
        "scatter" => Scatter(Scatter),
            "One metric against another, a point per seed.";
        "contour" => Contour(Contour),
            "A surface traced as x, y, z, as filled contours, with what was measured during learning as \
             points over it.";
        "interval_estimates" => IntervalEstimates(IntervalEstimates),
            "Median, interquartile mean, mean and optimality gap of normalised scores over several environments, \
             with intervals, a row per agent.";
        "performance_profile" => PerformanceProfile(PerformanceProfile),
            "The share of runs above a normalised score, one line per agent over all environments.";
        "probability_of_improvement" => ProbabilityOfImprovement(ProbabilityOfImprovement),
            "How often a run of one agent scores above one of another, averaged over environments, a row per \
             pair.";
        "sample_efficiency" => SampleEfficiency(SampleEfficiency),
            "The interquartile mean of normalised scores over several environments against environment steps, \
             one line per agent.";
        "importance" => Importance(ImportanceFigure),
            "How much each key of a search matters: what a forest's forecast loses without it.";
        "best_so_far" => BestSoFar(BestSoFar),
            "The value of each setting that a search tried, in their order, and the best one so far.";
        "parallel_coordinates" => ParallelCoordinates(ParallelCoordinates),
            "The settings that a search tried, a line each over its keys and its metric, with values on every axis.";
        "images" => Images(Images),
            "Samples that trials left as images, a grid of them per agent.";
        "graph" => GraphFigure(GraphFigure),
            "The graph of a design that a trial left, as boxes and arrows, one drawing per agent.";
    }
}

/// Interface of every kind of figure.
pub(crate) trait Figure {
    /// A use of the kind in YAML, for `describe` and for tests.
    fn example() -> &'static str
    where
        Self: Sized;

    /// Options that exclude each other.
    fn contradiction(_: &Value) -> Option<Contradiction>
    where
        Self: Sized,
    {
        None
    }

    /// Checks every name in it against the names that trials record.
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>);

    /// Kind of artifact that it shows; `None` where it shows recorded metrics.
    fn shows(&self) -> Option<ArtifactKind> {
        None
    }

    /// Whether the record in a folder of results holds all its values: means over episodes, without steps and
    /// artifacts.
    fn is_recorded(&self) -> bool {
        self.shows().is_none()
    }

    /// Computes its panels.
    ///
    /// # Errors
    /// [`Error::Render`] where the results lack the values that it shows.
    fn build(&self, spec: &FigureSpec, context: Context<'_>) -> Result<Chart, Error>;
}

/// One figure of a study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FigureSpec {
    /// Caption of the figure, in one sentence.
    #[serde(default)]
    pub caption: String,
    /// Kind of the figure: exactly one.
    #[serde(flatten)]
    pub kind: FigureKind,
    /// Names to print instead of the study's own.
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
    /// Label of the horizontal axis; a sensible one where absent.
    #[serde(default)]
    pub x_label: Option<String>,
    /// Label of the vertical axis; a sensible one where absent.
    #[serde(default)]
    pub y_label: Option<String>,
    /// Sentences under the figure: deviations, sources.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Width on paper in millimetres; 85 for one column of panels and 174 for several where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 30.0, max = 500.0))]
    pub width_mm: Option<f64>,
    /// Size of all text in points, whatever the width; 7.5 where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 4.0, max = 24.0))]
    pub font_pt: Option<f64>,
}

impl FigureSpec {
    /// A figure of this kind, without caption, labels and notes.
    #[must_use]
    pub fn of(kind: impl Into<FigureKind>) -> Self {
        Self {
            caption: String::new(),
            kind: kind.into(),
            labels: BTreeMap::new(),
            x_label: None,
            y_label: None,
            notes: Vec::new(),
            width_mm: None,
            font_pt: None,
        }
    }

    /// Resolves the files of its published curves against `folder`.
    pub fn seek_from(&mut self, folder: &Path) {
        self.published_curves_mut()
            .iter_mut()
            .for_each(|curve| curve.seek_from(folder));
    }

    /// The published curves in it.
    pub fn published_curves_mut(&mut self) -> &mut [PublishedCurve] {
        if let FigureKind::LearningCurve(curve) = &mut self.kind {
            &mut curve.published
        } else {
            &mut []
        }
    }
}

impl FigureKind {
    /// Checks every name in it.
    pub(crate) fn check(&self, names: &mut Names<'_>, at: &Place<'_>) {
        self.it().check(names, at);
    }

    /// Kind of artifact that it shows; `None` where it shows recorded metrics.
    #[must_use]
    pub fn shows(&self) -> Option<ArtifactKind> {
        self.it().shows()
    }

    /// Whether the record in a folder of results holds all its values.
    #[must_use]
    pub fn is_recorded(&self) -> bool {
        self.it().is_recorded()
    }
}

/// The names in the legend of a chart, in their order.
#[must_use]
pub fn legend_names(chart: &Chart) -> Vec<String> {
    legend::entries(chart).into_iter().map(|(_, name)| name).collect()
}

/// Whether a chart is as wide as two columns of a paper.
#[must_use]
pub fn is_wide(chart: &Chart) -> bool {
    layout::draw(chart).width > layout::SINGLE
}

/// A chart as an SVG file, sized in millimetres for one or two columns of a paper.
///
/// # Errors
/// [`Error::Render`] where the drawing is refused.
pub fn svg(chart: &Chart) -> Result<String, Error> {
    // A width from the study is kept to a hundredth of a millimetre.
    let decimals = if chart.paper.width_mm.is_some() { 2 } else { 1 };
    paint::svg(&layout::draw(chart), decimals)
}

/// Writes a chart as a PNG file of 288 pixels per inch; the path must end in `.png`.
///
/// # Errors
/// [`Error::Render`] where the drawing is refused or the file cannot be written.
pub fn png(chart: &Chart, path: &Path) -> Result<(), Error> {
    paint::png(&layout::draw(chart), path)
}
