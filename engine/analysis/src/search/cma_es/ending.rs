//! Ends of a run of CMA-ES that its values show: they are all equal, or have stopped improving.
//!
//! N. Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772v1 (2016), section B.3.

use statistics::estimators::median;

/// Largest difference of values that counts as none.
const FLAT: f64 = 1e-12;

/// The best and the median value of each generation so far.
#[derive(Debug, Clone)]
pub(super) struct Ending {
    /// `n / lambda`: number of keys for each draw of a generation.
    keys_per_draw: f64,
    best: Vec<f64>,
    medians: Vec<f64>,
}

impl Ending {
    pub(super) fn new(n_keys: usize, population: usize) -> Self {
        Self {
            keys_per_draw: n_keys as f64 / population as f64,
            best: Vec::new(),
            medians: Vec::new(),
        }
    }

    /// Adds a generation's values, sorted from the best to the worst, and returns whether the run is over.
    pub(super) fn is_reached(&mut self, values: &[f64]) -> bool {
        self.best.push(values[0]);
        self.medians.push(median(values));
        self.is_flat(values) || self.is_stagnant()
    }

    /// Whether this generation's values and the best of the last `10 + 30 n / lambda` generations are equal.
    fn is_flat(&self, values: &[f64]) -> bool {
        let n_last = 10 + (30.0 * self.keys_per_draw).ceil() as usize;
        let last = self.best.len().checked_sub(n_last).map(|from| &self.best[from..]);
        last.is_some_and(|last| range(last) < FLAT && range(values) < FLAT)
    }

    /// Whether neither the best values nor the medians of a fifth of all generations, at least `120 + 30 n / lambda`,
    /// are better in their last three tenths than in their first.
    fn is_stagnant(&self) -> bool {
        let least = 120 + (30.0 * self.keys_per_draw).ceil() as usize;
        let n_last = (self.best.len() / 5).clamp(least, 20_000);
        let Some(from) = self.best.len().checked_sub(n_last) else {
            return false;
        };
        [&self.best, &self.medians].into_iter().all(|values| {
            let last = &values[from..];
            let n_of_end = n_last * 3 / 10;
            median(&last[n_last - n_of_end..]) >= median(&last[..n_of_end])
        })
    }
}

fn range(values: &[f64]) -> f64 {
    let [low, high] = [f64::min, f64::max].map(|end| values.iter().copied().reduce(end).unwrap_or(f64::NAN));
    high - low
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Generations of four values until the run is over, at most 1000.
    fn generations(value: impl Fn(usize, usize) -> f64) -> usize {
        let mut ending = Ending::new(2, 4);
        (1..1000)
            .find(|generation| ending.is_reached(&[0, 1, 2, 3].map(|rank| value(*generation, rank))))
            .unwrap_or(1000)
    }

    #[test]
    fn equal_values_end_a_run_after_the_generations_of_the_tutorial() {
        assert_eq!(generations(|_, _| 7.0), 25);
        assert_eq!(
            generations(|generation, rank| rank as f64 - generation as f64),
            1000
        );
    }

    #[test]
    fn values_that_stop_becoming_better_end_a_run() {
        let noisy = |generation: usize, rank: usize| rank as f64 + (generation * 7 % 5) as f64;
        assert_eq!(generations(noisy), 135);
        let later = |generation: usize, rank: usize| noisy(generation, rank) - generation.min(300) as f64;
        let n_of_later = generations(later);
        assert!((300..450).contains(&n_of_later), "{n_of_later}");
    }
}
