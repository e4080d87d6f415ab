//! Tests of every operation against PyTorch (`tests/fixtures/images`), against finite differences, and row by
//! row.

use super::{convolution, deconvolution, normalisation, pointwise, resize, spectral};
use crate::network::{device, values};
use burn::tensor::{Gradients, Tensor, TensorData};
use serde_json::Value;

const REFERENCE: &str = include_str!("../../../../tests/fixtures/images/operations.json");

/// Numbers by the formula of `numbers_and_thinning.py`; each is exact in `f32`.
pub(super) fn numbers(count: usize, seed: usize) -> Vec<f32> {
    let integer = |i: usize| (i * i * 37 + i * 101 + seed * 53) % 2003;
    (0..count)
        .map(|i| (integer(i) as f32 - 1001.0) / 1024.0)
        .collect()
}

fn plain<const D: usize>(shape: [usize; D], seed: usize) -> Tensor<D> {
    Tensor::from_data(
        TensorData::new(numbers(shape.iter().product(), seed), shape),
        &device(),
    )
}

/// Inputs of an operation, which may use only some of them.
#[derive(Clone)]
struct Operands {
    image: Tensor<4>,
    /// Weight in one dimension; an operation reshapes it.
    weight: Tensor<1>,
    bias: Tensor<1>,
}

impl Operands {
    fn of(case: &Value) -> Self {
        let sizes = sizes(case);
        let (n_inputs, n_outputs) = (sizes[3], sizes.get(4).copied().unwrap_or(sizes[3]));
        let operation = case["operation"].as_str().unwrap();
        let n_weights = match operation {
            "convolve_3x3" => 9 * n_inputs * n_outputs,
            "convolve_1x1" => n_inputs * n_outputs,
            "deconvolve_2x2" => 4 * n_inputs * n_outputs,
            _ => n_inputs,
        };
        let n_biases = if operation.contains("convolve") {
            n_outputs
        } else {
            n_inputs
        };
        Self {
            image: plain([sizes[0], sizes[1], sizes[2], n_inputs], 1),
            weight: plain([n_weights], 2),
            bias: plain([n_biases], 3),
        }
    }

    fn tracked(&self) -> Self {
        Self {
            image: Tensor::from_inner(self.image.clone()).require_grad(),
            weight: Tensor::from_inner(self.weight.clone()).require_grad(),
            bias: Tensor::from_inner(self.bias.clone()).require_grad(),
        }
    }
}

fn sizes(case: &Value) -> Vec<usize> {
    let sizes = case["sizes"].as_array().unwrap();
    sizes.iter().map(|n| n.as_u64().unwrap() as usize).collect()
}

fn compute(case: &Value, leaves: &Operands) -> Tensor<4> {
    let (sizes, relu) = (sizes(case), case["relu"].as_bool().unwrap_or_default());
    let (x, w, b) = (leaves.image.clone(), leaves.weight.clone(), leaves.bias.clone());
    let given = || {
        let variance = numbers(sizes[3], 12).iter().map(|x| x.abs() + 0.125).collect();
        normalisation::Statistics {
            mean: numbers(sizes[3], 11),
            variance,
        }
    };
    match case["operation"].as_str().unwrap() {
        "convolve_3x3" => convolution::convolve_3x3(x, w.reshape([3, 3, sizes[3], sizes[4]]), b),
        "convolve_1x1" => convolution::convolve_1x1(x, w.reshape([sizes[3], sizes[4]]), b),
        "deconvolve_2x2" => deconvolution::deconvolve_2x2(x, w.reshape([sizes[3], 2, 2, sizes[4]]), b),
        "normalise_batch" => normalisation::normalise_batch(x, w, b, relu).0,
        "normalise_by" => normalisation::normalise_by(x, w, b, given(), relu),
        "normalise_instances" => normalisation::normalise_instances(x, relu),
        "enlarge_nearest" => resize::enlarge_nearest(x, sizes[4]),
        "resize_bilinear" => resize::resize_bilinear(x, [sizes[4], sizes[5]]),
        "average_pool" => resize::average_pool(x),
        "sum_pixels" => resize::sum_pixels(x),
        "relu" => pointwise::relu(x),
        "tanh" => pointwise::tanh(x),
        other => panic!("`{other}`"),
    }
}

/// Gradients for an upstream gradient by the formula.
fn gradients<const D: usize>(output: &Tensor<D>) -> Gradients {
    let upstream = plain(output.dims(), 7);
    (output.clone() * Tensor::from_inner(upstream)).sum().backward()
}

fn assert_close(found: &[f32], expected: &Value, what: &str) {
    let number = |key: &str| expected[key].as_f64().unwrap();
    assert_eq!(found.len() as f64, number("length"), "{what}");
    let largest = found.iter().fold(0.0f64, |most, x| most.max(f64::from(x.abs())));
    let tolerance = 3e-6 * largest + 1e-6;
    let entries = expected["entries"].as_array().unwrap();
    let step = number("step") as usize;
    assert_eq!(found.iter().step_by(step).count(), entries.len(), "{what}");
    for (at, (found, expected)) in found.iter().step_by(step).zip(entries).enumerate() {
        let expected = expected.as_f64().unwrap();
        assert!(
            (f64::from(*found) - expected).abs() < tolerance,
            "{what}, entry {at}: {found} {expected}"
        );
    }
    let pairs = found.iter().zip(numbers(found.len(), 9));
    let sum: f64 = pairs.map(|(x, weight)| f64::from(*x) * f64::from(weight)).sum();
    let allowed = tolerance * (found.len() as f64).sqrt();
    assert!(
        (sum - number("sum")).abs() < allowed,
        "{what}, sum: {sum} {}",
        expected["sum"]
    );
}

fn cases() -> Vec<Value> {
    let cases: Vec<Value> = serde_json::from_str(REFERENCE).unwrap();
    assert!(cases.len() > 40, "{}", cases.len());
    cases
}

fn on_images() -> impl Iterator<Item = Value> {
    cases().into_iter().filter(|case| case["operation"] != "spectral")
}

#[test]
fn values_and_gradients_agree_with_pytorch() {
    for case in on_images() {
        let what = |part: &str| format!("{part} of {} {:?}", case["operation"], sizes(&case));
        let (leaves, expected) = (Operands::of(&case).tracked(), &case["expected"]);
        let output = compute(&case, &leaves);
        let gradients = gradients(&output);
        assert_close(&values(output), &expected["output"], &what("output"));
        assert_close(
            &values(leaves.image.grad(&gradients).unwrap()),
            &expected["image"],
            &what("image"),
        );
        for (name, leaf) in [("weight", &leaves.weight), ("bias", &leaves.bias)] {
            match expected.get(name) {
                Some(expected) => {
                    assert_close(&values(leaf.grad(&gradients).unwrap()), expected, &what(name));
                }
                None => assert!(leaf.grad(&gradients).is_none(), "{}", what(name)),
            }
        }
    }
}

#[test]
fn spectral_division_agrees_with_pytorch() {
    for case in cases().iter().filter(|case| case["operation"] == "spectral") {
        let (sizes, expected) = (sizes(case), &case["expected"]);
        let weight: Tensor<4> = plain([3, 3, sizes[0], sizes[1]], 1);
        let start = numbers(sizes[1], 2);
        let length = start.iter().map(|x| x * x).sum::<f32>().sqrt();
        let mut vectors = spectral::SingularVectors {
            of_outputs: start.iter().map(|x| x / length).collect(),
            of_rows: vec![0.0; 9 * sizes[0]],
        };
        vectors.iterate(&weight);
        assert_close(&vectors.of_outputs, &expected["of_outputs"], "u");
        assert_close(&vectors.of_rows, &expected["of_rows"], "v");
        let weight = Tensor::from_inner(weight).require_grad();
        let output = spectral::normalised(weight.clone(), &vectors);
        let gradients = gradients(&output);
        assert_close(&values(output), &expected["output"], "output");
        assert_close(
            &values(weight.grad(&gradients).unwrap()),
            &expected["weight"],
            "weight",
        );
    }
}

#[test]
fn power_iteration_reaches_the_largest_singular_value() {
    let weight: Tensor<2> = plain([12, 5], 4);
    let mut vectors = spectral::SingularVectors {
        of_outputs: vec![1.0; 5],
        of_rows: vec![0.0; 12],
    };
    (0..200).for_each(|_| vectors.iterate(&weight));
    let scaled = values(spectral::normalised(weight, &vectors));
    let matrix = nalgebra::DMatrix::from_row_slice(12, 5, &scaled);
    let largest = matrix.singular_values().max();
    assert!((largest - 1.0).abs() < 1e-5, "{largest}");
}

#[test]
fn only_wanted_gradients_are_sent_back() {
    let case = on_images().next().unwrap();
    for tracked in [[true, false, false], [false, true, false], [false, false, true]] {
        let (all, plain) = (Operands::of(&case).tracked(), Operands::of(&case));
        let expected = gradients(&compute(&case, &all));
        let leaves = Operands {
            image: if tracked[0] {
                all.image.clone()
            } else {
                plain.image
            },
            weight: if tracked[1] {
                all.weight.clone()
            } else {
                plain.weight
            },
            bias: if tracked[2] { all.bias.clone() } else { plain.bias },
        };
        let found = gradients(&compute(&case, &leaves));
        assert_eq!(
            leaves.image.grad(&found).map(values),
            all.image.grad(&expected).map(values).filter(|_| tracked[0])
        );
        assert_eq!(
            leaves.weight.grad(&found).map(values),
            all.weight.grad(&expected).map(values).filter(|_| tracked[1])
        );
        assert_eq!(
            leaves.bias.grad(&found).map(values),
            all.bias.grad(&expected).map(values).filter(|_| tracked[2])
        );
    }
}

/// Loss with the gradients of [`gradients`], summed in `f64`.
fn loss(case: &Value, leaves: &Operands) -> f64 {
    let output = values(compute(case, leaves));
    let upstream = numbers(output.len(), 7);
    output
        .iter()
        .zip(upstream)
        .map(|(y, dy)| f64::from(*y) * f64::from(dy))
        .sum()
}

#[test]
fn gradients_agree_with_finite_differences() {
    const STEP: f32 = 1.0 / 256.0;
    for case in on_images() {
        let leaves = Operands::of(&case);
        let tracked = leaves.tracked();
        let gradient = values(tracked.image.grad(&gradients(&compute(&case, &tracked))).unwrap());
        let (shape, x) = (leaves.image.dims(), values(leaves.image.clone()));
        let largest = gradient
            .iter()
            .fold(0.0f64, |most, g| most.max(f64::from(g.abs())));
        let (mut missed, mut tried) = (0, 0);
        for at in (0..x.len()).step_by(x.len().div_ceil(12)) {
            let moved = |by: f32| {
                let mut x = x.clone();
                x[at] += by;
                let image = Tensor::from_data(TensorData::new(x, shape), &device());
                loss(
                    &case,
                    &Operands {
                        image,
                        ..leaves.clone()
                    },
                )
            };
            let difference = (moved(STEP) - moved(-STEP)) / (2.0 * f64::from(STEP));
            tried += 1;
            missed += usize::from((difference - f64::from(gradient[at])).abs() > 0.02 * largest + 1e-3);
        }
        // A rectifier may have its kink between the two points.
        let allowed = if case["relu"].as_bool().unwrap_or(case["operation"] == "relu") {
            1
        } else {
            0
        };
        assert!(
            missed <= allowed,
            "{missed} of {tried} in {} {:?}",
            case["operation"],
            sizes(&case)
        );
    }
}

#[test]
fn rows_of_the_batch_are_independent() {
    for case in on_images().filter(|case| case["operation"] != "normalise_batch") {
        let all = Operands::of(&case);
        let whole = values(compute(&case, &all));
        let n_images = all.image.dims()[0];
        for row in 0..n_images {
            let image = all.image.clone().narrow(0, row, 1);
            let alone = values(compute(&case, &Operands { image, ..all.clone() }));
            let length = whole.len() / n_images;
            assert_eq!(alone, whole[row * length..][..length], "{}", case["operation"]);
        }
    }
}

#[test]
fn running_statistics_move_by_the_momentum() {
    let mut running = normalisation::Statistics::neutral(1);
    let batch = normalisation::Statistics {
        mean: vec![2.0],
        variance: vec![3.0],
    };
    running.absorb(&batch, 4);
    assert!((running.mean[0] - 0.2).abs() < 1e-7 && (running.variance[0] - (0.9 + 0.4)).abs() < 1e-7);
}

#[test]
fn statistics_are_those_of_the_channels() {
    let image: Tensor<4> = plain([3, 2, 5, 7], 1);
    let (_, statistics) = normalisation::normalise_batch(image.clone(), plain([7], 2), plain([7], 3), false);
    let pixels = values(image);
    for channel in 0..7 {
        let of_channel: Vec<f64> = pixels
            .iter()
            .skip(channel)
            .step_by(7)
            .map(|x| f64::from(*x))
            .collect();
        let mean = of_channel.iter().sum::<f64>() / 30.0;
        let variance = of_channel.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 30.0;
        assert!((f64::from(statistics.mean[channel]) - mean).abs() < 1e-6);
        assert!((f64::from(statistics.variance[channel]) - variance).abs() < 1e-6);
    }
}
