//! Kernels for a card, run literally, against the processor, bit by bit.

#![allow(clippy::cast_possible_truncation, reason = "members and entries are few")]

use super::*;
use crate::cuda::literal::{Literal, has_compiler};
use crate::cuda::{Batch, Kernels, NoKernel, size};
use crate::operations::{Function, Pair};
use std::collections::BTreeMap;

#[path = "../../../../tests/skipped.rs"]
mod skipped;

/// Members in memory, and the places of those that run, in their order.
const N_MEMBERS: usize = 4;
const PLACES: [usize; 3] = [3, 0, 2];

/// A member with the entries of its inputs.
#[derive(Clone)]
struct Member {
    state: State<f32>,
    inputs: Vec<f32>,
    seed: u64,
}

/// Asserts that kernels of the routine `all` give members the bits of a run alone on the processor, `n_runs` times.
/// `limits` are those of the entries of leaves, by name.
fn assert_equal_bits(graph: &Graph, n_runs: u64, limits: impl Fn(&str) -> [f64; 2]) {
    if !has_compiler() {
        return skipped::skip("`c++` is not on the path", "`apt-get install g++` installs it");
    }
    let folder = tempfile::tempdir().unwrap();
    let kernels = Kernels::new(graph, graph.routine_named("all").unwrap()).unwrap();
    let literal = Literal::new(&kernels, &folder.path().join("kernels")).unwrap();
    let mut members: Vec<Member> = (0..N_MEMBERS as u64)
        .map(|at| member(&kernels, at, &limits))
        .collect();
    let mut alone = members.clone();
    let mut processor = Processor::<f32>::new(graph.clone());
    for run in 0..n_runs {
        for member in members.iter_mut().chain(&mut alone) {
            member.seed = arithmetic::draws::mix(member.seed + run);
        }
        let outputs = run_together(&kernels, &literal, &mut members);
        let output_size = size(&kernels.outputs);
        for (at, place) in PLACES.into_iter().enumerate() {
            let outputs = &outputs[at * output_size..][..output_size];
            let Member { state, inputs, seed } = &mut alone[place];
            for span in &kernels.inputs {
                processor.write(&span.name, &inputs[span.range()]);
            }
            processor.run_seeded("all", state, *seed);
            for span in &kernels.outputs {
                let (found, expected) = (&outputs[span.range()], processor.entries(&span.name));
                let differs =
                    |(a, b): (&f32, &f32)| a.to_bits() != b.to_bits() && !(a.is_nan() && b.is_nan());
                if let Some(at) = found.iter().zip(expected).position(differs) {
                    let name = &span.name;
                    panic!(
                        "`{name}` of member {place}: entry {at} is {:?}, not {:?}",
                        found[at], expected[at]
                    );
                }
            }
        }
        for (member, alone) in members.iter().zip(&alone) {
            assert_eq!(member.state.counts(), alone.state.counts());
            for (name, _, entries) in alone.state.tensors() {
                assert!(
                    bits(member.state.entries(name)) == bits(entries),
                    "`{name}` after run {run}"
                );
            }
        }
    }
}

#[allow(clippy::cast_possible_truncation, reason = "the nearest f32 is meant")]
fn member(kernels: &Kernels, at: u64, limits: &impl Fn(&str) -> [f64; 2]) -> Member {
    let entries = |name: &str, n, seed| {
        let wide = numbers(n, seed, limits(name));
        wide.into_iter().map(|x| x as f32).collect::<Vec<f32>>()
    };
    let mut state = State::default();
    for (nth, leaf) in kernels
        .tensors
        .iter()
        .enumerate()
        .filter(|(_, leaf)| !leaf.is_moment)
    {
        let n = leaf.shape[0] * leaf.shape[1];
        state.insert(
            &leaf.name,
            leaf.shape,
            entries(&leaf.name, n, at << 20 | nth as u64),
        );
    }
    let inputs = kernels.inputs.iter().enumerate();
    let inputs =
        inputs.flat_map(|(nth, span)| entries(&span.name, span.length, at << 20 | 1 << 10 | nth as u64));
    Member {
        state,
        inputs: inputs.collect(),
        seed: 1000 + at,
    }
}

/// Runs the members at [`PLACES`] at once; tensors lie backwards in the memory, with gaps.
fn run_together(kernels: &Kernels, literal: &Literal, members: &mut [Member]) -> Vec<f32> {
    let runs = PLACES.map(|place| kernels.prepare(&mut members[place].state, members[place].seed));
    let (mut firsts, mut state_size) = (vec![0; kernels.tensors.len()], 0);
    for (first, leaf) in firsts.iter_mut().zip(&kernels.tensors).rev() {
        *first = state_size;
        state_size += (leaf.shape[0] * leaf.shape[1]).next_multiple_of(32) + 32;
    }
    let mut states = vec![0.0; members.len() * state_size];
    for (member, memory) in members.iter().zip(states.chunks_exact_mut(state_size.max(1))) {
        for (leaf, first) in kernels.tensors.iter().zip(&firsts) {
            if let Some((_, entries)) = member.state.tensor(&leaf.name) {
                memory[*first..][..entries.len()].copy_from_slice(entries);
            }
        }
    }
    let outputs = literal.run(
        &mut states,
        &Batch {
            kernels,
            state_size,
            tensors: &firsts.iter().map(|first| *first as u32).collect::<Vec<u32>>(),
            members: &PLACES.map(|place| place as u32),
            runs: &runs.each_ref().map(Vec::as_slice),
            inputs: &PLACES.map(|place| members[place].inputs.as_slice()),
        },
    );
    for (member, memory) in members.iter_mut().zip(states.chunks_exact(state_size.max(1))) {
        for (leaf, first) in kernels.tensors.iter().zip(&firsts) {
            if member.state.tensor(&leaf.name).is_some() {
                let own = member.state.entries_mut(&leaf.name);
                own.copy_from_slice(&memory[*first..][..own.len()]);
            }
        }
    }
    outputs.unwrap()
}

#[test]
fn functions_of_one_number() {
    let mut graph = Graph::new();
    let any = graph.input("any", [7, 300]);
    let above = graph.input("above", [7, 300]);
    let large = graph.input("large", [7, 300]);
    let _ = graph.routine("all");
    type Of = fn(&mut Graph, Value) -> Value;
    let of_any: [(&str, Of); 22] = [
        ("negative", |g, x| g.neg(x)),
        ("rectified", |g, x| g.relu(x)),
        ("leaky", |g, x| g.leaky_relu(x, 0.2)),
        ("tanh", |g, x| g.tanh(x)),
        ("exp", |g, x| g.exp(x)),
        ("ln", |g, x| g.ln(x)),
        ("ln 1p", |g, x| g.ln_1p(x)),
        ("softplus", |g, x| g.softplus(x)),
        ("sigmoid", |g, x| g.sigmoid(x)),
        ("absolute", |g, x| g.abs(x)),
        ("square", |g, x| g.square(x)),
        ("sqrt", |g, x| g.sqrt(x)),
        ("scaled", |g, x| g.scale(x, 0.3)),
        ("shifted", |g, x| g.shift(x, -1e-8)),
        ("clamped", |g, x| g.clamp(x, -0.7, 1.1)),
        ("stopped", |g, x| g.stop_gradient(x)),
        ("softmax", |g, x| g.softmax(x)),
        ("log softmax", |g, x| g.log_softmax(x)),
        ("sign", |g, x| g.map(Function::Sign, x)),
        ("within", |g, x| g.map(Function::Within(-0.5, 2.0), x)),
        ("slope", |g, x| g.map(Function::RectifierSlope(0.2), x)),
        ("less square", |g, x| g.map(Function::OneLessSquare, x)),
    ];
    for (of, value) in [("any", any), ("above", above), ("large", large)] {
        for (name, function) in of_any {
            let result = function(&mut graph, value);
            graph.output(&format!("{name} of {of}"), result);
        }
    }
    let of_above: [(&str, Of); 3] = [
        ("ln gamma", |g, x| g.ln_gamma(x)),
        ("digamma", |g, x| g.digamma(x)),
        ("trigamma", |g, x| g.map(Function::Trigamma, x)),
    ];
    for (name, function) in of_above {
        for (of, value) in [("above", above), ("large", large)] {
            let result = function(&mut graph, value);
            graph.output(&format!("{name} of {of}"), result);
        }
    }
    assert_equal_bits(&graph, 2, |name| match name {
        "any" => [-3.0, 3.0],
        "above" => [1e-3, 12.0],
        _ => [-120.0, 120.0],
    });
}

#[test]
fn functions_of_two_numbers_with_rows_and_columns_repeated() {
    let mut graph = Graph::new();
    let x = graph.input("x", [13, 40]);
    let others = [
        ("whole", [13, 40]),
        ("row", [1, 40]),
        ("column", [13, 1]),
        ("one", [1, 1]),
    ]
    .map(|(name, shape)| (name, graph.parameter(name, shape)));
    let _ = graph.routine("all");
    type Of = fn(&mut Graph, Value, Value) -> Value;
    let functions: [(&str, Of); 8] = [
        ("sum", |g, a, b| g.add(a, b)),
        ("difference", |g, a, b| g.sub(a, b)),
        ("product", |g, a, b| g.mul(a, b)),
        ("quotient", |g, a, b| g.div(a, b)),
        ("smaller", |g, a, b| g.min(a, b)),
        ("larger", |g, a, b| g.max(a, b)),
        ("exceeds", |g, a, b| g.combine(Pair::Exceeds, a, b)),
        ("at most", |g, a, b| g.combine(Pair::AtMost, a, b)),
    ];
    for (of, other) in others {
        for (name, function) in functions {
            let forth = function(&mut graph, x, other);
            let back = function(&mut graph, other, forth);
            graph.output(&format!("{name} with {of}"), forth);
            graph.output(&format!("{of} by {name}"), back);
        }
    }
    assert_equal_bits(&graph, 1, |_| [-1.0, 1.0]);
}

#[test]
fn products_of_every_tile_with_edges_and_long_chains() {
    let mut graph = Graph::new();
    let shapes = [
        [150, 300, 140],
        [70, 40, 66],
        [130, 20, 9],
        [9, 33, 130],
        [3, 1030, 5],
        [1, 1, 1],
        [17, 513, 1],
    ];
    let operands = shapes.map(|[rows, inner, columns]| {
        let name = format!("{rows} {inner} {columns}");
        let a = graph.input(&format!("a {name}"), [rows, inner]);
        let b = graph.parameter(&format!("b {name}"), [inner, columns]);
        let bias = graph.parameter(&format!("bias {name}"), [1, columns]);
        let a_turned = graph.input(&format!("a turned {name}"), [inner, rows]);
        let b_turned = graph.input(&format!("b turned {name}"), [columns, inner]);
        (name, a, b, bias, a_turned, b_turned)
    });
    let _ = graph.routine("all");
    for (at, (name, a, b, bias, a_turned, b_turned)) in operands.into_iter().enumerate() {
        let activations = [
            Activation::Relu,
            Activation::LeakyRelu,
            Activation::Tanh,
            Activation::Identity,
        ];
        let results = [
            graph.dense(a, b, bias, activations[at % 4]),
            graph.product(a_turned, b, [true, false]),
            graph.product(a, b_turned, [false, true]),
            graph.product(a_turned, b_turned, [true, true]),
        ];
        for (kind, result) in results.into_iter().enumerate() {
            graph.output(&format!("{kind} {name}"), result);
        }
    }
    assert_equal_bits(&graph, 1, |_| [-1.0, 1.0]);
}

#[test]
fn sums_and_moves() {
    let mut graph = Graph::new();
    let x = graph.input("x", [1100, 12]);
    let column = graph.input("column", [1100, 1]);
    let y = graph.input("y", [6, 9]);
    let index = graph.parameter("index", [6, 1]);
    let _ = graph.routine("all");
    let positions = graph.place_of_largest(y);
    let results = [
        graph.sum(x),
        graph.sum_rows(x),
        graph.sum_columns(x),
        graph.sum_groups(x, 5),
        graph.largest_of_columns(x),
        graph.place_of_largest(x),
        graph.ranked(x, 4),
        graph.join(&[x, column, x]),
        graph.columns(x, 3..7),
        graph.gather(y, positions),
        graph.reshape(x, [12, 1100]),
        graph.repeat_rows(y, 3),
        graph.sum(column),
        graph.mean_rows(x),
        graph.mean_columns(y),
    ];
    for (at, result) in results.into_iter().enumerate() {
        graph.output(&format!("result {at}"), result);
    }
    // Gradients add scattered and placed entries.
    let (part, gathered) = (graph.columns(y, 2..5), graph.gather(y, positions));
    let (part, gathered) = (graph.mul(part, part), graph.mul(gathered, index));
    let (part, gathered) = (graph.sum(part), graph.sum(gathered));
    let loss = graph.add(part, gathered);
    for (at, gradient) in graph.gradients(loss, &[y, index]).into_iter().enumerate() {
        graph.output(&format!("gradient {at}"), gradient);
    }
    assert_equal_bits(&graph, 1, |_| [-1.0, 1.0]);
}

#[test]
fn draws_and_dirichlet_distributions() {
    let mut graph = Graph::new();
    let shapes = graph.input("shapes", [40, 6]);
    let small = graph.parameter("small", [40, 6]);
    let huge = graph.parameter("huge", [40, 6]);
    let _ = graph.routine("all");
    let (normal, uniform) = (graph.normal([40, 31]), graph.uniform([40, 31]));
    graph.output("normal", normal);
    graph.output("uniform", uniform);
    for (name, concentrations) in [("shapes", shapes), ("small", small), ("huge", huge)] {
        let draw = graph.log_gamma_draw(concentrations);
        let point = graph.log_softmax(draw);
        let (density, entropy) = (
            graph.dirichlet_density(concentrations, point),
            graph.dirichlet_entropy(concentrations),
        );
        let both = graph.add(density, entropy);
        let loss = graph.sum(both);
        for (of, value) in [("draw", draw), ("density", density), ("entropy", entropy)] {
            graph.output(&format!("{of} of {name}"), value);
        }
        let gradient = graph.gradients(loss, &[concentrations])[0];
        graph.output(&format!("gradient of {name}"), gradient);
    }
    assert_equal_bits(&graph, 2, |name| match name {
        "shapes" => [0.1, 30.0],
        "small" => [1e-3, 1.5],
        _ => [1e5, 3e6],
    });
}

#[test]
fn steps_of_optimisers_with_clipped_gradients() {
    let mut graph = Graph::new();
    let shapes = [[1, 3], [60, 41], [1025, 1030]];
    let [parameters, gradients] = ["parameter", "gradient"].map(|kind| {
        shapes.map(|shape| {
            let name = format!("{kind} {shape:?}");
            if kind == "parameter" {
                graph.parameter(&name, shape)
            } else {
                graph.input(&name, shape)
            }
        })
    });
    let target = graph.parameter("target", shapes[1]);
    let copy = graph.parameter("copy", shapes[0]);
    let rate = graph.number("learning rate", 3e-4);
    let _ = graph.routine("all");
    let clipped = graph.clip_norm(&gradients, 0.5);
    for (parameter, gradient) in parameters.into_iter().zip(clipped) {
        graph.adam(parameter, gradient, Optimiser::new(rate));
    }
    graph.adam(
        parameters[0],
        gradients[0],
        Optimiser {
            learning_rate: rate,
            betas: [0.5, 0.9],
        },
    );
    graph.follow(target, parameters[1], 0.005);
    graph.assign(copy, parameters[0]);
    assert_equal_bits(&graph, 3, |_| [-1.0, 1.0]);
}

#[test]
fn an_operation_of_another_crate_has_no_kernel() {
    let mut graph = Graph::new();
    let (a, b) = (graph.input("a", [2, 2]), graph.input("b", [2, 2]));
    let routine = graph.routine("all");
    let product = graph.apply(of_extensions::Products { is_constant: false }, &[a, b]);
    graph.output("product", product);
    let found = Kernels::new(&graph, routine).map(|kernels| kernels.waves.len());
    assert_eq!(
        found,
        Err(NoKernel {
            operation: "Products".into()
        })
    );
}

/// Independent operations share a wave, and an update waits for everything that reads the parameter before it.
#[test]
fn waves_keep_the_order_of_reads_and_writes() {
    let mut graph = Graph::new();
    let (x, w) = (graph.input("x", [8, 8]), graph.parameter("w", [8, 8]));
    let routine = graph.routine("all");
    let products = [0; 3].map(|_| graph.product(x, w, [false; 2]));
    graph.assign(w, products[0]);
    let after = graph.product(x, w, [false; 2]);
    for (name, value) in ["a", "b", "c"].iter().zip(products) {
        graph.output(name, value);
    }
    graph.output("after", after);
    let kernels = Kernels::new(&graph, routine).unwrap();
    let blocks: Vec<usize> = kernels.waves.iter().map(|wave| wave.blocks).collect();
    assert_eq!(blocks, [3, 1, 1]);
    assert_equal_bits(&graph, 2, |_| [-1.0, 1.0]);
    let names: BTreeMap<_, _> = kernels
        .tensors
        .iter()
        .map(|leaf| (&leaf.name, leaf.is_changed))
        .collect();
    assert_eq!(names, BTreeMap::from([(&"w".to_owned(), true)]));
}
