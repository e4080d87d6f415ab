//! Coloured cells over two axes of names.

use super::{Form, Frame, Ground, Mark, NumberFormat, Panel, Range, Rows, Style, Values, rectangle};
use crate::figure::{
    axes::TEXT,
    chart::Scale,
    color_scale,
    data_file::of_value,
    in_words::span_of,
    layout::count,
    paint::{Align, text_width},
    style::{INK, Rgb},
};

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

impl Cells {
    fn known(&self) -> impl Iterator<Item = f64> + '_ {
        self.values.iter().flatten().copied().flatten()
    }

    /// Row and column of the first cell with this value.
    fn place_of(&self, panel: &Panel, value: f64) -> Option<String> {
        let is_it = |it: &Option<f64>| *it == Some(value);
        let found = self.values.iter().enumerate();
        let (row, column) = found
            .filter_map(|(row, values)| Some((row, values.iter().position(is_it)?)))
            .next()?;
        Some(format!("{}, {}", name(&panel.y, row), name(&panel.x, column)))
    }

    /// Marks of one cell; a cell without a value stays white.
    fn cell(&self, (row, column): (usize, usize), colors: Range, frame: &Frame) -> Vec<Mark> {
        let corner = |right: f64, down: f64| frame.at(count(column) + right, count(row) + down);
        let color = self.values[row][column].map(|value| color_scale::color(colors, value));
        let (from, to) = (corner(-0.5, -0.5), corner(0.5, 0.5));
        let area = color.map(|color| Mark::area(rectangle(from, to), color));
        let words = &self.texts[row][column];
        // A value that does not fit is still in the colour bar and in the figure's file.
        let fits = text_width(words, TEXT) + 2.0 <= (to.0 - from.0).abs();
        let text = fits.then(|| Mark::Text {
            at: corner(0.0, 0.0),
            text: words.clone(),
            size: TEXT,
            align: Align::Center,
            upright: false,
            color: color.map_or(INK, on),
        });
        area.into_iter().chain(text).collect()
    }
}

impl<'a> Form<'a> for &'a Cells {
    fn color_scale(&self) -> Option<(&'a str, Values<'a>)> {
        Some((&self.label, Box::new(self.known())))
    }

    fn ground(&self) -> Ground {
        Ground::Boxes
    }

    fn draw(&self, _: Style, frame: &Frame, colors: Option<Range>) -> Vec<Mark> {
        let Some(colors) = colors else {
            return Vec::new();
        };
        let rows = self.values.iter().enumerate();
        let places = rows.flat_map(|(row, values)| (0..values.len()).map(move |column| (row, column)));
        places.flat_map(|place| self.cell(place, colors, frame)).collect()
    }

    fn nouns(&self) -> (&'static str, &'static str) {
        ("Coloured cells", "Last values")
    }

    fn in_words(&self, panel: &Panel, _: NumberFormat) -> Option<String> {
        span_of(&self.label, self.known(), |value| self.place_of(panel, value))
    }

    fn rows(&self, panel: &'a Panel) -> Rows<'a> {
        let rows = self.values.iter().enumerate();
        Box::new(rows.flat_map(move |(row, values)| {
            let cell = move |(column, value): (usize, &Option<f64>)| {
                let value = value.map_or_else(String::new, |value| value.to_string());
                of_value([name(&panel.x, column), name(&panel.y, row)], value)
            };
            values.iter().enumerate().map(cell)
        }))
    }
}

fn name(scale: &Scale, index: usize) -> String {
    scale.categories.get(index).cloned().unwrap_or_default()
}

/// The more readable of black and white on a colour.
fn on((red, green, blue): Rgb) -> Rgb {
    let lightness = 0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue);
    if lightness > 140.0 {
        INK
    } else {
        (0xff, 0xff, 0xff)
    }
}
