//! Operations of another crate: gradients, bits, listings, and operands that do not fit.

use super::*;
use crate::{Backward, Descent, Equations, Expression, Extension};

/// `a b` entry by entry; `b` may count as a constant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Products {
    pub(super) is_constant: bool,
}

impl Extension for Products {
    fn name(&self) -> String {
        "Products".into()
    }

    fn shape(&self, operands: &[Shape]) -> Option<Shape> {
        let [a, b] = operands else { return None };
        (a == b).then_some(*a)
    }

    fn flops(&self, _: &[Shape], [rows, columns]: Shape) -> u64 {
        (rows * columns) as u64
    }

    fn compute(&self, operands: &[&[f32]], result: &mut [f32], memory: &mut Vec<f32>) {
        memory.clear();
        memory.extend(operands[0].iter().zip(operands[1]).map(|(a, b)| a * b));
        result.copy_from_slice(memory);
    }

    fn passes(&self, operand: usize) -> bool {
        operand == 0 || !self.is_constant
    }

    fn gradients(&self, graph: &mut Graph, backward: &Backward<'_>) -> Vec<Option<Value>> {
        let Backward {
            operands, upstream, ..
        } = *backward;
        (0..2)
            .map(|at| backward.is_needed[at].then(|| graph.apply(*self, &[upstream, operands[1 - at]])))
            .collect()
    }
}

const FREE: Products = Products { is_constant: false };
const CONSTANT: Products = Products { is_constant: true };

/// Gradients of a loss with respect to two parameters, by an extension and by operations of this crate.
fn gradients(write: for<'e> fn([Expression<'e>; 2]) -> Expression<'e>) -> Vec<Vec<f32>> {
    let equations = Equations::new();
    let leaves = ["a", "b"].map(|name| equations.parameter(name, [3, 4]));
    equations.routine("gradients");
    let loss = write(leaves).sum();
    for (at, gradient) in equations.gradients(loss, &leaves).into_iter().enumerate() {
        equations.output(&format!("{at}"), gradient * 1.0);
    }
    let mut state = State::default();
    for (name, seed) in [("a", 1), ("b", 2)] {
        state.insert(name, [3, 4], singles(12, seed));
    }
    let mut processor = Processor::<f32>::new(equations.into_graph());
    processor.run("gradients", &mut state);
    ["0", "1"].map(|name| processor.entries(name).to_vec()).to_vec()
}

fn apply<'e>(extension: Products, a: Expression<'e>, b: Expression<'e>) -> Expression<'e> {
    a.equations().apply(extension, &[a, b])
}

#[test]
fn gradients_pass_through_an_extension_as_through_an_operation() {
    let found = gradients(|[a, b]| apply(FREE, apply(FREE, a, b).tanh(), a));
    assert_eq!(found, gradients(|[a, b]| (a * b).tanh() * a));
}

#[test]
fn a_constant_operand_has_no_gradient() {
    let found = gradients(|[a, b]| apply(CONSTANT, a, a * b) + b);
    assert_eq!(found, gradients(|[a, b]| a * (a * b).stop_gradient() + b));
}

#[test]
fn gradients_agree_with_finite_differences_as_far_as_single_precision_goes() {
    let loss = |graph: &mut Graph, leaves: &[Value], seed| {
        // A step of the difference is 1e-5, so a factor of 1e4 makes it much larger than the rounding of f32.
        let [a, b] = [0, 1].map(|at| graph.scale(leaves[at], 1e4));
        let product = graph.apply(FREE, &[a, b]);
        let product = graph.scale(product, 1e-8);
        weighted_sum(graph, product, seed)
    };
    let error = gradient_error(&loss, &[([3, 4], [0.5, 1.5]), ([3, 4], [0.5, 1.5])], 1);
    assert!(error < 0.02, "{error:e}");
}

/// An update whose gradient passes through an extension that kept its operands, twice.
#[test]
fn an_update_reads_the_values_from_before_it() {
    let equations = Equations::new();
    let (w, x) = (equations.parameter("w", [1, 3]), equations.input("x", [1, 3]));
    equations.routine("update");
    for at in 0..2 {
        let loss = apply(FREE, w, x).square().sum();
        equations.output(&format!("loss {at}"), loss);
        equations.descend(loss, &[w], &Descent::adam("rate", 0.1, None));
    }
    let mut processor = Processor::<f32>::new(equations.into_graph());
    processor.write("x", &[1.0, -1.0, 2.0]);
    let mut state = state_of(&[("w", &[1.0, 1.0, 1.0_f32])]);
    let mut losses = Vec::new();
    for _ in 0..30 {
        processor.run("update", &mut state);
        losses.extend(["loss 0", "loss 1"].map(|name| processor.number(name)));
    }
    assert_eq!((losses[0], state.steps("w")), (6.0, 60));
    assert!(losses[1] < 5.0 && losses[59] < 0.1 * losses[0], "{losses:?}");
}

#[test]
fn an_extension_is_listed_and_counted_and_allocates_once() {
    let mut graph = Graph::new();
    let [a, b] = ["a", "b"].map(|name| graph.input(name, [2, 3]));
    let routine = graph.routine("products");
    let product = graph.apply(FREE, &[a, b]);
    graph.output("y", product);
    let expected = "products: 6 operations, 72 bytes, no kernel for a card computes Products\n  `y` [2, 3] = Products of `a` [2, 3], `b` [2, 3]\n";
    assert_eq!(graph.to_string(), expected);
    let mut processor = Processor::<f32>::new(graph);
    let mut seen = Vec::new();
    processor.run_observed(routine, &mut State::default(), 0, |work, shape| {
        seen.push((work, shape));
    });
    assert_eq!(seen, [(crate::Work::Extension, [2, 3])]);
    let before = processor.capacities();
    processor.run("products", &mut State::default());
    assert_eq!(processor.capacities(), before);
}

#[test]
fn operands_that_do_not_fit_are_refused() {
    let mut graph = Graph::new();
    let (a, b) = (graph.input("a", [2, 3]), graph.input("b", [3, 2]));
    let _ = graph.routine("refused");
    for operands in [vec![a, b], vec![a], vec![]] {
        let refused = panic_of(|| _ = graph.clone().apply(FREE, &operands));
        assert!(refused.starts_with("Products of "), "{refused}");
    }
    let refused = panic_of(|| _ = graph.clone().apply(FREE, &[a, b]));
    assert_eq!(refused, "Products of `a` [2, 3], `b` [3, 2]");
}
