//! Tests that every estimator finds the health of an engine with good sensors.

use super::*;
use contract::{Agent, Environment as _, Mode, random::stream};
use environments::turbofan::calibration::{CalibrationConfig, TurbofanCalibration};
use serde_json::json;

fn registry() -> Registry {
    let mut registry = Registry::default();
    register(&mut registry);
    registry
}

fn built(name: &str, config: &serde_json::Value, problem: &TurbofanCalibration) -> Box<dyn Agent> {
    let registry = registry();
    let entry = &registry.agents[name];
    (entry.build)(
        &config.clone().into(),
        &problem.interface(),
        &mut stream(&["estimator"]),
    )
    .unwrap()
}

fn problem(config: serde_json::Value) -> TurbofanCalibration {
    let config: CalibrationConfig = serde_json::from_value(config).unwrap();
    TurbofanCalibration::new(config).unwrap()
}

/// Root mean squared error over the second half of a unit's life.
fn error_of(agent: &mut dyn Agent, problem: &mut TurbofanCalibration, unit: u64) -> f64 {
    let (mut rng, mut agent_rng) = (stream(&["life"]), stream(&["agent"]));
    let mut seen = problem.reset_to(unit, &mut rng).unwrap();
    agent.restart();
    let mut squares = Vec::new();
    loop {
        let theta = problem.state();
        let observation = Observation {
            seats: seen,
            state: Vec::new(),
        };
        let action = agent
            .act(&[observation], Mode::Evaluate, &mut agent_rng)
            .unwrap()
            .remove(0);
        let limits = problem.state_channels();
        let chosen = action[0].iter().zip(&limits).map(|(unit, channel)| {
            (channel.low + channel.high) / 2.0 + (channel.high - channel.low) / 2.0 * unit
        });
        let off = theta
            .iter()
            .zip(chosen)
            .map(|(x, y)| (x - y).powi(2))
            .sum::<f64>();
        squares.push(off / theta.len() as f64);
        let step = problem.step(&action, &mut rng).unwrap();
        seen = step.observations;
        if step.end.is_some() {
            break;
        }
    }
    let late = &squares[squares.len() / 2..];
    (late.iter().sum::<f64>() / late.len() as f64).sqrt()
}

fn lives(snr_db: Option<f64>) -> serde_json::Value {
    json!({
        "trajectory": "units", "sensor_snr_db": snr_db,
        "fleet": { "units": 2, "degradation": { "life": { "cycles": 30, "samples": 5 } } },
    })
}

#[test]
fn estimators_find_the_health_of_an_engine_with_good_sensors() {
    for (name, most) in [
        ("unscented_kalman_filter", 3e-4),
        ("extended_kalman_filter", 3e-4),
        ("particle_filter", 1e-3),
        ("least_squares", 6e-4),
    ] {
        let mut problem = problem(lives(Some(70.0)));
        let config = match name {
            "particle_filter" => json!({ "walk_sd": 5e-4, "noise": 1e-3 }),
            "least_squares" => json!({ "window": 3 }),
            _ => json!({ "walk_sd": 3e-4, "noise": 3.2e-4 }),
        };
        let mut agent = built(name, &config, &problem);
        let error = error_of(&mut *agent, &mut problem, 1);
        assert!(error < most, "{name}: {error}");
        // The error of a healthy guess is far larger.
        assert!(error < 0.2 * 5e-3, "{name}: {error}");
        // The filter starts over: the same life gives the same errors.
        let (again, other) = (
            error_of(&mut *agent, &mut problem, 1),
            error_of(&mut *agent, &mut problem, 0),
        );
        if name != "particle_filter" {
            assert!((again - error).abs() < 1e-9, "{name}: {again} {error}");
        }
        assert!(other < most, "{name}: {other}");
    }
}

#[test]
fn one_exact_sample_is_enough() {
    let mut problem = problem(json!({
        "engine": "agtf30", "trajectory": "units", "theta_range": [-0.06, 0.06],
        "calibrated": ["hpt_efficiency", "hpt_flow", "lpt_efficiency", "lpt_flow"],
        "fleet": { "units": 3, "degradation": { "faults": { "samples": 4 } } },
    }));
    let mut agent = built(
        "least_squares",
        &json!({ "engine": "agtf30", "window": 1 }),
        &problem,
    );
    let error = error_of(&mut *agent, &mut problem, 2);
    assert!(error < 1e-6, "{error}");
}

#[test]
fn other_environments_are_refused() {
    let registry = registry();
    let seat = contract::Seat {
        name: String::new(),
        observation: Space::Box(vec![contract::Channel::new("position", "m")]),
        action: Space::Box(vec![contract::Channel::new("force", "N")]),
    };
    let interface = Interface {
        seats: vec![seat],
        state: Vec::new(),
    };
    for entry in registry.agents.values() {
        let built = (entry.build)(&json!({}).into(), &interface, &mut stream(&["refused"]));
        let error = built.map(|_| ()).unwrap_err().to_string();
        assert!(
            error.contains("it reads `altitude_m`, which is not observed"),
            "{error}"
        );
    }
}

#[test]
fn a_biased_or_noisy_model_misleads_the_filter() {
    let config = json!({
        "trajectory": "units",
        "fleet": { "units": 1, "degradation": { "life": { "cycles": 10, "samples": 5 } } },
    });
    let error = |settings: serde_json::Value| {
        let mut problem = problem(config.clone());
        let mut agent = built("unscented_kalman_filter", &settings, &problem);
        error_of(agent.as_mut(), &mut problem, 0)
    };
    let filter = |bias: f64, noise: f64| {
        json!({
            "walk_sd": 5e-4, "noise": 5e-5, "first_sd": 5e-3, "alpha": 0.5, "beta": 2.0, "kappa": 0.0, "redraw": true,
            "engine": "hbtf", "model": "engine", "model_bias": bias, "model_noise": noise,
        })
    };
    let right = error(filter(1.0, 0.0));
    assert!(right < 2e-4, "{right}");
    for wrong in [filter(1.02, 0.0), filter(1.0, 0.1)] {
        let off = error(wrong);
        assert!(off > 10.0 * right, "{off} {right}");
    }
}
