//! Colours of a drawing on a dark page. The drawing itself does not change: the page's style sheet names the colours in
//! the SVG and a replacement for each.

use super::{
    axes::{AXIS_WIDTH, TEXT},
    chart::{Chart, Hue, Style},
    paint::SVG_SCALE,
    style::{FAINT, INK, Rgb, blend},
};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The paper colour of a dark page, as in its style sheet.
pub(super) const DARK_PAPER: Rgb = (0x16, 0x18, 0x1b);
const WHITE: Rgb = (0xff, 0xff, 0xff);
/// Replacement for black agents on dark paper, as light as text is there.
const PALE: Rgb = (0xe6, 0xe7, 0xe9);
/// Least contrast of a line with its paper, as the ratio that WCAG 2.1 defines.
const CONTRAST: f64 = 4.5;

/// Ground under the marks of a chart, which decides the changes on a dark page. The ground of a chart is the last, in
/// this order, of its series.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ground {
    /// Paper: every colour has a replacement.
    Paper,
    /// Coloured areas or images, whose colours are data: only paper, text and axes change.
    Colored,
    /// Light boxes with dark text in them: the drawing stays on white paper.
    Boxes,
}

impl Ground {
    /// Ground under the marks of a chart.
    #[must_use]
    pub fn of(chart: &Chart) -> Self {
        let series = chart.panels.iter().flat_map(|panel| &panel.series);
        let grounds = series.map(|series| series.shape.form().ground());
        grounds.max().unwrap_or(Self::Paper)
    }

    /// Class of the `figure` element that the rules apply to.
    #[must_use]
    pub fn class(self) -> &'static str {
        match self {
            Self::Paper => "on-paper",
            Self::Colored => "on-colors",
            Self::Boxes => "on-boxes",
        }
    }
}

/// Colours of a chart, for the rules of the page's style sheet on dark paper.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shades {
    /// Ground under its marks.
    pub ground: Ground,
    /// Width of its axes in the SVG, in the units of that file.
    axis_width: String,
    /// Colours of its marks, with the replacement for each on dark paper.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    colors: BTreeMap<String, String>,
}

impl Shades {
    /// Shades of a chart.
    #[must_use]
    pub fn of(chart: &Chart) -> Self {
        let ground = Ground::of(chart);
        let mut colors = BTreeMap::new();
        let series = chart.panels.iter().flat_map(|panel| &panel.series);
        for style in series.map(|series| series.style) {
            colors.insert(capitals(style.color()), hex(style.on_dark()));
            colors.insert(capitals(style.light()), hex(style.dim()));
            let bar = blend(style.on_dark(), DARK_PAPER, style.paleness());
            colors.insert(capitals(style.fill()), hex(bar));
        }
        Self {
            ground,
            axis_width: axis_width(chart),
            // Colours that are data stay.
            colors: if ground == Ground::Paper {
                colors
            } else {
                BTreeMap::new()
            },
        }
    }
}

/// Rules of a style sheet for dark pages with charts of these shades inside `figure` elements; empty if no colour
/// changes.
#[must_use]
pub fn on_dark(charts: &[Shades]) -> String {
    let on = |ground| charts.iter().filter(move |chart| chart.ground == ground);
    let mut rules = String::new();
    if on(Ground::Paper).next().is_some() {
        rules += &on_paper(on(Ground::Paper));
    }
    let widths: BTreeSet<&String> = on(Ground::Colored).map(|chart| &chart.axis_width).collect();
    if !widths.is_empty() {
        rules += "figure.on-colors svg > polygon:first-of-type { fill: var(--paper); }\n\
                  figure.on-colors svg text { fill: currentColor; }\n";
    }
    for width in widths {
        rules += &format!(
            "figure.on-colors svg [stroke=\"{}\"][stroke-width=\"{width}\"] {{ stroke: currentColor; }}\n",
            capitals(INK)
        );
    }
    rules
}

/// Width of axes in the SVG of a chart, which differs from that of marks of the same colour.
fn axis_width(chart: &Chart) -> String {
    let scale = chart.paper.font_pt.map_or(1.0, |size| size / TEXT);
    format!("{:.0}", (AXIS_WIDTH * scale * SVG_SCALE).round())
}

fn on_paper<'a>(charts: impl Iterator<Item = &'a Shades>) -> String {
    let mut instead = BTreeMap::from([
        (capitals(WHITE), "var(--paper)".to_owned()),
        (capitals(INK), "currentColor".to_owned()),
        (capitals(FAINT), "var(--line)".to_owned()),
    ]);
    instead.extend(charts.flat_map(|chart| chart.colors.clone()));
    let rule = |(color, instead): (&String, &String)| {
        let of = |what| format!("figure.on-paper svg [{what}=\"{color}\"] {{ {what}: {instead}; }}\n");
        of("fill") + &of("stroke")
    };
    instead.iter().map(rule).collect()
}

/// A colour as the painter of SVG files writes it.
fn capitals(color: Rgb) -> String {
    hex(color).to_uppercase()
}

/// A colour as style sheets write it.
pub(super) fn hex((r, g, b): Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

impl Style {
    /// The colour on a dark page: the same hue, light enough to be seen.
    #[must_use]
    pub fn on_dark(self) -> Rgb {
        match self.hue {
            Hue::Behind | Hue::Other => (0x5c, 0x5f, 0x64),
            _ if self.color() == (0, 0, 0) => PALE,
            _ => lightened(self.color()),
        }
    }

    /// The colour of thin lines on a dark page.
    #[must_use]
    pub fn dim(self) -> Rgb {
        blend(self.on_dark(), DARK_PAPER, 0.55)
    }
}

/// The colour mixed with as much white as it needs.
fn lightened(color: Rgb) -> Rgb {
    (0..=20)
        .map(|step| blend(color, WHITE, f64::from(step) / 20.0))
        .find(|color| contrast(*color, DARK_PAPER) >= CONTRAST)
        .unwrap_or(WHITE)
}

/// Contrast ratio of WCAG 2.1.
fn contrast(one: Rgb, other: Rgb) -> f64 {
    let (one, other) = (luminance(one), luminance(other));
    (one.max(other) + 0.05) / (one.min(other) + 0.05)
}

/// Relative luminance of sRGB, as WCAG 2.1 defines it.
fn luminance((r, g, b): Rgb) -> f64 {
    let linear = |channel: u8| {
        let part = f64::from(channel) / 255.0;
        if part <= 0.04045 {
            part / 12.92
        } else {
            ((part + 0.055) / 1.055).powf(2.4)
        }
    };
    0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Panel, Series, Shape};

    fn styles() -> impl Iterator<Item = Style> {
        let agents = (0..8).map(Style::of_agent);
        let steps = (0..5).map(|step| Style {
            hue: Hue::Ramp(step, 5),
            variant: 0,
        });
        agents.chain(steps).chain([Style {
            hue: Hue::Grey,
            variant: 0,
        }])
    }

    #[test]
    fn lines_are_seen_on_dark_paper_and_agents_stay_apart() {
        assert!((contrast(WHITE, (0, 0, 0)) - 21.0).abs() < 1e-9);
        for style in styles() {
            assert!(contrast(style.on_dark(), DARK_PAPER) >= CONTRAST, "{style:?}");
            assert!(
                contrast(style.dim(), DARK_PAPER) < contrast(style.on_dark(), DARK_PAPER),
                "{style:?}"
            );
        }
        let colors: std::collections::BTreeSet<Rgb> =
            (0..8).map(|index| Style::of_agent(index).on_dark()).collect();
        assert_eq!(colors.len(), 8);
    }

    #[test]
    fn every_colour_on_paper_has_a_rule_and_colours_that_are_data_have_none() {
        let series = |shape| Series {
            label: "a".into(),
            seeds: None,
            style: Style::of_agent(0),
            shape,
        };
        let chart = |shape| Chart {
            panels: vec![Panel {
                series: vec![series(shape)],
                ..Panel::default()
            }],
            columns: 1,
            ..Chart::default()
        };
        let flat = chart(Shape::Level(1.0));
        let rules = on_dark(&[Shades::of(&flat)]);
        let svg = crate::figure::svg(&flat).unwrap();
        let colors = svg
            .split(['"', ' '])
            .filter(|word| word.starts_with('#'))
            .collect::<std::collections::BTreeSet<_>>();
        assert!(colors.len() >= 4, "{colors:?}");
        for color in colors {
            assert!(rules.contains(&format!("=\"{color}\"]")), "{color}: {rules}");
        }
        let mut surface = chart(Shape::Surface(crate::figure::Surface::default()));
        let rules = on_dark(&[Shades::of(&surface)]);
        assert!(rules.contains("svg text {") && rules.contains("[stroke=\"#222222\"][stroke-width=\"6\"]"));
        assert!(!rules.contains("on-paper"), "{rules}");
        surface.paper.font_pt = Some(15.0);
        assert!(on_dark(&[Shades::of(&surface)]).contains("[stroke-width=\"12\"]"));
        let boxes = chart(Shape::Graph(contract::drawing::Graph::default()));
        assert!(on_dark(&[Shades::of(&boxes)]).is_empty());
    }
}
