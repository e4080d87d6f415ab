//! The plan as a text and as counts, states, memory, the order of routines, and what is refused.

use super::*;
use crate::operations::Function;

/// A small regression with Adam and a target network; its routines `update` and `act` in either order.
pub(super) fn regression(is_update_first: bool) -> Graph {
    let mut graph = Graph::new();
    let (x, y) = (graph.input("x", [6, 3]), graph.input("y", [6, 2]));
    let (w, b) = (graph.parameter("w", [3, 2]), graph.parameter("b", [1, 2]));
    let target = graph.parameter("target", [3, 2]);
    let rate = graph.number("rate", 0.1);
    let update = |graph: &mut Graph| {
        let _ = graph.routine("update");
        let found = graph.dense(x, w, b, Activation::Tanh);
        let error = graph.sub(found, y);
        let square = graph.square(error);
        let loss = graph.mean(square);
        graph.output("loss", loss);
        let gradients = graph.gradients(loss, &[w, b]);
        let clipped = graph.clip_norm(&gradients, 0.5);
        for (parameter, gradient) in [w, b].into_iter().zip(clipped) {
            graph.adam(parameter, gradient, Optimiser::new(rate));
        }
        graph.follow(target, w, 0.5);
    };
    let act = |graph: &mut Graph| {
        let _ = graph.routine("act");
        let action = graph.dense(x, target, b, Activation::Relu);
        graph.output("action", action);
        // Its result is never read.
        let _ = graph.exp(action);
    };
    let order: [&dyn Fn(&mut Graph); 2] = if is_update_first {
        [&update, &act]
    } else {
        [&act, &update]
    };
    order.into_iter().for_each(|add| add(&mut graph));
    graph
}

/// A processor with numbers in all inputs, and a state with numbers in all parameters.
pub(super) fn filled(graph: &Graph) -> (Processor<f32>, State<f32>) {
    let (mut processor, mut state) = (Processor::new(graph.clone()), State::default());
    for (at, name) in ["x", "y", "w", "b", "target"].into_iter().enumerate() {
        let shape = graph.shape(graph.named(name).unwrap());
        let entries = singles(shape[0] * shape[1], at as u64);
        match name {
            "x" | "y" => processor.write(name, &entries),
            _ => state.insert(name, shape, entries),
        }
    }
    (processor, state)
}

/// Bits of all parameters, moments and outputs.
pub(super) fn digest(processor: &Processor<f32>, state: &State<f32>) -> Vec<(String, Vec<u32>)> {
    let outputs = ["loss", "action"].map(|name| (name, processor.entries(name)));
    let tensors = state.tensors().map(|(name, _, entries)| (name, entries));
    let mut all: Vec<_> = tensors
        .chain(outputs)
        .map(|(name, entries)| (name.to_owned(), bits(entries)))
        .collect();
    all.sort();
    all
}

#[test]
fn the_order_of_routines_changes_no_bit() {
    let of = |is_update_first| {
        let (mut processor, mut state) = filled(&regression(is_update_first));
        for _ in 0..5 {
            processor.run("update", &mut state);
            processor.run("act", &mut state);
        }
        digest(&processor, &state)
    };
    assert_eq!(of(true), of(false));
}

#[test]
fn it_learns() {
    let (mut processor, mut state) = filled(&regression(true));
    processor.run("update", &mut state);
    let first = processor.number("loss");
    (0..100).for_each(|_| processor.run("update", &mut state));
    assert!(processor.number("loss") < 0.7 * first);
}

#[test]
fn runs_after_the_first_take_no_memory() {
    let (mut processor, mut state) = filled(&regression(true));
    let mut capacities = Vec::new();
    for _ in 0..4 {
        processor.run("update", &mut state);
        processor.run("act", &mut state);
        let of_state: Vec<*const f32> = state.tensors().map(|(_, _, entries)| entries.as_ptr()).collect();
        capacities.push((processor.capacities(), of_state));
    }
    assert!(capacities.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn an_operation_after_an_update_reads_the_new_entries() {
    let mut graph = Graph::new();
    let (x, y) = (graph.parameter("x", [1, 1]), graph.parameter("y", [1, 1]));
    let _ = graph.routine("assignments");
    let before = graph.scale(x, 2.0);
    graph.assign(x, before);
    let after = graph.scale(x, 2.0);
    graph.assign(y, after);
    graph.output("before", before);
    let mut processor = Processor::<f32>::new(graph);
    let mut state = state_of(&[("x", &[1.0]), ("y", &[0.0])]);
    processor.run("assignments", &mut state);
    let found = [
        state.entries("x"),
        processor.entries("before"),
        state.entries("y"),
    ];
    assert_eq!(found.map(|entries| entries[0]), [2.0, 2.0, 4.0]);
}

#[test]
fn a_second_factor_may_change_between_products() {
    let mut graph = Graph::new();
    let (x, w) = (graph.input("x", [2, 3]), graph.input("w", [3, 2]));
    let v = graph.parameter("v", [2, 2]);
    let _ = graph.routine("products");
    let once = graph.product(x, w, [false; 2]);
    let product = graph.product(once, v, [false; 2]);
    graph.output("before", product);
    graph.assign(v, product);
    let product = graph.product(once, v, [false; 2]);
    graph.output("after", product);
    let mut processor = Processor::<f32>::new(graph.clone());
    let mut state = State::default();
    state.insert("v", [2, 2], singles(4, 3));
    for seed in 0..4 {
        let mut fresh = Processor::<f32>::new(graph.clone());
        let (x, w) = (singles(6, seed / 2), singles(6, 9 + seed));
        for processor in [&mut processor, &mut fresh] {
            processor.write("x", &x);
            processor.input("w").copy_from_slice(&w);
        }
        let mut other = state.clone();
        processor.run("products", &mut state);
        fresh.run("products", &mut other);
        for name in ["before", "after"] {
            assert_eq!(
                bits(processor.entries(name)),
                bits(fresh.entries(name)),
                "{name} {seed}"
            );
        }
        assert_eq!(bits(state.entries("v")), bits(other.entries("v")));
        assert_eq!(bits(state.entries("v")), bits(processor.entries("before")));
    }
}

#[test]
fn draws_are_printed_without_operands() {
    let mut graph = Graph::new();
    let _ = graph.routine("draws");
    let (normal, uniform) = (graph.normal([2, 3]), graph.uniform([2, 3]));
    graph.output("normal", normal);
    graph.output("uniform", uniform);
    let expected = "draws: 12 operations, 48 bytes, kernels for a card: 1\n  \
        `normal` [2, 3] = Normal { index: 1 }\n  \
        `uniform` [2, 3] = Uniform { index: 2 }\n";
    assert_eq!(graph.to_string(), expected);
}

#[test]
fn parameters_and_numbers_of_one_name_are_one() {
    let mut graph = Graph::new();
    let w = graph.parameter("w", [2, 3]);
    assert_eq!(graph.parameter("w", [2, 3]), w);
    let rate = graph.number("rate", 0.1);
    assert_eq!(graph.number("rate", 0.1), rate);
    assert_ne!(graph.number("other rate", 0.1), rate);
    for refused in [
        panic_of(|| _ = graph.clone().parameter("w", [3, 2])),
        panic_of(|| _ = graph.clone().input("w", [2, 3])),
    ] {
        assert_eq!(refused, "two values named `w`");
    }
}

#[test]
fn a_plan_is_printed_and_counted() {
    let graph = regression(true);
    let (text, act) = (graph.to_string(), graph.routine_named("act").unwrap());
    let act_text = text.split("act: ").nth(1).unwrap();
    let expected = "96 operations, 152 bytes, kernels for a card: 1\n  \
        `action` [6, 2] = Dense(Relu) of `x` [6, 3], `target` [3, 2], `b` [1, 2]\n";
    assert_eq!(act_text, expected);
    // 6 x 2 entries of 3 products, a bias and an activation; 18 + 6 + 2 + 12 numbers.
    assert_eq!(
        (graph.flops(act), graph.bytes(act)),
        (12 * (2 * 3 + 2), 4 * (18 + 6 + 2 + 12))
    );
    for line in [
        "Product tn of `x` [6, 3], %",
        "`w` [3, 2] <- Adam by %",
        "`target` [3, 2] <- Follow `w` [3, 2], tau 0.5",
        "ClipScale { largest: 0.5 } of %",
    ] {
        assert!(text.contains(line), "{line}\n{text}");
    }
}

/// A step of building with `x` `[2, 3]`, `w` `[4, 5]` and `b` `[1, 3]`.
type Build = fn(&mut Graph, [Value; 3]);

/// Asserts that each step panics with a message.
fn assert_refused(cases: &[(&str, Build)]) {
    for (expected, build) in cases {
        let mut graph = Graph::new();
        let leaves = [
            graph.input("x", [2, 3]),
            graph.parameter("w", [4, 5]),
            graph.parameter("b", [1, 3]),
        ];
        let _ = graph.routine("first");
        let text = panic_of(|| build(&mut graph, leaves));
        assert!(text.contains(expected), "{expected}: {text}");
    }
}

#[test]
fn a_product_and_its_gate_are_one_kernel_if_nothing_else_reads_the_product() {
    let observed = |is_product_read: bool| {
        let mut graph = Graph::new();
        let (x, w) = (graph.input("x", [7, 5]), graph.input("w", [5, 5]));
        let routine = graph.routine("gate");
        let before = graph.tanh(x);
        let hidden = graph.product(before, w, [false; 2]);
        let product = graph.product(before, w, [false, true]);
        let slope = graph.map(Function::RectifierSlope(0.25), hidden);
        let gated = graph.mul(product, slope);
        graph.output("gated", gated);
        if is_product_read {
            graph.output("product", product);
        }
        let mut processor = Processor::<f32>::new(graph);
        processor.write("x", &singles(35, 1));
        processor.write("w", &singles(25, 2));
        let mut n_kernels = 0;
        processor.run_observed(routine, &mut State::default(), 0, |_, _| n_kernels += 1);
        (n_kernels, bits(processor.entries("gated")))
    };
    let (joined, apart) = (observed(false), observed(true));
    assert_eq!([joined.0, apart.0], [3, 4]);
    assert_eq!(joined.1, apart.1);
}

proptest! {
    /// Random entrywise operations, products, gates and sums of earlier values. If only the last value is read, buffers
    /// are shared, loops keep little and products have gates; if every value is read, nothing is shared or joined.
    #[test]
    fn shared_buffers_and_loops_change_no_bit(
        choices in prop::collection::vec((0..10_usize, 0..64_usize, 0..64_usize), 1..40),
        seed: u64,
    ) {
        let of = |is_all_read: bool| {
            let mut graph = Graph::new();
            let x = graph.input("x", [5, 5]);
            let _ = graph.routine("some");
            let mut values = vec![x];
            for (kind, first, second) in &choices {
                let (a, b) = (values[first % values.len()], values[second % values.len()]);
                let value = match kind {
                    0 => graph.add(a, b),
                    1 => graph.sub(a, b),
                    2 => graph.min(a, b),
                    3 => graph.tanh(a),
                    4 => graph.product(a, b, [false, true]),
                    5 => graph.product(a, b, [true, false]),
                    6 => {
                        let row = graph.sum_rows(b);
                        graph.add(row, a)
                    }
                    7 => {
                        let column = graph.mean_columns(a);
                        graph.mul(b, column)
                    }
                    8 => {
                        let product = graph.product(a, b, [false; 2]);
                        values.push(product);
                        let slope = graph.map(Function::RectifierSlope(0.25), a);
                        let gated = graph.mul(product, slope);
                        // Without a move the limits below would be in the loop of the gate.
                        graph.reshape(gated, [5, 5])
                    }
                    _ => graph.scale(a, 0.5),
                };
                // Bounded, so that no value becomes infinite.
                values.push(graph.clamp(value, -2.0, 2.0));
            }
            let last = values.len() - 1;
            let names = values.iter().enumerate().skip(1);
            names.filter(|(at, _)| is_all_read || *at == last).for_each(|(at, value)| {
                graph.output(&format!("y{at}"), *value);
            });
            let mut processor = Processor::<f32>::new(graph);
            processor.write("x", &singles(25, seed));
            for _ in 0..2 {
                processor.run("some", &mut State::default());
            }
            bits(processor.entries(&format!("y{last}")))
        };
        prop_assert_eq!(of(true), of(false));
    }
}

#[test]
fn moves_and_densities_that_do_not_fit_are_refused() {
    let cases: [(&str, Build); 5] = [
        ("Reshape of `x` [2, 3] to [4, 2]", |graph, [x, _, _]| {
            let _ = graph.reshape(x, [4, 2]);
        }),
        ("groups of 3 rows of `w` [4, 5]", |graph, [_, w, _]| {
            let _ = graph.sum_groups(w, 3);
        }),
        ("a value [0, 5] without entries", |graph, [_, w, _]| {
            let _ = graph.repeat_rows(w, 0);
        }),
        (
            "Dirichlet density of `x` [2, 3] at `b` [1, 3]",
            |graph, [x, _, b]| {
                let _ = graph.dirichlet_density(x, b);
            },
        ),
        ("two values named `b.first`", |graph, [_, _, b]| {
            let gradient = graph.input("b.first", [1, 3]);
            let rate = graph.number("rate", 0.1);
            graph.adam(b, gradient, Optimiser::new(rate));
        }),
    ];
    assert_refused(&cases);
}

#[test]
fn plans_that_do_not_fit_are_refused() {
    let cases: [(&str, Build); 13] = [
        (
            "Dense of `x` [2, 3] with weight `w` [4, 5] and bias `b` [1, 3]",
            |graph, [x, w, b]| {
                let _ = graph.dense(x, w, b, Activation::Relu);
            },
        ),
        ("Product of `x` [2, 3] and `w` [4, 5]", |graph, [x, w, _]| {
            let _ = graph.product(x, w, [false; 2]);
        }),
        ("Add of `x` [2, 3] and `w` [4, 5]", |graph, [x, w, _]| {
            let _ = graph.add(x, w);
        }),
        ("Join of `w` [4, 5] with 2 rows", |graph, [x, w, _]| {
            let _ = graph.join(&[x, w]);
        }),
        ("columns 2..4 of `x` [2, 3]", |graph, [x, _, _]| {
            let _ = graph.columns(x, 2..4);
        }),
        ("Gather of `x` [2, 3] by `b` [1, 3]", |graph, [x, _, b]| {
            let _ = graph.gather(x, b);
        }),
        ("Follow of `w` [4, 5] by `x` [2, 3]", |graph, [x, w, _]| {
            graph.follow(w, x, 0.5);
        }),
        ("Assign of `x` [2, 3] by `x` [2, 3]", |graph, [x, _, _]| {
            graph.assign(x, x);
        }),
        ("two values named `x`", |graph, _| {
            let _ = graph.input("x", [1, 1]);
        }),
        ("`empty` [0, 1] has no entries", |graph, _| {
            let _ = graph.input("empty", [0, 1]);
        }),
        ("does not depend on `w` [4, 5]", |graph, [x, w, _]| {
            let loss = graph.sum(x);
            let _ = graph.gradients(loss, &[w]);
        }),
        ("of another routine", |graph, [x, _, _]| {
            let y = graph.exp(x);
            let _ = graph.routine("second");
            let _ = graph.exp(y);
        }),
        ("`b` [1, 3] has been updated since", |graph, [_, _, b]| {
            let square = graph.mul(b, b);
            let loss = graph.sum(square);
            graph.assign(b, square);
            let _ = graph.gradients(loss, &[b]);
        }),
    ];
    assert_refused(&cases);
}
