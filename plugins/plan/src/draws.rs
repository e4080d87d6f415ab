//! Random numbers of a run. Entry `i` of draw `k` has the stream of words that begins at
//! `mix(mix(seed + k GOLDEN) + (i + 1) GOLDEN)`.

use crate::scalar::Scalar;
use arithmetic::draws::{self, GOLDEN, Stream, WordStream, mix};
use arithmetic::gamma_slope;
use arithmetic::normal::quantiles;

fn streams(seed: u64, index: usize) -> impl Iterator<Item = Stream> {
    let first = mix(seed.wrapping_add((index as u64).wrapping_mul(GOLDEN)));
    (1_u64..).map(move |entry| Stream::new(first.wrapping_add(entry.wrapping_mul(GOLDEN))))
}

pub(crate) fn normal<T: Scalar>(seed: u64, index: usize, result: &mut [T]) {
    let mut streams = streams(seed, index);
    let mut numbers = [0.0; 128];
    for piece in result.chunks_mut(numbers.len()) {
        let numbers = &mut numbers[..piece.len()];
        for (number, mut words) in numbers.iter_mut().zip(&mut streams) {
            *number = draws::uniform(words.word());
        }
        quantiles(numbers);
        piece
            .iter_mut()
            .zip(numbers)
            .for_each(|(x, number)| *x = T::of(*number));
    }
}

/// The largest `f32` below 1.
const BELOW_ONE: f64 = 1.0 - 1.0 / (1_u64 << 24) as f64;

pub(crate) fn uniform<T: Scalar>(seed: u64, index: usize, result: &mut [T]) {
    for (x, mut words) in result.iter_mut().zip(streams(seed, index)) {
        let nearest = T::of(draws::uniform(words.word()));
        // One of 2^25 numbers is rounded to 1 in `f32`.
        *x = if nearest.wide() < 1.0 {
            nearest
        } else {
            T::of(BELOW_ONE)
        };
    }
}

pub(crate) fn log_gamma<T: Scalar>(seed: u64, index: usize, shapes: &[T], result: &mut [T]) {
    for ((x, shape), mut words) in result.iter_mut().zip(shapes).zip(streams(seed, index)) {
        *x = T::of(draws::log_gamma(shape.wide(), &mut words));
    }
}

pub(crate) fn log_gamma_slope<T: Scalar>(shapes: &[T], draws: &[T], result: &mut [T]) {
    for ((x, shape), draw) in result.iter_mut().zip(shapes).zip(draws) {
        *x = T::of(gamma_slope::log_gamma_slope(shape.wide(), draw.wide()));
    }
}
