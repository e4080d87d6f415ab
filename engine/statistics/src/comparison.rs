//! Comparisons of two agents: probability of improvement, exact permutation tests.

use super::{
    Bootstrap, Interval,
    bootstrap::below,
    estimators::{count, mean, sorted},
};
use contract::random::{Rng, stream};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Largest number of rearrangements that are listed; if there are more, they are drawn at random.
const MOST_LISTED: f64 = 1_048_576.0;
/// Number of rearrangements that are drawn if they cannot be listed.
const DRAWN: u32 = 100_000;

/// One value per seed. A seed that occurs more than once (once per episode, by mistake) counts once, with its
/// mean.
#[must_use]
pub fn by_seed(values: &[(u64, f64)]) -> BTreeMap<u64, f64> {
    let mut seeds: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    for &(seed, value) in values {
        seeds.entry(seed).or_default().push(value);
    }
    seeds
        .into_iter()
        .map(|(seed, values)| (seed, mean(&values)))
        .collect()
}

/// Probability that a seed of `left` scores above a seed of `right` on the same task, ties counted half,
/// averaged over tasks (Agarwal et al. 2021, arXiv:2108.13264, section 4.3). `left[k]` and `right[k]` hold
/// the seeds of task `k`.
///
/// Returns NaN if the numbers of tasks differ, there is no task, or a task has no seed.
#[must_use]
pub fn probability_of_improvement(left: &[Vec<f64>], right: &[Vec<f64>]) -> f64 {
    if left.len() != right.len() {
        return f64::NAN;
    }
    let on_task = |(left, right): (&Vec<f64>, &Vec<f64>)| {
        let wins: f64 = left
            .iter()
            .flat_map(|l| right.iter().map(move |r| win(*l, *r)))
            .sum();
        wins / (count(left.len()) * count(right.len()))
    };
    mean(&left.iter().zip(right).map(on_task).collect::<Vec<_>>())
}

fn win(left: f64, right: f64) -> f64 {
    if left > right {
        1.0
    } else if left < right {
        0.0
    } else {
        0.5
    }
}

/// Bootstrap interval of [`probability_of_improvement`]; both sides are resampled, task by task.
#[must_use]
pub fn probability_of_improvement_interval(
    left: &[Vec<f64>],
    right: &[Vec<f64>],
    bootstrap: Bootstrap,
) -> Option<Interval> {
    bootstrap.independent([left, right], |[left, right]| {
        probability_of_improvement(left, right)
    })
}

/// Result of a permutation test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PermutationTest {
    /// Two-sided p value: twice the smaller tail, at most 1; 1 if a value is not finite.
    pub p: f64,
    /// The smallest p that this many seeds can reach with any values.
    pub smallest_p: f64,
    /// False if there are too many rearrangements to list, and [`PermutationTest::p`] is an estimate from random ones.
    pub exact: bool,
}

impl PermutationTest {
    /// The remark that no result at all could be significant at `alpha`, if that is so.
    #[must_use]
    pub fn note(&self, alpha: f64) -> Option<String> {
        (self.smallest_p > alpha).then(|| {
            let digits = if self.smallest_p < 0.1 { 3 } else { 2 };
            format!(
                "too few seeds for a permutation test: the smallest p they can reach is {:.digits$}",
                self.smallest_p
            )
        })
    }

    fn exact(tails: Tails, smallest_p: f64) -> Self {
        Self {
            p: tails.p(0.0),
            smallest_p,
            exact: true,
        }
    }

    /// The observed arrangement is counted with those drawn (Phipson and Smyth 2010,
    /// doi:10.2202/1544-6115.1585).
    fn estimated(tails: Tails, smallest_p: f64) -> Self {
        Self {
            p: tails.p(1.0),
            smallest_p,
            exact: false,
        }
    }
}

/// Counts of rearrangements whose statistic is at least, and at most, the observed one.
struct Tails {
    observed: f64,
    tolerance: f64,
    above: f64,
    below: f64,
    all: f64,
}

impl Tails {
    /// `size` is the largest magnitude of the statistic; sums that differ only by rounding count as equal.
    fn new(observed: f64, size: f64) -> Self {
        Self {
            observed,
            tolerance: 1e-12 * size,
            above: 0.0,
            below: 0.0,
            all: 0.0,
        }
    }

    fn count(&mut self, statistic: f64) {
        self.above += f64::from(u8::from(statistic >= self.observed - self.tolerance));
        self.below += f64::from(u8::from(statistic <= self.observed + self.tolerance));
        self.all += 1.0;
    }

    fn p(&self, extra: f64) -> f64 {
        if !self.observed.is_finite() {
            return 1.0;
        }
        (2.0 * (self.above.min(self.below) + extra) / (self.all + extra)).min(1.0)
    }
}

/// Sign-flip test of paired differences against a mean of 0 (Fisher 1935): all 2^n signs, or 100 000 random
/// ones for more than 20 pairs, from the stream `["statistics", "permutation"]`. The smallest reachable p is
/// `2 / 2^n`.
#[must_use]
pub fn sign_flip_test(differences: &[f64]) -> PermutationTest {
    let values = sorted(differences);
    let arrangements = 2f64.powf(count(values.len()));
    let smallest_p = (2.0 / arrangements).min(1.0);
    let mut tails = Tails::new(values.iter().sum(), values.iter().map(|value| value.abs()).sum());
    if arrangements <= MOST_LISTED {
        for signs in 0..(1_u32 << values.len()) {
            tails.count(
                values
                    .iter()
                    .enumerate()
                    .map(|(bit, value)| if signs >> bit & 1 == 1 { -value } else { *value })
                    .sum(),
            );
        }
        return PermutationTest::exact(tails, smallest_p);
    }
    let mut rng = stream(&["statistics", "permutation"]);
    for _ in 0..DRAWN {
        tails.count(
            values
                .iter()
                // A product, since no processor can predict a random branch.
                .map(|value| value * [1.0, -1.0][below(2, &mut rng)])
                .sum(),
        );
    }
    PermutationTest::estimated(tails, smallest_p)
}

/// Permutation test of two independent samples against equal means: all splits, or 100 000 random ones if there are
/// more than 2^20, from the stream `["statistics", "permutation"]`. The smallest reachable p is 2 over their number.
#[must_use]
pub fn two_sample_permutation_test(left: &[f64], right: &[f64]) -> PermutationTest {
    let mut pooled = [sorted(left), sorted(right)].concat();
    let arrangements = binomial(pooled.len(), left.len());
    let smallest_p = (2.0 / arrangements).min(1.0);
    // With the pooled sum fixed, the sum of one side orders the splits as the difference of means does.
    let mut tails = Tails::new(
        pooled[..left.len()].iter().sum(),
        pooled.iter().map(|value| value.abs()).sum(),
    );
    if arrangements <= MOST_LISTED {
        count_splits(&pooled, left.len(), 0.0, &mut tails);
        return PermutationTest::exact(tails, smallest_p);
    }
    let mut rng = stream(&["statistics", "permutation"]);
    for _ in 0..DRAWN {
        draw_front(&mut pooled, left.len(), &mut rng);
        tails.count(pooled[..left.len()].iter().sum());
    }
    PermutationTest::estimated(tails, smallest_p)
}

/// Counts the sums of all choices of `choose` of `values`, each added to `sum`.
fn count_splits(values: &[f64], choose: usize, sum: f64, tails: &mut Tails) {
    if choose == 0 {
        return tails.count(sum);
    }
    for first in 0..=values.len() - choose {
        count_splits(&values[first + 1..], choose - 1, sum + values[first], tails);
    }
}

/// Moves a random choice of `choose` values to the front (Fisher and Yates).
fn draw_front(values: &mut [f64], choose: usize, rng: &mut Rng) {
    for place in 0..choose {
        values.swap(place, place + below(values.len() - place, rng));
    }
}

/// Number of ways to choose `k` of `n`.
fn binomial(n: usize, k: usize) -> f64 {
    (1..=k)
        .fold(1.0, |ways, i| ways * count(n - k + i) / count(i))
        .round()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{assert_close, numbers, reference};

    #[test]
    fn sign_flip_tests_agree_with_scipy() {
        for case in reference()["paired"].as_array().unwrap() {
            let pairs = numbers(&case["left"]).into_iter().zip(numbers(&case["right"]));
            let test = sign_flip_test(&pairs.map(|(left, right)| left - right).collect::<Vec<_>>());
            assert_close(test.p, case["p_exact"].as_f64().unwrap(), 1e-14);
        }
    }

    #[test]
    fn two_sample_tests_agree_with_scipy() {
        for case in reference()["unpaired"].as_array().unwrap() {
            let test = two_sample_permutation_test(&numbers(&case["left"]), &numbers(&case["right"]));
            assert_close(test.p, case["p_exact"].as_f64().unwrap(), 1e-14);
            assert!(test.exact);
        }
    }

    #[test]
    fn improvement_agrees_with_rliable() {
        let suite = &reference()["suite"];
        let tasks = |key: &str| {
            suite[key]
                .as_array()
                .unwrap()
                .iter()
                .map(numbers)
                .collect::<Vec<_>>()
        };
        let (x, y) = (tasks("x"), tasks("y"));
        assert_close(
            probability_of_improvement(&x, &y),
            suite["probability_of_improvement"].as_f64().unwrap(),
            1e-14,
        );
        let interval = probability_of_improvement_interval(&x, &y, Bootstrap::TABLE).unwrap();
        let ends = numbers(&suite["probability_interval_95"]);
        assert_close(interval.low, ends[0], 0.01);
        assert_close(interval.high, ends[1], 0.01);
    }

    #[test]
    fn improvement_by_hand() {
        // Of the four pairs one wins, two lose and one ties.
        assert_eq!(
            probability_of_improvement(&[vec![1.0, 2.0]], &[vec![1.0, 2.5]]),
            0.375
        );
        assert_eq!(
            probability_of_improvement(&[vec![1.0, 2.0]], &[vec![1.0, 2.0]]),
            0.5
        );
        assert!(probability_of_improvement(&[vec![1.0]], &[]).is_nan());
    }

    /// Three against three seeds reach 2/20, three pairs 2/8: never below 5 %.
    #[test]
    fn the_smallest_p_is_said() {
        let unpaired = two_sample_permutation_test(&[4.0, 5.0, 6.0], &[1.0, 2.0, 3.0]);
        assert_eq!((unpaired.p, unpaired.smallest_p), (0.1, 0.1));
        assert!(unpaired.note(0.05).unwrap().ends_with("0.10"));
        let paired = sign_flip_test(&[1.0, 2.0, 3.0]);
        assert_eq!((paired.p, paired.smallest_p), (0.25, 0.25));
        assert_eq!(sign_flip_test(&[1.0; 6]).note(0.05), None);
        assert_eq!(sign_flip_test(&[1.0; 6]).p, 2.0 / 64.0);
    }

    #[test]
    fn no_difference_is_no_evidence() {
        assert_eq!(sign_flip_test(&[0.0; 8]).p, 1.0);
        assert_eq!(
            two_sample_permutation_test(&[0.1 + 0.2, 0.3], &[0.3, 0.1 + 0.2]).p,
            1.0
        );
        assert_eq!(sign_flip_test(&[]).smallest_p, 1.0);
        assert_eq!(sign_flip_test(&[1.0, f64::NAN, 2.0]).p, 1.0);
    }

    #[test]
    fn many_seeds_are_sampled_and_agree_with_the_normal_limit() {
        // Mean 0.2, root mean square sqrt(1.04): z = 0.2 * sqrt(60) / sqrt(1.04) = 1.519, two-sided p =
        // 0.129.
        let differences: Vec<f64> = (0..60)
            .map(|i| 0.2 + if i % 2 == 0 { 1.0 } else { -1.0 })
            .collect();
        let test = sign_flip_test(&differences);
        assert!(!test.exact && (test.p - 0.129).abs() < 0.03, "{test:?}");
        // Difference of means 0.4 with standard deviation 1 in each group of 30: z = 1.549, p = 0.121.
        let right: Vec<f64> = differences[..30].iter().map(|value| value - 0.4).collect();
        let test = two_sample_permutation_test(&differences[30..], &right);
        assert!(!test.exact && (test.p - 0.121).abs() < 0.04, "{test:?}");
    }

    #[test]
    fn episodes_of_one_seed_count_once() {
        let values = [(7, 1.0), (7, 3.0), (8, 5.0)];
        assert_eq!(by_seed(&values), BTreeMap::from([(7, 2.0), (8, 5.0)]));
    }
}
