//! Operations on images for convolutional networks, each one node of the autodiff graph.
//!
//! Images are `[batch, height, width, channels]`, channels last, `f32`. So every pixel is one short row of
//! neighbouring numbers, and all loops run over rows: a convolution adds rows of weights, a normalisation adds
//! rows of pixels, a resize copies or mixes them.
//!
//! | operation | module |
//! |---|---|
//! | convolution 3x3 and 1x1 with bias | [`convolution`] |
//! | deconvolution 2x2 with stride 2 | [`deconvolution`] |
//! | batch and instance normalisation, with an optional rectifier | [`normalisation`] |
//! | enlarging, resizing, average pooling, sums over pixels | [`resize`] |
//! | rectifier and hyperbolic tangent | [`pointwise`] |
//! | division by the largest singular value | [`spectral`] |
//!
//! Every sum has one order, which depends on the sizes alone and never on the width of a vector register:
//! results have the same bits with AVX2 and AVX-512. Except for batch normalisation, a row of the batch
//! depends on its own row of the input.

pub mod convolution;
pub mod deconvolution;
mod direct_convolution;
pub mod normalisation;
mod operation;
pub mod pointwise;
pub mod resize;
pub mod spectral;

#[cfg(test)]
mod oracle_tests;

/// Runs loops with the processor's widest vectors. The functions that they call have to be inlined.
#[inline(always)]
fn widest<R>(loops: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(loops)
}

/// Sum of each column over the rows.
fn column_sums(rows: &[f32], n_columns: usize) -> Vec<f32> {
    widest(
        #[inline(always)]
        || {
            let mut sums = vec![0.0; n_columns];
            for row in rows.chunks_exact(n_columns) {
                sums.iter_mut().zip(row).for_each(|(sum, entry)| *sum += entry);
            }
            sums
        },
    )
}
