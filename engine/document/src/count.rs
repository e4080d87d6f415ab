//! Numbers of things as text.

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

/// A duration as text, in the unit that suits it.
#[must_use]
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 9.95 => format!("{s:.1} s"),
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// Numbers as ranges, as in `0-2, 5`.
#[must_use]
pub fn seed_ranges(seeds: &[u64]) -> String {
    let range = |run: &[u64]| match run {
        [first, .., last] => format!("{first}-{last}"),
        [only] => only.to_string(),
        [] => String::new(),
    };
    seeds
        .chunk_by(|one, next| one.checked_add(1) == Some(*next))
        .map(range)
        .collect::<Vec<_>>()
        .join(", ")
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

    #[test]
    fn seeds_are_written_as_ranges() {
        assert_eq!(seed_ranges(&[]), "");
        assert_eq!(seed_ranges(&[4]), "4");
        assert_eq!(seed_ranges(&[0, 1, 2, 5, 7, 8]), "0-2, 5, 7-8");
        assert_eq!(seed_ranges(&[u64::MAX]), u64::MAX.to_string());
    }
}
