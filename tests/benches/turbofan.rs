//! Seconds per warm steady point of a turbofan on one core. usage: turbofan SECONDS
//!
//! The engine is `hbtf` as estimators read it, at 35 000 ft and Mach 0.8 with a given turbine inlet temperature;
//! each point begins at the last one's solution and loses a little efficiency of the high-pressure turbine. Then
//! the same over the samples of a whole flight, condition after condition. Prints one line of JSON.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use environments::turbofan::{EngineName, FlightCondition, HealthParameter, Model, SensorModel};
use std::{hint::black_box, time::Instant};

const CRUISE: FlightCondition = FlightCondition {
    altitude_m: 10_668.0,
    mach: 0.8,
    delta_t_k: 0.0,
    turbine_inlet_temperature_k: 2857.0 / 1.8,
};

#[expect(clippy::print_stdout, reason = "a benchmark prints its figure")]
fn main() {
    let seconds: f64 = std::env::args()
        .nth(1)
        .and_then(|word| word.parse().ok())
        .unwrap_or(3.0);
    let at_cruise = |point: u64| (CRUISE, -1e-4 * (point % 100) as f64);
    // A climb of 600 samples to the cruise and back, as a unit's flight has it.
    let in_flight = |point: u64| {
        let part = (point % 1200) as f64 / 600.0;
        let height = if part < 1.0 { part } else { 2.0 - part };
        let condition = FlightCondition {
            altitude_m: 3048.0 + height * (10_668.0 - 3048.0),
            mach: 0.45 + height * 0.35,
            turbine_inlet_temperature_k: 1450.0 + height * 137.0,
            ..CRUISE
        };
        (condition, -0.01 * height)
    };
    println!(
        "{}",
        serde_json::json!({
            "who": "Regimen",
            "s_per_point": s_per_point(seconds, at_cruise),
            "s_per_flight_point": s_per_point(seconds, in_flight),
        })
    );
}

fn s_per_point(seconds: f64, asked: impl Fn(u64) -> (FlightCondition, f64)) -> f64 {
    let sensors = ["t24_k", "p30_pa", "t48_k", "n2_rpm", "fuel_flow_kg_s"].map(String::from);
    let calibrated = [HealthParameter::HptEfficiency];
    let mut engine = SensorModel::new(EngineName::Hbtf, &Model::Engine, &calibrated, &sensors).unwrap();
    let (mut points, start) = (0, Instant::now());
    while start.elapsed().as_secs_f64() < seconds {
        for _ in 0..1000 {
            let (condition, theta) = asked(points);
            black_box(engine.read(&condition, &[theta]).unwrap());
            points += 1;
        }
    }
    start.elapsed().as_secs_f64() / points as f64
}
