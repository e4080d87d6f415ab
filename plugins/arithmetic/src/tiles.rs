//! The products of [`crate::products`], a tile at a time: the same chains and therefore the same bits, at the speed of
//! the processor.
//!
//! The second factor is read in panels of two vectors and 256 rows, which stay in the first cache while rows of the
//! first factor pass. A tile is a few rows of the first factor times a panel; its sums stay in registers over a whole
//! part of the chain. Tiles and panels differ in size between processors, but the chain of an entry does not.
//!
//! One core of an EPYC of family 26 with AVX-512, whose limit is 270 GFLOP/s, multiplies 256 x 256 x 256 in 0.132 ms (254
//! GFLOP/s), whether a factor is transposed or not. A bias and a rectifier take no further time, a gate 4 us. One of family 25
//! with AVX2, whose limit is 103 GFLOP/s, takes 0.37 to 0.39 ms (86 to 92 GFLOP/s) where no other program slows it down.

use crate::epilogue::{Epilogue, Place};
use crate::panel::{MOST_COLUMNS, Panel, Rows, Source};
use crate::products::{BLOCK, Matrix};
use crate::slices::{arch, widest};
use crate::squares;
use crate::zero_rows::OtherRows;
use pulp::{Simd, WithSimd};
use std::ops::Range;

/// Largest number of rows of the first factor that pass one panel before the next one is read. More would not stay in
/// the second cache.
const MOST_PASSING: usize = 384;
/// Number of values of `k` whose panel stays in the first cache.
const PART: usize = 256;
/// Number of terms of a chain between two counts of them, which take time as well.
const AT_ONCE: usize = 4;
const _: () = assert!(BLOCK.is_multiple_of(PART));

/// Whether each entry of a product with this number of terms and columns is written once, after its last term, so that
/// it can replace its gate.
#[must_use]
pub fn is_written_once(n_terms: usize, columns: usize) -> bool {
    n_terms <= BLOCK && columns > 1
}

/// Computes products; keeps its memory for the next one.
#[derive(Debug, Clone, Default)]
pub struct Multiplier {
    panel: Panel,
    /// Unfinished chains.
    chains: Vec<f32>,
    others: OtherRows,
}

impl Multiplier {
    /// Writes the product `a b`, `[a.rows, b.columns]`, row by row to `product`, each entry changed by the epilogue.
    ///
    /// # Panics
    /// If shapes or lengths do not fit.
    pub fn product(&mut self, a: Matrix, b: Matrix, product: &mut [f32], epilogue: Epilogue) {
        assert_eq!(
            a.columns, b.rows,
            "columns of the first and rows of the second factor"
        );
        assert_eq!(product.len(), a.rows * b.columns, "entries of the product");
        epilogue.check([a.rows, b.columns]);
        assert!(
            !epilogue.reads_product() || is_written_once(a.columns, b.columns),
            "gates in the memory of sums"
        );
        if b.columns == 1 {
            let n_done = if a.is_transposed {
                self.column(a, b.values, product);
                a.rows
            } else {
                squares::multiply_column(a, b.values, product)
            };
            if n_done < a.rows {
                let rest = &a.values[n_done * a.columns..];
                let rest = Matrix::new(rest, a.rows - n_done, a.columns);
                self.multiply_tiles(rest, b, &mut product[n_done..], Epilogue::None);
            }
            for (at, entry) in product.iter_mut().enumerate() {
                let sum = [*entry];
                epilogue.write_row(&sum, std::slice::from_mut(entry), at..at + 1, 0..1);
            }
        } else {
            self.multiply_rows(a, b, product, epilogue);
        }
    }

    /// Rows of zeros in the first factor are left out.
    fn multiply_rows(&mut self, a: Matrix, b: Matrix, product: &mut [f32], epilogue: Epilogue) {
        let mut others = std::mem::take(&mut self.others);
        if others.gather(a, b, epilogue) {
            let (rows, products) = others.factors(a.columns, b.columns);
            self.multiply_tiles(rows, b, products, Epilogue::None);
            others.scatter(b.columns, product, epilogue);
        } else {
            self.multiply_tiles(a, b, product, epilogue);
        }
        self.others = others;
    }

    fn multiply_tiles(&mut self, a: Matrix, b: Matrix, product: &mut [f32], epilogue: Epilogue) {
        arch().dispatch(Product {
            a,
            b,
            epilogue,
            product,
            panel: &mut self.panel,
            chains: &mut self.chains,
        });
    }

    /// A transposed factor times one column: the chains of all entries side by side, since the entries of the
    /// factor that meet one entry of the column are neighbours.
    fn column(&mut self, a: Matrix, column: &[f32], c: &mut [f32]) {
        c.fill(0.0);
        if a.rows == 0 {
            return;
        }
        let chains = &mut self.chains;
        widest(
            #[inline(always)]
            move || {
                let blocks = a.values.chunks(BLOCK * a.rows).zip(column.chunks(BLOCK));
                for (block, (columns, entries)) in blocks.enumerate() {
                    chains.clear();
                    chains.resize(a.rows, 0.0);
                    for (column, b) in columns.chunks_exact(a.rows).zip(entries) {
                        for (chain, a) in chains.iter_mut().zip(column) {
                            *chain = a.mul_add(*b, *chain);
                        }
                    }
                    if block == 0 {
                        c.copy_from_slice(chains);
                    } else {
                        c.iter_mut().zip(chains.iter()).for_each(|(c, chain)| *c += chain);
                    }
                }
            },
        );
    }
}

struct Product<'a> {
    a: Matrix<'a>,
    b: Matrix<'a>,
    epilogue: Epilogue<'a>,
    product: &'a mut [f32],
    panel: &'a mut Panel,
    chains: &'a mut Vec<f32>,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // A tile has as many sums as there are registers for them.
        match S::F32_LANES {
            16 => self.multiply::<S, 12, MOST_COLUMNS>(simd),
            8 => self.multiply::<S, 6, 16>(simd),
            4 => self.multiply::<S, 4, 8>(simd),
            _ => self.multiply::<S, 4, 2>(simd),
        }
    }
}

impl Product<'_> {
    /// The product in tiles of at most `ROWS` rows and two vectors, which are `COLUMNS` columns.
    #[inline(always)]
    fn multiply<S: Simd, const ROWS: usize, const COLUMNS: usize>(self, simd: S) {
        assert_eq!(COLUMNS, 2 * S::F32_LANES, "columns of a panel");
        let (a, b) = (self.a, self.b);
        let n_groups = a.rows.div_ceil(MOST_PASSING).max(1);
        let group = a.rows.div_ceil(n_groups).next_multiple_of(ROWS).max(1);
        if a.columns > PART {
            let most = self.chains.len().max(group * b.columns);
            self.chains.resize(most, 0.0);
        }
        let is_read_in_place = a.rows <= ROWS || b.rows <= most_in_place(S::F32_LANES);
        for top in (0..a.rows).step_by(group) {
            // A chain without terms has a part, too.
            for start in (0..a.columns.max(1)).step_by(PART) {
                let terms = start..a.columns.min(start + PART);
                for first in (0..b.columns).step_by(COLUMNS) {
                    let source = Source {
                        factor: b,
                        rows: terms.clone(),
                        first,
                    };
                    let in_place = source.in_place::<COLUMNS>().filter(|_| is_read_in_place);
                    let panel = in_place.unwrap_or_else(|| self.panel.copied::<COLUMNS>(&source));
                    let part = Part {
                        a,
                        terms: terms.clone(),
                        panel,
                        corner: Place {
                            row: top,
                            column: first,
                            left: b.columns - first,
                            columns: b.columns,
                        },
                        epilogue: self.epilogue,
                    };
                    let rows = top..a.rows.min(top + group);
                    part.pass::<S, ROWS, COLUMNS>(simd, rows, self.chains, self.product);
                }
            }
        }
    }
}

/// Largest number of rows of a factor that are read as quickly where they lie as from copies. A panel of shorter vectors
/// takes a part of the factor's cache lines, of which fewer fit into the first cache.
fn most_in_place(lanes: usize) -> usize {
    if lanes == 16 { 256 } else { 0 }
}

/// A part of the chains of a panel's columns.
struct Part<'a> {
    a: Matrix<'a>,
    /// Values of `k`.
    terms: Range<usize>,
    /// Rows that meet these values.
    panel: Rows<'a>,
    /// Place of the first entry among those of all rows that pass the panel.
    corner: Place,
    epilogue: Epilogue<'a>,
}

impl Part<'_> {
    /// All tiles of some rows of the first factor.
    #[inline(always)]
    fn pass<S: Simd, const ROWS: usize, const COLUMNS: usize>(
        &self,
        simd: S,
        rows: Range<usize>,
        chains: &mut [f32],
        product: &mut [f32],
    ) {
        let mut row = rows.start;
        while row + ROWS <= rows.end {
            self.tile::<S, ROWS, COLUMNS>(simd, row, chains, product);
            row += ROWS;
        }
        while row + 4 <= rows.end {
            self.tile::<S, 4, COLUMNS>(simd, row, chains, product);
            row += 4;
        }
        while row + 2 <= rows.end {
            self.tile::<S, 2, COLUMNS>(simd, row, chains, product);
            row += 2;
        }
        if row < rows.end {
            self.tile::<S, 1, COLUMNS>(simd, row, chains, product);
        }
    }

    /// One tile, in a function of its own: within a larger one the compiler keeps sums in memory.
    #[inline(never)]
    fn tile<S: Simd, const ROWS: usize, const COLUMNS: usize>(
        &self,
        simd: S,
        row: usize,
        chains: &mut [f32],
        product: &mut [f32],
    ) {
        let part = self;
        if self.corner.left > S::F32_LANES {
            simd.vectorize(Tile::<ROWS, 2, COLUMNS> {
                part,
                row,
                chains,
                product,
            });
        } else {
            simd.vectorize(Tile::<ROWS, 1, COLUMNS> {
                part,
                row,
                chains,
                product,
            });
        }
    }

    /// Continues the chains of a tile that begins at a row.
    #[inline(always)]
    fn add_terms<S: Simd, const ROWS: usize, const VECTORS: usize, const COLUMNS: usize>(
        &self,
        simd: S,
        sums: &mut [[S::f32s; VECTORS]; ROWS],
        row: usize,
    ) {
        let (a, panel) = (&self.a, self.panel);
        let (start, n_terms) = (self.terms.start, self.terms.len());
        if a.is_transposed {
            let columns = &a.values[start * a.rows..self.terms.end * a.rows];
            for (column, b) in columns.chunks_exact(a.rows).zip(panel.iter()) {
                let entries = &column[row..row + ROWS];
                multiply_add::<S, ROWS, VECTORS>(simd, sums, |at| entries[at], b);
            }
            return;
        }
        let entries = |at| &a.values[(row + at) * a.columns + start..][..n_terms];
        let rows: [&[f32]; ROWS] = std::array::from_fn(entries);
        let mut n_done = 0;
        if let Some(panel) = panel.contiguous::<COLUMNS>() {
            let (panel, _) = panel.as_chunks::<AT_ONCE>();
            let rows = rows.map(|row| row.as_chunks::<AT_ONCE>().0);
            for (few, b) in panel.iter().enumerate() {
                for (k, b) in b.iter().enumerate() {
                    multiply_add::<S, ROWS, VECTORS>(simd, sums, |at| rows[at][few][k], b);
                }
            }
            n_done = panel.len() * AT_ONCE;
        }
        for (k, b) in (n_done..n_terms).zip(panel.iter().skip(n_done)) {
            multiply_add::<S, ROWS, VECTORS>(simd, sums, |at| rows[at][k], b);
        }
    }
}

/// Some rows of the first factor times the vectors of a panel.
struct Tile<'a, const ROWS: usize, const VECTORS: usize, const COLUMNS: usize> {
    part: &'a Part<'a>,
    row: usize,
    chains: &'a mut [f32],
    product: &'a mut [f32],
}

impl<const ROWS: usize, const VECTORS: usize, const COLUMNS: usize> WithSimd
    for Tile<'_, ROWS, VECTORS, COLUMNS>
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            part,
            row,
            chains,
            product,
        } = self;
        let (a, terms) = (&part.a, &part.terms);
        let place = Place { row, ..part.corner };
        let unfinished = Place {
            row: row - part.corner.row,
            ..part.corner
        };
        let mut sums = if terms.start.is_multiple_of(BLOCK) {
            [[simd.splat_f32s(0.0); VECTORS]; ROWS]
        } else {
            unfinished.read::<S, ROWS, VECTORS>(simd, chains)
        };
        part.add_terms::<S, ROWS, VECTORS, COLUMNS>(simd, &mut sums, row);
        let is_last = terms.end == a.columns;
        if is_last || terms.end.is_multiple_of(BLOCK) {
            if terms.start >= BLOCK {
                let before = place.read::<S, ROWS, VECTORS>(simd, product);
                for (sum, before) in sums.as_flattened_mut().iter_mut().zip(before.as_flattened()) {
                    *sum = simd.add_f32s(*before, *sum);
                }
            }
            let epilogue = if is_last { part.epilogue } else { Epilogue::None };
            epilogue.write(simd, sums, place, product);
        } else {
            Epilogue::None.write(simd, sums, unfinished, chains);
        }
    }
}

/// Adds a term to the sums of a tile: the entries of its rows times a row of the panel.
#[inline(always)]
fn multiply_add<S: Simd, const ROWS: usize, const VECTORS: usize>(
    simd: S,
    sums: &mut [[S::f32s; VECTORS]; ROWS],
    entry: impl Fn(usize) -> f32,
    row: &[f32],
) {
    let b = S::as_simd_f32s(&row[..VECTORS * S::F32_LANES]).0;
    // Adaptors of iterators are not always inlined, and then the sums are in memory.
    for (at, sums) in sums.iter_mut().enumerate() {
        let a = simd.splat_f32s(entry(at));
        for (sum, b) in sums.iter_mut().zip(b) {
            *sum = simd.mul_add_f32s(a, *b, *sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::products::product;
    use crate::tests::{factor, numbers};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_product_has_the_bits_of_its_definition(
            rows in prop_oneof![9 => 0..30_usize, 1 => Just(400)],
            common in prop_oneof![0..20_usize, 500..530_usize, Just(1024), Just(1030)],
            columns in prop_oneof![Just(1), 0..70_usize],
            transposed: [bool; 2],
            seed: u64,
        ) {
            let (a, b) = (numbers(rows * common, seed), numbers(common * columns, !seed));
            let a = factor(&a, rows, common, transposed[0]);
            let b = factor(&b, common, columns, transposed[1]);
            let bits = |values: &[f32]| values.iter().map(|it| it.to_bits()).collect::<Vec<_>>();
            let plain = product(a, b);
            let mut multiplier = Multiplier::default();
            let mut of = |epilogue| {
                let mut fast = vec![f32::NAN; rows * columns];
                multiplier.product(a, b, &mut fast, epilogue);
                bits(&fast)
            };
            prop_assert_eq!(of(Epilogue::None), bits(&plain));

            let (bias, gate) = (numbers(columns, seed ^ 1), numbers(rows * columns, seed ^ 2));
            let sums = plain.iter().enumerate().map(|(at, x)| x + bias[at % columns]);
            let rectified: Vec<f32> = sums.map(|y| if y <= 0.0 { 0.25 * y } else { y }).collect();
            prop_assert_eq!(of(Epilogue::Rectified { bias: &bias, below: 0.25 }), bits(&rectified));
            let slopes = gate.iter().map(|y| if *y > 0.0 { 1.0 } else { 0.25 });
            let gated: Vec<f32> = plain.iter().zip(slopes).map(|(x, slope)| x * slope).collect();
            prop_assert_eq!(of(Epilogue::Gated { of: Some(&gate), below: 0.25 }), bits(&gated));
            if is_written_once(common, columns) {
                let mut replaced = gate;
                multiplier.product(a, b, &mut replaced, Epilogue::Gated { of: None, below: 0.25 });
                prop_assert_eq!(bits(&replaced), bits(&gated));
            }
        }
    }
}
