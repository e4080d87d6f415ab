//! Decides a claim by the seeds.
//!
//! | claim                                       | based on                                             |
//! |---------------------------------------------|------------------------------------------------------|
//! | metric against number                       | differences from the number, Student-t               |
//! | two metrics, at least three seeds in common | paired differences over the common seeds, Student-t   |
//! | two metrics, otherwise                      | difference of means of unrelated samples, Welch      |
//! | share of successes against number           | exact binomial interval                              |
//! | two shares of successes                     | exact bounds of both shares, not paired              |
//!
//! If a side has fewer than three seeds and all of them are common, they are paired too, although they rarely decide.
//! Numbers that a program reports of itself are not paired with measurements of the engine: they are of other episodes.
//!
//! `within N %` of a metric is decided by the same two tests of the left side against both edges, `1 - N / 100`
//! and `1 + N / 100` times the right side, whose seeds move the edges too.
//!
//! If a study names the difference that matters, a claim of a direction is SUPPORTED if the whole interval is larger,
//! DIRECTION ONLY if it is on the claimed side and part of it is smaller, and EQUIVALENT if the whole of it is smaller,
//! so that neither side is ahead by that much.
//!
//! A direction is decided by the 95 % interval of the difference, and `within` by the two one-sided tests of a
//! published value (90 % interval, as in [`verdict`]). With planned looks, the repeated interval of the look decides.

use super::{Claim, Operand, Quantity, Relation};
use contract::standard_metrics::SUCCESS;
use statistics::{
    Interval, MeanEstimate, PermutationTest, Seeds, TrainingShare,
    binomial::Share,
    comparison::{by_seed, sign_flip_test, two_sample_permutation_test},
    estimators::mean,
    statement::{Evidence, FEWEST_SEEDS, Look, Region, Statement, StatementOutcome},
    verdict::{self, Stage, share_of, too_few_seeds_in_words},
};
use std::{collections::BTreeMap, fmt};

/// Probability of a wrong decision on each side, for claims of a direction.
const ALPHA_OF_DIRECTION: f64 = 0.025;

/// The outcome of a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClaimOutcome {
    /// The whole interval is on the claimed side, and larger than the difference that matters.
    Supported,
    /// The whole interval is on the other side.
    Refuted,
    /// The whole interval is on the other side, after much less training than that of the source.
    NotAtThisBudget,
    /// The whole interval is smaller than the difference that matters.
    Equivalent,
    /// The whole interval is on the claimed side, and part of it is smaller than the difference that matters.
    DirectionOnly,
    /// The interval is on both sides, or there are too few seeds.
    Inconclusive,
    /// It would be supported, but depends on a published value that was used to choose a setting.
    Calibrated,
    /// The budget is too small for any result.
    NotJudged,
    /// It compares trained agents, and none of them is better than those that learned nothing.
    NotLearned,
    /// An agent in it made no update.
    NotTrained,
    /// One of its metrics has no value yet.
    NotRun,
}

impl ClaimOutcome {
    /// All outcomes, in the order in which they are counted.
    pub const ALL: [ClaimOutcome; 11] = [
        ClaimOutcome::Supported,
        ClaimOutcome::Refuted,
        ClaimOutcome::NotAtThisBudget,
        ClaimOutcome::Equivalent,
        ClaimOutcome::DirectionOnly,
        ClaimOutcome::Inconclusive,
        ClaimOutcome::Calibrated,
        ClaimOutcome::NotJudged,
        ClaimOutcome::NotLearned,
        ClaimOutcome::NotTrained,
        ClaimOutcome::NotRun,
    ];

    /// Word of the outcome in reports.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            ClaimOutcome::Supported => "SUPPORTED",
            ClaimOutcome::Refuted => "REFUTED",
            ClaimOutcome::NotAtThisBudget => verdict::NOT_AT_THIS_BUDGET,
            ClaimOutcome::NotJudged => "NOT JUDGED",
            ClaimOutcome::NotLearned => "NOT LEARNED",
            ClaimOutcome::Equivalent => "EQUIVALENT",
            ClaimOutcome::DirectionOnly => "DIRECTION ONLY",
            ClaimOutcome::Inconclusive => "INCONCLUSIVE",
            ClaimOutcome::Calibrated => "CALIBRATED",
            ClaimOutcome::NotTrained => "NOT TRAINED",
            ClaimOutcome::NotRun => "NOT RUN",
        }
    }

    /// Whether seeds decided the claim.
    #[must_use]
    pub fn is_judged(self) -> bool {
        matches!(
            self,
            ClaimOutcome::Supported
                | ClaimOutcome::Refuted
                | ClaimOutcome::NotAtThisBudget
                | ClaimOutcome::Equivalent
                | ClaimOutcome::DirectionOnly
                | ClaimOutcome::Inconclusive
        )
    }

    /// Whether more seeds may change the outcome.
    #[must_use]
    pub fn is_open(self) -> bool {
        matches!(self, ClaimOutcome::DirectionOnly | ClaimOutcome::Inconclusive)
    }

    /// The same outcome after a training that was too short to contradict the source.
    #[must_use]
    pub fn at_budget(self, training: Option<TrainingShare>) -> Self {
        let is_too_small = training.is_some_and(TrainingShare::is_too_small);
        if self == Self::Refuted && is_too_small {
            Self::NotAtThisBudget
        } else {
            self
        }
    }

    /// The outcome of a claim for a decision of the seeds.
    #[must_use]
    pub fn of(outcome: StatementOutcome) -> Self {
        match outcome {
            StatementOutcome::Holds => ClaimOutcome::Supported,
            StatementOutcome::Fails => ClaimOutcome::Refuted,
            StatementOutcome::Alike => ClaimOutcome::Equivalent,
            StatementOutcome::Direction => ClaimOutcome::DirectionOnly,
            StatementOutcome::Open => ClaimOutcome::Inconclusive,
        }
    }
}

impl fmt::Display for ClaimOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.word())
    }
}

/// The outcome of a claim, with the numbers on which it is based.
#[derive(Debug, Clone, PartialEq)]
pub struct ClaimVerdict {
    /// Outcome by the claim's own level.
    pub verdict: ClaimOutcome,
    /// The outcome when all claims of the study are judged together (Holm); `None` until they are.
    pub adjusted: Option<ClaimOutcome>,
    /// The strictest share of its level at which the decision is the same; `None` if the claim is open, or before that
    /// share is computed.
    pub strictest: Option<f64>,
    /// Number of seeds behind it: pairs, or seeds of the smaller sample.
    pub n: usize,
    /// Whether both sides are compared seed by seed.
    pub paired: bool,
    /// Mean of left minus right, factors included; `None` if nothing has run or a value is not finite.
    pub difference: Option<f64>,
    /// Interval of the difference at the level that decides; `None` below two seeds.
    pub interval: Option<Interval>,
    /// Permutation test of a difference of 0, for claims of a direction with a side that depends on the seed.
    pub permutation: Option<PermutationTest>,
    /// Approximate number of further seeds that would decide with a power of 80 %, if they were not added because of
    /// the results; `None` if the claim is decided, a look is left, or the number would be unaffordable.
    pub more_seeds: Option<u32>,
    /// Stage in the design; `None` if the number of seeds is fixed.
    pub stage: Option<Stage>,
    /// Remarks for the reader: too few seeds, seeds that do not match.
    pub notes: Vec<String>,
    /// The decided statement; `None` if nothing could be decided.
    pub statement: Option<Statement>,
}

impl ClaimVerdict {
    /// An outcome without numbers.
    #[must_use]
    pub fn without(verdict: ClaimOutcome) -> Self {
        Self {
            verdict,
            adjusted: None,
            strictest: None,
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

    /// Number of seeds behind it, as in `n = 5 pairs`.
    #[must_use]
    pub fn size(&self) -> String {
        format!("n = {} {}", self.n, if self.paired { "pairs" } else { "seeds" })
    }
}

/// The origin of the numbers of an operand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberOrigin {
    /// The engine measured them.
    Measured,
    /// A program reported them of itself.
    Reported,
    /// They are imported runs, to which no seed can be added.
    Imported,
}

/// Decides `claim` by the values that `values` gives for each of its operands: one value per seed, computed from the
/// seeds below a number; `None` if there is none. `origin` gives the origin of these values. Differences between the two
/// sides of a direction that are smaller than `min_effect` do not matter.
///
/// `values` must respect the claim's environment. Values that are not finite leave the claim inconclusive.
#[must_use]
pub fn evaluate(
    claim: &Claim,
    min_effect: Option<f64>,
    values: &dyn Fn(&Operand, u64) -> Option<Vec<(u64, f64)>>,
    origin: &dyn Fn(&Operand) -> NumberOrigin,
    seeds: &Seeds,
) -> ClaimVerdict {
    let sides = |limit| {
        let side = |quantity| Side::of(quantity, &|operand| values(operand, limit), origin);
        Some((side(&claim.left)?, side(&claim.right)?))
    };
    let at = |limit: u64| {
        let (left, right) = sides(limit)?;
        let (left, right) = (left.below(limit), right.below(limit));
        Some(SideDifference::under(claim.relation, &left, &right))
    };
    let has_run = sides(u64::MAX).is_some_and(|(left, right)| left.has_run() && right.has_run());
    let looks = seeds.limits().into_iter().map(at).collect::<Option<Vec<_>>>();
    match looks.filter(|_| has_run) {
        Some(looks) => judge(claim.relation, min_effect, &looks, seeds),
        None => ClaimVerdict::without(ClaimOutcome::NotRun),
    }
}

/// One side of a claim in numbers.
enum Side {
    Number(f64),
    BySeed {
        values: BTreeMap<u64, f64>,
        kind: NumberKind,
    },
}

/// The kind of the numbers of a side.
#[derive(Debug, Clone, Copy)]
struct NumberKind {
    /// Whether they are successes, 0 or 1 by seed.
    is_share: bool,
    /// Whether they are whole numbers before the factor, as counts are.
    is_whole: bool,
    origin: NumberOrigin,
}

impl Side {
    /// `None` if the metric is not known.
    fn of(
        quantity: &Quantity,
        values: &dyn Fn(&Operand) -> Option<Vec<(u64, f64)>>,
        origin: &dyn Fn(&Operand) -> NumberOrigin,
    ) -> Option<Self> {
        match quantity {
            Quantity::Number(number) => Some(Side::Number(*number)),
            Quantity::Measured { factor, operand } => {
                let values = by_seed(&values(operand)?);
                let kind = NumberKind {
                    is_share: operand.metric == SUCCESS && *factor == 1.0,
                    is_whole: values.values().all(|value| value.fract() == 0.0),
                    origin: origin(operand),
                };
                Some(Side::BySeed { values, kind }.times(*factor))
            }
        }
    }

    fn times(&self, factor: f64) -> Self {
        match self {
            Side::Number(number) => Side::Number(factor * number),
            Side::BySeed { values, kind } => Side::BySeed {
                values: values
                    .iter()
                    .map(|(seed, value)| (*seed, factor * value))
                    .collect(),
                kind: *kind,
            },
        }
    }

    /// The side with the seeds below a number.
    fn below(&self, limit: u64) -> Self {
        match self {
            Side::Number(number) => Side::Number(*number),
            Side::BySeed { values, kind } => Side::BySeed {
                values: values
                    .range(..limit)
                    .map(|(seed, value)| (*seed, *value))
                    .collect(),
                kind: *kind,
            },
        }
    }

    fn mean(&self) -> f64 {
        match self {
            Side::Number(number) => *number,
            Side::BySeed { values, .. } => mean(&values_of(values)),
        }
    }

    /// Whether at least two seeds all gave the same number. Equal successes, and equal counts, say little about the
    /// next seed.
    fn has_no_spread(&self) -> bool {
        match self {
            Side::Number(_) => true,
            Side::BySeed { values, kind } => {
                !kind.is_share && !kind.is_whole && MeanEstimate::of(&values_of(values)).has_no_spread()
            }
        }
    }

    /// Whether seeds gave numbers that cannot be counts, so that equal differences do not come about by chance.
    fn is_fractional(&self) -> bool {
        matches!(self, Side::BySeed { kind, .. } if !kind.is_share && !kind.is_whole)
    }

    fn has_run(&self) -> bool {
        !matches!(self, Side::BySeed { values, .. } if values.is_empty())
    }

    fn is_share(&self) -> bool {
        matches!(self, Side::BySeed { kind, .. } if kind.is_share)
    }

    fn is_of(&self, origin: NumberOrigin) -> bool {
        matches!(self, Side::BySeed { kind, .. } if kind.origin == origin)
    }
}

fn values_of(seeds: &BTreeMap<u64, f64>) -> Vec<f64> {
    seeds.values().copied().collect()
}

/// Form in which the seeds of both sides are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ComparisonDesign {
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
struct SideDifference {
    evidence: Evidence,
    sign: f64,
    offset: f64,
    design: ComparisonDesign,
    permutation: Option<PermutationTest>,
    /// Whether neither side depends on the seed.
    has_no_spread: bool,
    /// Whether all pairs, of numbers that depend on the seed, have the same difference.
    is_constant: bool,
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
    fn under(relation: Relation, left: &Side, right: &Side) -> Self {
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

    fn difference(&self) -> f64 {
        self.sign * self.evidence.value() + self.offset
    }

    /// An interval of the evidence, converted to one of the difference.
    fn interval(&self, Interval { low, high, level }: Interval) -> Interval {
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

    fn look(&self, relation: Relation, min_effect: Option<f64>) -> Look {
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

fn judge(
    relation: Relation,
    min_effect: Option<f64>,
    compared: &[SideDifference],
    seeds: &Seeds,
) -> ClaimVerdict {
    let is_direction = relation.is_direction();
    if compared.is_empty() {
        return ClaimVerdict {
            stage: Stage::of(seeds, None),
            ..ClaimVerdict::without(ClaimOutcome::Inconclusive)
        };
    }
    let statement = Statement {
        looks: compared.iter().map(|it| it.look(relation, min_effect)).collect(),
        design: seeds.design.clone(),
        by_last: seeds.is_pooled(),
        alpha: if is_direction {
            ALPHA_OF_DIRECTION
        } else {
            verdict::ALPHA
        },
    };
    let decision = statement.decide();
    let taken = &compared[decision.look];
    let verdict = ClaimOutcome::of(decision.outcome);
    let stage = Stage::of(seeds, Some(&decision));
    let open = verdict.is_open() && stage.is_none_or(|it| it.is_last());
    ClaimVerdict {
        verdict,
        adjusted: None,
        strictest: None,
        n: taken.evidence.n(),
        paired: taken.design == ComparisonDesign::Paired,
        difference: Some(taken.difference()).filter(|value| value.is_finite()),
        interval: decision.interval.map(|interval| taken.interval(interval)),
        permutation: taken.permutation.filter(|_| is_direction && !taken.has_no_spread),
        more_seeds: if open {
            verdict::more_seeds(&statement.looks[decision.look], statement.alpha)
        } else {
            None
        },
        stage,
        notes: notes(taken),
        statement: Some(statement),
    }
}

fn notes(compared: &SideDifference) -> Vec<String> {
    let n = compared.evidence.n();
    let too_few = (n < FEWEST_SEEDS && !compared.has_no_spread).then(|| too_few_seeds_in_words(n));
    let is_mean = matches!(
        compared.evidence,
        Evidence::Mean(_) | Evidence::BetweenMeans { .. }
    );
    let unrelated = match compared.design {
        ComparisonDesign::Unrelated if is_mean => Some(format!(
            "fewer than {FEWEST_SEEDS} seeds in common: compared as unrelated samples"
        )),
        ComparisonDesign::OfOtherEpisodes => Some(
            "one side is reported by a program and not measured on the same episodes: compared as unrelated samples"
                .to_owned(),
        ),
        _ => None,
    };
    let no_spread = compared
        .has_no_spread
        .then(|| "the seeds make no difference".to_owned());
    let constant = compared
        .is_constant
        .then(|| "every seed gives the same difference".to_owned());
    let is_decided = compared.has_no_spread || compared.is_constant;
    let alike = (n >= FEWEST_SEEDS && !is_decided && compared.evidence.has_no_spread())
        .then(|| verdict::ALIKE.to_owned());
    [too_few, unrelated, no_spread, constant, alike]
        .into_iter()
        .flatten()
        .collect()
}

#[cfg(test)]
mod tests;
