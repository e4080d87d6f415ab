//! Median time of one operation on images, forward and backward, on one thread.
//!
//! usage: images OPERATION BATCH INPUTS OUTPUTS SIDE SECONDS
//!
//! All inputs want gradients. A sum weighted by the upstream gradient starts the backward pass; what that sum
//! takes by itself is measured beside it and subtracted. Prints one line of JSON.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use burn::tensor::{Tensor, TensorData};
use numerics::image::{convolution, deconvolution, normalisation, pointwise, resize, spectral};
use numerics::network::device;
use std::hint::black_box;
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
    let image = numbers([batch, side, side, inputs]);
    let weight = numbers([n_weights(name, inputs, outputs)]);
    let bias = numbers([outputs]);
    let output = compute(
        name,
        [image.clone(), weight.clone().reshape([1, 1, 1, -1])],
        bias.clone(),
    );
    let upstream = Tensor::from_inner(numbers(output.dims()));
    let leaf = |x: &Tensor<4>| Tensor::from_inner(x.clone()).require_grad();
    let vector = |x: &Tensor<1>| Tensor::from_inner(x.clone()).require_grad();
    let of_sum = median(seconds / 4.0, || {
        black_box((leaf(&output) * upstream.clone()).sum().backward());
    });
    let whole = median(seconds, || {
        let weight = vector(&weight).reshape([1, 1, 1, -1]);
        let output = compute(name, [leaf(&image), weight], vector(&bias));
        black_box((output * upstream.clone()).sum().backward());
    });
    println!(
        "{}",
        serde_json::json!({ "who": "Regimen", "median_s": whole - of_sum, "sum_s": of_sum })
    );
}

fn numbers<const D: usize>(shape: [usize; D]) -> Tensor<D> {
    let values: Vec<f32> = (0..shape.iter().product())
        .map(|i| (i as f32 * 12.9898).sin())
        .collect();
    Tensor::from_data(TensorData::new(values, shape), &device())
}

fn n_weights(name: &str, inputs: usize, outputs: usize) -> usize {
    match name {
        "convolve_3x3" | "spectral" => 9 * inputs * outputs,
        "convolve_1x1" => inputs * outputs,
        "deconvolve_2x2" => 4 * inputs * outputs,
        _ => inputs,
    }
}

fn compute(name: &str, [x, w]: [Tensor<4>; 2], b: Tensor<1>) -> Tensor<4> {
    let (inputs, outputs, [_, height, width, _]) = (x.dims()[3], b.dims()[0], x.dims());
    match name {
        "convolve_3x3" => convolution::convolve_3x3(x, w.reshape([3, 3, inputs, outputs]), b),
        "convolve_1x1" => convolution::convolve_1x1(x, w.reshape([inputs, outputs]), b),
        "deconvolve_2x2" => deconvolution::deconvolve_2x2(x, w.reshape([inputs, 2, 2, outputs]), b),
        "batch" => normalisation::normalise_batch(x, w.flatten(0, 3), b, false).0,
        "batch_relu" => normalisation::normalise_batch(x, w.flatten(0, 3), b, true).0,
        "instance" => normalisation::normalise_instances(x, false),
        "instance_relu" => normalisation::normalise_instances(x, true),
        "bilinear" => resize::resize_bilinear(x, [2 * height, 2 * width]),
        "nearest" => resize::enlarge_nearest(x, 2),
        "pool" => resize::average_pool(x),
        "relu" => pointwise::relu(x),
        "tanh" => pointwise::tanh(x),
        "spectral" => {
            let mut vectors = spectral::SingularVectors {
                of_outputs: vec![1.0; outputs],
                of_rows: vec![1.0; 9 * inputs],
            };
            let weight = w.reshape([3, 3, inputs, outputs]);
            vectors.iterate(&weight);
            spectral::normalised(weight, &vectors)
        }
        other => panic!("there is no operation `{other}`"),
    }
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
