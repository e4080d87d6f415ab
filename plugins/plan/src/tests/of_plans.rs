//! The plan as a text and as counts, states, memory, the order of routines, and what is refused.

use super::*;
use crate::StateError;

/// A small regression with Adam and a target network; its routines in either order.
fn regression(is_update_first: bool) -> (Graph, Routine, Routine) {
    let mut graph = Graph::new();
    let (x, y) = (graph.input("x", [6, 3]), graph.input("y", [6, 2]));
    let (w, b) = (graph.parameter("w", [3, 2]), graph.parameter("b", [1, 2]));
    let target = graph.parameter("target", [3, 2]);
    let rate = graph.number("rate", 0.1);
    let update = |graph: &mut Graph| {
        let routine = graph.routine("update");
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
        routine
    };
    let act = |graph: &mut Graph| {
        let routine = graph.routine("act");
        let action = graph.dense(x, target, b, Activation::Relu);
        graph.output("action", action);
        // Nothing reads it.
        let _ = graph.exp(action);
        routine
    };
    if is_update_first {
        let update = update(&mut graph);
        let act = act(&mut graph);
        (graph, update, act)
    } else {
        let act = act(&mut graph);
        let update = update(&mut graph);
        (graph, update, act)
    }
}

/// A processor with numbers in all leaves.
fn filled(graph: &Graph) -> Processor<f32> {
    let mut processor = Processor::new(graph);
    for (at, name) in ["x", "y", "w", "b", "target"].into_iter().enumerate() {
        let value = graph.named(name).unwrap();
        let [rows, columns] = graph.shape(value);
        processor.write(value, &singles(rows * columns, at as u64));
    }
    processor
}

fn digest(processor: &Processor<f32>, graph: &Graph) -> Vec<(String, Vec<u32>)> {
    let outputs = ["loss", "action"].map(|name| (name, processor.entries(graph.named(name).unwrap())));
    let states = processor.states().map(|(name, _, entries)| (name, entries));
    let mut all: Vec<_> = states
        .chain(outputs)
        .map(|(name, entries)| (name.to_owned(), bits(entries)))
        .collect();
    all.sort();
    all
}

#[test]
fn the_order_of_routines_changes_no_bit() {
    let of = |is_update_first| {
        let (graph, update, act) = regression(is_update_first);
        let mut processor = filled(&graph);
        for _ in 0..5 {
            processor.run(update);
            processor.run(act);
        }
        digest(&processor, &graph)
    };
    assert_eq!(of(true), of(false));
}

#[test]
fn it_learns() {
    let (graph, update, _) = regression(true);
    let (mut processor, loss) = (filled(&graph), graph.named("loss").unwrap());
    processor.run(update);
    let first = processor.entries(loss)[0];
    (0..100).for_each(|_| processor.run(update));
    assert!(processor.entries(loss)[0] < 0.7 * first);
}

#[test]
fn a_restored_plan_continues_to_the_same_bits() {
    let (graph, update, act) = regression(true);
    let mut one = filled(&graph);
    (0..3).for_each(|_| one.run(update));
    let mut other = Processor::<f32>::new(&graph);
    for name in ["x", "y"] {
        let value = graph.named(name).unwrap();
        other.write(value, one.entries(value));
    }
    for (name, _, entries) in one.states() {
        other.restore(name, entries).unwrap();
    }
    for (name, count) in one.counts() {
        other.restore_count(name, count).unwrap();
    }
    for processor in [&mut one, &mut other] {
        processor.run(update);
        processor.run(act);
    }
    assert_eq!(digest(&one, &graph), digest(&other, &graph));
    assert_eq!(other.restore("x", &[]), Err(StateError::Missing("x".into())));
    let error = other.restore("w", &[1.0]).unwrap_err().to_string();
    assert_eq!(error, "1 entries for the state `w` [3, 2]");
    assert!(other.restore_count("w", 1).is_err());
}

#[test]
fn runs_after_the_first_take_no_memory() {
    let (graph, update, act) = regression(true);
    let mut processor = filled(&graph);
    let mut capacities = Vec::new();
    for _ in 0..4 {
        processor.run(update);
        processor.run(act);
        capacities.push(processor.capacities());
    }
    assert!(capacities.windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn an_operation_after_an_update_reads_the_new_entries() {
    let mut graph = Graph::new();
    let (x, y) = (graph.parameter("x", [1, 1]), graph.parameter("y", [1, 1]));
    let routine = graph.routine("assignments");
    let before = graph.scale(x, 2.0);
    graph.assign(x, before);
    let after = graph.scale(x, 2.0);
    graph.assign(y, after);
    graph.output("before", before);
    let mut processor = Processor::<f32>::new(&graph);
    processor.write(x, &[1.0]);
    processor.run(routine);
    assert_eq!(
        [x, before, y].map(|value| processor.entries(value)[0]),
        [2.0, 2.0, 4.0]
    );
}

#[test]
fn a_plan_is_printed_and_counted() {
    let (graph, _, act) = regression(true);
    let text = graph.to_string();
    let act_text = text.split("act: ").nth(1).unwrap();
    let expected = "96 operations, 152 bytes\n  \
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

/// Message of the panic that a building step causes.
fn refusal(build: fn(&mut Graph, [Value; 3])) -> String {
    let mut graph = Graph::new();
    let leaves = [
        graph.input("x", [2, 3]),
        graph.parameter("w", [4, 5]),
        graph.parameter("b", [1, 3]),
    ];
    let _ = graph.routine("first");
    let run = std::panic::AssertUnwindSafe(|| build(&mut graph, leaves));
    let payload = std::panic::catch_unwind(run).unwrap_err();
    let text = payload.downcast_ref::<String>().cloned();
    text.unwrap_or_else(|| (*payload.downcast_ref::<&str>().unwrap()).to_owned())
}

proptest! {
    /// Random entrywise operations, products and sums of earlier values: with the last value alone read, buffers are
    /// shared and loops keep little; with every value read, nothing is shared.
    #[test]
    fn shared_buffers_and_loops_change_no_bit(
        choices in prop::collection::vec((0..9_usize, 0..64_usize, 0..64_usize), 1..40),
        seed: u64,
    ) {
        let of = |is_all_read: bool| {
            let mut graph = Graph::new();
            let x = graph.input("x", [5, 5]);
            let routine = graph.routine("some");
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
                    _ => graph.scale(a, 0.5),
                };
                // Bounded, so that no value becomes infinite.
                values.push(graph.clamp(value, -2.0, 2.0));
            }
            let last = values[values.len() - 1];
            let names = values.iter().skip(1).enumerate();
            names.filter(|(_, value)| is_all_read || **value == last).for_each(|(at, value)| {
                graph.output(&format!("y{at}"), *value);
            });
            let mut processor = Processor::<f32>::new(&graph);
            processor.write(x, &singles(25, seed));
            processor.run(routine);
            processor.run(routine);
            bits(processor.entries(last))
        };
        prop_assert_eq!(of(true), of(false));
    }
}

#[test]
fn plans_that_do_not_fit_are_refused() {
    type Build = fn(&mut Graph, [Value; 3]);
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
    for (expected, build) in cases {
        let text = refusal(build);
        assert!(text.contains(expected), "{expected}: {text}");
    }
}
