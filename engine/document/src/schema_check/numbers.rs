//! Advice on texts at places where a number is required. The advice is the number that was intended. If a text can be
//! read in two ways, it names both; if a text cannot be read, there is none.

use super::View;
use crate::{lookalikes, plain_number};

/// The advice for `text`. `option` is the path of the key if it was given on the command line, as the value of `--set`.
pub(super) fn advice(text: &str, schema: &View<'_>, option: Option<&str>) -> Option<String> {
    let text = lookalikes::straightened(text.trim());
    let text = text.trim();
    if is_not_finite(text) {
        return Some("the number must be finite".into());
    }
    let wanted = AllowedNumbers::of(schema);
    if let Some(number) = wanted.fitting(text) {
        return Some(format!("write {number}"));
    }
    let fitting = |text: Option<String>| text.filter(|text| wanted.fitting(text).is_some());
    let list = list(text, &wanted);
    if let Some(list) = list.as_ref().filter(|_| wanted.lists) {
        return Some(format!("write [{list}]"));
    }
    // Three or more groups may be separate values.
    let commas = text.matches(',').count();
    let grouped = fitting(grouped(text)).filter(|_| list.is_none() || commas == 1);
    let decimal = fitting(with_decimal_comma(text)).filter(|_| commas == 1);
    let one = [grouped, decimal]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(" or ");
    let several = list.map(|list| match option {
        Some(path) => format!("`-S 'sweep.{path}={{grid: [{list}]}}'`"),
        None => format!("a sweep, `grid: [{list}]`"),
    });
    match several {
        None if one.is_empty() => scaled(text, &wanted).map(|number| format!("write {number}")),
        Some(several) if one.is_empty() => Some(format!("for several values write {several}")),
        Some(several) if option.is_some() => Some(format!("write {one}, or for several values {several}")),
        _ => Some(format!("write {one}")),
    }
}

/// The advice for a number with a fraction where a whole one is required.
pub(super) fn whole(text: &str) -> Option<String> {
    let value: f64 = text.parse().ok()?;
    let whole = (value.fract() == 0.0 && value.abs() < 9.0e15).then(|| format!("{value:.0}"));
    match (whole, groups(text, '.')) {
        (Some(whole), Some(grouped)) if whole != grouped => Some(format!(
            "write {whole}, or {grouped} where the point groups digits"
        )),
        (whole, _) => whole.map(|whole| format!("write {whole}")),
    }
}

/// The numbers that a key accepts.
struct AllowedNumbers {
    numbers: bool,
    lists: bool,
    limits: Vec<(f64, f64)>,
}

impl AllowedNumbers {
    fn of(schema: &View<'_>) -> Self {
        let places = schema.alternatives();
        let has = |name: &str| places.iter().any(|place| place.types().contains(&name));
        let limits = places.iter().filter(|place| {
            let types = place.types();
            types.contains(&"number") || types.contains(&"integer")
        });
        Self {
            numbers: has("number"),
            lists: has("array"),
            limits: limits
                .map(|place| {
                    let above = place.number("exclusiveMinimum").map(f64::next_up);
                    let below = place.number("exclusiveMaximum").map(f64::next_down);
                    let low = place.number("minimum").or(above).unwrap_or(f64::NEG_INFINITY);
                    let high = place.number("maximum").or(below).unwrap_or(f64::INFINITY);
                    (low, high)
                })
                .collect(),
        }
    }

    /// The text, if it is a number that the key accepts.
    fn fitting<'t>(&self, text: &'t str) -> Option<&'t str> {
        let number = plain_number(text)?;
        let value = number.as_f64()?;
        let is_in = |(low, high): &(f64, f64)| (*low..=*high).contains(&value);
        let is_kind = self.numbers || !number.is_f64();
        (is_kind && self.limits.iter().any(is_in)).then_some(text)
    }

    /// The largest value that the key accepts.
    fn most(&self) -> f64 {
        self.limits
            .iter()
            .map(|(_, high)| *high)
            .fold(f64::NEG_INFINITY, f64::max)
    }
}

fn is_not_finite(text: &str) -> bool {
    let word = text.trim_start_matches(['+', '-', '.']).to_lowercase();
    ["inf", "infinity", "\u{221e}", "nan"].contains(&word.as_str())
}

/// Digits in groups of three, separated by the same sign: `1,000`, `1 000`, `1'000`, `1.000.000`; and digits with
/// underscores anywhere between them.
fn grouped(text: &str) -> Option<String> {
    let points = groups(text, '.').filter(|_| text.matches('.').count() > 1);
    points
        .or_else(|| {
            [',', ' ', '\'']
                .into_iter()
                .find_map(|separator| groups(text, separator))
        })
        .or_else(|| underscored(text))
}

/// The number whose whole part is grouped by a separator.
fn groups(text: &str, separator: char) -> Option<String> {
    let (sign, unsigned) = match text.strip_prefix(['+', '-']) {
        Some(rest) => (&text[..1], rest),
        None => ("", text),
    };
    let (whole, fraction) = match separator {
        '.' => (unsigned, None),
        _ => unsigned
            .split_once('.')
            .map_or((unsigned, None), |(whole, rest)| (whole, Some(rest))),
    };
    let digits = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
    let mut parts = whole.split(separator);
    let first = parts
        .next()
        .filter(|first| digits(first) && first.len() <= 3 && !first.starts_with('0'))?;
    let rest: Vec<&str> = parts.collect();
    let fits = !rest.is_empty() && rest.iter().all(|part| digits(part) && part.len() == 3);
    let fraction = match fraction {
        Some(part) if digits(part) => format!(".{part}"),
        Some(_) => return None,
        None => String::new(),
    };
    let sign = if sign == "-" { "-" } else { "" };
    fits.then(|| format!("{sign}{first}{}{fraction}", rest.concat()))
}

fn underscored(text: &str) -> Option<String> {
    let digit = |letter: Option<char>| letter.is_some_and(|letter| letter.is_ascii_digit());
    let letters: Vec<char> = text.chars().collect();
    let between = |index: usize| {
        digit(
            index
                .checked_sub(1)
                .and_then(|before| letters.get(before))
                .copied(),
        ) && digit(letters.get(index + 1).copied())
    };
    let mut marks = letters
        .iter()
        .enumerate()
        .filter(|(_, letter)| **letter == '_')
        .peekable();
    marks.peek()?;
    marks
        .all(|(index, _)| between(index))
        .then(|| text.replace('_', ""))
}

/// The number with a point instead of its comma.
fn with_decimal_comma(text: &str) -> Option<String> {
    let (whole, rest) = text.split_once(',')?;
    let number = format!("{whole}.{rest}");
    let padded = whole.trim_start_matches(['+', '-']);
    let has_digits = !padded.is_empty() && rest.starts_with(|letter: char| letter.is_ascii_digit());
    (has_digits && !text.contains('.')).then_some(number)
}

/// Several numbers with commas between them, all allowed by the key, in the form of a list.
fn list(text: &str, wanted: &AllowedNumbers) -> Option<String> {
    let items: Vec<&str> = text.split(',').map(str::trim).collect();
    let is_padded = |item: &str| item.len() > 1 && item.starts_with('0') && !item.starts_with("0.");
    let is_item = |item: &&str| wanted.fitting(item).is_some() && !is_padded(item);
    let fit = items.len() > 1 && items.iter().all(is_item);
    fit.then(|| items.join(", "))
}

/// The number for a share in percent, or for a number of thousands (`k`) or millions (`M`).
fn scaled(text: &str, wanted: &AllowedNumbers) -> Option<String> {
    let of = |digits: &str, scale: f64| {
        let digits = digits.trim_end();
        let plain = digits.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
        let value = plain_number(digits).filter(|_| plain)?.as_f64()? * scale;
        let text = format!("{value:.10}");
        let text = text.trim_end_matches('0').trim_end_matches('.');
        wanted.fitting(text).map(String::from)
    };
    if let Some(share) = text.strip_suffix('%') {
        return match wanted.most() {
            most if most <= 1.0 => of(share, 0.01),
            100.0 => of(share, 1.0),
            _ => None,
        };
    }
    let thousands = text.strip_suffix(['k', 'K']).and_then(|digits| of(digits, 1e3));
    thousands.or_else(|| text.strip_suffix('M').and_then(|digits| of(digits, 1e6)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn said(text: &str, schema: &Value, option: Option<&str>) -> Option<String> {
        advice(text, &View::new(schema, schema), option)
    }

    fn count() -> Value {
        json!({ "type": "integer", "minimum": 0 })
    }

    fn share() -> Value {
        json!({ "type": "number", "minimum": 0, "maximum": 1 })
    }

    fn number() -> Value {
        json!({ "type": "number", "minimum": 0 })
    }

    #[test]
    fn commas_are_read_as_they_are_meant() {
        let cases = [
            ("0,99", share(), "write 0.99"),
            ("0,5", number(), "write 0.5"),
            ("1,5e-3", number(), "write 1.5e-3"),
            ("10,000", count(), "write 10000"),
            ("1,000,000", count(), "write 1000000"),
            ("1,000.5", number(), "write 1000.5"),
            ("0,125", number(), "write 0.125"),
            ("1,234", number(), "write 1234 or 1.234"),
            ("1,2", count(), "for several values write a sweep, `grid: [1, 2]`"),
            (
                "64,128,256",
                count(),
                "for several values write a sweep, `grid: [64, 128, 256]`",
            ),
        ];
        for (text, schema, expected) in cases {
            assert_eq!(said(text, &schema, None).as_deref(), Some(expected), "{text}");
        }
    }

    #[test]
    fn on_the_command_line_several_values_are_a_sweep() {
        let path = Some("protocol.steps");
        let sweep =
            |list: &str| format!("for several values write `-S 'sweep.protocol.steps={{grid: [{list}]}}'`");
        assert_eq!(said("64,128,256", &count(), path), Some(sweep("64, 128, 256")));
        assert_eq!(said("1,2", &count(), path), Some(sweep("1, 2")));
        assert_eq!(said("0.1,0.2", &share(), path), Some(sweep("0.1, 0.2")));
        assert_eq!(said("10,000", &count(), path).unwrap(), "write 10000");
        assert_eq!(
            said("0,5", &number(), path).unwrap(),
            "write 0.5, or for several values `-S 'sweep.protocol.steps={grid: [0, 5]}'`"
        );
        assert_eq!(said("0,99", &share(), path).unwrap(), "write 0.99");
        let lists = json!({ "anyOf": [count(), { "type": "array", "items": count() }] });
        assert_eq!(said("64,128", &lists, path).unwrap(), "write [64, 128]");
    }

    #[test]
    fn other_ways_to_write_a_number_are_read() {
        let cases = [
            ("1_000", count(), "write 1000"),
            ("10 000", count(), "write 10000"),
            ("10\u{202f}000", count(), "write 10000"),
            ("1'000", count(), "write 1000"),
            ("1.000.000", count(), "write 1000000"),
            ("1e\u{2013}3", share(), "write 1e-3"),
            ("\u{ff15}", count(), "write 5"),
            ("50%", share(), "write 0.5"),
            ("99.9 %", share(), "write 0.999"),
            ("10k", count(), "write 10000"),
            ("1.5M", count(), "write 1500000"),
            ("\u{221e}", number(), "the number must be finite"),
            ("-inf", number(), "the number must be finite"),
        ];
        for (text, schema, expected) in cases {
            assert_eq!(said(text, &schema, None).as_deref(), Some(expected), "{text}");
        }
    }

    #[test]
    fn no_number_is_advised_that_may_not_be_meant() {
        let texts = [
            "1 2", "1__000", "_1", "1/3", "10 steps", "5m", "10G", "2^10", "50 %", "1.2.3", "ten", "1,2,x",
            "1e", "-", "",
        ];
        for text in texts {
            assert_eq!(said(text, &number(), None), None, "{text}");
        }
        assert_eq!(said("2k", &share(), None), None);
        assert_eq!(said("1,234", &share(), None), None);
        assert_eq!(said("-5k", &count(), None), None);
        assert_eq!(
            said("1,000,000", &json!({ "type": "integer", "maximum": 100 }), None),
            None
        );
    }

    #[test]
    fn a_point_may_group_digits_of_a_whole_number() {
        assert_eq!(whole("2.0").unwrap(), "write 2");
        assert_eq!(whole("1e6").unwrap(), "write 1000000");
        assert_eq!(
            whole("10.000").unwrap(),
            "write 10, or 10000 where the point groups digits"
        );
        assert_eq!(whole("0.5"), None);
    }
}
