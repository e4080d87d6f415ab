//! What becomes of the colours of a drawing on a dark page. The drawing itself stays as it is: the page's style
//! sheet names the colours that it finds in the SVG and what stands for each.

use super::{
    chart::{Chart, Hue, Series, Shape, Style},
    style::{FAINT, INK, Rgb, blend},
};
use std::{collections::BTreeMap, fmt::Write as _};

/// The paper of a dark page, as its style sheet has it.
pub(super) const DARK_PAPER: Rgb = (0x16, 0x18, 0x1b);
const WHITE: Rgb = (0xff, 0xff, 0xff);
/// Black agents are as light on dark paper as text is.
const PALE: Rgb = (0xe6, 0xe7, 0xe9);
/// How much a line stands out from its paper at the least, as the ratio that WCAG 2.1 defines.
const CONTRAST: f64 = 4.5;

/// Rules of a style sheet for dark pages with these charts inside `figure` elements; empty where there is none.
/// Charts whose ground is coloured are not in them.
#[must_use]
pub fn on_dark(charts: &[&Chart]) -> String {
    let flat = || charts.iter().filter(|chart| !has_coloured_ground(chart));
    if flat().next().is_none() {
        return String::new();
    }
    let mut rules = BTreeMap::from([
        (WHITE, "var(--paper)".to_owned()),
        (INK, "currentColor".to_owned()),
        (FAINT, "var(--line)".to_owned()),
    ]);
    let series = flat()
        .flat_map(|chart| &chart.panels)
        .flat_map(|panel| &panel.series);
    for style in series.map(|series| series.style) {
        rules.insert(style.color(), hex(style.on_dark()));
        rules.insert(style.light(), hex(style.dim()));
    }
    rules.iter().fold(String::new(), |mut text, (color, instead)| {
        // Writing into a text cannot fail.
        let _ = rule(&mut text, *color, instead);
        text
    })
}

fn rule(text: &mut String, color: Rgb, instead: &str) -> std::fmt::Result {
    // The painter of SVG files writes colours in capitals.
    let color = hex(color).to_uppercase();
    for what in ["fill", "stroke"] {
        writeln!(
            text,
            "figure.flat svg [{what}=\"{color}\"] {{ {what}: {instead}; }}"
        )?;
    }
    Ok(())
}

/// True where colours are data or the ground of other marks, which is then white on every page.
#[must_use]
pub fn has_coloured_ground(chart: &Chart) -> bool {
    let is_colored = |series: &Series| {
        matches!(
            series.shape,
            Shape::Surface(_) | Shape::Path(_) | Shape::Images(_) | Shape::Graph(_)
        )
    };
    chart
        .panels
        .iter()
        .any(|panel| panel.series.iter().any(is_colored))
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
            Hue::Behind => (0x5c, 0x5f, 0x64),
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

/// The colour with as much white as it needs.
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
    use crate::figure::Panel;

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
    fn every_colour_of_a_flat_drawing_has_a_rule_and_coloured_grounds_have_none() {
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
        let rules = on_dark(&[&flat]);
        let svg = crate::figure::svg(&flat).unwrap();
        let colors = svg
            .split(['"', ' '])
            .filter(|word| word.starts_with('#'))
            .collect::<std::collections::BTreeSet<_>>();
        assert!(colors.len() >= 4, "{colors:?}");
        for color in colors {
            assert!(rules.contains(&format!("=\"{color}\"]")), "{color}: {rules}");
        }
        let surface = chart(Shape::Surface(crate::figure::Surface::default()));
        assert!(has_coloured_ground(&surface) && on_dark(&[&surface]).is_empty());
    }
}
