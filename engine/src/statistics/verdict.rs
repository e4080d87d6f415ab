//! Is a published value reproduced? An equivalence test over seeds.
//!
//! The two one-sided tests of Schuirmann (1987, doi:10.1007/BF01068419) at 5 % each: the 90 % interval of the mean over
//! seeds is laid against the band of published value and margin. Inside, the value is reproduced; outside, it differs; across an
//! edge, the seeds do not tell. A published value with a standard deviation and a number of runs is as uncertain as ours: then the
//! interval is Welch's, of the difference.

use super::{
    Interval, MeanEstimate,
    binomial::Share,
    mean_estimate::PublishedMean,
    power::POWER,
    spending::Design,
    statement::{Decision, Evidence, FEWEST_SEEDS, Look, Outcome, Region, Statement},
};
use std::fmt;

/// Probability of a wrong verdict on each side; a single look has an interval of 90 %.
pub const ALPHA: f64 = 0.05;

/// How a reproduced cell compares with the published value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The whole interval lies in the band.
    Reproduced,
    /// The whole interval lies outside the band.
    Differs,
    /// The interval crosses an edge of the band, or there are too few seeds.
    Inconclusive,
    /// The published value was used to choose a setting, so that agreement with it says nothing.
    Calibrated,
    /// The cell is what it is by construction.
    NotJudged,
    /// An agent behind the cell made no update.
    NotTrained,
    /// There is no seed yet.
    NotRun,
    /// No seed ended well, or a seed's value is not finite.
    Failed,
}

impl Verdict {
    /// All of them, in the order in which they are counted.
    pub const ALL: [Verdict; 8] = [
        Verdict::Reproduced,
        Verdict::Differs,
        Verdict::Inconclusive,
        Verdict::Calibrated,
        Verdict::NotJudged,
        Verdict::NotTrained,
        Verdict::NotRun,
        Verdict::Failed,
    ];

    /// The word that is shown.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Reproduced => "REPRODUCED",
            Verdict::Differs => "DIFFERS",
            Verdict::Inconclusive => "INCONCLUSIVE",
            Verdict::Calibrated => "CALIBRATED",
            Verdict::NotJudged => "NOT JUDGED",
            Verdict::NotTrained => "NOT TRAINED",
            Verdict::NotRun => "NOT RUN",
            Verdict::Failed => "FAILED",
        }
    }

    /// True where the seeds were asked.
    #[must_use]
    pub fn is_judged(self) -> bool {
        matches!(self, Verdict::Reproduced | Verdict::Differs | Verdict::Inconclusive)
    }

    /// The verdict on a published value for what the seeds decide.
    #[must_use]
    pub fn of(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Holds => Verdict::Reproduced,
            Outcome::Fails => Verdict::Differs,
            Outcome::Open => Verdict::Inconclusive,
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.word())
    }
}

/// A published value and what counts as the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    /// The value.
    pub value: f64,
    /// Standard deviation and number of the runs behind it, where both are published.
    pub runs: Option<(f64, u32)>,
    /// Smallest and largest value that count as the same.
    pub band: (f64, f64),
}

impl Reference {
    /// A value with a margin to both sides, in its unit.
    #[must_use]
    pub fn within(value: f64, margin: f64) -> Self {
        Self { value, runs: None, band: (value - margin, value + margin) }
    }
}

/// Which seeds a statement may be decided on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Seeds {
    /// The looks that were planned; `None` where the number of seeds is fixed.
    pub design: Option<Design>,
    /// How many of the planned looks are complete.
    pub complete: usize,
}

impl Seeds {
    /// The number below which seeds count, for each look that can be decided on; one look at all seeds where their number is fixed.
    #[must_use]
    pub fn limits(&self) -> Vec<u64> {
        match &self.design {
            None => vec![u64::MAX],
            Some(design) => design.looks().iter().take(self.complete).map(|most| u64::from(*most)).collect(),
        }
    }
}

/// Where in a design a statement stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stage {
    /// The look that decided, or the last complete one, from 1; 0 where none is complete.
    pub look: usize,
    /// All looks.
    pub of: usize,
    /// Seeds planned for this look.
    pub seeds: u32,
}

impl Stage {
    /// The stage of a decision in a design.
    #[must_use]
    pub fn of(seeds: &Seeds, decision: Option<&Decision>) -> Option<Self> {
        let design = seeds.design.as_ref()?;
        let look = decision.map_or(0, |decision| decision.look + 1);
        let planned = look.checked_sub(1).map_or(0, |index| design.looks()[index]);
        Some(Self { look, of: design.looks().len(), seeds: planned })
    }

    /// The stage as a phrase.
    #[must_use]
    pub fn phrase(&self, open: bool) -> String {
        let Self { look, of, seeds } = *self;
        match (look, open) {
            (0, _) => format!("the first of {of} looks is not complete"),
            (_, false) => format!("decided at look {look} of {of}, with {seeds} seeds"),
            (_, true) if look == of => format!("open after the last of {of} looks"),
            (_, true) => format!("open at look {look} of {of}, with {seeds} seeds; `run` adds seeds"),
        }
    }
}

/// A verdict with the numbers it rests on.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// The verdict.
    pub verdict: Verdict,
    /// The verdict when all judged values of the study are taken together (Holm); `None` until they are.
    pub adjusted: Option<Verdict>,
    /// Seeds it rests on.
    pub n: usize,
    /// Mean over these seeds; `None` without seeds or where it is not finite.
    pub mean: Option<f64>,
    /// The interval that decides, in the unit of the mean; `None` below two seeds.
    pub interval: Option<Interval>,
    /// The published value.
    pub reference: Reference,
    /// Where in the design it stands; `None` where the number of seeds is fixed.
    pub stage: Option<Stage>,
    /// About how many more seeds would decide with a power of 80 %; `None` where that is known to be too many or of no use.
    pub more_seeds: Option<u32>,
    /// What was decided; `None` where nothing could be.
    pub statement: Option<Statement>,
}

impl Judgement {
    /// A published value on which no verdict is passed.
    #[must_use]
    pub fn without(verdict: Verdict, reference: Reference, values: &[(u64, f64)]) -> Self {
        let values: Vec<f64> = values.iter().map(|(_, value)| *value).collect();
        let estimate = MeanEstimate::of(&values);
        Self {
            verdict,
            adjusted: None,
            n: values.len(),
            mean: Some(estimate.value).filter(|mean| mean.is_finite()),
            interval: estimate.interval(1.0 - 2.0 * ALPHA),
            reference,
            stage: None,
            more_seeds: None,
            statement: None,
        }
    }

    /// What to do about an inconclusive verdict, or at which look it was passed, in one phrase; empty where nothing is to be said.
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
        match (self.n, self.more_seeds) {
            (n, _) if n < FEWEST_SEEDS => format!("too few seeds ({n}): at least {FEWEST_SEEDS} are needed"),
            (_, Some(more)) => more_seeds_in_words(more),
            (_, None) => "the mean is too near the edge of the margin for an affordable number of seeds to decide".into(),
        }
    }
}

/// How many more seeds to plan, as a phrase.
#[must_use]
pub fn more_seeds_in_words(more: u32) -> String {
    let seeds = if more == 1 { "seed" } else { "seeds" };
    format!("an estimated {more} more {seeds} would decide with a probability of 80 %, if mean and spread stay as they are")
}

/// The margin where a study gives none: 5 % of the size of the published value.
#[must_use]
pub fn default_margin(published: f64) -> f64 {
    0.05 * published.abs()
}

/// Compares one reproduced value per seed with a published value.
///
/// `failed` is the number of seeds that did not end well: with no other seed the cell has failed. Where some seeds ended
/// well the verdict rests on them alone, and the reader must be shown that others are missing. `is_share` says that values are 0
/// or 1, successes of seeds.
#[must_use]
pub fn judge(reference: Reference, values: &[(u64, f64)], failed: usize, seeds: &Seeds, is_share: bool) -> Judgement {
    let blank = |verdict| Judgement { stage: Stage::of(seeds, None), ..Judgement::without(verdict, reference, values) };
    match values {
        [] if failed == 0 => return blank(Verdict::NotRun),
        [] => return blank(Verdict::Failed),
        _ if !values.iter().all(|(_, value)| value.is_finite()) => return blank(Verdict::Failed),
        _ => {}
    }
    let at = |limit: u64| {
        let values: Vec<f64> = values.iter().filter(|(seed, _)| *seed < limit).map(|(_, value)| *value).collect();
        look(&reference, &values, is_share)
    };
    let looks: Vec<Look> = seeds.limits().into_iter().map(at).collect();
    if looks.is_empty() {
        return blank(Verdict::Inconclusive);
    }
    let statement = Statement { looks, design: seeds.design.clone(), alpha: ALPHA };
    let decision = statement.decide();
    let taken = &statement.looks[decision.look];
    // Evidence against an uncertain value is the difference from it.
    let offset = if reference.runs.is_some() && !is_share { reference.value } else { 0.0 };
    let interval = decision.interval.map(|it| Interval { low: it.low + offset, high: it.high + offset, ..it });
    Judgement {
        verdict: Verdict::of(decision.outcome),
        adjusted: None,
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
    let deterministic = !is_share && MeanEstimate::of(values).has_no_spread();
    let (evidence, region) = match reference.runs {
        _ if is_share => (share_of(values), Region::between(low, high)),
        None => (Evidence::Mean(MeanEstimate::of(values)), Region::between(low, high)),
        Some((sd, n)) => {
            let estimate = MeanEstimate::against_published(values, PublishedMean { value: reference.value, sd, n });
            (Evidence::Mean(estimate), Region::between(low - reference.value, high - reference.value))
        }
    };
    Look { evidence, region, deterministic }
}

/// Values of 0 and 1 as a share.
#[must_use]
pub fn share_of(values: &[f64]) -> Evidence {
    Evidence::Share(Share::of(values.iter().map(|value| *value > 0.5)))
}

/// About how many more seeds would decide, with a power of 80 %; at least those that are missing to the fewest.
#[must_use]
pub fn more_seeds(look: &Look, alpha: f64) -> Option<u32> {
    let missing = u32::try_from(FEWEST_SEEDS.saturating_sub(look.evidence.n())).unwrap_or(0);
    match &look.evidence {
        _ if look.evidence.n() < 2 => Some(missing),
        Evidence::Mean(estimate) => {
            let more = estimate.more_seeds_for_power(look.region.room(estimate.value), alpha, POWER);
            more.map(|more| more.max(missing)).or((missing > 0).then_some(missing))
        }
        Evidence::Share(_) | Evidence::Shares(..) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::tests::{assert_close, numbers, reference};
    use proptest::prelude::*;

    fn with_failed(published: f64, margin: f64, values: &[f64], failed: usize) -> Judgement {
        let seeds: Vec<(u64, f64)> = (0..).zip(values.iter().copied()).collect();
        judge(Reference::within(published, margin), &seeds, failed, &Seeds::default(), false)
    }

    fn judged(published: f64, margin: f64, values: &[f64]) -> Judgement {
        with_failed(published, margin, values, 0)
    }

    fn verdict(published: f64, margin: f64, values: &[f64]) -> Verdict {
        judged(published, margin, values).verdict
    }

    #[test]
    fn equivalence_agrees_with_statsmodels() {
        let mut reproduced = 0;
        for case in reference()["equivalence"].as_array().unwrap() {
            let number = |key: &str| case[key].as_f64().unwrap();
            let values = numbers(&case["values"]);
            let judgement = judged(number("published"), number("margin"), &values);
            let expected = number("p") < 0.05 && (values.len() >= FEWEST_SEEDS);
            assert_eq!(judgement.verdict == Verdict::Reproduced, expected, "{judgement:?}");
            reproduced += u32::from(judgement.verdict == Verdict::Reproduced);
        }
        assert!((1..9).contains(&reproduced));
    }

    #[test]
    fn intervals_agree_with_scipy() {
        for case in reference()["one_sample"].as_array().unwrap() {
            let interval = judged(0.0, 1.0, &numbers(&case["values"])).interval.unwrap();
            let ends = numbers(&case["interval_90"]);
            assert_close(interval.low, ends[0], 1e-11);
            assert_close(interval.high, ends[1], 1e-11);
        }
    }

    #[test]
    fn the_band_decides() {
        // Mean 100, standard deviation 1, five seeds: 90 % interval 100 -+ 0.953.
        let values = [98.735_088_936, 99.367_544_468, 100.0, 100.632_455_532, 101.264_911_064];
        assert_eq!(verdict(100.0, 1.0, &values), Verdict::Reproduced);
        assert_eq!(verdict(103.0, 2.0, &values), Verdict::Differs);
        // Half a unit inside the edge: (t(0.95, n - 1) + 0.8416) / sqrt(n) falls below 0.5 at n = 27 (2.547 / 5.196 = 0.490).
        for published in [101.5, 102.5] {
            let judgement = judged(published, 2.0, &values);
            assert_eq!((judgement.verdict, judgement.more_seeds), (Verdict::Inconclusive, Some(22)));
        }
        assert_eq!(judged(102.0, 2.0, &values).more_seeds, None);
    }

    #[test]
    fn few_seeds_and_none() {
        let one = judged(5.0, 1.0, &[5.0]);
        assert_eq!((one.verdict, one.interval, one.more_seeds), (Verdict::Inconclusive, None, Some(2)));
        assert_eq!(one.note(), "too few seeds (1): at least 3 are needed");
        assert_eq!(verdict(5.0, 1.0, &[5.0, 5.001]), Verdict::Inconclusive);
        assert_eq!(verdict(5.0, 1.0, &[]), Verdict::NotRun);
        assert_eq!(with_failed(5.0, 1.0, &[], 3).verdict, Verdict::Failed);
        assert_eq!(verdict(5.0, 1.0, &[5.0, f64::NAN]), Verdict::Failed);
    }

    #[test]
    fn no_spread() {
        assert_eq!(verdict(0.1, 0.0, &[0.1, 0.1, 0.1]), Verdict::Reproduced);
        assert_eq!(verdict(0.1, 0.01, &[0.105, 0.105]), Verdict::Reproduced);
        assert_eq!(verdict(0.1, 0.01, &[0.12, 0.12]), Verdict::Differs);
    }

    #[test]
    fn an_uncertain_published_value_widens_the_interval() {
        let values = [99.0, 100.0, 101.0, 100.0, 100.0];
        let exact = judged(100.0, 1.0, &values);
        let seeds: Vec<(u64, f64)> = (0..).zip(values).collect();
        let uncertain = Reference { runs: Some((2.0, 5)), ..Reference::within(100.0, 1.0) };
        let judgement = judge(uncertain, &seeds, 0, &Seeds::default(), false);
        assert_eq!((exact.verdict, judgement.verdict), (Verdict::Reproduced, Verdict::Inconclusive));
        let (narrow, wide) = (exact.interval.unwrap(), judgement.interval.unwrap());
        assert!(wide.low < narrow.low && narrow.high < wide.high && wide.contains(100.0));
        assert_eq!(judgement.mean, Some(100.0));
    }

    #[test]
    fn planned_looks_are_taken_one_by_one() {
        let design = Some(Design::new(vec![3, 6, 9]));
        let seeds: Vec<(u64, f64)> = (0..).zip([100.0, 104.0, 96.0, 100.0, 100.2, 99.8]).collect();
        let at = |complete: usize, values: &[(u64, f64)]| {
            judge(Reference::within(100.0, 3.0), values, 0, &Seeds { design: design.clone(), complete }, false)
        };
        let (none, first, second) = (at(0, &seeds[..2]), at(1, &seeds), at(2, &seeds));
        assert_eq!((none.verdict, none.note().as_str()), (Verdict::Inconclusive, "the first of 3 looks is not complete"));
        assert_eq!((first.verdict, first.n), (Verdict::Inconclusive, 3));
        assert_eq!(first.note(), "open at look 1 of 3, with 3 seeds; `run` adds seeds");
        assert_eq!((second.verdict, second.n), (Verdict::Reproduced, 6));
        assert_eq!(second.note(), "decided at look 2 of 3, with 6 seeds");
    }

    /// One success of three published as a share of 0.33.
    #[test]
    fn shares_have_exact_intervals() {
        let seeds: Vec<(u64, f64)> = (0..20).map(|seed| (seed, f64::from(u8::from(seed % 4 != 0)))).collect();
        let judgement = judge(Reference::within(0.0, 0.4), &seeds, 0, &Seeds::default(), true);
        assert_eq!((judgement.verdict, judgement.mean), (Verdict::Differs, Some(0.75)));
    }

    #[test]
    fn words_and_margin() {
        assert_eq!(Verdict::NotRun.to_string(), "NOT RUN");
        assert_eq!(format!("{:>8}", Verdict::Failed), "  FAILED");
        assert_eq!((default_margin(-40.0), default_margin(0.0)), (2.0, 0.0));
    }

    /// `n` values with exactly this mean and sample standard deviation: pairs at equal distance, the mean itself if odd.
    fn sample(mean: f64, sd: f64, n: u32) -> Vec<f64> {
        let distance = sd * (f64::from(n - 1) / f64::from(n - n % 2)).sqrt();
        (0..n)
            .map(|i| {
                if i == n - n % 2 {
                    mean
                } else if i % 2 == 0 {
                    mean - distance
                } else {
                    mean + distance
                }
            })
            .collect()
    }

    proptest! {
        #[test]
        fn the_advised_number_of_seeds_decides_where_mean_and_spread_stay(mean in 95.0..105.0, margin in 0.5..4.0) {
            let judgement = judged(100.0, margin, &sample(mean, 1.0, 4));
            if let (Verdict::Inconclusive, Some(more)) = (judgement.verdict, judgement.more_seeds) {
                prop_assert_ne!(verdict(100.0, margin, &sample(mean, 1.0, 4 + more)), Verdict::Inconclusive);
            }
        }

        #[test]
        fn a_wider_margin_never_unmakes_a_reproduction(values in prop::collection::vec(90.0..110.0, 2..12), margin in 0.0..20.0) {
            if verdict(100.0, margin, &values) == Verdict::Reproduced {
                prop_assert_eq!(verdict(100.0, margin + 1.0, &values), Verdict::Reproduced);
            }
        }
    }
}
