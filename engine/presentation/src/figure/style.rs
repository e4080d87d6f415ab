//! Colours, dashes and markers.

use super::chart::{Hue, Style};

/// Red, green, blue.
pub type Rgb = (u8, u8, u8);

/// Colour of text and frames.
pub const INK: Rgb = (0x22, 0x22, 0x22);
/// Colour of grid lines.
pub const FAINT: Rgb = (0xe2, 0xe2, 0xe2);

/// Palette by Okabe and Ito, "Color Universal Design" (2008), whose colours can be distinguished with any kind of
/// colour vision. Their yellow is too light for a line on white paper and comes last.
const PALETTE: [Rgb; 8] = [
    (0x00, 0x72, 0xb2),
    (0xd5, 0x5e, 0x00),
    (0x00, 0x9e, 0x73),
    (0xcc, 0x79, 0xa7),
    (0xe6, 0x9f, 0x00),
    (0x56, 0xb4, 0xe9),
    (0x00, 0x00, 0x00),
    (0xf0, 0xe4, 0x42),
];

/// Anchors of a scale from dark blue to yellow whose lightness rises evenly: cividis, by Nuñez, Anderton and
/// Renslow (2018).
const RAMP: [Rgb; 7] = [
    (0x00, 0x22, 0x4e),
    (0x2a, 0x3f, 0x6d),
    (0x57, 0x5d, 0x6d),
    (0x7d, 0x7c, 0x78),
    (0xa5, 0x9c, 0x74),
    (0xd2, 0xc0, 0x60),
    (0xfe, 0xe8, 0x38),
];

/// Marks at the points of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Marker {
    /// A disc.
    Circle,
    /// A square.
    Square,
    /// A triangle that points up.
    Triangle,
    /// A square on its corner.
    Diamond,
}

impl Style {
    /// The look of the n-th agent of a study. Agents that share a colour differ in dashes.
    #[must_use]
    pub fn of_agent(index: usize) -> Self {
        Self {
            hue: Hue::Palette(index),
            variant: index + index / PALETTE.len(),
        }
    }

    /// Colour of the series on white paper.
    #[must_use]
    pub fn color(self) -> Rgb {
        match self.hue {
            Hue::Palette(index) => PALETTE[index % PALETTE.len()],
            #[allow(clippy::cast_precision_loss, reason = "a handful of steps")]
            Hue::Ramp(step, steps) => ramp(0.82 * step as f64 / (steps.max(2) - 1) as f64),
            Hue::Grey => (0x55, 0x55, 0x55),
            Hue::Behind | Hue::Other => (0xb4, 0xb4, 0xb4),
        }
    }

    /// Colour of bars, which have no dashes: lighter from the ninth agent on, where the palette begins again.
    #[must_use]
    pub fn fill(self) -> Rgb {
        blend(self.color(), (0xff, 0xff, 0xff), self.paleness())
    }

    /// Part of the paper in the colour of bars, from 0 to 0.75.
    pub(super) fn paleness(self) -> f64 {
        match self.hue {
            Hue::Palette(index) => [0.0, 0.5, 0.75][(index / PALETTE.len()).min(2)],
            _ => 0.0,
        }
    }

    /// Width of a line in points.
    #[must_use]
    pub fn width(self) -> f64 {
        match self.hue {
            Hue::Behind => 3.4,
            Hue::Other => 0.7,
            _ => 1.2,
        }
    }

    /// Lengths of dashes and gaps in points; empty for a full line.
    #[must_use]
    pub fn dashes(self) -> &'static [f64] {
        match self.variant % 4 {
            0 => &[],
            1 => &[6.0, 2.0],
            2 => &[6.0, 1.8, 1.3, 1.8],
            _ => &[6.0, 1.6, 1.3, 1.6, 1.3, 1.6],
        }
    }

    /// Short dashes, for agents that do not learn and for thresholds.
    #[must_use]
    pub fn short_dashes(self) -> &'static [f64] {
        match self.variant % 4 {
            0 => &[2.4, 1.6],
            1 => &[2.4, 2.8],
            2 => &[2.4, 4.0],
            _ => &[2.4, 1.6, 2.4, 4.4],
        }
    }

    /// Dots, for published curves.
    #[must_use]
    pub fn dots(self) -> &'static [f64] {
        match self.variant % 4 {
            0 => &[1.0, 1.5],
            1 => &[1.0, 3.0],
            2 => &[1.0, 1.5, 1.0, 3.5],
            _ => &[1.0, 1.5, 1.0, 1.5, 1.0, 3.5],
        }
    }

    /// The colour of thin lines: equally light for all agents, so that no agent's seeds stand out.
    #[must_use]
    pub fn light(self) -> Rgb {
        const LIGHT: f64 = 0.74;
        let color = self.color();
        let lightness =
            (0.299 * f64::from(color.0) + 0.587 * f64::from(color.1) + 0.114 * f64::from(color.2)) / 255.0;
        blend(
            color,
            (0xff, 0xff, 0xff),
            ((LIGHT - lightness) / (1.0 - lightness)).max(0.0),
        )
    }

    /// Marker at the points of the series.
    #[must_use]
    pub fn marker(self) -> Marker {
        [Marker::Circle, Marker::Square, Marker::Triangle, Marker::Diamond][self.variant % 4]
    }
}

/// A colour between dark at 0 and light at 1.
#[must_use]
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "clamped to the anchors first"
)]
pub fn ramp(part: f64) -> Rgb {
    let place = part.clamp(0.0, 1.0) * (RAMP.len() - 1) as f64;
    let index = (place as usize).min(RAMP.len() - 2);
    blend(RAMP[index], RAMP[index + 1], place - index as f64)
}

/// A colour that is `part` of the way from one to another.
#[must_use]
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "between two bytes"
)]
pub fn blend(from: Rgb, to: Rgb, part: f64) -> Rgb {
    let mix = |from: u8, to: u8| (f64::from(from) + (f64::from(to) - f64::from(from)) * part).round() as u8;
    (mix(from.0, to.0), mix(from.1, to.1), mix(from.2, to.2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_eight_agents_differ_in_colour_neighbours_in_dash_and_later_ones_in_one_of_both() {
        let colors: std::collections::BTreeSet<Rgb> =
            (0..8).map(|index| Style::of_agent(index).color()).collect();
        assert_eq!(colors.len(), 8);
        assert!((0..31).all(|index| Style::of_agent(index).dashes() != Style::of_agent(index + 1).dashes()));
        let looks = (0..32).map(Style::of_agent);
        let looks: std::collections::BTreeSet<(Rgb, Marker)> =
            looks.map(|it| (it.color(), it.marker())).collect();
        assert_eq!(looks.len(), 32);
    }

    #[test]
    fn bars_of_twenty_agents_differ_in_colour_and_the_first_eight_have_the_palette() {
        let fills: std::collections::BTreeSet<Rgb> =
            (0..20).map(|index| Style::of_agent(index).fill()).collect();
        assert_eq!(fills.len(), 20);
        assert!((0..8).all(|index| Style::of_agent(index).fill() == Style::of_agent(index).color()));
    }

    #[test]
    fn who_learned_is_seen_from_the_dashes_of_any_agent() {
        let kinds = |index| {
            let style = Style::of_agent(index);
            [style.dashes(), style.short_dashes(), style.dots()]
                .map(|dashes| dashes.first().map_or(f64::INFINITY, |first| *first))
        };
        let apart = |index| kinds(index).windows(2).all(|pair| pair[0] >= 2.0 * pair[1]);
        assert!((0..8).all(apart));
    }

    #[test]
    fn thin_lines_are_lighter_than_the_line_and_equally_light() {
        let lightness =
            |(r, g, b): Rgb| (0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)) / 255.0;
        for style in (0..7).map(Style::of_agent) {
            assert!((lightness(style.light()) - 0.74).abs() < 0.01 && lightness(style.color()) < 0.66);
        }
    }

    #[test]
    fn the_ramp_goes_from_dark_to_light() {
        let light = |part| {
            let (r, g, b) = ramp(part);
            u32::from(r) + u32::from(g) + u32::from(b)
        };
        assert!((0..20).all(|step| light(f64::from(step) / 20.0) <= light(f64::from(step + 1) / 20.0)));
    }
}
