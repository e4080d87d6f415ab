//! Extending a study: what determines a trial's numbers is its identity, so that only what is missing runs,
//! and `plan` says why.

use crate::program::{Bench, trial_files};
use serde_json::Value;
use std::{collections::BTreeMap, path::PathBuf, time::SystemTime};

const STUDY: &str = "
study: growing
environments:
  bandit: { allocation_bandit: {} }
agents:
  random: { random_allocation: {} }
  gradient: { dirichlet_gradient: { action_sd: 0.1, entropy_weight: 0.1 } }
protocol: { train_evaluate: { steps: 0, episodes: 0, evaluate_every: 0, final_episodes: 4 } }
seeds: 2
sweep:
  gradient.action_sd: { grid: [0.1, 0.2] }
tables:
  returns: { comparison: { rows: agent, value: return } }
";

/// A store that holds the study, and its files with the times of their last change.
struct Grown {
    bench: Bench,
    before: BTreeMap<PathBuf, SystemTime>,
}

impl Grown {
    fn new() -> Self {
        let bench = Bench::new();
        bench.write("study.yaml", STUDY);
        bench.ok(&["run", "study.yaml"]);
        let before = times(&bench);
        assert_eq!(
            before.len(),
            6,
            "two agents, one of them at two points, two seeds"
        );
        Self { bench, before }
    }

    /// Reasons that `plan` gives for an edited study, as `seeds: text`; running it then adds exactly `new`
    /// trials.
    fn extend(&self, study: &str, new: usize) -> Vec<String> {
        assert_ne!(study, STUDY, "the edit found its place");
        self.bench.write("study.yaml", study);
        let plan: Value =
            serde_json::from_str(&self.bench.ok(&["plan", "study.yaml", "--format", "json"])).unwrap();
        let missing: u64 = plan["cells"]
            .as_array()
            .unwrap()
            .iter()
            .map(|cell| cell["missing"].as_u64().unwrap())
            .sum();
        let reasons: Vec<String> = plan["why"].as_array().unwrap().iter().map(reason).collect();
        let printed = self.bench.ok(&["plan", "study.yaml"]);
        assert!(
            plan["why"]
                .as_array()
                .unwrap()
                .iter()
                .all(|it| printed.contains(it["text"].as_str().unwrap())),
            "{printed}"
        );
        self.bench.ok(&["run", "study.yaml"]);
        let after = times(&self.bench);
        assert_eq!(after.len(), self.before.len() + new, "{reasons:?}");
        assert!(
            self.before.iter().all(|(file, time)| after[file] == *time),
            "what was stored was left alone"
        );
        assert_eq!(missing, new as u64, "the plan said so beforehand");
        reasons
    }
}

fn reason(it: &Value) -> String {
    let words = |key: &str| it[key].as_str().unwrap().to_owned();
    format!(
        "{} {} {}: {}",
        words("agent"),
        words("setting"),
        it["seeds"],
        words("text")
    )
}

fn times(bench: &Bench) -> BTreeMap<PathBuf, SystemTime> {
    let modified = |file: PathBuf| {
        let time = std::fs::metadata(&file).unwrap().modified().unwrap();
        (file, time)
    };
    trial_files(&bench.path("store"))
        .into_iter()
        .map(modified)
        .collect()
}

#[test]
fn more_seeds() {
    let reasons = Grown::new().extend(&STUDY.replace("seeds: 2", "seeds: 4"), 6);
    assert_eq!(
        reasons,
        [
            "random  [2,3]: new seed (stored: 0-1)",
            "gradient action_sd=0.1 [2,3]: new seed (stored: 0-1)",
            "gradient action_sd=0.2 [2,3]: new seed (stored: 0-1)",
        ]
    );
}

#[test]
fn more_points_of_a_sweep() {
    let reasons = Grown::new().extend(&STUDY.replace("[0.1, 0.2]", "[0.1, 0.15, 0.2]"), 2);
    assert_eq!(reasons.len(), 1);
    assert!(
        reasons[0].starts_with("gradient action_sd=0.15 [0,1]: agent dirichlet_gradient.action_sd: "),
        "{reasons:?}"
    );
    assert!(reasons[0].ends_with(" -> 0.15"), "{reasons:?}");
}

#[test]
fn one_more_dimension_of_a_sweep_reuses_the_default() {
    let wider = STUDY.replace(
        "[0.1, 0.2] }",
        "[0.1, 0.2] }\n  gradient.entropy_weight: { grid: [0.1, 0.5] }",
    );
    let reasons = Grown::new().extend(&wider, 4);
    assert_eq!(
        reasons,
        [
            "gradient action_sd=0.1 entropy_weight=0.5 [0,1]: agent dirichlet_gradient.entropy_weight: 0.1 \
             -> 0.5",
            "gradient action_sd=0.2 entropy_weight=0.5 [0,1]: agent dirichlet_gradient.entropy_weight: 0.1 \
             -> 0.5",
        ]
    );
}

#[test]
fn another_budget_of_measurement_is_another_trial() {
    let reasons = Grown::new().extend(&STUDY.replace("final_episodes: 4", "final_episodes: 5"), 6);
    assert!(
        reasons
            .iter()
            .all(|reason| reason.ends_with("[0,1]: protocol.final_episodes: 4 -> 5")),
        "{reasons:?}"
    );
}

#[test]
fn another_environment_is_named_by_what_is_different() {
    let more = STUDY.replace(
        "{ allocation_bandit: {} }",
        "{ allocation_bandit: {} }\n  curved: { allocation_bandit: { curvature: 1 } }",
    );
    let reasons = Grown::new().extend(&more, 6);
    assert!(
        reasons
            .iter()
            .all(|it| it.ends_with("environment allocation_bandit.curvature: 0.0 -> 1.0")),
        "{reasons:?}"
    );
}

#[test]
fn tables_names_order_and_comments_change_no_identity() {
    let grown = Grown::new();
    let table =
        format!("{STUDY}  again: {{ comparison: {{ rows: agent, value: return, columns: environment }} }}\n");
    let renamed_agent = STUDY.replace("random: {", "by_chance: {");
    let renamed_environment = STUDY.replace("\n  bandit: {", "\n  one_choice: {");
    let reordered = STUDY.replace(
        "action_sd: 0.1, entropy_weight: 0.1",
        "entropy_weight: 0.1, action_sd: 0.1",
    );
    let commented = STUDY.replace("seeds: 2", "# as many as there is time for\nseeds: 2  # two");
    let defaults = STUDY.replace("{ action_sd: 0.1, entropy_weight: 0.1 }", "{}");
    for study in [
        table,
        renamed_agent,
        renamed_environment,
        reordered,
        commented,
        defaults,
    ] {
        assert_eq!(grown.extend(&study, 0), Vec::<String>::new(), "{study}");
        let run = grown.bench.run(&["run", "study.yaml"]);
        assert!(run.err.contains("nothing runs"), "{}", run.err);
    }
}

#[test]
fn an_empty_store_holds_nothing_like_it() {
    let bench = Bench::new();
    bench.write("study.yaml", STUDY);
    let plan = bench.ok(&["plan", "study.yaml"]);
    assert!(plan.contains("random"), "{plan}");
    assert!(plan.contains("nothing like it is stored"), "{plan}");
}

#[test]
fn summaries_for_continuous_integration_say_how_every_trial_ended() {
    let bench = Bench::new();
    bench.write("study.yaml", STUDY);
    let read = |name: &str| std::fs::read_to_string(bench.path(name)).unwrap();
    let arguments = [
        "status",
        "study.yaml",
        "--junit",
        "ci/before.xml",
        "--summary",
        "before.json",
    ];
    assert_eq!(bench.run(&arguments).code, 106);
    let before: Value = serde_json::from_str(&read("before.json")).unwrap();
    assert_eq!(
        (&before["exit_code"], &before["studies"][0]["counts"]["missing"]),
        (&106.into(), &6.into())
    );
    assert_eq!(read("ci/before.xml").matches("<skipped").count(), 6);
    bench.ok(&["worker", "study.yaml", "--junit", "worker.xml"]);
    assert!(
        read("worker.xml")
            .contains("<testsuites name=\"regimen\" tests=\"6\" skipped=\"0\" failures=\"0\" errors=\"0\"")
    );
    bench.ok(&[
        "run",
        "study.yaml",
        "--junit",
        "after.xml",
        "--summary",
        "after.json",
    ]);
    let after: Value = serde_json::from_str(&read("after.json")).unwrap();
    assert_eq!(
        (&after["exit_code"], &after["studies"][0]["counts"]["ok"]),
        (&0.into(), &6.into())
    );
    assert_eq!(after["studies"][0]["not_ok"], serde_json::json!([]));
    let named = "<testcase name=\"gradient/action_sd=0.2/seed 1\" classname=\"growing.bandit\"";
    assert!(read("after.xml").contains(named), "{}", read("after.xml"));
}
