//! Dates and times as text: in UTC, to the second.

use crate::world::clock;
use jiff::Timestamp;
use std::time::UNIX_EPOCH;

/// The current time, for notes beside a result; no value that is compared or hashed for identity may contain it.
pub fn now() -> String {
    let since = clock::date().duration_since(UNIX_EPOCH);
    rfc_3339_of(since.map_or(0, |since| since.as_secs()))
}

/// A moment in seconds since 1970 in the format of RFC 3339, such as `2024-02-29T23:59:59Z`; the order of such texts is
/// that of time. Moments after the year 9999 become the end of that year.
pub fn rfc_3339_of(seconds: u64) -> String {
    let seconds = i64::try_from(seconds).unwrap_or(i64::MAX);
    Timestamp::from_second(seconds)
        .unwrap_or(Timestamp::MAX)
        .strftime("%Y-%m-%dT%H:%M:%SZ")
        .to_string()
}

/// The moment that [`rfc_3339_of`] wrote; `None` for any other text.
pub fn seconds_of(text: &str) -> Option<u64> {
    let moment: Timestamp = text.parse().ok()?;
    let seconds = u64::try_from(moment.as_second()).ok()?;
    // There is one text for each moment.
    (rfc_3339_of(seconds) == text).then_some(seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_written_as_rfc_3339_has_them() {
        let moments = [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_000_000_000, "2001-09-09T01:46:40Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (1_709_251_200, "2024-03-01T00:00:00Z"),
            (4_107_542_399, "2100-02-28T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ];
        for (seconds, text) in moments {
            assert_eq!(rfc_3339_of(seconds), text);
            assert_eq!(seconds_of(text), Some(seconds));
        }
        for text in [
            "",
            "2024-02-30T00:00:00Z",
            "2024-02-29",
            "2024-02-29T24:00:00Z",
            "1969-12-31T00:00:00Z",
        ] {
            assert_eq!(seconds_of(text), None, "{text}");
        }
    }
}
