//! Arithmetic with the same bits on every processor and card.
//!
//! A result depends only on the arguments, not on the width of vectors, the C library, the number of threads, or the
//! number of trials that are computed in parallel. Everything here consists of
//!
//! - sums, differences, products, quotients and square roots, each rounded to the nearest number according to IEEE
//!   754,
//! - fused multiply-adds, but only where this crate states them (the chains of [`products`]),
//! - comparisons, operations on bits and conversions between integers and numbers,
//!
//! in an order that is stated and that no compiler may change: Rust neither reorders nor contracts operations on
//! numbers, and the CUDA twin `cuda/arithmetic.cuh` is compiled with `--fmad=false` and without fast division, fast
//! roots or flushed denormals (the defaults of `nvcc`).
//!
//! | module | contents |
//! |---|---|
//! | [`single`] | exp, ln, ln_1p, tanh, sigmoid, softplus of `f32`, one by one |
//! | [`slices`] | the same over slices, with the widest vectors of the processor |
//! | [`double`] | exp, exp_m1, ln, ln_1p, tanh of `f64` |
//! | [`trigonometry`] | sin and cos of `f64` |
//! | [`power`] | real and whole powers of `f64` |
//! | [`normal`] | probabilities and quantiles of the normal distribution, of `f64` |
//! | [`gamma`] | ln Gamma, digamma and trigamma of `f64` |
//! | [`gamma_slope`] | derivative of a gamma draw in its shape, of `f64` |
//! | [`draws`] | uniform, normal and gamma numbers from a stream of 64-bit words |
//! | [`products`] | products of matrices and sums over rows as chains, sums in blocks |
//! | [`tiles`] | the same products at the speed of the processor |
//! | [`epilogue`] | changes of a product's entries while they are in registers |
//! | [`steps`] | a step of Adam, a largest norm, a moving average |
//! | [`cuda`] | the text of the functions that kernels for a card call |
//! | [`digests`] | digests of all of the above, for a comparison of processors and cards |
//! | [`errors`] | errors in units in the last place |
//!
//! A NaN result always has the bits `0x7fc00000` or `0x7ff8000000000000` in the functions of [`single`],
//! [`double`], [`trigonometry`], [`power`], [`normal`], [`gamma`] and [`draws`]. Elsewhere its bits are unspecified,
//! since processors differ in them.

pub mod cuda;
pub mod digests;
pub mod double;
pub mod draws;
pub mod epilogue;
pub mod errors;
pub mod gamma;
pub mod gamma_slope;
pub mod normal;
mod panel;
pub mod power;
pub mod products;
pub mod single;
pub mod slices;
#[cfg_attr(not(target_arch = "x86_64"), path = "squares_none.rs")]
mod squares;
pub mod steps;
pub mod tiles;
pub mod trigonometry;
mod zero_rows;

/// Version of the results, raised whenever a change in this crate changes a bit of one.
pub const VERSION: u32 = 0;

#[cfg(test)]
mod tests;
