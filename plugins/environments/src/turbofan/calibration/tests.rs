//! The tracking problem: the true health costs nothing, and a wrong one can be distinguished from noise.

use super::{CalibrationConfig, Cost, TurbofanCalibration};
use crate::turbofan::{config::HealthParameter, fleet::Fleet, *};
use contract::random::stream;

fn environment(config: serde_json::Value) -> TurbofanCalibration {
    let config: CalibrationConfig = serde_json::from_value(config).unwrap();
    TurbofanCalibration::new(config).unwrap()
}

/// The action for the true health plus `shift`.
fn unit(environment: &TurbofanCalibration, shift: f64) -> Vec<f64> {
    let limits = environment.state_channels();
    let entry = |(channel, theta): (&Channel, f64)| {
        (2.0 * (theta + shift) - channel.low - channel.high) / (channel.high - channel.low)
    };
    limits.iter().zip(environment.state()).map(entry).collect()
}

/// Mean reward, and final errors of health and outputs, when every action is the true health plus `shift`.
fn followed(environment: &mut TurbofanCalibration, steps: usize, shift: f64) -> (f64, [f64; 2]) {
    let mut rng = stream(&["followed"]);
    environment.reset(&mut rng).unwrap();
    let (mut sum, mut errors) = (0.0, [f64::NAN; 2]);
    for _ in 0..steps {
        let action = unit(environment, shift);
        let step = environment.step(&[action], &mut rng).unwrap();
        sum += step.rewards[0];
        errors = ["theta_rmse", "output_rmse"].map(|metric| step.metric(metric).unwrap());
    }
    (sum / steps as f64, errors)
}

#[test]
fn the_true_health_costs_nothing_and_another_one_does() {
    for engine in ["hbtf", "agtf30"] {
        let config = serde_json::json!({ "engine": engine, "trajectory": { "piece": 40 } });
        let mut problem = environment(config);
        let (right, errors) = followed(&mut problem, 40, 0.0);
        assert!(
            right.abs() < 1e-6 && errors[0] < 1e-15 && errors[1] < 1e-7,
            "{engine}: {right} {errors:?}"
        );
        let (wrong, errors) = followed(&mut problem, 40, 0.003);
        assert!(
            wrong < -0.05 && (errors[0] - 0.003).abs() < 1e-9,
            "{engine}: {wrong} {errors:?}"
        );
    }
}

#[test]
fn costs_have_a_kink_or_are_squares() {
    let of = |cost: Cost| {
        let config = serde_json::json!({ "cost": cost, "trajectory": { "piece": 20 } });
        -followed(&mut environment(config), 20, 1e-5).0
    };
    let (kinked, squared) = (of(Cost::Kinked), of(Cost::MeanSquared));
    // Below the kink, and 14 sensors: the mean of squares is the square of the norm over 14.
    assert!(kinked < 0.01 && squared < kinked * kinked, "{kinked} {squared}");
    let config = serde_json::json!({ "trajectory": { "piece": 20 } });
    let far = -followed(&mut environment(config), 20, 3e-3).0;
    assert!(far / 10.0 > 200.0 * kinked, "{far} {kinked}");
}

#[test]
fn noise_and_bias_have_the_stated_size() {
    let seen = |config: serde_json::Value| {
        let mut problem = environment(config);
        problem.reset(&mut stream(&["noise"])).unwrap().remove(0)
    };
    let exact = seen(serde_json::json!({ "trajectory": { "piece": 200 } }));
    let noisy = seen(serde_json::json!({ "sensor_snr_db": 70, "trajectory": { "piece": 200 } }));
    // Beside the 14 outputs of the model and the flight condition, the observation has 14 sensors.
    let squares = noisy
        .iter()
        .zip(&exact)
        .skip(18)
        .map(|(x, y)| (x / y - 1.0).powi(2));
    let size = (squares.sum::<f64>() / 14.0).sqrt();
    assert!((1e-4..6e-4).contains(&size), "3.2e-4 are 70 dB: {size}");
    let biased = serde_json::json!({ "model_bias": 1.02, "trajectory": { "piece": 5 } });
    let (cost, _) = followed(&mut environment(biased), 5, 0.0);
    assert!(cost < -0.1, "{cost}");
}

/// Deviation of the count of each tenth of a life from its expectation, in standard deviations.
fn deviations(counts: [u32; 10]) -> [f64; 10] {
    let n = f64::from(counts.iter().sum::<u32>());
    let sd = (n * 0.1 * 0.9).sqrt();
    counts.map(|count| (f64::from(count) - 0.1 * n) / sd)
}

#[test]
fn every_part_of_a_life_is_equally_likely() {
    let lives = serde_json::json!({ "life": { "cycles": 10, "samples": 5 } });
    for piece in [1, 17, 512] {
        let mut problem = environment(serde_json::json!({
            "trajectory": { "piece": piece },
            "fleet": { "units": 3, "degradation": lives },
        }));
        let mut rng = stream(&["lives"]);
        let (mut first, mut all) = ([0; 10], [0; 10]);
        for _ in 0..300 {
            problem.reset(&mut rng).unwrap();
            first[problem.progress.at / 5] += 1;
            loop {
                all[problem.progress.at / 5] += 1;
                let action = unit(&problem, 0.0);
                if problem.step(&[action], &mut rng).unwrap().end.is_some() {
                    break;
                }
            }
        }
        let largest = |counts| deviations(counts).into_iter().map(f64::abs).fold(0.0, f64::max);
        assert!(largest(first) < 4.0, "{piece}: {first:?}");
        // Samples of one episode follow each other: whole lives contain each part equally often.
        assert!(
            if piece > 50 {
                largest(all) == 0.0
            } else {
                largest(all) < 12.0
            },
            "{piece}: {all:?}"
        );
    }
}

#[test]
fn examples_have_the_health_of_the_whole_fleet() {
    let mut problem = environment(serde_json::json!({}));
    let mut rng = stream(&["examples"]);
    let (mut sum, mut squares, mut deciles) = (0.0, 0.0, [0; 10]);
    for _ in 0..10_000 {
        problem.reset(&mut rng).unwrap();
        let theta = problem.state()[0];
        (sum, squares) = (sum + theta, squares + theta * theta);
        deciles[problem.progress.at / 150] += 1;
    }
    let (mean, lives) = (sum / 1e4, Fleet::default());
    let error = ((squares / 1e4 - mean * mean) / 1e4).sqrt();
    let calibrated = [HealthParameter::HptEfficiency];
    let of_unit = |unit| (0..75).map(move |cycle| lives.theta(unit, cycle, &calibrated)[0]);
    let true_mean = (0..10).flat_map(of_unit).sum::<f64>() / 750.0;
    assert!(
        (mean - true_mean).abs() < 4.0 * error,
        "{mean} {true_mean} {error}"
    );
    assert!(deviations(deciles).iter().all(|it| it.abs() < 4.0), "{deciles:?}");
}

#[test]
fn units_follow_each_other_whole() {
    let config = serde_json::json!({
        "trajectory": "units",
        "fleet": { "units": 3, "degradation": { "life": { "cycles": 4, "samples": 5 } } },
    });
    let mut problem = environment(config);
    let mut rng = stream(&["units"]);
    for (episode, number) in [(0, 0.0), (1, 1.0), (2, 2.0), (3, 0.0)] {
        problem.reset_to(episode, &mut rng).unwrap();
        for sample in 0..20 {
            assert_eq!(problem.trace()[0], number);
            let action = unit(&problem, 0.0);
            let step = problem.step(&[action], &mut rng).unwrap();
            assert_eq!(step.end.is_some(), sample == 19);
            // The trace belongs to one sample: its target and the model's output at its true health.
            let row = problem.trace();
            assert_eq!(row[..2], [number, sample as f64]);
            let (target, model) = row[4..].split_at(14);
            assert!(
                target.iter().zip(model).all(|(x, y)| (x / y - 1.0).abs() < 1e-6),
                "{row:?}"
            );
        }
    }
}

#[test]
fn contradictory_configs_are_refused() {
    for (config, message) in [
        (
            serde_json::json!({ "sensors": ["t99_k"] }),
            "no output is called `t99_k`; there are n1_rpm, ",
        ),
        (
            serde_json::json!({ "theta_range": [0.02, -0.02] }),
            "[0.02, -0.02] is no range",
        ),
        (
            serde_json::json!({ "calibrated": ["lpt_flow", "lpt_flow"] }),
            "`lpt_flow` is calibrated twice",
        ),
    ] {
        let config: CalibrationConfig = serde_json::from_value(config).unwrap();
        let error = TurbofanCalibration::new(config).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
    let mut problem = environment(serde_json::json!({ "trajectory": { "piece": 5 } }));
    let mut rng = stream(&["refused"]);
    problem.reset(&mut rng).unwrap();
    let error = problem.step(&[vec![1.05]], &mut rng).unwrap_err().to_string();
    assert!(
        error.contains("hpt_efficiency is 1.05, outside [-1, 1]"),
        "{error}"
    );
}
