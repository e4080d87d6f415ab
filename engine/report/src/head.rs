//! The counts at the head of a report.

use super::{Contents, Counts, StudyInfo};

/// A line of the head: a quantity, and the number of each word that occurs.
pub(super) struct CountLine {
    /// The quantity that is counted.
    pub(super) what: String,
    /// Words with their numbers, all above 0.
    pub(super) words: Counts,
}

/// Counts of published values and claims, taken together (Holm), one by one if those differ, and of exploratory ones.
/// Words without a count are left out, and so is everything if nothing is judged.
pub(super) fn lines(study: &StudyInfo, contents: &Contents) -> Vec<CountLine> {
    if study.is_rehearsal {
        return Vec::new();
    }
    let published = Families {
        alone: contents.verdicts(false),
        together: contents.verdicts_together(),
        exploratory: contents.verdicts(true),
    };
    let claims = Families {
        alone: contents.outcomes(false),
        together: contents.outcomes_together(),
        exploratory: contents.outcomes(true),
    };
    published
        .lines("Published values")
        .into_iter()
        .chain(claims.lines("Claims"))
        .collect()
}

/// Counts of one quantity in three ways.
struct Families {
    alone: Counts,
    together: Counts,
    exploratory: Counts,
}

impl Families {
    /// The line for all verdicts taken together, then the line for single verdicts if it differs.
    fn lines(self, what: &str) -> Vec<CountLine> {
        let differs = self.together != self.alone;
        let named = if differs {
            format!("{what}, all together (Holm)")
        } else {
            what.to_owned()
        };
        let mut lines = vec![CountLine {
            what: named,
            words: self.together,
        }];
        if differs {
            lines.push(CountLine {
                what: format!("{what}, one by one"),
                words: self.alone,
            });
        }
        lines.push(CountLine {
            what: format!("{what}, exploratory"),
            words: self.exploratory,
        });
        lines.retain(|line| !line.words.is_empty());
        lines
    }
}
