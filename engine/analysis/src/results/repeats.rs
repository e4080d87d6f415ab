//! Repetition: whether a program that trains itself gives the same values again with the same seed.

use contract::repeats::Repeats;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// A trial of a program that was computed twice, up to its first measurement.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RepeatCheck {
    /// Environment of the trial.
    pub environment: String,
    /// Agent of the trial.
    pub agent: String,
    /// Seed of the trial.
    pub seed: u64,
    /// Comparison of the values of both.
    pub repeats: Repeats,
}

/// The programs whose repetition is reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Programs {
    /// All.
    All,
    /// Programs that do not repeat bit by bit.
    OnlyLacking,
}

/// Sentences on the programs that are shown, one for each answer; `printed` gives the name under which an agent
/// is shown, if it is.
#[must_use]
pub fn sentences(
    all: &[RepeatCheck],
    which: Programs,
    printed: impl Fn(&str) -> Option<String>,
) -> Vec<String> {
    let mut answers: BTreeMap<(u8, String), Vec<(&RepeatCheck, String)>> = BTreeMap::new();
    let shown = all.iter().filter_map(|it| Some((it, printed(&it.agent)?)));
    for (one, name) in shown {
        let answer = match &one.repeats {
            Repeats::ToTheBit(_) if which == Programs::OnlyLacking => continue,
            Repeats::ToTheBit(_) => (0, "Repeats to the bit with the same seed".to_owned()),
            Repeats::Within(power) => (1, format!("Repeats to 1e{power} with the same seed")),
            Repeats::Not => (2, "Does not repeat with the same seed".into()),
            Repeats::Unknown(problem) => (3, format!("Not known to repeat ({problem})")),
        };
        answers.entry(answer).or_default().push((one, name));
    }
    let is_everywhere = |one: &RepeatCheck, of: &[(&RepeatCheck, String)]| {
        let environments = all.iter().filter(|it| it.agent == one.agent).count();
        of.iter().filter(|(it, _)| it.agent == one.agent).count() == environments
    };
    let sentence = |((_, words), of): (&(u8, String), &Vec<(&RepeatCheck, String)>)| {
        let name = |(one, name): &(&RepeatCheck, String)| match is_everywhere(one, of) {
            true => format!("`{name}`"),
            false => format!("`{name}` in `{}`", one.environment),
        };
        let names: BTreeSet<String> = of.iter().map(name).collect();
        format!("{words}: {}.", names.into_iter().collect::<Vec<_>>().join(", "))
    };
    answers.iter().map(sentence).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sentence_names_all_programs_with_its_answer_and_where_it_holds_if_not_everywhere() {
        let of = |environment: &str, repeats| RepeatCheck {
            environment: environment.into(),
            agent: "mine".into(),
            seed: 3,
            repeats,
        };
        let named = |agent: &str| Some(agent.to_owned());
        let one = [of("a", Repeats::Not), of("b", Repeats::Not)];
        let labelled = |_: &str| Some("My own".to_owned());
        assert_eq!(
            sentences(&one, Programs::All, labelled),
            ["Does not repeat with the same seed: `My own`."]
        );
        assert_eq!(
            sentences(&one, Programs::All, named),
            ["Does not repeat with the same seed: `mine`."]
        );
        assert!(sentences(&one, Programs::All, |_| None).is_empty());
        let three = [
            of("a", Repeats::ToTheBit(3)),
            of("b", Repeats::Unknown("it is slow".into())),
            RepeatCheck {
                agent: "other".into(),
                ..of("a", Repeats::ToTheBit(7))
            },
        ];
        let said = [
            "Repeats to the bit with the same seed: `mine` in `a`, `other`.",
            "Not known to repeat (it is slow): `mine` in `b`.",
        ];
        assert_eq!(sentences(&three, Programs::All, named), said);
        assert_eq!(sentences(&three, Programs::OnlyLacking, named), said[1..]);
    }
}
