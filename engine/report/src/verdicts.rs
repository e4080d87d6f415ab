//! `verdicts.json` of a folder of results: all verdicts of a report, for programs that watch many folders.

use super::{
    basis::basis,
    contents::Contents,
    passed::{Passed, not_made, of_claim, of_table},
    sentence::{filled, sentence},
    study_info::StudyInfo,
};
use analysis::{claim::ClaimOutcome, results::Results, training_share};
use contract::trial_result::TrialResult;
use presentation::{answers::Answer, summary::PlaceholderTarget};
use serde::{Deserialize, Serialize};
use statistics::TrainingShare;

/// The verdicts of a report, and their numbers.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Verdicts {
    /// Name of the study.
    pub study: String,
    /// Title of the study.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub title: String,
    /// Summary of the study, in its own sentence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub summary: Option<String>,
    /// Its lines in the answers of all studies.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub answers: Vec<AnswerLine>,
    /// The smallest share of the source's training behind its trials, as in `3.2 %`, where the study states the
    /// source's training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training_share: Option<String>,
    /// The verdicts that are read together with those of this study; its own alone where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub family: Option<String>,
    /// Number of trials that ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trials: Option<usize>,
    /// Wall-clock time of these trials in seconds, rounded to tenths.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trial_time_s: Option<f64>,
    /// Plugins with another version in the trials than in the program, as in `environment battery 1, now 2`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub earlier_versions: Vec<String>,
    /// Keys of the study that had other values when the trials ran.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changed_settings: Vec<String>,
    /// Line on allowed and used seeds, and on exploratory parts.
    pub basis: String,
    /// Number of published values and claims that the seeds were to decide.
    pub judged: usize,
    /// Number of those that are decided, either way.
    pub decided: usize,
    /// Number of those that differ or are refuted.
    pub differing: usize,
    /// Number of verdicts that were chosen after results were seen; the other numbers leave them out.
    pub exploratory: usize,
    /// All verdicts, those on tables first.
    pub verdicts: Vec<Passed>,
}

impl Verdicts {
    /// Collects the verdicts of a report.
    #[must_use]
    pub fn of(study: &StudyInfo, results: &Results, contents: &Contents) -> Self {
        let tables = study.tables.iter().zip(&contents.tables);
        let values = tables.flat_map(|((name, spec), (_, grid))| match grid {
            Ok(grid) => of_table(name, grid, results),
            Err(_) => not_made(name, spec).into_iter().collect(),
        });
        let verdicts: Vec<Passed> = values
            .chain(contents.claims.iter().map(|line| of_claim(line, results)))
            .collect();
        let count = |counts: &dyn Fn(&Passed) -> bool| verdicts.iter().filter(|it| counts(it)).count();
        let cost = contents.cost(results);
        let all: Vec<&TrialResult> = results.trials.iter().collect();
        Self {
            study: study.name.clone(),
            title: study.title.clone(),
            family: study.family.clone(),
            summary: sentence(study, contents),
            answers: AnswerLine::of(study, contents, &verdicts),
            training_share: training_share::behind(&all, results).map(TrainingShare::percent),
            trials: Some(cost.trials),
            trial_time_s: Some((10.0 * cost.seconds).round() / 10.0),
            earlier_versions: study.earlier_versions.clone(),
            changed_settings: study.changed_settings.clone(),
            basis: basis(study, results, contents),
            judged: count(&Passed::is_judged),
            decided: count(&|it| it.is_judged() && it.is_decided()),
            differing: count(&|it| it.is_judged() && it.is_decided() && it.differs()),
            exploratory: count(&|it| it.exploratory),
            verdicts,
        }
    }
}

/// A line of the answers.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AnswerLine {
    /// The item of the source; empty for a question that is not a printed item.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub item: String,
    /// The source's statement there, or the question.
    pub printed: String,
    /// The finding, in words and values.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub here: String,
    /// Places of its verdicts among those of the study.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lines: Vec<usize>,
    /// Difference of the system from that of the source; empty if it is the same.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub system: String,
}

impl AnswerLine {
    /// The answer lines of a study; none under the profile for trying it out.
    fn of(study: &StudyInfo, contents: &Contents, verdicts: &[Passed]) -> Vec<Self> {
        let answers = study.answers.iter().filter(|_| !study.is_rehearsal);
        let line = |answer: &Answer| Self {
            item: answer.text.item.clone(),
            printed: answer.text.printed.clone(),
            here: filled(&answer.here, contents),
            lines: answer.by.iter().flat_map(|asks| places(asks, verdicts)).collect(),
            system: answer.text.system.clone(),
        };
        answers.map(line).collect()
    }

    /// The answer, from the verdicts of its study; `None` where the line has none.
    #[must_use]
    pub fn word(&self, study: &Verdicts) -> Option<Word> {
        let lines = self.lines.iter().filter_map(|&at| study.verdicts.get(at));
        Word::of(&lines.collect::<Vec<_>>(), study.training_share.is_some())
    }
}

/// The places of the verdicts on a claim, or on a value of a table.
fn places(asks: &PlaceholderTarget, verdicts: &[Passed]) -> Vec<usize> {
    let is_meant = |passed: &Passed| match asks {
        PlaceholderTarget::Claim(number) => passed.about.starts_with(&format!("claim {number}: ")),
        PlaceholderTarget::Cell { table, place, .. } => {
            let name = format!("{table}: {place}");
            passed.about == name || passed.in_full.as_ref() == Some(&name)
        }
    };
    let all = verdicts.iter().enumerate();
    all.filter(|(_, passed)| is_meant(passed))
        .map(|(at, _)| at)
        .collect()
}

/// Answer in a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Word {
    /// All values and claims of the line hold.
    Yes,
    /// Some of them hold, and the others do not or are open.
    Partly,
    /// Some of them do not hold, and none holds.
    No,
    /// Nothing is decided, and the training was much shorter than that of the source.
    NotAtThisBudget,
    /// Nothing is decided.
    Open,
}

impl Word {
    /// All words, in the order of their declaration.
    pub const ALL: [Self; 5] = [
        Self::Yes,
        Self::Partly,
        Self::No,
        Self::NotAtThisBudget,
        Self::Open,
    ];

    /// The word for some verdicts; `None` without verdicts. `is_short` is true if the source trained for longer.
    fn of(lines: &[&Passed], is_short: bool) -> Option<Self> {
        if lines.is_empty() {
            return None;
        }
        let equivalent = ClaimOutcome::Equivalent.word();
        let is = |word: &str| lines.iter().any(|it| it.in_all() == word);
        let decided = lines.iter().filter(|it| it.is_decided());
        let small = decided.clone().filter(|it| it.verdict == equivalent).count();
        let fails = decided.clone().filter(|it| it.differs()).count();
        let holds = decided.count() - small - fails;
        // A small difference may become a large one after longer training.
        let against = if is_short { fails } else { fails + small };
        let may_come = is_short && (small > 0 || is(ClaimOutcome::NotLearned.word()));
        Some(match (holds, against) {
            (holds, 0) if holds == lines.len() => Self::Yes,
            (0, 0) if may_come || is(ClaimOutcome::NotAtThisBudget.word()) => Self::NotAtThisBudget,
            (0, 0) => Self::Open,
            (0, _) => Self::No,
            _ => Self::Partly,
        })
    }

    /// The word as text.
    #[must_use]
    pub fn text(self) -> &'static str {
        self.written().0
    }

    /// The word as text, and the verdict whose colour it has.
    pub(super) fn written(self) -> (&'static str, &'static str) {
        match self {
            Self::Yes => ("yes", ClaimOutcome::Supported.word()),
            Self::Partly => ("partly", ClaimOutcome::DirectionOnly.word()),
            Self::No => ("no", ClaimOutcome::Refuted.word()),
            Self::NotAtThisBudget => ("not at this budget", ClaimOutcome::NotAtThisBudget.word()),
            Self::Open => ("cannot be said", ClaimOutcome::Inconclusive.word()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passed(about: &str, verdict: &str) -> Passed {
        Passed {
            about: about.into(),
            verdict: verdict.into(),
            ..Passed::default()
        }
    }

    fn word(verdicts: &[&str]) -> Option<&'static str> {
        let study = Verdicts {
            verdicts: verdicts.iter().map(|word| passed("", word)).collect(),
            training_share: Some("1.3 %".into()),
            ..Verdicts::default()
        };
        let answered = AnswerLine {
            lines: (0..verdicts.len()).collect(),
            ..AnswerLine::default()
        };
        answered.word(&study).map(|word| word.written().0)
    }

    #[test]
    fn the_answer_follows_from_the_verdicts() {
        assert_eq!(word(&[]), None);
        assert_eq!(word(&["SUPPORTED", "REPRODUCED"]), Some("yes"));
        assert_eq!(word(&["SUPPORTED", "INCONCLUSIVE"]), Some("partly"));
        assert_eq!(word(&["SUPPORTED", "REFUTED"]), Some("partly"));
        assert_eq!(word(&["REFUTED", "INCONCLUSIVE"]), Some("no"));
        assert_eq!(word(&["DIFFERS"]), Some("no"));
        assert_eq!(word(&["EQUIVALENT"]), Some("not at this budget"));
        assert_eq!(Word::of(&[&passed("", "EQUIVALENT")], false), Some(Word::No));
        assert_eq!(
            word(&["NOT AT THIS BUDGET", "INCONCLUSIVE"]),
            Some("not at this budget")
        );
        assert_eq!(word(&["NOT LEARNED"]), Some("not at this budget"));
        assert_eq!(
            word(&["CALIBRATED", "NOT JUDGED", "DIRECTION ONLY"]),
            Some("cannot be said")
        );
        let falls = Passed {
            together: Some("INCONCLUSIVE".into()),
            ..passed("", "SUPPORTED")
        };
        assert_eq!(Word::of(&[&falls], true), Some(Word::Open));
        assert_eq!(Word::of(&[&passed("", "NOT LEARNED")], false), Some(Word::Open));
    }

    #[test]
    fn claims_and_values_are_found_among_the_verdicts() {
        let verdicts = [
            passed("t: a, b", "REPRODUCED"),
            Passed {
                in_full: Some("u: a, b".into()),
                ..passed("u: a", "DIFFERS")
            },
            passed("claim 1: a.x > b.x in one", "SUPPORTED"),
            passed("claim 1: a.x > b.x in two", "REFUTED"),
            passed("claim 12: a.x > c.x", "REFUTED"),
        ];
        let found = |text: &str| places(&presentation::summary::Summary::asks(text).unwrap(), &verdicts);
        assert_eq!(found("claim 1"), [2, 3]);
        assert_eq!(found("claim 2"), [0; 0]);
        assert_eq!(found("t: a, b"), [0]);
        assert_eq!(found("u: a"), [1]);
        assert_eq!(found("u: a, b"), [1]);
    }
}
