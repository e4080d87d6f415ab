//! Results in `f32` against the definitions of [`arithmetic`], bit by bit.

use super::*;
use arithmetic::products::{self, Matrix};
use arithmetic::{single, steps};

fn matrix(values: &[f32], shape: Shape, is_turned: bool) -> Matrix<'_> {
    let matrix = Matrix::new(values, shape[0], shape[1]);
    if is_turned { matrix.transposed() } else { matrix }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn products_and_dense_layers(
        rows in 1..40_usize,
        inner in prop_oneof![1..20_usize, 500..530_usize, Just(1030)],
        columns in 1..70_usize,
        turned: [bool; 2],
        seed: u64,
    ) {
        let shape = |shape: Shape, turned| if turned { [shape[1], shape[0]] } else { shape };
        let shapes = [shape([rows, inner], turned[0]), shape([inner, columns], turned[1])];
        let [a, b] = [0, 1].map(|at| singles(shapes[at][0] * shapes[at][1], seed ^ at as u64));
        let bias = singles(columns, !seed);
        let mut graph = Graph::new();
        let [x, w] = [("x", shapes[0]), ("w", shapes[1])].map(|(name, shape)| graph.input(name, shape));
        let c = graph.parameter("c", [1, columns]);
        let _ = graph.routine("products");
        let product = graph.product(x, w, turned);
        graph.output("product", product);
        let dense = [Activation::Relu, Activation::LeakyRelu, Activation::Tanh].map(|activation| {
            (turned == [false; 2]).then(|| {
                let (value, name) = (graph.dense(x, w, c, activation), format!("{activation:?}"));
                graph.output(&name, value);
                name
            })
        });
        let mut processor = Processor::<f32>::new(graph);
        for (name, entries) in [("x", &a), ("w", &b)] {
            processor.write(name, entries);
        }
        processor.run("products", &mut state_of(&[("c", &bias)]));
        let expected = products::product(matrix(&a, shapes[0], turned[0]), matrix(&b, shapes[1], turned[1]));
        prop_assert_eq!(bits(processor.entries("product")), bits(&expected));
        let functions: [fn(f32) -> f32; 3] = [
            |x| if x <= 0.0 { 0.0 * x } else { x },
            |x| if x <= 0.0 { 0.01 * x } else { x },
            single::tanh,
        ];
        for (name, function) in dense.into_iter().zip(functions) {
            let biases = bias.iter().cycle();
            let layer: Vec<f32> = expected.iter().zip(biases).map(|(z, b)| function(z + b)).collect();
            if let Some(name) = name {
                prop_assert_eq!(bits(processor.entries(&name)), bits(&layer));
            }
        }
    }

    #[test]
    fn sums(rows in prop_oneof![1..40_usize, 500..1100_usize], columns in 1..40_usize, turned: bool, seed: u64) {
        let shape = if turned { [columns, rows] } else { [rows, columns] };
        let entries = singles(rows * columns, seed);
        let mut graph = Graph::new();
        let x = graph.input("x", shape);
        let _ = graph.routine("sums");
        let names = ["rows", "columns", "all"];
        for (name, value) in names.into_iter().zip([graph.sum_rows(x), graph.sum_columns(x), graph.sum(x)]) {
            graph.output(name, value);
        }
        let mut processor = Processor::<f32>::new(graph);
        processor.write("x", &entries);
        processor.run("sums", &mut State::default());
        let [of_rows, of_columns, of_all] = names.map(|name| bits(processor.entries(name)));
        let matrix = matrix(&entries, shape, false);
        prop_assert_eq!(of_rows, bits(&products::row_sums(matrix)));
        prop_assert_eq!(of_columns, bits(&products::row_sums(matrix.transposed())));
        prop_assert_eq!(of_all, bits(&[products::sum(&entries)]));
    }

    #[test]
    fn functions_in_a_loop(rows in 1..60_usize, columns in 1..30_usize, seed: u64) {
        let (entries, row, column) =
            (singles(rows * columns, seed), singles(columns, !seed), singles(rows, seed ^ 5));
        let mut graph = Graph::new();
        let x = graph.input("x", [rows, columns]);
        let (b, c) = (graph.input("b", [1, columns]), graph.input("c", [rows, 1]));
        let _ = graph.routine("functions");
        let sum = graph.add(x, b);
        let product = graph.mul(c, sum);
        let tangent = graph.tanh(product);
        let power = graph.exp(tangent);
        let quotient = graph.div(power, x);
        graph.output("tangent", tangent);
        graph.output("quotient", quotient);
        let mut processor = Processor::<f32>::new(graph);
        for (name, entries) in [("x", &entries), ("b", &row), ("c", &column)] {
            processor.write(name, entries);
        }
        processor.run("functions", &mut State::default());
        let of = |at: usize| single::tanh(column[at / columns] * (entries[at] + row[at % columns]));
        let tangents: Vec<f32> = (0..rows * columns).map(of).collect();
        let quotients: Vec<f32> = tangents.iter().zip(&entries).map(|(t, x)| single::exp(*t) / x).collect();
        prop_assert_eq!(bits(processor.entries("tangent")), bits(&tangents));
        prop_assert_eq!(bits(processor.entries("quotient")), bits(&quotients));
    }

    #[test]
    fn steps_of_optimisers(n in [1..300_usize, 1..40_usize], largest in 0.01..3.0_f64, seed: u64) {
        let mut graph = Graph::new();
        let of = |graph: &mut Graph, name: &str, n| (graph.parameter(name, [1, n]), graph.input(&format!("of {name}"), [1, n]));
        let [(x, of_x), (y, of_y)] = [("x", n[0]), ("y", n[1])].map(|(name, n)| of(&mut graph, name, n));
        let target = graph.parameter("target", [1, n[0]]);
        let rate = graph.number("learning rate", 0.0);
        let _ = graph.routine("update");
        let clipped = graph.clip_norm(&[of_x, of_y], largest);
        let settings = Optimiser { learning_rate: rate, betas: [0.8, 0.99] };
        graph.adam(x, clipped[0], settings);
        graph.adam(y, clipped[1], settings);
        graph.follow(target, x, 0.005);
        let mut processor = Processor::<f32>::new(graph);
        let mut parameters = [singles(n[0], seed), singles(n[1], !seed)];
        let mut average = singles(n[0], seed ^ 9);
        let mut state = state_of(&[("x", &parameters[0]), ("y", &parameters[1]), ("target", &average)]);
        let mut moments = parameters.clone().map(|x| [vec![0.0; x.len()], vec![0.0; x.len()]]);
        for t in 1..4 {
            let learning_rate = 0.01 / t as f64;
            let mut gradients = [singles(n[0], seed + t), singles(n[1], !seed - t)];
            processor.write("of x", &gradients[0]);
            processor.write("of y", &gradients[1]);
            state.set_number("learning rate", learning_rate);
            processor.run("update", &mut state);
            let [one, two] = &mut gradients;
            steps::clip(&mut [one, two], largest);
            for ((x, g), [first, second]) in parameters.iter_mut().zip(&gradients).zip(&mut moments) {
                steps::Rates::at(t, learning_rate, [0.8, 0.99]).descend(x, g, first, second);
            }
            steps::follow(&mut average, &parameters[0], 0.005);
        }
        prop_assert_eq!(bits(state.entries("x")), bits(&parameters[0]));
        prop_assert_eq!(bits(state.entries("y")), bits(&parameters[1]));
        prop_assert_eq!(bits(state.entries("target")), bits(&average));
        for (name, [first, second]) in ["x", "y"].into_iter().zip(&moments) {
            prop_assert_eq!(bits(state.entries(&format!("{name}.first"))), bits(first));
            prop_assert_eq!(bits(state.entries(&format!("{name}.second"))), bits(second));
        }
        prop_assert_eq!(["x", "y", "target"].map(|name| state.steps(name)), [3, 3, 0]);
        prop_assert_eq!(state.counts().len(), 2);
    }
}
