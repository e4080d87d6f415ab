//! The data of a figure as comma-separated values: a line for each point, including points that are too dense for a
//! picture.

use super::{
    chart::{Cells, Chart, Panel, Point, RunLine, Scale, Series, Shape, Surface},
    drawn,
};
use crate::table::write_csv;
use contract::Error;
use statistics::thinning;

/// The names of the columns.
const HEADER: [&str; 9] = ["panel", "series", "n", "x", "y", "low", "high", "z", "run"];

/// The fields of a point from `x` on.
type Fields = [String; 6];

impl Chart {
    /// The data of the figure, one line per point. `run` names a single run and is empty for values over all runs.
    /// `n` is the number of runs behind the points of the series.
    ///
    /// # Errors
    /// [`Error::Render`] where the writer refuses.
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
    fields(&series.shape, panel).map(move |[x, y, low, high, z, run]| {
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

fn fields<'a>(shape: &'a Shape, panel: &'a Panel) -> Box<dyn Iterator<Item = Fields> + 'a> {
    let none = String::new;
    match shape {
        Shape::Level(level) => Box::new(std::iter::once([
            none(),
            level.to_string(),
            none(),
            none(),
            none(),
            none(),
        ])),
        Shape::Surface(surface) => Box::new(of_surface(surface)),
        Shape::Cells(cells) => Box::new(of_cells(cells, panel)),
        _ => {
            let x = if shape.is_across() { &panel.y } else { &panel.x };
            let line = shape.points().iter().map(|point| of_point(point, x, ""));
            let of_run = |run: &'a RunLine| run.points.iter().map(|point| of_point(point, x, &run.name));
            Box::new(line.chain(runs(shape).flat_map(of_run)))
        }
    }
}

/// The drawn runs, and those whose line leaves out some of their points.
fn runs(shape: &Shape) -> impl Iterator<Item = &RunLine> {
    let undrawn = match shape {
        Shape::Curve(curve) => curve.undrawn.as_slice(),
        _ => &[],
    };
    let is_long = |run: &&RunLine| run.points.len() > thinning::MOST;
    shape.runs().iter().chain(undrawn.iter().filter(is_long))
}

fn of_surface(surface: &Surface) -> impl Iterator<Item = Fields> + '_ {
    let none = String::new;
    surface.y.iter().zip(&surface.z).flat_map(move |(y, z)| {
        let cell = move |(x, z): (&f64, &f64)| {
            [
                x.to_string(),
                y.to_string(),
                none(),
                none(),
                z.to_string(),
                none(),
            ]
        };
        surface.x.iter().zip(z).map(cell)
    })
}

fn of_cells<'a>(cells: &'a Cells, panel: &'a Panel) -> impl Iterator<Item = Fields> + 'a {
    let none = String::new;
    let name = |scale: &Scale, index: usize| scale.categories.get(index).cloned().unwrap_or_default();
    cells.values.iter().enumerate().flat_map(move |(row, values)| {
        let cell = move |(column, value): (usize, &Option<f64>)| {
            let value = value.map_or_else(none, |value| value.to_string());
            [
                name(&panel.x, column),
                name(&panel.y, row),
                none(),
                none(),
                value,
                none(),
            ]
        };
        values.iter().enumerate().map(cell)
    })
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
