//! Formats of the numbers in a table.

/// Format of the numbers in a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberFormat {
    /// Digits after the decimal point.
    Fixed(usize),
    /// One digit before the decimal point, this many after it, and a power of ten.
    Scientific(usize),
}

impl Default for NumberFormat {
    fn default() -> Self {
        Self::Fixed(1)
    }
}

impl NumberFormat {
    /// A format that shows about four digits of the largest of some numbers.
    #[must_use]
    pub fn fitting(numbers: impl Iterator<Item = f64>) -> Self {
        let largest = numbers
            .filter(|number| number.is_finite())
            .fold(0.0, |largest: f64, number| largest.max(number.abs()));
        match largest {
            0.0 => Self::Fixed(1),
            _ if !(1e-3..1e7).contains(&largest) => Self::Scientific(3),
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "clamped to 0..=6 first"
            )]
            _ => Self::Fixed((3.0 - largest.log10().floor()).clamp(0.0, 6.0) as usize),
        }
    }

    /// Writes a number in this format.
    #[must_use]
    pub fn write(self, number: f64) -> String {
        let text = match self {
            Self::Fixed(decimals) => format!("{number:.decimals$}"),
            Self::Scientific(decimals) => format!("{number:.decimals$e}"),
        };
        // A number that rounds to zero from below is written without its sign.
        if text.starts_with('-') && !text.bytes().any(|byte| (b'1'..=b'9').contains(&byte)) {
            text[1..].into()
        } else {
            text
        }
    }

    /// Writes a published number with the digits of its publication. A number with more digits than any print has was
    /// computed from a curve, and gets the digits of the table.
    #[must_use]
    pub fn published(self, number: f64) -> String {
        const MOST_PRINTED: usize = 6;
        match self {
            Self::Fixed(_) => {
                let text = number.to_string();
                let digits = text.split_once('.').map_or(0, |(_, digits)| digits.len());
                if digits > MOST_PRINTED {
                    self.write(number)
                } else {
                    text
                }
            }
            Self::Scientific(_) => format!("{number:e}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_format_shows_about_four_digits() {
        assert_eq!(
            NumberFormat::fitting([12.3, 1.0].into_iter()),
            NumberFormat::Fixed(2)
        );
        assert_eq!(
            NumberFormat::fitting([51234.0].into_iter()),
            NumberFormat::Fixed(0)
        );
        assert_eq!(
            NumberFormat::fitting([2e-5, f64::NAN].into_iter()),
            NumberFormat::Scientific(3)
        );
        assert_eq!(NumberFormat::fitting(std::iter::empty()), NumberFormat::Fixed(1));
    }

    #[test]
    fn published_numbers_keep_their_digits_and_computed_ones_do_not() {
        assert_eq!(NumberFormat::Fixed(1).published(0.0505), "0.0505");
        assert_eq!(
            NumberFormat::Fixed(1).published(-160.435_637_499_999_98),
            "-160.4"
        );
    }

    #[test]
    fn a_number_that_rounds_to_zero_has_no_sign() {
        assert_eq!(NumberFormat::Fixed(1).write(-0.04), "0.0");
        assert_eq!(NumberFormat::Fixed(1).write(-0.06), "-0.1");
        assert_eq!(NumberFormat::Scientific(2).write(-1.234e-5), "-1.23e-5");
    }
}
