//! The functions of [`crate::single`] over slices, in place, with the widest vectors that the processor has.
//!
//! Each entry has the bits of the function of one number. The loops are compiled several times from one source without
//! fused multiply-adds, and a call uses the widest version that the processor can run.

use crate::single;
use std::sync::OnceLock;

/// Runs loops compiled for the processor's widest vectors. The functions that they call must be inlined.
///
/// Rust contracts no operations, so the bits are those of the same loops outside of this function.
#[inline(always)]
pub fn widest<R>(loops: impl FnOnce() -> R) -> R {
    arch().dispatch(loops)
}

/// The processor's widest vectors. Asking the processor takes 100 ns, so the answer is kept.
#[inline(always)]
pub(crate) fn arch() -> pulp::Arch {
    static ARCH: OnceLock<pulp::Arch> = OnceLock::new();
    *ARCH.get_or_init(pulp::Arch::new)
}

/// Replaces each entry `x` by `e^x`.
pub fn exp(values: &mut [f32]) {
    each(values, single::exp);
}

/// Replaces each entry by its natural logarithm.
pub fn ln(values: &mut [f32]) {
    each(values, single::ln);
}

/// Replaces each entry `x` by `ln(1 + x)`.
pub fn ln_1p(values: &mut [f32]) {
    each(values, single::ln_1p);
}

/// Replaces each entry by its hyperbolic tangent.
pub fn tanh(values: &mut [f32]) {
    each(values, single::tanh);
}

/// Replaces each entry by its logistic function.
pub fn sigmoid(values: &mut [f32]) {
    each(values, single::sigmoid);
}

/// Replaces each entry `x` by `ln(1 + e^x)`.
pub fn softplus(values: &mut [f32]) {
    each(values, single::softplus);
}

#[inline(always)]
fn each(values: &mut [f32], function: impl Fn(f32) -> f32) {
    widest(
        #[inline(always)]
        || {
            // The library's own functions are not always inlined.
            for value in values.iter_mut() {
                *value = function(*value);
            }
        },
    );
}
