//! The counts at the head of a report.

use super::Contents;

/// A line of the head: what is counted, and how many there are of each word that occurs.
pub(super) struct Counts {
    /// What is counted.
    pub(super) what: &'static str,
    /// Words with their numbers, none of them 0.
    pub(super) words: Vec<(&'static str, usize)>,
}

/// The lines of the head, in order; what does not occur is left out.
pub(super) fn counts(contents: &Contents) -> Vec<Counts> {
    let lines = [("Published values", contents.verdicts().to_vec()), ("Claims", contents.outcomes().to_vec())];
    let present = |(what, mut words): (&'static str, Vec<(&'static str, usize)>)| {
        words.retain(|(_, n)| *n > 0);
        (!words.is_empty()).then_some(Counts { what, words })
    };
    lines.into_iter().filter_map(present).collect()
}
