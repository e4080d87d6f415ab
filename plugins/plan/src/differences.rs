//! Compares gradients of a plan with central differences in `f64`, for tests of learners.

use crate::graph::{Graph, Shape, Value};
use crate::processor::Processor;
use crate::state::State;

const STEP: f64 = 1e-5;

/// Largest difference between the gradient of an output `[1, 1]` of a routine with respect to parameters and central
/// differences, relative to the largest entry of the gradient of the parameter (at least `1e-2`). The inputs are those
/// of `inputs`.
///
/// # Panics
/// If the graph has no such routine, output, parameter or input, if the routine is not the last one, and in the cases
/// of [`Graph::gradients`] and [`Processor::run`].
#[must_use]
pub fn largest_error(
    mut graph: Graph,
    [routine, loss]: [&str; 2],
    parameters: &[&str],
    state: &State<f64>,
    inputs: &[(&str, Vec<f64>)],
    seed: u64,
) -> f64 {
    // The gradients are added to the routine that was begun last.
    let last = graph.routines.last().map(|last| last.name.as_str());
    assert_eq!(last, Some(routine), "the last routine");
    let named = |graph: &Graph, name: &str| graph.named(name).unwrap_or_else(|| panic!("no `{name}`"));
    let (of, wanted): (Value, Vec<Value>) = (
        named(&graph, loss),
        parameters.iter().map(|name| named(&graph, name)).collect(),
    );
    let shapes: Vec<Shape> = wanted.iter().map(|value| graph.shape(*value)).collect();
    for (at, gradient) in graph.gradients(of, &wanted).into_iter().enumerate() {
        // A gradient may be a leaf, or that of two parameters.
        let copy = graph.scale(gradient, 1.0);
        graph.output(&format!("gradient {at}"), copy);
    }
    let mut processor = Processor::<f64>::new(graph);
    for (name, entries) in inputs {
        processor.write(name, entries);
    }
    processor.run_seeded(routine, &mut state.clone(), seed);
    let found: Vec<Vec<f64>> = (0..shapes.len())
        .map(|at| processor.entries(&format!("gradient {at}")).to_vec())
        .collect();
    let mut worst = 0.0_f64;
    for (parameter, found) in parameters.iter().zip(found) {
        let scale = found.iter().fold(1e-2, |scale: f64, g| scale.max(g.abs()));
        for (place, g) in found.iter().enumerate() {
            let mut at = |step: f64| {
                // The routine may change the state too.
                let mut state = state.clone();
                state.entries_mut(parameter)[place] += step;
                processor.run_seeded(routine, &mut state, seed);
                processor.number(loss)
            };
            let slope = (at(STEP) - at(-STEP)) / (2.0 * STEP);
            worst = worst.max((slope - g).abs() / scale);
        }
    }
    worst
}
