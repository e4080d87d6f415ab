//! Panels of the second factor of a product: columns of two vectors, row by row.

use crate::products::Matrix;
use crate::squares;
use std::ops::Range;

/// Number of columns of a panel of the longest vectors.
pub(crate) const MOST_COLUMNS: usize = 32;

/// Number of entries between the beginnings of cache lines of which a row of the longest vectors takes two.
const ALIGNMENT: usize = 32;

/// Memory of a panel.
#[derive(Debug, Clone, Default)]
pub(crate) struct Panel(Vec<f32>);

/// Some rows of a factor from a column on, which become a panel.
pub(crate) struct Source<'a> {
    pub(crate) factor: Matrix<'a>,
    pub(crate) rows: Range<usize>,
    /// First column.
    pub(crate) first: usize,
}

/// Rows of a panel, or of some columns of a matrix.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a> {
    values: &'a [f32],
    /// Number of entries from one row to the next one.
    stride: usize,
    /// First column.
    first: usize,
}

impl<'a> Rows<'a> {
    /// Rows of a matrix, from a column on.
    #[inline(always)]
    pub(crate) fn new(values: &'a [f32], columns: usize, first: usize) -> Self {
        Self {
            values,
            stride: columns,
            first,
        }
    }

    /// The rows from the first column to the end of the matrix.
    #[inline(always)]
    pub(crate) fn iter(self) -> impl Iterator<Item = &'a [f32]> {
        let Self {
            values,
            stride,
            first,
        } = self;
        values.chunks_exact(stride).map(
            #[inline(always)]
            move |row| &row[first..],
        )
    }

    /// The rows, if each has `COLUMNS` entries and nothing lies between them.
    #[inline(always)]
    pub(crate) fn contiguous<const COLUMNS: usize>(self) -> Option<&'a [[f32; COLUMNS]]> {
        (self.stride == COLUMNS).then_some(self.values.as_chunks().0)
    }
}

impl Panel {
    /// Copies rows to the panel.
    pub(crate) fn copied<const COLUMNS: usize>(&mut self, source: &Source) -> Rows<'_> {
        // Rows that lie on cache lines of their own are read faster.
        let n = source.rows.len() * COLUMNS;
        let most = self.0.len().max(n + ALIGNMENT);
        self.0.resize(most, 0.0);
        let skipped = self.0.as_ptr().align_offset(size_of::<f32>() * ALIGNMENT);
        let values = &mut self.0[skipped.min(ALIGNMENT)..][..n];
        source.copy(values.as_chunks_mut::<COLUMNS>().0);
        Rows::new(values, COLUMNS, 0)
    }
}

impl<'a> Source<'a> {
    /// The rows where they lie, if whole rows lie there.
    pub(crate) fn in_place<const COLUMNS: usize>(&self) -> Option<Rows<'a>> {
        let Self { factor, rows, first } = self;
        let is_whole = !factor.is_transposed && factor.columns - first >= COLUMNS;
        let values = &factor.values[rows.start * factor.columns..rows.end * factor.columns];
        is_whole.then(|| Rows::new(values, factor.columns, *first))
    }

    /// Copies the rows to a panel; missing columns are 0.
    #[inline(never)]
    fn copy<const COLUMNS: usize>(&self, panel: &mut [[f32; COLUMNS]]) {
        let Self { factor, rows, first } = self;
        let width = COLUMNS.min(factor.columns - first);
        if width < COLUMNS {
            panel.iter_mut().for_each(|row| row[width..].fill(0.0));
        }
        if factor.is_transposed {
            let column = |at| &factor.values[(first + at) * factor.rows..][rows.clone()];
            return turn(panel, column, width);
        }
        let values = factor.values.chunks_exact(factor.columns).skip(rows.start);
        for (row, values) in panel.iter_mut().zip(values) {
            // A copy of a fixed length needs no call.
            match values[*first..].first_chunk() {
                Some(all) => *row = *all,
                None => row[..width].copy_from_slice(&values[*first..]),
            }
        }
    }
}

/// Copies columns to the rows of a panel.
fn turn<'a, const COLUMNS: usize>(
    panel: &mut [[f32; COLUMNS]],
    column: impl Fn(usize) -> &'a [f32],
    n_columns: usize,
) {
    let n_turned = squares::turn(panel, &column, n_columns);
    for place in 0..n_columns {
        let first = if place < n_turned[1] { n_turned[0] } else { 0 };
        for (row, value) in panel.iter_mut().zip(column(place)).skip(first) {
            row[place] = *value;
        }
    }
}
