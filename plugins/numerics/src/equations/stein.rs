//! Stein variational gradient descent: the direction in which particles become samples of an unnormalised density.
//!
//! Liu and Wang 2016, "Stein variational gradient descent", arXiv:1608.04471, eq. 8; amortised as in Haarnoja
//! et al. 2017, "Reinforcement learning with deep energy-based policies", arXiv:1702.08165, eq. 13: the
//! expectation runs over held particles, and others move.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | x_j | `held` particles, those of a row one after the other | `[rows n_held, dimension]` |
//! | grad log p(x_j) | `scores` | `[rows n_held, dimension]` |
//! | y_k | `moved` particles | `[rows n_moved, dimension]` |
//! | k(x, y) | `exp(-|x - y|^2 / h)` | `[rows n_moved, n_held]` |
//! | h | bandwidth, `median |x - y|^2 / ln n_held`, at least [`SMALLEST_BANDWIDTH`] | `[rows, 1]` |
//! | phi(y_k) | `mean_j [k(x_j, y_k) grad log p(x_j) + grad_x k(x_j, y_k)]` | `[rows n_moved, dimension]` |
//!
//! The median is the lower one of an even number of distances, and the bandwidth is a constant of the gradient.

use arithmetic::double;
use plan::Expression;

/// Smallest bandwidth; below it, particles at the same place would no longer repel each other.
pub const SMALLEST_BANDWIDTH: f64 = 1e-3;

/// Direction of the moved particles.
#[derive(Debug, Clone, Copy)]
pub struct SteinDirection<'e> {
    /// Direction phi, `[rows n_moved, dimension]`.
    pub direction: Expression<'e>,
    /// Bandwidth h, `[rows, 1]`.
    pub bandwidth: Expression<'e>,
}

/// Direction phi of every moved particle of `rows` rows, which are independent of each other.
///
/// # Panics
/// If the shapes do not fit or fewer than 2 particles of a row are held.
#[must_use]
#[allow(
    clippy::cast_precision_loss,
    reason = "a number of particles is far below 2^52"
)]
pub fn stein_direction<'e>(
    held: Expression<'e>,
    scores: Expression<'e>,
    moved: Expression<'e>,
    rows: usize,
) -> SteinDirection<'e> {
    let (n_held, n_moved, dimension) = (held.n_rows() / rows, moved.n_rows() / rows, held.n_columns());
    assert!(
        n_held >= 2,
        "the bandwidth divides by the logarithm of the number of held particles"
    );
    assert_eq!(held.shape(), scores.shape(), "one score per held particle");
    assert_eq!(
        [held.shape(), moved.shape()],
        [[rows * n_held, dimension], [rows * n_moved, dimension]],
        "as many rows of held as of moved particles"
    );
    // One entry of the held particles for each moved one, `[rows n_moved, n_held]`.
    let of_held = |particles: Expression<'e>, entry: usize| {
        let of_row = particles.columns(entry..entry + 1).reshape([rows, n_held]);
        of_row.repeat_rows(n_moved)
    };
    // x - y of each pair, one matrix per entry.
    let difference = |entry| of_held(held, entry) - moved.columns(entry..entry + 1);
    let differences: Vec<_> = (0..dimension).map(difference).collect();
    let first = differences[0].square();
    let distances = differences[1..].iter().fold(first, |sum, it| sum + it.square());

    let n_pairs = n_moved * n_held;
    let median = distances.reshape([rows, n_pairs]).ranked((n_pairs - 1) / 2);
    let bandwidth = (median / double::ln(n_held as f64)).clamp(SMALLEST_BANDWIDTH, f64::INFINITY);
    let h = bandwidth.repeat_rows(n_moved);
    let kernel = (-distances / h).exp();
    let phi = |(entry, difference): (usize, &Expression<'e>)| {
        let attraction_and_repulsion = of_held(scores, entry) - *difference * 2.0 / h;
        (kernel * attraction_and_repulsion).mean_columns()
    };
    let direction: Vec<_> = differences.iter().enumerate().map(phi).collect();
    SteinDirection {
        direction: held.equations().join(&direction),
        bandwidth,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussian::standard_normal;
    use plan::{Equations, Processor, State};
    use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

    fn normal(n: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
        (0..n).map(|_| standard_normal(rng)).collect()
    }

    /// Direction and mean bandwidth for rows of 3 held and 2 moved particles in a plane.
    fn direction(held: &[f64], scores: &[f64], moved: &[f64]) -> (Vec<f64>, f64) {
        let equations = Equations::new();
        let particles = |entries: &[f64]| equations.constant([entries.len() / 2, 2], entries);
        let rows = moved.len() / 4;
        equations.routine("direction");
        let found = stein_direction(particles(held), particles(scores), particles(moved), rows);
        equations.output("direction", found.direction);
        equations.output("bandwidth", found.bandwidth.mean());
        let mut processor = Processor::<f64>::new(equations.into_graph());
        processor.run("direction", &mut State::default());
        (
            processor.entries("direction").to_vec(),
            processor.number("bandwidth"),
        )
    }

    /// Kernel `exp(-|x - y|^2 / h)`.
    fn kernel(x: [f64; 2], y: [f64; 2], h: f64) -> f64 {
        (-((x[0] - y[0]).powi(2) + (x[1] - y[1]).powi(2)) / h).exp()
    }

    #[test]
    fn one_row_term_by_term() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (held, scores, moved) = (normal(6, &mut rng), normal(6, &mut rng), normal(4, &mut rng));
        let (found, bandwidth) = direction(&held, &scores, &moved);
        let pair = |all: &[f64], i: usize| [all[2 * i], all[2 * i + 1]];
        let mut distances: Vec<f64> = (0..6)
            .map(|i| -kernel(pair(&held, i % 3), pair(&moved, i / 3), 1.0).ln())
            .collect();
        distances.sort_by(f64::total_cmp);
        let h = distances[2] / 3f64.ln();
        assert!((bandwidth / h - 1.0).abs() < 1e-9);
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
                assert!((found[2 * k + entry] - expected).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn rows_do_not_see_each_other() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let (held, scores, moved) = (normal(12, &mut rng), normal(12, &mut rng), normal(8, &mut rng));
        let both = direction(&held, &scores, &moved).0;
        let second = direction(&held[6..], &scores[6..], &moved[4..]).0;
        assert_eq!(both[4..], second);
    }

    #[test]
    fn particles_that_met_have_a_bandwidth() {
        let met = direction(&[0.5; 6], &[1.0; 6], &[0.5; 4]);
        assert_eq!(met, (vec![1.0; 4], SMALLEST_BANDWIDTH));
    }

    #[test]
    fn particles_become_samples_of_a_normal_density() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut state = State::default();
        let first = normal(60, &mut rng).iter().map(|x| 0.1 * x - 2.0).collect();
        state.insert("x", [60, 1], first);
        let equations = Equations::new();
        let x = equations.parameter("x", [60, 1]);
        equations.routine("move");
        // Mean 1, variance 1/4.
        let scores = (x - 1.0) * -4.0;
        let phi = stein_direction(x, scores, x, 1).direction;
        equations.assign(x, x + phi * 0.05);
        let mut processor = Processor::<f64>::new(equations.into_graph());
        (0..600).for_each(|_| processor.run("move", &mut state));
        let x = state.entries("x");
        let mean = x.iter().sum::<f64>() / 60.0;
        let variance = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 60.0;
        assert!(
            (mean - 1.0).abs() < 0.02 && (variance - 0.25).abs() < 0.04,
            "{mean} {variance}"
        );
    }
}
