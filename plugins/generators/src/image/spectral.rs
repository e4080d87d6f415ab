//! Division of a weight by its largest singular value.
//!
//! Miyato et al. 2018, "Spectral normalization for generative adversarial networks", arXiv:1802.05957,
//! algorithm 1.
//!
//! | paper | here | shape |
//! |---|---|---|
//! | W | `weight` | `[rows, outputs]` |
//! | u, v | [`SingularVectors`] | `[outputs, 1]`, `[rows, 1]` |
//! | sigma(W) | `v^T W u` | scalar |
//!
//! The paper's matrix is the transposed one, so its `u` belongs to the outputs here too. One step of power
//! iteration is `v = W u / |W u|`, `u = W^T v / |W^T v|`. No gradient passes through either (as in PyTorch, and by
//! appendix A of the paper exact where they have converged).

use plan::Expression;

/// Smallest length by which a vector is divided, so that a zero vector stays finite (PyTorch's default).
const EPSILON: f64 = 1e-12;

/// Estimates of the singular vectors of the largest singular value.
#[derive(Debug, Clone, Copy)]
pub struct SingularVectors<'e> {
    /// `u`, one number per output.
    pub of_outputs: Expression<'e>,
    /// `v`, one number per row of the weight.
    pub of_rows: Expression<'e>,
}

impl<'e> SingularVectors<'e> {
    /// The vectors after one step of power iteration from `u`.
    #[must_use]
    pub fn iterated(self, weight: Expression<'e>) -> Self {
        let of_rows = unit(weight.product(self.of_outputs, [false; 2]));
        let of_outputs = unit(weight.product(of_rows, [true, false]));
        Self {
            of_outputs: of_outputs.stop_gradient(),
            of_rows: of_rows.stop_gradient(),
        }
    }

    /// The weight divided by `v^T W u`.
    #[must_use]
    pub fn divided(self, weight: Expression<'e>) -> Expression<'e> {
        let sigma = (weight.product(self.of_outputs, [false; 2]) * self.of_rows).sum();
        weight / sigma
    }
}

fn unit(vector: Expression<'_>) -> Expression<'_> {
    let least = vector.equations().constant([1, 1], &[EPSILON]);
    vector / vector.square().sum().sqrt().max(least)
}
