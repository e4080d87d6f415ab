//! An agent that learns from examples of a life knows all of it: its error does not depend on the place in the
//! life, and no constant is better than the fitted one.

use crate::program::Bench;

/// Lives of 400 samples, examples of them, and what two policies infer of units that they did not learn from.
const STUDY: &str = "\
study: lives
environments:
  training: { turbofan_calibration: { fleet: { units: 6, degradation: { life: { cycles: 40, samples: 10 } } } } }
  unseen: { turbofan_calibration: { fleet: { units: 4, first_unit: 6, degradation: { life: { cycles: 40, \
  samples: 10 } } }, trajectory: units } }
prepare:
  fitted:
    environment: training
    agent: { network_regression: { inputs: [altitude_m, mach, delta_t_k, turbine_inlet_temperature_k, target_], \
    width: 32, updates_per_batch: 16, memory: 10000 } }
    protocol: { supervised_fit: { steps: 400, batch: 64, evaluate_every: 0, final_examples: 20 } }
  middle:
    environment: training
    agent: { network_regression: { inputs: [], halved_every: 200, layers: 1, width: 8 } }
    protocol: { supervised_fit: { steps: 600, batch: 16, evaluate_every: 0, final_examples: 20 } }
agents:
  end_to_end: { policy: { from: fitted } }
  constant: { policy: { from: middle } }
protocol: { track: { episodes: 4, trace_episodes: 4 } }
seeds: 1
exclude: [{ environment: training }]
figures:
  lives:
    trajectory: { channels: [inferred_hpt_efficiency], references: [true_hpt_efficiency], agents: [end_to_end, \
    constant], environment: unseen, episodes: 4 }
";

/// True and inferred health of an agent, sample by sample, over all lives.
fn series(csv: &str, agent: &str) -> Vec<(f64, f64)> {
    let values = |series: &str| -> Vec<f64> {
        let rows = csv.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let of_series = rows.filter(|row| row[0] == agent && row[1] == series);
        of_series.map(|row| row[4].parse().unwrap()).collect()
    };
    // The only channel of a figure has no name there.
    let (truth, inferred) = (values("true hpt efficiency"), values(""));
    assert_eq!((truth.len(), inferred.len()), (1600, 1600), "{csv}");
    truth.into_iter().zip(inferred).collect()
}

fn rmse(pairs: &[(f64, f64)]) -> f64 {
    let squares = pairs.iter().map(|(truth, inferred)| (truth - inferred).powi(2));
    (squares.sum::<f64>() / pairs.len() as f64).sqrt()
}

#[test]
fn examples_are_of_whole_lives() {
    let bench = Bench::new();
    bench.write("lives.yaml", STUDY);
    bench.ok(&["run", "lives.yaml"]);
    let csv = std::fs::read_to_string(bench.path("results/lives/figures/lives.csv")).unwrap();

    let inferred = series(&csv, "end_to_end");
    let part = |from: usize, to: usize| -> Vec<(f64, f64)> {
        let lives = inferred.chunks(400);
        lives.flat_map(|life| life[from..to].to_vec()).collect()
    };
    let (early, late) = (rmse(&part(0, 260)), rmse(&part(260, 400)));
    assert!(late < 3.0 * early, "{early} {late}");

    // The best constant of the units that were learned from loses a little on others; that of their first samples loses
    // half as much again.
    let constant = series(&csv, "constant");
    let truth: Vec<f64> = constant.iter().map(|(truth, _)| *truth).collect();
    let mean = truth.iter().sum::<f64>() / truth.len() as f64;
    let best: Vec<(f64, f64)> = truth.iter().map(|it| (*it, mean)).collect();
    let (fitted, best) = (rmse(&constant), rmse(&best));
    assert!(fitted < 1.2 * best, "{fitted} {best}");
    assert!(early < 0.35 * best, "{early} {best}");
}
