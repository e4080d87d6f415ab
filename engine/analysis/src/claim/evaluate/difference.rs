//! The difference between the two sides of a claim, and the differences for which it holds.

use super::side::{NumberOrigin, Side, values_of};
use crate::claim::Relation;
use statistics::{
    Interval, MeanEstimate, PermutationTest,
    binomial::Share,
    comparison::{sign_flip_test, two_sample_permutation_test},
    statement::{Evidence, FEWEST_SEEDS, Look, Region},
    verdict::share_of,
};
use std::collections::BTreeMap;

/// Form in which the seeds of both sides are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ComparisonDesign {
    /// One agent against a number.
    OneSample,
    /// Two agents, seed by seed.
    Paired,
    /// Two agents without enough seeds in common, or two shares.
    Unrelated,
    /// Two agents, one of which reports its numbers itself.
    OfOtherEpisodes,
}

/// Left minus right, as `sign * evidence + offset`.
pub(super) struct SideDifference {
    pub(super) evidence: Evidence,
    sign: f64,
    offset: f64,
    pub(super) design: ComparisonDesign,
    pub(super) permutation: Option<PermutationTest>,
    /// Whether neither side depends on the seed.
    pub(super) has_no_spread: bool,
    /// Whether all pairs, of numbers that depend on the seed, have the same difference.
    pub(super) is_constant: bool,
    right_mean: f64,
}

impl SideDifference {
    fn of(left: &Side, right: &Side) -> Self {
        let imported = [left, right].map(|side| side.is_of(NumberOrigin::Imported));
        let reported = [left, right].map(|side| side.is_of(NumberOrigin::Reported));
        let minus = |values: &BTreeMap<u64, f64>, number: f64, sign: f64| {
            let differences: Vec<f64> = values.values().map(|value| sign * (value - number)).collect();
            Self::differences(&differences, ComparisonDesign::OneSample, imported)
        };
        let mut compared = match (left, right) {
            (Side::BySeed { values, .. }, Side::Number(number)) if left.is_share() => {
                Self::share(values, 1.0, -number)
            }
            (Side::Number(number), Side::BySeed { values, .. }) if right.is_share() => {
                Self::share(values, -1.0, *number)
            }
            (Side::BySeed { values, .. }, Side::BySeed { values: others, .. })
                if left.is_share() && right.is_share() =>
            {
                Self::unpaired(Evidence::Shares(successes(values), successes(others)), None)
            }
            (Side::BySeed { values, .. }, Side::BySeed { values: others, .. })
                if reported[0] != reported[1] =>
            {
                Self {
                    design: ComparisonDesign::OfOtherEpisodes,
                    ..Self::unrelated(values, others, imported)
                }
            }
            (Side::BySeed { values, .. }, Side::BySeed { values: others, .. }) => {
                Self::two_samples(values, others, imported)
            }
            (Side::BySeed { values, .. }, Side::Number(number)) => minus(values, *number, 1.0),
            (Side::Number(number), Side::BySeed { values, .. }) => minus(values, *number, -1.0),
            (Side::Number(left), Side::Number(right)) => {
                Self::differences(&[left - right], ComparisonDesign::OneSample, imported)
            }
        };
        compared.has_no_spread = left.has_no_spread() && right.has_no_spread();
        compared.is_constant = !compared.has_no_spread
            && compared.design == ComparisonDesign::Paired
            && left.is_fractional()
            && right.is_fractional()
            && compared.evidence.n() >= FEWEST_SEEDS
            && compared.evidence.has_no_spread();
        compared.right_mean = right.mean();
        compared
    }

    /// The difference for a relation. One in percent of seeds is compared with both edges, which these seeds move.
    pub(super) fn under(relation: Relation, left: &Side, right: &Side) -> Self {
        let compared = Self::of(left, right);
        let (Relation::WithinPercent(percent), Side::BySeed { .. }) = (relation, right) else {
            return compared;
        };
        let sign = if compared.right_mean < 0.0 { -1.0 } else { 1.0 };
        let above = |edge: f64| Self::of(left, &right.times(1.0 + sign * edge * percent / 100.0)).evidence;
        match (compared.evidence, above(-1.0), above(1.0)) {
            (Evidence::Mean(difference), Evidence::Mean(above_low), Evidence::Mean(above_high)) => Self {
                evidence: Evidence::BetweenMeans {
                    difference,
                    above_low,
                    above_high,
                },
                ..compared
            },
            (evidence, ..) => Self { evidence, ..compared },
        }
    }

    /// Seeds in common are paired, unless there are too few of them.
    fn two_samples(left: &BTreeMap<u64, f64>, right: &BTreeMap<u64, f64>, imported: [bool; 2]) -> Self {
        let common: Vec<f64> = left
            .iter()
            .filter_map(|(seed, l)| right.get(seed).map(|r| l - r))
            .collect();
        if common.len() >= FEWEST_SEEDS.min(left.len()).min(right.len()) {
            return Self::differences(&common, ComparisonDesign::Paired, imported);
        }
        Self::unrelated(left, right, imported)
    }

    fn unrelated(left: &BTreeMap<u64, f64>, right: &BTreeMap<u64, f64>, imported: [bool; 2]) -> Self {
        let (left, right) = (values_of(left), values_of(right));
        let evidence = Evidence::Mean(MeanEstimate::difference(&left, &right).of_others(&imported));
        Self::unpaired(evidence, Some(two_sample_permutation_test(&left, &right)))
    }

    /// If one of the two sides is imported, no seed adds a difference.
    fn differences(differences: &[f64], design: ComparisonDesign, imported: [bool; 2]) -> Self {
        let others = imported.contains(&true);
        let evidence = Evidence::Mean(MeanEstimate::of(differences).of_others(&[others]));
        Self {
            design,
            ..Self::unpaired(evidence, Some(sign_flip_test(differences)))
        }
    }

    fn share(values: &BTreeMap<u64, f64>, sign: f64, offset: f64) -> Self {
        Self {
            sign,
            offset,
            design: ComparisonDesign::OneSample,
            ..Self::unpaired(share_of(&values_of(values)), None)
        }
    }

    fn unpaired(evidence: Evidence, permutation: Option<PermutationTest>) -> Self {
        let design = ComparisonDesign::Unrelated;
        Self {
            evidence,
            sign: 1.0,
            offset: 0.0,
            design,
            permutation,
            has_no_spread: false,
            is_constant: false,
            right_mean: f64::NAN,
        }
    }

    pub(super) fn difference(&self) -> f64 {
        self.sign * self.evidence.value() + self.offset
    }

    /// An interval of the evidence, converted to one of the difference.
    pub(super) fn interval(&self, Interval { low, high, level }: Interval) -> Interval {
        let [low, high] = if self.sign > 0.0 {
            [low, high]
        } else {
            [-high, -low]
        };
        Interval {
            low: low + self.offset,
            high: high + self.offset,
            level,
        }
    }

    /// A region of the difference, converted to one of the evidence.
    fn region(&self, Region { low, high, closed }: Region) -> Region {
        let [low, high] = [low - self.offset, high - self.offset];
        if self.sign > 0.0 {
            Region { low, high, closed }
        } else {
            Region {
                low: -high,
                high: -low,
                closed,
            }
        }
    }

    pub(super) fn look(&self, relation: Relation, min_effect: Option<f64>) -> Look {
        let region = self.region(region(relation, self.right_mean));
        let alike = min_effect.map(|min_effect| self.region(Region::between(-min_effect, min_effect)));
        Look {
            evidence: self.evidence.clone(),
            region,
            alike,
            deterministic: self.has_no_spread || self.is_constant,
        }
    }
}

fn successes(values: &BTreeMap<u64, f64>) -> Share {
    Share::of(values.values().map(|value| *value > 0.5))
}

/// The differences for which a relation holds.
fn region(relation: Relation, right_mean: f64) -> Region {
    let (low, high, closed) = match relation {
        Relation::Greater => (0.0, f64::INFINITY, false),
        Relation::GreaterOrEqual => (0.0, f64::INFINITY, true),
        Relation::Less => (f64::NEG_INFINITY, 0.0, false),
        Relation::LessOrEqual => (f64::NEG_INFINITY, 0.0, true),
        Relation::Within(distance) => (-distance, distance, true),
        Relation::WithinPercent(percent) => {
            let distance = percent / 100.0 * right_mean.abs();
            (-distance, distance, true)
        }
    };
    Region { low, high, closed }
}
