//! Tests of every operation against PyTorch (`tests/fixtures/images`), against finite differences, and row by
//! row.

use super::Image;
use super::normalisation::{Affine, MOMENTUM, unbiased};
use super::spectral::SingularVectors;
use crate::reference::numbers;
use plan::{Equations, Expression, Processor, Shape, State};
use serde_json::Value;

const REFERENCE: &str = include_str!("../../../../tests/fixtures/images/operations.json");

/// Inputs of an operation, which may use only some of them.
#[derive(Clone)]
struct Operands {
    /// Pixels, weight and bias.
    entries: [Vec<f32>; 3],
    shapes: [Shape; 3],
}

const NAMES: [&str; 3] = ["image", "weight", "bias"];

impl Operands {
    fn of(case: &Value) -> Self {
        let sizes = sizes(case);
        let (n_inputs, n_outputs) = (sizes[3], sizes.get(4).copied().unwrap_or(sizes[3]));
        let operation = case["operation"].as_str().unwrap();
        let weight = match operation {
            "convolve_3x3" => [9 * n_inputs, n_outputs],
            "convolve_1x1" => [n_inputs, n_outputs],
            "deconvolve_2x2" => [n_inputs, 4 * n_outputs],
            _ => [1, n_inputs],
        };
        let n_biases = if operation.contains("convolve") {
            n_outputs
        } else {
            n_inputs
        };
        let shapes = [[sizes[0] * sizes[1] * sizes[2], n_inputs], weight, [1, n_biases]];
        let entries = [0, 1, 2].map(|at: usize| numbers(shapes[at][0] * shapes[at][1], 1 + at));
        Self { entries, shapes }
    }

    /// Image number `at` alone.
    fn alone(&self, at: usize, n_images: usize) -> Self {
        let mut alone = self.clone();
        let length = self.entries[0].len() / n_images;
        alone.entries[0] = self.entries[0][at * length..][..length].to_vec();
        alone.shapes[0][0] /= n_images;
        alone
    }
}

fn sizes(case: &Value) -> Vec<usize> {
    let sizes = case["sizes"].as_array().unwrap();
    sizes.iter().map(|n| n.as_u64().unwrap() as usize).collect()
}

fn wide(entries: &[f32]) -> Vec<f64> {
    entries.iter().map(|x| f64::from(*x)).collect()
}

fn apply<'e>(case: &Value, [pixels, weight, bias]: [Expression<'e>; 3]) -> Image<'e> {
    let (sizes, relu) = (sizes(case), case["relu"].as_bool().unwrap_or_default());
    let image = Image::new(pixels, [sizes[1], sizes[2]]);
    let affine = Affine { weight, bias };
    let given = || {
        let variance = numbers(sizes[3], 12).into_iter().map(|x| x.abs() + 0.125);
        let both: Vec<f32> = numbers(sizes[3], 11).into_iter().chain(variance).collect();
        pixels.equations().constant([1, 2 * sizes[3]], &wide(&both))
    };
    match case["operation"].as_str().unwrap() {
        "convolve_3x3" => image.convolve(3, weight, bias),
        "convolve_1x1" => image.convolve(1, weight, bias),
        "deconvolve_2x2" => image.deconvolve_2x2(weight, bias),
        "normalise_batch" => image.normalise_batch(affine, relu).0,
        "normalise_by" => image.normalise_by(affine, given(), relu),
        "normalise_instances" => image.normalise_instances(relu),
        "enlarge_nearest" => image.enlarge_nearest(sizes[4]),
        "resize_bilinear" => image.resize_bilinear([sizes[4], sizes[5]]),
        "average_pool" => image.average_pool(),
        "sum_pixels" => Image::new(image.sum_pixels(), [1, 1]),
        "relu" => image.relu(),
        "tanh" => image.tanh(),
        other => panic!("`{other}`"),
    }
}

/// Output of an operation, and gradients in the wanted operands for an upstream gradient by the formula.
fn compute(case: &Value, operands: &Operands, is_wanted: [bool; 3]) -> (Vec<f32>, Vec<Option<Vec<f32>>>) {
    let (equations, mut state) = (Equations::new(), State::default());
    let leaves = [0, 1, 2].map(|at: usize| {
        state.insert(NAMES[at], operands.shapes[at], operands.entries[at].clone());
        equations.parameter(NAMES[at], operands.shapes[at])
    });
    equations.routine("all");
    let output = apply(case, leaves).pixels;
    equations.output("output", output);
    let upstream = numbers(output.n_rows() * output.n_columns(), 7);
    let loss = (output * equations.constant(output.shape(), &wide(&upstream))).sum();
    let wanted: Vec<usize> = (0..3).filter(|at| is_wanted[*at]).collect();
    let of: Vec<Expression<'_>> = wanted.iter().map(|at| leaves[*at]).collect();
    for (at, gradient) in wanted.iter().zip(equations.gradients(loss, &of)) {
        equations.output(&format!("gradient in {}", NAMES[*at]), gradient * 1.0);
    }
    let mut processor = Processor::<f32>::new(equations.into_graph());
    processor.run("all", &mut state);
    let gradient = |at: usize| {
        let name = format!("gradient in {}", NAMES[at]);
        is_wanted[at].then(|| processor.entries(&name).to_vec())
    };
    (
        processor.entries("output").to_vec(),
        (0..3).map(gradient).collect(),
    )
}

/// The operands that an operation uses.
fn used(case: &Value) -> [bool; 3] {
    NAMES.map(|name| case["expected"].get(name).is_some())
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
        let (output, gradients) = compute(&case, &Operands::of(&case), used(&case));
        assert_close(&output, &case["expected"]["output"], &what("output"));
        assert!(gradients[0].is_some(), "{}", what("image"));
        for (name, gradient) in NAMES.iter().zip(&gradients) {
            if let Some(gradient) = gradient {
                assert_close(gradient, &case["expected"][name], &what(name));
            }
        }
    }
}

/// Vectors, quotient and gradient of a weight after some steps of power iteration from `u`.
fn spectral(shape: Shape, seed: usize, start: Vec<f32>, n_steps: usize) -> [Vec<f32>; 4] {
    let (equations, mut state) = (Equations::new(), State::default());
    state.insert("weight", shape, numbers(shape[0] * shape[1], seed));
    state.insert("u", [shape[1], 1], start);
    let (weight, u) = (
        equations.parameter("weight", shape),
        equations.parameter("u", [shape[1], 1]),
    );
    equations.routine("all");
    let of_rows = equations.constant([shape[0], 1], &vec![0.0; shape[0]]);
    let mut vectors = SingularVectors {
        of_outputs: u,
        of_rows,
    };
    (0..n_steps).for_each(|_| vectors = vectors.iterated(weight));
    let divided = vectors.divided(weight);
    let upstream = numbers(shape[0] * shape[1], 7);
    let loss = (divided * equations.constant(shape, &wide(&upstream))).sum();
    let gradient = equations.gradients(loss, &[weight])[0];
    let names = ["of_outputs", "of_rows", "output", "weight's gradient"];
    let all = [vectors.of_outputs, vectors.of_rows, divided, gradient];
    for (name, value) in names.into_iter().zip(all) {
        equations.output(name, value);
    }
    let mut processor = Processor::<f32>::new(equations.into_graph());
    processor.run("all", &mut state);
    names.map(|name| processor.entries(name).to_vec())
}

#[test]
fn spectral_division_agrees_with_pytorch() {
    for case in cases().iter().filter(|case| case["operation"] == "spectral") {
        let (sizes, expected) = (sizes(case), &case["expected"]);
        let start = numbers(sizes[1], 2);
        let length = start.iter().map(|x| x * x).sum::<f32>().sqrt();
        let start = start.iter().map(|x| x / length).collect();
        let found = spectral([9 * sizes[0], sizes[1]], 1, start, 1);
        for (found, name) in found.iter().zip(["of_outputs", "of_rows", "output", "weight"]) {
            assert_close(found, &expected[name], name);
        }
    }
}

#[test]
fn power_iteration_reaches_the_largest_singular_value() {
    let [_, _, scaled, _] = spectral([12, 5], 4, vec![1.0; 5], 200);
    let matrix = nalgebra::DMatrix::from_row_slice(12, 5, &scaled);
    let largest = matrix.singular_values().max();
    assert!((largest - 1.0).abs() < 1e-5, "{largest}");
}

#[test]
fn only_wanted_gradients_are_sent_back() {
    let case = on_images().next().unwrap();
    let operands = Operands::of(&case);
    let (_, all) = compute(&case, &operands, [true; 3]);
    for wanted in 0..3 {
        let is_wanted = [0, 1, 2].map(|at| at == wanted);
        let (_, found) = compute(&case, &operands, is_wanted);
        for (at, (found, all)) in found.into_iter().zip(&all).enumerate() {
            assert_eq!(found.as_ref(), all.as_ref().filter(|_| is_wanted[at]));
        }
    }
}

/// Loss with the gradients of [`compute`], summed in `f64`.
fn loss(case: &Value, operands: &Operands) -> f64 {
    let (output, _) = compute(case, operands, [true, false, false]);
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
        let operands = Operands::of(&case);
        let (_, gradients) = compute(&case, &operands, [true, false, false]);
        let gradient = gradients[0].clone().unwrap();
        let largest = gradient
            .iter()
            .fold(0.0f64, |most, g| most.max(f64::from(g.abs())));
        let (mut missed, mut tried) = (0, 0);
        for at in (0..gradient.len()).step_by(gradient.len().div_ceil(12)) {
            let moved = |by: f32| {
                let mut operands = operands.clone();
                operands.entries[0][at] += by;
                loss(&case, &operands)
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
        let (all, n_images) = (Operands::of(&case), sizes(&case)[0]);
        let (whole, _) = compute(&case, &all, [true, false, false]);
        for row in 0..n_images {
            let (alone, _) = compute(&case, &all.alone(row, n_images), [true, false, false]);
            let length = whole.len() / n_images;
            assert_eq!(alone, whole[row * length..][..length], "{}", case["operation"]);
        }
    }
}

#[test]
fn running_statistics_move_by_the_momentum() {
    let (equations, mut state) = (Equations::new(), State::default());
    state.insert("running", [1, 2], vec![0.0, 1.0]);
    let running = equations.parameter("running", [1, 2]);
    equations.routine("absorb");
    let batch = equations.constant([1, 2], &[2.0, 3.0]);
    equations.follow(&[running], &[unbiased(batch, 4)], MOMENTUM);
    Processor::<f32>::new(equations.into_graph()).run("absorb", &mut state);
    let running = state.entries("running");
    assert!((running[0] - 0.2).abs() < 1e-7 && (running[1] - (0.9 + 0.4)).abs() < 1e-7);
}

#[test]
fn statistics_are_those_of_the_channels() {
    let equations = Equations::new();
    let input = |name, shape| equations.input(name, shape);
    let (image, weight, bias) = (
        input("image", [30, 7]),
        input("weight", [1, 7]),
        input("bias", [1, 7]),
    );
    equations.routine("all");
    let (output, statistics) = Image::new(image, [2, 5]).normalise_batch(Affine { weight, bias }, false);
    equations.output("output", output.pixels);
    equations.output("statistics", statistics);
    let mut processor = Processor::<f32>::new(equations.into_graph());
    let pixels = numbers(30 * 7, 1);
    processor.write("image", &pixels);
    processor.run("all", &mut State::default());
    let (means, variances) = processor.entries("statistics").split_at(7);
    for channel in 0..7 {
        let of_channel: Vec<f64> = pixels
            .iter()
            .skip(channel)
            .step_by(7)
            .map(|x| f64::from(*x))
            .collect();
        let mean = of_channel.iter().sum::<f64>() / 30.0;
        let variance = of_channel.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 30.0;
        assert!((f64::from(means[channel]) - mean).abs() < 1e-6);
        assert!((f64::from(variances[channel]) - variance).abs() < 1e-6);
    }
}

#[test]
fn operands_that_do_not_fit_are_refused() {
    let refused = |write: for<'e> fn(&'e Equations, Image<'e>)| {
        let equations = Equations::new();
        let image = Image::new(equations.input("image", [8, 3]), [2, 2]);
        equations.routine("refused");
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| write(&equations, image))).is_err()
    };
    assert!(refused(|equations, image| {
        let (weight, bias) = (equations.input("w", [27, 5]), equations.input("b", [1, 4]));
        let _ = image.convolve(3, weight, bias);
    }));
    assert!(refused(|equations, image| {
        let (weight, bias) = (equations.input("w", [1, 3]), equations.input("b", [1, 2]));
        let _ = image.normalise_batch(Affine { weight, bias }, true);
    }));
    assert!(refused(|equations, _| {
        let _ = Image::new(equations.input("odd", [6, 3]), [3, 2]).average_pool();
    }));
    assert!(!refused(|equations, image| {
        let (weight, bias) = (equations.input("w", [27, 5]), equations.input("b", [1, 5]));
        let _ = image.convolve(3, weight, bias).average_pool();
    }));
}
