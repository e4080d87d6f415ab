//! Numbers of things in words.

use std::fmt::Display;

/// A number with its noun: `1 trial`, `2 trials`.
pub fn count<N: Display + PartialEq + From<u8>>(number: N, noun: &str) -> String {
    let end = if number == N::from(1) { "" } else { "s" };
    format!("{number} {noun}{end}")
}

/// The word that goes with a number: `is` with one, `are` with several.
pub fn either<N: PartialEq + From<u8>>(number: &N, one: &'static str, several: &'static str) -> &'static str {
    if *number == N::from(1) { one } else { several }
}

/// A time in the unit that suits it.
#[must_use]
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 9.95 => format!("{s:.1} s"),
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_one_and_all_else_is_several() {
        assert_eq!(
            [0_usize, 1, 2].map(|number| count(number, "trial")),
            ["0 trials", "1 trial", "2 trials"]
        );
        assert_eq!(
            [either(&1_u64, "is", "are"), either(&0_u64, "is", "are")],
            ["is", "are"]
        );
    }
}
