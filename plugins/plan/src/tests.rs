//! Gradients against finite differences, bits against the definitions, and the plan as a whole.

use crate::differences::largest_error;
use crate::scalar::Scalar;
use crate::{Activation, Graph, Optimiser, Processor, Shape, State, Value};
use proptest::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};

mod of_bits;
mod of_cuda;
mod of_draws;
mod of_equations;
mod of_extensions;
mod of_gradients;
mod of_order;
mod of_plans;
mod of_states;

/// Numbers without a pattern between two limits.
fn numbers(count: usize, seed: u64, [low, high]: [f64; 2]) -> Vec<f64> {
    let word = |i: u64| arithmetic::draws::mix(seed.wrapping_add(i.wrapping_mul(arithmetic::draws::GOLDEN)));
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

/// A state of named rows.
fn state_of<T: Scalar>(rows: &[(&str, &[T])]) -> State<T> {
    let mut state = State::default();
    for (name, entries) in rows {
        state.insert(*name, [1, entries.len()], entries.to_vec());
    }
    state
}

/// Message of a panic.
fn panic_of(run: impl FnOnce()) -> String {
    let payload = catch_unwind(AssertUnwindSafe(run)).unwrap_err();
    let text = payload.downcast_ref::<String>().cloned();
    text.unwrap_or_else(|| (*payload.downcast_ref::<&str>().unwrap()).to_owned())
}

/// [`largest_error`] of a loss of parameters with given shapes and limits.
fn gradient_error(loss: Loss, parameters: &[(Shape, [f64; 2])], seed: u64) -> f64 {
    let (mut graph, mut state) = (Graph::new(), State::default());
    let names: Vec<String> = (0..parameters.len()).map(|at| format!("x{at}")).collect();
    let mut leaves = Vec::new();
    for ((at, name), (shape, limits)) in names.iter().enumerate().zip(parameters) {
        let entries = numbers(shape[0] * shape[1], seed ^ (at as u64) << 7, *limits);
        state.insert(name, *shape, entries);
        leaves.push(graph.parameter(name, *shape));
    }
    let _ = graph.routine("loss and gradients");
    let loss = loss(&mut graph, &leaves, seed);
    graph.output("loss", loss);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    largest_error(graph, ["loss and gradients", "loss"], &names, &state, &[], seed)
}
