//! Names of agents with their settings, shortened to the width of a terminal.

use contract::sweep_point::{last_word, split_words};
use std::{borrow::Cow, collections::BTreeSet};

/// Number of letters of each word of a key, and number of digits of a value, that are kept; `None` keeps all.
const LEVELS: [(Option<usize>, Option<usize>); 6] = [
    (None, None),
    (None, Some(3)),
    (Some(4), Some(3)),
    (Some(3), Some(3)),
    (Some(2), Some(3)),
    (Some(1), Some(3)),
];

/// Names in `room` columns each, such as `learner rate=0.002 batch_size=16`, all shortened alike: values are rounded
/// first, then the words of keys become shorter, as long as different names stay different. Names that are still too
/// long are cut.
pub(super) fn shortened(names: &[&str], room: usize) -> Vec<String> {
    let distinct = |names: &[String]| names.iter().collect::<BTreeSet<_>>().len();
    let whole: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
    let different = distinct(&whole);
    let mut best = whole;
    for level in LEVELS {
        let tried: Vec<String> = names.iter().map(|name| at_level(name, level)).collect();
        if distinct(&tried) < different {
            break;
        }
        best = tried;
        if best.iter().all(|name| name.chars().count() <= room) {
            break;
        }
    }
    best.into_iter().map(|name| cut(&name, room)).collect()
}

/// A text of at most `room` columns, with an ellipsis if it was cut.
pub(super) fn cut(text: &str, room: usize) -> String {
    if text.chars().count() <= room {
        return text.to_owned();
    }
    let kept = text.chars().take(room.saturating_sub(1));
    kept.chain((room > 0).then_some('…')).collect()
}

fn at_level(name: &str, (letters, digits): (Option<usize>, Option<usize>)) -> String {
    let word = |word| match str::split_once(word, '=') {
        Some((key, value)) => Cow::Owned(format!(
            "{}={}",
            short_key(key, letters),
            short_value(value, digits)
        )),
        None => Cow::Borrowed(word),
    };
    let words: Vec<Cow<'_, str>> = split_words(name).map(word).collect();
    words.join(" ")
}

/// The last part of a dotted key, with the first letters of its words.
fn short_key(key: &str, letters: Option<usize>) -> String {
    let Some(letters) = letters else {
        return key.to_owned();
    };
    let words = last_word(key)
        .split('_')
        .map(|word| word.chars().take(letters).collect::<String>());
    let words: Vec<String> = words.collect();
    words.join(if letters == 1 { "" } else { "_" })
}

/// A number rounded to `digits` digits, in its shorter notation.
fn short_value(value: &str, digits: Option<usize>) -> String {
    let (Some(digits), Ok(number)) = (digits, value.parse::<f64>()) else {
        return value.to_owned();
    };
    let rounded: f64 = format!("{number:.*e}", digits - 1).parse().unwrap_or(number);
    let forms = [value.to_owned(), rounded.to_string(), format!("{rounded:e}")];
    forms.into_iter().min_by_key(String::len).unwrap_or_default()
}

/// A number of steps in at most five columns, as `800`, `64k` or `1.25M`.
pub(super) fn steps(steps: u64) -> String {
    #[allow(clippy::cast_precision_loss, reason = "three digits are shown")]
    let number = steps as f64;
    match steps {
        0..10_000 => steps.to_string(),
        10_000..1_000_000 => format!("{:.0}k", number / 1e3),
        1_000_000..100_000_000 => format!("{}M", (number / 1e4).round() / 1e2),
        _ => format!("{:.0}M", number / 1e6),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 2] = [
        "learner actor_learning_rate=0.000198622 discount=0.910651 batch_size=16",
        "learner actor_learning_rate=0.00233 discount=0.95 batch_size=32",
    ];

    #[test]
    fn values_are_rounded_before_keys_become_shorter() {
        assert_eq!(shortened(&NAMES, 80), NAMES);
        assert_eq!(
            shortened(&NAMES, 64)[0],
            "learner actor_learning_rate=1.99e-4 discount=0.911 batch_size=16"
        );
        assert_eq!(
            shortened(&NAMES, 50),
            [
                "learner act_lea_rat=1.99e-4 dis=0.911 bat_siz=16",
                "learner act_lea_rat=0.00233 dis=0.95 bat_siz=32"
            ]
        );
        assert_eq!(shortened(&NAMES, 38)[1], "learner alr=0.00233 d=0.95 bs=32");
        assert_eq!(shortened(&NAMES, 12)[0], "learner alr…");
    }

    #[test]
    fn different_names_stay_different() {
        let names = ["a rate=0.10001 tau=1", "a rate=0.10002 tau=1"];
        assert_eq!(
            shortened(&names, 19),
            ["a rate=0.10001 tau…", "a rate=0.10002 tau…"]
        );
        let names = ["a tau=1", "a top=1"];
        assert_eq!(shortened(&names, 3)[1], "a …");
    }

    #[test]
    fn names_without_a_setting_stay() {
        assert_eq!(shortened(&["equal", "dsac"], 10), ["equal", "dsac"]);
    }

    #[test]
    fn steps_take_five_columns_at_most() {
        let written = [0, 9_999, 64_000, 999_999, 1_250_000, 25_000_000, 250_000_000].map(steps);
        assert_eq!(written, ["0", "9999", "64k", "1000k", "1.25M", "25M", "250M"]);
    }
}
