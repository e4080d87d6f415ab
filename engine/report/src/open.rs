//! Open verdicts over all studies, each with the approximate effort that would decide it. The list shows where an hour
//! of computing is most informative.

use super::{
    effort::Effort,
    passed::Passed,
    sheet::{NONE, Sheet, SheetEntry, Tone},
    verdicts::Verdicts,
};
use analysis::claim::ClaimOutcome;
use document::count::duration;
use serde::Serialize;
use std::cmp::Ordering;

/// A judged verdict that is open, with its study.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OpenVerdict {
    /// Name of the study.
    pub study: String,
    /// The claim or published value, as in `claim 2: dsac.success >= 0.8 in four_cells`.
    pub about: String,
    /// The word of the verdict.
    pub verdict: String,
    /// Effort that would decide it; `None` where no affordable number of seeds would, or where a design has looks
    /// left.
    pub would_decide: Option<Effort>,
}

impl OpenVerdict {
    fn of(study: &Verdicts, passed: &Passed) -> Self {
        Self {
            study: study.study.clone(),
            about: passed.about.clone(),
            verdict: passed.in_all().to_owned(),
            would_decide: passed.would_decide,
        }
    }
}

/// All judged verdicts that are open in these studies, the cheapest to decide first.
#[must_use]
pub fn still_open<'a>(studies: impl IntoIterator<Item = &'a Verdicts>) -> Vec<OpenVerdict> {
    let of_study = |study: &'a Verdicts| {
        let open = study
            .verdicts
            .iter()
            .filter(|it| it.is_judged() && !it.is_decided());
        open.map(|passed| OpenVerdict::of(study, passed))
    };
    let mut open: Vec<OpenVerdict> = studies.into_iter().flat_map(of_study).collect();
    open.sort_by(|one, other| cheaper(one.would_decide, other.would_decide));
    open
}

/// Order by time; verdicts without a known effort come last.
fn cheaper(one: Option<Effort>, other: Option<Effort>) -> Ordering {
    let seconds = |effort: Option<Effort>| effort.map_or(f64::INFINITY, |it| it.trial_time_s);
    seconds(one).total_cmp(&seconds(other))
}

/// Counts of judged and of decided values and claims.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Decided {
    /// Number of judged values and claims.
    pub judged: usize,
    /// Number of decided values and claims.
    pub decided: usize,
    /// Number of decided ones that rest on several rounds of seeds.
    pub confirmed: usize,
    /// Number of those that are decided as EQUIVALENT: neither side is ahead by an amount that matters.
    pub equivalent: usize,
}

impl Decided {
    /// Counts over all these studies.
    #[must_use]
    pub fn of<'a>(studies: impl IntoIterator<Item = &'a Verdicts>) -> Self {
        let verdicts = studies.into_iter().flat_map(|study| &study.verdicts);
        let judged: Vec<&Passed> = verdicts.filter(|it| it.is_judged()).collect();
        let decided: Vec<&Passed> = judged.iter().copied().filter(|it| it.is_decided()).collect();
        let is_equivalent = |it: &&&Passed| it.verdict == ClaimOutcome::Equivalent.word();
        Self {
            judged: judged.len(),
            decided: decided.len(),
            confirmed: decided.iter().filter(|it| it.rounds.len() > 1).count(),
            equivalent: decided.iter().filter(is_equivalent).count(),
        }
    }

    /// The counts in one sentence, as in `132 of 217 values and claims that are judged are decided (60 %).`
    #[must_use]
    pub fn in_words(self) -> String {
        let Self {
            judged,
            decided,
            confirmed,
            equivalent,
        } = self;
        let alike = match equivalent {
            0 => String::new(),
            some => format!("; EQUIVALENT are {some} of them"),
        };
        let later = match confirmed {
            0 => String::new(),
            some => format!(", {some} of them by several rounds of seeds"),
        };
        match judged {
            0 => "Nothing is judged.".into(),
            _ => {
                let percent = 100 * decided / judged;
                format!(
                    "{decided} of {judged} values and claims that are judged are decided ({percent} %){later}{alike}."
                )
            }
        }
    }
}

/// The open verdicts as a table; `None` where there is none.
pub(super) fn sheet(open: &[OpenVerdict]) -> Option<Sheet> {
    let row = |it: &OpenVerdict| {
        let effort = it.would_decide;
        let [seeds, time] = match effort {
            Some(effort) => [effort.seeds.to_string(), duration(effort.trial_time_s)],
            None => [NONE, NONE].map(Into::into),
        };
        let about = SheetEntry::of(Tone::Code, it.about.clone());
        vec![
            SheetEntry::plain(it.study.clone()),
            about,
            SheetEntry::plain(seeds),
            SheetEntry::plain(time),
        ]
    };
    (!open.is_empty()).then(|| Sheet {
        head: ["study", "open", "fresh seeds", "their trials"].map(String::from).into(),
        words: 2,
        rows: open.iter().map(row).collect(),
        notes: vec![
            "So many seeds that nobody has seen (a round of `confirm`) would decide with a probability of 80 %, if mean and \
             spread stay as they are; – where no affordable number would, where a design has looks left, and \
             where that is not known. Fewer that are added to those of a study would do, too, were they not added \
             because of what was seen. Times are those of trials, each on one core, with what they take from others; \
             one seed may serve several lines."
                .into(),
        ],
        ..Sheet::default()
    })
}

/// The open verdicts as a table in Markdown, each with the effort that would decide it; empty where there is none.
#[must_use]
pub fn open_as_markdown(open: &[OpenVerdict]) -> String {
    sheet(open).map_or_else(String::new, |sheet| sheet.markdown())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rounds::RoundVerdict;

    fn passed(about: &str, verdict: &str, effort: Option<(u32, f64)>) -> Passed {
        Passed {
            about: about.into(),
            verdict: verdict.into(),
            would_decide: effort.map(|(seeds, trial_time_s)| Effort { seeds, trial_time_s }),
            ..Passed::default()
        }
    }

    fn study(name: &str, verdicts: &[Passed]) -> Verdicts {
        Verdicts {
            study: name.into(),
            judged: verdicts.len(),
            decided: verdicts.iter().filter(|it| it.is_decided()).count(),
            verdicts: verdicts.to_vec(),
            ..Verdicts::default()
        }
    }

    #[test]
    fn what_is_cheapest_to_decide_stands_first_and_what_nothing_decides_last() {
        let exploratory = Passed {
            exploratory: true,
            ..passed("claim 4", "INCONCLUSIVE", Some((1, 0.1)))
        };
        let studies = [
            study(
                "one",
                &[
                    passed("claim 1", "INCONCLUSIVE", None),
                    passed("claim 2", "INCONCLUSIVE", Some((40, 90.0))),
                    passed("claim 3", "SUPPORTED", None),
                ],
            ),
            study(
                "two",
                &[passed("t: a", "INCONCLUSIVE", Some((3, 5400.0))), exploratory],
            ),
        ];
        let open = still_open(&studies);
        let names: Vec<(&str, &str)> = open
            .iter()
            .map(|it| (it.study.as_str(), it.about.as_str()))
            .collect();
        assert_eq!(names, [("one", "claim 2"), ("two", "t: a"), ("one", "claim 1")]);
        let text = open_as_markdown(&open);
        for line in [
            "| study | open | fresh seeds | their trials |",
            "| one | `claim 2` | 40 | 2 min |",
            "| two | `t: a` | 3 | 1.5 h |",
            "| one | `claim 1` | – | – |",
        ] {
            assert!(text.contains(line), "{line}\n{text}");
        }
        assert_eq!(open_as_markdown(&[]), "");
    }

    #[test]
    fn the_share_of_what_is_decided_is_of_what_is_judged() {
        let verdicts = ["SUPPORTED", "REFUTED", "INCONCLUSIVE"].map(|word| passed("claim", word, None));
        let studies = [study("one", &verdicts), study("two", &[])];
        assert_eq!(
            Decided::of(&studies).in_words(),
            "2 of 3 values and claims that are judged are decided (66 %)."
        );
        assert_eq!(Decided::of(&studies[1..]).in_words(), "Nothing is judged.");
    }

    #[test]
    fn what_is_decided_as_alike_is_told_apart() {
        let verdicts = ["SUPPORTED", "EQUIVALENT", "INCONCLUSIVE"].map(|word| passed("claim", word, None));
        assert_eq!(
            Decided::of(&[study("one", &verdicts)]).in_words(),
            "2 of 3 values and claims that are judged are decided (66 %); EQUIVALENT are 1 of them."
        );
    }

    #[test]
    fn verdicts_of_several_rounds_are_told() {
        let rounds = vec![RoundVerdict::default(), RoundVerdict::default()];
        let both = Passed {
            rounds,
            ..passed("claim 1: a > b", "SUPPORTED", None)
        };
        let studies = [study("one", &[both, passed("claim 2: b > c", "REFUTED", None)])];
        assert_eq!(
            Decided::of(&studies).in_words(),
            "2 of 2 values and claims that are judged are decided (100 %), 1 of them by several rounds of seeds."
        );
    }
}
