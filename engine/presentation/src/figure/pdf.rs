//! Figures as PDF files, converted from the SVG file: the same drawing, with its font embedded and without pixels
//! unless the SVG file has some.

use super::{letters::drawable, paint::FONT};
use contract::Error;
use std::sync::Arc;
use svg2pdf::{
    ConversionOptions, PageOptions, to_pdf,
    usvg::{Options, Tree, fontdb},
};

/// Points per inch of the page, so that SVG lengths in points do not change.
const POINTS_PER_INCH: f32 = 72.0;

/// Converts an SVG file of a figure into a PDF file of one page with the size of the figure. The same file gives the
/// same bytes. Letters that the font lacks are read as U+FFFD: all have one glyph, which the file can name only once.
///
/// # Errors
/// [`Error::Render`] if the drawing is refused.
pub fn pdf(svg: &str) -> Result<Vec<u8>, Error> {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(FONT.to_vec());
    let options = Options {
        dpi: POINTS_PER_INCH,
        fontdb: Arc::new(fonts),
        ..Options::default()
    };
    let tree = Tree::from_str(&drawable(svg), &options).map_err(|error| refused(&error.to_string()))?;
    let page = PageOptions { dpi: POINTS_PER_INCH };
    let bytes =
        to_pdf(&tree, ConversionOptions::default(), page).map_err(|error| refused(&error.to_string()))?;
    Ok(in_order(bytes))
}

/// Sorts the entries in dictionaries of resources, which come in the order of a hash map. No object moves or changes
/// its length, so the cross-reference table stays valid.
fn in_order(mut pdf: Vec<u8>) -> Vec<u8> {
    let lines: Vec<std::ops::Range<usize>> = lines(&pdf);
    let groups =
        lines.chunk_by(|one, next| is_resource(&pdf[one.clone()]) && is_resource(&pdf[next.clone()]));
    let sorted: Vec<(usize, Vec<u8>)> = groups
        .filter(|group| group.len() > 1)
        .map(|group| {
            let mut entries: Vec<&[u8]> = group.iter().map(|line| &pdf[line.clone()]).collect();
            entries.sort_unstable();
            (group[0].start, entries.concat())
        })
        .collect();
    for (start, entries) in sorted {
        pdf[start..start + entries.len()].copy_from_slice(&entries);
    }
    pdf
}

/// The range of each line with its end; a stream is part of the line that it begins in.
fn lines(pdf: &[u8]) -> Vec<std::ops::Range<usize>> {
    const STREAM: &[u8] = b"stream\n";
    const END: &[u8] = b"\nendstream";
    let (mut lines, mut start, mut at) = (Vec::new(), 0, 0);
    while at < pdf.len() {
        if at == start && pdf[at..].starts_with(STREAM) {
            let length = pdf[at..].windows(END.len()).position(|window| window == END);
            at += length.map_or(0, |length| length + END.len());
        }
        if pdf.get(at) == Some(&b'\n') {
            lines.push(start..at + 1);
            start = at + 1;
        }
        at += 1;
    }
    lines
}

/// Whether a line gives a resource its name, as `/gs0 7 0 R`.
fn is_resource(line: &[u8]) -> bool {
    let text = line.trim_ascii();
    text.starts_with(b"/") && text.ends_with(b" 0 R") && text[1..].iter().take(2).all(u8::is_ascii_lowercase)
}

fn refused(problem: &str) -> Error {
    Error::Render {
        what: "PDF file of a figure".into(),
        problem: problem.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{
        Chart, Paper, Shape,
        layout::{self, POINTS_PER_MM},
        paint::Mark,
        suite, svg,
    };

    fn page_of(chart: &Chart) -> String {
        String::from_utf8_lossy(&pdf(&svg(chart).unwrap()).unwrap()).into_owned()
    }

    /// Width and height of the only page, in points.
    fn size(pdf: &str) -> [f64; 2] {
        let boxes: Vec<&str> = pdf.split("/MediaBox [").skip(1).collect();
        assert_eq!(boxes.len(), 1);
        let numbers: Vec<f64> = boxes[0]
            .split(']')
            .next()
            .unwrap()
            .split_whitespace()
            .map(|number| number.parse().unwrap())
            .collect();
        [numbers[2] - numbers[0], numbers[3] - numbers[1]]
    }

    fn pictures() -> Vec<(&'static str, Chart)> {
        let mut all = suite::tests::pictures();
        all.extend(crate::figure::drawn_tests::pictures());
        all
    }

    #[test]
    fn pages_have_the_size_of_the_drawing_and_an_embedded_font() {
        for (name, chart) in pictures() {
            let (page, drawing) = (page_of(&chart), layout::draw(&chart));
            let [width, height] = size(&page);
            assert!((width - drawing.width).abs() < 0.15, "{name}: {width}");
            assert!((height - drawing.height).abs() < 0.15, "{name}: {height}");
            assert!(
                page.contains("/FontFile2") || page.contains("/FontFile3"),
                "{name}"
            );
            let (images, in_svg) = (page.matches("/Subtype /Image").count(), svg(&chart).unwrap());
            assert_eq!(images > 0, in_svg.contains("<image"), "{name}");
            assert!(
                (0..4).all(|_| page == page_of(&chart)),
                "{name} differs from itself"
            );
        }
    }

    #[test]
    fn letters_that_the_font_lacks_are_read_as_replaced() {
        let page = |label: &str| {
            let (_, mut chart) = pictures().remove(0);
            chart.panels[0].x.label = label.into();
            page_of(&chart)
        };
        assert_eq!(page("環境"), page("\u{fffd}\u{fffd}"));
        assert_ne!(page("环境"), page("шаг"));
    }

    #[test]
    fn a_page_is_as_wide_as_the_study_asks_and_text_keeps_its_size() {
        for (name, chart) in pictures() {
            for (width_mm, font_pt) in [(60.0, 6.0), (83.15, 9.0), (174.0, 7.5)] {
                let paper = Paper {
                    width_mm: Some(width_mm),
                    font_pt: Some(font_pt),
                };
                let chart = Chart {
                    paper,
                    ..chart.clone()
                };
                let [width, _] = size(&page_of(&chart));
                assert!((width - width_mm * POINTS_PER_MM).abs() < 0.02, "{name}: {width}");
                // A graph has text of several sizes, and is scaled down as a whole if the room is too small.
                let is_graph = matches!(chart.panels[0].series[0].shape, Shape::Graph(_));
                let marks = layout::draw(&chart).marks;
                let sizes = marks.iter().filter_map(|mark| match mark {
                    Mark::Text { size, .. } => Some(*size),
                    _ => None,
                });
                for size in sizes.filter(|_| !is_graph) {
                    assert!((size - font_pt).abs() < 1e-9, "{name}: {size}");
                }
            }
        }
    }
}
