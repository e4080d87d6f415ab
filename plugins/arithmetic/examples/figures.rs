//! Prints the figures stated in the modules' headers.
//!
//! - `figures errors [NAME]` the largest error of each function of `f32`, or of one, over all 2^32 arguments, against
//!   `f64` of the C library;
//! - `figures values FILE` that of each function of `f64` against the lines of a file made by `fixtures/values.py`;
//! - `figures times` nanoseconds per entry on one core, beside the C library's functions over the same numbers.

use arithmetic::digests::{DOUBLE, SINGLE};
use arithmetic::draws::mix;
use arithmetic::products::{Matrix, product};
use arithmetic::{draws, errors, slices};
use std::collections::BTreeMap;
use std::hint::black_box;

#[allow(clippy::print_stdout, reason = "the program prints its results")]
fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    match arguments.get(1).map(String::as_str) {
        Some("errors") => single_errors(arguments.get(2).map(String::as_str)),
        Some("values") => double_errors(arguments.get(2).map_or("fixtures/values.txt", String::as_str)),
        Some("times") => times(),
        _ => println!("errors [NAME], values FILE or times"),
    }
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

fn softplus(x: f64) -> f64 {
    (if x > 0.0 { x } else { 0.0 }) + (-x.abs()).exp().ln_1p()
}

const EXACT: [fn(f64) -> f64; 6] = [f64::exp, f64::ln, f64::ln_1p, f64::tanh, logistic, softplus];

#[allow(clippy::print_stdout, reason = "the program prints its results")]
fn single_errors(only: Option<&str>) {
    for ((name, function), exact) in SINGLE.into_iter().zip(EXACT) {
        if only.is_some_and(|only| only != name) {
            continue;
        }
        let n_threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get) as u64;
        let part = |thread: u64| {
            let mut worst = (0.0, 0.0f32);
            for i in (thread..1 << 32).step_by(n_threads as usize) {
                #[allow(clippy::cast_possible_truncation, reason = "inputs are below 2^32")]
                let x = f32::from_bits(i as u32);
                let error = errors::of_single(function(x), exact(f64::from(x)));
                if error > worst.0 {
                    worst = (error, x);
                }
            }
            worst
        };
        let worst = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..n_threads)
                .map(|thread| scope.spawn(move || part(thread)))
                .collect();
            let parts = threads
                .into_iter()
                .map(|thread| thread.join().expect("a thread that ends"));
            parts.fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a })
        });
        println!("{name}: {:.3} at {:e}", worst.0, worst.1);
    }
}

#[allow(clippy::print_stdout, reason = "the program prints its results")]
fn double_errors(path: &str) {
    let text = std::fs::read_to_string(path).expect("a readable file");
    let mut worst = BTreeMap::new();
    for (name, [x, y, high, low]) in text.lines().filter_map(errors::parse) {
        let got = match DOUBLE.iter().find(|function| function.0 == name) {
            Some((_, function, _)) => function(x, y),
            None => draws::normal(x.to_bits()),
        };
        let error = errors::of_double(got, high, low);
        let entry = worst.entry(name).or_insert((0, 0.0, 0.0, 0.0));
        entry.0 += 1;
        if error.is_nan() || error > entry.1 {
            (entry.1, entry.2, entry.3) = (error, x, y);
        }
    }
    for (name, (n, error, x, y)) in worst {
        println!("{name}: {error:.3} at {x:e} {y:e}, {n} points");
    }
}

/// Nanoseconds per entry of a loop over `n` entries, the least of several runs.
#[allow(clippy::disallowed_methods, reason = "the program measures time")]
fn measured(n: usize, mut work: impl FnMut()) -> f64 {
    let run = |_| {
        let begun = std::time::Instant::now();
        work();
        begun.elapsed().as_secs_f64() * 1e9 / n as f64
    };
    (0..9).map(run).fold(f64::INFINITY, f64::min)
}

fn times() {
    times_of_single();
    times_of_double();
    times_of_draws();
    time_of_product();
}

/// Number of entries of a timed slice.
const N: usize = 4096;

fn uniform(i: u64) -> f64 {
    draws::uniform(mix(i))
}

/// Nanoseconds of a function per pair of arguments.
fn time_of(function: impl Fn(f64, f64) -> f64) -> f64 {
    let inputs: Vec<[f64; 2]> = (0..N as u64)
        .map(|i| [16.0 * uniform(i), 8.0 * uniform(mix(i)) - 4.0])
        .collect();
    measured(N * 20, || {
        for _ in 0..20 {
            black_box(&inputs).iter().for_each(|[x, y]| {
                black_box(function(*x, *y));
            });
        }
    })
}

#[allow(
    clippy::print_stdout,
    clippy::cast_possible_truncation,
    reason = "the program prints its results"
)]
fn times_of_single() {
    const REPETITIONS: usize = 200;
    let ours: [fn(&mut [f32]); 6] = [
        slices::exp,
        slices::ln,
        slices::ln_1p,
        slices::tanh,
        slices::sigmoid,
        slices::softplus,
    ];
    let theirs: [fn(f32) -> f32; 6] = [
        f32::exp,
        f32::ln,
        f32::ln_1p,
        f32::tanh,
        |x| 1.0 / (1.0 + (-x).exp()),
        |x| x.max(0.0) + (-x.abs()).exp().ln_1p(),
    ];
    for (at, (name, _)) in SINGLE.into_iter().enumerate() {
        let positive = matches!(name, "ln" | "ln_1p");
        let from = |i| {
            (if positive {
                20.0 * uniform(i)
            } else {
                16.0 * uniform(i) - 8.0
            }) as f32
        };
        let inputs: Vec<f32> = (0..N as u64).map(from).collect();
        let mut values = inputs.clone();
        let mut time = |function: &dyn Fn(&mut [f32])| {
            measured(N * REPETITIONS, || {
                for _ in 0..REPETITIONS {
                    values.copy_from_slice(&inputs);
                    function(black_box(&mut values));
                }
            })
        };
        let (one, two) = (
            time(&|values| ours[at](values)),
            time(&|values| values.iter_mut().for_each(|x| *x = theirs[at](*x))),
        );
        println!("f32 {name}: {one:.3} ns, C library {two:.3} ns");
    }
}

#[allow(clippy::print_stdout, reason = "the program prints its results")]
fn times_of_double() {
    let theirs: BTreeMap<&str, fn(f64, f64) -> f64> = BTreeMap::from([
        ("exp", (|x, _| x.exp()) as fn(f64, f64) -> f64),
        ("exp_m1", |x, _| x.exp_m1()),
        ("ln", |x, _| x.ln()),
        ("ln_1p", |x, _| x.ln_1p()),
        ("tanh", |x, _| x.tanh()),
        ("sin", |x, _| x.sin()),
        ("cos", |x, _| x.cos()),
        ("pow", f64::powf),
    ]);
    for (name, function, _) in DOUBLE {
        let other = theirs.get(name).map_or(f64::NAN, |function| time_of(*function));
        println!("f64 {name}: {:.2} ns, C library {other:.2} ns", time_of(function));
    }
}

#[allow(clippy::print_stdout, reason = "the program prints its results")]
fn times_of_draws() {
    println!(
        "draw normal: {:.2} ns",
        time_of(|x, _| draws::normal(x.to_bits() << 12))
    );
    for shape in [0.3, 1.5, 20.0] {
        let mut state = 0;
        let mut words = || {
            state += 1;
            mix(state)
        };
        let time = measured(N, || {
            (0..N).for_each(|_| {
                black_box(draws::log_gamma(shape, &mut words));
            });
        });
        println!("draw log_gamma({shape}): {time:.2} ns");
    }
}

#[allow(
    clippy::print_stdout,
    clippy::cast_possible_truncation,
    reason = "the program prints its results"
)]
fn time_of_product() {
    let values: Vec<f32> = (0..256 * 256).map(|i| uniform(i) as f32 - 0.5).collect();
    let square = Matrix::new(&values, 256, 256);
    let time = measured(256 * 256 * 256, || drop(black_box(product(square, square))));
    println!("product 256 x 256 x 256: {time:.3} ns for each multiply-add");
}
