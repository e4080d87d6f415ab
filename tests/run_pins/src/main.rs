//! Computes the digests of pinned trials, and of the functions of the arithmetic over one class of their inputs.
//!
//! usage: run-pins PINS NAME..., where PINS is a file of pins (`tests/pins.rs`). It prints `name digest` for each name, and
//! then for each function.

#[path = "../../datasets.rs"]
mod datasets;
#[path = "../../pins/recorded.rs"]
mod recorded;

use arithmetic::digests::{
    DOUBLE, SINGLE, class, double_summand, log_gamma_summand, normal_summand, single_summand, steps,
};
use contract::{Registry, part::Part};
use serde_json::Value;
use std::{error::Error, fs};

fn main() -> Result<(), Box<dyn Error>> {
    let mut words = std::env::args().skip(1);
    let file = words.next().ok_or("usage: run-pins PINS NAME...")?;
    let pins: Value = serde_json::from_slice(&fs::read(file)?)?;
    let mut registry = Registry::default();
    protocols::register(&mut registry);
    environments::register(&mut registry);
    agents::register(&mut registry);
    for name in words {
        let trial: [Part; 3] = serde_json::from_value(pins[&name]["trial"].clone())?;
        println!("{name} {}", recorded::digest(&registry, &trial)?);
    }
    for (name, digest) in of_arithmetic() {
        println!("{name} {digest:016x}");
    }
    Ok(())
}

/// Names as in `plugins/arithmetic/fixtures/digests.txt`.
fn of_arithmetic() -> impl Iterator<Item = (String, u64)> {
    let single = SINGLE.into_iter().map(|(name, function)| {
        let digest = class(32, 0, |i| single_summand(function, i as u32));
        (format!("f32.{name}"), digest)
    });
    let double = DOUBLE.into_iter().map(|function| {
        let digest = class(28, 0, |i| double_summand(&function, i));
        (format!("f64.{}", function.0), digest)
    });
    let draws = [
        ("normal", normal_summand as fn(u64) -> u64),
        ("log_gamma", log_gamma_summand),
    ];
    let draws = draws.into_iter().map(|(name, summand)| (format!("draw.{name}"), class(24, 0, summand)));
    let steps = steps().into_iter().map(|(name, digest)| (format!("steps.{name}"), digest));
    single.chain(double).chain(draws).chain(steps)
}
