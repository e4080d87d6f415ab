//! The four aggregates of a suite that Agarwal et al. 2021 ("Deep reinforcement learning at the edge of the
//! statistical precipice", arXiv:2108.13264, section 4.3) report side by side, each with its interval.

use super::{
    Bootstrap, Interval,
    estimators::{suite_iqm, suite_mean, suite_median, suite_optimality_gap},
};

/// One number for the scores of a suite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SuiteStatistic {
    /// The median over tasks of the means over seeds.
    Median,
    /// The interquartile mean over all seeds of all tasks.
    InterquartileMean,
    /// The mean over tasks of the means over seeds.
    Mean,
    /// Average distance of scores below 1; scores above count as 1, and less is better.
    OptimalityGap,
}

/// A number with its interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Value of the statistic.
    pub value: f64,
    /// Its bootstrap interval; `None` if a task has fewer than two seeds.
    pub interval: Option<Interval>,
}

impl SuiteStatistic {
    /// All statistics, in the order in which the paper shows them.
    pub const ALL: [Self; 4] = [
        Self::Median,
        Self::InterquartileMean,
        Self::Mean,
        Self::OptimalityGap,
    ];

    /// Name of the statistic.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Median => "median",
            Self::InterquartileMean => "interquartile mean",
            Self::Mean => "mean",
            Self::OptimalityGap => "optimality gap",
        }
    }

    /// Its value; `tasks[k]` holds the normalised scores of the seeds of task `k`. NaN without a score.
    #[must_use]
    pub fn of(self, tasks: &[Vec<f64>]) -> f64 {
        match self {
            Self::Median => suite_median(tasks),
            Self::InterquartileMean => suite_iqm(tasks),
            Self::Mean => suite_mean(tasks),
            Self::OptimalityGap => suite_optimality_gap(tasks, 1.0),
        }
    }

    /// Its value with the stratified bootstrap interval; shape as in [`SuiteStatistic::of`].
    #[must_use]
    pub fn estimate(self, tasks: &[Vec<f64>], bootstrap: Bootstrap) -> Estimate {
        Estimate {
            value: self.of(tasks),
            interval: bootstrap.stratified(tasks, |tasks| self.of(tasks)),
        }
    }
}

impl Estimate {
    /// Both ends of the interval.
    #[must_use]
    pub fn ends(&self) -> Option<(f64, f64)> {
        self.interval.map(|interval| (interval.low, interval.high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        comparison::{probability_of_improvement, probability_of_improvement_interval},
        tests::{assert_close, assert_interval, suite_reference, tasks},
    };

    #[test]
    fn estimates_and_intervals_agree_with_rliable() {
        let reference = suite_reference();
        for (agent, scores) in reference["scores"].as_object().unwrap() {
            let scores = tasks(scores);
            for (index, statistic) in SuiteStatistic::ALL.into_iter().enumerate() {
                let estimate = statistic.estimate(&scores, Bootstrap::TABLE);
                let expected = &reference["estimates"][agent];
                assert_close(estimate.value, expected["values"][index].as_f64().unwrap(), 1e-12);
                assert_interval(estimate.interval, &expected["intervals"][index], 0.0);
            }
        }
    }

    #[test]
    fn probabilities_of_improvement_agree_with_rliable() {
        let reference = suite_reference();
        for pair in reference["improvement"].as_array().unwrap() {
            let [left, right] =
                ["left", "right"].map(|side| tasks(&reference["scores"][pair[side].as_str().unwrap()]));
            let value = probability_of_improvement(&left, &right);
            assert_close(value, pair["value"].as_f64().unwrap(), 1e-12);
            let interval = probability_of_improvement_interval(&left, &right, Bootstrap::TABLE);
            // It moves in wins of one seed over another on one of the tasks.
            let step = 1.0 / (left.len() * left[0].len() * right[0].len()) as f64;
            assert_interval(interval, &pair["interval"], step);
        }
    }

    #[test]
    fn a_single_seed_has_a_value_without_an_interval() {
        let estimate = SuiteStatistic::Mean.estimate(&[vec![1.0], vec![2.0, 4.0]], Bootstrap::CURVE);
        assert_eq!((estimate.value, estimate.ends()), (2.0, None));
    }
}
