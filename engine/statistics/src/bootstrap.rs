//! Stratified bootstrap intervals: the strata are tasks (environments), and within each task its seeds are
//! resampled.
//!
//! Agarwal et al. 2021, "Deep Reinforcement Learning at the Edge of the Statistical Precipice",
//! arXiv:2108.13264, section 4.1. Their scores have the shape runs x tasks; here `tasks[k]` holds the seeds
//! of task `k`, so that axes cannot be swapped and tasks may have unequal numbers of seeds. Intervals are
//! percentiles of the resampled statistic.
//!
//! Indices come from the stream named `["statistics", "bootstrap"]`, which is opened again for every interval, so that
//! an interval is a function of its scores only.
//!
//! Percentile intervals are too narrow for few seeds (for the mean of 5 seeds of one task about 84 % instead of 95 %);
//! a single cell uses the Student-t interval of [`MeanEstimate`](super::MeanEstimate).

use super::{
    Interval,
    estimators::{quantile_of_sorted, sorted},
};
use contract::random::{Rng, stream};
use rand::RngCore;

/// Options of a bootstrap interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bootstrap {
    /// Number of resamples, limited to between 2000 and 50 000.
    pub resamples: u32,
    /// Confidence level.
    pub level: f64,
}

impl Bootstrap {
    /// 95 % with 50 000 resamples, for tables.
    pub const TABLE: Self = Self {
        resamples: 50_000,
        level: 0.95,
    };
    /// 95 % with 2000 resamples, for each point of a curve.
    pub const CURVE: Self = Self {
        resamples: 2000,
        level: 0.95,
    };

    /// The interval of `statistic` over a suite of tasks; `None` if there is no task, a task has fewer than two seeds
    /// or the statistic is not finite.
    #[must_use]
    pub fn stratified(self, tasks: &[Vec<f64>], statistic: impl Fn(&[Vec<f64>]) -> f64) -> Option<Interval> {
        self.independent([tasks], |[tasks]| statistic(tasks))
    }

    /// The interval of `statistic` over several suites (agents) that are resampled independently of each
    /// other; `None` as in [`Bootstrap::stratified`].
    #[must_use]
    pub fn independent<const SUITES: usize>(
        self,
        suites: [&[Vec<f64>]; SUITES],
        statistic: impl Fn([&[Vec<f64>]; SUITES]) -> f64,
    ) -> Option<Interval> {
        let statistics = self.draws(suites, statistic)?;
        percentile_interval(&statistics, self.level)
    }

    /// The interval of each of several statistics of the same resamples, such as the points of a curve; each equals
    /// that of [`Bootstrap::stratified`]. `None` if there is no task or a task has fewer than two seeds; a single
    /// interval is `None` if its statistic is not finite.
    #[must_use]
    pub fn pointwise(
        self,
        tasks: &[Vec<f64>],
        statistics: impl Fn(&[Vec<f64>]) -> Vec<f64>,
    ) -> Option<Vec<Option<Interval>>> {
        let draws = self.draws([tasks], |[tasks]| statistics(tasks))?;
        let points = draws.first().map_or(0, Vec::len);
        let of_point = |point: usize| draws.iter().map(|draw| draw[point]).collect::<Vec<_>>();
        Some(
            (0..points)
                .map(|point| percentile_interval(&of_point(point), self.level))
                .collect(),
        )
    }

    /// The statistic of every resample; `None` if there is no task or a task has fewer than two seeds.
    fn draws<Value, const SUITES: usize>(
        self,
        suites: [&[Vec<f64>]; SUITES],
        statistic: impl Fn([&[Vec<f64>]; SUITES]) -> Value,
    ) -> Option<Vec<Value>> {
        if suites
            .iter()
            .any(|tasks| tasks.is_empty() || tasks.iter().any(|seeds| seeds.len() < 2))
        {
            return None;
        }
        // Sorted, so that the order of the seeds cannot affect the interval.
        let originals = suites.map(|tasks| tasks.iter().map(|seeds| sorted(seeds)).collect::<Vec<_>>());
        let mut resampled = originals.clone();
        let mut rng = stream(&["statistics", "bootstrap"]);
        let mut draw = || {
            resampled
                .iter_mut()
                .zip(&originals)
                .for_each(|(to, from)| resample(from, to, &mut rng));
            statistic(resampled.each_ref().map(Vec::as_slice))
        };
        Some((0..self.resamples.clamp(2000, 50_000)).map(|_| draw()).collect())
    }
}

/// Fills every task of `to` with seeds of the same task of `from`, drawn with replacement.
fn resample(from: &[Vec<f64>], to: &mut [Vec<f64>], rng: &mut Rng) {
    for (source, target) in from.iter().zip(to) {
        target
            .iter_mut()
            .for_each(|value| *value = source[below(source.len(), rng)]);
    }
}

/// A uniform index below `n`, from the upper bits of one draw. Its bias is below `n / 2^32`. Unlike a library's method
/// it cannot change with the library's version.
#[inline]
pub(super) fn below(n: usize, rng: &mut Rng) -> usize {
    ((u64::from(rng.next_u32()) * n as u64) >> 32) as usize
}

fn percentile_interval(statistics: &[f64], level: f64) -> Option<Interval> {
    let sorted = sorted(statistics);
    let (low, high) = (
        quantile_of_sorted(&sorted, 0.5 - level / 2.0),
        quantile_of_sorted(&sorted, 0.5 + level / 2.0),
    );
    (low.is_finite() && high.is_finite()).then_some(Interval { low, high, level })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        estimators::{mean, suite_iqm, suite_mean, suite_median},
        tests::{assert_close, numbers, reference},
    };

    /// rliable resamples with other random numbers; the ends of 50 000 resamples agree to about 1 % of the
    /// width.
    #[test]
    fn intervals_agree_with_rliable() {
        let suite = &reference()["suite"];
        let tasks: Vec<Vec<f64>> = suite["x"].as_array().unwrap().iter().map(numbers).collect();
        for (index, statistic) in [suite_mean, suite_median, suite_iqm].into_iter().enumerate() {
            let ends = numbers(&suite["intervals_95"][index]);
            let interval = Bootstrap::TABLE.stratified(&tasks, statistic).unwrap();
            let tolerance = 0.02 * (ends[1] - ends[0]);
            assert_close(interval.low, ends[0], tolerance);
            assert_close(interval.high, ends[1], tolerance);
        }
    }

    /// Two seeds, 0 and 1: the resampled mean is 0, 1/2 or 1 with probabilities 1/4, 1/2, 1/4.
    #[test]
    fn two_seeds_by_hand() {
        let tasks = [vec![0.0, 1.0]];
        let ends = |level| {
            let interval = Bootstrap {
                resamples: 20_000,
                level,
            }
            .stratified(&tasks, suite_mean)
            .unwrap();
            (interval.low, interval.high)
        };
        assert_eq!((ends(0.95), ends(0.4)), ((0.0, 1.0), (0.5, 0.5)));
    }

    #[test]
    fn tasks_are_strata() {
        // Without spread inside the tasks nothing can vary, even if the tasks differ.
        let tasks = [vec![1.0; 3], vec![100.0; 5]];
        let interval = Bootstrap::CURVE.stratified(&tasks, suite_mean).unwrap();
        assert_eq!((interval.low, interval.high), (50.5, 50.5));
    }

    #[test]
    fn the_order_of_the_seeds_does_not_matter() {
        let interval = |tasks: [Vec<f64>; 2]| Bootstrap::CURVE.stratified(&tasks, suite_iqm);
        let one = interval([vec![3.0, 1.0, 2.0, 5.0], vec![7.0, 9.0]]);
        assert_eq!(one, interval([vec![5.0, 2.0, 1.0, 3.0], vec![9.0, 7.0]]));
        assert_eq!(one, interval([vec![3.0, 1.0, 2.0, 5.0], vec![7.0, 9.0]]));
    }

    #[test]
    fn points_of_a_curve_have_the_intervals_that_each_has_alone() {
        let tasks = [vec![3.0, 1.0, 2.0, 5.0], vec![7.0, 9.0]];
        let both = Bootstrap::CURVE
            .pointwise(&tasks, |tasks| vec![suite_iqm(tasks), suite_mean(tasks)])
            .unwrap();
        let alone = [suite_iqm, suite_mean].map(|statistic| Bootstrap::CURVE.stratified(&tasks, statistic));
        assert_eq!(both, alone);
        assert_eq!(Bootstrap::CURVE.pointwise(&[vec![1.0]], |_| vec![0.0]), None);
    }

    #[test]
    fn too_few_seeds_have_no_interval() {
        assert_eq!(Bootstrap::CURVE.stratified(&[], suite_mean), None);
        assert_eq!(
            Bootstrap::CURVE.stratified(&[vec![1.0, 2.0], vec![3.0]], suite_mean),
            None
        );
        assert_eq!(
            Bootstrap::CURVE.stratified(&[vec![1.0, f64::NAN]], suite_mean),
            None
        );
    }

    /// The share of intervals of a mean of three tasks with 10 seeds each that contain the truth.
    #[test]
    fn intervals_cover_the_truth() {
        let mut rng = stream(&["test", "bootstrap coverage"]);
        // The mean of twelve uniform numbers is nearly normal around 1/2.
        let mut score = || {
            mean(
                &(0..12)
                    .map(|_| f64::from(rng.next_u32()) / 2f64.powi(32))
                    .collect::<Vec<_>>(),
            )
        };
        let mut covered = 0;
        for _ in 0..300 {
            let tasks: Vec<Vec<f64>> = (0..3).map(|_| (0..10).map(|_| score()).collect()).collect();
            covered += u32::from(
                Bootstrap::CURVE
                    .stratified(&tasks, suite_mean)
                    .unwrap()
                    .contains(0.5),
            );
        }
        // Nominal 285; percentile intervals of 10 seeds cover about 92 %, 277, with a standard error of 5.
        assert!((262..=292).contains(&covered), "{covered}");
    }
}
