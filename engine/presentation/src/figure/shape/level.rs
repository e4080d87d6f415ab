//! A horizontal dashed line across the panel.

use super::{
    Form, Frame, LINE_SAMPLE, Map, Mark, NumberFormat, Panel, Position, Range, Rows, Style, Value, Values,
};
use crate::figure::{
    data_file::of_value,
    plot_data::number,
    strokes::{LINE_WIDTH, dashed, stretch},
};
use serde_json::json;

/// The height of the line.
pub(super) struct Level(pub f64);

impl<'a> Form<'a> for Level {
    fn heights(&self) -> Values<'a> {
        Box::new(std::iter::once(self.0))
    }

    fn draw(&self, style: Style, frame: &Frame, _: Option<Range>) -> Vec<Mark> {
        let ends = [frame.x.low, frame.x.high].map(|x| frame.at(x, self.0));
        dashed(&ends, style.short_dashes(), LINE_WIDTH, style.color())
    }

    fn sample_width(&self) -> f64 {
        LINE_SAMPLE
    }

    fn sample(&self, style: Style, at: Position) -> Vec<Mark> {
        let ends = stretch(at, LINE_SAMPLE);
        dashed(&ends, style.short_dashes(), LINE_WIDTH, style.color())
    }

    fn is_reference(&self) -> bool {
        true
    }

    fn told_values(&self) -> Values<'a> {
        self.heights()
    }

    fn in_words(&self, _: &Panel, format: NumberFormat) -> Option<String> {
        Some(format.write(self.0))
    }

    fn rows(&self, _: &'a Panel) -> Rows<'a> {
        Box::new(std::iter::once(of_value(
            [String::new(), self.0.to_string()],
            String::new(),
        )))
    }

    fn plot_data(&self, style: Style, _: bool) -> Option<Map<String, Value>> {
        let fields = [("level", number(self.0)), ("dash", json!(style.short_dashes()))];
        Some(
            fields
                .map(|(name, value)| (name.to_owned(), value))
                .into_iter()
                .collect(),
        )
    }
}
