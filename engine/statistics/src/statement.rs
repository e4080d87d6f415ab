//! Statements about one number, tested at one look or at several planned ones, and the decisions of the seeds.
//!
//! A published value ("the mean lies within the margin") and a claim ("the difference is above 0") are both statements
//! that a number lies in a [`Region`]. The interval of the number decides: if it lies inside the region the statement
//! holds, outside it fails, and across an edge it is open. If only some differences matter, the whole interval must lie
//! among these for the statement to hold; one that lies among those that do not matter is alike. If looks were planned
//! ([`SequentialDesign`]), the interval of look `k` is the repeated confidence interval of Jennison and Turnbull (1989,
//! doi:10.1111/j.2517-6161.1989.tb01440.x): its nominal level is that of the look, and the first look that decides is
//! final, even if other statements ask for further seeds.
//!
//! [`holm`] decides a family of statements together (Holm 1979, doi:10.2307/4615733): with `m` of them, the one that is
//! decided at the strictest level must be decided at `alpha / m`, the next one at `alpha / (m - 1)`, and so on until
//! one is not.

use super::{Interval, MeanEstimate, binomial::Share, power::Room, spending::SequentialDesign};

/// Smallest number of seeds that decide, unless seeds make no difference at all.
pub const FEWEST_SEEDS: usize = 3;

/// The smallest share of a level that is tried: no family is larger than a million.
const LEAST_SHARE: f64 = 1e-6;

/// The evidence of the seeds about a number, as far as its interval needs it.
#[derive(Debug, Clone, PartialEq)]
pub enum Evidence {
    /// A mean, or a difference of two means: Student-t.
    Mean(MeanEstimate),
    /// A share of seeds: the exact binomial interval of Clopper and Pearson.
    Share(Share),
    /// A difference of two shares: exact bounds of both, squared and added.
    Shares(Share, Share),
    /// The same difference from a published share, to which no seed can be added.
    FromPublished(Share, Share),
    /// A difference from a number that is itself a mean, with the distances above two limits that move with that mean,
    /// such as a twentieth of it below and above it.
    BetweenMeans {
        /// The difference.
        difference: MeanEstimate,
        /// The value minus the lower limit.
        above_low: MeanEstimate,
        /// The value minus the upper limit.
        above_high: MeanEstimate,
    },
}

impl Evidence {
    /// The number itself; NaN without seeds.
    #[must_use]
    pub fn value(&self) -> f64 {
        match self {
            Evidence::Mean(estimate) => estimate.value,
            Evidence::BetweenMeans { difference, .. } => difference.value,
            Evidence::Share(share) => share.value(),
            Evidence::Shares(left, right) | Evidence::FromPublished(left, right) => {
                left.value() - right.value()
            }
        }
    }

    /// Number of seeds behind it; those of the smaller sample if both samples have seeds.
    #[must_use]
    pub fn n(&self) -> usize {
        match self {
            Evidence::Mean(estimate) => estimate.n(),
            Evidence::BetweenMeans { difference, .. } => difference.n(),
            Evidence::Share(share) | Evidence::FromPublished(share, _) => share.n as usize,
            Evidence::Shares(left, right) => left.n.min(right.n) as usize,
        }
    }

    /// The interval that errs with probability `nominal` on each side; `None` with too few seeds or a value
    /// that is not finite.
    #[must_use]
    pub fn interval(&self, nominal: f64) -> Option<Interval> {
        let level = 1.0 - 2.0 * nominal;
        match self {
            Evidence::Mean(estimate) => estimate.interval(level),
            Evidence::BetweenMeans { difference, .. } => difference.interval(level),
            Evidence::Share(share) => share.interval(level),
            Evidence::Shares(left, right) | Evidence::FromPublished(left, right) => {
                left.interval_of_difference(*right, level)
            }
        }
    }

    /// Whether it is about shares of seeds.
    #[must_use]
    pub fn is_of_shares(&self) -> bool {
        matches!(
            self,
            Evidence::Share(_) | Evidence::Shares(..) | Evidence::FromPublished(..)
        )
    }

    /// Whether the seeds of each sample of a mean all gave the same number.
    #[must_use]
    pub fn has_no_spread(&self) -> bool {
        match self {
            Evidence::Mean(estimate) => estimate.has_no_spread(),
            Evidence::BetweenMeans {
                above_low,
                above_high,
                ..
            } => above_low.has_no_spread() || above_high.has_no_spread(),
            Evidence::Share(_) | Evidence::Shares(..) | Evidence::FromPublished(..) => false,
        }
    }
}

/// The values for which a statement holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Smallest value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
    /// Whether the ends belong to it.
    pub closed: bool,
}

impl Region {
    /// Everything from `low` to `high`, ends included.
    #[must_use]
    pub fn between(low: f64, high: f64) -> Self {
        Self {
            low,
            high,
            closed: true,
        }
    }

    fn outcome(&self, interval: Interval) -> StatementOutcome {
        match interval {
            it if self.holds(it) => StatementOutcome::Holds,
            it if self.fails(it) => StatementOutcome::Fails,
            _ => StatementOutcome::Open,
        }
    }

    fn holds(&self, Interval { low, high, .. }: Interval) -> bool {
        if self.closed {
            self.low <= low && high <= self.high
        } else {
            self.low < low && high < self.high
        }
    }

    fn fails(&self, Interval { low, high, .. }: Interval) -> bool {
        if self.closed {
            high < self.low || self.high < low
        } else {
            high <= self.low || self.high <= low
        }
    }

    /// Whether a value lies between the ends.
    #[must_use]
    pub fn contains(&self, value: f64) -> bool {
        self.low < value && value < self.high
    }

    /// Distances that an interval around a value must keep to decide: to both ends from inside, or to the nearer one
    /// from outside.
    #[must_use]
    pub fn room(&self, value: f64) -> Room {
        if self.contains(value) {
            return Room::in_band(value, self.low, self.high);
        }
        Room::to_edge((value - self.low).abs().min((value - self.high).abs()))
    }
}

/// The seeds at one look.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Evidence of the seeds at this look.
    pub evidence: Evidence,
    /// The values for which the statement holds.
    pub region: Region,
    /// The values that differ too little to matter; `None` if any difference matters.
    pub alike: Option<Region>,
    /// Whether seeds make no difference, so that a few of them show as much as many. Equal seeds alone do not show it:
    /// counts and outcomes of 0 and 1 may be equal by chance.
    pub deterministic: bool,
}

/// A statement that seeds decide.
#[derive(Debug, Clone, PartialEq)]
pub struct Statement {
    /// The looks that are complete, in order; at least one.
    pub looks: Vec<Look>,
    /// The looks that were planned; `None` if the number of seeds is fixed.
    pub design: Option<SequentialDesign>,
    /// Whether the last complete look decides instead of the first that can, because the looks were not planned
    /// together.
    pub by_last: bool,
    /// Probability of a wrong decision on each side, over all looks together.
    pub alpha: f64,
}

/// The outcome of a statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StatementOutcome {
    /// The whole interval lies in the region.
    Holds,
    /// The whole interval lies outside.
    Fails,
    /// The whole interval differs too little to matter.
    Alike,
    /// The whole interval lies in the region, and part of it differs too little to matter.
    Direction,
    /// The interval crosses an edge and is wide enough to matter, or there are too few seeds.
    Open,
}

impl StatementOutcome {
    /// Whether further looks, or a less strict level, cannot change the outcome.
    fn is_final(self) -> bool {
        !matches!(self, StatementOutcome::Direction | StatementOutcome::Open)
    }
}

/// An outcome with the look on which it is based.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decision {
    /// The outcome at that look.
    pub outcome: StatementOutcome,
    /// Index of the look that decided, or of the last complete one if none did.
    pub look: usize,
    /// The interval at that look.
    pub interval: Option<Interval>,
}

impl Statement {
    /// The decision at the statement's own level.
    #[must_use]
    pub fn decide(&self) -> Decision {
        self.decide_at(self.alpha)
    }

    /// The decision if each side may be wrong with probability `alpha`: at the first look that decides, or at the last
    /// one.
    #[must_use]
    pub fn decide_at(&self, alpha: f64) -> Decision {
        let levels = self
            .design
            .as_ref()
            .map_or_else(|| vec![alpha], |design| design.nominal_levels(alpha));
        let mut last = Decision {
            outcome: StatementOutcome::Open,
            look: 0,
            interval: None,
        };
        let first = if self.by_last {
            self.looks.len().saturating_sub(1)
        } else {
            0
        };
        for (index, (look, nominal)) in self.looks.iter().zip(levels).enumerate().skip(first) {
            let interval = look.evidence.interval(nominal);
            last = Decision {
                outcome: look.outcome(nominal),
                look: index,
                interval,
            };
            if last.outcome.is_final() {
                break;
            }
        }
        last
    }
}

impl Statement {
    /// The strictest share of the statement's level at which the decision is the same, to three digits; `None` if it is
    /// open.
    #[must_use]
    pub fn strictest(&self) -> Option<f64> {
        let outcome = self.decide().outcome;
        let holds = |share: f64| self.decide_at(self.alpha * share).outcome == outcome;
        if !outcome.is_final() {
            return None;
        }
        if holds(LEAST_SHARE) {
            return Some(LEAST_SHARE);
        }
        let (mut open, mut decided) = (LEAST_SHARE.ln(), 0.0);
        while decided - open > 1e-3 {
            let middle = f64::midpoint(open, decided);
            if holds(middle.exp()) {
                decided = middle;
            } else {
                open = middle;
            }
        }
        Some(decided.exp())
    }
}

impl Look {
    fn outcome(&self, nominal: f64) -> StatementOutcome {
        let enough = self.evidence.n() >= FEWEST_SEEDS && !self.evidence.has_no_spread();
        if !enough && !self.deterministic {
            return StatementOutcome::Open;
        }
        if let Evidence::BetweenMeans {
            above_low,
            above_high,
            ..
        } = &self.evidence
        {
            return between(
                above_low.interval(1.0 - 2.0 * nominal),
                above_high.interval(1.0 - 2.0 * nominal),
            );
        }
        let interval = self.evidence.interval(nominal);
        interval.map_or(StatementOutcome::Open, |interval| self.outcome_by(interval))
    }

    /// One interval decides whether the statement holds, whether it fails and whether the difference matters, so that
    /// the three together err no more often than the interval.
    fn outcome_by(&self, interval: Interval) -> StatementOutcome {
        let outcome = self.region.outcome(interval);
        match self.alike {
            Some(alike) if alike.holds(interval) => StatementOutcome::Alike,
            Some(alike) if outcome == StatementOutcome::Holds && !alike.fails(interval) => {
                StatementOutcome::Direction
            }
            _ => outcome,
        }
    }
}

/// Two one-sided tests against limits that are means: of the value minus the lower limit, and minus the upper one.
fn between(above_low: Option<Interval>, above_high: Option<Interval>) -> StatementOutcome {
    match (above_low, above_high) {
        (Some(low), Some(high)) if low.low >= 0.0 && high.high <= 0.0 => StatementOutcome::Holds,
        (Some(low), Some(high)) if low.high < 0.0 || high.low > 0.0 => StatementOutcome::Fails,
        _ => StatementOutcome::Open,
    }
}

/// Whether each statement of a family is decided together with the others, so that the probability of any wrong
/// decision among them is that of a single one. The input is the strictest share of its level at which each is decided;
/// `None` if it is open by itself.
#[must_use]
pub fn holm(strictest: &[Option<f64>]) -> Vec<bool> {
    let mut order: Vec<(usize, f64)> = (0..)
        .zip(strictest)
        .filter_map(|(index, share)| Some((index, (*share)?)))
        .collect();
    order.sort_by(|one, other| one.1.total_cmp(&other.1));
    let mut decided = vec![false; strictest.len()];
    for (taken, (index, share)) in order.into_iter().enumerate() {
        if share * super::estimators::count(strictest.len() - taken) > 1.0 {
            break;
        }
        decided[index] = true;
    }
    decided
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(values: &[f64], region: Region) -> Look {
        let estimate = MeanEstimate::of(values);
        Look {
            deterministic: estimate.has_no_spread(),
            evidence: Evidence::Mean(estimate),
            region,
            alike: None,
        }
    }

    fn fixed(values: &[f64], region: Region) -> Statement {
        Statement {
            looks: vec![at(values, region)],
            design: None,
            by_last: false,
            alpha: 0.05,
        }
    }

    #[test]
    fn ends_belong_to_a_closed_region_only() {
        let exactly = |region| fixed(&[1.0, 1.0], region).decide().outcome;
        assert_eq!(exactly(Region::between(1.0, 2.0)), StatementOutcome::Holds);
        assert_eq!(
            exactly(Region {
                low: 1.0,
                high: f64::INFINITY,
                closed: false
            }),
            StatementOutcome::Fails
        );
        assert_eq!(exactly(Region::between(0.0, 0.5)), StatementOutcome::Fails);
    }

    #[test]
    fn the_first_look_that_decides_is_final() {
        let region = Region::between(-1.0, 1.0);
        let near = [0.0, 0.1, -0.1, 0.05, -0.05];
        let far = [0.0, 0.1, -0.1, 0.05, -0.05, 30.0, 31.0, 32.0, 33.0, 34.0];
        let design = Some(SequentialDesign::new(vec![5, 10]));
        let statement = Statement {
            looks: vec![at(&near, region), at(&far, region)],
            design,
            by_last: false,
            alpha: 0.05,
        };
        assert_eq!(
            (statement.decide().outcome, statement.decide().look),
            (StatementOutcome::Holds, 0)
        );
        let only = Statement {
            looks: vec![at(&far, region)],
            design: None,
            by_last: false,
            alpha: 0.05,
        };
        assert_ne!(only.decide().outcome, StatementOutcome::Holds);
    }

    #[test]
    fn a_planned_look_asks_for_more_than_a_single_one() {
        // Mean 0.8, standard deviation 1 over five seeds: the 90 % interval is 0.8 -+ 0.953.
        let values = [-0.464_911, 0.167_544, 0.8, 1.432_456, 2.064_911];
        let region = Region {
            low: -0.2,
            high: f64::INFINITY,
            closed: false,
        };
        assert_eq!(fixed(&values, region).decide().outcome, StatementOutcome::Holds);
        let planned = Statement {
            design: Some(SequentialDesign::new(vec![5, 10, 15])),
            by_last: false,
            ..fixed(&values, region)
        };
        assert_eq!(planned.decide().outcome, StatementOutcome::Open);
    }

    #[test]
    fn fewer_than_three_seeds_decide_only_without_spread() {
        let region = Region::between(0.0, 100.0);
        assert_eq!(
            fixed(&[50.0, 50.1], region).decide().outcome,
            StatementOutcome::Open
        );
        assert_eq!(
            fixed(&[50.0, 50.1, 50.2], region).decide().outcome,
            StatementOutcome::Holds
        );
        assert_eq!(
            fixed(&[50.0, 50.0], region).decide().outcome,
            StatementOutcome::Holds
        );
        assert_eq!(fixed(&[50.0], region).decide().outcome, StatementOutcome::Open);
    }

    /// Mean 0.1 with a standard error of 0.2 over five seeds: the 90 % interval is 0.1 -+ 2.132 * 0.2.
    #[test]
    fn what_differs_may_differ_too_little_to_matter() {
        let sd = 0.2 * 5f64.sqrt();
        let values: Vec<f64> = [-1.264_911, -0.632_456, 0.0, 0.632_456, 1.264_911]
            .map(|z| 0.1 + sd * z)
            .into();
        let above = Region {
            low: 0.0,
            high: f64::INFINITY,
            closed: false,
        };
        let outcome = |shift: f64, min_effect: Option<f64>| {
            let moved: Vec<f64> = values.iter().map(|value| value + shift).collect();
            let mut statement = fixed(&moved, above);
            statement.looks[0].alike = min_effect.map(|it| Region::between(-it, it));
            statement.decide().outcome
        };
        assert_eq!(outcome(0.0, None), StatementOutcome::Open);
        assert_eq!(outcome(0.0, Some(0.52)), StatementOutcome::Open);
        assert_eq!(outcome(0.0, Some(0.53)), StatementOutcome::Alike);
        // On the right side by 0.074 to 0.926: all of it matters, part of it, or none of it.
        assert_eq!(outcome(0.4, Some(0.05)), StatementOutcome::Holds);
        assert_eq!(outcome(0.4, Some(0.5)), StatementOutcome::Direction);
        assert_eq!(outcome(0.4, Some(0.93)), StatementOutcome::Alike);
        // On the wrong side by 0.074 to 0.926.
        assert_eq!(outcome(-0.6, Some(0.5)), StatementOutcome::Fails);
        assert_eq!(outcome(-0.6, Some(0.93)), StatementOutcome::Alike);
    }

    /// Three seeds of three give 97.5 % limits of 0.2924 and 1.
    #[test]
    fn shares_are_decided_by_exact_intervals() {
        let share = |low: f64| Look {
            evidence: Evidence::Share(Share { successes: 3, n: 3 }),
            region: Region::between(low, 1.0),
            alike: None,
            deterministic: false,
        };
        let outcome = |low| {
            Statement {
                looks: vec![share(low)],
                design: None,
                by_last: false,
                alpha: 0.025,
            }
            .decide()
            .outcome
        };
        assert_eq!(
            (outcome(0.292), outcome(0.293)),
            (StatementOutcome::Holds, StatementOutcome::Open)
        );
        let apart = Look {
            evidence: Evidence::Shares(Share { successes: 20, n: 20 }, Share { successes: 0, n: 20 }),
            region: Region {
                low: 0.0,
                high: f64::INFINITY,
                closed: false,
            },
            alike: None,
            deterministic: false,
        };
        assert_eq!(
            Statement {
                looks: vec![apart],
                design: None,
                by_last: false,
                alpha: 0.025
            }
            .decide()
            .outcome,
            StatementOutcome::Holds
        );
    }

    /// One-sided p values of 0.01, 0.02 and 0.04 for "above 0": Holm's levels are 0.05 / 3, 0.05 / 2 and
    /// 0.05.
    #[test]
    fn holm_steps_down() {
        let above = Region {
            low: 0.0,
            high: f64::INFINITY,
            closed: false,
        };
        let strictest = |p: f64| {
            // Two degrees of freedom: values with mean m and standard error 1 reach p if m is the quantile.
            let mean = super::super::student_t::quantile(1.0 - p, 2.0);
            let sd = 3f64.sqrt();
            fixed(&[mean - sd, mean, mean + sd], above).strictest()
        };
        let decided = |ps: [f64; 3]| holm(&ps.map(strictest));
        assert_eq!(decided([0.01, 0.02, 0.04]), [true, true, true]);
        assert_eq!(decided([0.02, 0.02, 0.02]), [false, false, false]);
        assert_eq!(decided([0.04, 0.01, 0.03]), [false, true, false]);
        assert_eq!(decided([0.049, 0.024, 0.016]), [true, true, true]);
        assert_eq!(decided([0.01, 0.06, 0.04]), [true, false, false]);
        let share = strictest(0.02).unwrap();
        assert!((share - 0.4).abs() < 1e-3, "{share}");
        assert_eq!((strictest(0.06), strictest(1e-9)), (None, Some(LEAST_SHARE)));
    }

    /// Five seeds that decide by themselves, and three more with which they do not.
    #[test]
    fn rounds_that_were_not_planned_together_are_decided_by_all_their_seeds() {
        let above = Region {
            low: 0.0,
            high: f64::INFINITY,
            closed: false,
        };
        let values = [1.0, 1.2, 0.8, 1.1, 0.9, -2.0, -1.0, 1.0];
        let of = |by_last| Statement {
            looks: vec![at(&values[..5], above), at(&values, above)],
            design: Some(SequentialDesign::new(vec![5, 8])),
            by_last,
            alpha: 0.025,
        };
        let planned = of(false).decide();
        assert_eq!((planned.outcome, planned.look), (StatementOutcome::Holds, 0));
        let rounds = of(true).decide();
        assert_eq!((rounds.outcome, rounds.look), (StatementOutcome::Open, 1));
        // The level of the last look is less than that of a single one.
        let single = MeanEstimate::of(&values).interval(0.95).unwrap();
        let interval = rounds.interval.unwrap();
        assert!(interval.low < single.low && single.high < interval.high);
    }

    proptest! {
        #[test]
        fn a_statement_is_decided_alike_at_every_level_from_its_strictest_on(mean in -3.0..3.0, share in 0.0..1.0) {
            let above = Region { low: 0.0, high: f64::INFINITY, closed: false };
            let statement = fixed(&[mean - 1.0, mean, mean + 1.0, mean + 0.5], above);
            let Some(strictest) = statement.strictest() else {
                return Ok(());
            };
            let level: f64 = strictest * 1.002 + share * (1.0 - strictest);
            let level = statement.alpha * level.min(1.0);
            prop_assert_eq!(statement.decide_at(level).outcome, statement.decide().outcome);
            if strictest > LEAST_SHARE {
                prop_assert_eq!(statement.decide_at(statement.alpha * strictest * 0.998).outcome, StatementOutcome::Open);
            }
        }
    }
}
