//! Outcomes of claims, and the numbers on which they are based.

use statistics::{
    Interval, PermutationTest, TrainingShare,
    statement::{Statement, StatementOutcome},
    verdict::{self, Stage},
};
use std::fmt;

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
