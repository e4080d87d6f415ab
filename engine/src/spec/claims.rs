//! Claims of a study: comparisons of agents' metrics.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A comparison that the results support, refute or leave open.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ClaimSpec {
    /// The comparison, such as `learner.return > rule.return`.
    pub claim: String,
    /// The environment it is about; each in turn where absent.
    pub environment: Option<String>,
    /// Which sentence of the source it stands for; empty where absent.
    pub about: String,
}

/// An agent and a metric that a claim speaks of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Operand {
    /// Name of the agent.
    pub agent: String,
    /// Name of the metric.
    pub metric: String,
    /// Where it begins in the text, in characters.
    pub position: usize,
}

/// What is wrong with a claim's text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mistake {
    /// Where, in characters from the beginning.
    pub position: usize,
    /// What.
    pub message: String,
}

impl Mistake {
    /// Number of characters that are wrong: a word, or the whole text.
    #[must_use]
    pub fn length(&self, text: &str) -> usize {
        let rest = text.chars().skip(self.position);
        if self.position == 0 { rest.count() } else { rest.take_while(|letter| !letter.is_whitespace()).count().max(1) }
    }
}

/// The operands of a claim.
///
/// # Errors
/// Where the text is no comparison of terms: names with a dot, numbers, `+ - * / %`, parentheses.
pub fn operands(text: &str) -> Result<Vec<Operand>, Mistake> {
    let letters: Vec<char> = text.chars().collect();
    let (mut operands, mut comparisons, mut index) = (Vec::new(), 0, 0);
    while index < letters.len() {
        let rest = &letters[index..];
        let length = match rest[0] {
            letter if letter.is_alphabetic() || letter == '_' => {
                let length = run(rest, |letter| letter.is_alphanumeric() || "_-.".contains(letter));
                operands.extend(operand(&rest[..length].iter().collect::<String>(), index)?);
                length
            }
            letter if letter.is_ascii_digit() || letter == '.' => {
                run(rest, |letter| letter.is_ascii_alphanumeric() || ".".contains(letter))
            }
            '<' | '>' | '=' | '!' => {
                comparisons += 1;
                run(rest, |letter| "<>=!".contains(letter))
            }
            letter if letter.is_whitespace() || "+-*/%()".contains(letter) => 1,
            letter => return Err(Mistake { position: index, message: format!("`{letter}` has no meaning in a claim") }),
        };
        index += length;
    }
    match (comparisons, operands.is_empty()) {
        (1, false) => Ok(operands),
        (1, true) => Err(Mistake { position: 0, message: "this claim names no metric of an agent".into() }),
        (0, _) => Err(Mistake { position: 0, message: "this claim compares nothing".into() }),
        _ => Err(Mistake { position: 0, message: "this claim compares more than once".into() }),
    }
}

fn run(letters: &[char], belongs: impl Fn(char) -> bool) -> usize {
    letters.iter().take_while(|letter| belongs(**letter)).count()
}

fn operand(word: &str, position: usize) -> Result<Option<Operand>, Mistake> {
    match word.split_once('.') {
        Some((agent, metric)) if !agent.is_empty() && !metric.is_empty() => {
            Ok(Some(Operand { agent: agent.into(), metric: metric.into(), position }))
        }
        _ if word == "and" || word == "or" => Err(Mistake { position, message: format!("`{word}`: write two claims instead") }),
        _ => Err(Mistake { position, message: format!("`{word}` is no metric of an agent: write `AGENT.METRIC`") }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operands_are_found_with_their_positions() {
        let found = operands("one.length > 1.1 * other.length").unwrap();
        assert_eq!(found.iter().map(|it| (it.agent.as_str(), it.position)).collect::<Vec<_>>(), [("one", 0), ("other", 19)]);
    }

    #[test]
    fn what_is_no_comparison_is_refused() {
        assert_eq!(operands("one.return").unwrap_err().position, 0);
        assert_eq!(operands("one.return > best").unwrap_err().position, 13);
        assert_eq!(operands("a.b > c.d ; e.f").unwrap_err().position, 10);
    }
}
