//! The data of a figure as comma-separated values: a line for each point, including points that are too dense for a
//! picture.

use super::{
    chart::{Chart, Panel, Point, Scale, Series},
    drawn,
};
use crate::table::write_csv;
use contract::Error;

/// The names of the columns.
const HEADER: [&str; 9] = ["panel", "series", "n", "x", "y", "low", "high", "z", "run"];

/// The fields of a point from `x` on.
pub(super) type Fields = [String; 6];
/// The lines of a series, each from `x` on.
pub(super) type Rows<'a> = Box<dyn Iterator<Item = Fields> + 'a>;

impl Chart {
    /// The data of the figure, one line per point. `run` names a single run and is empty for values over all runs.
    /// `n` is the number of runs behind the points of the series.
    ///
    /// # Errors
    /// [`Error::Render`] if the writer refuses.
    pub fn csv(&self) -> Result<String, Error> {
        if let Some(lines) = drawn::lines(self) {
            return write_csv(lines);
        }
        let panels = self.panels.iter().enumerate();
        let lines = panels.flat_map(|(index, panel)| {
            let series = panel.series.iter();
            series.flat_map(move |series| lines(panel.name(index), panel, series))
        });
        write_csv(std::iter::once(HEADER.map(String::from)).chain(lines))
    }
}

fn lines<'a>(
    name: String,
    panel: &'a Panel,
    series: &'a Series,
) -> impl Iterator<Item = [String; 9]> + use<'a> {
    let n = series.seeds.map_or(String::new(), |(n, _)| n.to_string());
    series
        .shape
        .form()
        .rows(panel)
        .map(move |[x, y, low, high, z, run]| {
            [
                name.clone(),
                series.label.clone(),
                n.clone(),
                x,
                y,
                low,
                high,
                z,
                run,
            ]
        })
}

/// Lines of points; their places have the names of the axis if it has names.
pub(super) fn of_points<'a>(points: &'a [Point], x: &'a Scale, run: &'a str) -> Rows<'a> {
    Box::new(points.iter().map(move |point| of_point(point, x, run)))
}

/// A value at a place, without an interval.
pub(super) fn of_value([x, y]: [String; 2], z: String) -> Fields {
    let none = String::new;
    [x, y, none(), none(), z, none()]
}

fn of_point(point: &Point, x: &Scale, run: &str) -> Fields {
    let (low, high) = point
        .interval
        .map_or((String::new(), String::new()), |(low, high)| {
            (low.to_string(), high.to_string())
        });
    let place = x.name_at(point.x).unwrap_or_else(|| point.x.to_string());
    [place, point.y.to_string(), low, high, String::new(), run.into()]
}
