//! Reads a claim from its text by recursive descent over the grammar of the parent module.

use super::{Aggregate, Claim, ClaimError, Operand, Quantity, Relation, Within, forms::SYMBOLS};
use contract::sweep_point::as_word;
use serde_json::Value;

/// Reads one claim.
///
/// # Errors
/// [`ClaimError`] with the byte position of the first text that does not fit and the text to write instead.
pub fn parse(text: &str) -> Result<Claim, ClaimError> {
    let mut reader = ClaimParser { text, position: 0 };
    let mut left = reader.quantity()?;
    let of_left = reader.environment_of_left(&left)?;
    let relation = reader.relation()?;
    let mut right = reader.quantity()?;
    let before_last = reader.position;
    let last = reader.environment()?;
    let environment = match (of_left, &last) {
        (None, _) => last,
        (Some(only), None) if matches!(right, Quantity::Number(_)) => Some(only),
        (Some(_), None) => {
            return reader.error("the left side names its environment: name that of the right side too");
        }
        (Some(of_left), Some(of_right)) if of_left == *of_right => last,
        (Some(_), Some(_)) if matches!(right, Quantity::Number(_)) => {
            return Err(number_in_environment(before_last));
        }
        (Some(of_left), Some(_)) => {
            left.measured_in(Some(of_left));
            right.measured_in(last);
            None
        }
    };
    let claim = Claim {
        left,
        relation,
        right,
        environment,
    };
    if claim.operands().is_empty() {
        return Err(ClaimError {
            position: 0,
            message: "a claim names at least one agent's metric, as in `agent.return > 0.2`".into(),
        });
    }
    Ok(claim)
}

fn number_in_environment(position: usize) -> ClaimError {
    ClaimError {
        position,
        message: "a number is of no environment".into(),
    }
}

impl Quantity {
    fn measured_in(&mut self, place: Option<String>) {
        if let Quantity::Measured { operand, .. } = self {
            operand.environment = place;
        }
    }
}

struct ClaimParser<'a> {
    text: &'a str,
    position: usize,
}

impl<'a> ClaimParser<'a> {
    /// The rest of the text, without spaces in front.
    fn rest(&mut self) -> &'a str {
        let rest = &self.text[self.position..];
        let trimmed = rest.trim_start();
        self.position += rest.len() - trimmed.len();
        trimmed
    }

    /// Reads `symbol` if it comes next.
    fn eat(&mut self, symbol: &str) -> bool {
        let found = self.rest().starts_with(symbol);
        self.position += if found { symbol.len() } else { 0 };
        found
    }

    /// Reads the word `word` if it comes next and ends there.
    fn eat_word(&mut self, word: &str) -> bool {
        let found = name_at(self.rest()) == Some(word);
        self.position += if found { word.len() } else { 0 };
        found
    }

    fn error<T>(&mut self, message: impl Into<String>) -> Result<T, ClaimError> {
        self.rest();
        Err(ClaimError {
            position: self.position,
            message: message.into(),
        })
    }

    fn quantity(&mut self) -> Result<Quantity, ClaimError> {
        if let Some(number) = self.number() {
            return if self.eat("*") {
                Ok(Quantity::Measured {
                    factor: number,
                    operand: self.operand()?,
                })
            } else {
                Ok(Quantity::Number(number))
            };
        }
        let operand = self.operand()?;
        let factor = if self.eat("*") {
            self.expect_number("a factor after `*`")?
        } else {
            1.0
        };
        Ok(Quantity::Measured { factor, operand })
    }

    fn operand(&mut self) -> Result<Operand, ClaimError> {
        let Some(name) = name_at(self.rest()) else {
            return self.error("expected a number or an agent's metric, as in `agent.return`");
        };
        let start = self.position;
        self.position += name.len();
        if !self.eat("(") {
            return self.metric_of(Aggregate::Final, name);
        }
        let Some(aggregate) = Aggregate::ALL
            .into_iter()
            .find(|aggregate| aggregate.name() == name)
        else {
            let known = Aggregate::ALL.map(Aggregate::name).join(", ");
            return Err(ClaimError {
                position: start,
                message: format!("unknown function `{name}`; known: {known}"),
            });
        };
        let Some(agent) = name_at(self.rest()) else {
            return self.error(format!(
                "expected an agent's metric, as in `{name}(agent.return)`"
            ));
        };
        self.position += agent.len();
        let operand = self.metric_of(aggregate, agent)?;
        if self.eat(")") {
            Ok(operand)
        } else {
            self.error(format!("expected `)` to close `{name}(`"))
        }
    }

    /// Reads `.metric` after the agent's name, or the rest of `play.role.agent.metric`, without spaces
    /// between.
    fn metric_of(&mut self, aggregate: Aggregate, first: &str) -> Result<Operand, ClaimError> {
        let start = self.position - first.len();
        let setting = self.setting()?;
        let mut names = vec![first];
        while let Some(after) = self.text[self.position..].strip_prefix('.') {
            self.position += 1;
            let Some(name) = name_at(after) else {
                return self.error(format!("expected a metric's name after `{}.`", names.join(".")));
            };
            self.position += name.len();
            names.push(name);
        }
        let (within, agent, metric) = match names.as_slice() {
            [agent] => {
                return self.error(format!(
                    "expected `.` and a metric after the agent `{agent}`, as in `{agent}.return`"
                ));
            }
            [agent, metric] => (None, agent, metric),
            [play, role, agent, metric] if setting.is_empty() => (
                Some(Within {
                    play: (*play).into(),
                    role: (*role).into(),
                }),
                agent,
                metric,
            ),
            _ if !setting.is_empty() => {
                let message = format!("a setting stands behind an agent, as in `{first}[KEY=VALUE].METRIC`");
                return Err(ClaimError {
                    position: start,
                    message,
                });
            }
            other => {
                let message = format!(
                    "`{}` is neither AGENT.METRIC nor PLAY.ROLE.AGENT.METRIC",
                    other.join(".")
                );
                return Err(ClaimError {
                    position: start,
                    message,
                });
            }
        };
        Ok(Operand {
            aggregate,
            within,
            agent: (*agent).into(),
            setting,
            metric: (*metric).into(),
            environment: None,
        })
    }

    /// Reads `[KEY=VALUE, ...]` behind an agent's name, without a space before it; empty if there is none.
    fn setting(&mut self) -> Result<Vec<(String, String)>, ClaimError> {
        let mut setting = Vec::new();
        if !self.text[self.position..].starts_with('[') {
            return Ok(setting);
        }
        self.position += 1;
        loop {
            setting.push(self.swept()?);
            if self.eat("]") {
                return Ok(setting);
            }
            if !self.eat(",") {
                return self.error("expected `]` to close the setting");
            }
        }
    }

    /// Reads `KEY=VALUE`. A value with quotes or brackets is JSON, so that it may contain commas and brackets.
    fn swept(&mut self) -> Result<(String, String), ClaimError> {
        let rest = self.rest();
        let start = self.position;
        let key = rest.find('=').filter(|end| !rest[..*end].contains([',', ']']));
        let wrong = "expected a swept key with its value, as in `[discount=0.9]`";
        let Some(end) = key else {
            return self.error(wrong);
        };
        let key = rest[..end].trim().to_owned();
        self.position += end + 1;
        let rest = self.rest();
        let (value, end) = if rest.starts_with(['"', '[', '{']) {
            let mut values = serde_json::Deserializer::from_str(rest).into_iter::<Value>();
            match values.next() {
                Some(Ok(value)) => (value.to_string(), values.byte_offset()),
                _ => {
                    return self.error(
                        "a value with quotes or brackets is written as in JSON, as in `[load={\"watts\": 8}]`",
                    );
                }
            }
        } else {
            let end = rest.find([',', ']']).unwrap_or(rest.len());
            (as_word(rest[..end].trim()), end)
        };
        if value.is_empty() {
            self.position = start;
            return self.error(wrong);
        }
        self.position += end;
        Ok((key, value))
    }

    fn relation(&mut self) -> Result<Relation, ClaimError> {
        if let Some((_, relation)) = SYMBOLS.into_iter().find(|(symbol, _)| self.eat(symbol)) {
            return Ok(relation);
        }
        if self.eat_word("within") {
            return self.tolerance();
        }
        let rest = self.rest();
        if rest.starts_with('=') || rest.starts_with("!=") {
            return self
                .error("measured values are never exactly equal: write `within 5 % of`, or `~` for short");
        }
        self.error("expected `>`, `>=`, `<`, `<=`, `~` or `within N % of`")
    }

    /// Reads `N % of` or `N of` after `within`.
    fn tolerance(&mut self) -> Result<Relation, ClaimError> {
        self.rest();
        let start = self.position;
        let size = self.expect_number("how far, as in `within 5 % of`")?;
        if size < 0.0 {
            return Err(ClaimError {
                position: start,
                message: "a tolerance cannot be negative".into(),
            });
        }
        let relation = if self.eat("%") {
            Relation::WithinPercent(size)
        } else {
            Relation::Within(size)
        };
        if self.eat_word("of") {
            Ok(relation)
        } else {
            self.error("expected `of`, as in `within 5 % of 143`")
        }
    }

    /// Reads `in ENVIRONMENT`, if it comes next.
    fn named_environment(&mut self) -> Result<Option<String>, ClaimError> {
        if !self.eat_word("in") {
            return Ok(None);
        }
        let Some(name) = name_at(self.rest()) else {
            return self.error("expected an environment's name after `in`");
        };
        self.position += name.len();
        Ok(Some(name.to_owned()))
    }

    /// Reads the environment of the left side, if one follows it.
    fn environment_of_left(&mut self, left: &Quantity) -> Result<Option<String>, ClaimError> {
        self.rest();
        let start = self.position;
        match (self.named_environment()?, left) {
            (Some(_), Quantity::Number(_)) => Err(number_in_environment(start)),
            (environment, _) => Ok(environment),
        }
    }

    /// Reads the environment at the claim's end, and checks that the claim ends there.
    fn environment(&mut self) -> Result<Option<String>, ClaimError> {
        let environment = self.named_environment()?;
        let rest = self.rest();
        if rest.is_empty() {
            return Ok(environment);
        }
        if rest.starts_with(['<', '>', '~']) {
            return self.error("one comparison per claim: write a second claim");
        }
        self.error(if environment.is_some() {
            "expected the end of the claim"
        } else {
            "expected the end of the claim or `in ENVIRONMENT`"
        })
    }

    fn expect_number(&mut self, what: &str) -> Result<f64, ClaimError> {
        match self.number() {
            Some(number) => Ok(number),
            None => self.error(format!("expected a number: {what}")),
        }
    }

    /// Reads a number if one comes next; `4_cells.mae` and `1.mae` are names.
    fn number(&mut self) -> Option<f64> {
        let rest = self.rest();
        let length = number_length(rest);
        let number = rest[..length]
            .parse()
            .ok()
            .filter(|number: &f64| number.is_finite())?;
        if rest[length..].starts_with(|next: char| next == '.' || is_name_character(next)) {
            return None;
        }
        self.position += length;
        Some(number)
    }
}

/// Length of the longest text at the start of the form `-1.5e-3`; 0 if there is none.
fn number_length(text: &str) -> usize {
    let digits = |from: usize| text[from..].bytes().take_while(u8::is_ascii_digit).count();
    let mut length = usize::from(text.starts_with('-'));
    let whole = digits(length);
    length += whole;
    if text[length..].starts_with('.') && (whole == 0 || digits(length + 1) > 0) {
        length += 1 + digits(length + 1);
    }
    if text[length..].starts_with(['e', 'E']) {
        let sign = usize::from(text[length + 1..].starts_with(['+', '-']));
        let exponent = digits(length + 1 + sign);
        length += if exponent > 0 { 1 + sign + exponent } else { 0 };
    }
    length
}

/// The name at the start of `text`. A name does not start with `-`.
fn name_at(text: &str) -> Option<&str> {
    let length = text
        .find(|character| !is_name_character(character))
        .unwrap_or(text.len());
    (length > 0 && !text.starts_with('-')).then_some(&text[..length])
}

/// Whether names of agents, metrics and environments may have this character.
pub fn is_name_character(character: char) -> bool {
    character.is_alphanumeric() || character == '_' || character == '-'
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::sweep_point::SweepPoint;
    use proptest::prelude::*;
    use serde_json::json;

    fn measured(factor: f64, aggregate: Aggregate, agent: &str, metric: &str) -> Quantity {
        Quantity::Measured {
            factor,
            operand: Operand {
                aggregate,
                within: None,
                agent: agent.into(),
                setting: vec![],
                metric: metric.into(),
                environment: None,
            },
        }
    }

    #[test]
    fn settings_are_read_and_written() {
        let text = "max(dsac[discount=0.9, width=16].return) > 1.5 * dsac[discount=0.5].return";
        let claim = parse(text).unwrap();
        let setting = |index: usize| claim.operands()[index].setting.clone();
        let pair = |key: &str, value: &str| (key.to_owned(), value.to_owned());
        assert_eq!(setting(0), [pair("discount", "0.9"), pair("width", "16")]);
        assert_eq!(setting(1), [pair("discount", "0.5")]);
        assert_eq!(claim.to_string(), text);
        for (wrong, at) in [
            ("a[b].return > 1", 2),
            ("a[b=].return > 1", 2),
            ("a[b=1.return > 1", 16),
            ("a[b=1].c.d.e > 1", 0),
            ("a[b={c: 1}].return > 1", 4),
            ("a[b=\"c].return > 1", 4),
        ] {
            assert_eq!(parse(wrong).unwrap_err().position, at, "{wrong}");
        }
    }

    #[test]
    fn a_value_with_commas_and_brackets_is_json() {
        let text = r#"a[kind="b, [c]", load={"watts":[8,16]}].return > 1"#;
        let claim = parse(text).unwrap();
        let swept = |kind: &str, watts: i32| {
            let values = [("kind", json!(kind)), ("load", json!({ "watts": [8, watts] }))];
            SweepPoint::from_iter(values)
        };
        let operand = claim.operands()[0].clone();
        assert!(operand.is_at(&swept("b, [c]", 16)));
        assert!(!operand.is_at(&swept("b, c", 16)) && !operand.is_at(&swept("b, [c]", 8)));
        assert_eq!(claim.to_string(), text);
        // A word has the same value with and without quotes.
        let plain = parse(r#"a[kind="b"].return > a[kind=b].return"#).unwrap();
        let point = SweepPoint::from_iter([("kind", json!("b"))]);
        assert!(plain.operands().iter().all(|operand| operand.is_at(&point)));
    }

    fn claim(left: Quantity, relation: Relation, right: Quantity, environment: Option<&str>) -> Claim {
        Claim {
            left,
            relation,
            right,
            environment: environment.map(Into::into),
        }
    }

    /// Each text means the claim, and so does the claim's canonical form.
    fn all_mean(cases: &[(&str, Claim)]) {
        for (text, expected) in cases {
            assert_eq!(parse(text).as_ref(), Ok(expected), "{text}");
            assert_eq!(
                parse(&expected.to_string()).as_ref(),
                Ok(expected),
                "the canonical form of {text}"
            );
        }
    }

    #[test]
    fn comparisons_are_read() {
        use {Aggregate::*, Relation::*};
        let dsac = || measured(1.0, Final, "dsac", "cycle_length");
        all_mean(&[
            (
                "dsac.cycle_length > equal.cycle_length",
                claim(
                    dsac(),
                    Greater,
                    measured(1.0, Final, "equal", "cycle_length"),
                    None,
                ),
            ),
            (
                " dsac.cycle_length>=1.15*equal.cycle_length in 4-cells ",
                claim(
                    dsac(),
                    GreaterOrEqual,
                    measured(1.15, Final, "equal", "cycle_length"),
                    Some("4-cells"),
                ),
            ),
            (
                "gaussian_hot.mae > 0.2",
                claim(
                    measured(1.0, Final, "gaussian_hot", "mae"),
                    Greater,
                    Quantity::Number(0.2),
                    None,
                ),
            ),
            (
                "-1e-3 <= 4_cells.x",
                claim(
                    Quantity::Number(-1e-3),
                    LessOrEqual,
                    measured(1.0, Final, "4_cells", "x"),
                    None,
                ),
            ),
            (
                "a.x * 2 < 1e5.y",
                claim(
                    measured(2.0, Final, "a", "x"),
                    Less,
                    measured(1.0, Final, "1e5", "y"),
                    None,
                ),
            ),
        ]);
    }

    #[test]
    fn aggregates_are_read() {
        use {Aggregate::*, Relation::*};
        all_mean(&[
            (
                "auc(a.x) > max( in.y )",
                claim(
                    measured(1.0, Auc, "a", "x"),
                    Greater,
                    measured(1.0, Max, "in", "y"),
                    None,
                ),
            ),
            (
                "auc.x > min(größe.x)",
                claim(
                    measured(1.0, Final, "auc", "x"),
                    Greater,
                    measured(1.0, Min, "größe", "x"),
                    None,
                ),
            ),
        ]);
    }

    #[test]
    fn margins_are_read() {
        use {Aggregate::*, Relation::*};
        let dsac = || measured(1.0, Final, "dsac", "cycle_length");
        all_mean(&[
            (
                "final(dsac.cycle_length) ~ 143",
                claim(dsac(), WithinPercent(5.0), Quantity::Number(143.0), None),
            ),
            (
                "dsac.cycle_length within 2.5% of 143",
                claim(dsac(), WithinPercent(2.5), Quantity::Number(143.0), None),
            ),
            (
                "dsac.cycle_length within 3 of 143 in of",
                claim(dsac(), Within(3.0), Quantity::Number(143.0), Some("of")),
            ),
        ]);
    }

    /// The position is marked by `|`, which is removed before reading.
    #[test]
    fn errors_point_at_the_place() {
        let cases = [
            ("|", "a number or an agent's metric"),
            ("dsac| > 3", "`.` and a metric after the agent `dsac`"),
            ("dsac.| > 3", "metric's name after `dsac.`"),
            ("dsac.x |= 3", "within 5 % of"),
            ("dsac.x |3", "expected `>`"),
            ("dsac.x > |", "a number or an agent's metric"),
            ("dsac.x > |* 3", "a number or an agent's metric"),
            (
                "|mean(dsac.x) > 3",
                "unknown function `mean`; known: final, auc, max, min",
            ),
            ("auc(dsac.x| > 3", "`)` to close `auc(`"),
            ("auc(|> 3", "`auc(agent.return)`"),
            ("a.x > b.x |> c.x", "one comparison per claim"),
            ("a.x > b.x |and c.x > 2", "or `in ENVIRONMENT`"),
            ("a.x > b.x in |", "environment's name after `in`"),
            ("a.x > b.x in four |eight", "expected the end of the claim"),
            ("a.x in |> b.x", "environment's name after `in`"),
            ("a.x in e > b.x|", "name that of the right side too"),
            ("3 |in e < b.x", "a number is of no environment"),
            ("a.x in e > 3 |in f", "a number is of no environment"),
            ("a.x in e |f > 3", "expected `>`"),
            ("a.x within |of 3", "how far"),
            ("a.x within |-2 of 3", "cannot be negative"),
            ("a.x within 5 % |3", "expected `of`"),
            ("|a.b.x > 2", "neither AGENT.METRIC nor PLAY.ROLE.AGENT.METRIC"),
            ("a.b.c.d.| > 2", "after `a.b.c.d.`"),
            ("a.x * |b.x > 2", "a factor after `*`"),
            ("|1 > 2", "at least one agent's metric"),
            ("ä.x > |€", "a number or an agent's metric"),
        ];
        for (marked, message) in cases {
            let position = marked.find('|').unwrap();
            let error = parse(&marked.replace('|', "")).unwrap_err();
            assert!(error.message.contains(message), "{marked}: {error}");
            let text = marked.replace('|', "");
            assert_eq!(
                text[error.position..].trim_start(),
                text[position..].trim_start(),
                "{marked}: {error}"
            );
        }
    }

    #[test]
    fn an_agent_in_a_role_of_a_play() {
        let claim = parse("pursuit.prey.tdom_ac.score > 2 * pursuit.prey.pr2.score").unwrap();
        let [left, right] = claim.operands()[..] else {
            panic!("two operands")
        };
        assert_eq!(
            left.within,
            Some(Within {
                play: "pursuit".into(),
                role: "prey".into()
            })
        );
        assert_eq!(
            (left.agent.as_str(), right.agent.as_str(), left.metric.as_str()),
            ("tdom_ac", "pr2", "score")
        );
        assert_eq!(parse(&claim.to_string()), Ok(claim));
    }

    #[test]
    fn each_side_may_be_of_its_own_environment() {
        let claim = parse("a.x in worn >= 0.9 * auc(b.x) in new").unwrap();
        assert_eq!(claim.environments_of_sides(), Some(["worn", "new"]));
        assert_eq!(claim.environment, None);
        assert_eq!(claim.to_string(), "a.x in worn >= 0.9 * auc(b.x) in new");
        // An environment that both sides name is that of the claim.
        for text in ["a.x in worn > b.x in worn", "a.x > b.x in worn"] {
            let claim = parse(text).unwrap();
            assert_eq!(claim.environments_of_sides(), None, "{text}");
            assert_eq!(claim.to_string(), "a.x > b.x in worn");
        }
        let claim = parse("a.x in worn within 2 of 3").unwrap();
        assert_eq!(claim.environment.as_deref(), Some("worn"));
    }

    #[test]
    fn operands_are_listed() {
        let claim = parse("dirichlet.mae < 0.6 * auc(gaussian.mae)").unwrap();
        assert_eq!(
            claim
                .operands()
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>(),
            ["dirichlet.mae", "auc(gaussian.mae)"]
        );
        assert_eq!(parse("2 < a.x").unwrap().operands().len(), 1);
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused_at_a_place_inside_it(text in "[a-c.*<>=~%() 0-9eäin-]{0,24}") {
            match parse(&text) {
                Ok(claim) => prop_assert_eq!(parse(&claim.to_string()), Ok(claim)),
                Err(error) => prop_assert!(text.is_char_boundary(error.position)),
            }
        }
    }
}
