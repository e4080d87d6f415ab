//! Statistics over seeds: estimates with intervals, comparisons, and verdicts on published values and on
//! claims.
//!
//! Everything here is a pure function of plain numbers: the same numbers give the same result, in whatever order the
//! seeds come. Resampling and random permutation draw from a stream with a fixed name.
//!
//! A **seed** is a replicate; an episode never is. One seed gives one number (its mean over episodes) before it reaches
//! this module. A seed that occurs twice counts once, with the mean of its values.

pub mod binomial;
pub mod bootstrap;
pub mod common_steps;
pub mod comparison;
pub mod estimators;
mod interval;
pub mod mean_estimate;
pub mod normal;
pub mod performance_profile;
pub mod power;
mod quadrature;
pub mod rank_correlation;
pub mod sample_efficiency;
pub mod spending;
pub mod statement;
pub mod student_t;
pub mod suite_statistic;
pub mod thinning;
pub mod training_share;
pub mod verdict;

pub use binomial::Share;
pub use bootstrap::Bootstrap;
pub use comparison::PermutationTest;
pub use interval::Interval;
pub use mean_estimate::{MeanEstimate, PublishedMean};
pub use performance_profile::performance_profile;
pub use power::Room;
pub use rank_correlation::{rank_correlation, rank_correlation_interval};
pub use sample_efficiency::sample_efficiency;
pub use spending::SequentialDesign;
pub use statement::{Statement, StatementOutcome, holm};
pub use suite_statistic::{Estimate, SuiteStatistic};
pub use training_share::TrainingShare;
pub use verdict::{Judgement, Reference, Sample, Seeds, Verdict};

use serde::{Deserialize, Serialize};

/// Summary of the seeds of a cell of a table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Number of seeds.
    pub n: usize,
    /// Arithmetic mean over seeds.
    pub mean: f64,
    /// Sample standard deviation (divisor n - 1); `None` for one seed.
    pub sd: Option<f64>,
    /// Median over seeds.
    pub median: f64,
    /// Interquartile mean over seeds.
    pub iqm: f64,
    /// 95 % Student-t interval of the mean; `None` for one seed.
    pub interval: Option<Interval>,
}

impl Summary {
    /// Summarises one value per seed; `None` if there is no seed.
    #[must_use]
    pub fn of(values: &[f64]) -> Option<Self> {
        (!values.is_empty()).then(|| Self {
            n: values.len(),
            mean: estimators::mean(values),
            sd: (values.len() > 1).then(|| estimators::sd(values)),
            median: estimators::median(values),
            iqm: estimators::iqm(values),
            interval: MeanEstimate::of(values).interval(0.95),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::RngCore;

    /// The values made by `tests/fixtures/statistics/make.py`.
    pub(super) fn reference() -> serde_json::Value {
        serde_json::from_str(include_str!("../../../tests/fixtures/statistics/reference.json")).unwrap()
    }

    /// The values made by `tests/fixtures/statistics/sequential.py`.
    pub(super) fn sequential_reference() -> serde_json::Value {
        serde_json::from_str(include_str!("../../../tests/fixtures/statistics/sequential.json")).unwrap()
    }

    /// Scores and values made by `tests/fixtures/statistics/suite.py` with rliable.
    pub(super) fn suite_reference() -> serde_json::Value {
        serde_json::from_str(include_str!("../../../tests/fixtures/statistics/suite.json")).unwrap()
    }

    /// The scores of an agent of a fixture, seeds by task.
    pub(super) fn tasks(value: &serde_json::Value) -> Vec<Vec<f64>> {
        value.as_array().unwrap().iter().map(numbers).collect()
    }

    /// Panics unless the ends of an interval are as close to those of the reference as other random numbers allow;
    /// `step` is the unit of the statistic.
    pub(super) fn assert_interval(interval: Option<Interval>, expected: &serde_json::Value, step: f64) {
        let (interval, ends) = (interval.unwrap(), numbers(expected));
        let tolerance = 0.025 * (ends[1] - ends[0]) + step;
        let is_near = |left: f64, right: f64| (left - right).abs() <= tolerance + 1e-9;
        assert!(
            is_near(interval.low, ends[0]) && is_near(interval.high, ends[1]),
            "{interval:?} is not {ends:?}"
        );
    }

    /// A list of numbers of the reference values.
    pub(super) fn numbers(value: &serde_json::Value) -> Vec<f64> {
        value
            .as_array()
            .unwrap()
            .iter()
            .map(|number| number.as_f64().unwrap())
            .collect()
    }

    /// Two independent standard normal numbers (Box and Muller).
    pub(super) fn normal_pair(rng: &mut contract::random::Rng) -> [f64; 2] {
        let mut uniform = || (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        let (radius, angle) = (
            (-2.0 * (1.0 - uniform()).ln()).sqrt(),
            std::f64::consts::TAU * uniform(),
        );
        [radius * angle.cos(), radius * angle.sin()]
    }

    /// Panics unless both numbers agree to `tolerance`, relative to the larger of 1 and their size.
    pub(super) fn assert_close(left: f64, right: f64, tolerance: f64) {
        assert!(
            (left - right).abs() <= tolerance * right.abs().max(1.0),
            "{left} is not {right}"
        );
    }

    #[test]
    fn no_seed_has_no_summary_and_one_seed_has_no_interval() {
        assert_eq!(Summary::of(&[]), None);
        let one = Summary::of(&[4.0]).unwrap();
        assert_eq!((one.n, one.mean, one.sd, one.interval), (1, 4.0, None, None));
        assert_eq!((one.median, one.iqm), (4.0, 4.0));
    }

    #[test]
    fn summaries_agree_with_scipy() {
        for case in reference()["one_sample"].as_array().unwrap() {
            let summary = Summary::of(&numbers(&case["values"])).unwrap();
            let expected = |key: &str| case[key].as_f64().unwrap();
            assert_close(summary.mean, expected("mean"), 1e-13);
            assert_close(summary.sd.unwrap(), expected("sd"), 1e-13);
            assert_close(summary.median, expected("median"), 1e-13);
            assert_close(summary.iqm, expected("iqm"), 1e-13);
            let ends = numbers(&case["interval_95"]);
            assert_close(summary.interval.unwrap().low, ends[0], 1e-11);
            assert_close(summary.interval.unwrap().high, ends[1], 1e-11);
        }
    }

    proptest! {
        #[test]
        fn the_interval_contains_the_mean(values in prop::collection::vec(-1e6..1e6, 2..30)) {
            let summary = Summary::of(&values).unwrap();
            prop_assert!(summary.interval.unwrap().contains(summary.mean));
        }

        #[test]
        fn the_order_of_the_seeds_does_not_matter(values in prop::collection::vec(-1e3..1e3, 1..20),
            turn in 0_usize..20) {
            let mut turned = values.clone();
            turned.rotate_left(turn % values.len());
            turned.reverse();
            prop_assert_eq!(Summary::of(&values), Summary::of(&turned));
        }

        #[test]
        fn the_unit_does_not_matter(values in prop::collection::vec(-1e3..1e3, 2..20), exponent in -20..20) {
            // A power of two scales without rounding, so that even the last bit must agree.
            let scale = 2f64.powi(exponent);
            let scaled: Vec<f64> = values.iter().map(|value| value * scale).collect();
            let (plain, scaled) = (Summary::of(&values).unwrap(), Summary::of(&scaled).unwrap());
            prop_assert_eq!(plain.mean * scale, scaled.mean);
            prop_assert_eq!(plain.iqm * scale, scaled.iqm);
            prop_assert_eq!(plain.sd.map(|sd| sd * scale), scaled.sd);
            prop_assert_eq!(plain.interval.map(|it| it.high * scale), scaled.interval.map(|it| it.high));
        }
    }
}
