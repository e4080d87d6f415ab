//! Searches for settings through the real program: the same settings however they are computed, and a chosen one
//! that is measured on seeds which the search has not seen.

use crate::program::{Bench, trial_files};
use rand::Rng as _;
use std::{
    os::unix::process::CommandExt,
    process::{Command, Stdio},
    time::Duration,
};

const STUDY: &str = "
study: tuned
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 8, batch_size: 16, learning_starts: 64 } }
protocol: { train_evaluate: { steps: 192, environments: 8, evaluate_every: 96, episodes: 1, final_episodes: 2 } }
seeds: 3
tune:
  rates:
    over:
      dsac.actor_learning_rate: { log_uniform: { low: 0.0001, high: 0.1 } }
      dsac.policy_layers: { uniform: { low: 1, high: 3 } }
      dsac.target_entropy: { choice: [minus_sqrt_d, { nats: -3 }] }
    metric: cycle_length
    settings: 9
    seeds: 2
    method: { tree_parzen: { startup: 4, batch: 2 } }
profiles:
  smoke: { tune.rates.settings: 5, tune.rates.seeds: 1 }
tables:
  settings: { caption: What was tried, best_settings: { search: rates, best: 3 } }
  lengths: { comparison: { rows: agent, value: cycle_length } }
claims: [dsac.cycle_length > 0]
";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("tuned.yaml", STUDY);
    bench
}

/// The study with halving in the place of the estimator.
pub(crate) fn halving() -> String {
    STUDY.replace(
        "settings: 9\n    seeds: 2\n    method: { tree_parzen: { startup: 4, batch: 2 } }",
        "settings: 9\n    method: { halving: { pauses: [96], keep: 0.34, brackets: 2 } }",
    )
}

/// Tables as they were rendered.
fn tables(bench: &Bench) -> Vec<String> {
    ["settings", "lengths"]
        .map(|name| std::fs::read_to_string(bench.path(&format!("results/tuned/tables/{name}.csv"))).unwrap())
        .into()
}

#[test]
fn a_search_ends_alike_for_any_number_of_workers_and_after_fifty_kills() {
    let bench = bench();
    bench.ok(&["run", "tuned.yaml", "-j", "1", "--store", "one"]);
    let (expected, whole) = (tables(&bench), bench.digests("one"));
    // Nine settings with two seeds each, and two agents with three: a setting may have been met twice.
    assert!((20..=24).contains(&whole.len()), "{}", whole.len());
    bench.ok(&["run", "tuned.yaml", "-j", "2", "--store", "two"]);
    assert_eq!(
        (tables(&bench), bench.digests("two")),
        (expected.clone(), whole.clone())
    );
    let mut rng = contract::random::stream(&["kill a search"]);
    let mut kills = 0;
    for _ in 0..50 {
        let mut command = bench.command(&["run", "tuned.yaml", "-j", "2", "--store", "killed"]);
        let mut child = command
            .process_group(0)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_micros(rng.random_range(1_000..400_000)));
        kills += usize::from(child.try_wait().unwrap().is_none());
        let group = format!("-{}", child.id());
        let _ = Command::new("kill")
            .args(["-KILL", "--", &group])
            .stderr(Stdio::null())
            .status();
        child.wait().unwrap();
    }
    assert!(kills > 5, "{kills}");
    bench.ok(&["run", "tuned.yaml", "-j", "2", "--store", "killed"]);
    assert_eq!(
        (tables(&bench), bench.digests("killed")),
        (expected, whole),
        "after {kills} kills"
    );
}

#[test]
fn adaptation_ends_alike_for_any_number_of_workers_and_reports_what_it_tried() {
    let bench = Bench::new();
    let study = STUDY
        .replace(
            "      dsac.target_entropy: { choice: [minus_sqrt_d, { nats: -3 }] }\n",
            "",
        )
        .replace(
            "settings: 9\n    seeds: 2\n    method: { tree_parzen: { startup: 4, batch: 2 } }",
            "settings: 8\n    method: { cma_es: { population: 3 } }",
        );
    bench.write("tuned.yaml", &study);
    bench.ok(&["run", "tuned.yaml", "-j", "1", "--store", "one"]);
    let (expected, whole) = (tables(&bench), bench.digests("one"));
    assert_eq!(whole.len(), 8 + 6);
    bench.ok(&["run", "tuned.yaml", "-j", "2", "--store", "two"]);
    assert_eq!((tables(&bench), bench.digests("two")), (expected, whole));
    let report = std::fs::read_to_string(bench.path("results/tuned/report.md")).unwrap();
    let said = "Search rates of dsac: its setting was chosen among 8";
    assert!(report.contains(said), "{report}");
}

#[test]
fn the_chosen_setting_is_measured_on_fresh_seeds_and_everything_says_so() {
    let bench = bench();
    bench.ok(&["run", "tuned.yaml", "-P", "smoke"]);
    let seeds = |tuning: bool| {
        let trials = trial_files(&bench.path("store"));
        let seed = |file: &std::path::PathBuf| {
            let trial: serde_json::Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
            trial["trial"]["key"]["seed"]
                .as_u64()
                .or(trial["key"]["seed"].as_u64())
                .unwrap()
        };
        trials
            .iter()
            .filter(|file| (seed(file) >= 1_000_000) == tuning)
            .count()
    };
    assert_eq!((seeds(true), seeds(false)), (5, 6));
    let report = std::fs::read_to_string(bench.path("results/tuned-smoke/report.md")).unwrap();
    let said = "Search rates of dsac: its setting was chosen among 5, in cells by one seed of its own";
    assert!(report.contains(said), "{report}");
    assert!(
        report.contains("What is shown of dsac is measured on other seeds than these."),
        "{report}"
    );
    assert!(
        report.contains("the best of many looks better there than it is"),
        "{report}"
    );
    // Planning and reporting come to the same from the store alone.
    let plan = bench.ok(&["plan", "tuned.yaml", "-P", "smoke"]);
    assert!(
        plan.contains("nothing is missing") && plan.contains("search rates of dsac"),
        "{plan}"
    );
    bench.ok(&["report", "tuned.yaml", "-P", "smoke"]);
    assert_eq!(
        std::fs::read_to_string(bench.path("results/tuned-smoke/report.md")).unwrap(),
        report
    );
}

#[test]
fn before_the_setting_is_chosen_only_the_search_and_other_agents_have_trials() {
    let bench = bench();
    let plan = bench.ok(&["plan", "tuned.yaml"]);
    // Four settings with two seeds, and the rule with three.
    assert!(plan.contains("tuned: 11 trials"), "{plan}");
    assert!(plan.contains("0 of 9 settings were tried"), "{plan}");
}

#[test]
fn a_setting_that_the_agent_refuses_says_where_it_comes_from() {
    let bench = Bench::new();
    let study = "study: tuned\nenvironments: { swing: { pendulum: {} } }\nagents: { sac: { soft_actor_critic: { \
                 batch_size: 64 } } }\nprotocol: { train_evaluate: { steps: 192 } }\ntune: { memory: { over: { \
                 sac.replay_capacity: { choice: [16, 32] } }, metric: return, settings: 2 } }\n";
    bench.write("tuned.yaml", study);
    let answer = bench.run(&["run", "tuned.yaml"]);
    assert_eq!(answer.code, 2, "{}", answer.err);
    assert!(
        answer.err.contains("tuned.yaml:3:") && answer.err.contains("a buffer of 16"),
        "{}",
        answer.err
    );
}

/// Pauses are those of ordinary trials: what goes on ends with the bits of a trial that was never paused.
#[test]
fn halving_pauses_trials_and_the_best_end_as_if_they_had_never_paused() {
    let bench = Bench::new();
    let halving = halving();
    bench.write("tuned.yaml", &halving);
    bench.ok(&["run", "tuned.yaml", "-j", "2", "--store", "paused"]);
    let (tables_of_halving, ended) = (tables(&bench), bench.digests("paused"));
    // The rule's three and the chosen one's three, and those settings that went to their ends.
    assert!((9..15).contains(&ended.len()), "{}", ended.len());
    let plan = bench.ok(&["plan", "tuned.yaml", "--store", "paused"]);
    assert!(
        plan.contains("nothing is missing") && plan.contains("looked at up to a pause alone"),
        "{plan}"
    );
    // All settings to their ends.
    let whole = halving.replace("halving: { pauses: [96], keep: 0.34, brackets: 2 }", "random: {}");
    bench.write("whole.yaml", &whole.replace("study: tuned", "study: whole"));
    bench.ok(&["run", "whole.yaml", "-j", "2", "--store", "whole"]);
    let whole: std::collections::BTreeMap<_, _> = bench.digests("whole").into_iter().collect();
    assert!(
        ended
            .iter()
            .all(|(id, digest)| whole.get(id).is_none_or(|other| other == digest))
    );
    // Stopped and taken up again at any instant it comes to the same.
    for round in 0..15u64 {
        let mut command = bench.command(&["run", "tuned.yaml", "-j", "2", "--store", "killed"]);
        let mut child = command
            .process_group(0)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(20 * round));
        let group = format!("-{}", child.id());
        let _ = Command::new("kill")
            .args(["-KILL", "--", &group])
            .stderr(Stdio::null())
            .status();
        child.wait().unwrap();
    }
    bench.ok(&["run", "tuned.yaml", "-j", "1", "--store", "killed"]);
    assert_eq!(
        (tables(&bench), bench.digests("killed")),
        (tables_of_halving, ended)
    );
}

/// Twelve settings by exhaustion, on the seeds on which a search compares them.
const GRID: &str = "
study: grid
environments: { cells: { battery: { cells: 2 } } }
agents:
  dsac: { dirichlet_sac: { width: 16, batch_size: 32, learning_starts: 256, updates_per_step: 1 } }
protocol: { train_evaluate: { steps: 4096, environments: 16, evaluate_every: 1024, episodes: 10, final_episodes: 50 } }
seeds: [1000000, 1000001]
sweep:
  dsac.actor_learning_rate: { grid: [0.00001, 0.0003, 0.003, 0.1] }
  dsac.critic_learning_rate: { grid: [0.00001, 0.001, 0.1] }
tables:
  settings: { comparison: { rows: actor_learning_rate, columns: critic_learning_rate, value: cycle_length, decimals: 9 } }
";

/// Hyperband over the same values: two groups of settings, one of which pauses once more than the other.
const HYPERBAND: &str = "
tune:
  rates:
    over:
      dsac.actor_learning_rate: { choice: [0.00001, 0.0003, 0.003, 0.1] }
      dsac.critic_learning_rate: { choice: [0.00001, 0.001, 0.1] }
    metric: cycle_length
    settings: 12
    seeds: 2
    method: { halving: { pauses: [1024, 2048], keep: 0.5, brackets: 2 } }
tables:
  settings: { best_settings: { search: rates, best: 1 } }
";

#[test]
fn hyperband_over_stored_trials_trains_nothing_and_chooses_among_the_best() {
    let bench = Bench::new();
    bench.write("grid.yaml", GRID);
    bench.ok(&["run", "grid.yaml", "-j", "2"]);
    let exhaustive = std::fs::read_to_string(bench.path("results/grid/tables/settings.csv")).unwrap();
    let stored = bench.digests("store");
    assert_eq!(stored.len(), 24);
    let head = GRID.split("sweep:").next().unwrap();
    let head = head
        .replace("study: grid", "study: band")
        .replace("[1000000, 1000001]", "1");
    bench.write("band.yaml", &format!("{head}{HYPERBAND}"));
    let ran = bench.run(&["run", "band.yaml", "-j", "2"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    // The results that the search asks for exist: only the chosen setting runs, on the seed of the study.
    let now = bench.digests("store");
    assert_eq!(now.len(), 25, "{}", ran.err);
    assert!(stored.iter().all(|it| now.contains(it)));
    let chosen = std::fs::read_to_string(bench.path("results/band/tables/settings.csv")).unwrap();
    let values = |table: &str| -> Vec<f64> {
        let cells = table
            .lines()
            .skip(1)
            .filter_map(|line| line.split(',').nth(5)?.parse().ok());
        cells.collect()
    };
    let (mut all, best) = (values(&exhaustive), values(&chosen)[0]);
    all.sort_by(|one, other| other.total_cmp(one));
    assert_eq!(all.len(), 12);
    assert!(best >= all[2], "{best} among\n{exhaustive}");
    let plan = bench.ok(&["plan", "band.yaml"]);
    assert!(
        plan.contains("looked at up to a pause alone"),
        "not all were looked at to their ends:\n{plan}"
    );
}

/// A metric that is recorded while learning alone has no final value.
#[test]
fn a_search_that_finds_no_setting_fails_and_says_why() {
    let bench = Bench::new();
    let study = STUDY.replace(
        "metric: cycle_length",
        "metric: critic_loss\n    direction: minimize",
    );
    bench.write("tuned.yaml", &study);
    let answer = bench.run(&["run", "tuned.yaml", "-P", "smoke"]);
    assert_eq!(answer.code, 100, "{}", answer.err);
    let said = "no trial has a final value of `critic_loss`, so no setting can be chosen";
    assert!(answer.err.contains(said), "{}", answer.err);
}

#[test]
fn importance_of_too_few_settings_is_refused_before_anything_runs() {
    let bench = Bench::new();
    let figures = "figures:\n  keys: { importance: { search: rates } }\n";
    bench.write("tuned.yaml", &format!("{STUDY}{figures}"));
    let refused = bench.run(&["check", "tuned.yaml"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    let said = "`rates` has at most 9 settings that go to their ends; `importance` takes 10";
    assert!(refused.err.contains(said), "{}", refused.err);
    bench.ok(&["check", "tuned.yaml", "-S", "tune.rates.settings=10"]);
}

#[test]
fn what_a_search_saw_is_drawn() {
    let bench = Bench::new();
    let study = STUDY.replace("settings: 9\n", "settings: 12\n");
    let labels = "labels: { policy_layers: layers of the policy, cycle_length: cycles }";
    let figures = format!(
        "figures:\n  keys: {{ importance: {{ search: rates }}, {labels} }}\n  \
         tried: {{ parallel_coordinates: {{ search: rates }}, {labels} }}\n"
    );
    bench.write("tuned.yaml", &format!("{study}{figures}"));
    bench.ok(&["run", "tuned.yaml", "-j", "2"]);
    let read = |name: &str| {
        std::fs::read_to_string(bench.path(&format!("results/tuned/figures/{name}.csv"))).unwrap()
    };
    let (keys, tried, way) = (read("keys"), read("tried"), read("rates-best-so-far"));
    // A run of one value for each setting has its name, and the line never falls.
    assert_eq!(
        way.lines()
            .filter(|line| line.contains("actor_learning_rate="))
            .count(),
        12,
        "{way}"
    );
    let cells = way
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect::<Vec<_>>());
    let line = cells.filter(|cells| cells[1] == "settings and the best so far" && cells[8].is_empty());
    let line: Vec<f64> = line.map(|cells| cells[4].parse().unwrap()).collect();
    assert!(line.len() >= 12 && line.is_sorted(), "{way}");
    // The study names parallel coordinates itself, so that they are drawn once.
    assert!(!bench.path("results/tuned/figures/rates-settings.csv").exists());
    // A bar for each of three keys, and twelve lines over three keys and the metric.
    assert_eq!(
        (keys.lines().count(), tried.lines().count()),
        (4, 49),
        "{keys}\n{tried}"
    );
    for key in ["actor learning rate", "layers of the policy", "target entropy"] {
        assert!(keys.replace('_', " ").contains(key), "{keys}");
        assert!(tried.contains(key), "{tried}");
    }
    assert!(tried.contains("cycles"), "{tried}");
    let report = std::fs::read_to_string(bench.path("results/tuned/report.md")).unwrap();
    assert!(report.contains("% of the variance"), "{report}");
}

#[test]
fn a_search_is_shown_without_being_asked_for_and_the_winner_beside_its_value_on_fresh_seeds() {
    let bench = Bench::new();
    let study = STUDY.split("tables:").next().unwrap();
    let lengths = "tables: { lengths: { comparison: { rows: agent, value: cycle_length } } }";
    bench.write("tuned.yaml", &format!("{study}{lengths}\n"));
    bench.ok(&["run", "tuned.yaml", "-j", "2"]);
    let read = |name: &str| std::fs::read_to_string(bench.path(&format!("results/tuned/{name}"))).unwrap();
    let rows = |table: &str| -> Vec<Vec<String>> {
        let cells = |line: &str| line.split(',').map(String::from).collect();
        read(table).lines().skip(1).map(cells).collect()
    };
    let best = rows("tables/rates-best-settings.csv");
    // Five settings in the search and on fresh seeds, where only the winner has a value: that of the agent.
    let fresh: Vec<&Vec<String>> = best
        .iter()
        .filter(|cells| cells.iter().any(|it| it == "fresh"))
        .collect();
    assert_eq!((best.len(), fresh.len()), (10, 5), "{best:?}");
    let lengths = rows("tables/lengths.csv");
    let agent = lengths.iter().find(|cells| cells[0] == "dsac").unwrap();
    // Mean and both ends of its interval.
    let value = |cells: &[String]| [5, 7, 8].map(|column| cells[column].clone());
    assert_eq!(value(fresh[0]), value(agent));
    assert!(fresh[1..].iter().all(|cells| cells[5].is_empty()), "{fresh:?}");
    let page = read("index.html");
    for part in [
        "cycle length on fresh seeds",
        "id=\"rates-best-so-far\"",
        "id=\"rates-settings\"",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(read("resolved.yaml").contains("rates-best-settings"));
}
