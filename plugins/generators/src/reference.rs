//! Reference values in `tests/fixtures/images`, for tests.

use burn::module::Module;
use burn::tensor::{Tensor, TensorData};
use numerics::network::device;
use numerics::parameters::{parameters, with_parameters};
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

pub fn tensor<const D: usize>(shape: [usize; D], seed: usize) -> Tensor<D> {
    Tensor::from_data(
        TensorData::new(numbers(shape.iter().product(), seed), shape),
        &device(),
    )
}

/// The module with parameters from number `known` on set by the formula.
pub fn by_formula<M: Module>(module: M, seed: usize, known: usize) -> M {
    let mut all = parameters(&module);
    for (at, parameter) in all.iter_mut().enumerate().skip(known) {
        let around = f32::from(u8::from(parameter.name.ends_with("norm.weight")));
        let values = numbers(parameter.values.len(), seed + at);
        parameter.values = values.into_iter().map(|x| around + x / 4.0).collect();
    }
    with_parameters(module, &all).unwrap()
}

/// Asserts that numbers equal those of a thinned list, up to a fraction of the largest or an absolute bound.
pub fn assert_close(found: &[f32], expected: &Value, (relative, absolute): (f64, f64), what: &str) {
    let number = |key: &str| expected[key].as_f64().unwrap();
    assert_eq!(found.len() as f64, number("length"), "{what}");
    let entries: Vec<f64> = expected["entries"]
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect();
    let largest = found.iter().fold(0.0f64, |most, x| most.max(f64::from(x.abs())));
    let allowed = relative * largest + absolute;
    assert_eq!(
        found.iter().step_by(number("step") as usize).count(),
        entries.len(),
        "{what}"
    );
    for (at, (x, entry)) in found
        .iter()
        .step_by(number("step") as usize)
        .zip(&entries)
        .enumerate()
    {
        assert!(
            (f64::from(*x) - entry).abs() < allowed,
            "{what}, entry {at}: {x} {entry}"
        );
    }
    let pairs = found.iter().zip(numbers(found.len(), 9));
    let sum: f64 = pairs.map(|(x, weight)| f64::from(*x) * f64::from(weight)).sum();
    assert!(
        (sum - number("sum")).abs() < allowed * (found.len() as f64).sqrt(),
        "{what}, sum: {sum} {}",
        expected["sum"]
    );
}
