//! Point estimates of one value per seed, and of a suite of tasks with several seeds each.
//!
//! All of them return NaN if there are too few values, and none depends on the order of the values, since sums run over
//! the sorted values.

/// `values` in ascending order.
pub(super) fn sorted(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted
}

/// Arithmetic mean; exact if all values are equal.
#[must_use]
pub fn mean(values: &[f64]) -> f64 {
    mean_of_sorted(&sorted(values))
}

/// Deviations from the first value are summed, so that equal values have no rounding error and a variance of
/// exactly 0.
fn mean_of_sorted(sorted: &[f64]) -> f64 {
    let Some(&first) = sorted.first() else {
        return f64::NAN;
    };
    first + sorted.iter().map(|value| value - first).sum::<f64>() / count(sorted.len())
}

/// The moving average y' = weight y' + (1 - weight) y along a curve, started at its first value.
#[must_use]
pub fn moving_average(values: &[f64], weight: f64) -> Vec<f64> {
    let mut average = values.first().copied().unwrap_or_default();
    let next = |value: &f64| {
        average = weight * average + (1.0 - weight) * value;
        average
    };
    values.iter().map(next).collect()
}

/// Sample variance (divisor n - 1); NaN for fewer than two values.
#[must_use]
pub fn variance(values: &[f64]) -> f64 {
    let sorted = sorted(values);
    let mean = mean_of_sorted(&sorted);
    if sorted.len() < 2 {
        return f64::NAN;
    }
    sorted.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count(sorted.len() - 1)
}

/// Sample standard deviation (divisor n - 1); NaN for fewer than two values.
#[must_use]
pub fn sd(values: &[f64]) -> f64 {
    variance(values).sqrt()
}

/// Median; the mean of the middle two for an even number of values.
#[must_use]
pub fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// Interquartile mean: the mean without the `floor(n / 4)` smallest and as many largest values, like SciPy's
/// `trim_mean(values, 0.25)` (Agarwal et al. 2021, arXiv:2108.13264, section 4.3).
#[must_use]
pub fn iqm(values: &[f64]) -> f64 {
    let sorted = sorted(values);
    let cut = sorted.len() / 4;
    mean_of_sorted(&sorted[cut..sorted.len() - cut])
}

/// Quantile at `probability` (0 to 1) with linear interpolation between order statistics (type 7 of Hyndman
/// and Fan).
#[must_use]
pub fn quantile(values: &[f64], probability: f64) -> f64 {
    quantile_of_sorted(&sorted(values), probability)
}

/// [`quantile`] of values that are already in ascending order.
pub(super) fn quantile_of_sorted(sorted: &[f64], probability: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return f64::NAN;
    };
    let position = probability.clamp(0.0, 1.0) * count(last);
    // Below 2^53, since it is at most the number of values.
    let below = position.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (position - position.floor()) * (sorted[above] - sorted[below])
}

/// Mean over tasks of the mean over seeds; `tasks` holds the seeds of one task per entry, possibly of unequal
/// number.
#[must_use]
pub fn suite_mean(tasks: &[Vec<f64>]) -> f64 {
    mean(&task_means(tasks))
}

/// Median over tasks of the mean over seeds, shape as in [`suite_mean`].
#[must_use]
pub fn suite_median(tasks: &[Vec<f64>]) -> f64 {
    median(&task_means(tasks))
}

/// Interquartile mean of all seeds of all tasks together, shape as in [`suite_mean`]. If tasks have unequal numbers of
/// seeds, all tasks have the same weight: a quarter of the weight is cut from either end.
#[must_use]
pub fn suite_iqm(tasks: &[Vec<f64>]) -> f64 {
    let alike = tasks.windows(2).all(|pair| pair[0].len() == pair[1].len());
    if alike {
        return iqm(&tasks.concat());
    }
    let of_task = |seeds: &Vec<f64>| {
        let weight = 1.0 / (count(tasks.len()) * count(seeds.len()));
        seeds
            .iter()
            .map(move |value| (*value, weight))
            .collect::<Vec<_>>()
    };
    let mut weighted: Vec<(f64, f64)> = tasks.iter().flat_map(of_task).collect();
    weighted.sort_by(|one, other| one.0.total_cmp(&other.0));
    let (mut below, mut sum) = (0.0, 0.0);
    for (value, weight) in weighted {
        let inside = (below + weight).min(0.75) - f64::max(below, 0.25);
        sum += value * inside.max(0.0);
        below += weight;
    }
    2.0 * sum
}

/// Mean over tasks of the average distance of a task's seeds below `target`; values above count as `target` (Agarwal et
/// al. 2021, arXiv:2108.13264, section 4.3); shape as in [`suite_mean`].
#[must_use]
pub fn suite_optimality_gap(tasks: &[Vec<f64>], target: f64) -> f64 {
    let capped =
        |seeds: &Vec<f64>| target - mean(&seeds.iter().map(|score| score.min(target)).collect::<Vec<_>>());
    mean(&tasks.iter().map(capped).collect::<Vec<_>>())
}

/// Mean over tasks of the share of seeds above `score`, a point of the performance profile (the same, section
/// 4.2); shape as in [`suite_mean`].
#[must_use]
pub fn suite_share_above(tasks: &[Vec<f64>], score: f64) -> f64 {
    let share =
        |seeds: &Vec<f64>| count(seeds.iter().filter(|value| **value > score).count()) / count(seeds.len());
    mean(&tasks.iter().map(share).collect::<Vec<_>>())
}

fn task_means(tasks: &[Vec<f64>]) -> Vec<f64> {
    tasks.iter().map(|seeds| mean(seeds)).collect()
}

/// A number of values as a float; exact below 2^53.
pub(super) fn count(n: usize) -> f64 {
    n as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{assert_close, numbers, reference};

    #[test]
    fn a_task_with_more_seeds_weighs_no_more() {
        // In order: 1 (1/8), 2 (1/8), 3 (1/4), 4 (1/8), 8 (1/4), 10 (1/8). Between a quarter and three quarters lie
        // 3, 4 and the half of 8: (3 / 4 + 4 / 8 + 8 / 8) / (1 / 2).
        let tasks = [vec![3.0, 8.0], vec![1.0, 2.0, 4.0, 10.0]];
        assert_close(suite_iqm(&tasks), 2.0 * (0.75 + 0.5 + 1.0), 1e-12);
        // Counting every seed twice changes nothing.
        let doubled = [tasks[0].repeat(2), tasks[1].clone()];
        assert_close(suite_iqm(&doubled), iqm(&doubled.concat()), 1e-12);
        assert_close(suite_iqm(&doubled), suite_iqm(&tasks), 1e-12);
        assert!(suite_iqm(&[]).is_nan());
    }

    /// Worked by hand.
    #[test]
    fn small_samples() {
        assert_eq!(mean(&[1.0, 2.0, 6.0]), 3.0);
        assert_eq!(variance(&[1.0, 2.0, 6.0]), 7.0);
        assert_eq!(median(&[5.0, 1.0, 3.0, 2.0]), 2.5);
        // One of four values is cut at each end, none of three.
        assert_eq!(iqm(&[100.0, 1.0, 3.0, -50.0]), 2.0);
        assert_eq!(iqm(&[1.0, 2.0, 6.0]), 3.0);
        assert_eq!(quantile(&[10.0, 20.0, 30.0, 40.0, 50.0], 0.3), 22.0);
    }

    #[test]
    fn equal_values_have_no_variance() {
        for n in 2..20 {
            assert_eq!((mean(&vec![0.1; n]), variance(&vec![0.1; n])), (0.1, 0.0));
        }
    }

    #[test]
    fn too_few_values_are_no_number() {
        assert!(mean(&[]).is_nan() && median(&[]).is_nan() && iqm(&[]).is_nan());
        assert!(sd(&[]).is_nan() && sd(&[1.0]).is_nan());
    }

    #[test]
    fn gaps_and_profiles_by_hand() {
        // The first task misses 1 by 0.5 and 0, since the excess of 3 does not count; the second by 1 and 2.
        let tasks = [vec![0.5, 3.0], vec![0.0, -1.0]];
        assert_eq!(suite_optimality_gap(&tasks, 1.0), 0.875);
        assert_eq!(
            (suite_share_above(&tasks, 0.5), suite_share_above(&tasks, -1.0)),
            (0.25, 0.75)
        );
        assert!(suite_optimality_gap(&[], 1.0).is_nan() && suite_share_above(&[], 1.0).is_nan());
    }

    #[test]
    fn suites_agree_with_rliable() {
        let suite = &reference()["suite"];
        let tasks: Vec<Vec<f64>> = suite["x"].as_array().unwrap().iter().map(numbers).collect();
        let expected = numbers(&suite["mean_median_iqm"]);
        assert_close(suite_mean(&tasks), expected[0], 1e-13);
        assert_close(suite_median(&tasks), expected[1], 1e-13);
        assert_close(suite_iqm(&tasks), expected[2], 1e-13);
    }
}
