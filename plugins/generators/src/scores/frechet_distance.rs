//! The Fréchet distance between normal distributions that are fitted to features of two sets of images.
//!
//! M. Heusel et al. 2017, "GANs trained by a two time-scale update rule converge to a local Nash equilibrium",
//! arXiv:1706.08500, equation 6: `d^2 = |m1 - m2|^2 + Tr(C1 + C2 - 2 (C1 C2)^(1/2))`. The reported distance is
//! d^2, there and here.
//!
//! | symbol | here | shape |
//! |---|---|---|
//! | m1, m2 | `mean` | `[features]` |
//! | C1, C2 | `covariance`, divided by images - 1 | `[features, features]` |
//! | A, with A A^T = C | `Factor::matrix`: eigenvectors times roots of the eigenvalues | `[features, rank]` |
//!
//! `Tr (C1 C2)^(1/2)` is the sum of the roots of the eigenvalues of `C1^(1/2) C2 C1^(1/2)`, and those roots are
//! the singular values of `B = A2^T A1`. They are taken from `B` itself, as the positive eigenvalues of the
//! symmetric `[0, B; B^T, 0]`: no product of covariances is formed, whose small eigenvalues would drown, no
//! general square root of a matrix is needed, no part is imaginary, and nothing is added to a diagonal, so a
//! covariance of fewer images than features is handled like any other. Eigenvalues of a covariance below
//! `features x 2^-52` of its largest are rounding errors, negative ones above all, and count as 0; the lowest
//! one is part of the result.

use super::ScoreError;
use nalgebra::{DMatrix, SymmetricEigen};
use serde::{Deserialize, Serialize};

/// Mean and covariance of the features of a set of images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Moments {
    /// Number of images.
    pub count: usize,
    /// `[features]`.
    pub mean: Vec<f64>,
    /// `[features, features]`, divided by `count - 1` (`numpy.cov`).
    pub covariance: Vec<f64>,
}

/// Distance between two sets, with its parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrechetDistance {
    /// `d^2`; 0 where rounding made it negative.
    pub distance: f64,
    /// `|m1 - m2|^2`.
    pub of_means: f64,
    /// `Tr(C1 + C2 - 2 (C1 C2)^(1/2))`, as it was computed.
    pub of_covariances: f64,
    /// The lowest eigenvalue in units of the largest of its matrix, where negative, else 0. About 1e-15 is
    /// rounding; much more means that a matrix is not a covariance.
    pub lowest_eigenvalue: f64,
}

/// Running moments of images that come in batches. Each image is added by itself (Welford 1962), so the bits
/// depend on the order of the images and not on the sizes of batches.
#[derive(Debug, Clone, PartialEq)]
pub struct MomentSums {
    count: usize,
    mean: Vec<f64>,
    /// Sum of the products of deviations from the mean, `[features, features]`, on and above the diagonal.
    products: Vec<f64>,
}

impl Moments {
    /// The moments of `features` `[images, n_features]`.
    ///
    /// # Errors
    /// [`ScoreError::TooFewImages`] below two, [`ScoreError::NotFinite`].
    ///
    /// # Panics
    /// Where `features` is no whole number of images.
    pub fn of(features: &[f32], n_features: usize) -> Result<Self, ScoreError> {
        let mut sums = MomentSums::new(n_features);
        sums.add(features)?;
        sums.moments()
    }

    fn is_shaped(&self) -> bool {
        !self.mean.is_empty() && self.covariance.len() == self.mean.len() * self.mean.len()
    }

    fn trace(&self) -> f64 {
        self.covariance.iter().step_by(self.mean.len() + 1).sum()
    }
}

impl MomentSums {
    /// Sums over no images yet.
    ///
    /// # Panics
    /// Where there are no features.
    #[must_use]
    pub fn new(n_features: usize) -> Self {
        assert!(n_features > 0, "moments of no features");
        Self {
            count: 0,
            mean: vec![0.0; n_features],
            products: vec![0.0; n_features * n_features],
        }
    }

    /// Adds the images of a batch, `[images, features]`.
    ///
    /// # Errors
    /// [`ScoreError::NotFinite`], with images counted from the first of all; those before it are added.
    ///
    /// # Panics
    /// Where `features` is no whole number of images.
    pub fn add(&mut self, features: &[f32]) -> Result<(), ScoreError> {
        let n_features = self.mean.len();
        let whole = features.len().is_multiple_of(n_features);
        assert!(whole, "{} numbers of {n_features} features", features.len());
        features
            .chunks_exact(n_features)
            .try_for_each(|image| self.add_image(image))
    }

    fn add_image(&mut self, features: &[f32]) -> Result<(), ScoreError> {
        if let Some(feature) = features.iter().position(|feature| !feature.is_finite()) {
            return Err(ScoreError::NotFinite {
                image: self.count,
                feature,
                found: features[feature],
            });
        }
        self.count += 1;
        let count = self.count as f64;
        let pairs = features.iter().zip(&self.mean);
        let deviations: Vec<f64> = pairs.map(|(x, mean)| f64::from(*x) - mean).collect();
        for (mean, deviation) in self.mean.iter_mut().zip(&deviations) {
            *mean += deviation / count;
        }
        let weight = (count - 1.0) / count;
        for (index, row) in self.products.chunks_exact_mut(deviations.len()).enumerate() {
            let weighed = deviations[index] * weight;
            let right = row[index..].iter_mut().zip(&deviations[index..]);
            right.for_each(|(sum, deviation)| *sum += weighed * deviation);
        }
        Ok(())
    }

    /// The moments of all images so far.
    ///
    /// # Errors
    /// [`ScoreError::TooFewImages`] below two.
    pub fn moments(&self) -> Result<Moments, ScoreError> {
        if self.count < 2 {
            return Err(ScoreError::TooFewImages {
                found: self.count,
                needed: 2,
            });
        }
        let n = self.mean.len();
        let entry = |at: usize| self.products[(at / n).min(at % n) * n + (at / n).max(at % n)];
        let divisor = (self.count - 1) as f64;
        Ok(Moments {
            count: self.count,
            mean: self.mean.clone(),
            covariance: (0..n * n).map(|at| entry(at) / divisor).collect(),
        })
    }
}

/// The distance between two sets of images, given the moments of their features.
///
/// # Errors
/// [`ScoreError::Shapes`] where the features are not as many, [`ScoreError::Moments`] where they are not finite.
pub fn frechet_distance(first: &Moments, second: &Moments) -> Result<FrechetDistance, ScoreError> {
    let n = first.mean.len();
    if n != second.mean.len() || !first.is_shaped() || !second.is_shaped() {
        return Err(ScoreError::Shapes {
            first: n,
            second: second.mean.len(),
        });
    }
    let pairs = first.mean.iter().zip(&second.mean);
    let of_means: f64 = pairs.map(|(one, other)| (one - other) * (one - other)).sum();
    let [one, other] = [Factor::of(first)?, Factor::of(second)?];
    let of_covariances =
        first.trace() + second.trace() - 2.0 * sum_of_singular_values(&one.matrix, &other.matrix);
    let distance = of_means + of_covariances;
    if !distance.is_finite() {
        return Err(ScoreError::Moments { features: n });
    }
    Ok(FrechetDistance {
        distance: distance.max(0.0),
        of_means,
        of_covariances,
        lowest_eigenvalue: one.lowest_eigenvalue.min(other.lowest_eigenvalue),
    })
}

/// A factor `A` of a covariance `C = A A^T`, from its eigenvalues.
struct Factor {
    /// `A`: a column for each eigenvalue that is not 0.
    matrix: DMatrix<f64>,
    /// The lowest eigenvalue in units of the largest, at most 0.
    lowest_eigenvalue: f64,
}

impl Factor {
    fn of(moments: &Moments) -> Result<Self, ScoreError> {
        /// Far more than the two or so that an eigenvalue takes.
        const STEPS_PER_FEATURE: usize = 100;
        let n = moments.mean.len();
        let missing = ScoreError::Moments { features: n };
        // The search for eigenvalues would not end for NaN.
        if !moments.covariance.iter().all(|entry| entry.is_finite()) {
            return Err(missing);
        }
        let covariance = DMatrix::from_row_slice(n, n, &moments.covariance);
        let eigen =
            SymmetricEigen::try_new(covariance, f64::EPSILON, STEPS_PER_FEATURE * n).ok_or(missing)?;
        let values = &eigen.eigenvalues;
        let largest = values.amax();
        let rounding = largest * n as f64 * f64::EPSILON;
        let kept: Vec<usize> = (0..n).filter(|index| values[*index] > rounding).collect();
        Ok(Self {
            matrix: DMatrix::from_fn(n, kept.len(), |row, column| {
                eigen.eigenvectors[(row, kept[column])] * values[kept[column]].sqrt()
            }),
            lowest_eigenvalue: if largest > 0.0 {
                (values.min() / largest).min(0.0)
            } else {
                0.0
            },
        })
    }
}

/// The singular values of `B = A2^T A1`: half the sum of the sizes of the eigenvalues of `[0, B; B^T, 0]`,
/// which are both signs of each.
fn sum_of_singular_values(a1: &DMatrix<f64>, a2: &DMatrix<f64>) -> f64 {
    let (columns, rows) = (a1.ncols(), a2.ncols());
    if columns == 0 || rows == 0 {
        return 0.0;
    }
    let mut both = DMatrix::zeros(rows + columns, rows + columns);
    for row in 0..rows {
        for column in 0..columns {
            // Written out: for a matrix product the library picks a kernel by the processor, and bits with it.
            let entry = a2.column(row).dot(&a1.column(column));
            both[(row, rows + column)] = entry;
            both[(rows + column, row)] = entry;
        }
    }
    both.symmetric_eigenvalues()
        .iter()
        .map(|value| value.abs())
        .sum::<f64>()
        / 2.0
}

#[cfg(test)]
mod tests;
