//! Verdicts that a report passes, each on a published value or a claim.

use super::{
    claim_line::{ClaimLine, UNREAD},
    effort::Effort,
    rounds::RoundVerdict,
};
use analysis::{claim::ClaimOutcome, results::Results};
use presentation::table::{Grid, TableSpec};
use serde::{Deserialize, Serialize};
use statistics::{Judgement, Verdict};

/// Word for published values of a table that could not be made.
const NOT_MADE: &str = "NOT MADE";

/// Verdict on a published value or a claim.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Passed {
    /// The published value or claim, as in `table-3.2: four_cells, dsac` or `claim 2: dsac.success >= 0.8 in
    /// four_cells`.
    pub about: String,
    /// The same with the column, for a value in a table that shows only one column.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_full: Option<String>,
    /// Word for this value or claim alone.
    pub verdict: String,
    /// Word with all of its family taken together (Holm), where it differs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub together: Option<String>,
    /// The strictest share of its level at which it is still decided; absent where it is open.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strictest: Option<f64>,
    /// Whether it was chosen after results were seen.
    #[serde(default)]
    pub exploratory: bool,
    /// Cause of a difference or refutation, as the study states it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// Approximate effort that would decide an open one. `None` if no affordable number of seeds would, or if a design
    /// has looks left, since its looks determine when to continue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub would_decide: Option<Effort>,
    /// The verdict of each round of seeds alone, where there are several.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rounds: Vec<RoundVerdict>,
}

impl Passed {
    /// Whether the seeds were meant to decide it: it was planned, no choice was made by it, its trials have run and
    /// learned, and it is not fixed by construction. A failed or unreadable one counts as judged and not decided.
    #[must_use]
    pub fn is_judged(&self) -> bool {
        let unasked = [
            Verdict::Calibrated.word(),
            Verdict::NotJudged.word(),
            ClaimOutcome::NotLearned.word(),
            Verdict::NotTrained.word(),
            Verdict::NotRun.word(),
        ];
        !self.exploratory && !unasked.contains(&self.verdict.as_str())
    }

    /// Whether the seeds decide against it.
    #[must_use]
    pub fn differs(&self) -> bool {
        [Verdict::Differs.word(), ClaimOutcome::Refuted.word()].contains(&self.verdict.as_str())
    }

    /// Word with all verdicts of the study taken together (Holm).
    #[must_use]
    pub fn in_all(&self) -> &str {
        self.together.as_ref().unwrap_or(&self.verdict)
    }

    /// Whether the seeds decide it, either way, with all verdicts of its family taken together.
    #[must_use]
    pub fn is_decided(&self) -> bool {
        self.is_decided_alone() && self.together.is_none()
    }

    /// Whether the seeds decide it, either way, at its own level.
    #[must_use]
    pub fn is_decided_alone(&self) -> bool {
        let settled = [
            Verdict::Reproduced.word(),
            ClaimOutcome::Supported.word(),
            ClaimOutcome::Equivalent.word(),
        ];
        self.differs() || settled.contains(&self.verdict.as_str())
    }
}

/// All words that a verdict may have, each once.
pub(super) fn words() -> Vec<&'static str> {
    let mut words: Vec<&'static str> = Vec::new();
    let all = Verdict::ALL.map(Verdict::word).into_iter();
    for word in all
        .chain(ClaimOutcome::ALL.map(ClaimOutcome::word))
        .chain([UNREAD, NOT_MADE])
    {
        if !words.contains(&word) {
            words.push(word);
        }
    }
    words
}

pub(super) fn of_table(name: &str, grid: &Grid, results: &Results) -> Vec<Passed> {
    let mut passed = Vec::new();
    for (index, (row, cells)) in grid.rows.iter().zip(&grid.cells).enumerate() {
        for (column, cell) in grid.columns.iter().zip(cells) {
            let Some(judgement) = &cell.judgement else {
                continue;
            };
            let verdict = judgement.verdict;
            let together = judgement.adjusted.filter(|adjusted| *adjusted != verdict);
            let in_full = format!("{name}: {}, {}", row.name, column.name);
            let shows_one = grid.columns.len() == 1;
            let cause = grid.cause(index).filter(|_| verdict == Verdict::Differs);
            passed.push(Passed {
                about: if shows_one {
                    format!("{name}: {}", row.name)
                } else {
                    in_full.clone()
                },
                in_full: shows_one.then_some(in_full),
                verdict: verdict.word().into(),
                together: together.map(|it| it.word().into()),
                strictest: judgement.strictest,
                exploratory: grid.is_exploratory(cell),
                cause: cause.map(Into::into),
                would_decide: seeds_to_decide(judgement).map(|n| Effort::of(n, &cell.rests_on, results)),
                rounds: Vec::new(),
            });
        }
    }
    passed
}

/// The verdict on the published values of a table that could not be made, so that they are not left out.
pub(super) fn not_made(name: &str, spec: &TableSpec) -> Option<Passed> {
    let is_published = !spec.published.is_empty() || !spec.published_curves.is_empty();
    is_published.then(|| Passed {
        about: name.into(),
        verdict: NOT_MADE.into(),
        exploratory: spec.exploratory,
        ..Passed::default()
    })
}

pub(super) fn of_claim(line: &ClaimLine, results: &Results) -> Passed {
    Passed {
        about: format!("claim {}: {}", line.number, line.in_place()),
        in_full: None,
        verdict: line.word().into(),
        together: line.together().map(|outcome| outcome.word().into()),
        strictest: line.verdict.as_ref().ok().and_then(|claim| claim.strictest),
        exploratory: line.is_exploratory(),
        cause: line.cause().map(Into::into),
        would_decide: line
            .seeds_to_decide()
            .map(|n| Effort::of(n, &line.rests_on, results)),
        rounds: line.rounds.clone(),
    }
}

/// Approximate number of fresh seeds that would decide an open published value.
fn seeds_to_decide(judgement: &Judgement) -> Option<u32> {
    let is_last = judgement.stage.is_none_or(|stage| stage.is_last());
    let open = judgement.verdict == Verdict::Inconclusive && is_last;
    let more = judgement.more_seeds.filter(|_| open)?;
    u32::try_from(judgement.n).ok().map(|n| n + more)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passed(verdict: &str, exploratory: bool) -> Passed {
        Passed {
            verdict: verdict.into(),
            exploratory,
            ..Passed::default()
        }
    }

    #[test]
    fn every_word_is_judged_or_not_and_decided_or_not() {
        let words = words();
        let those = |is: fn(&Passed) -> bool| {
            let found = words.iter().copied().filter(|word| is(&passed(word, false)));
            found.collect::<Vec<&str>>()
        };
        assert_eq!(those(Passed::differs), ["DIFFERS", "REFUTED"]);
        assert_eq!(
            those(Passed::is_decided),
            ["REPRODUCED", "DIFFERS", "SUPPORTED", "REFUTED", "EQUIVALENT"]
        );
        let judged = those(Passed::is_judged);
        let open = [
            "INCONCLUSIVE",
            "NOT AT THIS BUDGET",
            "DIRECTION ONLY",
            "FAILED",
            "NOT READ",
            "NOT MADE",
        ];
        assert!(
            open.iter()
                .chain(&those(Passed::is_decided))
                .all(|word| judged.contains(word))
        );
        let unasked = [
            "CALIBRATED",
            "NOT JUDGED",
            "NOT LEARNED",
            "NOT TRAINED",
            "NOT RUN",
        ];
        assert!(unasked.iter().all(|word| !judged.contains(word)));
        assert!(!passed("DIFFERS", true).is_judged());
    }
}
