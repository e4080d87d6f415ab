//! Shares of seeds that succeed: exact bounds of one share, and the interval of the difference of two.
//!
//! The bounds of one share are those of Clopper and Pearson (1934, doi:10.1093/biomet/26.4.404): the lower one is the
//! probability of success with which at least as many successes would occur in the share `nominal` of all samples. They
//! hold their level for every true share, and usually exceed it, since counts are discrete. The interval of the
//! difference of two independent shares combines the exact bounds of both by squaring and adding their distances (Zou
//! and Donner 2008, doi:10.1002/sim.3095). With score bounds instead (Newcombe 1998, Statistics in Medicine 17,
//! 873-890, method 10) it is narrower and errs more often than its level allows: with three seeds a side three times as
//! often at half a percent.
//!
//! Bounds have a relative error below 1e-11 up to ten thousand seeds.

use super::Interval;
use serde::{Deserialize, Serialize};

/// Number of seeds that succeeded, out of all seeds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Share {
    /// Seeds that succeeded, at most `n`.
    pub successes: u32,
    /// Number of all seeds.
    pub n: u32,
}

impl Share {
    /// Counts one outcome per seed.
    #[must_use]
    pub fn of(outcomes: impl IntoIterator<Item = bool>) -> Self {
        let count = |share: Self, success| Self {
            successes: share.successes + u32::from(success),
            n: share.n + 1,
        };
        outcomes.into_iter().fold(Self { successes: 0, n: 0 }, count)
    }

    /// The share as a number; NaN without seeds.
    #[must_use]
    pub fn value(self) -> f64 {
        f64::from(self.successes) / f64::from(self.n)
    }

    /// The exact lower bound at the one-sided level `nominal`, between 0 and one half; 0 without a success.
    #[must_use]
    pub fn lower_bound(self, nominal: f64) -> f64 {
        if self.successes == 0 {
            return 0.0;
        }
        let choices = ln_choices(self.n, self.successes);
        let (mut low, mut high) = (0.0, self.value());
        // With this number of halvings even a bound far below the share has all digits of a float.
        for _ in 0..80 {
            let middle = f64::midpoint(low, high);
            if self.at_least(middle, choices) < nominal {
                low = middle;
            } else {
                high = middle;
            }
        }
        f64::midpoint(low, high)
    }

    /// The exact upper bound at the one-sided level `nominal`, between 0 and one half; 1 if every seed succeeded.
    #[must_use]
    pub fn upper_bound(self, nominal: f64) -> f64 {
        let failures = Self {
            successes: self.n - self.successes,
            n: self.n,
        };
        1.0 - failures.lower_bound(nominal)
    }

    /// The exact interval at `level`, whose ends are bounds at half of the remaining probability each; `None` without
    /// seeds.
    #[must_use]
    pub fn interval(self, level: f64) -> Option<Interval> {
        let nominal = (1.0 - level) / 2.0;
        (self.n > 0).then(|| Interval {
            low: self.lower_bound(nominal),
            high: self.upper_bound(nominal),
            level,
        })
    }

    /// The interval of this share minus `other`, which has other seeds, combined from the exact bounds of both; `None`
    /// if either has no seed.
    #[must_use]
    pub fn interval_of_difference(self, other: Self, level: f64) -> Option<Interval> {
        let [one, two] = [self.interval(level)?, other.interval(level)?];
        let difference = self.value() - other.value();
        let below = (self.value() - one.low).hypot(two.high - other.value());
        let above = (one.high - self.value()).hypot(other.value() - two.low);
        Some(Interval {
            low: difference - below,
            high: difference + above,
            level,
        })
    }

    /// Probability of at least this number of successes, each of probability `p`, which is at most the share itself, so
    /// that the terms decrease.
    fn at_least(self, p: f64, ln_choices: f64) -> f64 {
        let (n, k) = (f64::from(self.n), f64::from(self.successes));
        let first = (ln_choices + k * p.ln() + (n - k) * (-p).ln_1p()).exp();
        let odds = p / (1.0 - p);
        let (mut term, mut sum) = (1.0, 1.0);
        for more in (self.successes..self.n).map(f64::from) {
            term *= (n - more) / (more + 1.0) * odds;
            sum += term;
            if term < f64::EPSILON * sum {
                break;
            }
        }
        first * sum
    }
}

/// Logarithm of the number of ways to choose `k` of `n`.
fn ln_choices(n: u32, k: u32) -> f64 {
    let fewer = k.min(n - k);
    (0..fewer)
        .map(|i| (f64::from(n - i) / f64::from(i + 1)).ln())
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{assert_close, numbers, sequential_reference};
    use proptest::prelude::*;

    fn assert_relative(left: f64, right: f64) {
        assert!((left - right).abs() <= 1e-11 * right, "{left} is not {right}");
    }

    #[test]
    fn bounds_agree_with_scipy() {
        for case in sequential_reference()["binomial"]["bounds"]
            .as_array()
            .unwrap()
            .iter()
            .map(numbers)
        {
            let share = Share {
                successes: case[0] as u32,
                n: case[1] as u32,
            };
            assert_relative(share.lower_bound(case[2]), case[3]);
            assert_relative(share.upper_bound(case[2]), case[4]);
            let interval = share.interval(1.0 - 2.0 * case[2]).unwrap();
            assert_close(interval.low, case[3], 1e-11);
            assert_close(interval.high, case[4], 1e-11);
        }
    }

    #[test]
    fn by_hand() {
        let share = Share::of([true, false, true, true]);
        assert_eq!((share, share.value()), (Share { successes: 3, n: 4 }, 0.75));
        assert_eq!(
            (
                Share { successes: 0, n: 4 }.lower_bound(0.05),
                Share { successes: 4, n: 4 }.upper_bound(0.05)
            ),
            (0.0, 1.0)
        );
        // All of n succeed with probability p^n.
        assert_relative(Share { successes: 5, n: 5 }.lower_bound(0.05), 0.05_f64.powf(0.2));
        assert_eq!(
            (
                Share::of([]).interval(0.9),
                Share::of([]).interval_of_difference(share, 0.9)
            ),
            (None, None)
        );
        assert_eq!(share.interval_of_difference(Share::of([]), 0.9), None);
    }

    /// Probability of each number of successes of `n`, each of probability `p`, which is not 0 and not 1.
    fn probabilities(n: u32, p: f64) -> Vec<f64> {
        let of = |successes: u32| {
            let (succeed, fail) = (f64::from(successes), f64::from(n - successes));
            (ln_choices(n, successes) + succeed * p.ln() + fail * (-p).ln_1p()).exp()
        };
        (0..=n).map(of).collect()
    }

    /// All samples of the study and of a few published runs, over a grid of true shares. A difference within the margin
    /// is found outside, and one outside is found within, in at most 5 % of them.
    #[test]
    fn differences_from_few_published_runs_are_wrong_in_one_of_twenty_at_most() {
        for (ours, published, margin) in [(20, 3, 0.2), (50, 3, 0.3), (20, 5, 0.2), (20, 10, 0.3)] {
            let wrong = worst_error(ours, published, margin, &truths());
            assert!(wrong <= 0.05, "{ours} against {published}: {wrong}");
        }
    }

    /// All samples of two equally good agents: one is found better no more often than the level allows, at the levels
    /// of claims, of looks and of families.
    #[test]
    fn equal_shares_are_told_apart_as_seldom_as_the_level_says() {
        let better = |nominal: f64, n: u32, m: u32, p: f64| -> f64 {
            let (left, right) = (probabilities(n, p), probabilities(m, p));
            let pairs = (0..=n).flat_map(|k| (0..=m).map(move |l| (k, l)));
            let wrong = pairs.filter(|&(k, l)| {
                let [one, two] = [(k, n), (l, m)].map(|(successes, n)| Share { successes, n });
                one.interval_of_difference(two, 1.0 - 2.0 * nominal).unwrap().low > 0.0
            });
            wrong.map(|(k, l)| left[k as usize] * right[l as usize]).sum()
        };
        for (nominal, n, m) in [(0.025, 5, 5), (0.025, 20, 5), (0.0125, 10, 10), (0.005, 3, 3)] {
            let worst = truths()
                .into_iter()
                .map(|p| better(nominal, n, m, p))
                .fold(0.0, f64::max);
            assert!(worst <= nominal, "{n} against {m} at {nominal}: {worst}");
        }
    }

    fn truths() -> Vec<f64> {
        let step = |step: i32| (f64::from(step) / 20.0).clamp(1e-9, 1.0 - 1e-9);
        (0..=20).map(step).collect()
    }

    /// The largest probability of a wrong decision on "the shares differ by at most `margin`" at 90 %.
    fn worst_error(ours: u32, published: u32, margin: f64, truths: &[f64]) -> f64 {
        let share = |successes, n| Share { successes, n };
        let mut decided = Vec::new();
        for (left, right) in (0..=ours).flat_map(|left| (0..=published).map(move |right| (left, right))) {
            let it = share(left, ours)
                .interval_of_difference(share(right, published), 0.9)
                .unwrap();
            let (within, outside) = (
                -margin <= it.low && it.high <= margin,
                it.high < -margin || margin < it.low,
            );
            decided.push((left as usize, right as usize, within, outside));
        }
        let tables = |n| truths.iter().map(|p| probabilities(n, *p)).collect::<Vec<_>>();
        let (of_ours, of_published) = (tables(ours), tables(published));
        let mut worst = 0.0_f64;
        for (p, left) in truths.iter().zip(&of_ours) {
            for (q, right) in truths.iter().zip(&of_published) {
                let is_within = (p - q).abs() <= margin + 1e-6;
                let wrong = decided
                    .iter()
                    .filter(|it| if is_within { it.3 } else { it.2 })
                    .map(|it| left[it.0] * right[it.1]);
                worst = worst.max(wrong.sum());
            }
        }
        worst
    }

    #[test]
    fn a_difference_by_hand() {
        // All of 5 and none of 4: each share has one bound apart from itself, the root of 0.05.
        let (all, none) = (Share { successes: 5, n: 5 }, Share { successes: 0, n: 4 });
        let interval = all.interval_of_difference(none, 0.9).unwrap();
        let below = (1.0 - 0.05_f64.powf(0.2)).hypot(1.0 - 0.05_f64.powf(0.25));
        assert_close(interval.low, 1.0 - below, 1e-11);
        assert_close(interval.high, 1.0, 1e-11);
        assert_eq!(all.interval_of_difference(Share::of([]), 0.9), None);
    }

    proptest! {
        /// For every true share, the bound exceeds it in at most the share `nominal` of samples, summed over all
        /// counts.
        #[test]
        fn bounds_hold_their_level(
            n in 1_u32..40,
            truth in 0.01..0.99,
            nominal in prop::sample::select(vec![0.0126, 0.05, 0.3]),
        ) {
            let truth: f64 = truth;
            let probability = |successes: u32| {
                let (succeed, fail) = (f64::from(successes), f64::from(n - successes));
                (ln_choices(n, successes) + succeed * truth.ln() + fail * (-truth).ln_1p()).exp()
            };
            let missed = |bound: fn(Share, f64) -> f64, beyond: fn(f64, f64) -> bool| -> f64 {
                (0..=n).filter(|&k| beyond(bound(Share { successes: k, n }, nominal),
                    truth)).map(probability).sum()
            };
            prop_assert!(missed(Share::lower_bound, |bound, truth| bound > truth) <= nominal + 1e-12);
            prop_assert!(missed(Share::upper_bound, |bound, truth| bound < truth) <= nominal + 1e-12);
        }
    }
}
