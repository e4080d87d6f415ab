//! The sentences under a table: meaning of numbers, rules of verdicts, missing seeds, and cautions.

use super::{Cell, FixedReason, Grid, Margin, Reduction, Statistic};
use document::count::{count, seed_ranges};
use statistics::{Judgement, Verdict};

/// Display of intervals in the output format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Intervals {
    /// Brackets after the number; cells with missing seeds have a star.
    InBrackets,
    /// Half of the width after the number.
    AsHalfWidth,
    /// No display.
    NotShown,
    /// Lines over bars.
    AsLines,
}

/// Largest number of seeds with which a percentile bootstrap covers much less than its level: nine of ten times with
/// five, three of four with three (normal values, median and interquartile mean).
const FEW: usize = 5;

impl Grid {
    /// All notes, a sentence each: causes of differences that the study states, meaning and origin of the numbers,
    /// missing seeds, and the notes of the study.
    #[must_use]
    pub fn footnotes(&self, intervals: Intervals) -> Vec<String> {
        let star = if intervals == Intervals::AsLines { "" } else { "* " };
        let mut notes = self.causes();
        notes.push(self.reading(intervals));
        notes.extend(self.judging());
        notes.extend(self.incomplete().map(|note| format!("{star}{note}")));
        notes.extend(self.grouped(|cell| {
            cell.judgement
                .as_ref()
                .map(Judgement::note)
                .filter(|note| !note.is_empty())
        }));
        notes.extend(self.grouped(caution));
        notes.extend(self.notes.iter().cloned());
        notes
    }

    /// Notes on reading the numbers and the verdicts, without those on single cells.
    #[must_use]
    pub fn how_read(&self, intervals: Intervals) -> Vec<String> {
        std::iter::once(self.reading(intervals))
            .chain(self.judging())
            .collect()
    }

    fn reading(&self, intervals: Intervals) -> String {
        let unit = if self.unit.is_empty() {
            String::new()
        } else {
            format!(" [{}]", self.unit)
        };
        let shown = match intervals {
            Intervals::InBrackets => "in brackets",
            Intervals::AsHalfWidth => "after ±, its larger half",
            Intervals::NotShown => "not shown",
            Intervals::AsLines => "as lines",
        };
        let seeds = match self.usual_n() {
            None => "no seed has a value yet".into(),
            // The bootstrap resamples the ranked points, not the seeds.
            Some(n) if self.one_number == Reduction::RankCorrelation => {
                let seeds = count(n, "seed");
                format!("rank correlation of means over n = {seeds}, 95 % interval over the points {shown}")
            }
            Some(1) => "one seed, so no interval".into(),
            Some(n) => format!(
                "{} over n = {n} seeds, 95 % interval {shown}",
                self.one_number.name()
            ),
        };
        let few = if self.is_resampled() && self.usual_n().is_some_and(|n| (2..=FEW).contains(&n)) {
            " Bootstrap intervals of so few seeds are narrower than they say."
        } else {
            ""
        };
        format!("{}{unit}: {seeds}.{few}", self.quantity)
    }

    /// Whether intervals are percentiles of resampled seeds.
    fn is_resampled(&self) -> bool {
        let is_mean = |statistic: &Statistic| *statistic == Statistic::Mean;
        match &self.one_number {
            Reduction::Of(statistic) => !is_mean(statistic),
            Reduction::Aggregates => true,
            Reduction::Share | Reduction::RankCorrelation => false,
        }
    }

    /// The rule of the verdicts; `None` if nothing is judged.
    fn judging(&self) -> Option<String> {
        let judged = || {
            self.cells
                .iter()
                .flatten()
                .filter_map(|cell| cell.judgement.as_ref())
                .filter(|it| it.statement.is_some())
        };
        judged().next()?;
        let of = if self.one_number == Reduction::Share {
            "share"
        } else {
            "mean"
        };
        let interval = match judged().find_map(|judgement| judgement.stage) {
            Some(stage) => format!(
                "repeated confidence interval of the {of} (Lan and DeMets, Pocock type, {} looks)",
                stage.of
            ),
            None => format!("90 % interval of the {of}"),
        };
        let margin = Margin::in_words(self.margin.as_ref(), &self.unit);
        let reason = match Margin::reason(self.margin.as_ref()) {
            "" => "No reason is given for this margin.".into(),
            why => format!("Why this margin: {}.", why.trim_end_matches('.')),
        };
        let published = self.certainty();
        let when = if self.exploratory {
            "Exploratory: the comparison was thought of after results were seen. "
        } else {
            ""
        };
        Some(format!(
            "{when}A value counts as reproduced where the {interval} lies within the published value \
             {margin}. {reason} {published}"
        ))
    }

    /// Sentence on the certainty of the published values.
    fn certainty(&self) -> &'static str {
        let references = || {
            let judged = self.cells.iter().flatten().filter_map(|it| it.judgement.as_ref());
            judged.filter(|it| it.statement.is_some()).map(|it| &it.reference)
        };
        if references().any(|it| it.share.is_some()) {
            "Published shares with a number of runs count as uncertain: the interval is that of the \
             difference of both shares, its ends made of the exact bounds of both (Clopper and Pearson, \
             squared and added). The others count as exact."
        } else if references().any(|it| it.runs.is_some()) {
            "Published values with a standard deviation and a number of runs count as uncertain (Welch), \
             the others as exact."
        } else {
            "Published values count as exact."
        }
    }

    fn incomplete(&self) -> impl Iterator<Item = String> {
        let cells = self.places().filter(|(_, cell)| cell.is_incomplete());
        cells.map(|(place, cell)| format!("{place}: {}.", cell.incompleteness()))
    }

    /// Notes that several cells may share, each once, after the places that it concerns.
    fn grouped(&self, note: impl Fn(&Cell) -> Option<String>) -> Vec<String> {
        let mut groups: Vec<(String, Vec<String>)> = Vec::new();
        for (place, cell) in self.places() {
            let Some(note) = note(cell) else { continue };
            match groups.iter_mut().find(|(known, _)| *known == note) {
                Some((_, places)) => places.push(place),
                None => groups.push((note, vec![place])),
            }
        }
        groups
            .into_iter()
            .map(|(note, places)| format!("{}: {note}.", places.join("; ")))
            .collect()
    }
}

impl Cell {
    /// Sentence on the number of seeds and on the reasons for missing ones.
    #[must_use]
    pub fn incompleteness(&self) -> String {
        let count = format!("{} of {} seeds", self.seeds.len(), self.planned);
        let mut groups: Vec<(Vec<u64>, String)> = Vec::new();
        for text in self.missing.iter().map(ToString::to_string) {
            let (seed, reason) = seed_and_reason(&text);
            match groups
                .iter_mut()
                .find(|(seeds, known)| !seeds.is_empty() && known == reason)
            {
                Some((seeds, _)) if seed.is_some() => seeds.extend(seed),
                _ => groups.push((seed.into_iter().collect(), reason.to_owned())),
            }
        }
        let group = |(seeds, reason): (Vec<u64>, String)| match seeds.as_slice() {
            [] => reason,
            [seed] => format!("seed {seed}: {reason}"),
            several => format!("seeds {}: {reason}", seed_ranges(several)),
        };
        std::iter::once(count)
            .chain(groups.into_iter().map(group))
            .collect::<Vec<_>>()
            .join("; ")
    }
}

/// Splits a sentence into the seed that it is about and the rest.
fn seed_and_reason(text: &str) -> (Option<u64>, &str) {
    let parts = text.strip_prefix("seed ").and_then(|rest| rest.split_once(": "));
    let parts = parts.and_then(|(seed, reason)| Some((seed.parse().ok()?, reason)));
    parts.map_or((None, text), |(seed, reason)| (Some(seed), reason))
}

/// Caution about a value or its verdict; `None` if there is none.
fn caution(cell: &Cell) -> Option<String> {
    let untrained = cell
        .is_untrained()
        .then(|| untrained_in_words(cell.untrained.iter().map(String::as_str)));
    let published = cell.judgement.is_some();
    let fixed = cell
        .fixed
        .filter(|_| published)
        .map(|fixed| format!("not judged: {}", why(fixed)));
    let calibrated = cell.calibrated_on.as_ref().filter(|_| published);
    let differs = cell.verdict() == Some(Verdict::Differs);
    let calibrated = calibrated.map(|on| match differs {
        true => format!("in spite of calibration on the published value: {on}"),
        false => format!("calibrated on the published value: {on}"),
    });
    let training = cell.training.filter(|share| published && share.own < share.paper);
    let training = training.map(|share| share.to_string());
    let seen = cell.seen_at.map(unplanned_look_in_words);
    let changed = cell.first_judged_by.as_deref().map(changed_rule_in_words);
    let cautions: Vec<String> = [untrained, fixed, calibrated, training, seen, changed]
        .into_iter()
        .flatten()
        .collect();
    (!cautions.is_empty()).then(|| cautions.join("; "))
}

/// Sentence on agents without updates, as in `0 updates: sac was not trained`.
pub fn untrained_in_words<'a>(agents: impl Iterator<Item = &'a str>) -> String {
    format!(
        "0 updates: {} was not trained",
        agents.collect::<Vec<_>>().join(", ")
    )
}

/// Sentence on a verdict that was seen at this number of seeds without a plan.
pub fn unplanned_look_in_words(seeds: u32) -> String {
    format!("unplanned look: the verdict was seen with {seeds} seeds before, so its level is not held")
}

/// Sentence on a verdict whose rule was changed after it was seen.
pub fn changed_rule_in_words(first: &str) -> String {
    format!("exploratory: judged by {first} when the verdict was first seen, which was changed afterwards")
}

fn why(fixed: FixedReason) -> &'static str {
    match fixed {
        FixedReason::Itself => "an agent is compared with itself",
        FixedReason::Ends => "the smallest and the largest mean are 0 and 1 by the normalisation",
        FixedReason::Scale => "its scores are 0 or 1 by the normalisation",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{Form, MissingReason, MissingSeeds, PrintedColumn, Quantity};
    use contract::trial_end::EndState;

    #[test]
    fn seeds_that_lack_the_same_are_named_together() {
        let other = |seed| MissingReason::NoCounterpart {
            seed,
            agent: "equal".into(),
        };
        let failed = MissingReason::CounterpartFailed {
            seed: 3,
            agent: "equal".into(),
        };
        let missing = [other(5), failed, other(6), other(7)].map(MissingSeeds::of);
        let cell = Cell {
            planned: 4,
            missing: missing.into(),
            ..Cell::default()
        };
        assert_eq!(
            cell.incompleteness(),
            "0 of 4 seeds; seeds 5-7: no trial of `equal` to compare with; seed 3: `equal` has no result"
        );
    }

    #[test]
    fn a_cell_says_why_seeds_are_missing() {
        let missing =
            [MissingReason::Ended(1, EndState::Oom), MissingReason::NotRun(1)].map(MissingSeeds::of);
        let cell = Cell {
            planned: 2,
            failed: 1,
            missing: missing.into(),
            ..Cell::default()
        };
        assert_eq!(cell.incompleteness(), "0 of 2 seeds; 1 failed: oom; 1 not run");
        let text = |cell: Cell| {
            Grid {
                cells: vec![vec![cell]],
                ..Grid::default()
            }
            .text(0, PrintedColumn::Value(0))
        };
        assert_eq!(text(cell), "failed *");
        let missing = |why| vec![MissingSeeds::of(why).within("maze")];
        assert_eq!(
            text(Cell {
                planned: 2,
                missing: missing(MissingReason::NotRun(2)),
                ..Cell::default()
            }),
            "not run *"
        );
        assert_eq!(
            text(Cell {
                planned: 2,
                missing: missing(MissingReason::NoScale),
                ..Cell::default()
            }),
            "none *"
        );
    }

    #[test]
    fn how_values_are_paired_is_said_in_notes_and_not_on_axes() {
        let quantity = Quantity {
            value: "return".into(),
            relative: Some((Form::Difference, "a".into())),
        };
        assert_eq!(quantity.label(), "return minus that of a");
        let notes = |intervals| {
            Grid {
                quantity: quantity.clone(),
                ..Grid::default()
            }
            .footnotes(intervals)
        };
        assert_eq!(
            notes(Intervals::AsLines),
            ["return minus that of a, by seed: no seed has a value yet."]
        );
    }
}
