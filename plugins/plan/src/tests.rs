//! Gradients against finite differences, bits against the definitions, and the plan as a whole.

use crate::{Activation, Graph, Optimiser, Processor, Routine, Shape, Value};
use proptest::prelude::*;

mod of_bits;
mod of_gradients;
mod of_plans;

/// Numbers without a pattern between two limits.
fn numbers(count: usize, seed: u64, [low, high]: [f64; 2]) -> Vec<f64> {
    let word =
        |i: u64| arithmetic::digests::mix(seed.wrapping_add(i.wrapping_mul(arithmetic::digests::GOLDEN)));
    let number = |i| low + (high - low) * arithmetic::draws::uniform(word(i));
    (1..=count as u64).map(number).collect()
}

#[allow(clippy::cast_possible_truncation, reason = "the nearest f32 is meant")]
fn singles(count: usize, seed: u64) -> Vec<f32> {
    numbers(count, seed, [-1.0, 1.0])
        .into_iter()
        .map(|x| x as f32)
        .collect()
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// A loss `[1, 1]` of some inputs, by the seed of its constants.
type Loss<'a> = &'a dyn Fn(&mut Graph, &[Value], u64) -> Value;

/// Sum of a value's entries with a different weight each, so that every entry has another gradient.
fn weighted_sum(graph: &mut Graph, value: Value, seed: u64) -> Value {
    let shape = graph.shape(value);
    let weights = graph.constant(shape, &numbers(shape[0] * shape[1], !seed, [0.5, 1.5]));
    let product = graph.mul(value, weights);
    graph.sum(product)
}

/// Largest difference between gradients and central differences in `f64`, relative to the largest gradient of the
/// input, of a loss of inputs with given shapes and limits.
fn gradient_error(loss: Loss, inputs: &[(Shape, [f64; 2])], seed: u64) -> f64 {
    const STEP: f64 = 1e-5;
    let mut graph = Graph::new();
    let leaves: Vec<Value> = inputs
        .iter()
        .enumerate()
        .map(|(at, (shape, _))| graph.input(&format!("x{at}"), *shape))
        .collect();
    let routine = graph.routine("loss and gradients");
    let loss = loss(&mut graph, &leaves, seed);
    let gradients = graph.gradients(loss, &leaves);
    graph.output("loss", loss);
    let gradients: Vec<Value> = gradients
        .into_iter()
        .enumerate()
        .map(|(at, gradient)| {
            // Two inputs may have one gradient, and a gradient may be a leaf.
            let copy = graph.scale(gradient, 1.0);
            graph.output(&format!("g{at}"), copy);
            copy
        })
        .collect();
    let mut processor = Processor::<f64>::new(&graph);
    for (at, (leaf, (shape, limits))) in leaves.iter().zip(inputs).enumerate() {
        processor.write(
            *leaf,
            &numbers(shape[0] * shape[1], seed ^ (at as u64) << 7, *limits),
        );
    }
    processor.run(routine);
    let found: Vec<Vec<f64>> = gradients
        .iter()
        .map(|it| processor.entries(*it).to_vec())
        .collect();
    let mut worst = 0.0_f64;
    for (leaf, found) in leaves.iter().zip(found) {
        let mut at = |place: usize, step: f64| {
            processor.entries_mut(*leaf)[place] += step;
            processor.run(routine);
            let value = processor.entries(loss)[0];
            processor.entries_mut(*leaf)[place] -= step;
            value
        };
        let scale = found.iter().fold(1e-2, |scale: f64, g| scale.max(g.abs()));
        for (place, g) in found.iter().enumerate() {
            let slope = (at(place, STEP) - at(place, -STEP)) / (2.0 * STEP);
            worst = worst.max((slope - g).abs() / scale);
        }
    }
    worst
}
