//! Writes words, names and comments of a study.

use serde_json::Value;

/// Width of the longest line.
const WIDTH: usize = 116;

/// A value as YAML.
pub fn value(value: &Value) -> String {
    match value {
        Value::String(text) => quoted(text),
        other => other.to_string(),
    }
}

/// A text as YAML, without quotes where it cannot be read as anything else.
pub fn quoted(text: &str) -> String {
    const OTHERS: [&str; 11] = [
        "true", "false", "yes", "no", "on", "off", "null", "y", "n", "nan", "inf",
    ];
    let begins = text.trim_start_matches(['-', '.', '/']);
    let is_plain = begins.starts_with(|it: char| it.is_ascii_alphabetic())
        && text
            .chars()
            .all(|it| it.is_ascii_alphanumeric() || "_./+-=".contains(it))
        && !OTHERS.contains(&begins.to_ascii_lowercase().as_str());
    match is_plain {
        true => text.to_owned(),
        false => Value::from(text).to_string(),
    }
}

/// A key as the name of a metric.
pub fn plain(key: &str) -> String {
    let lower = key.to_lowercase();
    if ["return", "reward", "rew_"]
        .iter()
        .any(|word| lower.contains(word))
        || lower == "r"
    {
        return "return".into();
    }
    let last = lower
        .rsplit(['/', '.', ' '])
        .find(|part| !part.is_empty())
        .unwrap_or_default();
    let letter = |it: char| if it.is_ascii_alphanumeric() { it } else { '_' };
    let name: String = last.chars().map(letter).collect();
    let begins = name.starts_with(|it: char| it.is_ascii_alphabetic());
    const TAKEN: [&str; 5] = [
        "updates",
        "wall_time",
        "own_steps",
        "time_per_update",
        "time_per_decision",
    ];
    match begins && !TAKEN.contains(&name.as_str()) {
        true => name,
        false => format!("own_{}", name.trim_matches('_')),
    }
}

/// A list in brackets, wrapped at the line width.
pub fn wrapped(begin: &str, words: &[String], indent: &str) -> String {
    let (mut text, mut width) = (begin.to_owned(), begin.len());
    for (place, word) in words.iter().enumerate() {
        let is_last = place + 1 == words.len();
        let word = if is_last {
            format!("{word}]")
        } else {
            format!("{word},")
        };
        if place > 0 && width + 1 + word.chars().count() > WIDTH {
            text += &format!("\n{indent}");
            width = indent.len();
        } else if place > 0 {
            text.push(' ');
            width += 1;
        }
        width += word.chars().count();
        text += &word;
    }
    text + "\n"
}

/// A comment, wrapped at the line width.
pub fn comment(indent: &str, text: &str, hang: &str) -> String {
    let (mut lines, mut line) = (Vec::new(), String::new());
    for word in text.split_whitespace() {
        if !line.is_empty() && indent.len() + 2 + line.chars().count() + 1 + word.chars().count() > WIDTH {
            lines.push(std::mem::replace(&mut line, hang.to_owned()));
        } else if !line.is_empty() {
            line.push(' ');
        }
        line += word;
    }
    lines.push(line);
    lines.iter().map(|line| format!("{indent}# {line}\n")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_where_yaml_would_read_something_else() {
        for (text, written) in [
            ("--lr", "--lr"),
            ("./run.sh", "./run.sh"),
            ("{lr}", "\"{lr}\""),
            ("1", "\"1\""),
            ("-1", "\"-1\""),
            ("no", "\"no\""),
            ("a: b", "\"a: b\""),
            ("", "\"\""),
            ("--x=3", "--x=3"),
            ("*tfevents*", "\"*tfevents*\""),
        ] {
            assert_eq!(quoted(text), written);
        }
    }

    #[test]
    fn names_of_metrics_are_short_words() {
        for (key, name) in [
            ("charts/episodic_return", "return"),
            ("rollout/ep_rew_mean", "return"),
            ("r", "return"),
            ("losses/td-loss", "td_loss"),
            ("val.acc", "acc"),
            ("updates", "own_updates"),
            ("3d", "own_3d"),
        ] {
            assert_eq!(plain(key), name);
        }
    }
}
