//! Sample efficiency: the interquartile mean of all runs of a suite against environment steps.
//!
//! Agarwal et al. 2021, arXiv:2108.13264, section 4.3 and figure 9: the curve of the interquartile mean of
//! normalised scores, with a stratified bootstrap interval at each step.

use super::{
    Bootstrap,
    suite_statistic::{Estimate, SuiteStatistic},
};
use std::collections::BTreeMap;

/// The scores of one run by environment steps.
pub type Run = BTreeMap<u64, f64>;

/// The interquartile mean at every step at which all runs were measured; `tasks[k]` holds the runs of task
/// `k`. Empty where there is no such step, or a task has no run.
#[must_use]
pub fn sample_efficiency(tasks: &[Vec<Run>], bootstrap: Bootstrap) -> Vec<(u64, Estimate)> {
    let at = |step: u64| {
        let scores: Vec<Vec<f64>> = tasks
            .iter()
            .map(|runs| runs.iter().filter_map(|run| run.get(&step)).copied().collect())
            .collect();
        (
            step,
            SuiteStatistic::InterquartileMean.estimate(&scores, bootstrap),
        )
    };
    shared_steps(tasks).into_iter().map(at).collect()
}

/// The steps at which every run was measured.
fn shared_steps(tasks: &[Vec<Run>]) -> Vec<u64> {
    if tasks.iter().any(Vec::is_empty) {
        return Vec::new();
    }
    let mut runs = tasks.iter().flatten();
    let first = runs
        .next()
        .map_or_else(Vec::new, |run| run.keys().copied().collect());
    runs.fold(first, |mut steps: Vec<u64>, run| {
        steps.retain(|step| run.contains_key(step));
        steps
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::tests::{assert_close, assert_interval, numbers, suite_reference};

    #[test]
    fn curves_agree_with_rliable() {
        let reference = suite_reference();
        let curve = &reference["sample_efficiency"];
        let runs = |task: &serde_json::Value| -> Vec<Run> {
            let run = |run: &serde_json::Value| (0..).step_by(1000).zip(numbers(run)).collect();
            task.as_array().unwrap().iter().map(run).collect()
        };
        let tasks: Vec<Vec<Run>> = curve["scores"].as_array().unwrap().iter().map(runs).collect();
        let points = sample_efficiency(&tasks, Bootstrap::TABLE);
        assert_eq!(points.len(), numbers(&curve["values"]).len());
        for (index, (step, estimate)) in points.iter().enumerate() {
            assert_eq!(*step, 1000 * index as u64);
            assert_close(estimate.value, curve["values"][index].as_f64().unwrap(), 1e-12);
            assert_interval(estimate.interval, &curve["intervals"][index], 0.0);
        }
    }

    #[test]
    fn only_steps_that_all_runs_share_are_shown() {
        let run = |steps: &[u64]| -> Run { steps.iter().map(|step| (*step, *step as f64)).collect() };
        let tasks = [vec![run(&[0, 5, 10]), run(&[0, 10])], vec![run(&[0, 5, 10, 20])]];
        let steps: Vec<u64> = sample_efficiency(&tasks, Bootstrap::CURVE)
            .iter()
            .map(|(step, _)| *step)
            .collect();
        assert_eq!(steps, [0, 10]);
        assert!(sample_efficiency(&[vec![run(&[0])], Vec::new()], Bootstrap::CURVE).is_empty());
    }
}
