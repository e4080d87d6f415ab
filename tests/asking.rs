//! How a command is asked: studies of several files, every key from the command line, where the store and the
//! settings are sought, and what is refused before anything runs.

use crate::program::{Answer, Bench};
use std::{fs, path::Path};

const COMMON: &str = "
blocks:
  lengths: { rows: agent, value: cycle_length }
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  random: { random_allocation: {} }
protocol: { train_evaluate: { steps: 0, final_episodes: 2 } }
seeds: 2
tables:
  lengths: { comparison: { <<: lengths } }
";

const STUDY: &str = "
study: small
include: shared/common.yaml
tables:
  lengths: { caption: How long cells last }
";

fn bench() -> Bench {
    let bench = Bench::new();
    fs::create_dir(bench.path("shared")).unwrap();
    bench.write("shared/common.yaml", COMMON);
    bench.write("small.yaml", STUDY);
    bench
}

/// A refusal before anything ran: no store was begun.
fn refused(bench: &Bench, arguments: &[&str], code: i32) -> Answer {
    let answer = bench.run(arguments);
    assert_eq!(answer.code, code, "{}", answer.err);
    assert!(!bench.path("store").exists(), "{arguments:?} began a store");
    answer
}

#[test]
fn a_study_of_two_files_is_run_reported_and_taken_away_whole() {
    let bench = bench();
    let said = bench.run(&["run", "small.yaml"]);
    assert_eq!(said.code, 0, "{}", said.err);
    assert!(
        said.err.contains("running 4 trials on") && said.err.contains("the store is `store`"),
        "{}",
        said.err
    );
    let report = fs::read_to_string(bench.path("results/small/report.md")).unwrap();
    assert!(report.contains("How long cells last"), "{report}");
    bench.ok(&[
        "export",
        "small.yaml",
        "--to",
        "crate",
        "--as",
        "ro-crate",
        "--license",
        "CC-BY-4.0",
    ]);
    let included = fs::read_to_string(bench.path("crate/included/1/common.yaml")).unwrap();
    assert_eq!(included, COMMON);
    // Written as one file, it has the same trials.
    let whole = bench.ok(&["resolve", "small.yaml"]);
    bench.write("whole.yaml", &whole);
    let plan = bench.ok(&["plan", "whole.yaml"]);
    assert!(plan.contains("nothing is missing"), "{plan}");
}

#[test]
fn a_mistake_in_an_included_file_is_shown_there() {
    let bench = bench();
    bench.write("shared/common.yaml", &COMMON.replace("cells: 2", "cell: 2"));
    let answer = refused(&bench, &["run", "small.yaml"], 2);
    assert!(
        answer.err.contains("--> shared/common.yaml:4:37"),
        "{}",
        answer.err
    );
}

#[test]
fn every_key_can_be_set_from_the_command_line() {
    let bench = bench();
    let sets = [
        "title=A title of today",
        "tables.lengths.comparison.decimals=3",
        "tables.lengths.caption=Another caption",
        "limits.wall_time_s=600",
        "claims=[equal.cycle_length > random.cycle_length]",
        "figures.bars={ bars: { of: { rows: agent, value: cycle_length } } }",
    ];
    let mut words = vec!["resolve", "small.yaml"];
    sets.iter().for_each(|set| words.extend(["-S", set]));
    let resolved = bench.ok(&words);
    for part in [
        "A title of today",
        "decimals: 3",
        "Another caption",
        "wall_time_s: 600",
        "bars:",
    ] {
        assert!(resolved.contains(part), "{part}:\n{resolved}");
    }
    let answer = refused(&bench, &["run", "small.yaml", "-S", "tables.length.caption=x"], 2);
    assert!(answer.err.contains("did you mean `lengths`?"), "{}", answer.err);
}

#[test]
fn settings_and_store_are_found_from_below_their_folder() {
    let bench = bench();
    bench.write("regimen.toml", "store = \"kept\"\nworkers = 1\n");
    fs::create_dir(bench.path("deep")).unwrap();
    let run = bench
        .command(&["run", "../small.yaml"])
        .current_dir(bench.path("deep"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(
        run.status.success() && said.contains("1 worker process; the store is `../kept`"),
        "{said}"
    );
    assert!(bench.path("kept/trials").is_dir() && !bench.path("deep/store").exists());
    bench.write("regimen.toml", "workers = 0\n");
    let answer = refused(&bench, &["run", "small.yaml"], 2);
    assert!(
        answer.err.contains("workers = 0: write 1 or more"),
        "{}",
        answer.err
    );
}

#[test]
fn a_store_of_nearly_the_name_is_pointed_at() {
    let bench = bench();
    bench.ok(&["run", "small.yaml"]);
    let answer = bench.run(&["plan", "small.yaml", "--store", "stroe"]);
    assert!(
        answer
            .err
            .contains("there is no store `stroe` yet; did you mean `store`?"),
        "{}",
        answer.err
    );
    let answer = bench.run(&["plan", "small.yaml", "--store", "elsewhere"]);
    assert!(!answer.err.contains("did you mean"), "{}", answer.err);
}

#[test]
fn no_process_and_unknown_names_are_refused() {
    let bench = bench();
    for command in [
        ["run", "small.yaml"],
        ["worker", "small.yaml"],
        ["verify", "small.yaml"],
    ] {
        let answer = refused(&bench, &[&command[..], &["-j", "0"]].concat(), 2);
        assert!(answer.err.contains("write 1 or more"), "{}", answer.err);
    }
    let checked = bench.run(&["check", "small.yaml", "--only", "eqaul", "--format", "json"]);
    assert_eq!(checked.code, 4, "{}", checked.err);
    assert!(checked.out.contains("\"problems\":[]"), "{}", checked.out);
    assert!(checked.err.contains("did you mean `equal`?"), "{}", checked.err);
    let answer = refused(&bench, &["run", "small.yaml", "--only", "eqaul"], 4);
    assert!(
        answer
            .err
            .contains("no environment or agent is named `eqaul`: did you mean `equal`?"),
        "{}",
        answer.err
    );
}

#[test]
fn results_that_cannot_be_written_are_refused_before_anything_runs() {
    let bench = bench();
    bench.write("taken", "a file");
    let answer = refused(&bench, &["run", "small.yaml", "-o", "taken/results"], 2);
    assert!(
        answer
            .err
            .contains("results cannot be written to `taken/results`"),
        "{}",
        answer.err
    );
    bench.write("results", "a file");
    refused(&bench, &["run", "small.yaml"], 2);
    let left = fs::read_dir(bench.path(""))
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    let left: Vec<String> = left.map(|name| name.to_string_lossy().into_owned()).collect();
    assert!(!left.iter().any(|name| name.starts_with(".regimen")), "{left:?}");
    assert!(Path::new(&bench.path("taken")).is_file());
}

#[test]
fn a_curve_that_ends_early_is_warned_of() {
    let bench = bench();
    bench.write(
        "shared/common.yaml",
        &COMMON.replace("equal_split", "dirichlet_sac"),
    );
    let sets = ["-S", "protocol.steps=10000", "-S", "protocol.evaluate_every=3000"];
    let answer = bench.run(&[&["check", "small.yaml"], &sets[..]].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(
        answer.err.contains("warning: `evaluate_every`: 3000 does not divide 10000 steps, so the learning curve ends at step 9000"),
        "{}",
        answer.err
    );
    assert!(
        answer
            .out
            .contains("small: ok, 4 trials, 1 table, 0 figures, 0 claims"),
        "{}",
        answer.out
    );
}

#[test]
fn a_claim_may_compare_two_settings_of_one_agent() {
    let bench = bench();
    bench.write(
        "settings.yaml",
        "
study: settings
include: shared/common.yaml
seeds: 5
sweep:
  cells.decision_interval_s: { grid: [5, 10] }
tables:
  lengths: { comparison: { columns: decision_interval_s } }
figures:
  map: { heat_map: { of: { rows: agent, columns: decision_interval_s, value: cycle_length } } }
claims:
  - equal[decision_interval_s=5].cycle_length > 1.5 * equal[decision_interval_s=10].cycle_length
  - equal.cycle_length > random.cycle_length
",
    );
    bench.ok(&["run", "settings.yaml"]);
    let verdicts = fs::read_to_string(bench.path("results/settings/verdicts.json")).unwrap();
    let verdicts: serde_json::Value = serde_json::from_str(&verdicts).unwrap();
    let all = verdicts["verdicts"].as_array().unwrap();
    let about = |words: &str| -> Vec<&str> {
        let those = all
            .iter()
            .filter(|it| it["about"].as_str().unwrap().contains(words));
        those.map(|it| it["verdict"].as_str().unwrap()).collect()
    };
    // One comparison of the two settings, and one comparison of two agents in each of them.
    assert_eq!(
        about("equal[decision_interval_s=5]"),
        ["SUPPORTED"],
        "{verdicts:#}"
    );
    assert_eq!(about("random.cycle_length").len(), 2, "{verdicts:#}");
    let table = fs::read_to_string(bench.path("results/settings/tables/lengths.csv")).unwrap();
    assert!(
        table.lines().count() == 5,
        "two agents with two settings:\n{table}"
    );
    assert!(bench.path("results/settings/figures/map.svg").is_file());
}
