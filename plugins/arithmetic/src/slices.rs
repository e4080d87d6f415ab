//! The functions of [`crate::single`] over slices, in place, with the widest vectors that the processor has.
//!
//! Each entry becomes the bits that the function for one number gives: the loops are compiled several times from one
//! source without fused multiply-adds, and the widest version that the processor runs is chosen when called.

use crate::single;

/// Runs loops compiled for the widest vectors that the processor has. Functions that it calls are to be inlined.
#[inline(always)]
pub(crate) fn widest<R>(loops: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(loops)
}

/// `e^x` of each entry.
pub fn exp(values: &mut [f32]) {
    each(values, single::exp);
}

/// The natural logarithm of each entry.
pub fn ln(values: &mut [f32]) {
    each(values, single::ln);
}

/// `ln(1 + x)` of each entry.
pub fn ln_1p(values: &mut [f32]) {
    each(values, single::ln_1p);
}

/// The hyperbolic tangent of each entry.
pub fn tanh(values: &mut [f32]) {
    each(values, single::tanh);
}

/// The logistic function of each entry.
pub fn sigmoid(values: &mut [f32]) {
    each(values, single::sigmoid);
}

/// `ln(1 + e^x)` of each entry.
pub fn softplus(values: &mut [f32]) {
    each(values, single::softplus);
}

#[inline(always)]
fn each(values: &mut [f32], function: impl Fn(f32) -> f32) {
    widest(
        #[inline(always)]
        || {
            // A loop, since the library's own functions are not always inlined.
            for value in values.iter_mut() {
                *value = function(*value);
            }
        },
    );
}
