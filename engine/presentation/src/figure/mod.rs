//! Figures: their specifications, and their computation from results.

mod axes;
mod bars;
mod best_so_far;
mod build;
#[cfg(test)]
mod built_tests;
mod category_labels;
mod chart;
mod color_scale;
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
mod shape;
mod strokes;
mod style;
mod suite;
#[cfg(test)]
mod tests;
mod ticks;
mod trajectory;

pub use bars::Bars;
pub use best_so_far::BestSoFar;
pub use build::{Context, build};
pub use chart::{Chart, Hue, Panel, Paper, Point, Scale, Series, Style};
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
pub use shape::{Cells, Curve, CurveSource, RunLine, Shape, Surface, Tiles};
pub use suite::{IntervalEstimates, PerformanceProfile, ProbabilityOfImprovement, SampleEfficiency};
pub use ticks::Tick;
pub use trajectory::Trajectory;

use crate::{
    kinds::{Chosen, Kind, KindOptions, KindSpec, Readable},
    names::{Names, Place},
    vocabulary::Vocabulary,
};
use contract::{ArtifactKind, Error};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::Path, sync::Arc};

/// The kinds of figures of the engine, in the order in which they are listed.
pub(crate) fn kinds() -> Vec<Readable<dyn Figure>> {
    vec![
        kind::<LearningCurve>(),
        kind::<Trajectory>(),
        kind::<Bars>(),
        kind::<GroupedLines>(),
        kind::<HeatMap>(),
        kind::<Scatter>(),
        kind::<Contour>(),
        kind::<IntervalEstimates>(),
        kind::<PerformanceProfile>(),
        kind::<ProbabilityOfImprovement>(),
        kind::<SampleEfficiency>(),
        kind::<ImportanceFigure>(),
        kind::<BestSoFar>(),
        kind::<ParallelCoordinates>(),
        kind::<Images>(),
        kind::<GraphFigure>(),
    ]
}

/// Interface of every kind of figure.
pub trait Figure: KindOptions {
    /// Checks every name in it against the names that trials record.
    fn check(&self, names: &mut Names<'_>, at: &Place<'_>);

    /// Names that it prints besides those of metrics, channels, agents, environments and settings; `labels` may replace
    /// them too.
    fn further_names(&self, _: &Vocabulary) -> Vec<String> {
        Vec::new()
    }

    /// Resolves the files that it names relative to the folder of the study.
    fn seek_from(&mut self, _folder: &Path) {}

    /// The metric whose course `watch` shows for it; `None` if it shows something else.
    fn followed_metric(&self) -> Option<&str> {
        None
    }

    /// Kind of artifact that it shows; `None` if it shows recorded metrics.
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
    /// [`Error::Render`] if the results lack the values that it shows.
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
    #[serde(flatten, skip_deserializing, default = "unread")]
    #[schemars(skip)]
    pub kind: Chosen<dyn Figure>,
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
    /// Size of all text in points, independent of the width; 7.5 where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 4.0, max = 24.0))]
    pub font_pt: Option<f64>,
}

/// The kind of a figure whose options are not read yet; its reader fills them in.
fn unread() -> Chosen<dyn Figure> {
    Chosen::of::<LearningCurve>(Arc::new(LearningCurve::default()))
}

impl FigureSpec {
    /// A figure of this kind, without caption, labels and notes.
    #[must_use]
    pub fn of<K: Figure + KindSpec>(kind: K) -> Self {
        Self {
            caption: String::new(),
            kind: Chosen::of::<K>(Arc::new(kind)),
            labels: BTreeMap::new(),
            x_label: None,
            y_label: None,
            notes: Vec::new(),
            width_mm: None,
            font_pt: None,
        }
    }
}

/// The entry of a kind of figures.
pub(crate) fn kind<F: Figure + KindSpec>() -> Readable<dyn Figure> {
    Readable {
        kind: Kind::of::<F>(),
        read: |options, folder| {
            let mut read: F = serde_json::from_value(options)?;
            read.seek_from(folder);
            Ok(Arc::new(read))
        },
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
/// [`Error::Render`] if the drawing is refused.
pub fn svg(chart: &Chart) -> Result<String, Error> {
    // A width from the study is kept to a hundredth of a millimetre.
    let decimals = if chart.paper.width_mm.is_some() { 2 } else { 1 };
    paint::svg(&layout::draw(chart), decimals)
}

/// Writes a chart as a PNG file of 288 pixels per inch; the path must end in `.png`.
///
/// # Errors
/// [`Error::Render`] if the drawing is refused or the file cannot be written.
pub fn png(chart: &Chart, path: &Path) -> Result<(), Error> {
    paint::png(&layout::draw(chart), path)
}
