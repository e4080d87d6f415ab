//! Products of matrices, sums over rows and sums of many numbers, with the order of every sum.
//!
//! **Chains.** An entry of a product over `k = 0, 1, ... K - 1` is cut into blocks of [`BLOCK`] values of `k`. Within a
//! block it is one chain of fused multiply-adds that begins at +0, `c <- fma(a_k, b_k, c)`, in the order of `k`. The
//! first block's chain is the entry; that of each further block is added to it, in their order. An entry depends only
//! on its row and its column, not on the size of a tile or on the number of rows or processors.
//!
//! **Sums over rows** (gradients of biases) are products with a row of ones: `fma(1, x, c)` is `c + x`.
//!
//! **Sums of many numbers** are taken in blocks of [`SUM_BLOCK`] = 32 x 32. Lane `l` of 32 adds the entries `l, l + 32,
//! l + 64, ...` of the block to +0, in this order. Then lane `l` adds the sum of lane `l + 16`, for `l` below 16, then
//! that of `l + 8` for `l` below 8, and so on with 4, 2 and 1, until lane 0 has the sum of the block. The sums of the
//! blocks are summed in the same way, until one is left. Missing entries of a block are +0, which changes no bit. The
//! sum of no numbers is +0.
//!
//! The loops are the definition, not a fast product: a processor with fused multiply-adds takes about 0.07 ns for each
//! multiply-add on one core, and one without them calls the C library (exact, about ten times slower).

use crate::slices::widest;

/// Number of values of `k` in one chain.
pub const BLOCK: usize = 512;

/// Number of summands in one block of a sum.
pub const SUM_BLOCK: usize = LANES * LANES;

const LANES: usize = 32;

/// A matrix in a slice, row by row or column by column.
#[derive(Debug, Clone, Copy)]
pub struct Matrix<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    pub(crate) is_transposed: bool,
}

impl<'a> Matrix<'a> {
    /// Matrix `[rows, columns]` from values row by row.
    ///
    /// # Panics
    /// If the number of values is not `rows * columns`.
    #[must_use]
    pub fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        assert_eq!(
            values.len(),
            rows * columns,
            "{} values for {rows} x {columns}",
            values.len()
        );
        Self {
            values,
            rows,
            columns,
            is_transposed: false,
        }
    }

    /// Transposed matrix without a copy.
    #[must_use]
    pub fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            is_transposed: !self.is_transposed,
            ..self
        }
    }

    #[inline(always)]
    fn at(&self, row: usize, column: usize) -> f32 {
        if self.is_transposed {
            self.values[column * self.rows + row]
        } else {
            self.values[row * self.columns + column]
        }
    }

    /// Values row by row.
    fn by_rows(self) -> Vec<f32> {
        let entries = |row| (0..self.columns).map(move |column| self.at(row, column));
        (0..self.rows).flat_map(entries).collect()
    }
}

/// Product `[a.rows, b.columns]`, row by row.
///
/// # Panics
/// If the number of `a`'s columns is not the number of `b`'s rows.
#[must_use]
pub fn product(a: Matrix, b: Matrix) -> Vec<f32> {
    assert_eq!(
        a.columns, b.rows,
        "columns of the first and rows of the second factor"
    );
    let n = b.columns;
    let (mut c, mut chains) = (vec![0.0; a.rows * n], vec![0.0; n]);
    if n == 0 {
        return c;
    }
    let (copy, plain);
    let b = if b.is_transposed {
        copy = b.by_rows();
        &copy
    } else {
        plain = b.values;
        plain
    };
    widest(
        #[inline(always)]
        || {
            for (row, c) in c.chunks_exact_mut(n).enumerate() {
                for (block, rows) in b.chunks(BLOCK * n).enumerate() {
                    chains.fill(0.0);
                    for (k, b) in rows.chunks_exact(n).enumerate() {
                        let a = a.at(row, block * BLOCK + k);
                        for (c, b) in chains.iter_mut().zip(b) {
                            *c = a.mul_add(*b, *c);
                        }
                    }
                    if block == 0 {
                        c.copy_from_slice(&chains);
                    } else {
                        c.iter_mut().zip(&chains).for_each(|(c, chain)| *c += chain);
                    }
                }
            }
        },
    );
    c
}

/// Sum of each column over the rows.
#[must_use]
pub fn row_sums(rows: Matrix) -> Vec<f32> {
    let ones = vec![1.0; rows.rows];
    product(Matrix::new(&ones, 1, rows.rows), rows)
}

/// Sum of numbers.
#[must_use]
pub fn sum(values: &[f32]) -> f32 {
    in_blocks(values, |value| value)
}

/// Sum of numbers in `f64`.
#[must_use]
pub fn sum_f64(values: &[f64]) -> f64 {
    in_blocks(values, |value| value)
}

/// Sum of squares in `f64`, in which each square is exact.
#[must_use]
pub fn sum_of_squares(values: &[f32]) -> f64 {
    in_blocks(values, |value| f64::from(value) * f64::from(value))
}

/// Sum in blocks without memory of its own.
#[inline(always)]
fn in_blocks<T: Copy, S: Copy + Default + std::ops::AddAssign>(values: &[T], term: impl Fn(T) -> S) -> S {
    // Number of summands below one block of the last round.
    let mut width = 1;
    while width * SUM_BLOCK < values.len() {
        width *= SUM_BLOCK;
    }
    tree_sum(values, &term, width)
}

/// Sum of at most `SUM_BLOCK` blocks of `width` values; each block is first summed in the same way.
fn tree_sum<T: Copy, S: Copy + Default + std::ops::AddAssign>(
    values: &[T],
    term: &impl Fn(T) -> S,
    width: usize,
) -> S {
    if width == 1 {
        return block_sum(values, term);
    }
    let mut lanes = [S::default(); LANES];
    for row in values.chunks(LANES * width) {
        let blocks = row.chunks(width);
        lanes
            .iter_mut()
            .zip(blocks)
            .for_each(|(lane, block)| *lane += tree_sum(block, term, width / SUM_BLOCK));
    }
    folded(lanes)
}

#[inline(always)]
fn block_sum<T: Copy, S: Copy + Default + std::ops::AddAssign>(block: &[T], term: &impl Fn(T) -> S) -> S {
    let mut lanes = [S::default(); LANES];
    for row in block.chunks(LANES) {
        lanes
            .iter_mut()
            .zip(row)
            .for_each(|(lane, value)| *lane += term(*value));
    }
    folded(lanes)
}

/// Sum of the lanes, by halves.
#[inline(always)]
fn folded<S: Copy + std::ops::AddAssign>(mut lanes: [S; LANES]) -> S {
    for width in [16, 8, 4, 2, 1] {
        let (near, far) = lanes.split_at_mut(width);
        near.iter_mut().zip(far).for_each(|(near, far)| *near += *far);
    }
    lanes[0]
}
