//! Paints marks with plotters, as SVG or PNG, with the bundled font. Uses no window, no font of the system and no
//! clock.

use super::{letters::drawable, style::Rgb};
use base64::{Engine as _, prelude::BASE64_STANDARD};
use contract::{Error, drawing::Image};
use document::plain_text::printable;
use plotters::{
    backend::{BitMapBackend, DrawingBackend, SVGBackend},
    style::{
        Color, FontDesc, FontFamily, FontStyle, FontTransform, RGBAColor, ShapeStyle, TextStyle,
        register_font,
        text_anchor::{HPos, Pos, VPos},
    },
};
use std::{borrow::Cow, path::Path, sync::Once};

/// The family that SVG files name; the bundled font is registered under the whole list.
const FAMILY: &str = "DejaVu Sans, sans-serif";
pub(super) static FONT: &[u8] = include_bytes!("../../assets/DejaVuSans.ttf");

/// SVG units per point: coordinates are whole numbers.
pub(super) const SVG_SCALE: f64 = 10.0;
/// PNG pixels per point, 288 per inch.
pub(super) const PNG_SCALE: f64 = 4.0;
/// Each pixel of a PNG is the mean of a square of this side.
const OVERSAMPLING: usize = 2;
/// Ratio of the font size that plotters-svg writes to the size of the style.
const SVG_SIZE_PER_EM: f64 = 1.24;
/// Height from ascent to descent in em of DejaVu Sans, which the rasteriser takes as the size.
const PNG_SIZE_PER_EM: f64 = 2384.0 / 2048.0;
/// Offset by which the rasteriser centres a text higher than SVG does, in em.
const PNG_RAISE: f64 = 0.16;

/// A drawing: its size in points and its marks, the first at the bottom.
#[derive(Clone, Default)]
pub(super) struct Drawing {
    pub width: f64,
    pub height: f64,
    pub marks: Vec<Mark>,
}

impl Drawing {
    /// The drawing at another scale.
    pub(super) fn scaled(self, scale: f64) -> Self {
        if scale == 1.0 {
            return self;
        }
        Self {
            width: self.width * scale,
            height: self.height * scale,
            marks: self
                .marks
                .iter()
                .map(|mark| mark.moved(scale, (0.0, 0.0)))
                .collect(),
        }
    }
}

/// A position in points, from the upper left corner.
pub(super) type Position = (f64, f64);

/// A shape, a text or an image to paint.
#[derive(Clone)]
pub(super) enum Mark {
    Line {
        points: Vec<Position>,
        width: f64,
        color: Rgb,
    },
    Fill {
        points: Vec<Position>,
        color: Rgb,
        opacity: f64,
    },
    Text {
        at: Position,
        text: String,
        size: f64,
        align: Align,
        upright: bool,
        color: Rgb,
    },
    /// A square image whose pixels stay squares. Images are painted over all other marks.
    Image {
        corner: Position,
        side: f64,
        image: Image,
    },
}

/// Side of a text at its place; an upright text is turned with its sides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Align {
    Left,
    Center,
    Right,
}

impl Align {
    fn anchor(self) -> HPos {
        match self {
            Self::Left => HPos::Left,
            Self::Center => HPos::Center,
            Self::Right => HPos::Right,
        }
    }
}

/// Bounding box of marks, in points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extent {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

impl Extent {
    /// The smallest box that holds both.
    pub(super) fn with(self, other: Self) -> Self {
        Self {
            left: self.left.min(other.left),
            top: self.top.min(other.top),
            right: self.right.max(other.right),
            bottom: self.bottom.max(other.bottom),
        }
    }
}

impl Mark {
    /// An area that hides the marks below it.
    pub(super) fn area(points: Vec<Position>, color: Rgb) -> Self {
        Self::Fill {
            points,
            color,
            opacity: 1.0,
        }
    }

    /// The mark, scaled and then moved.
    pub(super) fn moved(&self, scale: f64, by: Position) -> Self {
        let place = |(x, y): &Position| (x * scale + by.0, y * scale + by.1);
        let all = |points: &[Position]| points.iter().map(place).collect();
        match self.clone() {
            Self::Line { points, width, color } => Self::Line {
                points: all(&points),
                width: width * scale,
                color,
            },
            Self::Fill {
                points,
                color,
                opacity,
            } => Self::Fill {
                points: all(&points),
                color,
                opacity,
            },
            Self::Text {
                at,
                text,
                size,
                align,
                upright,
                color,
            } => Self::Text {
                at: place(&at),
                text,
                size: size * scale,
                align,
                upright,
                color,
            },
            Self::Image { corner, side, image } => Self::Image {
                corner: place(&corner),
                side: side * scale,
                image,
            },
        }
    }

    /// Bounding box of the points of a line or an area; `None` for other marks.
    pub(super) fn extent(&self) -> Option<Extent> {
        let (Self::Line { points, .. } | Self::Fill { points, .. }) = self else {
            return None;
        };
        let of = |&(x, y): &Position| Extent {
            left: x,
            top: y,
            right: x,
            bottom: y,
        };
        points.iter().map(of).reduce(Extent::with)
    }
}

/// Width of a text in points.
pub(super) fn text_width(text: &str, size: f64) -> f64 {
    load_font();
    let font = FontDesc::new(
        FontFamily::Name(FAMILY),
        1000.0 * PNG_SIZE_PER_EM,
        FontStyle::Normal,
    );
    font.box_size(&drawable(text))
        .map_or(0.0, |(width, _)| f64::from(width) / 1000.0 * size)
}

/// The drawing as an SVG file with the same size on paper, in millimetres with `decimals`.
pub(super) fn svg(drawing: &Drawing, decimals: usize) -> Result<String, Error> {
    let (width, height) = (
        whole(drawing.width * SVG_SCALE),
        whole(drawing.height * SVG_SCALE),
    );
    let mut text = String::new();
    let mut backend = SVGBackend::with_string(&mut text, (width.unsigned_abs(), height.unsigned_abs()));
    let pen = Pen {
        scale: SVG_SCALE,
        size_per_em: SVG_SIZE_PER_EM,
        raise: 0.0,
        rasters: false,
    };
    pen.paint(&mut backend, drawing)?;
    backend.present().map_err(refused)?;
    drop(backend);
    let millimetres = |points: f64| points * 25.4 / 72.0;
    let size = format!("width=\"{width}\" height=\"{height}\"");
    let on_paper = format!(
        "width=\"{:.decimals$}mm\" height=\"{:.decimals$}mm\"",
        millimetres(drawing.width),
        millimetres(drawing.height)
    );
    let text = text.replacen(&size, &format!("{on_paper} stroke-linejoin=\"round\""), 1);
    let images = drawing
        .marks
        .iter()
        .map(embedded)
        .collect::<Result<String, Error>>()?;
    match text.rfind("</svg>") {
        Some(end) if !images.is_empty() => Ok(format!("{}{images}{}", &text[..end], &text[end..])),
        _ => Ok(text),
    }
}

/// An image inside an SVG file; nothing for other marks.
fn embedded(mark: &Mark) -> Result<String, Error> {
    let Mark::Image { corner, side, image } = mark else {
        return Ok(String::new());
    };
    let png = BASE64_STANDARD.encode(image.png()?);
    let [x, y, side] = [corner.0, corner.1, *side].map(|length| whole(length * SVG_SCALE));
    Ok(format!(
        "<image x=\"{x}\" y=\"{y}\" width=\"{side}\" height=\"{side}\" preserveAspectRatio=\"none\" \
         style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{png}\"/>\n"
    ))
}

/// Writes the drawing as a PNG file; the path must end in `.png`.
pub(super) fn png(drawing: &Drawing, path: &Path) -> Result<(), Error> {
    #[allow(clippy::cast_precision_loss, reason = "2")]
    let scale = PNG_SCALE * OVERSAMPLING as f64;
    let (width, height) = (
        whole(drawing.width * PNG_SCALE).unsigned_abs(),
        whole(drawing.height * PNG_SCALE).unsigned_abs(),
    );
    let (w, h) = (width as usize * OVERSAMPLING, height as usize * OVERSAMPLING);
    let mut fine = vec![255; 3 * w * h];
    let size = (width * 2, height * 2);
    let pen = Pen {
        scale,
        size_per_em: PNG_SIZE_PER_EM,
        raise: PNG_RAISE,
        rasters: true,
    };
    pen.paint(&mut BitMapBackend::with_buffer(&mut fine, size), drawing)?;
    let mut pixels = shrink(&fine, w, h);
    for mark in &drawing.marks {
        paste(mark, &mut pixels, (width as usize, height as usize));
    }
    let image = Image {
        width,
        height,
        pixels,
    };
    std::fs::write(path, image.png()?).map_err(Error::file("write", path))
}

/// The mean of each square of pixels.
fn shrink(fine: &[u8], width: usize, height: usize) -> Vec<u8> {
    let channel = |x: usize, y: usize, c: usize| u32::from(fine[3 * (y * width + x) + c]);
    let mean = |x: usize, y: usize, c: usize| {
        let (x, y) = (x * 2, y * 2);
        let sum = channel(x, y, c) + channel(x + 1, y, c) + channel(x, y + 1, c) + channel(x + 1, y + 1, c);
        u8::try_from((sum + 2) / 4).unwrap_or(u8::MAX)
    };
    let pixels = (0..height / 2).flat_map(|y| (0..width / 2).map(move |x| (x, y)));
    pixels
        .flat_map(|(x, y)| [mean(x, y, 0), mean(x, y, 1), mean(x, y, 2)])
        .collect()
}

/// Copies an image into the pixels of a PNG file, `[height, width, 3]`, so that each of its pixels becomes a rectangle
/// of one colour. Does nothing for other marks.
fn paste(mark: &Mark, pixels: &mut [u8], (width, height): (usize, usize)) {
    let Mark::Image { corner, side, image } = mark else {
        return;
    };
    let [left, top, side] =
        [corner.0, corner.1, *side].map(|length| whole(length * PNG_SCALE).unsigned_abs() as usize);
    let source = |at: usize, count: u32| at * count as usize / side;
    for y in top..(top + side).min(height) {
        for x in left..(left + side).min(width) {
            let from =
                3 * (source(y - top, image.height) * image.width as usize + source(x - left, image.width));
            let to = 3 * (y * width + x);
            pixels[to..to + 3].copy_from_slice(&image.pixels[from..from + 3]);
        }
    }
}

/// Differences between the two formats.
struct Pen {
    scale: f64,
    size_per_em: f64,
    raise: f64,
    /// Whether this is the rasteriser. It spoils long thick lines at sharp corners, so there each segment is drawn as
    /// its own line. It has only the bundled font.
    rasters: bool,
}

impl Pen {
    fn paint<B: DrawingBackend>(&self, backend: &mut B, drawing: &Drawing) -> Result<(), Error> {
        load_font();
        let paper = [
            (0.0, 0.0),
            (drawing.width, 0.0),
            (drawing.width, drawing.height),
            (0.0, drawing.height),
        ];
        backend
            .fill_polygon(paper.map(|place| self.place(place)), &fill((255, 255, 255), 1.0))
            .map_err(refused)?;
        drawing.marks.iter().try_for_each(|mark| self.mark(backend, mark))
    }

    fn mark<B: DrawingBackend>(&self, backend: &mut B, mark: &Mark) -> Result<(), Error> {
        match mark {
            Mark::Line { points, width, color } => {
                let stroke_width = whole(width * self.scale).unsigned_abs().max(1);
                self.line(
                    backend,
                    points,
                    ShapeStyle {
                        stroke_width,
                        ..fill(*color, 1.0)
                    },
                )
            }
            Mark::Fill {
                points,
                color,
                opacity,
            } => {
                let points: Vec<_> = points.iter().map(|point| self.place(*point)).collect();
                backend
                    .fill_polygon(points, &fill(*color, *opacity))
                    .map_err(refused)
            }
            Mark::Text {
                at,
                text,
                size,
                align,
                upright,
                color,
            } => self.text(backend, *at, text, *size, (*align, *upright, *color)),
            // Neither of the two backends keeps pixels sharp: see `embedded` and `paste`.
            Mark::Image { .. } => Ok(()),
        }
    }

    fn line<B: DrawingBackend>(
        &self,
        backend: &mut B,
        points: &[Position],
        style: ShapeStyle,
    ) -> Result<(), Error> {
        let points: Vec<_> = points.iter().map(|point| self.place(*point)).collect();
        if !self.rasters {
            return backend.draw_path(points, &style).map_err(refused);
        }
        points
            .windows(2)
            .try_for_each(|ends| backend.draw_line(ends[0], ends[1], &style).map_err(refused))
    }

    fn text<B: DrawingBackend>(
        &self,
        backend: &mut B,
        at: Position,
        text: &str,
        size: f64,
        (align, upright, color): (Align, bool, Rgb),
    ) -> Result<(), Error> {
        let raise = self.raise * size;
        let at = if upright {
            (at.0 + raise, at.1)
        } else {
            (at.0, at.1 + raise)
        };
        let font = FontDesc::new(
            FontFamily::Name(FAMILY),
            size * self.scale * self.size_per_em,
            FontStyle::Normal,
        );
        let font = if upright {
            font.transform(FontTransform::Rotate270)
        } else {
            font
        };
        let style = TextStyle {
            font,
            color: fill(color, 1.0).color.to_backend_color(),
            pos: Pos::new(align.anchor(), VPos::Center),
        };
        let text = printable(text);
        let text = if self.rasters {
            drawable(&text)
        } else {
            Cow::Borrowed(&*text)
        };
        backend.draw_text(&text, &style, self.place(at)).map_err(refused)
    }

    fn place(&self, (x, y): Position) -> (i32, i32) {
        (whole(x * self.scale), whole(y * self.scale))
    }
}

fn fill((r, g, b): Rgb, opacity: f64) -> ShapeStyle {
    ShapeStyle {
        color: RGBAColor(r, g, b, opacity),
        filled: true,
        stroke_width: 1,
    }
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "a drawing is a few thousand units wide"
)]
fn whole(number: f64) -> i32 {
    number.round() as i32
}

fn load_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // The bytes are compiled in and parsed by the tests. Without a font the backends report an error themselves.
        let _ = register_font(FAMILY, FontStyle::Normal, FONT);
    });
}

/// Error for the file of an image that was not written. The backend's error has the reason only in its debug text, with
/// the system's message in quotes.
fn refused(error: impl std::fmt::Display) -> Error {
    Error::Render {
        what: "figure".into(),
        problem: error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bundled_font_is_loaded_and_measured() {
        // Advance widths of DejaVu Sans: 1995 of 2048 units for "m", 569 for "i".
        assert!((text_width("m", 2048.0) - 1995.0).abs() < 4.0);
        assert!((text_width("i", 2048.0) - 569.0).abs() < 4.0);
        assert!(text_width("10⁻⁵ × α ± −", 10.0) > text_width("10", 10.0));
    }

    #[test]
    fn pixels_are_means_of_four() {
        let fine = [0, 0, 0, 4, 4, 4, 8, 8, 8, 8, 8, 8].map(|value| value + 1);
        assert_eq!(shrink(&fine, 2, 2), [6, 6, 6]);
    }
}
