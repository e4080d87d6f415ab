//! Changes of the entries of a product while they are in registers.

use crate::panel::MOST_COLUMNS;
use pulp::Simd;
use std::ops::{Add, Mul, Range};

/// Change of each entry of a product after its last block. Entries of slices meet those of the product or of its
/// columns.
#[derive(Debug, Clone, Copy)]
pub enum Epilogue<'a, T = f32> {
    /// The entry is left as it is.
    None,
    /// The bias of the entry's column is added, and a sum that is not above 0 is multiplied.
    Rectified {
        /// One number a column.
        bias: &'a [T],
        /// Factor of sums at 0 and below; 1 leaves them as they are.
        below: T,
    },
    /// The entry is multiplied by the slope of a rectifier: 1 where its result is above 0.
    Gated {
        /// Results of the rectifier, one an entry; `None` if the product replaces them.
        of: Option<&'a [T]>,
        /// Slope elsewhere.
        below: T,
    },
}

impl<T: Copy + PartialOrd + Default + Add<Output = T> + Mul<Output = T>> Epilogue<'_, T> {
    /// Writes entries of one row of a product, with their places in the product and their columns.
    #[inline(always)]
    pub fn write_row(&self, sums: &[T], row: &mut [T], entries: Range<usize>, columns: Range<usize>) {
        match self {
            Self::None => row.copy_from_slice(sums),
            Self::Rectified { bias, below } => {
                for ((entry, x), bias) in row.iter_mut().zip(sums).zip(&bias[columns]) {
                    let y = *x + *bias;
                    *entry = if y <= T::default() { *below * y } else { y };
                }
            }
            Self::Gated { of, below } => {
                let gated = |x: T, y: T| if y > T::default() { x } else { x * *below };
                match of {
                    Some(of) => {
                        for ((entry, x), y) in row.iter_mut().zip(sums).zip(&of[entries]) {
                            *entry = gated(*x, *y);
                        }
                    }
                    None => {
                        for (entry, x) in row.iter_mut().zip(sums) {
                            *entry = gated(*x, *entry);
                        }
                    }
                }
            }
        }
    }

    /// Whether the entries of the product are read.
    #[must_use]
    pub fn reads_product(&self) -> bool {
        matches!(self, Self::Gated { of: None, .. })
    }

    /// # Panics
    /// If a slice does not fit a product of a shape.
    pub fn check(&self, [rows, columns]: [usize; 2]) {
        match self {
            Self::None => {}
            Self::Rectified { bias, .. } => assert_eq!(bias.len(), columns, "one bias a column"),
            Self::Gated { of: Some(of), .. } => {
                assert_eq!(of.len(), rows * columns, "one gate an entry");
            }
            Self::Gated { of: None, .. } => {}
        }
    }
}

/// Place of a tile in a product.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub(crate) row: usize,
    pub(crate) column: usize,
    /// Number of columns from the tile's first one on that exist.
    pub(crate) left: usize,
    /// Number of columns of the product.
    pub(crate) columns: usize,
}

impl Place {
    /// Entries of the product; those that do not exist are 0.
    #[inline(always)]
    pub(crate) fn read<S: Simd, const ROWS: usize, const VECTORS: usize>(
        &self,
        simd: S,
        product: &[f32],
    ) -> [[S::f32s; VECTORS]; ROWS] {
        let n = VECTORS * S::F32_LANES;
        let mut tile = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
        for (at, vectors) in tile.iter_mut().enumerate() {
            let row = &product[(self.row + at) * self.columns + self.column..];
            // A copy of a fixed length needs no call.
            if self.left >= n {
                vectors.copy_from_slice(S::as_simd_f32s(&row[..n]).0);
            } else {
                let mut entries = [0.0; MOST_COLUMNS];
                entries[..self.left].copy_from_slice(&row[..self.left]);
                vectors.copy_from_slice(&S::as_simd_f32s(&entries).0[..VECTORS]);
            }
        }
        tile
    }
}

impl Epilogue<'_> {
    /// Changes the sums of a tile and writes them to the product.
    ///
    /// Each change has a loop of its own that stores the sums as well, so that they stay in registers.
    #[inline(always)]
    pub(crate) fn write<S: Simd, const ROWS: usize, const VECTORS: usize>(
        &self,
        simd: S,
        sums: [[S::f32s; VECTORS]; ROWS],
        place: Place,
        product: &mut [f32],
    ) {
        let n = VECTORS * S::F32_LANES;
        if place.left < n {
            return self.write_part::<S, ROWS, VECTORS>(&sums, place, product);
        }
        let row = |row| (place.row + row) * place.columns + place.column;
        match *self {
            Self::None => {
                for (at, sums) in sums.iter().enumerate() {
                    let (entries, _) = S::as_mut_simd_f32s(&mut product[row(at)..][..n]);
                    entries.copy_from_slice(sums);
                }
            }
            Self::Rectified { bias, below } => {
                let [zero, below] = [0.0, below].map(|x| simd.splat_f32s(x));
                let (bias, _) = S::as_simd_f32s(&bias[place.column..][..n]);
                for (at, sums) in sums.iter().enumerate() {
                    let (entries, _) = S::as_mut_simd_f32s(&mut product[row(at)..][..n]);
                    for ((entry, sum), bias) in entries.iter_mut().zip(sums).zip(bias) {
                        let y = simd.add_f32s(*sum, *bias);
                        let is_low = simd.less_than_or_equal_f32s(y, zero);
                        *entry = simd.select_f32s(is_low, simd.mul_f32s(below, y), y);
                    }
                }
            }
            Self::Gated { of, below } => {
                let [zero, below] = [0.0, below].map(|x| simd.splat_f32s(x));
                for (at, sums) in sums.iter().enumerate() {
                    let (entries, _) = S::as_mut_simd_f32s(&mut product[row(at)..][..n]);
                    let gates = of.map(|of| S::as_simd_f32s(&of[row(at)..][..n]).0);
                    for (column, (entry, sum)) in entries.iter_mut().zip(sums).enumerate() {
                        let y = gates.map_or(*entry, |gates| gates[column]);
                        let is_above = simd.greater_than_f32s(y, zero);
                        *entry = simd.select_f32s(is_above, *sum, simd.mul_f32s(*sum, below));
                    }
                }
            }
        }
    }

    /// A tile that reaches beyond the product.
    #[inline(always)]
    fn write_part<S: Simd, const ROWS: usize, const VECTORS: usize>(
        &self,
        sums: &[[S::f32s; VECTORS]; ROWS],
        place: Place,
        product: &mut [f32],
    ) {
        for (row, sums) in sums.iter().enumerate() {
            let mut entries = [0.0; MOST_COLUMNS];
            S::as_mut_simd_f32s(&mut entries).0[..VECTORS].copy_from_slice(sums);
            let first = (place.row + row) * place.columns + place.column;
            let places = first..first + place.left;
            let row = &mut product[places.clone()];
            let columns = place.column..place.column + place.left;
            self.write_row(&entries[..place.left], row, places, columns);
        }
    }
}
