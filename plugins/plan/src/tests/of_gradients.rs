//! Gradients of every operation and of the losses of learners against central differences.

use super::*;
use crate::operations::{Function, Operation, Pair};

const LARGEST_ERROR: f64 = 1e-6;

fn assert_gradients(name: &str, loss: Loss, inputs: &[(Shape, [f64; 2])], seed: u64) {
    let error = gradient_error(loss, inputs, seed);
    assert!(error < LARGEST_ERROR, "{name} {inputs:?} {seed}: {error:e}");
}

/// Functions of one number with intervals without a kink.
const FUNCTIONS: [(Function, [f64; 2]); 33] = [
    (Function::Repeat, [-1.0, 1.0]),
    (Function::Negate, [-1.0, 1.0]),
    (Function::Rectify(0.0), [0.1, 1.0]),
    (Function::Rectify(0.0), [-1.0, -0.1]),
    (Function::Rectify(0.01), [0.1, 1.0]),
    (Function::Rectify(0.01), [-1.0, -0.1]),
    (Function::RectifierSlope(0.2), [0.1, 1.0]),
    (Function::Tanh, [-2.0, 2.0]),
    (Function::OneLessSquare, [-1.0, 1.0]),
    (Function::Exp, [-2.0, 2.0]),
    (Function::Ln, [0.3, 3.0]),
    (Function::Ln1p, [-0.5, 3.0]),
    (Function::Softplus, [-3.0, 3.0]),
    (Function::Sigmoid, [-3.0, 3.0]),
    (Function::Absolute, [0.1, 1.0]),
    (Function::Absolute, [-1.0, -0.1]),
    (Function::Sign, [0.1, 1.0]),
    (Function::Sign, [-1.0, -0.1]),
    (Function::Square, [-1.0, 1.0]),
    (Function::Sqrt, [0.3, 3.0]),
    (Function::Scale(-2.5), [-1.0, 1.0]),
    (Function::Shift(0.3), [-1.0, 1.0]),
    (Function::Clamp(-0.5, 0.5), [-0.4, 0.4]),
    (Function::Clamp(-0.5, 0.5), [0.6, 0.9]),
    (Function::Clamp(-0.5, 0.5), [-0.9, -0.6]),
    (Function::Within(-0.5, 0.5), [-0.4, 0.4]),
    (Function::LnGamma, [0.3, 3.0]),
    (Function::LnGamma, [5.0, 20.0]),
    (Function::Digamma, [0.5, 3.0]),
    (Function::Digamma, [5.0, 20.0]),
    (Function::Tanh, [2.0, 4.0]),
    (Function::Softplus, [4.0, 8.0]),
    (Function::Sigmoid, [-8.0, -4.0]),
];

const PAIRS: [Pair; 8] = [
    Pair::Add,
    Pair::Subtract,
    Pair::Multiply,
    Pair::Divide,
    Pair::Smaller,
    Pair::Larger,
    Pair::Exceeds,
    Pair::AtMost,
];

/// A small multilayer perceptron of `x`, with parameters from `parameters[..4]`.
fn network(graph: &mut Graph, x: Value, parameters: &[Value]) -> Value {
    let hidden = graph.dense(x, parameters[0], parameters[1], Activation::Tanh);
    graph.dense(hidden, parameters[2], parameters[3], Activation::Identity)
}

fn network_inputs(inputs: usize, hidden: usize, outputs: usize) -> [(Shape, [f64; 2]); 4] {
    let one = [-1.0, 1.0];
    [
        ([inputs, hidden], one),
        ([1, hidden], one),
        ([hidden, outputs], one),
        ([1, outputs], one),
    ]
}

/// Action `[rows, n]` and log density `[rows, 1]` of a squashed Gaussian policy with the head `[rows, 2 n]`.
fn squashed(graph: &mut Graph, head: Value, noise: Value) -> (Value, Value) {
    let n = graph.shape(noise)[1];
    let (mean, log_sd) = (graph.columns(head, 0..n), graph.columns(head, n..2 * n));
    let log_sd = graph.clamp(log_sd, -20.0, 5.0);
    let sd = graph.exp(log_sd);
    let spread = graph.mul(sd, noise);
    let candidate = graph.add(mean, spread);
    let square = graph.square(noise);
    let half = graph.scale(square, -0.5);
    let density = graph.sub(half, log_sd);
    // ln(1 - tanh(x)^2) = 2 (ln 2 - x - softplus(-2 x))
    let twice = graph.scale(candidate, -2.0);
    let softplus = graph.softplus(twice);
    let sum = graph.add(candidate, softplus);
    let shifted = graph.shift(sum, -std::f64::consts::LN_2);
    let derivative = graph.scale(shifted, -2.0);
    let terms = graph.sub(density, derivative);
    (graph.tanh(candidate), graph.sum_columns(terms))
}

fn critic_loss(graph: &mut Graph, x: &[Value], _: u64) -> Value {
    let joined = graph.join(&[x[0], x[1]]);
    let losses = [3, 7].map(|first| {
        let value = network(graph, joined, &x[first..]);
        let error = graph.sub(value, x[2]);
        let square = graph.square(error);
        let mean = graph.mean(square);
        graph.scale(mean, 0.5)
    });
    graph.add(losses[0], losses[1])
}

fn policy_loss(graph: &mut Graph, x: &[Value], _: u64) -> Value {
    let head = network(graph, x[0], &x[3..]);
    let (action, log_density) = squashed(graph, head, x[1]);
    let joined = graph.join(&[x[0], action]);
    let values = [7, 11].map(|first| network(graph, joined, &x[first..]));
    // Far from ties: the first critic is the lower one in every other row.
    let rows = graph.shape(x[0])[0];
    let far: Vec<f64> = (0..rows)
        .map(|row| if row % 2 == 0 { 20.0 } else { -20.0 })
        .collect();
    let far = graph.constant([rows, 1], &far);
    let first = graph.add(values[0], far);
    let value = graph.min(first, values[1]);
    let temperature = graph.exp(x[2]);
    let entropy = graph.mul(log_density, temperature);
    let loss = graph.sub(entropy, value);
    graph.mean(loss)
}

/// Cross entropy of the class that an index names.
fn cross_entropy(graph: &mut Graph, x: &[Value], seed: u64) -> Value {
    let logits = network(graph, x[0], &x[1..]);
    let [rows, columns] = graph.shape(logits);
    let index: Vec<f64> = numbers(rows, seed, [0.0, columns as f64])
        .iter()
        .map(|i| i.floor())
        .collect();
    let index = graph.constant([rows, 1], &index);
    let logarithms = graph.log_softmax(logits);
    let chosen = graph.gather(logarithms, index);
    let mean = graph.mean(chosen);
    graph.neg(mean)
}

/// Log density of a Dirichlet policy at points of the simplex, with concentrations `1 + softplus(head)`, and its mean
/// digamma.
fn dirichlet(graph: &mut Graph, x: &[Value], _: u64) -> Value {
    let softplus = graph.softplus(x[0]);
    let concentration = graph.shift(softplus, 1.0);
    let point = graph.softmax(x[1]);
    let logarithm = graph.ln(point);
    let less_one = graph.shift(concentration, -1.0);
    let weighted = graph.mul(less_one, logarithm);
    let of_each = graph.ln_gamma(concentration);
    let terms = graph.sub(weighted, of_each);
    let terms = graph.sum_columns(terms);
    let total = graph.sum_columns(concentration);
    let of_total = graph.ln_gamma(total);
    let density = graph.add(terms, of_total);
    let digamma = graph.digamma(concentration);
    let (density, digamma) = (graph.mean(density), graph.mean(digamma));
    graph.add(density, digamma)
}

/// An operation on one value, by the seed of its constants.
type Build = fn(&mut Graph, Value, u64) -> Value;

fn assert_gradients_of_squares(builds: &[(&str, Build)], shape: Shape, seed: u64) {
    for (name, build) in builds {
        let loss = |graph: &mut Graph, x: &[Value], seed| {
            let y = build(graph, x[0], seed);
            let y = graph.square(y);
            weighted_sum(graph, y, seed)
        };
        assert_gradients(name, &loss, &[(shape, [0.2, 1.0])], seed);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn of_functions(rows in 1..5_usize, columns in 1..5_usize, seed: u64) {
        for (function, limits) in FUNCTIONS {
            let loss = |graph: &mut Graph, x: &[Value], seed| {
                let y = graph.map(function, x[0]);
                weighted_sum(graph, y, seed)
            };
            assert_gradients(&format!("{function:?}"), &loss, &[([rows, columns], limits)], seed);
        }
    }

    #[test]
    fn of_pairs_with_repeated_operands(rows in 1..5_usize, columns in 1..5_usize, which in 0..16_usize, seed: u64) {
        let side = |bit: usize, n| if which >> bit & 1 == 1 { 1 } else { n };
        let shapes = [[side(0, rows), side(1, columns)], [side(2, rows), side(3, columns)]];
        for pair in PAIRS {
            let loss = |graph: &mut Graph, x: &[Value], seed| {
                let y = graph.combine(pair, x[0], x[1]);
                weighted_sum(graph, y, seed)
            };
            // Intervals without ties.
            for limits in [[[0.2, 0.9], [1.0, 2.0]], [[1.0, 2.0], [0.3, 0.9]]] {
                assert_gradients(
                    &format!("{pair:?}"), &loss, &[(shapes[0], limits[0]), (shapes[1], limits[1])], seed,
                );
            }
        }
    }

    #[test]
    fn of_products_and_dense_layers(n in [1..5_usize, 1..5_usize, 1..5_usize], turned: [bool; 2], seed: u64) {
        let [rows, inner, columns] = n;
        let shape = |shape: Shape, turned| if turned { [shape[1], shape[0]] } else { shape };
        let one = [-1.0, 1.0];
        let inputs = [(shape([rows, inner], turned[0]), one), (shape([inner, columns], turned[1]), one)];
        assert_gradients("product", &|graph, x, seed| {
            let y = graph.product(x[0], x[1], turned);
            weighted_sum(graph, y, seed)
        }, &inputs, seed);
        // Positive products, then negative ones, so that no rectifier is at its kink.
        for limits in [[0.1, 1.0], [-1.0, -0.1]] {
            for activation in [Activation::Identity, Activation::Relu, Activation::LeakyRelu, Activation::Tanh] {
                let inputs = [([rows, inner], limits), ([inner, columns], [0.1, 1.0]), ([1, columns], limits)];
                assert_gradients(&format!("{activation:?}"), &|graph, x, seed| {
                    let y = graph.dense(x[0], x[1], x[2], activation);
                    weighted_sum(graph, y, seed)
                }, &inputs, seed);
            }
        }
    }

    #[test]
    fn of_sums_and_means(rows in 1..5_usize, columns in 2..6_usize, seed: u64) {
        let builds: [(&str, Build); 8] = [
            ("sum_rows", |graph, x, _| graph.sum_rows(x)),
            ("sum_columns", |graph, x, _| graph.sum_columns(x)),
            ("sum", |graph, x, _| graph.sum(x)),
            ("mean_rows", |graph, x, _| graph.mean_rows(x)),
            ("mean_columns", |graph, x, _| graph.mean_columns(x)),
            ("mean", |graph, x, _| graph.mean(x)),
            ("softmax", |graph, x, _| graph.softmax(x)),
            ("log_softmax", |graph, x, _| graph.log_softmax(x)),
        ];
        assert_gradients_of_squares(&builds, [rows, columns], seed);
    }

    #[test]
    fn of_moves(rows in 1..5_usize, columns in 2..6_usize, seed: u64) {
        let builds: [(&str, Build); 11] = [
            ("columns", |graph, x, _| graph.columns(x, 1..2)),
            ("place", |graph, x, _| {
                let [rows, columns] = graph.shape(x);
                graph.compute(Operation::Place { first: 2 }, vec![x], [rows, columns + 3])
            }),
            ("join", |graph, x, _| {
                let square = graph.square(x);
                graph.join(&[square, x, square])
            }),
            ("gather", |graph, x, seed| {
                let [rows, columns] = graph.shape(x);
                let index = numbers(rows, seed, [0.0, columns as f64]);
                let index: Vec<f64> = index.iter().map(|i| i.floor()).collect();
                let index = graph.constant([rows, 1], &index);
                graph.gather(x, index)
            }),
            ("scatter", |graph, x, _| {
                let rows = graph.shape(x)[0];
                let index = graph.constant([rows, 1], &vec![1.0; rows]);
                let sums = graph.sum_columns(x);
                graph.compute(Operation::Scatter, vec![sums, index], [rows, 3])
            }),
            ("reshape", |graph, x, _| {
                let [rows, columns] = graph.shape(x);
                graph.reshape(x, [columns, rows])
            }),
            ("repeat_rows", |graph, x, _| graph.repeat_rows(x, 3)),
            ("repeat_rows once", |graph, x, _| graph.repeat_rows(x, 1)),
            ("sum_groups", |graph, x, _| {
                let [rows, columns] = graph.shape(x);
                let column = graph.reshape(x, [rows * columns, 1]);
                graph.sum_groups(column, columns)
            }),
            ("sum_groups of all rows", |graph, x, _| {
                let rows = graph.shape(x)[0];
                graph.sum_groups(x, rows)
            }),
            ("moves of products", |graph, x, _| {
                // Groups of every other row of `x x^T`, weighted.
                let rows = graph.shape(x)[0];
                let twice = graph.repeat_rows(x, 2);
                let product = graph.product(twice, x, [false, true]);
                let weights = graph.constant([2 * rows, 1], &numbers(2 * rows, 3, [0.5, 1.5]));
                let product = graph.mul(product, weights);
                graph.sum_groups(product, 2)
            }),
        ];
        assert_gradients_of_squares(&builds, [rows, columns], seed);
    }

    #[test]
    fn of_learners(rows in 1..6_usize, n in 1..4_usize, hidden in 1..5_usize, seed: u64) {
        let (seen, one) = (3, [-1.0, 1.0]);
        let critic = network_inputs(seen + n, hidden, 1);
        let policy = network_inputs(seen, hidden, 2 * n);
        let data = |width, last: Shape| [([rows, seen], one), ([rows, width], one), (last, one)];
        let critics = [&data(n, [rows, 1])[..], &critic, &critic].concat();
        assert_gradients("critics", &critic_loss, &critics, seed);
        let actor = [&data(n, [1, 1])[..], &policy, &critic, &critic].concat();
        assert_gradients("policy", &policy_loss, &actor, seed);
        let classes = [&[([rows, seen], one)][..], &network_inputs(seen, hidden, n + 1)].concat();
        assert_gradients("cross entropy", &cross_entropy, &classes, seed);
        let simplex = [([rows, n + 1], one), ([rows, n + 1], one)];
        assert_gradients("Dirichlet", &dirichlet, &simplex, seed);
    }

    #[test]
    fn of_dirichlet_distributions(rows in 1..4_usize, n in 1..6_usize, seed: u64) {
        for limits in [[0.3, 0.9], [1.0, 4.0], [4.0, 12.0]] {
            let inputs = [([rows, n], limits), ([rows, n], [-4.0, -0.1])];
            assert_gradients("density", &|graph, x, seed| {
                let y = graph.dirichlet_density(x[0], x[1]);
                let y = graph.square(y);
                weighted_sum(graph, y, seed)
            }, &inputs, seed);
            assert_gradients("density of one operand", &|graph, x, seed| {
                let y = graph.dirichlet_density(x[0], x[0]);
                weighted_sum(graph, y, seed)
            }, &inputs[..1], seed);
            assert_gradients("density at a fixed point", &|graph, x, seed| {
                let points = graph.constant([rows, n], &numbers(rows * n, seed, [-4.0, -0.1]));
                let y = graph.dirichlet_density(x[0], points);
                weighted_sum(graph, y, seed)
            }, &inputs[..1], seed);
            assert_gradients("entropy", &|graph, x, seed| {
                let y = graph.dirichlet_entropy(x[0]);
                weighted_sum(graph, y, seed)
            }, &inputs[..1], seed);
        }
    }

    /// The gradient of a gradient: a penalty on the slope of a network with respect to its input.
    #[test]
    fn of_gradients(rows in 1..4_usize, hidden in 1..5_usize, seed: u64) {
        let inputs = [&[([rows, 2], [-1.0, 1.0])][..], &network_inputs(2, hidden, 1)].concat();
        assert_gradients("penalty", &|graph, x, _| {
            let value = network(graph, x[0], &x[1..]);
            let sum = graph.sum(value);
            let slope = graph.gradients(sum, &x[..1])[0];
            let square = graph.square(slope);
            let norm = graph.sum_columns(square);
            let mean = graph.mean(norm);
            let bias = graph.sum(x[4]);
            graph.add(mean, bias)
        }, &inputs, seed);
    }
}

#[test]
fn ties_go_to_the_first_and_limits_to_the_inside() {
    let mut graph = Graph::new();
    let (a, b) = (graph.input("a", [1, 3]), graph.input("b", [1, 3]));
    let _ = graph.routine("kinks");
    let (low, high) = (graph.min(a, b), graph.max(a, b));
    let held = graph.clamp(a, -1.0, 1.0);
    let less = graph.sub(a, b);
    let distance = graph.abs(less);
    let outputs: Vec<Value> = [low, high, held, distance]
        .into_iter()
        .enumerate()
        .flat_map(|(at, value)| {
            let sum = graph.sum(value);
            let wanted = if at == 2 { vec![a] } else { vec![a, b] };
            graph.gradients(sum, &wanted)
        })
        .collect();
    for (at, value) in outputs.iter().enumerate() {
        graph.output(&format!("g{at}"), *value);
    }
    let mut processor = Processor::<f32>::new(graph);
    processor.write("a", &[1.0, -1.0, 2.0]);
    processor.write("b", &[1.0, 3.0, -3.0]);
    processor.run("kinks", &mut State::default());
    let expected = [
        [1.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, -1.0, 1.0],
        [0.0, 1.0, -1.0],
    ];
    assert_eq!(outputs.len(), expected.len());
    for (at, expected) in expected.into_iter().enumerate() {
        assert_eq!(processor.entries(&format!("g{at}")), expected);
    }
}

#[test]
fn no_gradient_passes_a_stop() {
    let mut graph = Graph::new();
    let x = graph.parameter("x", [1, 2]);
    let _ = graph.routine("stop");
    let stopped = graph.stop_gradient(x);
    let product = graph.mul(x, stopped);
    let loss = graph.sum(product);
    let gradient = graph.gradients(loss, &[x])[0];
    graph.output("gradient", gradient);
    let mut processor = Processor::<f32>::new(graph);
    processor.run("stop", &mut state_of(&[("x", &[3.0, -5.0])]));
    assert_eq!(processor.entries("gradient"), [3.0, -5.0]);
}

#[test]
fn absolute_values_have_no_sign() {
    let mut graph = Graph::new();
    let x = graph.input("x", [1, 5]);
    let _ = graph.routine("absolute");
    let y = graph.abs(x);
    graph.output("y", y);
    let mut processor = Processor::<f32>::new(graph);
    processor.write("x", &[-0.0, 0.0, -2.5, f32::NEG_INFINITY, 3.0]);
    processor.run("absolute", &mut State::default());
    let expected = bits(&[0.0, 0.0, 2.5, f32::INFINITY, 3.0]);
    assert_eq!(bits(processor.entries("y")), expected);
}

#[test]
fn dirichlet_densities_and_entropies_have_known_values() {
    let mut graph = Graph::new();
    let (alpha, log_point) = (graph.input("alpha", [3, 2]), graph.input("ln point", [3, 2]));
    let _ = graph.routine("values");
    let density = graph.dirichlet_density(alpha, log_point);
    let entropy = graph.dirichlet_entropy(alpha);
    graph.output("density", density);
    graph.output("entropy", entropy);
    let mut processor = Processor::<f64>::new(graph);
    processor.write("alpha", &[1.0, 1.0, 2.0, 3.0, 2.0, 3.0]);
    let [half, quarter, rest] = [0.5_f64, 0.25, 0.75].map(f64::ln);
    processor.write("ln point", &[half, half, half, half, quarter, rest]);
    processor.run("values", &mut State::default());
    // The density of Beta(2, 3) is 12 a (1 - a)^2, its entropy is 9/4 - ln 12.
    let expected = [0.0, 1.5_f64.ln(), (27.0_f64 / 16.0).ln()];
    let of_entropy = [0.0, 2.25 - 12_f64.ln(), 2.25 - 12_f64.ln()];
    for (name, expected) in [("density", expected), ("entropy", of_entropy)] {
        for (found, expected) in processor.entries(name).iter().zip(expected) {
            assert!(
                (found - expected).abs() < 1e-14,
                "{name}: {found}, not {expected}"
            );
        }
    }
}

#[test]
fn differences_find_a_wrong_gradient_and_accept_a_right_one() {
    let error = |is_stopped: bool| {
        let mut graph = Graph::new();
        let (x, w) = (graph.input("x", [4, 3]), graph.parameter("w", [3, 2]));
        let target = graph.parameter("target", [3, 2]);
        let _ = graph.routine("loss");
        let noise = graph.normal([4, 2]);
        let y = graph.product(x, w, [false; 2]);
        let y = graph.add(y, noise);
        let other = if is_stopped { graph.stop_gradient(y) } else { y };
        let product = graph.mul(y, other);
        let loss = graph.mean(product);
        graph.output("loss", loss);
        // It changes the state, on which the loss does not depend.
        graph.follow(target, w, 0.5);
        let mut state = State::default();
        state.insert("w", [3, 2], numbers(6, 1, [-1.0, 1.0]));
        state.insert("target", [3, 2], vec![0.0; 6]);
        let inputs = [("x", numbers(12, 2, [-1.0, 1.0]))];
        let error = largest_error(graph, ["loss", "loss"], &["w"], &state, &inputs, 5);
        assert_eq!(state.entries("target"), [0.0; 6]);
        error
    };
    let (right, wrong) = (error(false), error(true));
    assert!(right < 1e-9, "{right:e}");
    // Half of the gradient is stopped, so that the largest entry lacks half of its value.
    assert!((wrong - 1.0).abs() < 1e-6, "{wrong}");
}

#[test]
#[should_panic(expected = "no gradient passes through")]
fn no_gradient_passes_the_slope_of_a_draw() {
    let mut graph = Graph::new();
    let shapes = graph.parameter("shapes", [1, 2]);
    let _ = graph.routine("slope of a slope");
    let draw = graph.log_gamma_draw(shapes);
    let sum = graph.sum(draw);
    let slope = graph.gradients(sum, &[shapes])[0];
    let slopes = graph.sum(slope);
    let _ = graph.gradients(slopes, &[shapes]);
}
