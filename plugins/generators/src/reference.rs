//! Reference values in `tests/fixtures/images`, for tests.

use crate::layers::Parameter;
use plan::State;
use serde_json::Value;

pub fn networks() -> Value {
    serde_json::from_str(include_str!("../../../tests/fixtures/images/networks.json")).unwrap()
}

/// The formula of `numbers_and_thinning.py`; every number is exact in `f32`.
pub fn numbers(count: usize, seed: usize) -> Vec<f32> {
    let integer = |i: usize| (i * i * 37 + i * 101 + seed * 53) % 2003;
    (0..count)
        .map(|i| (integer(i) as f32 - 1001.0) / 1024.0)
        .collect()
}

/// Sets parameters from number `known` on by the formula.
pub fn by_formula(parameters: &[Parameter], state: &mut State<f32>, seed: usize, known: usize) {
    for (at, parameter) in parameters.iter().enumerate().skip(known) {
        let around = f32::from(u8::from(parameter.name.ends_with("norm.weight")));
        let own = state.entries_mut(&parameter.name);
        let values = numbers(own.len(), seed + at);
        own.iter_mut()
            .zip(values)
            .for_each(|(own, x)| *own = around + x / 4.0);
    }
}

/// Differences between numbers and those of a thinned list.
pub fn differences(found: &[f32], expected: &Value, what: &str) -> Vec<f64> {
    let number = |key: &str| expected[key].as_f64().unwrap();
    assert_eq!(found.len() as f64, number("length"), "{what}");
    let entries = expected["entries"].as_array().unwrap();
    let thinned: Vec<&f32> = found.iter().step_by(number("step") as usize).collect();
    assert_eq!(thinned.len(), entries.len(), "{what}");
    let pairs = thinned.into_iter().zip(entries);
    pairs
        .map(|(x, entry)| (f64::from(*x) - entry.as_f64().unwrap()).abs())
        .collect()
}

/// Asserts that numbers equal those of a thinned list, up to a fraction of the largest or an absolute bound.
pub fn assert_close(found: &[f32], expected: &Value, (relative, absolute): (f64, f64), what: &str) {
    let largest = found.iter().fold(0.0f64, |most, x| most.max(f64::from(x.abs())));
    let allowed = relative * largest + absolute;
    for (at, difference) in differences(found, expected, what).into_iter().enumerate() {
        assert!(difference < allowed, "{what}, entry {at}: {difference} away");
    }
    let pairs = found.iter().zip(numbers(found.len(), 9));
    let sum: f64 = pairs.map(|(x, weight)| f64::from(*x) * f64::from(weight)).sum();
    assert!(
        (sum - expected["sum"].as_f64().unwrap()).abs() < allowed * (found.len() as f64).sqrt(),
        "{what}, sum: {sum} {}",
        expected["sum"]
    );
}
