//! Holds a claim against the seeds.
//!
//! | claim                                       | rests on                                             |
//! |---------------------------------------------|------------------------------------------------------|
//! | metric against number                       | differences from the number, Student-t               |
//! | two metrics, at least three seeds in common | paired differences over the common seeds, Student-t   |
//! | two metrics, otherwise                      | difference of means of unrelated samples, Welch      |
//! | share of successes against number           | exact binomial interval                              |
//! | two shares of successes                     | Newcombe's interval of the difference, not paired    |
//!
//! Where a side has fewer than three seeds and all of them are common, they are paired too, though they rarely decide.
//!
//! A direction is decided by the 95 % interval of the difference, `within` by the two one-sided tests of a published value
//! (90 % interval, as in [`verdict`]); where looks are planned, by the repeated interval of the look.

use super::{Claim, Operand, Quantity, Relation};
use crate::{
    results::SUCCESS,
    statistics::{
        Interval, MeanEstimate, PermutationTest, Seeds,
        binomial::Share,
        comparison::{by_seed, sign_flip_test, two_sample_permutation_test},
        estimators::mean,
        statement::{Evidence, FEWEST_SEEDS, Look, Outcome, Region, Statement},
        verdict::{self, Stage, share_of},
    },
};
use std::{collections::BTreeMap, fmt};

/// Probability of a wrong decision on each side, for claims of a direction.
const ALPHA_OF_DIRECTION: f64 = 0.025;

/// What the seeds say of a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClaimOutcome {
    /// The whole interval is on the claimed side.
    Supported,
    /// The whole interval is on the other side.
    Refuted,
    /// The interval is on both sides, or there are too few seeds.
    Inconclusive,
    /// It rests on a published value that was used to choose a setting.
    Calibrated,
    /// An agent that it speaks of made no update.
    NotTrained,
    /// One of its metrics has no value yet.
    NotRun,
}

impl ClaimOutcome {
    /// All of them, in the order in which they are counted.
    pub const ALL: [ClaimOutcome; 6] = [
        ClaimOutcome::Supported,
        ClaimOutcome::Refuted,
        ClaimOutcome::Inconclusive,
        ClaimOutcome::Calibrated,
        ClaimOutcome::NotTrained,
        ClaimOutcome::NotRun,
    ];

    /// The word that is shown.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            ClaimOutcome::Supported => "SUPPORTED",
            ClaimOutcome::Refuted => "REFUTED",
            ClaimOutcome::Inconclusive => "INCONCLUSIVE",
            ClaimOutcome::Calibrated => "CALIBRATED",
            ClaimOutcome::NotTrained => "NOT TRAINED",
            ClaimOutcome::NotRun => "NOT RUN",
        }
    }

    /// True where the seeds were asked.
    #[must_use]
    pub fn is_judged(self) -> bool {
        matches!(self, ClaimOutcome::Supported | ClaimOutcome::Refuted | ClaimOutcome::Inconclusive)
    }

    /// The outcome of a claim for what the seeds decide.
    #[must_use]
    pub fn of(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Holds => ClaimOutcome::Supported,
            Outcome::Fails => ClaimOutcome::Refuted,
            Outcome::Open => ClaimOutcome::Inconclusive,
        }
    }
}

impl fmt::Display for ClaimOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.word())
    }
}

/// What the seeds say of a claim, with the numbers it rests on.
#[derive(Debug, Clone, PartialEq)]
pub struct ClaimVerdict {
    /// The outcome.
    pub verdict: ClaimOutcome,
    /// The outcome when all claims of the study are taken together (Holm); `None` until they are.
    pub adjusted: Option<ClaimOutcome>,
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
    /// About how many more seeds would decide with a power of 80 %, where that is open and an affordable number would.
    pub more_seeds: Option<u32>,
    /// Where in the design it stands; `None` where the number of seeds is fixed.
    pub stage: Option<Stage>,
    /// What the reader must know: too few seeds, seeds that do not match, the smallest p that can be reached.
    pub notes: Vec<String>,
    /// What was decided; `None` where nothing could be.
    pub statement: Option<Statement>,
}

impl ClaimVerdict {
    /// An outcome without numbers.
    #[must_use]
    pub fn without(verdict: ClaimOutcome) -> Self {
        Self {
            verdict,
            adjusted: None,
            n: 0,
            paired: false,
            difference: None,
            interval: None,
            permutation: None,
            more_seeds: None,
            stage: None,
            notes: Vec::new(),
            statement: None,
        }
    }
}

/// Holds `claim` against what `values` gives for each of its operands: one value per seed, `None` where there is none.
///
/// The claim's environment is for `values` to respect. Values that are not finite leave the claim inconclusive.
#[must_use]
pub fn evaluate(claim: &Claim, values: &dyn Fn(&Operand) -> Option<Vec<(u64, f64)>>, seeds: &Seeds) -> ClaimVerdict {
    match (Side::of(&claim.left, values), Side::of(&claim.right, values)) {
        (Some(left), Some(right)) => judge(claim.relation, &left, &right, seeds),
        _ => ClaimVerdict::without(ClaimOutcome::NotRun),
    }
}

/// One side of a claim in numbers.
enum Side {
    Number(f64),
    BySeed {
        values: BTreeMap<u64, f64>,
        /// True for successes, 0 or 1 by seed.
        is_share: bool,
    },
}

impl Side {
    /// `None` where the metric has no value.
    fn of(quantity: &Quantity, values: &dyn Fn(&Operand) -> Option<Vec<(u64, f64)>>) -> Option<Self> {
        match quantity {
            Quantity::Number(number) => Some(Side::Number(*number)),
            Quantity::Measured { factor, operand } => {
                let seeds = by_seed(&values(operand).filter(|values| !values.is_empty())?);
                let values = seeds.into_iter().map(|(seed, value)| (seed, factor * value)).collect();
                Some(Side::BySeed { values, is_share: operand.metric == SUCCESS && *factor == 1.0 })
            }
        }
    }

    /// The side with the seeds below a number.
    fn below(&self, limit: u64) -> Self {
        match self {
            Side::Number(number) => Side::Number(*number),
            Side::BySeed { values, is_share } => {
                let values = values.iter().filter(|(seed, _)| **seed < limit).map(|(seed, value)| (*seed, *value)).collect();
                Side::BySeed { values, is_share: *is_share }
            }
        }
    }

    fn mean(&self) -> f64 {
        match self {
            Side::Number(number) => *number,
            Side::BySeed { values, .. } => mean(&values_of(values)),
        }
    }

    /// True where at least two seeds all gave the same number; equal successes say little about the next seed.
    fn has_no_spread(&self) -> bool {
        match self {
            Side::Number(_) => true,
            Side::BySeed { values, is_share } => !is_share && MeanEstimate::of(&values_of(values)).has_no_spread(),
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
    /// Two agents without enough seeds in common, or two shares.
    Unrelated,
}

/// Left minus right, as `sign * evidence + offset`.
struct Compared {
    evidence: Evidence,
    sign: f64,
    offset: f64,
    design: Design,
    permutation: Option<PermutationTest>,
    /// True where neither side depends on the seed.
    has_no_spread: bool,
    right_mean: f64,
}

impl Compared {
    fn of(left: &Side, right: &Side) -> Self {
        let mut compared = match (left, right) {
            (Side::BySeed { values, is_share: true }, Side::Number(number)) => Self::share(values, 1.0, -number),
            (Side::Number(number), Side::BySeed { values, is_share: true }) => Self::share(values, -1.0, *number),
            (Side::BySeed { values, is_share: true }, Side::BySeed { values: others, is_share: true }) => {
                Self::unpaired(Evidence::Shares(successes(values), successes(others)), None)
            }
            (Side::BySeed { values: left, .. }, Side::BySeed { values: right, .. }) => Self::two_samples(left, right),
            (Side::BySeed { values, .. }, Side::Number(number)) => {
                Self::differences(&values.values().map(|value| value - number).collect::<Vec<_>>(), Design::OneSample)
            }
            (Side::Number(number), Side::BySeed { values, .. }) => {
                Self::differences(&values.values().map(|value| number - value).collect::<Vec<_>>(), Design::OneSample)
            }
            (Side::Number(left), Side::Number(right)) => Self::differences(&[left - right], Design::OneSample),
        };
        compared.has_no_spread = left.has_no_spread() && right.has_no_spread();
        compared.right_mean = right.mean();
        compared
    }

    /// Seeds in common are paired, unless there are too few of them.
    fn two_samples(left: &BTreeMap<u64, f64>, right: &BTreeMap<u64, f64>) -> Self {
        let common: Vec<f64> = left.iter().filter_map(|(seed, l)| right.get(seed).map(|r| l - r)).collect();
        if common.len() >= FEWEST_SEEDS.min(left.len()).min(right.len()) {
            return Self::differences(&common, Design::Paired);
        }
        let (left, right) = (values_of(left), values_of(right));
        let evidence = Evidence::Mean(MeanEstimate::difference(&left, &right));
        Self::unpaired(evidence, Some(two_sample_permutation_test(&left, &right)))
    }

    fn differences(differences: &[f64], design: Design) -> Self {
        let evidence = Evidence::Mean(MeanEstimate::of(differences));
        Self { design, ..Self::unpaired(evidence, Some(sign_flip_test(differences))) }
    }

    fn share(values: &BTreeMap<u64, f64>, sign: f64, offset: f64) -> Self {
        Self { sign, offset, design: Design::OneSample, ..Self::unpaired(share_of(&values_of(values)), None) }
    }

    fn unpaired(evidence: Evidence, permutation: Option<PermutationTest>) -> Self {
        let design = Design::Unrelated;
        Self { evidence, sign: 1.0, offset: 0.0, design, permutation, has_no_spread: false, right_mean: f64::NAN }
    }

    fn difference(&self) -> f64 {
        self.sign * self.evidence.value() + self.offset
    }

    /// An interval of the evidence as one of the difference.
    fn interval(&self, Interval { low, high, level }: Interval) -> Interval {
        let [low, high] = if self.sign > 0.0 { [low, high] } else { [-high, -low] };
        Interval { low: low + self.offset, high: high + self.offset, level }
    }

    /// A region of the difference as one of the evidence.
    fn region(&self, Region { low, high, closed }: Region) -> Region {
        let [low, high] = [low - self.offset, high - self.offset];
        if self.sign > 0.0 { Region { low, high, closed } } else { Region { low: -high, high: -low, closed } }
    }

    fn look(&self, relation: Relation) -> Look {
        let region = self.region(region(relation, self.right_mean));
        Look { evidence: self.evidence.clone(), region, deterministic: self.has_no_spread }
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

fn judge(relation: Relation, left: &Side, right: &Side, seeds: &Seeds) -> ClaimVerdict {
    let is_direction = !matches!(relation, Relation::Within(_) | Relation::WithinPercent(_));
    let compared: Vec<Compared> =
        seeds.limits().into_iter().map(|limit| Compared::of(&left.below(limit), &right.below(limit))).collect();
    if compared.is_empty() {
        return ClaimVerdict { stage: Stage::of(seeds, None), ..ClaimVerdict::without(ClaimOutcome::Inconclusive) };
    }
    let statement = Statement {
        looks: compared.iter().map(|it| it.look(relation)).collect(),
        design: seeds.design.clone(),
        alpha: if is_direction { ALPHA_OF_DIRECTION } else { verdict::ALPHA },
    };
    let decision = statement.decide();
    let taken = &compared[decision.look];
    let verdict = ClaimOutcome::of(decision.outcome);
    let permutation = taken.permutation.filter(|_| is_direction);
    let open = verdict == ClaimOutcome::Inconclusive && seeds.design.is_none();
    ClaimVerdict {
        verdict,
        adjusted: None,
        n: taken.evidence.n(),
        paired: taken.design == Design::Paired,
        difference: Some(taken.difference()).filter(|value| value.is_finite()),
        interval: decision.interval.map(|interval| taken.interval(interval)),
        permutation,
        more_seeds: if open { verdict::more_seeds(&statement.looks[decision.look], statement.alpha) } else { None },
        stage: Stage::of(seeds, Some(&decision)),
        notes: notes(taken, permutation),
        statement: Some(statement),
    }
}

fn notes(compared: &Compared, permutation: Option<PermutationTest>) -> Vec<String> {
    let n = compared.evidence.n();
    let too_few =
        (n < FEWEST_SEEDS && !compared.has_no_spread).then(|| format!("too few seeds ({n}): at least {FEWEST_SEEDS} are needed"));
    let is_mean = matches!(compared.evidence, Evidence::Mean(_));
    let unrelated = (compared.design == Design::Unrelated && is_mean)
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
        evaluate(
            &parse(text).unwrap(),
            &|operand| {
                let (first, values) = match operand.agent.as_str() {
                    "a" => (first_a, a),
                    "b" => (first_b, b),
                    _ => return None,
                };
                Some((first..).zip(values.iter().copied()).collect())
            },
            &Seeds::default(),
        )
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
        // (t(0.975, n - 1) + 0.8416) / sqrt(n) is 2.012 with four seeds and 1.618 with five.
        assert_eq!((verdict.difference, verdict.more_seeds), (Some(2.0), Some(2)));
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
        let one = evaluate(
            &claim,
            &|operand| Some(if a(operand) { vec![(0, 3.0), (1, 4.0), (2, 6.0)] } else { vec![(0, 1.0), (1, 1.5), (2, 1.0)] }),
            &Seeds::default(),
        );
        let other = evaluate(
            &claim,
            &|operand| {
                Some(if a(operand) { vec![(2, 6.0), (0, 3.0), (1, 3.5), (1, 4.5)] } else { vec![(1, 1.5), (2, 1.0), (0, 1.0)] })
            },
            &Seeds::default(),
        );
        assert_eq!(one, other);
    }

    /// Nine successes of ten against none of ten, and against numbers.
    #[test]
    fn shares_of_successes_are_no_means() {
        let claim = |text: &str| {
            let share = |agent: &str| if agent == "a" { 9 } else { 0 };
            let seeds =
                |operand: &Operand| (0..10).map(|seed| (seed, f64::from(u8::from(seed < share(&operand.agent))))).collect();
            evaluate(&parse(text).unwrap(), &|operand| Some(seeds(operand)), &Seeds::default())
        };
        // The exact 95 % limits of 9 of 10 are 0.555 and 0.9975.
        assert_eq!(claim("a.success > 0.55").verdict, ClaimOutcome::Supported);
        assert_eq!(claim("0.55 < a.success").verdict, ClaimOutcome::Supported);
        assert_eq!(claim("a.success > 0.56").verdict, ClaimOutcome::Inconclusive);
        assert_eq!(claim("a.success < 0.5").verdict, ClaimOutcome::Refuted);
        let two = claim("a.success > b.success");
        assert_eq!((two.verdict, two.paired, two.difference), (ClaimOutcome::Supported, false, Some(0.9)));
        // Ten seeds without any success are no proof that there never is one.
        assert_eq!(claim("b.success < 0.1").verdict, ClaimOutcome::Inconclusive);
    }

    #[test]
    fn planned_looks_stop_at_the_first_decision() {
        let design = Some(crate::statistics::spending::Design::new(vec![3, 6, 9]));
        let values = [5.0, 5.5, 4.5, -20.0, -30.0, -40.0];
        let at = |complete| {
            let seeds = Seeds { design: design.clone(), complete };
            evaluate(&parse("a.x > 0").unwrap(), &|_| Some((0..).zip(values).collect()), &seeds)
        };
        assert_eq!((at(0).verdict, at(0).statement), (ClaimOutcome::Inconclusive, None));
        assert_eq!((at(1).verdict, at(1).n), (ClaimOutcome::Supported, 3));
        assert_eq!((at(2).verdict, at(2).n, at(2).stage.unwrap().look), (ClaimOutcome::Supported, 3, 1));
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
