//! The counts at the head of a report.

use super::{Contents, Counts};
use crate::statistics::{ClaimOutcome, Verdict};

/// A line of the head: what is counted, and how many there are of each word that occurs.
pub(super) struct Line {
    /// What is counted.
    pub(super) what: String,
    /// Words with their numbers, none of them 0.
    pub(super) words: Counts,
}

/// Published values and claims, taken together (Holm) and one by one where that differs, and what is exploratory; what does not
/// occur is left out.
pub(super) fn lines(contents: &Contents) -> Vec<Line> {
    let judged: Vec<&str> = Verdict::ALL.into_iter().filter(|it| it.is_judged()).map(Verdict::word).collect();
    let published = Families {
        alone: contents.verdicts(false),
        together: together(contents.verdicts(false), contents.adjusted_verdicts(), &judged),
        exploratory: contents.verdicts(true),
    };
    let judged: Vec<&str> = ClaimOutcome::ALL.into_iter().filter(|it| it.is_judged()).map(ClaimOutcome::word).collect();
    let claims = Families {
        alone: contents.outcomes(false),
        together: together(contents.outcomes(false), contents.adjusted_outcomes(), &judged),
        exploratory: contents.outcomes(true),
    };
    published.lines("Published values").into_iter().chain(claims.lines("Claims")).collect()
}

/// Adjusted counts of what is judged, and the counts of everything else as they are.
fn together(all: Counts, adjusted: Counts, judged: &[&str]) -> Counts {
    adjusted.into_iter().chain(all.into_iter().filter(|(word, _)| !judged.contains(word))).collect()
}

/// The same things, counted in three ways.
struct Families {
    alone: Counts,
    together: Counts,
    exploratory: Counts,
}

impl Families {
    /// Together first, one by one only where that is another.
    fn lines(self, what: &str) -> Vec<Line> {
        let differs = self.together != self.alone;
        let named = if differs { format!("{what}, all together (Holm)") } else { what.to_owned() };
        let mut lines = vec![Line { what: named, words: self.together }];
        if differs {
            lines.push(Line { what: format!("{what}, one by one"), words: self.alone });
        }
        lines.push(Line { what: format!("{what}, exploratory"), words: self.exploratory });
        lines.retain(|line| !line.words.is_empty());
        lines
    }
}
