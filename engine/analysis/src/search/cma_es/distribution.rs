//! The normal distribution of CMA-ES: mean, step and covariance follow the better draws of each generation, and the
//! covariance shrinks along the worse ones.
//!
//! N. Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772v1 (2016), figure 6 and table 1.
//!
//! | there | here |
//! |---|---|
//! | `n`, lambda, mu | `n_keys`, `population`, `n_parents` |
//! | `m`, sigma, `C = B D^2 B^T` | `mean`, `step`, `covariance`, `axes` and `lengths` |
//! | `p_sigma`, `p_c` | `path_of_step`, `path_of_covariance` |
//! | `w_i`, mu_eff | `weights`, `n_effective` |
//! | `c_sigma`, `d_sigma`, `c_c`, `c_1`, `c_mu` | `Rates` |

use contract::random::Rng;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand::Rng as _;
use statistics::normal;

/// Mean, step and covariance, with the sums over generations that they follow.
#[derive(Debug, Clone)]
pub(super) struct Distribution {
    rates: Rates,
    mean: DVector<f64>,
    step: f64,
    covariance: DMatrix<f64>,
    /// Unit eigenvectors of the covariance, as columns.
    axes: DMatrix<f64>,
    /// Roots of the eigenvalues, in the order of the axes.
    lengths: DVector<f64>,
    path_of_step: DVector<f64>,
    path_of_covariance: DVector<f64>,
    n_generations: i32,
}

impl Distribution {
    /// A round distribution of standard deviation `spread` in the middle of the unit cube.
    pub(super) fn new(n_keys: usize, spread: f64, population: usize) -> Self {
        Self {
            rates: Rates::new(n_keys, population),
            mean: DVector::from_element(n_keys, 0.5),
            step: spread,
            covariance: DMatrix::identity(n_keys, n_keys),
            axes: DMatrix::identity(n_keys, n_keys),
            lengths: DVector::from_element(n_keys, 1.0),
            path_of_step: DVector::zeros(n_keys),
            path_of_covariance: DVector::zeros(n_keys),
            n_generations: 0,
        }
    }

    /// Draws `m + sigma B D z`.
    pub(super) fn draw(&self, rng: &mut Rng) -> DVector<f64> {
        let noise = self.lengths.map(|length| length * standard_normal(rng));
        &self.mean + self.step * (&self.axes * noise)
    }

    /// Moves the distribution towards a generation, whose draws are sorted from the best to the worst.
    pub(super) fn learn(&mut self, ranked: &[DVector<f64>]) {
        let steps: Vec<DVector<f64>> = ranked
            .iter()
            .map(|draw| (draw - &self.mean) / self.step)
            .collect();
        self.n_generations += 1;
        let mean_step = self.recombine(&steps);
        self.mean += self.step * &mean_step;
        let is_short = self.follow(&mean_step);
        self.adapt_covariance(&steps, is_short);
        let Rates {
            step_path, damping, ..
        } = self.rates;
        let excess = self.path_of_step.norm() / expected_norm(self.mean.len()) - 1.0;
        self.step *= (step_path / damping * excess).exp();
        self.decompose();
    }

    /// `sum_{i <= mu} w_i y_i`.
    fn recombine(&self, steps: &[DVector<f64>]) -> DVector<f64> {
        let mut mean = DVector::zeros(self.mean.len());
        for (step, weight) in steps.iter().zip(&self.rates.weights).take(self.rates.n_parents) {
            mean.axpy(*weight, step, 1.0);
        }
        mean
    }

    /// Adds a step of the mean to both paths. The path of the covariance waits while the other one is long; returns
    /// whether that one is short.
    fn follow(&mut self, mean_step: &DVector<f64>) -> bool {
        let Rates {
            step_path: c_sigma,
            covariance_path: c_c,
            n_effective,
            ..
        } = self.rates;
        let whitened = self.whitened(mean_step);
        self.path_of_step *= 1.0 - c_sigma;
        self.path_of_step
            .axpy((c_sigma * (2.0 - c_sigma) * n_effective).sqrt(), &whitened, 1.0);
        let n_keys = self.mean.len();
        let of_stationary = (1.0 - (1.0 - c_sigma).powi(2 * self.n_generations)).sqrt();
        let is_short = self.path_of_step.norm() / of_stationary
            < (1.4 + 2.0 / (n_keys as f64 + 1.0)) * expected_norm(n_keys);
        self.path_of_covariance *= 1.0 - c_c;
        if is_short {
            self.path_of_covariance
                .axpy((c_c * (2.0 - c_c) * n_effective).sqrt(), mean_step, 1.0);
        }
        is_short
    }

    /// `C <- (1 + c_1 delta - c_1 - c_mu sum w_i) C + c_1 p_c p_c^T + c_mu sum w_i° y_i y_i^T`.
    fn adapt_covariance(&mut self, steps: &[DVector<f64>], is_short: bool) {
        let Rates {
            covariance_path: c_c,
            one: c_1,
            many: c_mu,
            ..
        } = self.rates;
        let delta = if is_short { 0.0 } else { c_c * (2.0 - c_c) };
        let sum: f64 = self.rates.weights.iter().sum();
        let n_keys = self.mean.len() as f64;
        let of_steps: Vec<f64> = steps
            .iter()
            .zip(&self.rates.weights)
            .map(|(step, weight)| {
                // A negative weight removes no more than the covariance has along the step.
                let length = if *weight < 0.0 {
                    self.whitened(step).norm_squared()
                } else {
                    n_keys
                };
                c_mu * weight * n_keys / length.max(f64::MIN_POSITIVE)
            })
            .collect();
        self.covariance *= 1.0 + c_1 * delta - c_1 - c_mu * sum;
        self.covariance
            .ger(c_1, &self.path_of_covariance, &self.path_of_covariance, 1.0);
        for (step, weight) in steps.iter().zip(of_steps) {
            self.covariance.ger(weight, step, step, 1.0);
        }
    }

    /// `C^{-1/2} y`.
    fn whitened(&self, step: &DVector<f64>) -> DVector<f64> {
        &self.axes * self.axes.tr_mul(step).component_div(&self.lengths)
    }

    fn decompose(&mut self) {
        let SymmetricEigen {
            eigenvectors,
            eigenvalues,
        } = SymmetricEigen::new(self.covariance.clone());
        self.axes = eigenvectors;
        self.lengths = eigenvalues.map(|value| value.max(0.0).sqrt());
    }

    /// Whether the distribution is a point, a needle or not finite, so that its draws give nothing new. `spread` is the
    /// initial standard deviation.
    pub(super) fn is_degenerate(&self, spread: f64) -> bool {
        const SMALLEST_STEP: f64 = 1e-12;
        const LARGEST_STEP: f64 = 1e4;
        const LARGEST_CONDITION: f64 = 1e14;
        let [least, most] = [self.lengths.min(), self.lengths.max()];
        let largest = self.step * most / spread;
        let is_round = (most / least).powi(2) <= LARGEST_CONDITION;
        !(is_round && (SMALLEST_STEP..LARGEST_STEP).contains(&largest))
    }
}

/// Weights and rates of learning, which follow from the number of keys and the size of a generation.
#[derive(Debug, Clone)]
struct Rates {
    weights: Vec<f64>,
    n_parents: usize,
    n_effective: f64,
    step_path: f64,
    damping: f64,
    covariance_path: f64,
    one: f64,
    many: f64,
}

impl Rates {
    fn new(n_keys: usize, population: usize) -> Self {
        let n = n_keys as f64;
        let raw: Vec<f64> = (1..=population)
            .map(|rank| ((population as f64 + 1.0) / 2.0).ln() - (rank as f64).ln())
            .collect();
        let n_parents = population / 2;
        let n_effective = effective(&raw[..n_parents]);
        let step_path = (n_effective + 2.0) / (n + n_effective + 5.0);
        let one = 2.0 / ((n + 1.3).powi(2) + n_effective);
        let many = (2.0 * (n_effective - 2.0 + n_effective.recip()) / ((n + 2.0).powi(2) + n_effective))
            .min(1.0 - one);
        let of_worse = (1.0 + one / many)
            .min(1.0 + 2.0 * effective(&raw[n_parents..]) / (n_effective + 2.0))
            .min((1.0 - one - many) / (n * many));
        let [better, worse] = [1.0, -1.0].map(|sign| raw.iter().map(|it| (it * sign).max(0.0)).sum::<f64>());
        Self {
            weights: raw
                .iter()
                .map(|it| {
                    if *it >= 0.0 {
                        it / better
                    } else {
                        of_worse * it / worse
                    }
                })
                .collect(),
            n_parents,
            n_effective,
            step_path,
            damping: 1.0 + 2.0 * (((n_effective - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + step_path,
            covariance_path: (4.0 + n_effective / n) / (n + 4.0 + 2.0 * n_effective / n),
            one,
            many,
        }
    }
}

/// `(sum w)^2 / sum w^2`.
fn effective(weights: &[f64]) -> f64 {
    weights.iter().sum::<f64>().powi(2) / weights.iter().map(|it| it * it).sum::<f64>()
}

/// `E |N(0, I)|`, to the order of the tutorial.
fn expected_norm(n_keys: usize) -> f64 {
    let n = n_keys as f64;
    n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n))
}

fn standard_normal(rng: &mut Rng) -> f64 {
    // Half a unit above each multiple of 2^-53 less one bit: strictly between 0 and 1.
    let uniform = (rng.random::<u64>() >> 12) as f64 + 0.5;
    normal::quantile(uniform / (1u64 << 52) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::random;
    use serde_json::Value;

    /// Distributions of the Python package `cmaes` after each of eight generations; `cma_es_generations.py` beside the
    /// file writes them.
    fn reference() -> Value {
        serde_json::from_str(include_str!(
            "../../../../../tests/fixtures/search/cma_es_generations.json"
        ))
        .unwrap()
    }

    fn numbers(value: &Value) -> Vec<f64> {
        serde_json::from_value(value.clone()).unwrap()
    }

    #[test]
    fn generations_move_it_as_they_move_another_programs() {
        let reference = reference();
        let mut ours = Distribution::new(3, reference["spread"].as_f64().unwrap(), 7);
        for generation in reference["generations"].as_array().unwrap() {
            let ranked: Vec<_> = generation["ranked"]
                .as_array()
                .unwrap()
                .iter()
                .map(|draw| DVector::from_vec(numbers(draw)))
                .collect();
            ours.learn(&ranked);
            let covariance: Vec<f64> = generation["covariance"]
                .as_array()
                .unwrap()
                .iter()
                .flat_map(numbers)
                .collect();
            let theirs = [numbers(&generation["mean"]), covariance].concat();
            for (ours, theirs) in ours.mean.iter().chain(&ours.covariance).zip(theirs) {
                assert!(
                    (ours - theirs).abs() < 1e-7 * theirs.abs().max(1.0),
                    "{ours} {theirs}"
                );
            }
            let step = generation["step"].as_f64().unwrap();
            assert!((ours.step / step - 1.0).abs() < 1e-7, "{} {step}", ours.step);
        }
    }

    #[test]
    fn draws_have_its_mean_and_covariance() {
        let mut distribution = Distribution::new(2, 0.2, 4);
        distribution.covariance = DMatrix::from_row_slice(2, 2, &[2.0, 0.6, 0.6, 0.5]);
        distribution.decompose();
        let mut rng = random::stream(&["test"]);
        let (n, mut sum, mut squares) = (40_000, DVector::zeros(2), DMatrix::zeros(2, 2));
        for _ in 0..n {
            let y = (distribution.draw(&mut rng) - &distribution.mean) / distribution.step;
            sum += &y;
            squares.ger(1.0, &y, &y, 1.0);
        }
        let off = squares / f64::from(n) - &distribution.covariance;
        // Five standard errors of the largest entry's mean: 5 sqrt(2 / n) 2.
        assert!(off.amax() < 0.08 && (sum / f64::from(n)).amax() < 0.04, "{off}");
    }

    #[test]
    fn a_point_a_needle_and_an_endless_step_are_degenerate() {
        let round = Distribution::new(2, 0.2, 4);
        assert!(!round.is_degenerate(0.2));
        for step in [1e-14, 1e5, f64::NAN] {
            assert!(
                Distribution {
                    step,
                    ..round.clone()
                }
                .is_degenerate(0.2),
                "{step}"
            );
        }
        let lengths = DVector::from_vec(vec![1e-8, 1.0]);
        assert!(Distribution { lengths, ..round }.is_degenerate(0.2));
    }
}
