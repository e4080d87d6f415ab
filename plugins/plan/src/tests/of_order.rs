//! Operations that depend on the order of the entries of a row.

#![allow(
    clippy::redundant_closure_for_method_calls,
    reason = "a path of the method has one lifetime, the closure has any"
)]

use super::*;
use crate::{Equations, Expression};

/// An operation on the rows of three columns.
fn of_rows(rows: &[f64], compute: impl for<'e> Fn(Expression<'e>) -> Expression<'e>) -> Vec<f64> {
    let equations = Equations::new();
    let x = equations.input("x", [rows.len() / 3, 3]);
    equations.routine("order");
    equations.output("y", compute(x));
    let mut processor = Processor::<f64>::new(equations.into_graph());
    processor.write("x", rows);
    processor.run("order", &mut State::default());
    processor.entries("y").to_vec()
}

#[test]
fn the_place_of_the_largest_entry_is_the_first_of_equals() {
    let rows = [
        [1.0, 3.0, 2.0],
        [5.0, 5.0, 5.0],
        [-2.0, -1.0, -1.0],
        [f64::NEG_INFINITY, 0.0, f64::INFINITY],
        [f64::NAN, 1.0, 2.0],
        [1.0, f64::NAN, 2.0],
    ];
    let places = of_rows(rows.as_flattened(), |x| x.place_of_largest());
    assert_eq!(places, [1.0, 0.0, 1.0, 2.0, 0.0, 2.0]);
}

#[test]
fn the_place_of_the_largest_entry_gathers_it() {
    let rows = numbers(60, 4, [-1.0, 1.0]);
    let gathered = of_rows(&rows, |x| x.gather(x.place_of_largest()));
    assert_eq!(gathered, of_rows(&rows, |x| x.largest_of_columns()));
}

#[test]
fn ranks_are_those_of_the_sorted_row() {
    let mut rows = numbers(60, 5, [-1.0, 1.0]);
    rows[4] = rows[3];
    for rank in 0..3 {
        let expected: Vec<f64> = rows
            .chunks(3)
            .map(|row| {
                let mut row = row.to_vec();
                row.sort_by(f64::total_cmp);
                row[rank]
            })
            .collect();
        assert_eq!(of_rows(&rows, |x| x.ranked(rank)), expected);
    }
    let text = panic_of(|| {
        let _ = of_rows(&rows, |x| x.ranked(3));
    });
    assert!(text.contains("rank 3 of `x` [20, 3]"), "{text}");
}

/// The places and ranked entries do not change if an entry moves a little, and a ranked one is a constant of the
/// gradient.
#[test]
fn no_gradient_passes_an_order() {
    let equations = Equations::new();
    let x = equations.parameter("x", [2, 3]);
    equations.routine("loss");
    let loss = (x * x.ranked(1)).sum() + x.gather(x.place_of_largest()).sum();
    let gradient = equations.gradients(loss, &[x])[0];
    equations.output("gradient", gradient);
    let mut state = State::default();
    state.insert("x", [2, 3], vec![1.0, 4.0, 2.0, 9.0, 8.0, 7.0]);
    let mut processor = Processor::<f64>::new(equations.into_graph());
    processor.run("loss", &mut state);
    assert_eq!(processor.entries("gradient"), [2.0, 3.0, 2.0, 9.0, 8.0, 8.0]);
}
