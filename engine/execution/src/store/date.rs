//! When something happened, as text: in UTC, to the second.

use crate::world::clock;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

const SECONDS_A_DAY: u64 = 86_400;

/// This moment, to be noted beside a result; nothing that is compared or hashed for identity may hold it.
pub fn now() -> String {
    rfc_3339(clock::date())
}

/// A moment in seconds since 1970 as RFC 3339 writes it.
pub fn rfc_3339_of(seconds: u64) -> String {
    rfc_3339(UNIX_EPOCH + Duration::from_secs(seconds))
}

/// The moment that [`rfc_3339_of`] wrote; `None` where it is another text.
pub fn seconds_of(text: &str) -> Option<u64> {
    let (day, time) = text.strip_suffix('Z')?.split_once('T')?;
    let numbers = |text: &str, between: char| -> Option<[u64; 3]> {
        let parts: Vec<u64> = text
            .split(between)
            .map(|word| word.parse().ok())
            .collect::<Option<_>>()?;
        parts.try_into().ok()
    };
    let ([year, month, day], [hour, minute, second]) = (numbers(day, '-')?, numbers(time, ':')?);
    // Within these limits there is one text for each moment, and nothing below overflows.
    let limits = [
        (1970..10_000, year),
        (0..24, hour),
        (0..60, minute),
        (0..60, second),
    ];
    let within = limits.into_iter().all(|(range, number)| range.contains(&number));
    let days = days(year, month, day).filter(|_| within)?;
    Some(days * SECONDS_A_DAY + hour * 3600 + minute * 60 + second)
}

/// Days from 1970-01-01 to a date, which must be one.
fn days(year: u64, month: u64, day: u64) -> Option<u64> {
    // A year has at most 366 days: the date is among them or there is no such date.
    let first = year.checked_sub(1970)? * 365;
    (first..first + (year / 4).saturating_sub(400) + 366).find(|days| date(*days) == (year, month, day))
}

/// A moment as RFC 3339 writes it, as in `2024-02-29T23:59:59Z`; texts of this form are in the order of time.
fn rfc_3339(moment: SystemTime) -> String {
    let seconds = moment
        .duration_since(UNIX_EPOCH)
        .map_or(0, |since| since.as_secs());
    let ((year, month, day), second) = (date(seconds / SECONDS_A_DAY), seconds % SECONDS_A_DAY);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Year, month and day, from the number of days since 1970-01-01 in the Gregorian calendar.
///
/// Years are counted from the first of March of the year 0, so that a leap day is the last day of its year;
/// 400 years have 146097 days.
fn date(days: u64) -> (u64, u64, u64) {
    let days = days + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year + year / 4 - year / 100);
    // March to July and August to December have 153 days each, in the same order of long and short months.
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day_of_month = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 {
        month_from_march + 3
    } else {
        month_from_march - 9
    };
    (year + 400 * era + u64::from(month <= 2), month, day_of_month)
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

    #[test]
    fn every_day_follows_the_one_before() {
        let lengths = |year: u64| {
            let leap = year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
            [
                31,
                if leap { 29 } else { 28 },
                31,
                30,
                31,
                30,
                31,
                31,
                30,
                31,
                30,
                31,
            ]
        };
        let mut expected = (1970, 1, 1);
        for days in 0..200_000 {
            assert_eq!(date(days), expected);
            let (year, month, day) = expected;
            expected = match (month, day == lengths(year)[month as usize - 1]) {
                (12, true) => (year + 1, 1, 1),
                (_, true) => (year, month + 1, 1),
                (_, false) => (year, month, day + 1),
            };
        }
    }
}
