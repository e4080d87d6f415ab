//! A mean, or a difference of two independent means, with its Student-t interval.

use super::{
    Interval,
    estimators::{count, mean, variance},
    student_t,
};

/// No verdict asks for more seeds than this in all.
pub const MOST_SEEDS: u32 = 1000;

/// The mean of one sample, or the difference between the means of two independent samples, with what its interval needs.
///
/// The standard error is `sqrt(sum of s^2 / n)` over the samples and the degrees of freedom are those of Welch and
/// Satterthwaite, `(sum of s^2 / n)^2 / sum of (s^2 / n)^2 / (n - 1)`: for one sample the familiar `n - 1`.
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
}

impl Sample {
    fn of(values: &[f64]) -> Self {
        Self { n: values.len(), variance: variance(values) }
    }
}

impl MeanEstimate {
    /// The mean of one value per seed.
    #[must_use]
    pub fn of(values: &[f64]) -> Self {
        Self { value: mean(values), samples: vec![Sample::of(values)] }
    }

    /// `mean(left) - mean(right)` of samples that share nothing (Welch 1947).
    #[must_use]
    pub fn difference(left: &[f64], right: &[f64]) -> Self {
        Self { value: mean(left) - mean(right), samples: vec![Sample::of(left), Sample::of(right)] }
    }

    /// Seeds in the smaller sample.
    #[must_use]
    pub fn n(&self) -> usize {
        self.samples.iter().map(|sample| sample.n).min().unwrap_or(0)
    }

    /// True where every sample has at least two seeds and all seeds of a sample gave the same number.
    #[must_use]
    pub fn has_no_spread(&self) -> bool {
        self.samples.iter().all(|sample| sample.variance == 0.0)
    }

    /// The Student-t interval at `level`; `None` where a sample has fewer than two seeds or a value is not finite.
    #[must_use]
    pub fn interval(&self, level: f64) -> Option<Interval> {
        let half = self.half_width(level, 0);
        let interval = Interval { low: self.value - half, high: self.value + half, level };
        (half.is_finite() && self.value.is_finite()).then_some(interval)
    }

    /// Degrees of freedom of the interval; NaN where there is no spread.
    #[must_use]
    pub fn degrees_of_freedom(&self) -> f64 {
        self.degrees_of_freedom_with(0)
    }

    fn degrees_of_freedom_with(&self, more: u32) -> f64 {
        let (mut sum, mut squares) = (0.0, 0.0);
        for sample in &self.samples {
            let n = count(sample.n) + f64::from(more);
            sum += sample.variance / n;
            squares += (sample.variance / n).powi(2) / (n - 1.0);
        }
        sum * sum / squares
    }

    /// Half the width of the interval if each sample had `more` seeds more and the same spread.
    fn half_width(&self, level: f64, more: u32) -> f64 {
        if self.has_no_spread() {
            return 0.0;
        }
        let error: f64 = self.samples.iter().map(|sample| sample.variance / (count(sample.n) + f64::from(more))).sum();
        student_t::quantile(0.5 + level / 2.0, self.degrees_of_freedom_with(more)) * error.sqrt()
    }

    /// About how many more seeds bring the interval's half-width below `distance`, if mean and spread stay as they are;
    /// `None` where more than [`MOST_SEEDS`] in all would be needed, and where the spread is not known.
    #[must_use]
    pub fn more_seeds(&self, level: f64, distance: f64) -> Option<u32> {
        let narrow = |more: u32| self.half_width(level, more) < distance;
        let largest = self.samples.iter().map(|sample| sample.n).max().unwrap_or(0);
        let mut enough = MOST_SEEDS.saturating_sub(u32::try_from(largest).unwrap_or(MOST_SEEDS));
        if enough == 0 || !narrow(enough) {
            return None;
        }
        // The width falls with the number of seeds, so the smallest number is found by halving.
        let mut too_few = 0;
        while enough - too_few > 1 {
            let middle = too_few.midpoint(enough);
            if narrow(middle) { enough = middle } else { too_few = middle }
        }
        Some(enough)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::tests::{assert_close, numbers, reference};
    use rand::RngCore;

    #[test]
    fn welch_agrees_with_scipy() {
        for case in reference()["unpaired"].as_array().unwrap() {
            let estimate = MeanEstimate::difference(&numbers(&case["left"]), &numbers(&case["right"]));
            let (interval, ends) = (estimate.interval(0.95).unwrap(), numbers(&case["interval_95"]));
            assert_close(estimate.degrees_of_freedom(), case["degrees_of_freedom"].as_f64().unwrap(), 1e-12);
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
        // Standard deviation 1: with n seeds the half-width is t(0.975, n - 1) / sqrt(n); 2.776 / sqrt(5) = 1.242 and
        // 2.571 / sqrt(6) = 1.049 enclose 1.1.
        assert_eq!(estimate.more_seeds(0.95, 1.1), Some(3));
        assert_eq!(estimate.more_seeds(0.95, 0.0), None);
        assert_eq!(estimate.more_seeds(0.95, 0.01), None);
        assert_eq!(MeanEstimate::of(&[1.0]).more_seeds(0.95, 1.0), None);
    }

    #[test]
    fn values_that_are_not_finite_have_no_interval() {
        assert_eq!(MeanEstimate::of(&[1.0, f64::INFINITY]).interval(0.95), None);
        assert_eq!(MeanEstimate::of(&[1.0, f64::NAN, 2.0]).interval(0.95), None);
        assert_eq!(MeanEstimate::of(&[]).interval(0.95), None);
    }

    /// Two independent standard normal numbers (Box and Muller).
    fn normal_pair(rng: &mut crate::random::Rng) -> [f64; 2] {
        let mut uniform = || (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        let (radius, angle) = ((-2.0 * (1.0 - uniform()).ln()).sqrt(), std::f64::consts::TAU * uniform());
        [radius * angle.cos(), radius * angle.sin()]
    }

    /// The share of 95 % intervals that contain the truth, over 10 000 experiments with 4 and 6 seeds.
    #[test]
    fn intervals_cover_the_truth() {
        let mut rng = crate::random::stream(&["test", "coverage"]);
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
