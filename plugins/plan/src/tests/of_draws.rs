//! Draws of a plan: the dependences of an entry, moments, and the slope of log-gamma draws.

use super::*;
use arithmetic::draws::{self, GOLDEN, Stream, WordStream, mix};
use arithmetic::gamma::{digamma, trigamma};
use arithmetic::gamma_slope::log_gamma_slope;

const NAMES: [&str; 4] = ["normal", "uniform", "log gamma", "second normal"];

/// A plan with four draws of a shape; the log-gamma draw has the parameter `shapes` `[1, columns]`.
fn plan<T: Scalar>([rows, columns]: Shape) -> Processor<T> {
    let mut graph = Graph::new();
    let shapes = graph.parameter("shapes", [1, columns]);
    let _ = graph.routine("draws");
    let (normal, uniform) = (graph.normal([rows, columns]), graph.uniform([rows, columns]));
    let all = graph.repeat_rows(shapes, rows);
    let log_gamma = graph.log_gamma_draw(all);
    let second = graph.normal([rows, columns]);
    for (name, value) in NAMES.into_iter().zip([normal, uniform, log_gamma, second]) {
        graph.output(name, value);
    }
    Processor::new(graph)
}

/// Draws by the names of [`NAMES`].
fn drawn<T: Scalar>(shape: Shape, seed: u64) -> [Vec<T>; 4] {
    let mut processor = plan::<T>(shape);
    let shapes: Vec<T> = [0.25, 1.0, 7.5]
        .iter()
        .cycle()
        .take(shape[1])
        .map(|a| T::of(*a))
        .collect();
    processor.run_seeded("draws", &mut state_of(&[("shapes", &shapes)]), seed);
    NAMES.map(|name| processor.entries(name).to_vec())
}

#[test]
fn an_entry_is_the_same_for_any_number_of_rows() {
    let [few, many] = [3, 700].map(|rows| drawn::<f32>([rows, 3], 11));
    for (few, many) in few.iter().zip(&many) {
        assert_eq!(bits(few), bits(&many[..9]));
    }
}

#[test]
fn an_entry_has_the_stream_of_its_seed_draw_and_place() {
    let seed = 99;
    let found = drawn::<f64>([4, 3], seed);
    let stream = |draw: u64, entry: u64| {
        let first = mix(seed + draw.wrapping_mul(GOLDEN));
        Stream::new(first.wrapping_add((entry + 1).wrapping_mul(GOLDEN)))
    };
    for entry in 0..12 {
        let place = usize::try_from(entry).unwrap();
        let shape = [0.25, 1.0, 7.5][place % 3];
        let expected = [
            draws::normal(stream(1, entry).word()),
            draws::uniform(stream(2, entry).word()),
            draws::log_gamma(shape, &mut stream(3, entry)),
            draws::normal(stream(4, entry).word()),
        ];
        assert_eq!([0, 1, 2, 3].map(|draw: usize| found[draw][place]), expected);
    }
    // The numbers of `f32` are the nearest ones.
    for (single, double) in drawn::<f32>([4, 3], seed)
        .iter()
        .flatten()
        .zip(found.iter().flatten())
    {
        assert_eq!(*single, <f32 as Scalar>::of(*double));
    }
}

#[test]
fn draws_and_seeds_differ_and_a_seed_repeats() {
    let (one, other) = (drawn::<f32>([5, 3], 1), drawn::<f32>([5, 3], 2));
    assert_eq!(one, drawn::<f32>([5, 3], 1));
    for (one, other) in one.iter().zip(&other) {
        assert!(one.iter().zip(other).all(|(a, b)| a != b), "seeds");
    }
    let pairs = one[0].iter().zip(&one[3]);
    assert!(pairs.into_iter().all(|(a, b)| a != b), "draws of a routine");
    let mut sorted = [&one[0][..], &one[3]].concat();
    sorted.sort_by(f32::total_cmp);
    assert!(sorted.windows(2).all(|pair| pair[0] < pair[1]), "entries");
}

#[test]
fn a_draw_that_nothing_reads_moves_no_other() {
    let of = |is_read: bool| {
        let mut graph = Graph::new();
        let _ = graph.routine("draws");
        let (first, second) = (graph.uniform([2, 2]), graph.uniform([2, 2]));
        graph.output("second", second);
        if is_read {
            graph.output("first", first);
        }
        let mut processor = Processor::<f32>::new(graph);
        processor.run_seeded("draws", &mut State::default(), 3);
        bits(processor.entries("second"))
    };
    assert_eq!(of(true), of(false));
}

/// Asserts that the mean of numbers is within four standard errors of the expected one.
fn assert_mean(name: &str, numbers: &[f64], expected: f64) {
    let n = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / n;
    let variance = numbers.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
    let error = (mean - expected).abs() / (variance / n).sqrt();
    assert!(
        error < 4.0,
        "{name}: {mean}, not {expected}, {error} standard errors"
    );
}

#[test]
fn moments_are_right() {
    let [normal, uniform, _, second] = drawn::<f64>([40_000, 3], 5);
    let powers = |x: &[f64], power| x.iter().map(|x| x.powi(power)).collect::<Vec<f64>>();
    for (power, of_normal, of_uniform) in [
        (1, 0.0, 1.0 / 2.0),
        (2, 1.0, 1.0 / 3.0),
        (3, 0.0, 1.0 / 4.0),
        (4, 3.0, 1.0 / 5.0),
    ] {
        assert_mean(&format!("normal^{power}"), &powers(&normal, power), of_normal);
        assert_mean(
            &format!("second normal^{power}"),
            &powers(&second, power),
            of_normal,
        );
        assert_mean(&format!("uniform^{power}"), &powers(&uniform, power), of_uniform);
    }
    let products = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<f64>>();
    assert_mean("normal and second normal", &products(&normal, &second), 0.0);
    assert_mean("neighbouring columns", &products(&normal[1..], &normal), 0.0);
    assert_mean("neighbouring rows", &products(&normal[3..], &normal), 0.0);
    let of_next_seed = &drawn::<f64>([40_000, 3], 6)[0];
    assert_mean("neighbouring seeds", &products(&normal, of_next_seed), 0.0);
}

/// The means of a log-gamma draw and of its slope are digamma and its derivative.
#[test]
fn log_gamma_draws_have_the_mean_and_the_slope_of_digamma() {
    for shape in [0.05, 0.4, 1.0, 3.0, 80.0] {
        let mut graph = Graph::new();
        let shapes = graph.parameter("shape", [1, 1]);
        let _ = graph.routine("draws");
        let all = graph.repeat_rows(shapes, 20_000);
        let draw = graph.log_gamma_draw(all);
        let sum = graph.sum(draw);
        let gradients = graph.gradients(sum, &[all, shapes]);
        for (name, value) in ["draw", "slopes", "slope"]
            .into_iter()
            .zip([draw, gradients[0], gradients[1]])
        {
            graph.output(name, value);
        }
        let mut processor = Processor::<f64>::new(graph);
        processor.run_seeded("draws", &mut state_of(&[("shape", &[shape])]), 8);
        let (draws, slopes) = (processor.entries("draw"), processor.entries("slopes"));
        for (draw, slope) in draws.iter().zip(slopes) {
            assert_eq!(*slope, log_gamma_slope(shape, *draw));
        }
        assert_mean(&format!("shape {shape}"), draws, digamma(shape));
        assert_mean(&format!("slope at {shape}"), slopes, trigamma(shape));
        let total: f64 = slopes.iter().sum();
        assert!((processor.number("slope") / total - 1.0).abs() < 1e-12);
    }
}

/// The slope passes through the operations before and after the draw: that of `sum w ln x` with shapes `softplus(y)`.
#[test]
fn the_slope_of_a_log_gamma_draw_is_a_factor_of_the_chain_rule() {
    let (shape, entries) = ([4, 3], numbers(12, 1, [-3.0, 4.0]));
    let mut graph = Graph::new();
    let y = graph.parameter("y", shape);
    let _ = graph.routine("loss");
    let shapes = graph.softplus(y);
    let draw = graph.log_gamma_draw(shapes);
    let loss = weighted_sum(&mut graph, draw, 2);
    let gradient = graph.gradients(loss, &[y])[0];
    for (name, value) in [("shapes", shapes), ("draw", draw), ("gradient", gradient)] {
        graph.output(name, value);
    }
    let mut processor = Processor::<f64>::new(graph);
    let mut state = State::default();
    state.insert("y", shape, entries.clone());
    let weights = numbers(12, !2, [0.5, 1.5]);
    for seed in 0..20 {
        processor.run_seeded("loss", &mut state, seed);
        let of = |name| processor.entries(name);
        for at in 0..12 {
            let slope = log_gamma_slope(of("shapes")[at], of("draw")[at]);
            let expected = weights[at] * slope / (1.0 + (-entries[at]).exp());
            let found = of("gradient")[at];
            assert!(
                (found / expected - 1.0).abs() < 1e-13,
                "seed {seed}: {found}, not {expected}"
            );
        }
    }
}

#[test]
fn a_vanishing_shape_has_an_infinite_draw_and_slope() {
    let mut graph = Graph::new();
    let shapes = graph.parameter("shapes", [1, 2]);
    let _ = graph.routine("draw");
    let draw = graph.log_gamma_draw(shapes);
    let sum = graph.sum(draw);
    let slope = graph.gradients(sum, &[shapes])[0];
    let copy = graph.scale(slope, 1.0);
    graph.output("draw", draw);
    graph.output("slope", copy);
    let mut processor = Processor::<f32>::new(graph);
    processor.run_seeded("draw", &mut state_of(&[("shapes", &[1e-42, 0.0])]), 4);
    assert_eq!(processor.entries("draw")[0], f32::NEG_INFINITY);
    assert_eq!(processor.entries("slope")[0], f32::INFINITY);
    assert!(processor.entries("draw")[1].is_nan() && processor.entries("slope")[1].is_nan());
}

/// The first uniform number at this seed is 1 - 2.5e-9, which `f32` would round to 1.
#[test]
fn uniform_numbers_are_below_one() {
    let mut graph = Graph::new();
    let _ = graph.routine("draw");
    let draw = graph.uniform([1, 1]);
    graph.output("draw", draw);
    let (mut single, mut double) = (Processor::<f32>::new(graph.clone()), Processor::<f64>::new(graph));
    single.run_seeded("draw", &mut State::default(), 65_552_721);
    double.run_seeded("draw", &mut State::default(), 65_552_721);
    assert_eq!(double.number("draw"), 0.999_999_997_493_561);
    assert_eq!(single.entries("draw"), [1.0 - f32::EPSILON / 2.0]);
}

#[test]
fn a_routine_that_draws_needs_a_seed() {
    let mut processor = plan::<f32>([2, 1]);
    let mut state = state_of(&[("shapes", &[1.0])]);
    let refused = panic_of(|| processor.run("draws", &mut state));
    assert!(
        refused.contains("`draws` draws numbers and needs a seed"),
        "{refused}"
    );
    processor.run_seeded("draws", &mut state, 0);
}
