//! Operators and methods of expressions against plain arithmetic and against the graph that they write.

use super::*;
use crate::equations::Descent;
use crate::{Equations, Expression};

/// An expression of `x`, and the function that it has to be.
type Case = (
    &'static str,
    for<'e> fn(Expression<'e>, Expression<'e>) -> Expression<'e>,
    fn(f64, f64) -> f64,
);

const CASES: [Case; 29] = [
    ("x + y", |x, y| x + y, |x, y| x + y),
    ("x - y", |x, y| x - y, |x, y| x - y),
    ("y - x", |x, y| y - x, |x, y| y - x),
    ("x y", |x, y| x * y, |x, y| x * y),
    ("x / y", |x, y| x / y, |x, y| x / y),
    ("y / x", |x, y| y / x, |x, y| y / x),
    ("x + c", |x, _| x + 0.7, |x, _| x + 0.7),
    ("c + x", |x, _| 0.7 + x, |x, _| 0.7 + x),
    ("x - c", |x, _| x - 0.7, |x, _| x - 0.7),
    ("c - x", |x, _| 0.7 - x, |x, _| 0.7 - x),
    ("x c", |x, _| x * 0.7, |x, _| x * 0.7),
    ("c x", |x, _| 0.7 * x, |x, _| 0.7 * x),
    ("x / c", |x, _| x / 0.7, |x, _| x * (1.0 / 0.7)),
    ("c / x", |x, _| 0.7 / x, |x, _| 0.7 / x),
    ("-x", |x, _| -x, |x, _| -x),
    ("min", |x, y| x.min(y), f64::min),
    ("max", |x, y| x.max(y), f64::max),
    ("relu", |x, _| x.relu(), |x, _| x.max(0.0)),
    ("abs", |x, _| x.abs(), |x, _| x.abs()),
    ("square", |x, _| x.square(), |x, _| x * x),
    ("sqrt", |_, y| y.sqrt(), |_, y| y.sqrt()),
    ("clamp", |x, _| x.clamp(-0.5, 0.3), |x, _| x.clamp(-0.5, 0.3)),
    ("tanh", |x, _| x.tanh(), |x, _| arithmetic::double::tanh(x)),
    ("exp", |x, _| x.exp(), |x, _| arithmetic::double::exp(x)),
    ("ln", |_, y| y.ln(), |_, y| arithmetic::double::ln(y)),
    ("ln_1p", |_, y| y.ln_1p(), |_, y| arithmetic::double::ln_1p(y)),
    (
        "ln_gamma",
        |_, y| y.ln_gamma(),
        |_, y| arithmetic::gamma::ln_gamma(y),
    ),
    (
        "digamma",
        |_, y| y.digamma(),
        |_, y| arithmetic::gamma::digamma(y),
    ),
    (
        "all at once",
        |x, y| 1.0 - (2.0 * x - y) * -x / 0.5,
        |x, y| 1.0 - (2.0 * x - y) * -x / 0.5,
    ),
];

#[test]
fn operators_are_those_of_plain_arithmetic() {
    let equations = Equations::new();
    let (x, y) = (equations.input("x", [3, 4]), equations.input("y", [3, 4]));
    let _ = equations.routine("cases");
    for (name, expression, _) in CASES {
        equations.output(name, expression(x, y));
    }
    let mut processor = Processor::<f64>::new(equations.into_graph());
    let (x, y) = (numbers(12, 1, [-2.0, 2.0]), numbers(12, 2, [0.2, 2.0]));
    processor.write("x", &x);
    processor.write("y", &y);
    processor.run("cases", &mut State::default());
    for (name, _, function) in CASES {
        let expected: Vec<f64> = x.iter().zip(&y).map(|(x, y)| function(*x, *y)).collect();
        assert_eq!(processor.entries(name), expected, "{name}");
    }
}

#[test]
fn a_constant_quotient_is_within_a_rounding_of_the_exact_one() {
    let equations = Equations::new();
    let x = equations.input("x", [1, 64]);
    let _ = equations.routine("quotient");
    equations.output("y", x / 3.0);
    let mut processor = Processor::<f64>::new(equations.into_graph());
    let x = numbers(64, 1, [-2.0, 2.0]);
    processor.write("x", &x);
    processor.run("quotient", &mut State::default());
    for (y, x) in processor.entries("y").iter().zip(x) {
        assert!((y / (x / 3.0) - 1.0).abs() <= f64::EPSILON);
    }
}

#[test]
fn operands_with_one_row_or_column_are_repeated() {
    let equations = Equations::new();
    let (x, row) = (
        equations.input("x", [2, 2]),
        equations.constant([1, 2], &[10.0, 20.0]),
    );
    let _ = equations.routine("repeated");
    let column = x.sum_columns();
    assert_eq!(
        (column.shape(), column.n_rows(), column.n_columns()),
        ([2, 1], 2, 1)
    );
    equations.output("y", row + x * column);
    let mut processor = Processor::<f32>::new(equations.into_graph());
    processor.write("x", &[1.0, 2.0, 3.0, 4.0]);
    processor.run("repeated", &mut State::default());
    assert_eq!(processor.entries("y"), [13.0, 26.0, 31.0, 48.0]);
}

/// The regression of `of_plans` in equations is the same plan, operation by operation.
#[test]
fn equations_write_the_plan_that_methods_of_the_graph_write() {
    let equations = Equations::new();
    let (x, y) = (equations.input("x", [6, 3]), equations.input("y", [6, 2]));
    let (w, b) = (equations.parameter("w", [3, 2]), equations.parameter("b", [1, 2]));
    let target = equations.parameter("target", [3, 2]);
    let _ = equations.routine("update");
    let loss = (x.dense(w, b, Activation::Tanh) - y).square().mean();
    equations.output("loss", loss);
    equations.descend(loss, &[w, b], &Descent::adam("rate", 0.1, Some(0.5)));
    equations.follow(&[target], &[w], 0.5);
    let _ = equations.routine("act");
    let action = equations
        .input("x of actions", [1, 3])
        .dense(target, b, Activation::Relu);
    equations.output("action", action);
    equations.assign(b, action);
    let graph = equations.into_graph();
    let update = |graph: &Graph| graph.to_string().split("act: ").next().unwrap().to_owned();
    let expected = update(&of_plans::regression(true));
    let strip = |text: &str| {
        let words = text.split_whitespace().filter(|word| !word.starts_with('%'));
        words.map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(strip(&update(&graph)), strip(&expected));
    assert!(graph.to_string().contains("`b` [1, 2] <- `action` [1, 2]"));
}

/// Results of the moves of `[[1, 2, 3], [6, 5, 4]]`.
const MOVED: [(&str, &[f64]); 13] = [
    ("join", &[2.0, 3.0, 1.0, 2.0, 3.0, 5.0, 4.0, 6.0, 5.0, 4.0]),
    ("reshape", &[9.0, 12.0]),
    (
        "repeat_rows",
        &[1.0, 2.0, 3.0, 1.0, 2.0, 3.0, 6.0, 5.0, 4.0, 6.0, 5.0, 4.0],
    ),
    ("sum_groups", &[14.0, 14.0, 14.0]),
    ("gather", &[3.0, 6.0]),
    ("largest", &[3.0, 6.0]),
    ("mean_rows", &[3.5, 3.5, 3.5]),
    ("mean_columns", &[2.0, 5.0]),
    ("sum", &[21.0]),
    ("product", &[14.0, 28.0, 28.0, 77.0]),
    ("stopped", &[1.0, 2.0, 3.0, 6.0, 5.0, 4.0]),
    ("draws", &[0.0, 0.0]),
    ("gradients", &[1.0, 2.0, 3.0, 6.0, 5.0, 4.0]),
];

#[test]
fn methods_of_equations_move_sum_and_draw() {
    let equations = Equations::new();
    let x = equations.input("x", [2, 3]);
    let _ = equations.routine("moves");
    let index = equations.constant([2, 1], &[2.0, 0.0]);
    for (name, value) in [
        ("join", equations.join(&[x.columns(1..3), x])),
        ("reshape", x.reshape([3, 2]).sum_rows()),
        ("repeat_rows", x.repeat_rows(2)),
        ("sum_groups", x.repeat_rows(2).sum_groups(4)),
        ("gather", x.gather(index)),
        ("largest", x.largest_of_columns()),
        ("mean_rows", x.mean_rows()),
        ("mean_columns", x.mean_columns()),
        ("sum", x.sum()),
        ("product", x.product(x, [false, true])),
        ("softmax", x.softmax().sum_columns()),
        ("log_softmax", x.log_softmax().exp().sum_columns()),
        ("stopped", x.stop_gradient()),
        (
            "draws",
            equations.normal([1, 2]) * 0.0 + equations.uniform([1, 2]) * 0.0,
        ),
        (
            "gradients",
            equations.gradients((x * x.stop_gradient()).sum(), &[x])[0] * 1.0,
        ),
    ] {
        equations.output(name, value);
    }
    let mut processor = Processor::<f64>::new(equations.into_graph());
    processor.write("x", &[1.0, 2.0, 3.0, 6.0, 5.0, 4.0]);
    processor.run_seeded("moves", &mut State::default(), 1);
    for (name, expected) in MOVED {
        let found = processor.entries(name);
        assert_eq!(found.len(), expected.len(), "{name}");
        let is_near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14);
        assert!(is_near, "{name}: {found:?}");
    }
    for name in ["softmax", "log_softmax"] {
        assert!(
            processor
                .entries(name)
                .iter()
                .all(|sum| (sum - 1.0).abs() < 1e-14),
            "{name}"
        );
    }
}

#[test]
fn groups_of_parameters_that_do_not_fit_are_refused() {
    let equations = Equations::new();
    let (w, b) = (equations.parameter("w", [1, 1]), equations.parameter("b", [1, 1]));
    let _ = equations.routine("update");
    let refused = panic_of(|| equations.follow(&[w, b], &[w], 0.5));
    assert!(refused.contains("parameters that follow"), "{refused}");
    let descent = Descent::adam("rate", 0.1, None);
    let refused = panic_of(|| equations.step_against(&[w.square()], &[w, b], &descent));
    assert!(refused.contains("gradients and parameters"), "{refused}");
}
