//! Errors and special values of the functions, the distribution of the draws, the order of sums, and the digests.

use crate::digests::{self, DOUBLE, KEPT, SINGLE, class};
use crate::draws::{GOLDEN, Stream, WordStream, log_gamma, mix, normal, uniform};
use crate::products::{BLOCK, Matrix, SUM_BLOCK, product, row_sums, sum, sum_of_squares};
use crate::steps::{Rates, clip, follow};
use crate::{double, errors, gamma, gamma_slope, normal, power, single, slices, trigonometry};
use proptest::prelude::*;

mod of_draws;
mod of_functions;
mod of_sums;

/// Stored digests (`digests.rs`) of all inputs, and of the first 16 classes of them.
const DIGESTS: &str = include_str!("../fixtures/digests.txt");

fn kept(name: &str) -> Vec<u64> {
    let line = DIGESTS.lines().find(|line| line.split(' ').next() == Some(name));
    let words = line
        .unwrap_or_else(|| panic!("{name} is kept"))
        .split(' ')
        .skip(1);
    words
        .map(|word| u64::from_str_radix(word, 16).expect("hexadecimal digits"))
        .collect()
}

/// Tests two classes of a function of `f32`: 2^21 of its inputs, spread over all of them.
#[test]
#[allow(clippy::cast_possible_truncation, reason = "inputs are below 2^32")]
fn digests_of_single_functions_are_the_kept_ones() {
    for (name, function) in SINGLE {
        let kept = kept(&format!("f32.{name}"));
        assert_eq!(kept.len(), 1 + KEPT);
        for at in [0, 15] {
            let digest = class(32, at, |i| digests::single_summand(function, i as u32));
            assert_eq!(digest, kept[1 + at as usize], "{name}, class {at}");
        }
    }
}

/// Tests classes 0 to 3 of 2^28 inputs: two of bit patterns and two of a range.
#[test]
fn digests_of_double_functions_are_the_kept_ones() {
    for function in &DOUBLE {
        let kept = kept(&format!("f64.{}", function.0));
        for at in 0..4 {
            let digest = class(28, at, |i| digests::double_summand(function, i));
            assert_eq!(digest, kept[1 + at as usize], "{}, class {at}", function.0);
        }
    }
}

#[test]
fn digests_of_draws_are_the_kept_ones() {
    for (name, summand) in [
        ("normal", digests::normal_summand as fn(u64) -> u64),
        ("log_gamma", digests::log_gamma_summand),
    ] {
        let kept = kept(&format!("draw.{name}"));
        for at in 0..KEPT {
            assert_eq!(class(24, at as u64, summand), kept[1 + at], "{name}, class {at}");
        }
    }
}

#[test]
fn digests_of_steps_are_the_kept_ones() {
    for (name, digest) in digests::steps() {
        assert_eq!(vec![digest], kept(&format!("steps.{name}")), "{name}");
    }
}

/// Tests the words of the streams of digests against the published first words of SplitMix64 with the state
/// 0.
#[test]
fn streams_are_split_mix() {
    let mut state = 0_u64;
    let mut next = || {
        state = state.wrapping_add(GOLDEN);
        mix(state)
    };
    assert_eq!([next(), next()], [0xe220_a839_7b1d_cdaf, 0x6e78_9e6a_a1b9_65f4]);
    let mut stream = Stream::new(5);
    assert_eq!(stream.word(), mix(mix(5).wrapping_add(GOLDEN)));
}

/// Numbers between -0.5 and 0.5.
pub(crate) fn numbers(count: usize, first: u64) -> Vec<f32> {
    let mut state = first.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let number = |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / 16_777_216.0 - 0.5
    };
    (0..count).map(number).collect()
}

/// A factor in either order of its entries.
pub(crate) fn factor(values: &[f32], rows: usize, columns: usize, is_transposed: bool) -> Matrix<'_> {
    if is_transposed {
        Matrix::new(values, columns, rows).transposed()
    } else {
        Matrix::new(values, rows, columns)
    }
}
