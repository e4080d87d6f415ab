//! Width of a text in Computer Modern at 10 points, used to find a table that is wider than the text before LaTeX runs.

/// Widths of the characters from space to tilde in thousandths of an em, from the font metrics of cmr10; characters
/// that LaTeX takes from another font have their width there.
const WIDTHS: [u16; 95] = [
    333, 278, 500, 833, 500, 833, 778, 278, 389, 389, 500, 778, 278, 333, 278, 500, // space to /
    500, 500, 500, 500, 500, 500, 500, 500, 500, 500, // digits
    278, 278, 778, 778, 778, 472, 778, // : to @
    750, 708, 722, 764, 681, 653, 785, 750, 361, 514, 778, 625, 917, // A to M
    750, 778, 681, 778, 736, 556, 722, 750, 750, 1028, 750, 750, 611, // N to Z
    278, 500, 278, 500, 300, 278, // [ to `
    500, 556, 444, 556, 444, 306, 500, 556, 278, 306, 528, 278, 833, // a to m
    556, 500, 556, 528, 392, 394, 389, 556, 528, 722, 528, 528, 444, // n to z
    500, 278, 500, 500, // { to ~
];

/// Widths of bold text, small text and small capitals relative to plain text.
const BOLD: f64 = 1.16;
const SMALL: f64 = 0.8;
const CAPITALS: f64 = 1.22;

/// Typeface and size of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Face {
    Plain,
    Bold,
    /// `\scriptsize`.
    Small,
    /// `\textsc`.
    SmallCapitals,
}

/// Width of a text in points.
pub(super) fn width(text: &str, face: Face) -> f64 {
    // LaTeX prints hyphens before digits as minus signs.
    let signs = text
        .as_bytes()
        .windows(2)
        .filter(|pair| pair[0] == b'-' && pair[1].is_ascii_digit());
    let signs =
        f64::from(u32::try_from(signs.count()).unwrap_or(0)) * (character('\u{2212}') - character('-'));
    let plain = (text.chars().map(character).sum::<f64>() + signs) / 100.0;
    plain
        * match face {
            Face::Plain => 1.0,
            Face::Bold => BOLD,
            Face::Small => SMALL,
            Face::SmallCapitals => CAPITALS,
        }
}

fn character(character: char) -> f64 {
    let index = (character as usize).checked_sub(' ' as usize);
    f64::from(index.and_then(|index| WIDTHS.get(index)).copied().unwrap_or(778))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Measured by TeX, as `\setbox0\hbox{Dirichlet SAC}\the\wd0`, in points.
    const MEASURED: [(&str, Face, f64); 8] = [
        ("Dirichlet SAC", Face::Plain, 61.27786),
        ("16.4 [15.4, 17.3]", Face::Plain, 68.33351),
        ("0123456789", Face::Plain, 50.00015),
        ("environment", Face::Plain, 54.19456),
        ("Dirichlet SAC", Face::Bold, 70.96492),
        ("[15.4, 17.3]", Face::Small, 37.93074),
        ("inconclusive", Face::SmallCapitals, 64.04414),
        ("not judged", Face::SmallCapitals, 57.03308),
    ];

    #[test]
    fn widths_are_those_of_tex() {
        for (text, face, measured) in MEASURED {
            let ratio = width(text, face) / measured;
            assert!((ratio - 1.0).abs() < 0.015, "{text}: {ratio}");
        }
    }
}
