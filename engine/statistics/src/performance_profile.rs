//! Performance profiles: the share of runs above a score, as a curve over scores.
//!
//! Agarwal et al. 2021, arXiv:2108.13264, section 4.2: the run-score distribution, the share of runs whose normalised
//! score is larger than tau. Tasks have equal weights, which gives the share over all runs if every task has the same
//! number of seeds.
//!
//! | paper | here |
//! |---|---|
//! | tau | `thresholds`, rising |
//! | F(tau) | the value at a threshold |

use super::{
    Bootstrap,
    estimators::{count, mean, sorted},
    suite_statistic::Estimate,
};

/// The profile at some rising thresholds with pointwise bootstrap intervals, all from the same resamples; `tasks[k]`
/// holds the scores of the seeds of task `k`.
#[must_use]
pub fn performance_profile(tasks: &[Vec<f64>], thresholds: &[f64], bootstrap: Bootstrap) -> Vec<Estimate> {
    let intervals = bootstrap.pointwise(tasks, |tasks| shares_above(tasks, thresholds));
    let intervals = intervals.unwrap_or_else(|| vec![None; thresholds.len()]);
    shares_above(tasks, thresholds)
        .into_iter()
        .zip(intervals)
        .map(|(value, interval)| Estimate { value, interval })
        .collect()
}

/// The mean over tasks of the share of seeds above each of some rising thresholds; NaN if a task has no seed.
fn shares_above(tasks: &[Vec<f64>], thresholds: &[f64]) -> Vec<f64> {
    let sorted: Vec<Vec<f64>> = tasks.iter().map(|seeds| sorted(seeds)).collect();
    let share = |seeds: &Vec<f64>, threshold: f64| {
        let above = seeds.len() - seeds.partition_point(|score| *score <= threshold);
        count(above) / count(seeds.len())
    };
    let at = |threshold: &f64| {
        let shares: Vec<f64> = sorted.iter().map(|seeds| share(seeds, *threshold)).collect();
        mean(&shares)
    };
    thresholds.iter().map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        estimators::suite_share_above,
        tests::{assert_close, assert_interval, numbers, suite_reference, tasks},
    };
    use proptest::prelude::*;

    #[test]
    fn profiles_agree_with_rliable() {
        let reference = suite_reference();
        let thresholds = numbers(&reference["thresholds"]);
        for (agent, scores) in reference["scores"].as_object().unwrap() {
            let (scores, expected) = (tasks(scores), &reference["profiles"][agent]);
            let profile = performance_profile(&scores, &thresholds, Bootstrap::TABLE);
            // A share moves in steps of one run.
            let step = 1.0 / scores.iter().map(Vec::len).sum::<usize>() as f64;
            for (index, point) in profile.iter().enumerate() {
                assert_close(point.value, expected["values"][index].as_f64().unwrap(), 1e-12);
                assert_interval(point.interval, &expected["intervals"][index], step);
            }
        }
    }

    /// Two of three seeds of the first task and one of two of the second lie above 1; a score of 1 does not.
    #[test]
    fn small_suites_by_hand() {
        let tasks = [vec![2.0, 1.0, 3.0], vec![0.0, 4.0]];
        let profile = performance_profile(&tasks, &[-1.0, 1.0, 4.0], Bootstrap::CURVE);
        let values: Vec<f64> = profile.iter().map(|point| point.value).collect();
        assert_close(values[1], (2.0 / 3.0 + 0.5) / 2.0, 1e-15);
        assert_eq!((values[0], values[2]), (1.0, 0.0));
        let certain = profile[0].interval.unwrap();
        assert_eq!((certain.low, certain.high), (1.0, 1.0));
        assert!(
            performance_profile(&[vec![1.0]], &[0.0], Bootstrap::CURVE)[0]
                .interval
                .is_none()
        );
    }

    proptest! {
        #[test]
        fn profiles_fall_and_are_the_share_at_each_threshold(
            tasks in prop::collection::vec(prop::collection::vec(-2.0f64..2.0, 1..6), 1..4),
            mut thresholds in prop::collection::vec(-2.5f64..2.5, 1..8)) {
            thresholds.sort_by(f64::total_cmp);
            let shares = shares_above(&tasks, &thresholds);
            prop_assert!(shares.windows(2).all(|pair| pair[0] >= pair[1]));
            let alone: Vec<f64> = thresholds.iter().map(|at| suite_share_above(&tasks, *at)).collect();
            prop_assert_eq!(shares, alone);
        }
    }
}
