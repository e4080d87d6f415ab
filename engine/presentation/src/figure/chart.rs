//! A computed figure: panels with series, as data.

use super::{shape::Shape, ticks::Tick};

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

/// Size of a figure as the study gives it; absent values are chosen.
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
    /// Values that the axis always includes, such as the zero of bars.
    pub includes: Vec<f64>,
}

/// One line, set of points, set of bars or surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend; empty if the series has no entry.
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
    /// The i-th of n steps from dark to light, for series other than agents.
    Ramp(usize, usize),
    /// Dark grey, for thresholds.
    Grey,
    /// Pale grey and wide, for reference lines, which stay visible behind a line that covers them.
    Behind,
    /// Pale grey, for the lines of a crowded chart that are not among the best ones.
    Other,
}

impl Default for Hue {
    fn default() -> Self {
        Self::Palette(0)
    }
}

/// A point, with the interval of its vertical value if it has one.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Point {
    /// Value on the horizontal axis.
    pub x: f64,
    /// Value on the vertical axis.
    pub y: f64,
    /// Lower and upper end of the interval of `y`.
    pub interval: Option<(f64, f64)>,
}

impl Point {
    /// The value and the ends of its interval.
    pub(super) fn ends(&self) -> [Option<f64>; 3] {
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
        let mut axes = self
            .series
            .iter()
            .map(|series| series.shape.form().upright_axes());
        axes.find(|axes| !axes.is_empty()).unwrap_or_default()
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
