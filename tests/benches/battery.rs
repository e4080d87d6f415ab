//! Simulated cell-seconds per second of the battery environment on one core. usage: battery SECONDS
//!
//! One fresh cell, isothermal, from the middle of its discharge, 10 s a decision, through the registered
//! environment, so that observations, rewards and metrics are paid for too. Prints one line of JSON.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use std::time::Instant;

#[expect(clippy::print_stdout, reason = "a benchmark prints its figure")]
fn main() {
    let seconds: f64 = std::env::args()
        .nth(1)
        .and_then(|word| word.parse().ok())
        .unwrap_or(3.0);
    let registry = plugins::registry();
    let entry = &registry.environments["battery"];
    let config = serde_json::json!({"cells": 4, "load": {"constant": {"power_w": 32.0}}, "start": "full"});
    let mut environment = (entry.build)(&(entry.about.resolve)(&config).unwrap()).unwrap();
    let mut rng = contract::random::stream(&["benchmark"]);
    let (mut cell_seconds, start) = (0u64, Instant::now());
    while start.elapsed().as_secs_f64() < seconds {
        environment.reset(&mut rng).unwrap();
        for _ in 0..100 {
            environment.step(&[vec![0.25; 4]], &mut rng).unwrap();
            cell_seconds += 40;
        }
    }
    let rate = cell_seconds as f64 / start.elapsed().as_secs_f64();
    println!(
        "{}",
        serde_json::json!({"who": "Regimen", "cell_seconds_per_s": rate})
    );
}
