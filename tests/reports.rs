//! What the report of a study says besides its tables.

use crate::program::{Bench, trial_files};

const STUDY: &str = "
study: small
environments:
  cells: { battery: { cells: 2 } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64 } }
protocol: { train_evaluate: { steps: 256, environments: 8, evaluate_every: 128, episodes: 2, \
final_episodes: 6 } }
seeds: 2
profiles:
  short: { protocol.steps: 128 }
  long: { protocol.steps: 512 }
  wide: { dsac.width: 32 }
tables:
  lengths: { comparison: { value: cycle_length } }
";

#[test]
fn a_report_tells_budgets_settings_profiles_and_dates() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml", "--profile", "short"]);
    let said = bench.ok(&["run", "small.yaml"]);
    assert!(
        said.contains("long: 0 of 4 trials are stored: never run"),
        "{said}"
    );
    let report = std::fs::read_to_string(bench.path("results/small/report.md")).unwrap();
    for line in [
        "- default: all 4 trials are stored: this report",
        "- short: all 4 trials are stored",
        "- wide: 2 of 4 trials are stored, all of them shared with other profiles: never run itself",
        "| width | 256 | 16 |",
        "| steps | 60000 | 256 |",
        "- lengths: [tables/lengths-seeds.csv](tables/lengths-seeds.csv)",
        "- trials ended: ",
    ] {
        assert!(report.contains(line), "{line}\n{report}");
    }
    let row = report
        .lines()
        .find(|line| line.starts_with("| dsac | 2 | "))
        .expect(&report);
    assert!(
        row.contains(" | 6 | "),
        "episodes of the final measurement: {row}"
    );
    let seeds = std::fs::read_to_string(bench.path("results/small/tables/lengths-seeds.csv")).unwrap();
    assert_eq!(seeds.lines().count(), 5, "{seeds}");
}

#[test]
fn the_date_of_a_trial_is_stored_and_is_no_part_of_what_is_compared() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    let dates = |store: &str| -> Vec<String> {
        bench.ok(&["run", "small.yaml", "--store", store, "--only", "equal"]);
        let date = |file: &std::path::PathBuf| {
            let trial: serde_json::Value =
                serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
            trial["ended_at"].as_str().unwrap().to_owned()
        };
        trial_files(&bench.path(store)).iter().map(date).collect()
    };
    let one = dates("one");
    // Dates have the resolution of a second.
    std::thread::sleep(std::time::Duration::from_millis(1100));
    let two = dates("two");
    assert!(one.iter().max() < two.iter().min(), "{one:?} {two:?}");
    assert_eq!(bench.digests("one"), bench.digests("two"));
    bench.ok(&["fsck", "two"]);
}
