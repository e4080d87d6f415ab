//! Squares of entries that are turned in registers, which the compiler does not find by itself. Each function says how much
//! it has done; with the vectors of an older processor it does nothing.

use crate::products::{BLOCK, Matrix};
use pulp::{f32x8, x86::V3};
use std::ops::Range;

/// Side of a square.
const SIDE: usize = 8;
/// Number of squares below each other whose chains run side by side.
const SQUARES: usize = 4;
const ROWS: usize = SIDE * SQUARES;

type Square = [[f32; SIDE]; SIDE];

fn vectors() -> Option<V3> {
    match crate::slices::arch() {
        pulp::Arch::V4(simd) => Some(*simd),
        pulp::Arch::V3(simd) => Some(simd),
        _ => None,
    }
}

/// Copies the entries of whole squares from columns to the rows of a panel; returns the number of rows and columns of these
/// squares.
pub(crate) fn turn<'a, const COLUMNS: usize>(
    panel: &mut [[f32; COLUMNS]],
    column: impl Fn(usize) -> &'a [f32],
    n_columns: usize,
) -> [usize; 2] {
    let Some(simd) = vectors() else {
        return [0; 2];
    };
    let (squares, _) = panel.as_chunks_mut::<SIDE>();
    let n_turned = [squares.len() * SIDE, n_columns / SIDE * SIDE];
    simd.vectorize(
        #[inline(always)]
        || {
            for place in 0..n_columns / SIDE {
                let columns: [&[[f32; SIDE]]; SIDE] =
                    std::array::from_fn(|at| column(place * SIDE + at).as_chunks().0);
                for (at, rows) in squares.iter_mut().enumerate() {
                    let square = turned(simd, columns.map(|column| column[at]));
                    for (row, entries) in rows.iter_mut().zip(square) {
                        row.as_chunks_mut().0[place] = entries;
                    }
                }
            }
        },
    );
    n_turned
}

/// Writes the first entries of a factor times one column; returns their number.
pub(crate) fn multiply_column(a: Matrix, column: &[f32], product: &mut [f32]) -> usize {
    let n = a.columns;
    let Some(simd) = vectors().filter(|_| n > 0) else {
        return 0;
    };
    simd.vectorize(
        #[inline(always)]
        || {
            let rows = a.values.chunks_exact(ROWS * n);
            for (rows, entries) in rows.zip(product.chunks_exact_mut(ROWS)) {
                for start in (0..n).step_by(BLOCK) {
                    let sums = chains(simd, rows, column, start..n.min(start + BLOCK));
                    for (entry, sum) in entries.iter_mut().zip(sums.as_flattened()) {
                        *entry = if start == 0 { *sum } else { *entry + *sum };
                    }
                }
            }
        },
    );
    a.rows / ROWS * ROWS
}

/// One block of the chains of rows, each as long as the column.
#[inline(always)]
fn chains(simd: V3, rows: &[f32], column: &[f32], terms: Range<usize>) -> [[f32; SIDE]; SQUARES] {
    let n = column.len();
    let rows: [&[f32]; ROWS] = std::array::from_fn(|at| &rows[at * n..][terms.clone()]);
    let column = &column[terms];
    let (eights, rest) = column.as_chunks::<SIDE>();
    let mut sums = [simd.splat_f32x8(0.0); SQUARES];
    for (at, b) in eights.iter().enumerate() {
        for (square, sum) in sums.iter_mut().enumerate() {
            let rows: Square = std::array::from_fn(|row| rows[square * SIDE + row].as_chunks().0[at]);
            for (a, b) in turned(simd, rows).into_iter().zip(b) {
                *sum = simd.mul_add_f32x8(pulp::cast(a), simd.splat_f32x8(*b), *sum);
            }
        }
    }
    for (b, k) in rest.iter().zip(column.len() - rest.len()..) {
        for (square, sum) in sums.iter_mut().enumerate() {
            let a: [f32; SIDE] = std::array::from_fn(|row| rows[square * SIDE + row][k]);
            *sum = simd.mul_add_f32x8(pulp::cast(a), simd.splat_f32x8(*b), *sum);
        }
    }
    sums.map(pulp::cast::<f32x8, _>)
}

/// A square with rows and columns exchanged: pairs of rows are mixed, then pairs of pairs, then halves.
#[inline(always)]
fn turned(simd: pulp::x86::V3, square: Square) -> Square {
    let avx = simd.avx;
    let rows: [std::arch::x86_64::__m256; SIDE] = square.map(pulp::bytemuck::cast);
    let pairs: [_; SIDE] = std::array::from_fn(|at| {
        let [a, b] = [rows[at / 2 * 2], rows[at / 2 * 2 + 1]];
        if at % 2 == 0 {
            avx._mm256_unpacklo_ps(a, b)
        } else {
            avx._mm256_unpackhi_ps(a, b)
        }
    });
    let fours: [_; SIDE] = std::array::from_fn(|at| {
        let first = at / 4 * 4 + at / 2 % 2;
        let [a, b] = [pairs[first], pairs[first + 2]];
        if at % 2 == 0 {
            avx._mm256_shuffle_ps::<0x44>(a, b)
        } else {
            avx._mm256_shuffle_ps::<0xee>(a, b)
        }
    });
    let halves: [_; SIDE] = std::array::from_fn(|at| {
        let [a, b] = [fours[at % 4], fours[at % 4 + 4]];
        if at < 4 {
            avx._mm256_permute2f128_ps::<0x20>(a, b)
        } else {
            avx._mm256_permute2f128_ps::<0x31>(a, b)
        }
    });
    halves.map(pulp::bytemuck::cast)
}
