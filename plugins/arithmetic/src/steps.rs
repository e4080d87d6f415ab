//! Steps of optimisers over slices of `f32`: Adam, clipping of gradients, a moving average of parameters.
//!
//! Adam (Kingma and Ba 2015, algorithm 1), entry by entry, each operation rounded to `f32`, products before sums and
//! without fused multiply-adds:
//!
//! | line | operations |
//! |---|---|
//! | `m <- b1 m + (1 - b1) g` | `m = b1 * m + (1 - b1) * g` |
//! | `v <- b2 v + (1 - b2) g^2` | `v = b2 * v + ((1 - b2) * g) * g` |
//! | moments below the smallest normal number are +0 | `if abs(m) < 2^-126 { m = 0 }`, and the same for `v` |
//! | `x <- x - rate m' / (sqrt(v') + epsilon)` | `x = x - (step * m) / (sqrt(v) * root + epsilon)` |
//!
//! `b1`, `b2` and `epsilon` are rounded to `f32` first, and `1 - b1` and `1 - b2` are differences of `f32`. `step =
//! rate / (1 - b1^t)` and `root = 1 / sqrt(1 - b2^t)` are computed in `f64` with [`pow`] and rounded to `f32`, once for
//! all entries.
//!
//! The squared norm of several gradients is the sum of [`sum_of_squares`] of each, in their order, from +0.

use crate::power::pow;
use crate::products::sum_of_squares;
use crate::slices::widest;

/// Summand epsilon of the denominator, as in the paper.
pub const EPSILON: f64 = 1e-8;

/// Constants of one step, which all entries share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    step: f32,
    root: f32,
    betas: [f32; 2],
}

#[allow(clippy::cast_possible_truncation, reason = "parameters are f32")]
impl Rates {
    /// Constants of step `t = 1, 2, ...`.
    #[must_use]
    pub fn at(t: u64, learning_rate: f64, betas: [f64; 2]) -> Self {
        let [bias_1, bias_2] = betas.map(|beta| 1.0 - pow(beta, t as f64));
        Self {
            step: (learning_rate / bias_1) as f32,
            root: (1.0 / bias_2.sqrt()) as f32,
            betas: betas.map(|beta| beta as f32),
        }
    }

    /// Step size, and the factor of the second moment's root.
    #[must_use]
    pub fn parts(&self) -> [f32; 2] {
        [self.step, self.root]
    }

    /// Steps parameters `x` once against `gradient`, with the moments `first` and `second`. All slices have
    /// the same length.
    pub fn descend(&self, x: &mut [f32], gradient: &[f32], first: &mut [f32], second: &mut [f32]) {
        let Self {
            step,
            root,
            betas: [b1, b2],
        } = *self;
        let epsilon = EPSILON as f32;
        let (c1, c2) = (1.0 - b1, 1.0 - b2);
        widest(
            #[inline(always)]
            move || {
                for (((x, g), m), v) in x.iter_mut().zip(gradient).zip(first).zip(second) {
                    *m = normal_or_zero(b1 * *m + c1 * g);
                    *v = normal_or_zero(b2 * *v + c2 * g * g);
                    *x -= step * *m / (v.sqrt() * root + epsilon);
                }
            },
        );
    }
}

/// Scales gradients down to a Euclidean norm of at most `largest`; returns their norm. Each entry is
/// multiplied by `largest / norm`, rounded to `f32`.
#[allow(clippy::cast_possible_truncation, reason = "gradients are f32")]
pub fn clip(gradients: &mut [&mut [f32]], largest: f64) -> f64 {
    let squares = gradients
        .iter()
        .fold(0.0, |sum, gradient| sum + sum_of_squares(gradient));
    let norm = squares.sqrt();
    if norm > largest {
        let scale = (largest / norm) as f32;
        for gradient in gradients {
            gradient.iter_mut().for_each(|g| *g *= scale);
        }
    }
    norm
}

/// Moves the average `target <- target + tau (source - target)`, entry by entry.
pub fn follow(target: &mut [f32], source: &[f32], tau: f32) {
    widest(
        #[inline(always)]
        move || {
            for (t, s) in target.iter_mut().zip(source) {
                *t += tau * (s - *t);
            }
        },
    );
}

/// Zero for a number below the smallest normal one. The moments of a unit that becomes inactive would fade to denormals
/// and stay there, and a processor takes about thirty times as long for each.
#[inline(always)]
fn normal_or_zero(moment: f32) -> f32 {
    if moment.abs() < f32::MIN_POSITIVE {
        0.0
    } else {
        moment
    }
}
