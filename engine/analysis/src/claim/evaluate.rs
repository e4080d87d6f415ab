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

mod difference;
mod outcome;
mod side;

pub use outcome::{ClaimOutcome, ClaimVerdict};
pub use side::NumberOrigin;

use super::{Claim, Operand, Relation};
use difference::{ComparisonDesign, SideDifference};
use side::Side;
use statistics::{
    Seeds,
    statement::{Evidence, FEWEST_SEEDS, Statement},
    verdict::{self, Stage, too_few_seeds_in_words},
};

/// Probability of a wrong decision on each side, for claims of a direction.
const ALPHA_OF_DIRECTION: f64 = 0.025;

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
