//! Stein variational gradient descent: the direction in which particles become samples of an unnormalised
//! density.
//!
//! Liu and Wang 2016, "Stein variational gradient descent", arXiv:1608.04471, eq. 8; amortised as in Haarnoja
//! et al. 2017, "Reinforcement learning with deep energy-based policies", arXiv:1702.08165, eq. 13: the
//! expectation runs over held particles, and others move.
//!
//! | paper | here | shape per row |
//! |---|---|---|
//! | x_j | `held` particles | `[n_held, dimension]` |
//! | grad log p(x_j) | `scores` | `[n_held, dimension]` |
//! | y_k | `moved` particles | `[n_moved, dimension]` |
//! | k(x, y) | `exp(-|x - y|^2 / h)` | scalar |
//! | h | bandwidth, `median |x - y|^2 / ln n_held`, at least [`SMALLEST_BANDWIDTH`] | scalar per row |
//! | phi(y_k) | `mean_j [k(x_j, y_k) grad log p(x_j) + grad_x k(x_j, y_k)]` | `[n_moved, dimension]` |
//!
//! The median is the lower one of an even number of distances, and the bandwidth is a constant of the
//! gradient.

/// Smallest bandwidth: below it, particles at the same place would not repel each other any more.
pub const SMALLEST_BANDWIDTH: f64 = 1e-3;

/// Numbers of particles per row and of entries per particle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Particles {
    /// Number of held particles per row, at least 2.
    pub n_held: usize,
    /// Number of moved particles per row.
    pub n_moved: usize,
    /// Number of entries of a particle.
    pub dimension: usize,
}

/// Direction of the moved particles.
#[derive(Debug, Clone, PartialEq)]
pub struct SteinDirection {
    /// Direction phi, `[rows, n_moved, dimension]`.
    pub direction: Vec<f32>,
    /// Mean bandwidth h over the rows.
    pub mean_bandwidth: f64,
}

/// Direction phi of every moved particle; rows are independent of each other. `held` and `scores` are `[rows,
/// n_held, dimension]`, `moved` is `[rows, n_moved, dimension]`, the last entry running fastest.
///
/// # Panics
/// Where the lengths do not fit or fewer than 2 particles are held.
#[must_use]
pub fn stein_direction(held: &[f32], scores: &[f32], moved: &[f32], particles: Particles) -> SteinDirection {
    let Particles {
        n_held,
        n_moved,
        dimension,
    } = particles;
    assert!(
        n_held >= 2,
        "the bandwidth divides by the logarithm of the number of held particles"
    );
    assert_eq!(held.len(), scores.len(), "one score per held particle");
    assert_eq!(
        held.len() * n_moved,
        moved.len() * n_held,
        "as many rows of held as of moved particles"
    );
    let (per_held, per_moved) = (n_held * dimension, n_moved * dimension);
    let mut direction = Vec::with_capacity(moved.len());
    let mut sum_of_bandwidths = 0.0;
    let rows = held
        .chunks(per_held)
        .zip(scores.chunks(per_held))
        .zip(moved.chunks(per_moved));
    for ((held, scores), moved) in rows {
        let row = Row {
            held,
            scores,
            dimension,
        };
        let bandwidth = row.bandwidth(moved);
        sum_of_bandwidths += bandwidth;
        moved
            .chunks(dimension)
            .for_each(|particle| row.extend(particle, bandwidth, &mut direction));
    }
    #[allow(clippy::cast_precision_loss, reason = "a number of rows is far below 2^52")]
    let n_rows = (held.len() / per_held).max(1) as f64;
    SteinDirection {
        direction,
        mean_bandwidth: sum_of_bandwidths / n_rows,
    }
}

/// Held particles of one row.
struct Row<'a> {
    held: &'a [f32],
    scores: &'a [f32],
    dimension: usize,
}

impl Row<'_> {
    #[allow(
        clippy::cast_precision_loss,
        reason = "a number of particles is far below 2^52"
    )]
    fn bandwidth(&self, moved: &[f32]) -> f64 {
        let from = |particle| {
            self.held
                .chunks(self.dimension)
                .map(move |x| squared_distance(x, particle))
        };
        let mut distances: Vec<f64> = moved.chunks(self.dimension).flat_map(from).collect();
        let middle = (distances.len() - 1) / 2;
        let (_, median, _) = distances.select_nth_unstable_by(middle, f64::total_cmp);
        let n_held = (self.held.len() / self.dimension) as f64;
        (*median / n_held.ln()).max(SMALLEST_BANDWIDTH)
    }

    /// Appends the direction of one moved particle.
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        reason = "parameters are f32"
    )]
    fn extend(&self, particle: &[f32], bandwidth: f64, direction: &mut Vec<f32>) {
        let mut sum = vec![0.0; self.dimension];
        for (x, score) in self
            .held
            .chunks(self.dimension)
            .zip(self.scores.chunks(self.dimension))
        {
            let kernel = (-squared_distance(x, particle) / bandwidth).exp();
            for (((sum, x), y), score) in sum.iter_mut().zip(x).zip(particle).zip(score) {
                let repulsion = -2.0 * (f64::from(*x) - f64::from(*y)) / bandwidth;
                *sum += kernel * (f64::from(*score) + repulsion);
            }
        }
        let n_held = (self.held.len() / self.dimension) as f64;
        direction.extend(sum.into_iter().map(|sum| (sum / n_held) as f32));
    }
}

fn squared_distance(x: &[f32], y: &[f32]) -> f64 {
    x.iter()
        .zip(y)
        .map(|(x, y)| (f64::from(*x) - f64::from(*y)).powi(2))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussian::standard_normal;
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    const SMALL: Particles = Particles {
        n_held: 3,
        n_moved: 2,
        dimension: 2,
    };

    fn normal(n: usize, rng: &mut ChaCha8Rng) -> Vec<f32> {
        (0..n).map(|_| standard_normal(rng) as f32).collect()
    }

    /// Kernel `exp(-|x - y|^2 / h)`.
    fn kernel(x: [f64; 2], y: [f64; 2], h: f64) -> f64 {
        (-((x[0] - y[0]).powi(2) + (x[1] - y[1]).powi(2)) / h).exp()
    }

    #[test]
    fn one_row_term_by_term() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (held, scores, moved) = (normal(6, &mut rng), normal(6, &mut rng), normal(4, &mut rng));
        let got = stein_direction(&held, &scores, &moved, SMALL);
        let pair = |all: &[f32], i: usize| [f64::from(all[2 * i]), f64::from(all[2 * i + 1])];
        let mut distances: Vec<f64> = (0..6)
            .map(|i| -kernel(pair(&held, i % 3), pair(&moved, i / 3), 1.0).ln())
            .collect();
        distances.sort_by(f64::total_cmp);
        let h = distances[2] / 3f64.ln();
        assert!((got.mean_bandwidth / h - 1.0).abs() < 1e-9);
        for k in 0..2 {
            for entry in 0..2 {
                // Slope of the kernel in x by finite differences.
                let term = |j: usize| {
                    let (x, y) = (pair(&held, j), pair(&moved, k));
                    let shifted = |step: f64| {
                        let mut x = x;
                        x[entry] += step;
                        kernel(x, y, h)
                    };
                    let slope = (shifted(1e-5) - shifted(-1e-5)) / 2e-5;
                    kernel(x, y, h) * pair(&scores, j)[entry] + slope
                };
                let expected = (0..3).map(term).sum::<f64>() / 3.0;
                assert!((f64::from(got.direction[2 * k + entry]) - expected).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn rows_do_not_see_each_other() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let (held, scores, moved) = (normal(12, &mut rng), normal(12, &mut rng), normal(8, &mut rng));
        let both = stein_direction(&held, &scores, &moved, SMALL);
        let second = stein_direction(&held[6..], &scores[6..], &moved[4..], SMALL);
        assert_eq!(both.direction[4..], second.direction);
    }

    #[test]
    fn particles_that_met_have_a_bandwidth() {
        let met = stein_direction(&[0.5; 6], &[1.0; 6], &[0.5; 4], SMALL);
        assert_eq!(
            (met.direction, met.mean_bandwidth),
            (vec![1.0; 4], SMALLEST_BANDWIDTH)
        );
    }

    #[test]
    fn particles_become_samples_of_a_normal_density() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let shape = Particles {
            n_held: 60,
            n_moved: 60,
            dimension: 1,
        };
        let mut x: Vec<f32> = normal(60, &mut rng).iter().map(|x| 0.1 * x - 2.0).collect();
        for _ in 0..600 {
            // Mean 1, variance 1/4.
            let scores: Vec<f32> = x.iter().map(|x| -4.0 * (x - 1.0)).collect();
            let phi = stein_direction(&x, &scores, &x, shape).direction;
            x.iter_mut().zip(&phi).for_each(|(x, phi)| *x += 0.05 * phi);
        }
        let mean = x.iter().sum::<f32>() / 60.0;
        let variance = x.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / 60.0;
        assert!(
            (mean - 1.0).abs() < 0.02 && (variance - 0.25).abs() < 0.04,
            "{mean} {variance}"
        );
    }
}
