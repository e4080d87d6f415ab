//! Trials that build on trials: prepared entries, policies measured elsewhere, any number of steps.

use crate::program::{Bench, trial_files};
use serde_json::Value;
use std::{collections::BTreeMap, path::PathBuf};

/// A learner of few units, with a key or two of its own.
fn sac(own: &str) -> String {
    format!("dirichlet_sac: {{ width: 4, batch_size: 4, learning_starts: 8, updates_per_step: 0.5, {own} }}")
}

/// Two prepared entries of which one begins from the other, an agent that begins from the second, and
/// policies measured elsewhere.
fn study() -> String {
    format!(
        "
study: graph
environments:
  fresh: {{ battery: {{ cells: 4, episode_limit: 4 }} }}
  worn: {{ battery: {{ cells: second_life, episode_limit: 4 }} }}
agents:
  equal: {{ equal_split: {{}} }}
  sac: {{ {} }}
  from_fresh: {{ policy: {{ from: sac, environment: fresh }} }}
  tuned: {{ {} }}
  twice: {{ policy: {{ from: tuned, environment: worn, seed: 1 }} }}
protocol: {{ train_evaluate: {{ steps: 32, environments: 4, evaluate_every: 0, episodes: 0, final_episodes: \
3, trace_episodes: 0 }} }}
seeds: 2
exclude:
  - {{ environment: fresh, agent: tuned }}
prepare:
  first:
    environment: fresh
    agent: {{ {} }}
  second:
    environment: worn
    agent: {{ {} }}
    protocol: {{ train_evaluate: {{ steps: 16, environments: 4, evaluate_every: 0, episodes: 0, \
    final_episodes: 1, trace_episodes: 0 }} }}
tables:
  life: {{ comparison: {{ rows: agent, columns: environment, value: voltage_spread_at_end_v, decimals: 9 }} }}
claims:
  - from_fresh.cycle_length >= 0 * equal.cycle_length
",
        sac("discount: 0.9"),
        sac("start: { from: second }"),
        sac("target_concentration: 20"),
        sac("start: { from: first, seed: 7 }"),
    )
}

/// Combinations: 2 seeds of equal, sac, from_fresh and twice in 2 environments and of tuned in one. Prepared:
/// seed 7 of first, and the 2 seeds of second that tuned takes.
const TRIALS: usize = 2 * (4 * 2 + 1) + 1 + 2;

fn bench(study: &str) -> Bench {
    let bench = Bench::new();
    bench.write("graph.yaml", study);
    bench
}

/// Everything that is stored, by the trial's id.
fn stored(bench: &Bench, store: &str) -> BTreeMap<String, Value> {
    let read = |file: PathBuf| {
        let id = file
            .parent()
            .unwrap()
            .file_name()
            .unwrap()
            .to_string_lossy()
            .into_owned();
        (
            id,
            serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap(),
        )
    };
    trial_files(&bench.path(store)).into_iter().map(read).collect()
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

#[test]
fn any_number_of_steps_run_in_order_and_give_the_same_bits_for_any_number_of_workers() {
    let bench = bench(&study());
    let out = bench.run(&["run", "graph.yaml", "-j", "2"]);
    assert_eq!(out.code, 0, "{}\n{}", out.out, out.err);
    bench.ok(&["run", "graph.yaml", "-j", "1", "--store", "other"]);
    assert_eq!(
        (bench.digests("store").len(), bench.digests("store")),
        (TRIALS, bench.digests("other"))
    );
    assert!(bench.run(&["run", "graph.yaml"]).err.contains("nothing runs"));
    assert!(bench.run(&["fsck", "store"]).out.contains(" 0 files are wrong"));
    // A policy that is measured where it was trained gives what its own trial measured, to the bit.
    let table = std::fs::read_to_string(bench.path("results/graph/tables/life.csv")).unwrap();
    let of = |agent: &str| {
        let row = table
            .lines()
            .find(|line| line.starts_with(&format!("{agent},fresh,")))
            .unwrap_or_else(|| panic!("{table}"));
        row.split(',').nth(5).unwrap().to_owned()
    };
    assert_eq!(of("sac"), of("from_fresh"));
    assert_ne!(of("sac"), of("equal"));
    let report = std::fs::read_to_string(bench.path("results/graph/report.md")).unwrap();
    assert!(
        report.contains("networks of second") && report.contains("networks of first"),
        "{report}"
    );
    // A resolved study loads to the same trials.
    let resolved = bench.ok(&["resolve", "graph.yaml"]);
    bench.write("again.yaml", &resolved);
    assert!(
        bench.ok(&["plan", "again.yaml"]).contains("nothing is missing"),
        "{resolved}"
    );
}

#[test]
fn what_leads_to_a_artifact_is_part_of_what_takes_it_and_names_are_not() {
    let bench = bench(&study());
    bench.ok(&["worker", "graph.yaml", "-j", "2"]);
    let before = stored(&bench, "store");
    assert_eq!(before.len(), TRIALS);
    let renamed = study()
        .replace("first", "origin")
        .replace("  second:", "  middle:")
        .replace("from: second", "from: middle");
    bench.write("renamed.yaml", &renamed);
    assert!(
        bench.run(&["run", "renamed.yaml"]).err.contains("nothing runs"),
        "names of entries are no part of ids"
    );
    let changed = ["graph.yaml", "--set", "prepare.first.agent.discount=0.5"];
    let plan = bench.ok(&[&["plan"], &changed[..]].concat());
    assert!(
        plan.contains("second takes networks of first") && plan.contains("twice takes policy of tuned"),
        "{plan}"
    );
    assert!(plan.contains("takes from first, which is new"), "{plan}");
    assert!(plan.contains("takes from tuned in worn, which is new"), "{plan}");
    assert!(
        plan.contains("agent dirichlet_sac.discount: 0.99 -> 0.5"),
        "{plan}"
    );
    bench.ok(&[&["worker"], &changed[..]].concat());
    // first once, second and tuned twice, and what measures tuned's policy of seed 1 in two environments for
    // two seeds.
    assert_eq!(stored(&bench, "store").len() - before.len(), 1 + 2 + 2 + 4);
}

#[test]
fn a_chosen_part_runs_with_what_it_takes() {
    let bench = bench(&study());
    bench.ok(&["worker", "graph.yaml", "--only", "tuned"]);
    assert_eq!(stored(&bench, "store").len(), 2 + 2 + 1);
}

/// A prepared trial that fails once, one that takes from it, an agent that takes from that, and a policy of
/// the agent elsewhere.
fn failing(marker: &str) -> String {
    let taking =
        |source: &str| format!("{{ misbehaving: {{ leaves_policy: true, start: {{ {source} }} }} }}");
    format!(
        "
study: graph
environments:
  fresh: {{ battery: {{ cells: 4, episode_limit: 4 }} }}
  worn: {{ battery: {{ cells: second_life, episode_limit: 4 }} }}
agents:
  equal: {{ equal_split: {{}} }}
  third: {}
  fourth: {{ policy: {{ from: third, environment: fresh }} }}
protocol: {{ train_evaluate: {{ steps: 8, environments: 4, evaluate_every: 0, episodes: 0, final_episodes: \
1, trace_episodes: 0 }} }}
seeds: 2
exclude: [ {{ environment: worn, agent: third }}, {{ environment: fresh, agent: fourth }} ]
prepare:
  first: {{ environment: fresh, agent: {{ misbehaving: {{ how: fail, once: '{marker}', leaves_policy: true \
  }} }} }}
  second: {{ environment: fresh, agent: {} }}
",
        taking("from: second"),
        taking("from: first, seed: 0"),
    )
}

#[test]
fn a_failure_blocks_all_that_follows_and_a_retry_goes_down_the_graph() {
    let bench = Bench::new();
    bench.write(
        "graph.yaml",
        &failing(&bench.path("went_wrong").display().to_string()),
    );
    let run = bench.run_misused(&["run", "graph.yaml", "-j", "2"]);
    assert_eq!(run.code, 106, "{}", run.err);
    // second, third and fourth, each with two seeds.
    assert!(
        run.err.contains("6 trials are blocked") && run.err.contains("it fails as asked"),
        "{}",
        run.err
    );
    let status = bench.run_misused(&["status", "graph.yaml"]);
    assert_eq!(status.code, 106);
    assert!(
        status.out.contains(
            "6 trials are blocked: first misbehaving seed 0 ended as failed: test: it fails as asked"
        ),
        "{}",
        status.out
    );
    let status = json(
        &bench
            .run_misused(&["status", "graph.yaml", "--format", "json"])
            .out,
    );
    assert_eq!(status["waiting"]["blocked"][0]["trials"], 6, "{status}");
    let again = bench.run_misused(&["run", "graph.yaml", "--retry-failed", "-j", "2"]);
    assert_eq!(again.code, 0, "{}", again.err);
    // equal in two environments, first once, the others twice.
    assert_eq!(bench.digests("store").len(), 4 + 1 + 6);
}

#[test]
fn what_an_entry_does_not_leave_is_refused_by_check() {
    let bench = Bench::new();
    let study = failing("nowhere").replacen("leaves_policy: true", "leaves_policy: false", 1);
    bench.write("graph.yaml", &study);
    let check = bench.run_misused(&["check", "graph.yaml"]);
    assert_eq!(check.code, 2, "{}", check.out);
    assert!(
        check
            .err
            .contains("leaves nothing for others, and a policy is taken here"),
        "{}",
        check.err
    );
}

#[test]
fn a_damaged_artifact_is_not_taken() {
    let bench = bench(&study());
    bench.ok(&["worker", "graph.yaml", "--only", "second"]);
    let first = stored(&bench, "store")
        .into_iter()
        .find(|(_, it)| it["key"]["seed"] == 7)
        .unwrap()
        .0;
    let file = bench
        .path("store/trials")
        .join(&first[..2])
        .join(&first)
        .join("networks.safetensors");
    let mut bytes = std::fs::read(&file).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&file, bytes).unwrap();
    std::fs::remove_dir_all(bench.path("store/trials").join({
        let second = stored(&bench, "store")
            .into_iter()
            .find(|(_, it)| it["key"]["seed"] == 0)
            .unwrap()
            .0;
        PathBuf::from(&second[..2]).join(second)
    }))
    .unwrap();
    let found = bench.run(&["fsck", "store", "--dry-run"]).out;
    assert!(found.contains("networks.safetensors"), "{found}");
    let worker = bench.run(&["worker", "graph.yaml"]);
    assert!(
        worker
            .err
            .contains("`networks.safetensors` is damaged or not there"),
        "{}",
        worker.err
    );
    let run = bench.run(&["run", "graph.yaml"]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(run.err.contains("1 damaged trial runs again"), "{}", run.err);
    bench.ok(&["run", "graph.yaml", "--store", "whole"]);
    assert_eq!(bench.digests("store"), bench.digests("whole"));
}

#[test]
fn a_policy_that_does_not_fit_is_refused_by_check_with_its_place() {
    let bench = bench(&study().replace(
        "worn: { battery: { cells: second_life, episode_limit: 4 } }",
        "worn: { battery: { cells: 8, episode_limit: 4 } }",
    ));
    let check = bench.run(&["check", "graph.yaml"]);
    assert_eq!(check.code, 2, "{}", check.out);
    assert!(check.err.contains("graph.yaml:9:"), "{}", check.err);
    assert!(
        check
            .err
            .contains("the policy of `sac in fresh` cannot be used here"),
        "{}",
        check.err
    );
    assert!(check.err.contains("`inputs` of the policy is"), "{}", check.err);
    assert!(
        check.err.contains("start"),
        "networks of four cells do not begin eight: {}",
        check.err
    );
}
