//! Recorded flights in a study: a surrogate is fitted to them, estimators follow them, and what is wrong with a file
//! is said by the check.

use crate::program::{Bench, repository};

/// A study of a recording: an estimator with the engine that was recorded, one with a surrogate of it, and times.
fn study(file: &str) -> String {
    format!(
        "study: recorded\n\
         environments:\n\
         \x20 examples: {{ turbofan_samples: {{ recorded: {{ file: {file} }}, sensors: [n2_rpm, t24_k, t48_k, p30_pa] }} }}\n\
         \x20 flown: {{ turbofan_calibration: {{ recorded: {{ file: {file}, units: [11] }}, sensors: [n2_rpm, \
         t24_k, t48_k, p30_pa], trajectory: units }} }}\n\
         prepare:\n\
         \x20 surrogate:\n\
         \x20   environment: examples\n\
         \x20   agent: {{ network_regression: {{ width: 8 }} }}\n\
         \x20   protocol: {{ supervised_fit: {{ steps: 20, batch: 16, evaluate_every: 10, examples: 8, final_examples: 16 }} }}\n\
         agents:\n\
         \x20 exact: {{ least_squares: {{ window: 1 }} }}\n\
         \x20 filter: {{ unscented_kalman_filter: {{ model: {{ surrogate: {{ from: surrogate, seed: 0 }} }} }} }}\n\
         protocol: {{ track: {{ episodes: 1, trace_episodes: 0 }} }}\n\
         seeds: 1\n\
         exclude: [{{ environment: examples }}]\n\
         tables:\n\
         \x20 health: {{ comparison: {{ rows: agent, value: theta_rmse, decimals: 6 }} }}\n\
         \x20 times: {{ comparison: {{ rows: agent, value: time_per_decision, decimals: 7 }} }}\n"
    )
}

/// A bench with a copy of a fixture.
fn bench_with(name: &str) -> Bench {
    let bench = Bench::new();
    let fixture = repository().join("tests/fixtures/turbofan").join(name);
    std::fs::copy(fixture, bench.path(name)).unwrap();
    bench.write("recorded.yaml", &study(name));
    bench
}

#[test]
fn an_engine_is_followed_through_its_recorded_flights() {
    let bench = bench_with("recorded.h5");
    let run = bench.run(&["run", "recorded.yaml", "-j", "1", "--verbose"]);
    assert_eq!(run.code, 0, "{}{}", run.out, run.err);
    let row = |table: &str, agent: &str| -> f64 {
        let rows = run.out.split(table).nth(1).unwrap_or_default().lines();
        let row = rows
            .into_iter()
            .find(|line| line.starts_with(agent))
            .unwrap_or_default();
        let number = row.split_whitespace().nth(1).unwrap_or_default();
        number.parse().unwrap_or_else(|_| panic!("{}", run.out))
    };
    assert!(row("health", "exact") < 1e-5, "{}", run.out);
    assert!(row("health", "filter") > 1e-4, "{}", run.out);
    // An estimate takes microseconds, and a thousand of them at most a tenth of a second each.
    for agent in ["exact", "filter"] {
        assert!((1e-7..0.1).contains(&row("times", agent)), "{}", run.out);
    }
    assert!(
        run.out.contains("Times are measurements of the machine"),
        "{}",
        run.out
    );
}

#[test]
fn a_changed_file_makes_new_trials_and_a_wrong_one_is_refused() {
    let bench = bench_with("recorded.csv");
    assert_eq!(bench.run(&["run", "recorded.yaml", "-j", "1"]).code, 0);
    let plan = bench.run(&["plan", "recorded.yaml"]);
    assert!(plan.out.contains("nothing is missing"), "{}", plan.out);
    let text = std::fs::read_to_string(bench.path("recorded.csv")).unwrap();
    // One sample less.
    let shorter = &text[..text.trim_end().rfind('\n').unwrap_or_default()];
    bench.write("recorded.csv", shorter);
    let plan = bench.run(&["plan", "recorded.yaml"]);
    assert!(plan.out.contains("3 missing"), "{}", plan.out);
    bench.write("recorded.csv", &text.replacen("T48", "T49", 1));
    let refused = bench.run(&["check", "recorded.yaml"]);
    assert_eq!(refused.code, 2);
    assert!(
        refused.err.contains("column `T48`: is missing; there are unit"),
        "{}",
        refused.err
    );
}
