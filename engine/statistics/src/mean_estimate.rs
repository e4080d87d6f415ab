//! A mean, or a difference of two independent means, with its Student-t interval.

use super::{
    Interval,
    estimators::{count, mean, variance},
    power::{Room, fewest, power},
    student_t,
};
use serde::{Deserialize, Serialize};

/// Largest total number of seeds that a verdict asks for.
pub const MOST_SEEDS: u32 = 1000;

/// The mean of one sample, or the difference between the means of two independent samples, with the numbers that its
/// interval needs.
///
/// The standard error is `sqrt(sum of s^2 / n)` over the samples. The degrees of freedom are those of Welch and
/// Satterthwaite, `(sum of s^2 / n)^2 / sum of (s^2 / n)^2 / (n - 1)`, which is `n - 1` for one sample.
#[derive(Debug, Clone, PartialEq)]
pub struct MeanEstimate {
    /// The mean or the difference of means.
    pub value: f64,
    samples: Vec<Sample>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    n: usize,
    variance: f64,
    source: SampleOrigin,
}

/// Origin of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SampleOrigin {
    /// Seeds of a study, which may run more of them.
    Seeds,
    /// Imported runs, to which none can be added.
    Runs,
    /// Published runs with known mean and spread only.
    Published,
}

impl Sample {
    fn of(values: &[f64]) -> Self {
        Self {
            n: values.len(),
            variance: variance(values),
            source: SampleOrigin::Seeds,
        }
    }

    /// The squared standard error of its mean if it had `more` additional seeds, provided that it can grow, and the
    /// number of its seeds less one.
    fn error_with(&self, more: u32) -> (f64, f64) {
        let grows = self.source == SampleOrigin::Seeds;
        let n = count(self.n) + if grows { f64::from(more) } else { 0.0 };
        (self.variance / n, n - 1.0)
    }
}

/// A published mean with its spread over seeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PublishedMean {
    /// Mean over seeds.
    pub value: f64,
    /// Sample standard deviation over seeds (divisor n - 1), not a standard error.
    pub sd: f64,
    /// Number of seeds behind it: two or more.
    pub n: u32,
}

impl MeanEstimate {
    /// The mean of one value per seed.
    #[must_use]
    pub fn of(values: &[f64]) -> Self {
        Self {
            value: mean(values),
            samples: vec![Sample::of(values)],
        }
    }

    /// `mean(left) - mean(right)` of independent samples (Welch 1947).
    #[must_use]
    pub fn difference(left: &[f64], right: &[f64]) -> Self {
        Self {
            value: mean(left) - mean(right),
            samples: vec![Sample::of(left), Sample::of(right)],
        }
    }

    /// The same estimate with these samples, in their order, marked as runs to which none can be added.
    #[must_use]
    pub fn of_others(mut self, others: &[bool]) -> Self {
        for (sample, _) in self.samples.iter_mut().zip(others).filter(|(_, others)| **others) {
            sample.source = SampleOrigin::Runs;
        }
        self
    }

    /// `mean(values)` minus a mean that was published with its spread (Welch 1947). More seeds change only the sample
    /// of the study, so the interval never becomes narrower than the published spread allows.
    #[must_use]
    pub fn against_published(values: &[f64], published: PublishedMean) -> Self {
        let theirs = Sample {
            n: published.n as usize,
            variance: published.sd.powi(2),
            source: SampleOrigin::Published,
        };
        Self {
            value: mean(values) - published.value,
            samples: vec![Sample::of(values), theirs],
        }
    }

    /// Number of seeds in the smaller sample, not counting published ones.
    #[must_use]
    pub fn n(&self) -> usize {
        let counted = self
            .samples
            .iter()
            .filter(|sample| sample.source != SampleOrigin::Published);
        counted.map(|sample| sample.n).min().unwrap_or(0)
    }

    /// Whether every sample has at least two seeds and all seeds of a sample gave the same number.
    #[must_use]
    pub fn has_no_spread(&self) -> bool {
        self.samples.iter().all(|sample| sample.variance == 0.0)
    }

    /// The Student-t interval at `level`; `None` if a sample has fewer than two seeds or a value is not finite.
    #[must_use]
    pub fn interval(&self, level: f64) -> Option<Interval> {
        let half = self.half_width(level, 0);
        let interval = Interval {
            low: self.value - half,
            high: self.value + half,
            level,
        };
        (half.is_finite() && self.value.is_finite()).then_some(interval)
    }

    /// The Student-t interval whose ends are each a bound at the one-sided level `nominal`, as those of a
    /// [`SequentialDesign`](super::SequentialDesign): the interval at level `1 - 2 nominal`.
    #[must_use]
    pub fn interval_one_sided(&self, nominal: f64) -> Option<Interval> {
        self.interval(1.0 - 2.0 * nominal)
    }

    /// Degrees of freedom of the interval; NaN if there is no spread.
    #[must_use]
    pub fn degrees_of_freedom(&self) -> f64 {
        self.degrees_of_freedom_with(0)
    }

    fn degrees_of_freedom_with(&self, more: u32) -> f64 {
        let (mut sum, mut squares) = (0.0, 0.0);
        for (error, less_one) in self.samples.iter().map(|sample| sample.error_with(more)) {
            sum += error;
            squares += error.powi(2) / less_one;
        }
        sum * sum / squares
    }

    /// Half the width of the interval if each sample had `more` additional seeds and the same spread.
    fn half_width(&self, level: f64, more: u32) -> f64 {
        if self.has_no_spread() {
            return 0.0;
        }
        student_t::quantile(0.5 + level / 2.0, self.degrees_of_freedom_with(more))
            * self.standard_error_with(more)
    }

    fn standard_error_with(&self, more: u32) -> f64 {
        self.samples
            .iter()
            .map(|sample| sample.error_with(more).0)
            .sum::<f64>()
            .sqrt()
    }

    /// Approximate number of further seeds with which the interval clears the edges of `room` with probability
    /// `wanted`, if the true value and spread are the estimated ones; each of its ends is a bound at the one-sided
    /// level `nominal`. `None` if more than [`MOST_SEEDS`] in total would be needed, or if the spread is not known.
    #[must_use]
    pub fn more_seeds_for_power(&self, room: Room, nominal: f64, wanted: f64) -> Option<u32> {
        let power_with = |more| {
            power(
                room,
                self.standard_error_with(more),
                self.degrees_of_freedom_with(more),
                nominal,
            )
        };
        let (most, enough) = (self.most_more(), |more| power_with(more) >= wanted);
        let grow_all = self.samples.iter().all(|it| it.source == SampleOrigin::Seeds);
        if grow_all {
            fewest(1, most, enough)
        } else {
            // Beside a sample that does not grow, more seeds may leave fewer degrees of freedom and less power.
            (1..=most).find(|more| enough(*more))
        }
    }

    /// Number of seeds that may be added until the largest sample that can grow has [`MOST_SEEDS`].
    fn most_more(&self) -> u32 {
        let growing = self
            .samples
            .iter()
            .filter(|sample| sample.source == SampleOrigin::Seeds);
        let largest = growing.map(|sample| sample.n).max();
        let room = |largest| MOST_SEEDS.saturating_sub(u32::try_from(largest).unwrap_or(MOST_SEEDS));
        largest.map_or(0, room)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        power::POWER,
        tests::{assert_close, normal_pair, numbers, reference, sequential_reference},
    };

    #[test]
    fn welch_agrees_with_scipy() {
        for case in reference()["unpaired"].as_array().unwrap() {
            let estimate = MeanEstimate::difference(&numbers(&case["left"]), &numbers(&case["right"]));
            let (interval, ends) = (estimate.interval(0.95).unwrap(), numbers(&case["interval_95"]));
            assert_close(
                estimate.degrees_of_freedom(),
                case["degrees_of_freedom"].as_f64().unwrap(),
                1e-12,
            );
            assert_close(interval.low, ends[0], 1e-11);
            assert_close(interval.high, ends[1], 1e-11);
        }
    }

    /// Two values at -1 and 1: standard error 1, one degree of freedom, quantile 12.706.
    #[test]
    fn two_seeds_by_hand() {
        let interval = MeanEstimate::of(&[-1.0, 1.0]).interval(0.95).unwrap();
        assert_close(interval.high, 12.706_204_736_174_7, 1e-12);
        assert_eq!(interval.low, -interval.high);
    }

    #[test]
    fn the_number_of_seeds_asked_for_is_the_smallest_that_suffices() {
        let estimate = MeanEstimate::of(&[9.0, 10.0, 11.0]);
        let more = |distance: f64| estimate.more_seeds_for_power(Room::to_edge(distance), 0.025, POWER);
        // One more seed raises the power, and one fewer does not reach it.
        let enough = more(1.1).unwrap();
        let power_of = |more| {
            power(
                Room::to_edge(1.1),
                estimate.standard_error_with(more),
                estimate.degrees_of_freedom_with(more),
                0.025,
            )
        };
        assert!(
            power_of(enough) >= POWER && power_of(enough - 1) < POWER,
            "{enough}"
        );
        assert_eq!((more(0.0), more(0.01)), (None, None));
        assert_eq!(
            MeanEstimate::of(&[1.0]).more_seeds_for_power(Room::to_edge(1.0), 0.025, POWER),
            None
        );
    }

    /// The interval at the level 1 - p ends at 0.
    #[test]
    fn published_means_agree_with_scipy() {
        for case in sequential_reference()["published"].as_array().unwrap() {
            let number = |key: &str| case[key].as_f64().unwrap();
            let published = PublishedMean {
                value: number("value"),
                sd: number("sd"),
                n: number("n") as u32,
            };
            let estimate = MeanEstimate::against_published(&numbers(&case["values"]), published);
            assert_eq!(estimate.n(), numbers(&case["values"]).len());
            let interval = estimate.interval_one_sided(number("p") / 2.0).unwrap();
            let end = if estimate.value > 0.0 {
                interval.low
            } else {
                interval.high
            };
            assert!(end.abs() < 1e-9 * estimate.value.abs(), "{end} in {case}");
            assert!(
                !estimate
                    .interval(1.0 - number("p") * 1.001)
                    .unwrap()
                    .contains(0.0)
            );
        }
    }

    /// No number of seeds compensates for a published mean with a wide spread; without spread it is a known value.
    #[test]
    fn published_samples_do_not_grow() {
        let (ours, published) = (
            [9.0, 10.0, 11.0],
            PublishedMean {
                value: 9.0,
                sd: 4.0,
                n: 4,
            },
        );
        let wide = MeanEstimate::against_published(&ours, published);
        assert_eq!(wide.more_seeds_for_power(Room::to_edge(1.0), 0.05, POWER), None);
        let known = MeanEstimate::against_published(&ours, PublishedMean { sd: 0.0, ..published });
        let alone = MeanEstimate::of(&[0.0, 1.0, 2.0]);
        assert_eq!(
            (known.value, known.interval(0.9)),
            (alone.value, alone.interval(0.9))
        );
        assert_eq!(
            MeanEstimate::against_published(&ours, PublishedMean { n: 1, ..published }).interval(0.9),
            None
        );
    }

    /// Standard deviation 1, distance 1: according to statsmodels, a power of 0.8 at 5 % one-sided takes 7.73 seeds in
    /// total.
    #[test]
    fn seeds_for_power_in_one_sample_and_two() {
        let one = MeanEstimate::of(&[9.0, 10.0, 11.0]);
        assert_eq!(one.more_seeds_for_power(Room::to_edge(1.0), 0.05, 0.8), Some(5));
        // Both edges at one standard deviation: simulated power 0.795 with 10 in all, 0.850 with 11.
        assert_eq!(
            one.more_seeds_for_power(Room::in_band(10.0, 9.0, 11.0), 0.05, 0.8),
            Some(8)
        );
        let two = MeanEstimate::difference(&[9.0, 10.0, 11.0], &[9.0, 10.0, 11.0]);
        // Two samples: statsmodels asks for 13.10 in each.
        assert_eq!(two.more_seeds_for_power(Room::to_edge(1.0), 0.05, 0.8), Some(11));
        assert_eq!(
            MeanEstimate::of(&[1.0]).more_seeds_for_power(Room::to_edge(1.0), 0.05, 0.8),
            None
        );
    }

    #[test]
    fn values_that_are_not_finite_have_no_interval() {
        assert_eq!(MeanEstimate::of(&[1.0, f64::INFINITY]).interval(0.95), None);
        assert_eq!(MeanEstimate::of(&[1.0, f64::NAN, 2.0]).interval(0.95), None);
        assert_eq!(MeanEstimate::of(&[]).interval(0.95), None);
    }

    /// The share of 95 % intervals that contain the truth, over 10 000 experiments with 4 and 6 seeds.
    #[test]
    fn intervals_cover_the_truth() {
        let mut rng = contract::random::stream(&["test", "coverage"]);
        let (mut one, mut two) = (0, 0);
        for _ in 0..10_000 {
            let draws: Vec<f64> = (0..5).flat_map(|_| normal_pair(&mut rng)).collect();
            let left: Vec<f64> = draws[..4].iter().map(|draw| 3.0 + 2.0 * draw).collect();
            one += u32::from(MeanEstimate::of(&left).interval(0.95).unwrap().contains(3.0));
            let welch = MeanEstimate::difference(&left, &draws[4..]);
            two += u32::from(welch.interval(0.95).unwrap().contains(3.0));
        }
        // The standard error of a share is 0.0022; Welch's is an approximation.
        assert!((9430..=9570).contains(&one), "{one}");
        assert!((9400..=9600).contains(&two), "{two}");
    }
}
