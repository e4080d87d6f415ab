//! Sums, largest entries and moves of rows.

use crate::scalar::Scalar;
use arithmetic::products::BLOCK;
use arithmetic::slices::widest;

/// Sum of each column over the rows: chains over blocks of rows, added in their order.
pub(crate) fn sum_rows<T: Scalar>(entries: &[T], sums: &mut [T], chains: &mut Vec<T>) {
    let n = sums.len();
    sums.fill(T::default());
    let mut blocks = entries.chunks(BLOCK * n);
    add_rows(sums, blocks.next().unwrap_or_default());
    for block in blocks {
        chains.clear();
        chains.resize(n, T::default());
        add_rows(chains, block);
        add_rows(sums, chains);
    }
}

/// Adds each row in turn. The wide loops begin once for all rows, which are often short.
fn add_rows<T: Scalar>(sums: &mut [T], rows: &[T]) {
    widest(
        #[inline(always)]
        move || {
            for row in rows.chunks_exact(sums.len()) {
                for (sum, entry) in sums.iter_mut().zip(row) {
                    *sum += *entry;
                }
            }
        },
    );
}

/// Sum of one row: chains over blocks of columns, added in their order.
pub(crate) fn sum_row<T: Scalar>(row: &[T]) -> T {
    let chain = |block: &[T]| block.iter().fold(T::default(), |sum, x| sum + *x);
    let mut blocks = row.chunks(BLOCK);
    let first = chain(blocks.next().unwrap_or_default());
    blocks.fold(first, |sum, block| sum + chain(block))
}

/// One number for each row.
pub(crate) fn by_rows<T: Scalar>(
    result: &mut [T],
    x: &[T],
    width: usize,
    mut function: impl FnMut(&[T]) -> T,
) {
    for (result, row) in result.iter_mut().zip(x.chunks_exact(width)) {
        *result = function(row);
    }
}

/// Largest number of a row; a NaN if one is a NaN.
#[allow(clippy::eq_op, reason = "a NaN differs from itself")]
pub(crate) fn largest<T: Scalar>(row: &[T]) -> T {
    let larger = |a: T, b: T| if b > a || b != b { b } else { a };
    row.iter().copied().reduce(larger).unwrap_or_default()
}

/// Place of the largest number of a row, the first one of equals.
pub(crate) fn place_of_largest<T: Scalar>(row: &[T]) -> T {
    let better = |best, at| if row[at] > row[best] { at } else { best };
    T::of((0..row.len()).fold(0, better) as f64)
}

/// Number of a row with a rank in ascending order. `memory` is overwritten.
pub(crate) fn ranked<T: Scalar>(row: &[T], rank: usize, memory: &mut Vec<T>) -> T {
    memory.clear();
    memory.extend_from_slice(row);
    let by_size = |a: &T, b: &T| a.wide().total_cmp(&b.wide());
    *memory.select_nth_unstable_by(rank, by_size).1
}

/// Copies rows of `width` entries to rows of `columns` entries, from column `first` on.
pub(crate) fn place<T: Scalar>(result: &mut [T], columns: usize, first: usize, x: &[T], width: usize) {
    for (target, row) in result.chunks_exact_mut(columns).zip(x.chunks_exact(width)) {
        target[first..first + width].copy_from_slice(row);
    }
}

/// Column that a number names.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "checked below"
)]
pub(crate) fn column<T: Scalar>(index: T, columns: usize) -> usize {
    let (index, at) = (index.wide(), index.wide() as usize);
    assert!(
        index == at as f64 && at < columns,
        "index {index} of {columns} columns"
    );
    at
}
