//! Prints the digests of this crate's results, one line each, as in `fixtures/digests.txt`. It uses all
//! cores; the sums are modulo 2^64, so that the division of work does not matter.
//!
//! `cargo run --release --example digests -p regimen-arithmetic [-- --fast] [--plain]`. With `--fast` it
//! computes the kept classes alone and prints totals of 0; with `--plain` it computes one `f32` at a time
//! instead of slices.

use arithmetic::digests::{
    CLASSES, DOUBLE, KEPT, SINGLE, double_summand, log_gamma_summand, normal_summand, steps,
};
use arithmetic::draws::mix;
use arithmetic::slices;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// The functions of [`SINGLE`] over slices.
const SLICES: [fn(&mut [f32]); 6] = [
    slices::exp,
    slices::ln,
    slices::ln_1p,
    slices::tanh,
    slices::sigmoid,
    slices::softplus,
];

#[allow(
    clippy::print_stdout,
    clippy::cast_possible_truncation,
    reason = "inputs are below 2^32 and printed"
)]
fn main() {
    let [is_fast, is_plain] = ["--fast", "--plain"].map(|flag| std::env::args().any(|it| it == flag));
    let print = |name: String, bits: u32, summand: &(dyn Fn(u64, &mut [u64]) + Sync)| {
        let sums = classes(bits, is_fast, summand);
        let total = if is_fast {
            0
        } else {
            sums.iter().fold(0_u64, |a, b| a.wrapping_add(*b))
        };
        let kept: Vec<String> = sums[..KEPT].iter().map(|sum| format!("{sum:016x}")).collect();
        println!("{name} {total:016x} {}", kept.join(" "));
    };
    for (at, (name, function)) in SINGLE.into_iter().enumerate() {
        print(format!("f32.{name}"), 32, &|first, sums| {
            let mut values = vec![0.0; sums.len()];
            for (input, value) in (first as u32..).zip(&mut values) {
                *value = f32::from_bits(input);
            }
            if is_plain {
                values.iter_mut().for_each(|value| *value = function(*value));
            } else {
                SLICES[at](&mut values);
            }
            for ((i, value), sum) in (first..).zip(values).zip(sums) {
                *sum = sum.wrapping_add(mix(i << 32 | u64::from(value.to_bits())));
            }
        });
    }
    let each = |summand: &dyn Fn(u64) -> u64, first: u64, sums: &mut [u64]| {
        for (class, sum) in (0..).zip(sums) {
            *sum = sum.wrapping_add(summand(first + class));
        }
    };
    for function in &DOUBLE {
        print(format!("f64.{}", function.0), 28, &|first, sums| {
            each(&|i| double_summand(function, i), first, sums);
        });
    }
    print("draw.normal".into(), 24, &|first, sums| {
        each(&normal_summand, first, sums);
    });
    print("draw.log_gamma".into(), 24, &|first, sums| {
        each(&log_gamma_summand, first, sums);
    });
    for (name, digest) in steps() {
        println!("steps.{name} {digest:016x}");
    }
}

/// Sums of each class over the inputs below `2^bits`.
fn classes(bits: u32, is_fast: bool, summand: &(dyn Fn(u64, &mut [u64]) + Sync)) -> Vec<u64> {
    let n_classes = if is_fast { KEPT } else { CLASSES as usize };
    let (next, total) = (AtomicU64::new(0), Mutex::new(vec![0_u64; n_classes]));
    let chunks = (1_u64 << bits) / CLASSES;
    let chunk = 256.min(chunks);
    let work = || {
        let mut sums = vec![0_u64; n_classes];
        loop {
            let begin = next.fetch_add(chunk, Ordering::Relaxed);
            if begin >= chunks {
                break;
            }
            (begin..begin + chunk).for_each(|at| summand(at * CLASSES, &mut sums));
        }
        // No thread panics while it holds the lock.
        let mut total = total.lock().expect("a sound lock");
        total
            .iter_mut()
            .zip(sums)
            .for_each(|(total, sum)| *total = total.wrapping_add(sum));
    };
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(work))));
    total.into_inner().expect("a sound lock")
}
