//! Products whose first factor has many rows of zeros, which need no multiplication. The gradient through the smaller
//! value of two critics is such a factor: each sample moves one of the two.

use crate::epilogue::Epilogue;
use crate::products::Matrix;
use crate::slices::widest;

/// Smallest number of entries of a second factor whose products with a row take much longer than the look at that row.
const FEWEST_ENTRIES: usize = 1024;
/// Number of rows of which at least one must be zeros, so that copies of the others pay off.
const ROWS_FOR_ONE: usize = 8;

/// The rows of a first factor that are not zeros, and their products.
#[derive(Debug, Clone, Default)]
pub(crate) struct OtherRows {
    places: Vec<usize>,
    entries: Vec<f32>,
    products: Vec<f32>,
}

impl OtherRows {
    /// Copies the rows that are not zeros, if each other row becomes one of +0 and there are enough of those.
    pub(crate) fn gather(&mut self, a: Matrix, b: Matrix, epilogue: Epilogue) -> bool {
        if a.is_transposed || b.values.len() < FEWEST_ENTRIES || !keeps_zero(epilogue) {
            return false;
        }
        let rows = || a.values.chunks_exact(a.columns);
        self.places.clear();
        widest(
            #[inline(always)]
            || {
                let others = rows().enumerate().filter(|(_, row)| !is_zero(row));
                self.places.extend(others.map(|(place, _)| place));
            },
        );
        let n_zero = a.rows - self.places.len();
        if n_zero * ROWS_FOR_ONE < a.rows.max(1) || !is_finite(b.values) {
            return false;
        }
        self.entries.clear();
        let others = self
            .places
            .iter()
            .map(|place| &a.values[place * a.columns..][..a.columns]);
        others.for_each(|row| self.entries.extend_from_slice(row));
        let most = self.products.len().max(self.places.len() * b.columns);
        self.products.resize(most, 0.0);
        true
    }

    /// The rows as a factor, and memory for their products.
    pub(crate) fn factors(&mut self, columns: usize, n_products: usize) -> (Matrix<'_>, &mut [f32]) {
        let rows = Matrix::new(&self.entries, self.places.len(), columns);
        let products = &mut self.products[..self.places.len() * n_products];
        (rows, products)
    }

    /// Writes the products to their places, changed by the epilogue, and 0 elsewhere.
    pub(crate) fn scatter(&self, columns: usize, product: &mut [f32], epilogue: Epilogue) {
        let mut products = self.products.chunks_exact(columns);
        let mut places = self.places.iter().copied().peekable();
        widest(
            #[inline(always)]
            || {
                for (place, row) in product.chunks_exact_mut(columns).enumerate() {
                    let first = place * columns;
                    match places.next_if_eq(&place).and_then(|_| products.next()) {
                        Some(sums) => epilogue.write_row(sums, row, first..first + columns, 0..columns),
                        None => row.fill(0.0),
                    }
                }
            },
        );
    }
}

/// Whether an epilogue leaves +0 as it is.
fn keeps_zero(epilogue: Epilogue) -> bool {
    match epilogue {
        Epilogue::None => true,
        Epilogue::Rectified { .. } => false,
        Epilogue::Gated { below, .. } => below.is_sign_positive() && below.is_finite(),
    }
}

/// Whether all entries are +0 or -0.
#[inline(always)]
fn is_zero(row: &[f32]) -> bool {
    let (eights, rest) = row.as_chunks::<8>();
    let are_zero = |few: &[f32]| few.iter().fold(true, |all, x| all & (*x == 0.0));
    eights.iter().all(|few| are_zero(few)) && are_zero(rest)
}

/// Whether the products of 0 with all numbers are 0.
fn is_finite(values: &[f32]) -> bool {
    widest(
        #[inline(always)]
        || {
            values
                .chunks(4096)
                .all(|some| some.iter().fold(true, |all, x| all & x.is_finite()))
        },
    )
}

#[cfg(test)]
mod tests {
    use crate::epilogue::Epilogue;
    use crate::products::product;
    use crate::tests::{factor, numbers};
    use crate::tiles::{Multiplier, is_written_once};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_of_zeros_change_no_bit(
            rows in prop::collection::vec(prop_oneof![Just(0.0_f32), Just(-0.0), 0.1_f32..1.0], 1..50),
            common in prop_oneof![1..40_usize, Just(600)],
            columns in 2..90_usize,
            is_transposed: bool,
            seed: u64,
            wrong in prop::option::of(any::<prop::sample::Index>()),
            below in prop_oneof![Just(0.0_f32), Just(-0.5)],
        ) {
            let n = rows.len();
            let mut a = numbers(n * common, seed);
            for (row, scale) in a.chunks_mut(common).zip(&rows) {
                row.iter_mut().for_each(|x| *x *= scale);
            }
            let mut b = numbers(common * columns, !seed);
            if let Some(wrong) = wrong {
                *wrong.get_mut(&mut b) = f32::INFINITY;
            }
            let gate = numbers(n * columns, seed ^ 1);
            let bias = &gate[..columns];
            let (a, b) = (factor(&a, n, common, false), factor(&b, common, columns, is_transposed));
            // The bits of a NaN are unspecified.
            let bits = |values: &[f32]| {
                values.iter().map(|it| if it.is_nan() { 1 } else { it.to_bits() }).collect::<Vec<_>>()
            };
            let plain = product(a, b);
            let mut multiplier = Multiplier::default();
            for epilogue in [
                Epilogue::None,
                Epilogue::Rectified { bias, below },
                Epilogue::Gated { of: Some(&gate), below },
                Epilogue::Gated { of: None, below },
            ] {
                if epilogue.reads_product() && !is_written_once(common, columns) {
                    continue;
                }
                let (mut fast, mut slow) = (gate.clone(), gate.clone());
                multiplier.product(a, b, &mut fast, epilogue);
                for (at, (row, sums)) in slow.chunks_mut(columns).zip(plain.chunks(columns)).enumerate() {
                    epilogue.write_row(sums, row, at * columns..(at + 1) * columns, 0..columns);
                }
                prop_assert_eq!(bits(&fast), bits(&slow));
            }
        }
    }
}
