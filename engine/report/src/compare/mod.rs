//! Two sets of results side by side: moved values, changed verdicts, and differing settings.
//!
//! Everything is a pure function of two [`Side`]s, in the order of their tables' and keys' names, so that the same
//! results give the same text.

mod difference;
mod render;
mod settings;
mod side;

pub use difference::{Basis, Difference, Fate, LEVEL};
pub use render::{markdown, text};
pub use settings::{changed_keys, flat};
pub use side::{CellAddress, CellValues, Side, parse_study};

use crate::Passed;
use serde::Serialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Differences between two sides.
#[derive(Debug, Clone, Serialize)]
pub struct Compared {
    /// The first side, the earlier one as a rule.
    pub a: Named,
    /// The second side, the later one as a rule.
    pub b: Named,
    /// Number of cells by judgement.
    pub counts: Counts,
    /// Cells that both sides have a value of.
    pub cells: Vec<Pair>,
    /// Verdicts on published values that changed.
    pub verdicts: Vec<ChangedVerdict>,
    /// Verdicts on claims that changed; a claim is found by its words, not by its number.
    pub claims: Vec<ChangedVerdict>,
    /// Cells, verdicts and claims that one side has alone.
    pub only: Vec<OneSidedItem>,
    /// Keys of the resolved studies that differ.
    pub settings: Vec<Setting>,
}

/// Origin of the results on one side.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Named {
    /// Folder or study that they were read from.
    pub from: String,
    /// Name of the study.
    pub study: String,
    /// Options of the command line behind them.
    pub options: Vec<String>,
}

/// Number of cells by judgement, and number of verdicts compared.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Cells with the same bits for every seed.
    pub same: usize,
    /// Cells with 0 inside the interval of the difference.
    pub within: usize,
    /// Cells with 0 outside the interval of the difference.
    pub moved: usize,
    /// Cells with other values and no interval.
    pub undecided: usize,
    /// Verdicts and claims that both sides have.
    pub judged: usize,
}

/// A cell that both sides have.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pair {
    /// Place of the cell.
    #[serde(flatten)]
    pub place: CellAddress,
    /// Its values in the first side.
    pub a: CellValues,
    /// Its values in the second side.
    pub b: CellValues,
    /// The second less the first.
    #[serde(flatten)]
    pub difference: Difference,
}

/// A verdict with another word on the second side.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ChangedVerdict {
    /// The published value or claim.
    pub about: String,
    /// Its word on the first side, with the word of all verdicts together (Holm) where that differs.
    pub a: String,
    /// Its word on the second side, in the same form.
    pub b: String,
}

/// A cell, verdict or claim that one side has alone.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct OneSidedItem {
    /// Side that has it, `a` or `b`.
    pub side: &'static str,
    /// `cell`, `verdict` or `claim`.
    pub kind: &'static str,
    /// Name of the cell, or words of the verdict or claim.
    pub what: String,
}

/// A key of the resolved study that differs; a side without the key has no value.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Setting {
    /// Dotted key in the resolved study.
    pub key: String,
    /// Its value in the first side.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub a: Option<Value>,
    /// Its value in the second side.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub b: Option<Value>,
}

impl Compared {
    /// Compares side `b` with side `a`.
    #[must_use]
    pub fn of(a: &Side, b: &Side) -> Self {
        let cells = pairs(a, b);
        let mut only = lonely_cells(a, b);
        let mut judged = 0;
        let [verdicts, claims] = [("verdict", false), ("claim", true)].map(|(kind, of_claims)| {
            let [a, b] = [a, b].map(|side| words(&side.verdicts, of_claims));
            judged += a.keys().filter(|about| b.contains_key(*about)).count();
            changed(kind, &a, &b, &mut only)
        });
        Self {
            a: a.named.clone(),
            b: b.named.clone(),
            counts: Counts {
                judged,
                ..Counts::of(&cells)
            },
            cells,
            verdicts,
            claims,
            only,
            settings: settings::differing(&a.settings, &b.settings),
        }
    }

    /// Whether the sides have no cell, verdict or claim in common.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty() && self.counts.judged == 0
    }

    /// Whether a value moved beyond its interval or a verdict changed.
    #[must_use]
    pub fn differs(&self) -> bool {
        self.counts.moved + self.verdicts.len() + self.claims.len() > 0
    }
}

impl Counts {
    fn of(cells: &[Pair]) -> Self {
        let count = |fate| cells.iter().filter(|pair| pair.difference.fate == fate).count();
        Self {
            same: count(Fate::Same),
            within: count(Fate::Within),
            moved: count(Fate::Moved),
            undecided: count(Fate::Undecided),
            judged: 0,
        }
    }
}

fn pairs(a: &Side, b: &Side) -> Vec<Pair> {
    let both = |(place, first): (&CellAddress, &CellValues)| {
        let second = b.cells.get(place)?;
        Some(Pair {
            place: place.clone(),
            difference: Difference::of(first, second)?,
            a: first.clone(),
            b: second.clone(),
        })
    };
    a.cells.iter().filter_map(both).collect()
}

/// Cells with a value on one side alone.
fn lonely_cells(a: &Side, b: &Side) -> Vec<OneSidedItem> {
    let valued = |side: &Side| {
        let cells = side.cells.iter().filter(|(_, cell)| cell.value.is_some());
        cells.map(|(place, _)| place.to_string()).collect::<BTreeSet<_>>()
    };
    let (of_a, of_b) = (valued(a), valued(b));
    let alone = |side, own: &BTreeSet<String>, others: &BTreeSet<String>| {
        let lonely = |what: &String| OneSidedItem {
            side,
            kind: "cell",
            what: what.clone(),
        };
        own.difference(others).map(lonely).collect::<Vec<_>>()
    };
    [alone("a", &of_a, &of_b), alone("b", &of_b, &of_a)].concat()
}

/// Words of verdicts by their value or claim. Repeated ones have a number behind them.
fn words(verdicts: &[Passed], of_claims: bool) -> BTreeMap<String, String> {
    let mut words = BTreeMap::new();
    for passed in verdicts {
        let claim = claim(&passed.about);
        if claim.is_some() != of_claims {
            continue;
        }
        let about = claim.unwrap_or(&passed.about);
        let together = passed.together.iter().map(|word| format!(" (Holm: {word})"));
        let word: String = std::iter::once(passed.verdict.clone()).chain(together).collect();
        let name = (1..).map(|n| {
            if n == 1 {
                about.to_owned()
            } else {
                format!("{about} ({n})")
            }
        });
        let free = name.into_iter().find(|name| !words.contains_key(name));
        words.insert(free.unwrap_or_default(), word);
    }
    words
}

/// The words of a claim behind its number; `None` for a verdict on a published value.
fn claim(about: &str) -> Option<&str> {
    let (number, words) = about.strip_prefix("claim ")?.split_once(": ")?;
    number.bytes().all(|byte| byte.is_ascii_digit()).then_some(words)
}

fn changed(
    kind: &'static str,
    a: &BTreeMap<String, String>,
    b: &BTreeMap<String, String>,
    only: &mut Vec<OneSidedItem>,
) -> Vec<ChangedVerdict> {
    for (side, own, other) in [("a", a, b), ("b", b, a)] {
        let alone = own.keys().filter(|about| !other.contains_key(*about));
        only.extend(alone.map(|about| OneSidedItem {
            side,
            kind,
            what: about.clone(),
        }));
    }
    let both = a
        .iter()
        .filter_map(|(about, first)| Some((about, first, b.get(about)?)));
    both.filter(|(_, first, second)| first != second)
        .map(|(about, first, second)| ChangedVerdict {
            about: about.clone(),
            a: first.clone(),
            b: second.clone(),
        })
        .collect()
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

    fn side(verdicts: Vec<Passed>) -> Side {
        Side {
            verdicts,
            ..Side::default()
        }
    }

    #[test]
    fn claims_are_found_by_their_words_and_values_by_their_places() {
        let a = side(vec![
            passed("table: x", "INCONCLUSIVE"),
            passed("claim 1: p > q", "SUPPORTED"),
            passed("claim 2: r > s", "SUPPORTED"),
        ]);
        let b = side(vec![
            passed("table: x", "REPRODUCED"),
            passed("claim 1: new > q", "SUPPORTED"),
            passed("claim 2: p > q", "SUPPORTED"),
            passed("claim 3: r > s", "REFUTED"),
        ]);
        let compared = Compared::of(&a, &b);
        let change = |about: &str, a: &str, b: &str| ChangedVerdict {
            about: about.into(),
            a: a.into(),
            b: b.into(),
        };
        assert_eq!(
            compared.verdicts,
            [change("table: x", "INCONCLUSIVE", "REPRODUCED")]
        );
        assert_eq!(compared.claims, [change("r > s", "SUPPORTED", "REFUTED")]);
        assert_eq!(compared.only.len(), 1);
        assert_eq!(
            (compared.only[0].side, compared.only[0].what.as_str()),
            ("b", "new > q")
        );
        assert!(compared.differs());
    }

    #[test]
    fn a_claim_that_is_made_twice_is_compared_twice() {
        let twice = |second: &str| {
            side(vec![
                passed("claim 1: p", "SUPPORTED"),
                passed("claim 2: p", second),
            ])
        };
        let compared = Compared::of(&twice("SUPPORTED"), &twice("REFUTED"));
        assert_eq!(compared.claims.len(), 1);
        assert_eq!(compared.claims[0].about, "p (2)");
        assert!(!Compared::of(&twice("REFUTED"), &twice("REFUTED")).differs());
    }

    #[test]
    fn the_verdict_of_all_together_counts_as_well() {
        let holm = |word: Option<&str>| {
            side(vec![Passed {
                together: word.map(Into::into),
                ..passed("t: x", "REPRODUCED")
            }])
        };
        let compared = Compared::of(&holm(None), &holm(Some("INCONCLUSIVE")));
        assert_eq!(compared.verdicts[0].b, "REPRODUCED (Holm: INCONCLUSIVE)");
    }
}
