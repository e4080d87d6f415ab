//! Unscented Kalman filter of a random walk that is observed through a function.
//!
//! S. J. Julier and J. K. Uhlmann 1997; R. van der Merwe 2004, "Sigma-point Kalman filters for probabilistic inference
//! in dynamic state-space models" (the scaled sigma points). All in double precision, since the weight of the middle
//! point is of the order of `-1 / alpha^2`.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | x, P | `mean`, `covariance` | `[d]`, `[d, d]` |
//! | Q, R | variances of a step and of a measurement | `[d]`, `[m]` |
//! | alpha, beta, kappa, lambda = alpha^2 (d + kappa) - d | [`SigmaPoints`] | scalars |
//! | X_0 = x, X_i = x +- column i of chol((d + lambda) P) | `SigmaPoints::at` | `2 d + 1` points |
//! | W_m, W_c | weights of means and covariances | `[2 d + 1]` |

use crate::matrices::product;
use nalgebra::{DMatrix, DVector};

/// Spread and weights of the sigma points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SigmaPoints {
    /// Spread of the points around the mean.
    pub alpha: f64,
    /// Weight of the middle point in the covariance; 2 is best for a normal distribution.
    pub beta: f64,
    /// Second spread.
    pub kappa: f64,
}

/// Reason why a filter cannot take a step.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FilterError<E> {
    /// The covariance is not positive definite.
    #[error("the covariance is not positive definite any more")]
    Indefinite,
    /// Error of the function.
    #[error("{0}")]
    Function(E),
}

impl SigmaPoints {
    fn scale(&self, d: usize) -> f64 {
        self.alpha * self.alpha * (d as f64 + self.kappa)
    }

    /// Sigma points of a mean and a covariance, as columns; `None` if the covariance is not positive definite.
    fn at(&self, mean: &DVector<f64>, covariance: &DMatrix<f64>) -> Option<Vec<DVector<f64>>> {
        let d = mean.len();
        let root = (covariance * self.scale(d)).cholesky()?.l();
        let mut points = vec![mean.clone()];
        points.extend((0..d).map(|i| mean + root.column(i)));
        points.extend((0..d).map(|i| mean - root.column(i)));
        Some(points)
    }

    /// Weights of the means and of the covariances.
    fn weights(&self, d: usize) -> (Vec<f64>, Vec<f64>) {
        let scale = self.scale(d);
        let first = (scale - d as f64) / scale;
        let mut means = vec![0.5 / scale; 2 * d + 1];
        means[0] = first;
        let mut covariances = means.clone();
        covariances[0] = first + 1.0 - self.alpha * self.alpha + self.beta;
        (means, covariances)
    }
}

/// A normal belief about the state of a random walk.
#[derive(Debug, Clone, PartialEq)]
pub struct UnscentedFilter {
    sigma: SigmaPoints,
    /// Whether the sigma points are drawn again between prediction and update; otherwise those of the prediction are
    /// kept.
    redraw: bool,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl UnscentedFilter {
    /// Creates a belief of independent normal entries.
    #[must_use]
    pub fn new(sigma: SigmaPoints, redraw: bool, mean: &[f64], sd: &[f64]) -> Self {
        let variances = DVector::from_iterator(sd.len(), sd.iter().map(|sd| sd * sd));
        Self {
            sigma,
            redraw,
            mean: DVector::from_column_slice(mean),
            covariance: DMatrix::from_diagonal(&variances),
        }
    }

    /// Mean of the belief.
    #[must_use]
    pub fn mean(&self) -> &[f64] {
        self.mean.as_slice()
    }

    /// Covariance of the belief.
    #[must_use]
    pub fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// Takes a step of the walk with variances `walk`, then a measurement of `function` with variances
    /// `noise`.
    ///
    /// # Errors
    /// [`FilterError`]; the belief is then unchanged.
    pub fn step<E>(
        &mut self,
        walk: &[f64],
        measured: &[f64],
        noise: &[f64],
        mut function: impl FnMut(&[f64]) -> Result<Vec<f64>, E>,
    ) -> Result<(), FilterError<E>> {
        let points = self
            .sigma
            .at(&self.mean, &self.covariance)
            .ok_or(FilterError::Indefinite)?;
        let predicted = &self.covariance + DMatrix::from_diagonal(&DVector::from_column_slice(walk));
        let points = if self.redraw {
            self.sigma
                .at(&self.mean, &predicted)
                .ok_or(FilterError::Indefinite)?
        } else {
            points
        };
        let seen: Vec<DVector<f64>> = points
            .iter()
            .map(|point| function(point.as_slice()).map(DVector::from_vec))
            .collect::<Result<_, E>>()
            .map_err(FilterError::Function)?;
        let (means, covariances) = self.sigma.weights(self.mean.len());
        let expected = weighed(&means, &seen);
        let (m, d) = (measured.len(), self.mean.len());
        let mut spread = DMatrix::from_diagonal(&DVector::from_column_slice(noise));
        let mut joint = DMatrix::zeros(d, m);
        for ((weight, point), value) in covariances.iter().zip(&points).zip(&seen) {
            let off = value - &expected;
            spread += &off * off.transpose() * *weight;
            joint += (point - &self.mean) * off.transpose() * *weight;
        }
        let inverse = spread.clone().cholesky().ok_or(FilterError::Indefinite)?;
        let gain = inverse.solve(&joint.transpose()).transpose();
        let off = DVector::from_column_slice(measured) - expected;
        let mean = &self.mean + &gain * off;
        let covariance = predicted - product(&product(&gain, &spread), &gain.transpose());
        // Rounding leaves the covariance slightly asymmetric.
        self.covariance = (&covariance + covariance.transpose()) * 0.5;
        self.mean = mean;
        Ok(())
    }
}

fn weighed(weights: &[f64], points: &[DVector<f64>]) -> DVector<f64> {
    let sum = DVector::zeros(points[0].len());
    weights
        .iter()
        .zip(points)
        .fold(sum, |sum, (weight, point)| sum + point * *weight)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGMA: SigmaPoints = SigmaPoints {
        alpha: 0.5,
        beta: 2.0,
        kappa: 0.0,
    };

    /// Readings of two numbers that resemble range and bearing.
    fn seen(x: &[f64]) -> Result<Vec<f64>, ()> {
        Ok(vec![x[0].hypot(x[1]), (x[1] / x[0]).atan(), x[0] * x[1]])
    }

    #[test]
    fn a_linear_measurement_gives_the_kalman_filter() {
        // One number is observed directly: gain P / (P + R) by hand.
        let mut filter = UnscentedFilter::new(SIGMA, true, &[1.0], &[2.0]);
        filter
            .step(&[1.0], &[3.0], &[5.0], |x| Ok::<_, ()>(vec![x[0]]))
            .unwrap();
        let gain = 5.0 / 10.0;
        assert!((filter.mean()[0] - (1.0 + gain * 2.0)).abs() < 1e-12);
        assert!((filter.covariance()[(0, 0)] - (1.0 - gain) * 5.0).abs() < 1e-12);
    }

    #[test]
    fn steps_are_those_of_another_program() {
        let text = include_str!("../../../tests/fixtures/filters/unscented.csv");
        for redraw in [false, true] {
            let mut filter = UnscentedFilter::new(SIGMA, redraw, &[1.0, 0.5], &[0.3, 0.2]);
            let rows = text
                .lines()
                .skip(1)
                .map(|line| line.split(',').collect::<Vec<_>>());
            for row in rows.filter(|row| row[0] == if redraw { "redrawn" } else { "kept" }) {
                let number: Vec<f64> = row[1..].iter().map(|cell| cell.parse().unwrap()).collect();
                filter
                    .step(&[1e-3, 2e-3], &number[..3], &[0.01, 0.002, 0.02], seen)
                    .unwrap();
                let now = [
                    filter.mean()[0],
                    filter.mean()[1],
                    filter.covariance()[(0, 0)],
                    filter.covariance()[(0, 1)],
                    filter.covariance()[(1, 1)],
                ];
                for (here, there) in now.iter().zip(&number[3..]) {
                    assert!((here - there).abs() < 1e-10, "{here} {there}");
                }
            }
        }
    }

    #[test]
    fn a_function_that_fails_leaves_the_belief() {
        let mut filter = UnscentedFilter::new(SIGMA, true, &[1.0], &[1.0]);
        let before = filter.clone();
        let failed = filter.step(&[0.1], &[1.0], &[1.0], |_| Err("no point"));
        assert_eq!(failed, Err(FilterError::Function("no point")));
        assert_eq!(filter, before);
    }
}
