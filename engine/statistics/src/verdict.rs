//! Is a published value reproduced? An equivalence test over seeds.
//!
//! The two one-sided tests of Schuirmann (1987, doi:10.1007/BF01068419) at 5 % each compare the 90 % interval of the
//! mean over seeds with the band of published value and margin. If the interval lies inside, the value is reproduced;
//! outside, it differs; across an edge, the seeds do not decide. A published value with a standard deviation and a
//! number of runs is as uncertain as the reproduced one: the interval is then Welch's, of the difference. The same
//! holds for a published share with a number of runs: the interval is then that of the difference of the two shares,
//! combined from the exact bounds of both.

use super::{
    Interval, MeanEstimate,
    binomial::Share,
    mean_estimate::PublishedMean,
    power::{POWER, Room},
    spending::SequentialDesign,
    statement::{Decision, Evidence, FEWEST_SEEDS, Look, Region, Statement, StatementOutcome},
};
use crate::TrainingShare;
use document::count::count;
use std::{collections::BTreeMap, fmt};

/// Probability of a wrong verdict on each side; a single look has an interval of 90 %.
pub const ALPHA: f64 = 0.05;

/// The word for a failed comparison after much less training than that of the source.
pub const NOT_AT_THIS_BUDGET: &str = "NOT AT THIS BUDGET";

/// Result of the comparison of a reproduced cell with the published value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The whole interval lies in the band.
    Reproduced,
    /// The whole interval lies outside the band.
    Differs,
    /// The whole interval lies outside the band, after much less training than that of the source.
    NotAtThisBudget,
    /// The interval crosses an edge of the band, or there are too few seeds.
    Inconclusive,
    /// It would be reproduced, but the published value was used to choose a setting, so the agreement is by
    /// construction.
    Calibrated,
    /// The cell is fixed by construction, belongs to another system, or has a budget that gives no result.
    NotJudged,
    /// An agent behind the cell made no update.
    NotTrained,
    /// There is no seed yet.
    NotRun,
    /// No seed ended successfully, or a seed's value is not finite.
    Failed,
}

impl Verdict {
    /// All verdicts, in the order in which they are counted.
    pub const ALL: [Verdict; 9] = [
        Verdict::Reproduced,
        Verdict::Differs,
        Verdict::NotAtThisBudget,
        Verdict::Inconclusive,
        Verdict::Calibrated,
        Verdict::NotJudged,
        Verdict::NotTrained,
        Verdict::NotRun,
        Verdict::Failed,
    ];

    /// Word of the verdict in reports.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Reproduced => "REPRODUCED",
            Verdict::Differs => "DIFFERS",
            Verdict::NotAtThisBudget => NOT_AT_THIS_BUDGET,
            Verdict::Inconclusive => "INCONCLUSIVE",
            Verdict::Calibrated => "CALIBRATED",
            Verdict::NotJudged => "NOT JUDGED",
            Verdict::NotTrained => "NOT TRAINED",
            Verdict::NotRun => "NOT RUN",
            Verdict::Failed => "FAILED",
        }
    }

    /// Whether seeds decided the verdict.
    #[must_use]
    pub fn is_judged(self) -> bool {
        matches!(
            self,
            Verdict::Reproduced | Verdict::Differs | Verdict::NotAtThisBudget | Verdict::Inconclusive
        )
    }

    /// The same verdict after a training that was too short to contradict the source.
    #[must_use]
    pub fn at_budget(self, training: Option<TrainingShare>) -> Self {
        let is_too_small = training.is_some_and(TrainingShare::is_too_small);
        if self == Self::Differs && is_too_small {
            Self::NotAtThisBudget
        } else {
            self
        }
    }

    /// The verdict on a published value for an outcome of the seeds.
    #[must_use]
    pub fn of(outcome: StatementOutcome) -> Self {
        match outcome {
            StatementOutcome::Holds => Verdict::Reproduced,
            StatementOutcome::Fails => Verdict::Differs,
            // A published value has one band, inside which it counts as reproduced.
            StatementOutcome::Alike | StatementOutcome::Direction | StatementOutcome::Open => {
                Verdict::Inconclusive
            }
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.word())
    }
}

/// A published value, with the band of values that count as the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    /// The published value, in its own unit.
    pub value: f64,
    /// Standard deviation and number of the published runs, if both are published.
    pub runs: Option<(f64, u32)>,
    /// Successes and number of the published runs, if it is a share and their number is published.
    pub share: Option<Share>,
    /// Smallest and largest value that count as the same.
    pub band: (f64, f64),
}

impl Reference {
    /// A value with a margin to both sides, in its unit.
    #[must_use]
    pub fn within(value: f64, margin: f64) -> Self {
        Self {
            value,
            runs: None,
            share: None,
            band: (value - margin, value + margin),
        }
    }

    /// The number that turns evidence on a value into the displayed value: evidence against an uncertain value is the
    /// difference from it.
    fn offset(&self, is_share: bool) -> f64 {
        match (self.share, self.runs) {
            (Some(share), _) if is_share => share.value(),
            (_, Some(_)) if !is_share => self.value,
            _ => 0.0,
        }
    }
}

/// The seeds by which a statement may be decided.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Seeds {
    /// The looks that were planned; `None` if the number of seeds is fixed.
    pub design: Option<SequentialDesign>,
    /// The upper limit of the seeds that count, for each look that is complete.
    pub limits: Vec<u64>,
    /// Number of rounds of seeds that are pooled, none planned with the one before; 0 for one round.
    pub rounds: usize,
}

impl Seeds {
    /// The upper limit of the seeds that count, for each look that can decide; a single look at all seeds if their
    /// number is fixed.
    #[must_use]
    pub fn limits(&self) -> Vec<u64> {
        match &self.design {
            None => vec![u64::MAX],
            Some(_) => self.limits.clone(),
        }
    }

    /// Number of the planned looks that are complete.
    #[must_use]
    pub fn complete(&self) -> usize {
        self.limits.len()
    }

    /// Whether rounds are pooled: all of their seeds decide, not the first look that can.
    #[must_use]
    pub fn is_pooled(&self) -> bool {
        self.rounds > 0
    }
}

/// The stage of a statement in a design.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stage {
    /// The look that decided, or the last complete one, from 1; 0 if none is complete.
    pub look: usize,
    /// Number of looks of the design.
    pub of: usize,
    /// Seeds planned for this look.
    pub seeds: u32,
    /// Number of rounds of seeds that are pooled; 0 for one round.
    pub rounds: usize,
}

impl Stage {
    /// The stage of a decision in a design.
    #[must_use]
    pub fn of(seeds: &Seeds, decision: Option<&Decision>) -> Option<Self> {
        let design = seeds.design.as_ref()?;
        let look = decision.map_or(0, |decision| decision.look + 1);
        let planned = look.checked_sub(1).map_or(0, |index| design.looks()[index]);
        Some(Self {
            look,
            of: design.looks().len(),
            seeds: planned,
            rounds: seeds.rounds,
        })
    }

    /// Whether no look is left.
    #[must_use]
    pub fn is_last(&self) -> bool {
        self.look == self.of
    }

    /// The stage as a phrase.
    #[must_use]
    pub fn phrase(&self, open: bool) -> String {
        let Self {
            look,
            of,
            seeds,
            rounds,
        } = *self;
        match (look, open) {
            _ if rounds > 0 => format!(
                "all {seeds} seeds of {rounds} rounds, whose {look} looks were not planned together; the level is divided \
                 among them"
            ),
            (0, _) => format!("the first of {of} looks is not complete"),
            (_, false) => format!("decided at look {look} of {of}, with {seeds} seeds"),
            (_, true) if self.is_last() => format!("open after the last of {of} looks"),
            (_, true) => format!("open at look {look} of {of}, with {seeds} seeds; `run` adds seeds"),
        }
    }
}

/// A verdict with the numbers on which it is based.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// Verdict by the cell's own level.
    pub verdict: Verdict,
    /// The verdict when all judged values of the study are judged together (Holm); `None` until they are.
    pub adjusted: Option<Verdict>,
    /// The strictest share of its level at which the decision is the same; `None` if it is open, or before that share
    /// is computed.
    pub strictest: Option<f64>,
    /// Number of seeds behind it.
    pub n: usize,
    /// Mean over these seeds; `None` without seeds or if it is not finite.
    pub mean: Option<f64>,
    /// The interval that decides, in the unit of the mean; `None` below two seeds.
    pub interval: Option<Interval>,
    /// The published value.
    pub reference: Reference,
    /// Stage in the design; `None` if the number of seeds is fixed.
    pub stage: Option<Stage>,
    /// Approximate number of further seeds that would decide with a power of 80 %; `None` if that is known to be too
    /// many or useless.
    pub more_seeds: Option<u32>,
    /// The decided statement; `None` if nothing could be decided.
    pub statement: Option<Statement>,
}

impl Judgement {
    /// A published value that is not judged.
    #[must_use]
    pub fn without(verdict: Verdict, reference: Reference, values: &[(u64, f64)]) -> Self {
        let values: Vec<f64> = values.iter().map(|(_, value)| *value).collect();
        let estimate = MeanEstimate::of(&values);
        Self {
            verdict,
            adjusted: None,
            strictest: None,
            n: values.len(),
            mean: Some(estimate.value).filter(|mean| mean.is_finite()),
            interval: estimate.interval(1.0 - 2.0 * ALPHA),
            reference,
            stage: None,
            more_seeds: None,
            statement: None,
        }
    }

    /// Advice for an inconclusive verdict, or the look at which it was decided, in one phrase; empty if there is
    /// nothing to add.
    #[must_use]
    pub fn note(&self) -> String {
        if !self.verdict.is_judged() {
            return String::new();
        }
        let open = self.verdict == Verdict::Inconclusive;
        match (self.stage, open) {
            (Some(stage), _) => stage.phrase(open),
            (None, false) => String::new(),
            (None, true) => self.advice(),
        }
    }

    fn advice(&self) -> String {
        let is_alike = |it: &Statement| it.looks.iter().all(|look| look.evidence.has_no_spread());
        let is_of_shares = |it: &Statement| it.looks.iter().all(|look| look.evidence.is_of_shares());
        match (self.n, self.more_seeds) {
            (n, _) if n < FEWEST_SEEDS => too_few_seeds_in_words(n),
            _ if self.statement.as_ref().is_some_and(is_alike) => ALIKE.into(),
            (_, Some(more)) => more_seeds_in_words(more),
            _ if self.statement.as_ref().is_some_and(is_of_shares) => {
                "more seeds may decide; for shares their number is not estimated".into()
            }
            (_, None) => {
                "no affordable number of seeds would decide with a probability of 80 %, if mean and spread \
                          stay as they are"
                    .into()
            }
        }
    }
}

/// The remark on seeds that are equal, possibly by chance.
pub const ALIKE: &str = "all seeds gave the same whole number, as counts do by chance, which decides nothing";

/// Phrase: this number of seeds is too small to decide.
#[must_use]
pub fn too_few_seeds_in_words(n: usize) -> String {
    format!("too few seeds ({n}): at least {FEWEST_SEEDS} are needed")
}

/// Phrase: the number of further seeds to plan.
#[must_use]
pub fn more_seeds_in_words(more: u32) -> String {
    let seeds = count(more, "more seed");
    format!(
        "an estimated {seeds} would decide with a probability of 80 %, if mean and spread stay \
         as they are"
    )
}

/// The margin if a study gives none: 5 % of the size of the published value.
#[must_use]
pub fn default_margin(published: f64) -> f64 {
    0.05 * published.abs()
}

/// One number per seed.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// The numbers computed from all seeds.
    pub values: &'a [(u64, f64)],
    /// The numbers computed from the seeds below a limit, if other seeds change them; `None` if none does.
    pub as_of: Option<&'a BTreeMap<u64, Vec<(u64, f64)>>>,
}

impl<'a> Sample<'a> {
    /// Numbers that no other seed changes.
    #[must_use]
    pub fn of(values: &'a [(u64, f64)]) -> Self {
        Self { values, as_of: None }
    }

    /// The numbers of the seeds below a limit.
    fn below(&self, limit: u64) -> Vec<f64> {
        let then = self.as_of.and_then(|as_of| as_of.get(&limit));
        let values = then.map_or(self.values, Vec::as_slice).iter();
        values
            .filter(|(seed, _)| *seed < limit)
            .map(|(_, value)| *value)
            .collect()
    }
}

/// Compares one reproduced value per seed with a published value.
///
/// `failed` is the number of seeds that ended unsuccessfully: if there is no other seed, the cell has failed. If some
/// seeds ended successfully, the verdict is based on them alone, and the reader must be shown that others are missing.
/// `is_share` means that values are 0 or 1, successes of seeds.
#[must_use]
pub fn judge(
    reference: Reference,
    sample: Sample<'_>,
    failed: usize,
    seeds: &Seeds,
    is_share: bool,
) -> Judgement {
    let values = sample.values;
    let blank = |verdict| Judgement {
        stage: Stage::of(seeds, None),
        ..Judgement::without(verdict, reference, values)
    };
    match values {
        [] if failed == 0 => return blank(Verdict::NotRun),
        [] => return blank(Verdict::Failed),
        _ if !values.iter().all(|(_, value)| value.is_finite()) => return blank(Verdict::Failed),
        _ => {}
    }
    let at = |limit: u64| look(&reference, &sample.below(limit), is_share);
    let looks: Vec<Look> = seeds.limits().into_iter().map(at).collect();
    if looks.is_empty() {
        return blank(Verdict::Inconclusive);
    }
    let statement = Statement {
        looks,
        design: seeds.design.clone(),
        by_last: seeds.is_pooled(),
        alpha: ALPHA,
    };
    let decision = statement.decide();
    let taken = &statement.looks[decision.look];
    let offset = reference.offset(is_share);
    let interval = decision.interval.map(|it| Interval {
        low: it.low + offset,
        high: it.high + offset,
        ..it
    });
    Judgement {
        verdict: Verdict::of(decision.outcome),
        adjusted: None,
        strictest: None,
        n: taken.evidence.n(),
        mean: Some(taken.evidence.value() + offset).filter(|mean| mean.is_finite()),
        interval,
        reference,
        stage: Stage::of(seeds, Some(&decision)),
        more_seeds: more_seeds(taken, ALPHA),
        statement: Some(statement),
    }
}

/// The evidence of the seeds of one look, and the values that count as the same.
fn look(reference: &Reference, values: &[f64], is_share: bool) -> Look {
    let (low, high) = reference.band;
    let deterministic = !is_share && make_no_difference(values);
    let difference = Region::between(low - reference.value, high - reference.value);
    let (evidence, region) = match reference.runs {
        _ if is_share => match reference.share {
            None => (share_of(values), Region::between(low, high)),
            Some(published) => (
                Evidence::FromPublished(successes_of(values), published),
                difference,
            ),
        },
        None => (
            Evidence::Mean(MeanEstimate::of(values)),
            Region::between(low, high),
        ),
        Some((sd, n)) => {
            let estimate = MeanEstimate::against_published(
                values,
                PublishedMean {
                    value: reference.value,
                    sd,
                    n,
                },
            );
            (Evidence::Mean(estimate), difference)
        }
    };
    Look {
        evidence,
        region,
        alike: None,
        deterministic,
    }
}

/// Whether two seeds or more all gave the same number that is not whole. A whole number may be a count, and equal
/// counts say little about the next seed.
#[must_use]
pub fn make_no_difference(values: &[f64]) -> bool {
    let is_whole = |value: &f64| value.fract() == 0.0;
    MeanEstimate::of(values).has_no_spread() && !values.iter().all(is_whole)
}

/// Values of 0 and 1 as a share.
#[must_use]
pub fn share_of(values: &[f64]) -> Evidence {
    Evidence::Share(successes_of(values))
}

fn successes_of(values: &[f64]) -> Share {
    Share::of(values.iter().map(|value| *value > 0.5))
}

/// Approximate number of further seeds that would decide with a power of 80 %; at least those that are missing to the
/// smallest number that decides. `None` for one seed, for shares, and if no affordable number would.
#[must_use]
pub fn more_seeds(look: &Look, alpha: f64) -> Option<u32> {
    let missing = u32::try_from(FEWEST_SEEDS.saturating_sub(look.evidence.n())).unwrap_or(0);
    match &look.evidence {
        // Nothing is known of the spread.
        _ if look.evidence.n() < 2 => None,
        it if it.has_no_spread() && !look.deterministic => (missing > 0).then_some(missing),
        Evidence::Mean(estimate) => {
            // On the side that holds, a difference has to be larger than one that does not matter.
            let holds = look.alike.is_some() && look.region.contains(estimate.value);
            let rooms = [Some(look.region).filter(|_| !holds), look.alike];
            let more = rooms
                .into_iter()
                .flatten()
                .filter_map(|it| estimate.more_seeds_for_power(it.room(estimate.value), alpha, POWER))
                .min();
            more.map(|more| more.max(missing))
                .or((missing > 0).then_some(missing))
        }
        Evidence::BetweenMeans {
            above_low,
            above_high,
            ..
        } => {
            let clear = |limit: &MeanEstimate| {
                limit.more_seeds_for_power(Room::to_edge(limit.value.abs()), alpha, POWER)
            };
            let more = match (above_low.value >= 0.0, above_high.value <= 0.0) {
                (true, true) => clear(above_low)
                    .zip(clear(above_high))
                    .map(|(low, high)| low.max(high)),
                (false, _) => clear(above_low),
                (_, false) => clear(above_high),
            };
            more.map(|more| more.max(missing))
        }
        Evidence::Share(_) | Evidence::Shares(..) | Evidence::FromPublished(..) => None,
    }
}

#[cfg(test)]
mod tests;
