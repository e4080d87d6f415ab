//! Holds a claim against the seeds.
//!
//! | claim                                       | rests on                                           |
//! |---------------------------------------------|-----------------------------------------------------|
//! | metric against number                       | differences from the number, Student-t              |
//! | two metrics, at least three seeds in common | paired differences over the common seeds, Student-t |
//! | two metrics, otherwise                      | difference of means of unrelated samples, Welch     |
//!
//! Where a side has fewer than three seeds and all of them are common, they are paired too, though they rarely decide.
//!
//! A direction is decided by the 95 % interval of the difference, `within` by the two one-sided tests of a published value
//! (90 % interval, as in [`verdict`]).

use super::{Claim, Operand, Quantity, Relation};
use crate::statistics::{
    Interval, MeanEstimate, PermutationTest,
    comparison::{by_seed, sign_flip_test, two_sample_permutation_test},
    estimators::mean,
    verdict,
};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, fmt};

/// Below this many seeds nothing is decided, unless seeds make no difference at all.
const FEWEST_SEEDS: usize = 3;

/// What the seeds say of a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ClaimOutcome {
    /// The whole interval is on the claimed side.
    Supported,
    /// The whole interval is on the other side.
    Refuted,
    /// The interval is on both sides, or there are too few seeds.
    Inconclusive,
    /// One of its metrics has no value yet.
    NotRun,
}

impl ClaimOutcome {
    /// The word that is shown.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            ClaimOutcome::Supported => "SUPPORTED",
            ClaimOutcome::Refuted => "REFUTED",
            ClaimOutcome::Inconclusive => "INCONCLUSIVE",
            ClaimOutcome::NotRun => "NOT RUN",
        }
    }
}

impl fmt::Display for ClaimOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.word())
    }
}

/// What the seeds say of a claim, with the numbers it rests on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClaimVerdict {
    /// The outcome.
    pub verdict: ClaimOutcome,
    /// Seeds it rests on: pairs, or seeds of the smaller sample.
    pub n: usize,
    /// True where both sides are compared seed by seed.
    pub paired: bool,
    /// Mean of left minus right, factors included; `None` where nothing has run or a value is not finite.
    pub difference: Option<f64>,
    /// Interval of the difference at the level that decides; `None` below two seeds.
    pub interval: Option<Interval>,
    /// Permutation test of a difference of 0, for claims of a direction.
    pub permutation: Option<PermutationTest>,
    /// About how many more seeds would decide, where that is open and an affordable number would.
    pub more_seeds: Option<u32>,
    /// What the reader must know: too few seeds, seeds that do not match, the smallest p that can be reached.
    pub notes: Vec<String>,
}

impl ClaimVerdict {
    fn not_run() -> Self {
        Self {
            verdict: ClaimOutcome::NotRun,
            n: 0,
            paired: false,
            difference: None,
            interval: None,
            permutation: None,
            more_seeds: None,
            notes: Vec::new(),
        }
    }
}

/// Holds `claim` against what `values` gives for each of its operands: one value per seed, `None` where there is none.
///
/// The claim's environment is for `values` to respect. Values that are not finite leave the claim inconclusive.
#[must_use]
pub fn evaluate(claim: &Claim, values: &dyn Fn(&Operand) -> Option<Vec<(u64, f64)>>) -> ClaimVerdict {
    match (Side::of(&claim.left, values), Side::of(&claim.right, values)) {
        (Some(left), Some(right)) => judge(claim.relation, &Compared::of(&left, &right)),
        _ => ClaimVerdict::not_run(),
    }
}

/// One side of a claim in numbers.
enum Side {
    Number(f64),
    BySeed(BTreeMap<u64, f64>),
}

impl Side {
    /// `None` where the metric has no value.
    fn of(quantity: &Quantity, values: &dyn Fn(&Operand) -> Option<Vec<(u64, f64)>>) -> Option<Self> {
        match quantity {
            Quantity::Number(number) => Some(Side::Number(*number)),
            Quantity::Measured { factor, operand } => {
                let seeds = by_seed(&values(operand).filter(|values| !values.is_empty())?);
                Some(Side::BySeed(seeds.into_iter().map(|(seed, value)| (seed, factor * value)).collect()))
            }
        }
    }

    fn mean(&self) -> f64 {
        match self {
            Side::Number(number) => *number,
            Side::BySeed(seeds) => mean(&values_of(seeds)),
        }
    }

    /// True where at least two seeds all gave the same number.
    fn has_no_spread(&self) -> bool {
        match self {
            Side::Number(_) => true,
            Side::BySeed(seeds) => MeanEstimate::of(&values_of(seeds)).has_no_spread(),
        }
    }
}

fn values_of(seeds: &BTreeMap<u64, f64>) -> Vec<f64> {
    seeds.values().copied().collect()
}

/// Which seeds are set against which.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Design {
    /// One agent against a number.
    OneSample,
    /// Two agents, seed by seed.
    Paired,
    /// Two agents without enough seeds in common.
    Unrelated,
}

/// Left minus right.
struct Compared {
    estimate: MeanEstimate,
    design: Design,
    permutation: PermutationTest,
    /// True where neither side depends on the seed.
    has_no_spread: bool,
    right_mean: f64,
}

impl Compared {
    fn of(left: &Side, right: &Side) -> Self {
        let (has_no_spread, right_mean) = (left.has_no_spread() && right.has_no_spread(), right.mean());
        let (differences, design) = match (left, right) {
            (Side::BySeed(left), Side::BySeed(right)) => {
                let common: Vec<f64> = left.iter().filter_map(|(seed, l)| right.get(seed).map(|r| l - r)).collect();
                if common.len() < FEWEST_SEEDS.min(left.len()).min(right.len()) {
                    return Self::unrelated(&values_of(left), &values_of(right), has_no_spread);
                }
                (common, Design::Paired)
            }
            (Side::BySeed(left), Side::Number(right)) => (left.values().map(|value| value - right).collect(), Design::OneSample),
            (Side::Number(left), Side::BySeed(right)) => (right.values().map(|value| left - value).collect(), Design::OneSample),
            (Side::Number(left), Side::Number(right)) => (vec![left - right], Design::OneSample),
        };
        Self {
            estimate: MeanEstimate::of(&differences),
            design,
            permutation: sign_flip_test(&differences),
            has_no_spread,
            right_mean,
        }
    }

    fn unrelated(left: &[f64], right: &[f64], has_no_spread: bool) -> Self {
        Self {
            estimate: MeanEstimate::difference(left, right),
            design: Design::Unrelated,
            permutation: two_sample_permutation_test(left, right),
            has_no_spread,
            right_mean: mean(right),
        }
    }
}

fn judge(relation: Relation, compared: &Compared) -> ClaimVerdict {
    let (estimate, n) = (&compared.estimate, compared.estimate.n());
    let tolerance = tolerance(relation, compared.right_mean);
    let level = if tolerance.is_some() { verdict::LEVEL } else { 0.95 };
    let interval = estimate.interval(level);
    let enough = n >= FEWEST_SEEDS || compared.has_no_spread;
    let verdict =
        interval.filter(|_| enough).map_or(ClaimOutcome::Inconclusive, |interval| decide(relation, tolerance, interval));
    let open = verdict == ClaimOutcome::Inconclusive;
    let distance = tolerance.map_or(estimate.value.abs(), |tolerance| (tolerance - estimate.value.abs()).abs());
    let permutation = tolerance.is_none().then_some(compared.permutation);
    ClaimVerdict {
        verdict,
        n,
        paired: compared.design == Design::Paired,
        difference: Some(estimate.value).filter(|value| value.is_finite()),
        interval,
        permutation,
        more_seeds: if open { more_seeds(estimate, level, distance) } else { None },
        notes: notes(compared, enough, permutation),
    }
}

/// How far the sides may be apart, for `within`.
fn tolerance(relation: Relation, right_mean: f64) -> Option<f64> {
    match relation {
        Relation::WithinPercent(percent) => Some(percent / 100.0 * right_mean.abs()),
        Relation::Within(distance) => Some(distance),
        Relation::Greater | Relation::GreaterOrEqual | Relation::Less | Relation::LessOrEqual => None,
    }
}

fn decide(relation: Relation, tolerance: Option<f64>, Interval { low, high, .. }: Interval) -> ClaimOutcome {
    let (supported, refuted) = match (relation, tolerance) {
        (_, Some(tolerance)) => (-tolerance <= low && high <= tolerance, high < -tolerance || tolerance < low),
        (Relation::Greater, _) => (low > 0.0, high <= 0.0),
        (Relation::GreaterOrEqual, _) => (low >= 0.0, high < 0.0),
        (Relation::Less, _) => (high < 0.0, low >= 0.0),
        // The relations that have a tolerance are the first arm's.
        (Relation::LessOrEqual | Relation::WithinPercent(_) | Relation::Within(_), _) => (high <= 0.0, low > 0.0),
    };
    match (supported, refuted) {
        (true, _) => ClaimOutcome::Supported,
        (_, true) => ClaimOutcome::Refuted,
        (false, false) => ClaimOutcome::Inconclusive,
    }
}

/// With fewer seeds than can decide, at least what is missing.
fn more_seeds(estimate: &MeanEstimate, level: f64, distance: f64) -> Option<u32> {
    let missing = u32::try_from(FEWEST_SEEDS.saturating_sub(estimate.n())).unwrap_or(0);
    if estimate.n() < 2 { Some(missing) } else { estimate.more_seeds(level, distance).map(|more| more.max(missing)) }
}

fn notes(compared: &Compared, enough: bool, permutation: Option<PermutationTest>) -> Vec<String> {
    let n = compared.estimate.n();
    let too_few = (!enough).then(|| format!("too few seeds ({n}): at least {FEWEST_SEEDS} are needed"));
    let unrelated = (compared.design == Design::Unrelated)
        .then(|| format!("fewer than {FEWEST_SEEDS} seeds in common: compared as unrelated samples"));
    let no_spread = compared.has_no_spread.then(|| "the seeds make no difference".to_owned());
    let smallest_p = permutation.filter(|_| !compared.has_no_spread).and_then(|test| test.note(0.05));
    [too_few, unrelated, no_spread, smallest_p].into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::claim::parse;
    use proptest::prelude::*;

    /// Evaluates `text` where agent `a` has `left` and `b` has `right`, both with seeds counted from the given first one.
    fn outcome(text: &str, (first_a, a): (u64, &[f64]), (first_b, b): (u64, &[f64])) -> ClaimVerdict {
        evaluate(&parse(text).unwrap(), &|operand| {
            let (first, values) = match operand.agent.as_str() {
                "a" => (first_a, a),
                "b" => (first_b, b),
                _ => return None,
            };
            Some((first..).zip(values.iter().copied()).collect())
        })
    }

    fn word(text: &str, a: &[f64], b: &[f64]) -> &'static str {
        outcome(text, (0, a), (0, b)).verdict.word()
    }

    /// Differences 1, 2, 3: mean 2, standard error 1/sqrt(3), t(0.975, 2) = 4.3027, interval 2 -+ 2.484.
    #[test]
    fn paired_by_hand() {
        let verdict = outcome("a.x > b.x", (0, &[11.0, 22.0, 33.0]), (0, &[10.0, 20.0, 30.0]));
        assert_eq!((verdict.verdict, verdict.n, verdict.paired), (ClaimOutcome::Inconclusive, 3, true));
        assert!((verdict.interval.unwrap().high - 4.484).abs() < 5e-4);
        // With five seeds the half-width would be 2.776 / sqrt(5) = 1.242, with four 3.182 / 2 = 1.591: one more decides.
        assert_eq!((verdict.difference, verdict.more_seeds), (Some(2.0), Some(1)));
        assert_eq!(verdict.permutation.unwrap().smallest_p, 0.25);
        assert!(verdict.notes[0].ends_with("0.25"), "{:?}", verdict.notes);
    }

    #[test]
    fn every_direction() {
        let (high, low) = ([10.0, 10.5, 11.0, 10.2], [5.0, 5.2, 5.4, 4.9]);
        for (claim, expected) in [
            ("a.x > b.x", "SUPPORTED"),
            ("a.x >= 1.5 * b.x", "SUPPORTED"),
            ("a.x >= 3 * b.x", "REFUTED"),
            ("a.x < b.x", "REFUTED"),
            ("b.x <= a.x", "SUPPORTED"),
            ("b.x > a.x", "REFUTED"),
            ("a.x > 9", "SUPPORTED"),
            ("9 > a.x", "REFUTED"),
            ("a.x > 10.4", "INCONCLUSIVE"),
            ("a.x > c.x", "NOT RUN"),
            ("a.x within 10 % of 10.2", "SUPPORTED"),
            ("a.x within 1 of b.x", "REFUTED"),
            ("a.x within 0.5 of 10", "INCONCLUSIVE"),
            ("a.x ~ 2 * b.x", "SUPPORTED"),
        ] {
            assert_eq!(word(claim, &high, &low), expected, "{claim}");
        }
    }

    /// Pairing removes what the seeds share.
    #[test]
    fn common_seeds_are_paired_and_others_are_not() {
        let (a, b) = ([1.1, 10.2, 100.1, 1000.3], [1.0, 10.0, 100.0, 1000.0]);
        assert_eq!(word("a.x > b.x", &a, &b), "SUPPORTED");
        let apart = outcome("a.x > b.x", (0, &a), (50, &b));
        assert_eq!((apart.verdict, apart.paired, apart.n), (ClaimOutcome::Inconclusive, false, 4));
        assert!(apart.notes[0].contains("unrelated samples"));
        // Seeds 2 to 5 against 0 to 3: two in common are too few to pair.
        assert!(!outcome("a.x > b.x", (2, &a), (0, &b)).paired);
        assert_eq!(outcome("a.x > b.x", (1, &a), (0, &b)).n, 3);
    }

    #[test]
    fn too_few_seeds_decide_nothing() {
        let two = outcome("a.x > b.x", (0, &[100.0, 100.1]), (0, &[1.0, 1.1]));
        assert_eq!((two.verdict, two.n, two.paired, two.more_seeds), (ClaimOutcome::Inconclusive, 2, true, Some(1)));
        assert_eq!(two.notes[0], "too few seeds (2): at least 3 are needed");
        let one = outcome("a.x > 1", (0, &[100.0]), (0, &[]));
        assert_eq!((one.verdict, one.interval, one.more_seeds), (ClaimOutcome::Inconclusive, None, Some(2)));
        assert_eq!(word("a.x > b.x", &[1.0, 2.0, 3.0], &[]), "NOT RUN");
    }

    #[test]
    fn seeds_that_make_no_difference_decide() {
        let verdict = outcome("a.x > b.x", (0, &[2.0, 2.0]), (0, &[1.0, 1.0]));
        assert_eq!(verdict.verdict, ClaimOutcome::Supported);
        assert_eq!(verdict.notes.last().unwrap(), "the seeds make no difference");
        assert_eq!(word("a.x > b.x", &[1.0, 1.0], &[1.0, 1.0]), "REFUTED");
        assert_eq!(word("a.x >= b.x", &[1.0, 1.0], &[1.0, 1.0]), "SUPPORTED");
        assert_eq!(word("a.x > b.x", &[2.0], &[1.0]), "INCONCLUSIVE");
    }

    #[test]
    fn values_that_are_not_finite_decide_nothing() {
        assert_eq!(word("a.x > 1", &[2.0, f64::NAN, 3.0], &[]), "INCONCLUSIVE");
        assert_eq!(word("a.x > 1", &[2.0, f64::INFINITY, 3.0], &[]), "INCONCLUSIVE");
    }
    #[test]
    fn the_order_and_the_episodes_of_seeds_do_not_matter() {
        let claim = parse("a.x > b.x").unwrap();
        let a = |operand: &Operand| operand.agent == "a";
        let one = evaluate(&claim, &|operand| {
            Some(if a(operand) { vec![(0, 3.0), (1, 4.0), (2, 6.0)] } else { vec![(0, 1.0), (1, 1.5), (2, 1.0)] })
        });
        let other = evaluate(&claim, &|operand| {
            Some(if a(operand) { vec![(2, 6.0), (0, 3.0), (1, 3.5), (1, 4.5)] } else { vec![(1, 1.5), (2, 1.0), (0, 1.0)] })
        });
        assert_eq!(one, other);
    }

    proptest! {
        #[test]
        fn a_mirrored_claim_has_the_same_outcome(pairs in prop::collection::vec((0.0..2.0, 0.5..2.5), 1..9), factor in 0.5..2.0) {
            let (a, b): (Vec<f64>, Vec<f64>) = pairs.into_iter().unzip();
            let claims = [format!("a.x > {factor} * b.x"), format!("{factor} * b.x < a.x")];
            let [one, other] = claims.map(|claim| outcome(&claim, (0, &a), (0, &b)));
            prop_assert_eq!((one.verdict, one.n, one.more_seeds), (other.verdict, other.n, other.more_seeds));
            prop_assert_eq!(one.permutation.map(|test| test.p), other.permutation.map(|test| test.p));
        }

        #[test]
        fn a_claim_and_its_contrary_are_never_both_supported(a in prop::collection::vec(0.0..9.0, 3..9), limit in 0.0..9.0) {
            let [above, below] = [">", "<="].map(|relation| outcome(&format!("a.x {relation} {limit}"), (0, &a), (0, &[])).verdict);
            prop_assert_eq!(above == ClaimOutcome::Supported, below == ClaimOutcome::Refuted);
            prop_assert_eq!(above == ClaimOutcome::Refuted, below == ClaimOutcome::Supported);
        }
    }
}
