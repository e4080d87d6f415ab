//! Grids of images without axes, one panel beside the other, each pixel as a square.

use super::{
    Chart, Drawing, Form, Ground, Mark, NumberFormat, Panel, Position, Shape, Sheet, Style, rectangle,
};
use crate::figure::{
    axes::TEXT,
    drawn::shapes,
    layout::{DOUBLE, POINTS_PER_MM, SINGLE, count, text},
    paint::{Align, PNG_SCALE, text_width},
    style::FAINT,
};
use contract::drawing::Image;

/// Room between two images, and between two panels.
const GAP: f64 = 1.0;
const PANEL_GAP: f64 = 14.0;
/// Height of a title with its room.
const TITLE: f64 = 12.0;
const MARGIN: f64 = 4.0;
/// Largest side of an image in points, if the study states no size.
const LARGEST: f64 = 24.0 * POINTS_PER_MM;
/// Width of the line around an image, which shows the edge of a light one.
const RIM: f64 = 0.3;

/// Columns of the data file.
const HEADER: [&str; 9] = [
    "panel",
    "trial",
    "image",
    "row",
    "column",
    "side",
    "mean_red",
    "mean_green",
    "mean_blue",
];

/// Images in rows, in one panel.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tiles {
    /// Id of the trial that left the images; its folder holds the file with all of them.
    pub trial: String,
    /// The images in the figure, all of one size.
    pub images: Vec<Image>,
    /// Images in a row, at least one.
    pub columns: usize,
    /// Side of an image on paper in millimetres; with `None`, as large as the room allows.
    pub size_mm: Option<f64>,
}

impl<'a> Form<'a> for &'a Tiles {
    fn has_axes(&self) -> bool {
        false
    }

    fn ground(&self) -> Ground {
        Ground::Colored
    }

    fn paint(&self, chart: &Chart, asked: Option<f64>) -> Option<Drawing> {
        draw(chart, asked)
    }

    fn sample(&self, _: Style, _: Position) -> Vec<Mark> {
        Vec::new()
    }

    fn in_words(&self, _: &Panel, _: NumberFormat) -> Option<String> {
        Some(format!("{} images", self.images.len()))
    }

    fn sheet(&self) -> Option<Sheet> {
        let columns = self.columns.max(1);
        let line = |(index, image): (usize, &Image)| {
            let place = [index, index / columns, index % columns].map(|number| number.to_string());
            let colors = image.mean_color().map(|mean| format!("{mean:.3}"));
            std::iter::once(self.trial.clone())
                .chain(place)
                .chain([image.width.to_string()])
                .chain(colors)
                .collect()
        };
        Some((&HEADER, self.images.iter().enumerate().map(line).collect()))
    }
}

/// A chart of images at the requested width; `None` for another chart.
fn draw(chart: &Chart, asked: Option<f64>) -> Option<Drawing> {
    let grids: Vec<(&Panel, &Tiles)> = shapes(chart)
        .filter_map(|(_, panel, shape)| match shape {
            Shape::Images(tiles) => Some((panel, tiles)),
            _ => None,
        })
        .collect();
    if grids.is_empty() {
        return None;
    }
    let columns = chart.columns.clamp(1, grids.len());
    // The drawing is scaled as a whole for another size of text, but the size of an image stays.
    let per_mm = POINTS_PER_MM * TEXT / chart.paper.font_pt.unwrap_or(TEXT);
    let usual = if columns == 1 && natural(&grids, SINGLE, per_mm) <= SINGLE {
        SINGLE
    } else {
        DOUBLE
    };
    let width = asked.unwrap_or(usual);
    let slot = (width - 2.0 * MARGIN - PANEL_GAP * count(columns - 1)) / count(columns);
    let titled = grids.iter().any(|(panel, _)| !panel.title.is_empty());
    // Panels narrower than their slots stand together in the middle.
    let own = |(panel, tiles): &(&Panel, &Tiles)| {
        span(side(tiles, slot, per_mm), tiles.columns).max(text_width(&panel.title, TEXT))
    };
    let slot = grids.iter().map(own).fold(0.0, f64::max).min(slot);
    let used = slot * count(columns) + PANEL_GAP * count(columns - 1);
    let (mut marks, mut top) = (Vec::new(), MARGIN);
    for row in grids.chunks(columns) {
        top += if titled { TITLE } else { 0.0 };
        let mut lowest = top;
        for (column, (panel, tiles)) in row.iter().enumerate() {
            let left = (width - used) / 2.0 + (slot + PANEL_GAP) * count(column);
            // A size from the study never makes the grid wider than its slot.
            let side = side(tiles, slot, per_mm).min(fit(tiles, slot));
            lowest = lowest.max(grid(panel, tiles, (left, top), (slot, side), &mut marks));
        }
        top = lowest + PANEL_GAP / 2.0;
    }
    Some(Drawing {
        width,
        height: top - PANEL_GAP / 2.0 + MARGIN,
        marks,
    })
}

/// Natural width of one column of panels.
fn natural(grids: &[(&Panel, &Tiles)], width: f64, per_mm: f64) -> f64 {
    let wanted =
        |tiles: &Tiles| span(side(tiles, width - 2.0 * MARGIN, per_mm), tiles.columns) + 2.0 * MARGIN;
    grids.iter().map(|(_, tiles)| wanted(tiles)).fold(0.0, f64::max)
}

/// Draws a panel in the middle of its slot, with images of one side; returns its lower edge.
fn grid(
    panel: &Panel,
    tiles: &Tiles,
    (left, top): (f64, f64),
    (slot, side): (f64, f64),
    marks: &mut Vec<Mark>,
) -> f64 {
    let start = on_pixel(left + ((slot - span(side, tiles.columns)) / 2.0).max(0.0));
    let top = on_pixel(top);
    if !panel.title.is_empty() {
        marks.push(text(
            (left + slot / 2.0, top - TITLE / 2.0),
            &panel.title,
            Align::Center,
        ));
    }
    for (index, image) in tiles.images.iter().enumerate() {
        let (row, column) = (index / tiles.columns, index % tiles.columns);
        let corner = (
            start + (side + GAP) * count(column),
            top + (side + GAP) * count(row),
        );
        let end = (corner.0 + side + RIM, corner.1 + side + RIM);
        marks.push(Mark::area(
            rectangle((corner.0 - RIM, corner.1 - RIM), end),
            FAINT,
        ));
        marks.push(Mark::Image {
            corner,
            side,
            image: image.clone(),
        });
    }
    top + span(side, tiles.images.len().div_ceil(tiles.columns))
}

/// Width or height of some images with the gaps between them.
fn span(side: f64, images: usize) -> f64 {
    side * count(images) + GAP * count(images.saturating_sub(1))
}

/// Side of an image: as the study states, in points `per_mm`; otherwise as large as the room allows.
fn side(tiles: &Tiles, room: f64, per_mm: f64) -> f64 {
    match tiles.size_mm {
        Some(size_mm) => size_mm * per_mm,
        None => whole_pixels(tiles, fit(tiles, room).min(LARGEST)),
    }
}

fn fit(tiles: &Tiles, room: f64) -> f64 {
    (room - GAP * count(tiles.columns.saturating_sub(1))) / count(tiles.columns.max(1))
}

/// The largest side up to `most` at which each pixel of the image is a whole number of pixels of the PNG file, so
/// that all are equally large.
fn whole_pixels(tiles: &Tiles, most: f64) -> f64 {
    let pixels = f64::from(tiles.images.first().map_or(1, |image| image.width.max(1)));
    let times = (most * PNG_SCALE / pixels).floor();
    if times >= 1.0 {
        times * pixels / PNG_SCALE
    } else {
        most
    }
}

/// The nearest place where a pixel of the PNG file begins.
fn on_pixel(place: f64) -> f64 {
    (place * PNG_SCALE).round() / PNG_SCALE
}
