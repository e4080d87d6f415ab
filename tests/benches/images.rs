//! Median time of one operation on images, forward and backward, on one thread.
//!
//! usage: images OPERATION BATCH INPUTS OUTPUTS SIDE SECONDS
//!
//! All inputs want gradients. A sum weighted by the upstream gradient starts the backward pass; what that sum
//! takes by itself is measured beside it and subtracted. Prints one line of JSON.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use generators::image::{Image, normalisation::Affine, spectral::SingularVectors};
use plan::{Equations, Expression, Processor, State};
use std::time::Instant;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

#[expect(clippy::print_stdout, reason = "a benchmark prints its figure")]
fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let number = |at: usize, otherwise: usize| words.get(at).map_or(otherwise, |word| word.parse().unwrap());
    let name = words.first().map_or("convolve_3x3", String::as_str);
    let [batch, inputs, outputs, side] = [number(1, 32), number(2, 16), number(3, 16), number(4, 16)];
    let seconds = number(5, 2) as f64;
    let mut state = State::default();
    let weight_shape = weight_shape(name, inputs, outputs);
    let n_biases = if name.contains("convolve") {
        outputs
    } else {
        inputs
    };
    let operands = [
        ("image", [batch * side * side, inputs]),
        ("weight", weight_shape),
        ("bias", [1, n_biases]),
    ];
    let equations = Equations::new();
    let leaves = operands.map(|(name, shape)| {
        state.insert(name, shape, numbers(shape[0] * shape[1]));
        equations.parameter(name, shape)
    });
    equations.routine("whole");
    let output = compute(name, leaves, side);
    let shape = output.shape();
    let used = match name {
        "spectral" => &leaves[1..2],
        "batch" | "batch_relu" => &leaves[..],
        _ if name.contains("convolve") => &leaves[..],
        _ => &leaves[..1],
    };
    descend_sum(output, used);
    equations.routine("sum");
    state.insert("output", shape, numbers(shape[0] * shape[1]));
    descend_sum(equations.parameter("output", shape), &[]);
    let mut plan = Processor::<f32>::new(equations.into_graph());
    let mut time = |routine: &str, seconds: f64| median(seconds, || plan.run(routine, &mut state));
    let (of_sum, whole) = (time("sum", seconds / 4.0), time("whole", seconds));
    println!(
        "{}",
        serde_json::json!({ "who": "Regimen", "median_s": whole - of_sum, "sum_s": of_sum })
    );
}

/// Adds the gradients of a weighted sum of a value in leaves, or in itself.
fn descend_sum<'e>(output: Expression<'e>, leaves: &[Expression<'e>]) {
    let (equations, [rows, columns]) = (output.equations(), output.shape());
    let upstream: Vec<f64> = numbers(rows * columns).into_iter().map(f64::from).collect();
    let loss = (output * equations.constant([rows, columns], &upstream)).sum();
    let of = if leaves.is_empty() {
        vec![output]
    } else {
        leaves.to_vec()
    };
    for (at, gradient) in equations.gradients(loss, &of).into_iter().enumerate() {
        equations.output(&format!("{rows} {columns} {at} {}", leaves.len()), gradient);
    }
}

fn numbers(count: usize) -> Vec<f32> {
    (0..count).map(|i| (i as f32 * 12.9898).sin()).collect()
}

fn weight_shape(name: &str, inputs: usize, outputs: usize) -> [usize; 2] {
    match name {
        "convolve_3x3" | "spectral" => [9 * inputs, outputs],
        "convolve_1x1" => [inputs, outputs],
        "deconvolve_2x2" => [inputs, 4 * outputs],
        _ => [1, inputs],
    }
}

fn compute<'e>(name: &str, [pixels, weight, bias]: [Expression<'e>; 3], side: usize) -> Expression<'e> {
    let x = Image::new(pixels, [side; 2]);
    let affine = Affine { weight, bias };
    let image = match name {
        "convolve_3x3" => x.convolve(3, weight, bias),
        "convolve_1x1" => x.convolve(1, weight, bias),
        "deconvolve_2x2" => x.deconvolve_2x2(weight, bias),
        "batch" => x.normalise_batch(affine, false).0,
        "batch_relu" => x.normalise_batch(affine, true).0,
        "instance" => x.normalise_instances(false),
        "instance_relu" => x.normalise_instances(true),
        "bilinear" => x.resize_bilinear([2 * side; 2]),
        "nearest" => x.enlarge_nearest(2),
        "pool" => x.average_pool(),
        "relu" => x.relu(),
        "tanh" => x.tanh(),
        "spectral" => {
            let ones = |n| weight.equations().constant([n, 1], &vec![1.0; n]);
            let vectors = SingularVectors {
                of_outputs: ones(weight.n_columns()),
                of_rows: ones(weight.n_rows()),
            };
            return vectors.iterated(weight).divided(weight);
        }
        other => panic!("there is no operation `{other}`"),
    };
    image.pixels
}

fn median(seconds: f64, mut run: impl FnMut()) -> f64 {
    (0..3).for_each(|_| run());
    let (mut times, begin) = (Vec::new(), Instant::now());
    while times.len() < 5 || begin.elapsed().as_secs_f64() < seconds {
        let start = Instant::now();
        run();
        times.push(start.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
