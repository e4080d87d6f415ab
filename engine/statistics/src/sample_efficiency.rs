//! Sample efficiency: the interquartile mean of all runs of a suite against environment steps.
//!
//! Agarwal et al. 2021, arXiv:2108.13264, section 4.3 and figure 9: the curve of the interquartile mean of
//! normalised scores, with a stratified bootstrap interval at each step.

use super::{
    Bootstrap,
    common_steps::at_common_steps,
    suite_statistic::{Estimate, SuiteStatistic},
    thinning,
};

pub use super::common_steps::StepSeries;

/// Largest number of steps with intervals; with more, only those that `thinning` keeps have one.
const MOST_INTERVALS: usize = 1000;

/// The interquartile mean at the common steps of all runs; `tasks[k]` holds the runs of task `k`. Empty if there is no
/// such step, or a task has no run.
#[must_use]
pub fn sample_efficiency(tasks: &[Vec<StepSeries>], bootstrap: Bootstrap) -> Vec<(u64, Estimate)> {
    if tasks.iter().any(Vec::is_empty) {
        return Vec::new();
    }
    let runs: Vec<&[(u64, f64)]> = tasks.iter().flatten().map(Vec::as_slice).collect();
    let mut middles: StepSeries = Vec::new();
    at_common_steps(&runs, |step, values| {
        middles.push((
            step,
            SuiteStatistic::InterquartileMean.of(&by_task(tasks, values)),
        ));
    });
    let kept = if middles.len() > MOST_INTERVALS {
        thinning::kept_steps(&middles)
    } else {
        (0..middles.len()).collect()
    };
    let mut kept = kept.into_iter().map(|index| middles[index].0).peekable();
    let mut points = Vec::new();
    at_common_steps(&runs, |step, values| {
        if kept.next_if_eq(&step).is_some() {
            let scores = by_task(tasks, values);
            points.push((
                step,
                SuiteStatistic::InterquartileMean.estimate(&scores, bootstrap),
            ));
        }
    });
    points
}

/// The values of all runs, task by task.
fn by_task(tasks: &[Vec<StepSeries>], mut values: &[f64]) -> Vec<Vec<f64>> {
    let of_task = |runs: &Vec<StepSeries>| {
        let (own, rest) = values.split_at(runs.len());
        values = rest;
        own.to_vec()
    };
    tasks.iter().map(of_task).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{assert_close, assert_interval, numbers, suite_reference};

    #[test]
    fn curves_agree_with_rliable() {
        let reference = suite_reference();
        let curve = &reference["sample_efficiency"];
        let runs = |task: &serde_json::Value| -> Vec<StepSeries> {
            let run = |run: &serde_json::Value| (0..).step_by(1000).zip(numbers(run)).collect();
            task.as_array().unwrap().iter().map(run).collect()
        };
        let tasks: Vec<Vec<StepSeries>> = curve["scores"].as_array().unwrap().iter().map(runs).collect();
        let points = sample_efficiency(&tasks, Bootstrap::TABLE);
        assert_eq!(points.len(), numbers(&curve["values"]).len());
        for (index, (step, estimate)) in points.iter().enumerate() {
            assert_eq!(*step, 1000 * index as u64);
            assert_close(estimate.value, curve["values"][index].as_f64().unwrap(), 1e-12);
            assert_interval(estimate.interval, &curve["intervals"][index], 0.0);
        }
    }

    #[test]
    fn runs_count_with_their_last_value_where_all_have_one() {
        let run = |steps: &[u64]| -> StepSeries { steps.iter().map(|step| (*step, *step as f64)).collect() };
        let tasks = [vec![run(&[0, 5, 10]), run(&[0, 10])], vec![run(&[0, 5, 10, 20])]];
        let points = sample_efficiency(&tasks, Bootstrap::CURVE);
        let steps: Vec<u64> = points.iter().map(|(step, _)| *step).collect();
        assert_eq!(steps, [0, 5, 10]);
        // The second run keeps the 0 of step 0.
        assert_close(
            points[1].1.value,
            SuiteStatistic::InterquartileMean.of(&[vec![5.0, 0.0], vec![5.0]]),
            1e-12,
        );
        assert!(sample_efficiency(&[vec![run(&[0])], Vec::new()], Bootstrap::CURVE).is_empty());
    }
}
