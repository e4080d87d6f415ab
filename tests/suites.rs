//! Figures of a suite of environments, through the real program.

use crate::program::Bench;
use std::fs;

const STUDY: &str = "
study: suite
environments:
  two: { battery: { cells: 2 } }
  three: { battery: { cells: 3 } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64 } }
  random: { random_allocation: {} }
protocol: { train_evaluate: { steps: 256, environments: 8, evaluate_every: 64, episodes: 2, final_episodes: 4 } }
seeds: 4
figures:
  estimates:
    caption: Aggregates of two batteries
    interval_estimates: { metric: cycle_length, normalise: { low: random, high: equal } }
  profile:
    performance_profile: { metric: cycle_length, normalise: { two: [random, 13.5], three: [0, equal] } }
    width_mm: 88.9
    font_pt: 9
  improvement:
    probability_of_improvement: { metric: cycle_length, normalise: { low: random, high: equal }, relative_to: random }
  efficiency:
    sample_efficiency: { metric: cycle_length, normalise: { low: random, high: equal } }
";

#[test]
fn all_four_are_drawn_of_what_was_measured() {
    let bench = Bench::new();
    bench.write("suite.yaml", STUDY);
    bench.ok(&["run", "suite.yaml"]);
    let figures = bench.path("results/suite/figures");
    let read = |name: &str| fs::read_to_string(figures.join(name)).unwrap();
    let lines = |name: &str| read(&format!("{name}.csv")).lines().count();
    assert_eq!(
        ["estimates", "profile", "improvement", "efficiency"].map(lines),
        [1 + 4 * 3, 1 + 3 * 101, 1 + 2 + 2, 1 + 3 * 5]
    );
    // The agents by which scores are normalised have 0 or 1 in the mean.
    let estimates = read("estimates.csv");
    let mean = |agent: &str| {
        let line = estimates
            .lines()
            .find(|line| line.starts_with(&format!("mean,,4,{agent},")));
        line.unwrap_or_else(|| panic!("{estimates}"))
            .split(',')
            .nth(4)
            .unwrap()
            .parse::<f64>()
            .unwrap()
    };
    assert!(mean("random").abs() < 1e-12 && (mean("equal") - 1.0).abs() < 1e-12);
    assert!(read("profile.svg").contains("width=\"88.90mm\""));
    let page = read("../index.html");
    assert!(
        page.contains("aria-label=\"Intervals as bars in 4 panels")
            && page.contains("Aggregates of two batteries")
            && page.contains("figures/profile.pdf"),
        "{page}"
    );
    for name in ["estimates", "profile", "improvement", "efficiency"] {
        let pdf = fs::read(figures.join(name).with_extension("pdf")).unwrap();
        assert!(pdf.starts_with(b"%PDF-"), "{name}");
    }
}
