//! Products of matrices of `f64` with the same bits on every processor.
//!
//! The operator of nalgebra computes products of more than five rows and columns with kernels that depend on the
//! processor and may contract a product and a sum into one rounding.

use nalgebra::DMatrix;

/// Product of two matrices; every entry is a sum over the inner index, from the first on.
///
/// # Panics
/// If the number of columns of `left` differs from the number of rows of `right`.
#[must_use]
pub fn product(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    assert_eq!(left.ncols(), right.nrows(), "columns and rows of a product");
    DMatrix::from_fn(left.nrows(), right.ncols(), |row, column| {
        let terms = (0..left.ncols()).map(|inner| left[(row, inner)] * right[(inner, column)]);
        terms.sum()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_product_by_hand() {
        let left = DMatrix::from_row_slice(2, 3, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let right = DMatrix::from_row_slice(3, 2, &[7.0, 8.0, 9.0, 10.0, 11.0, 12.0]);
        let want = DMatrix::from_row_slice(2, 2, &[58.0, 64.0, 139.0, 154.0]);
        assert_eq!(product(&left, &right), want);
    }

    /// The square of `1 + e` is rounded before the sum, so a sum with `-1 - 2 e` is zero; a fused multiply-add would
    /// leave `e^2`.
    #[test]
    fn products_are_rounded_before_they_are_added() {
        let (n, e) = (8, 2.0_f64.powi(-30));
        let mut left = DMatrix::zeros(n, n);
        let mut right = DMatrix::zeros(n, n);
        (left[(0, 0)], left[(0, 1)]) = (-1.0 - 2.0 * e, 1.0 + e);
        (right[(0, 0)], right[(1, 0)]) = (1.0, 1.0 + e);
        assert_eq!(product(&left, &right)[(0, 0)], 0.0);
    }
}
