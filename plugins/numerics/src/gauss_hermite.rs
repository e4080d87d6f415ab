//! Gauss-Hermite quadrature: expectations over a standard normal number.
//!
//! Golub and Welsch 1969, "Calculation of Gauss quadrature rules", Mathematics of Computation 23.
//!
//! | symbol | here |
//! |---|---|
//! | h_k | orthonormal Hermite polynomials, `sqrt(k + 1) h_(k+1)(z) = z h_k(z) - sqrt(k) h_(k-1)(z)`, `h_0 = 1` |
//! | J | matrix of that recurrence: symmetric, `sqrt(1), ..., sqrt(n - 1)` beside a diagonal of zeros |
//! | z_i | nodes, the eigenvalues of J |
//! | w_i | weights, `1 / sum_(k<n) h_k(z_i)^2`, with a small relative error even if they are tiny |

use nalgebra::DMatrix;

/// Nodes in rising order with their weights: `E f(z)` is `sum_i w_i f(z_i)`, exact for polynomials of a
/// degree below `2 n`.
#[must_use]
pub fn gauss_hermite(n: usize) -> Vec<(f64, f64)> {
    let recurrence = DMatrix::from_fn(n, n, |row, column| {
        if row.abs_diff(column) == 1 {
            root(row.max(column))
        } else {
            0.0
        }
    });
    let mut nodes: Vec<f64> = recurrence.symmetric_eigenvalues().iter().copied().collect();
    nodes.sort_by(f64::total_cmp);
    nodes.into_iter().map(|z| (z, weight(n, z))).collect()
}

fn weight(n: usize, z: f64) -> f64 {
    let (mut before, mut polynomial, mut sum) = (0.0, 1.0, 0.0);
    for k in 0..n {
        sum += polynomial * polynomial;
        (before, polynomial) = (polynomial, (z * polynomial - root(k) * before) / root(k + 1));
    }
    1.0 / sum
}

#[allow(clippy::cast_precision_loss, reason = "a few dozen nodes")]
fn root(k: usize) -> f64 {
    (k as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with closed forms for three nodes, and for five (the roots of `z^5 - 10 z^3 + 15 z`).
    #[test]
    fn small_rules_are_the_known_ones() {
        let wide = |sign: f64| (5.0 + sign * 10f64.sqrt()).sqrt();
        let light = |sign: f64| (7.0 - sign * 2.0 * 10f64.sqrt()) / 60.0;
        let five = [
            (wide(1.0), light(1.0)),
            (wide(-1.0), light(-1.0)),
            (0.0, 8.0 / 15.0),
        ];
        let three = [(3f64.sqrt(), 1.0 / 6.0), (0.0, 2.0 / 3.0)];
        for (n, known) in [(3, three.as_slice()), (5, five.as_slice())] {
            let rule = gauss_hermite(n);
            for (i, (z, w)) in known.iter().enumerate() {
                let ((low, of_low), (high, of_high)) = (rule[i], rule[n - 1 - i]);
                assert!(
                    (low + z).abs() < 1e-14 && (high - z).abs() < 1e-14,
                    "{n}: {low} {high} {z}"
                );
                assert!(
                    (of_low - w).abs() < 1e-14 && (of_high - w).abs() < 1e-14,
                    "{n}: {of_low} {of_high} {w}"
                );
            }
        }
    }

    /// Compares with Abramowitz and Stegun, table 25.10, whose nodes are these divided by the square root of
    /// 2.
    #[test]
    fn twenty_nodes_are_the_tabulated_ones() {
        let rule = gauss_hermite(20);
        for (place, node, weight) in [
            (19, 5.387_480_890_011_2, 2.229_393_645_534e-13),
            (10, 0.245_340_708_300_9, 0.462_243_669_600_6),
        ] {
            let (z, w) = rule[place];
            assert!((z / 2f64.sqrt() - node).abs() < 1e-12, "{z}");
            assert!(
                (w * std::f64::consts::PI.sqrt() / weight - 1.0).abs() < 1e-11,
                "{w}"
            );
        }
    }

    /// Tests the degrees below twice the number of nodes, as far as a rounded sum can show them.
    #[test]
    fn moments_are_those_of_a_normal_number() {
        let rule = gauss_hermite(40);
        let mut expected = 1.0;
        for power in (0..=40).step_by(2) {
            let moment: f64 = rule.iter().map(|(z, w)| w * z.powi(power)).sum();
            assert!(
                (moment / expected - 1.0).abs() < 1e-11,
                "{power}: {moment} {expected}"
            );
            expected *= f64::from(power + 1);
        }
    }
}
