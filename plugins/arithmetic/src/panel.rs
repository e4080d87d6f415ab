//! Panels of the second factor of a product: 32 columns, row by row.

use crate::products::Matrix;
use crate::squares;

/// Number of columns of a panel: a multiple of two vectors of every processor.
pub(crate) const PANEL: usize = 32;

/// Number of entries between the beginnings of cache lines of which a row takes two.
const ALIGNMENT: usize = 32;

/// Largest number of rows that are read as quickly where they lie as from a copy.
const FEW: usize = 256;

/// Memory of a panel.
#[derive(Debug, Clone, Default)]
pub(crate) struct Panel(Vec<f32>);

/// Rows of a panel, each [`PANEL`] entries long.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a> {
    values: &'a [f32],
    /// Number of entries from one row to the next one.
    stride: usize,
}

impl<'a> Rows<'a> {
    /// Rows from one on.
    #[inline(always)]
    pub(crate) fn from(self, row: usize) -> Self {
        let values = self.values.get(row * self.stride..).unwrap_or_default();
        Self { values, ..self }
    }

    #[inline(always)]
    pub(crate) fn row(&self, at: usize) -> &'a [f32] {
        &self.values[at * self.stride..][..PANEL]
    }
}

impl Panel {
    /// Rows of the panel that begins at a column of a factor. They are copied, unless whole rows lie in the factor and
    /// are few or read only once.
    pub(crate) fn rows<'a>(&'a mut self, factor: Matrix<'a>, first: usize, is_read_once: bool) -> Rows<'a> {
        let is_whole = !factor.is_transposed && factor.columns - first >= PANEL;
        if is_whole && (is_read_once || factor.rows <= FEW) {
            return Rows {
                values: factor.values.get(first..).unwrap_or_default(),
                stride: factor.columns,
            };
        }
        // Rows that lie on cache lines of their own are read faster.
        let most = self.0.len().max(factor.rows * PANEL + ALIGNMENT);
        self.0.resize(most, 0.0);
        let skipped = self.0.as_ptr().align_offset(size_of::<f32>() * ALIGNMENT);
        let panel = &mut self.0[skipped.min(ALIGNMENT)..][..factor.rows * PANEL];
        copy(panel, factor, first);
        Rows {
            values: panel,
            stride: PANEL,
        }
    }
}

/// Copies the columns of a factor from one on to a panel; missing columns are 0.
#[inline(never)]
fn copy(panel: &mut [f32], factor: Matrix, first: usize) {
    let width = PANEL.min(factor.columns - first);
    let (rows, _) = panel.as_chunks_mut::<PANEL>();
    if width < PANEL {
        rows.iter_mut().for_each(|row| row[width..].fill(0.0));
    }
    if !factor.is_transposed {
        let values = factor.values.chunks_exact(factor.columns);
        for (row, values) in rows.iter_mut().zip(values) {
            // A copy of a fixed length needs no call.
            match values[first..].first_chunk() {
                Some(all) => *row = *all,
                None => row[..width].copy_from_slice(&values[first..]),
            }
        }
    } else if factor.rows > 0 {
        turn(rows, &factor.values[first * factor.rows..][..width * factor.rows]);
    }
}

/// Copies columns, one after the other, to the rows of a panel.
fn turn(rows: &mut [[f32; PANEL]], columns: &[f32]) {
    let n = rows.len();
    let n_turned = squares::turn(rows, columns);
    for (place, column) in columns.chunks_exact(n).enumerate() {
        let first = if place < n_turned[1] { n_turned[0] } else { 0 };
        for (row, value) in rows.iter_mut().zip(column).skip(first) {
            row[place] = *value;
        }
    }
}
