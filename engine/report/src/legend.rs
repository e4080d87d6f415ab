//! The meaning of a report's verdicts.

use super::{Contents, UNREAD};
use analysis::claim::ClaimOutcome;
use statistics::Verdict;

/// The words that occur in a report, each with its meaning.
pub(super) fn entries(contents: &Contents) -> Vec<(&'static str, &'static str)> {
    let counted = [
        contents.verdicts(false),
        contents.verdicts(true),
        contents.outcomes(false),
        contents.outcomes(true),
    ];
    let occurs = |word: &str| counted.iter().flatten().any(|(it, _)| *it == word);
    super::passed::words()
        .into_iter()
        .filter(|word| occurs(word))
        .map(|word| (word, meaning(word)))
        .collect()
}

/// The meaning of a word; empty for words that are no verdicts.
fn meaning(word: &str) -> &'static str {
    let value = Verdict::ALL.into_iter().find(|verdict| verdict.word() == word);
    let claim = ClaimOutcome::ALL
        .into_iter()
        .find(|outcome| outcome.word() == word);
    match (value, claim) {
        (Some(verdict), _) => of_value(verdict),
        (None, Some(outcome)) => of_claim(outcome),
        (None, None) if word == UNREAD => "The claim cannot be read.",
        (None, None) => "The table could not be made.",
    }
}

fn of_value(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Reproduced => "The whole 90 % interval lies within the margin around the published value.",
        Verdict::Differs => "The whole 90 % interval lies outside the margin around the published value.",
        Verdict::NotAtThisBudget => {
            "It does not hold after less than half of the source's training, which says nothing against the source."
        }
        Verdict::Inconclusive => {
            "The interval lies on both sides of an edge, or there are fewer than three seeds."
        }
        Verdict::Calibrated => {
            "It agrees, but a setting was chosen by it, so that the agreement says nothing."
        }
        Verdict::NotJudged => "It is so by construction, it is of another system, or this is no result.",
        Verdict::NotTrained => "An agent behind it made no update.",
        Verdict::NotRun => "There is no seed yet.",
        Verdict::Failed => "No seed ended well.",
    }
}

fn of_claim(outcome: ClaimOutcome) -> &'static str {
    match outcome {
        ClaimOutcome::Supported => {
            "The whole interval of the difference lies on the claimed side, and beyond what matters."
        }
        ClaimOutcome::Refuted => "The whole interval of the difference lies on the other side.",
        ClaimOutcome::Equivalent => "The whole interval is smaller than the difference that matters.",
        ClaimOutcome::DirectionOnly => {
            "The whole interval lies on the claimed side, and part of it is smaller than what matters."
        }
        ClaimOutcome::NotLearned => {
            "It compares trained agents none of which is better than those that learned nothing."
        }
        ClaimOutcome::NotAtThisBudget => of_value(Verdict::NotAtThisBudget),
        ClaimOutcome::Inconclusive => of_value(Verdict::Inconclusive),
        ClaimOutcome::Calibrated => of_value(Verdict::Calibrated),
        ClaimOutcome::NotJudged => of_value(Verdict::NotJudged),
        ClaimOutcome::NotTrained => of_value(Verdict::NotTrained),
        ClaimOutcome::NotRun => of_value(Verdict::NotRun),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_has_a_meaning_of_its_own_or_that_of_its_namesake() {
        let words = super::super::passed::words();
        let meanings: std::collections::BTreeSet<&str> = words.iter().map(|word| meaning(word)).collect();
        assert!(meanings.iter().all(|meaning| meaning.ends_with('.')));
        assert_eq!(meanings.len(), words.len());
    }
}
