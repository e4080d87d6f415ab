//! Digests of every bit of this crate's results, for a comparison of processors and cards.
//!
//! `examples/digests.rs` prints them on a processor and `cuda/check.cu` on a card; `fixtures/digests.txt` holds
//! them. They are equal over all inputs on a Xeon compiled for x86-64, v3 and v4 and on an NVIDIA H100, and over
//! the kept classes on aarch64 and on a processor without fused multiply-adds.
//! A line is `name total class_0 class_1 ... class_15`, in hexadecimal digits.
//!
//! A digest is the sum modulo 2^64 of [`mix`] over all inputs, so that their order does not matter. Inputs `i` fall
//! into 4096 classes, `i mod 4096`; the first 16 have digests of their own, which a quick test recomputes. Every
//! class is spread over the whole range.
//!
//! | family | inputs | argument | summand |
//! |---|---|---|---|
//! | `f32.*` | all `i < 2^32` | the number with the bits `i` | `mix(2^32 i + bits)` |
//! | `f64.*` | `i < 2^28` | see [`argument`]: every bit pattern for even `i`, a range for odd `i` | `mix(bits + i GOLDEN)` |
//! | `draw.normal` | `i < 2^24` | the word `mix(i)` | `mix(bits + i GOLDEN)` |
//! | `draw.log_gamma` | `i < 2^24` | [`shape`], words of [`Stream`] from `i` on | `mix(bits + i GOLDEN)` |
//!
//! `steps.*` are digests over the entries of a few products, sums and steps ([`steps`]); entry `i` adds
//! `mix(bits + i GOLDEN)`, and there are no classes.

use crate::draws::{GOLDEN, Stream, log_gamma, mix, normal, uniform};
use crate::products::{Matrix, product, row_sums, sum, sum_of_squares};
use crate::steps::{Rates, clip, follow};
use crate::{double, gamma, power, single, trigonometry};

/// Number of classes of inputs.
pub const CLASSES: u64 = 4096;

/// Number of classes with a digest of their own.
pub const KEPT: usize = 16;

/// Functions of one `f32` with their names.
pub const SINGLE: [(&str, fn(f32) -> f32); 6] = [
    ("exp", single::exp),
    ("ln", single::ln),
    ("ln_1p", single::ln_1p),
    ("tanh", single::tanh),
    ("sigmoid", single::sigmoid),
    ("softplus", single::softplus),
];

/// Name of a function of one or two `f64`, the function, and the range of its arguments for odd inputs.
pub type DoubleFunction = (&'static str, fn(f64, f64) -> f64, [f64; 2]);

/// Functions of `f64`. The second argument of [`power::pow`] is between -64 and 64 for odd inputs.
pub const DOUBLE: [DoubleFunction; 11] = [
    ("exp", |x, _| double::exp(x), [-750.0, 720.0]),
    ("exp_m1", |x, _| double::exp_m1(x), [-4.0, 4.0]),
    ("ln", |x, _| double::ln(x), [0.0, 4.0]),
    ("ln_1p", |x, _| double::ln_1p(x), [-1.0, 3.0]),
    ("tanh", |x, _| double::tanh(x), [-4.0, 4.0]),
    ("sin", |x, _| trigonometry::sin(x), [-2048.0, 2048.0]),
    ("cos", |x, _| trigonometry::cos(x), [-2048.0, 2048.0]),
    ("pow", power::pow, [0.0, 16.0]),
    ("ln_gamma", |x, _| gamma::ln_gamma(x), [0.0, 16.0]),
    ("digamma", |x, _| gamma::digamma(x), [0.0, 16.0]),
    ("trigamma", |x, _| gamma::trigamma(x), [0.0, 16.0]),
];

/// Argument of a function of `f64` for input `i` from the word `w = mix(i)`, or `mix(w)` for a second argument: the
/// number with the bits of `w` for even `i`, `low + (high - low) uniform(w)` for odd `i`.
#[must_use]
pub fn argument(i: u64, word: u64, [low, high]: [f64; 2]) -> f64 {
    if i.is_multiple_of(2) {
        f64::from_bits(word)
    } else {
        low + (high - low) * uniform(word)
    }
}

/// Shape of gamma draw `i`: `2^n (1 + uniform(mix(i)))` with `n = i mod 16 - 6`, between 1/64 and 1024.
#[must_use]
pub fn shape(i: u64) -> f64 {
    let power = f64::from_bits((i % 16 + 1017) << 52);
    power * (1.0 + uniform(mix(i)))
}

/// Digest of one class of the inputs below `2^bits`.
#[must_use]
pub fn class(bits: u32, class: u64, summand: impl Fn(u64) -> u64) -> u64 {
    let mut sum = 0_u64;
    for at in 0..(1 << bits) / CLASSES {
        sum = sum.wrapping_add(summand(at * CLASSES + class));
    }
    sum
}

/// Summand of input `i` of a function of `f32`.
#[inline(always)]
#[must_use]
pub fn single_summand(function: impl Fn(f32) -> f32, i: u32) -> u64 {
    mix(u64::from(i) << 32 | u64::from(function(f32::from_bits(i)).to_bits()))
}

/// Summand of input `i` of a function of `f64`.
#[must_use]
pub fn double_summand((_, function, range): &DoubleFunction, i: u64) -> u64 {
    let word = mix(i);
    let y = function(argument(i, word, *range), argument(i, mix(word), [-64.0, 64.0]));
    summand(i, y.to_bits())
}

/// Summand of normal draw `i`.
#[must_use]
pub fn normal_summand(i: u64) -> u64 {
    summand(i, normal(mix(i)).to_bits())
}

/// Summand of gamma draw `i`.
#[must_use]
pub fn log_gamma_summand(i: u64) -> u64 {
    summand(i, log_gamma(shape(i), &mut Stream::new(i)).to_bits())
}

fn summand(i: u64, bits: u64) -> u64 {
    mix(bits.wrapping_add(i.wrapping_mul(GOLDEN)))
}

/// Digest of entries in order.
fn of_entries(bits: impl Iterator<Item = u64>) -> u64 {
    bits.zip(0..)
        .fold(0, |sum, (bits, i)| sum.wrapping_add(summand(i, bits)))
}

fn of_singles(values: &[f32]) -> u64 {
    of_entries(values.iter().map(|value| u64::from(value.to_bits())))
}

/// `n` numbers `normal(mix(seed + i))`, rounded to `f32`, from the counter `seed` on.
fn numbers(seed: u64, n: usize) -> Vec<f32> {
    #[allow(clippy::cast_possible_truncation, reason = "the factors are f32")]
    (seed..).take(n).map(|i| normal(mix(i)) as f32).collect()
}

/// Digests of products, sums and steps.
///
/// Products of `[17, K]` and `[K, 33]` for `K = 24, 512, 513, 1300`, with the factors as they are, the second
/// one and the first one transposed in memory; sums of 100,000 numbers; 200 steps of Adam over 4096
/// parameters with a moving average. The gradients are scaled to a norm of 50; after 60 steps only every
/// third entry has one.
#[must_use]
pub fn steps() -> Vec<(&'static str, u64)> {
    let mut products = [0_u64; 4];
    for k in [24, 512, 513, 1300] {
        let (a, b) = (numbers(1 << 32, 17 * k), numbers(1 << 33, k * 33));
        let results = [
            product(Matrix::new(&a, 17, k), Matrix::new(&b, k, 33)),
            product(Matrix::new(&a, 17, k), Matrix::new(&b, 33, k).transposed()),
            product(Matrix::new(&a, k, 17).transposed(), Matrix::new(&b, k, 33)),
            row_sums(Matrix::new(&b, k, 33)),
        ];
        for (digest, result) in products.iter_mut().zip(results) {
            *digest = mix(*digest).wrapping_add(of_singles(&result));
        }
    }
    let many = numbers(1 << 34, 100_000);
    let [nn, nt, tn, rows] = products;
    let [adam, norms, average] = adam();
    vec![
        ("product_nn", nn),
        ("product_nt", nt),
        ("product_tn", tn),
        ("row_sums", rows),
        ("sum", u64::from(sum(&many).to_bits())),
        ("sum_of_squares", sum_of_squares(&many).to_bits()),
        ("adam", adam),
        ("norms", norms),
        ("average", average),
    ]
}

/// Digests of parameters and moments after the last step, of all norms, and of the average.
fn adam() -> [u64; 3] {
    const N: usize = 4096;
    let (mut x, mut first, mut second) = (numbers(1 << 35, N), vec![0.0; N], vec![0.0; N]);
    let mut target = x.clone();
    let mut norms = Vec::new();
    for step in 0..200_u64 {
        let mut gradient = numbers((1 << 36) + (step << 20), N);
        if step >= 60 {
            gradient
                .iter_mut()
                .enumerate()
                .filter(|(at, _)| at % 3 != 0)
                .for_each(|(_, g)| *g = 0.0);
        }
        let (one, two) = gradient.split_at_mut(1000);
        norms.push(clip(&mut [one, two], 50.0).to_bits());
        Rates::at(step + 1, 1e-3, [0.9, 0.999]).descend(&mut x, &gradient, &mut first, &mut second);
        follow(&mut target, &x, 0.005);
    }
    [
        of_singles(&[x, first, second].concat()),
        of_entries(norms.into_iter()),
        of_singles(&target),
    ]
}
