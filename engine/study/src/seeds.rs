//! Seeds of a study: a number of them, a list, ranges, or a design whose looks are fixed before the first trial.

use document::{
    Node,
    diagnostic::{Diagnostic, Sources},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{spending::SequentialDesign, statement::FEWEST_SEEDS};
use std::collections::BTreeSet;

/// Largest number of seeds of a study.
pub(super) const MOST_SEEDS: u64 = 1_000_000;
/// Largest number of seeds that a design may reach.
const MOST_IN_DESIGN: u64 = 1000;
/// Largest number of looks of a design.
const MOST_LOOKS: u64 = 50;

/// The section as it is written.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub(super) enum SeedsText {
    /// Number of replicates.
    Count(#[schemars(range(min = 1, max = MOST_SEEDS))] u64),
    /// The seeds themselves.
    Listed(#[schemars(length(min = 1, max = MOST_SEEDS), extend("uniqueItems" = true))] Vec<u64>),
    /// Ranges, as in `100-199` or `0-4, 10-14`.
    Ranges(String),
    /// Seeds that are added look by look.
    Designed(DesignText),
}

/// A design as it is written.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct DesignText {
    /// The first seed; the others follow it without gaps.
    #[serde(default, skip_serializing_if = "is_zero")]
    #[schemars(range(max = MOST_SEEDS))]
    first: u64,
    /// Seeds at the first look.
    #[schemars(range(min = FEWEST_SEEDS, max = MOST_IN_DESIGN))]
    min: u64,
    /// Seeds at the last look.
    #[schemars(range(min = FEWEST_SEEDS, max = MOST_IN_DESIGN))]
    max: u64,
    /// Number of looks, spread evenly, or the numbers of seeds at each.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "LooksText")]
    looks: Option<LooksText>,
}

/// The looks of a design as they are written.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
enum LooksText {
    /// Number of looks.
    Number(#[schemars(range(min = 2, max = MOST_LOOKS))] u64),
    /// The number of seeds at each.
    Listed(
        #[schemars(length(min = 2, max = MOST_LOOKS), inner(range(min = FEWEST_SEEDS, max = MOST_IN_DESIGN)))]
         Vec<u64>,
    ),
}

/// The seeds of a study, with their looks.
#[derive(Debug, Clone, PartialEq)]
pub struct SeedPlan {
    /// All seeds that it may use.
    pub seeds: Vec<u64>,
    /// The looks at which `run` adds seeds until every claim and judged value is decided.
    pub design: Option<SequentialDesign>,
}

impl SeedPlan {
    /// The seeds of the section in `node`; one seed if it is absent.
    ///
    /// # Errors
    /// Looks that contradict each other or the limits.
    pub(super) fn of(
        text: Option<&SeedsText>,
        node: Option<&Node>,
        sources: &Sources,
    ) -> Result<Self, Vec<Diagnostic>> {
        let fixed = |seeds| Ok(Self { seeds, design: None });
        let Some((text, node)) = text.zip(node) else {
            return fixed(vec![0]);
        };
        match text {
            SeedsText::Designed(written) => {
                let looks = looks(written).map_err(|(key, message, help)| {
                    let place = node.entry(key).map_or(node.span, |entry| entry.key_span);
                    vec![sources.error(place, &format!("seeds.{key}"), message).help(help)]
                })?;
                let most = looks.last().copied().unwrap_or(1);
                Ok(Self {
                    seeds: (written.first..written.first + u64::from(most)).collect(),
                    design: Some(SequentialDesign::new(looks)),
                })
            }
            SeedsText::Listed(list) => fixed(list.clone()),
            SeedsText::Ranges(text) => match ranges(text) {
                Ok(seeds) => fixed(seeds),
                Err(message) => Err(vec![
                    sources
                        .error(node.span, "seeds", message)
                        .help("write ranges as in `100-199` or `0-4, 10-14`"),
                ]),
            },
            SeedsText::Count(count) => fixed((0..*count).collect()),
        }
    }

    /// Number of seeds that every combination has before any result.
    #[must_use]
    pub fn certain(&self) -> usize {
        self.design
            .as_ref()
            .map_or(self.seeds.len(), |design| design.looks()[0] as usize)
    }
}

fn is_zero(first: &u64) -> bool {
    *first == 0
}

/// The seeds of ranges, in their order.
fn ranges(text: &str) -> Result<Vec<u64>, String> {
    let mut seeds = Vec::new();
    let mut seen = BTreeSet::new();
    for part in text.split(',').map(str::trim) {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let number = |word: &str| word.trim().parse::<u64>();
        let (Ok(first), Ok(last)) = (number(first), number(last)) else {
            return Err(format!("`{part}` is no range of seeds"));
        };
        if last < first {
            return Err(format!("the range `{part}` ends before it begins"));
        }
        if last - first >= MOST_SEEDS || seeds.len() as u64 + (last - first) >= MOST_SEEDS {
            return Err(format!("`{text}` are more than {MOST_SEEDS} seeds"));
        }
        seeds.extend(first..=last);
        if let Some(twice) = (first..=last).find(|seed| !seen.insert(*seed)) {
            return Err(format!("seed {twice} stands twice in `{text}`"));
        }
    }
    Ok(seeds)
}

/// A mistake in a design: the key, the message, and the advice.
type DesignMistake = (&'static str, String, String);

fn looks(written: &DesignText) -> Result<Vec<u32>, DesignMistake> {
    let (least, most) = (written.min, written.max);
    if least >= most {
        let message = format!("`min` is {least} and `max` is {most}, so there is nothing to add");
        return Err((
            "max",
            message,
            "write a larger `max`, or a plain number of seeds".into(),
        ));
    }
    let looks = match &written.looks {
        Some(LooksText::Listed(list)) => list.clone(),
        Some(LooksText::Number(count)) => evenly(least, most, *count),
        None => evenly(least, most, (most / least).clamp(2, MOST_LOOKS)),
    };
    if looks.windows(2).any(|pair| pair[0] >= pair[1]) {
        let message = format!("looks must rise, but these are {}", listed(&looks));
        return Err((
            "looks",
            message,
            format!(
                "there are at most {} looks from {least} to {most}",
                most - least + 1
            ),
        ));
    }
    if looks.first() != Some(&least) || looks.last() != Some(&most) {
        let message = format!(
            "the looks {} do not begin with `min`, {least}, and end with `max`, {most}",
            listed(&looks)
        );
        return Err((
            "looks",
            message,
            "write the number of looks, as in `looks: 4`, to have them spread evenly".into(),
        ));
    }
    Ok(looks
        .into_iter()
        .map(|look| u32::try_from(look).unwrap_or(u32::MAX))
        .collect())
}

fn listed(looks: &[u64]) -> String {
    looks.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")
}

/// Numbers of seeds at `looks` looks from `least` to `most`, at equal distances as far as whole numbers allow.
fn evenly(least: u64, most: u64, looks: u64) -> Vec<u64> {
    let steps = looks.max(2) - 1;
    (0..=steps)
        .map(|step| least + (step * (most - least) + steps / 2) / steps)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn read(value: Value) -> Result<Vec<u32>, String> {
        looks(&serde_json::from_value(value).unwrap()).map_err(|(_, message, _)| message)
    }

    #[test]
    fn looks_are_spread_evenly_or_listed() {
        assert_eq!(
            read(json!({ "min": 5, "max": 30, "looks": 6 })).unwrap(),
            [5, 10, 15, 20, 25, 30]
        );
        assert_eq!(
            read(json!({ "min": 3, "max": 10, "looks": 3 })).unwrap(),
            [3, 7, 10]
        );
        assert_eq!(read(json!({ "min": 5, "max": 20 })).unwrap(), [5, 10, 15, 20]);
        assert_eq!(read(json!({ "min": 3, "max": 4 })).unwrap(), [3, 4]);
        assert_eq!(
            read(json!({ "min": 3, "max": 1000 })).unwrap().len(),
            50,
            "as many as may be listed"
        );
        assert_eq!(
            read(json!({ "min": 3, "max": 30, "looks": [3, 5, 8, 30] })).unwrap(),
            [3, 5, 8, 30]
        );
    }

    #[test]
    fn ranges_are_read_and_what_is_none_is_named() {
        assert_eq!(ranges("100-103").unwrap(), [100, 101, 102, 103]);
        assert_eq!(ranges("7, 0-2,5 - 5").unwrap(), [7, 0, 1, 2, 5]);
        let wrong = |text: &str| ranges(text).unwrap_err();
        assert_eq!(wrong("0-2, x"), "`x` is no range of seeds");
        assert_eq!(wrong(""), "`` is no range of seeds");
        assert_eq!(wrong("5-3"), "the range `5-3` ends before it begins");
        assert_eq!(wrong("0-4, 3-6"), "seed 3 stands twice in `0-4, 3-6`");
        assert_eq!(wrong("0-1000000"), "`0-1000000` are more than 1000000 seeds");
        assert!(wrong("0-18446744073709551615").contains("more than"));
        assert_eq!(ranges("18446744073709551615").unwrap(), [u64::MAX]);
    }

    #[test]
    fn designs_that_contradict_themselves_are_refused() {
        assert!(
            read(json!({ "min": 5, "max": 5 }))
                .unwrap_err()
                .contains("nothing to add")
        );
        assert!(
            read(json!({ "min": 3, "max": 5, "looks": 9 }))
                .unwrap_err()
                .contains("must rise")
        );
        assert!(
            read(json!({ "min": 3, "max": 9, "looks": [3, 7, 5, 9] }))
                .unwrap_err()
                .contains("3, 7, 5, 9")
        );
        assert!(
            read(json!({ "min": 3, "max": 9, "looks": [4, 9] }))
                .unwrap_err()
                .contains("do not begin")
        );
    }
}
