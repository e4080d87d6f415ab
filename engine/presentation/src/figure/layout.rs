//! Turns a chart into a drawing: positions of legend, panels, axes and labels.

use super::{
    axes::{self, Frame, OVERHANG, Range, TEXT},
    chart::{Chart, Panel, Scale},
    color_scale, drawn, legend,
    paint::{Align, Drawing, Mark, text_width},
    series,
    shape::Shape,
    style::INK,
    ticks::Tick,
};

/// Width of one column of a paper, 85 mm, in points.
pub(super) const SINGLE: f64 = 241.0;
/// Width of two columns with the gap between them, 174 mm.
pub(super) const DOUBLE: f64 = 493.0;
/// Points in a millimetre.
pub(super) const POINTS_PER_MM: f64 = 72.0 / 25.4;
/// Height of a line of text, and of each further line of a label.
const LINE: f64 = 10.0;
const LABEL_LINE: f64 = 8.8;
/// Height of a row of a vertical axis with names.
const ROW: f64 = 15.0;
/// Least height of a figure with axes.
const LOWEST: f64 = 60.0;
/// Room between a row's axis labels and the next row.
const GAP: f64 = 7.0;
/// Largest number of upright axes beside each other in one column of a paper.
const MOST_UPRIGHT: usize = 4;
/// Room for the colour bar of surfaces, its numbers and label.
const COLOR_BAR: f64 = 42.0;

/// Lays a chart out for paper at the width that the study gives; without one, a single column of panels is one paper
/// column wide and several are two. Charts without axes have a layout of their own.
pub(super) fn draw(chart: &Chart) -> Drawing {
    // Everything is laid out for text of the usual size, and then scaled as a whole.
    let scale = chart.paper.font_pt.map_or(1.0, |size| size / TEXT);
    let width = chart.paper.width_mm.map(|width| width * POINTS_PER_MM / scale);
    let drawing = drawn::shapes(chart).find_map(|(.., shape)| shape.form().paint(chart, width));
    drawing.unwrap_or_else(|| with_axes(chart, width)).scaled(scale)
}

fn with_axes(chart: &Chart, width: Option<f64>) -> Drawing {
    let width = width.unwrap_or_else(|| usual_width(chart));
    let mut marks = Vec::new();
    let top = legend::draw(chart, width, &mut marks);
    let frames = Grid::of(chart, width, top);
    let height = frames.place(chart, &mut marks);
    Drawing { width, height, marks }
}

fn usual_width(chart: &Chart) -> f64 {
    let upright = chart.panels.iter().map(|panel| panel.upright_axes().len()).max();
    if chart.columns <= 1 && upright.is_none_or(|axes| axes <= MOST_UPRIGHT) {
        SINGLE
    } else {
        DOUBLE
    }
}

/// The widths of the columns of panels, and the room for their axes.
struct Grid {
    ranges: Vec<(Range, Range)>,
    /// Left edge of each column's plots, and the room before it.
    lefts: Vec<f64>,
    margins: Vec<f64>,
    plot: (f64, f64),
    top: f64,
    heights: Option<Range>,
}

impl Grid {
    fn of(chart: &Chart, width: f64, top: f64) -> Self {
        let columns = chart.columns.max(1);
        let ranges = ranges(chart);
        let height = plot_height(chart, width);
        let margins: Vec<f64> = (0..columns)
            .map(|column| left_margin(chart, &ranges, column, height))
            .collect();
        let heights = color_scale::heights(chart);
        let right = if heights.is_some() { COLOR_BAR } else { 0.0 };
        let plot_width = (width - right - margins.iter().sum::<f64>()) / count(columns) - OVERHANG;
        let left =
            |column: usize| margins[..=column].iter().sum::<f64>() + count(column) * (plot_width + OVERHANG);
        Self {
            lefts: (0..columns).map(left).collect(),
            margins,
            ranges,
            plot: (plot_width, height),
            top,
            heights,
        }
    }

    /// Draws all panels; returns the height of the drawing.
    fn place(&self, chart: &Chart, marks: &mut Vec<Mark>) -> f64 {
        let columns = chart.columns.max(1);
        let mut top = self.top;
        for (row, panels) in chart.panels.chunks(columns).enumerate() {
            top += self.room_above(panels);
            for (column, panel) in panels.iter().enumerate() {
                self.panel(chart, panel, (row, column), top, marks);
            }
            let below = panels
                .iter()
                .enumerate()
                .map(|(column, panel)| self.room_below(chart, panel, row * columns + column));
            top += self.plot.1 + below.fold(0.0, f64::max) + GAP;
        }
        if let Some(heights) = self.heights {
            let first_row = &chart.panels[..columns.min(chart.panels.len())];
            let top = self.top + self.room_above(first_row);
            let last = self.frame(0, self.lefts.len() - 1, top);
            color_scale::color_bar(chart, heights, &last, marks);
        }
        top - GAP + 3.0
    }

    fn panel(
        &self,
        chart: &Chart,
        panel: &Panel,
        (row, column): (usize, usize),
        top: f64,
        marks: &mut Vec<Mark>,
    ) {
        let index = row * chart.columns.max(1) + column;
        let frame = self.frame(index, column, top);
        let has_usual_axes = panel.upright_axes().is_empty();
        axes::background(&frame, panel, self.heights.is_none() && has_usual_axes, marks);
        series::draw(panel, &frame, self.heights, marks);
        if has_usual_axes {
            axes::border(&frame, marks);
        }
        let columns = chart.columns.max(1);
        let of_row = &chart.panels[row * columns..chart.panels.len().min((row + 1) * columns)];
        for (above, line) in self.titles(of_row)[column].iter().rev().enumerate() {
            let y = top - LINE / 2.0 - 1.5 - LABEL_LINE * count(above);
            marks.push(text(((frame.left + frame.right) / 2.0, y), line, Align::Center));
        }
        if has_usual_axes && !(chart.shared_y && column > 0) {
            axes::vertical(&frame, &panel.y, marks);
            if column == 0 || panel.y.label != chart.panels[index - 1].y.label {
                let middle = (frame.top + frame.bottom) / 2.0;
                let edge = frame.left - self.margins[column] + 5.5;
                axes::upright(&panel.y.label, (edge, middle), upright_room(self.plot.1), marks);
            }
        }
        if shows_x(chart, index) {
            let depth = axes::horizontal(&frame, &panel.x, marks);
            let at = (
                (frame.left + frame.right) / 2.0,
                frame.bottom + depth + LINE / 2.0,
            );
            for (index, line) in self.x_label(panel).iter().enumerate() {
                let down = LABEL_LINE * count(index);
                marks.push(text((at.0, at.1 + down), line, Align::Center));
            }
        }
    }

    /// Room above the plots of a row of panels, for their titles and the label of a colour bar.
    fn room_above(&self, panels: &[Panel]) -> f64 {
        let lines = self.titles(panels).iter().map(Vec::len).max().unwrap_or(0);
        match lines.max(usize::from(self.heights.is_some())) {
            0 => 4.0,
            lines => LINE + 2.0 + LABEL_LINE * count(lines - 1),
        }
    }

    /// The lines of each title of a row of panels: one, unless neighbours would overlap.
    fn titles(&self, panels: &[Panel]) -> Vec<Vec<String>> {
        let width = |panel: &Panel| text_width(&panel.title, TEXT);
        let mut pairs = panels.windows(2).zip(self.lefts.windows(2));
        let overlap =
            pairs.any(|(pair, lefts)| (width(&pair[0]) + width(&pair[1])) / 2.0 > lefts[1] - lefts[0]);
        let lines = |panel: &Panel| match panel.title.as_str() {
            "" => Vec::new(),
            title if overlap => axes::break_lines(title, self.plot.0),
            title => vec![title.to_owned()],
        };
        panels.iter().map(lines).collect()
    }

    /// The label of a horizontal axis, in lines that stand below the plot.
    fn x_label(&self, panel: &Panel) -> Vec<String> {
        axes::break_lines(&panel.x.label, self.plot.0 + 2.0 * OVERHANG)
    }

    fn frame(&self, index: usize, column: usize, top: f64) -> Frame {
        let (x, y) = self.ranges[index];
        let left = self.lefts[column];
        Frame {
            left,
            right: left + self.plot.0,
            top,
            bottom: top + self.plot.1,
            x,
            y,
        }
    }

    fn room_below(&self, chart: &Chart, panel: &Panel, index: usize) -> f64 {
        if !shows_x(chart, index) {
            return 0.0;
        }
        let frame = self.frame(index, index % self.lefts.len(), 0.0);
        let label = match self.x_label(panel).len() {
            0 => 0.0,
            lines => LINE + LABEL_LINE * count(lines - 1),
        };
        axes::horizontal(&frame, &panel.x, &mut Vec::new()) + label
    }
}

/// With a shared horizontal axis only the lowest panel of a column shows it.
fn shows_x(chart: &Chart, index: usize) -> bool {
    !chart.shared_x || index + chart.columns >= chart.panels.len()
}

/// Height for rows of names; otherwise a proportion of the width, unless the study gives another width.
fn plot_height(chart: &Chart, width: f64) -> f64 {
    let rows = chart.panels.iter().map(|panel| panel.y.categories.len()).max();
    match rows {
        Some(rows) if rows > 0 => ROW * count(rows) + 4.0,
        _ => (usual_height(chart) * width / usual_width(chart)).max(LOWEST),
    }
}

fn usual_height(chart: &Chart) -> f64 {
    match chart.columns {
        // About square, since both axes have the same role.
        columns if is_filled(chart) => {
            if columns > 2 {
                122.0
            } else {
                150.0
            }
        }
        _ if chart.shared_x => 72.0,
        0 | 1 => 132.0,
        2 => 125.0,
        _ => 104.0,
    }
}

/// Longest upright label beside a plot of some height.
fn upright_room(height: f64) -> f64 {
    height + 24.0
}

/// Whether a series fills its plot.
fn is_filled(chart: &Chart) -> bool {
    let mut series = chart.panels.iter().flat_map(|panel| &panel.series);
    series.any(|series| series.shape.form().fills_plot())
}

fn left_margin(chart: &Chart, ranges: &[(Range, Range)], column: usize, height: f64) -> f64 {
    if chart.shared_y && column > 0 {
        // Axes of filled plots end in numbers, which must not meet.
        return if is_filled(chart) { 12.0 } else { 5.0 };
    }
    let of_panel = |index: usize| {
        let panel = &chart.panels[index];
        if !panel.upright_axes().is_empty() {
            return 0.0;
        }
        let labelled = column == 0 || panel.y.label != chart.panels[index - 1].y.label;
        let lines = if labelled {
            axes::break_lines(&panel.y.label, upright_room(height)).len()
        } else {
            0
        };
        widest(&axes::ticks(&panel.y, ranges[index].1, height, false)) + 7.0 + LINE * count(lines)
    };
    (column..chart.panels.len())
        .step_by(chart.columns.max(1))
        .map(of_panel)
        .fold(0.0, f64::max)
}

fn widest(ticks: &[Tick]) -> f64 {
    ticks
        .iter()
        .map(|tick| text_width(&tick.text, TEXT))
        .fold(0.0, f64::max)
}

/// The range of both axes of each panel: of its own data, or of all panels that share the axis.
fn ranges(chart: &Chart) -> Vec<(Range, Range)> {
    let columns = chart.columns.max(1);
    let group = |shared: bool, same: &dyn Fn(usize) -> bool, index: usize| -> Vec<&Panel> {
        let belongs = |(other, _): &(usize, &Panel)| if shared { same(*other) } else { *other == index };
        chart
            .panels
            .iter()
            .enumerate()
            .filter(belongs)
            .map(|(_, panel)| panel)
            .collect()
    };
    let of_panel = |index: usize| {
        let in_column = group(
            chart.shared_x,
            &|other| other % columns == index % columns || chart.shared_y,
            index,
        );
        let in_row = group(chart.shared_y, &|other| other / columns == index / columns, index);
        (horizontal_range(&in_column), vertical_range(&in_row))
    };
    (0..chart.panels.len()).map(of_panel).collect()
}

fn shapes<'a>(panels: &[&'a Panel]) -> impl Iterator<Item = &'a Shape> {
    let series = panels.iter().flat_map(|panel| &panel.series);
    series.map(|series| &series.shape)
}

fn horizontal_range(panels: &[&Panel]) -> Range {
    let scale: &Scale = &panels[0].x;
    if !scale.categories.is_empty() {
        return Range {
            low: -0.5,
            high: count(scale.categories.len()) - 0.5,
            log: false,
        };
    }
    let shapes = || shapes(panels);
    let padding = shapes().next().map_or(0.02, |shape| shape.form().padding());
    Range::around(
        shapes()
            .flat_map(Shape::places)
            .chain(scale.includes.iter().copied()),
        scale.log,
        padding,
    )
}

fn vertical_range(panels: &[&Panel]) -> Range {
    let scale: &Scale = &panels[0].y;
    if !scale.categories.is_empty() {
        // The first row is the highest.
        return Range {
            low: count(scale.categories.len()) - 0.5,
            high: -0.5,
            log: false,
        };
    }
    let shapes = || shapes(panels);
    let padding = if shapes().any(|shape| shape.form().fills_plot()) {
        0.0
    } else {
        0.06
    };
    let mut range = Range::around(
        shapes()
            .flat_map(Shape::heights)
            .chain(scale.includes.iter().copied()),
        scale.log,
        padding,
    );
    // Bars stand on the axis: there is no room between zero and its end.
    if scale.includes.contains(&0.0) {
        let values = || shapes().flat_map(Shape::heights);
        if values().all(|value| value >= 0.0) {
            range.low = 0.0;
        } else if values().all(|value| value <= 0.0) {
            range.high = 0.0;
        }
    }
    range
}

pub(super) fn text(at: (f64, f64), text: &str, align: Align) -> Mark {
    Mark::Text {
        at,
        text: text.into(),
        size: TEXT,
        align,
        upright: false,
        color: INK,
    }
}

#[allow(clippy::cast_precision_loss, reason = "a handful of panels or categories")]
pub(super) fn count(number: usize) -> f64 {
    number as f64
}
