//! Learning that goes on in another trial: to the same bits as if it had never been cut, for every agent, and in
//! populations whose members take up what others have learned.

use crate::{
    program::{Bench, trial_files},
    resume::keys,
};
use contract::{
    Error, NoKeeper, Phase, Registry, part::Part, protocol::Run, random::Streams, trial::TrialKey,
};
use plugins::registry;
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    os::unix::process::CommandExt,
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    process::{Command, Stdio},
    time::Duration,
};

/// Files that the agent saved at the end of learning, and the record until then.
#[derive(Debug, PartialEq)]
struct Learned {
    files: BTreeMap<String, Vec<u8>>,
    rows: Vec<(String, u64, u64, u16, u64)>,
}

/// Learns up to a step in `folder`, from the first one or from what lies in the folder `from`.
fn learn(
    registry: &Registry,
    key: &TrialKey,
    steps: u64,
    (from, folder): (Option<&Path>, &Path),
) -> Result<Learned, Error> {
    let find = |name: &str, part: &Part| {
        assert!(part.files.is_empty() && part.artifacts.is_empty(), "{name}");
        part.config.clone()
    };
    let mut protocol = find("protocol", &key.protocol);
    (protocol["steps"], protocol["leave_checkpoint"]) = (json!(steps), json!(true));
    if let Some(from) = from {
        protocol["go_on_from"] = json!({ "from": "before", "product": "checkpoint", "folder": from });
    }
    let protocol = (registry.protocols["train_evaluate"].build)(&protocol)?;
    let environment = &registry.environments[key.environment.plugin.as_str()];
    let config = find("environment", &key.environment);
    let make_environment = || (environment.build)(&config);
    let interface = make_environment()?.interface();
    let agent = key.agent.agent().unwrap();
    let streams = Streams::new("cut", "cut", 3);
    let entry = &registry.agents[agent.plugin.as_str()];
    let agent = (entry.build)(
        &find("agent", agent),
        &interface,
        &mut streams.agent("initialise"),
    )?;
    let mut run = Run {
        make_environment: &make_environment,
        agent,
        streams,
        record: Default::default(),
        progress: &mut |_, _| {},
        assignment: Default::default(),
        keeper: &mut NoKeeper,
        folder: Some(folder),
    };
    protocol.run(&mut run)?;
    let names = run.record.names();
    let learned = run
        .record
        .rows()
        .iter()
        .filter(|row| row.phase == Phase::Train || row.phase == Phase::Evaluate);
    let row = |row: &contract::recorder::Row| {
        let name = format!("{} {}", row.phase.name(), names[usize::from(row.metric)]);
        (name, row.step, row.episode, row.seat, row.value.to_bits())
    };
    let (mut files, rows) = (BTreeMap::new(), learned.map(row).collect());
    read_into(&folder.join("checkpoint/agent"), "", &mut files);
    Ok(Learned { files, rows })
}

fn read_into(folder: &Path, at: &str, files: &mut BTreeMap<String, Vec<u8>>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let name = format!("{at}{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            read_into(&entry.path(), &format!("{name}/"), files);
        } else {
            files.insert(name, std::fs::read(entry.path()).unwrap());
        }
    }
}

#[test]
fn learning_that_is_cut_in_three_ends_as_learning_that_is_whole() {
    let registry = registry();
    let mut cut = Vec::new();
    let learners = crate::contracts::acting(&registry).filter(|(_, entry)| entry.traits.learns());
    for (name, _) in learners {
        let of_decisions = |key: &TrialKey| {
            key.protocol.plugin == "train_evaluate" && key.environment.plugin != "generator_search"
        };
        for key in keys(&registry, name).into_iter().filter(of_decisions) {
            let folder = tempfile::tempdir().unwrap();
            let part = |part: &str| {
                let path = folder.path().join(part);
                std::fs::create_dir(&path).unwrap();
                path
            };
            let (whole, [one, two, three]) = (part("whole"), ["one", "two", "three"].map(part));
            let whole = catch_unwind(AssertUnwindSafe(|| learn(&registry, &key, 72, (None, &whole))));
            // Some agents do not fit an environment, and some learn from other things than decisions.
            let Ok(Ok(whole)) = whole else { continue };
            learn(&registry, &key, 24, (None, &one)).unwrap();
            learn(&registry, &key, 48, (Some(&one), &two)).unwrap();
            let last = learn(&registry, &key, 72, (Some(&two), &three)).unwrap();
            assert!(whole == last, "{name} in {}", key.environment.plugin);
            assert!(
                !whole.files.is_empty() && whole.rows.iter().any(|row| row.1 < 48),
                "{name}"
            );
            cut.push(name);
            break;
        }
    }
    assert!(
        cut.len() > 8 && cut.contains(&"dirichlet_sac") && cut.contains(&"tdom_ac"),
        "{cut:?}"
    );
}

#[test]
fn what_does_not_fit_is_said_before_anything_is_learned() {
    let registry = registry();
    let key = keys(&registry, "dirichlet_sac")
        .into_iter()
        .find(|key| key.protocol.plugin == "train_evaluate" && key.environment.plugin == "battery")
        .unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["one", "two"] {
        std::fs::create_dir(path(name)).unwrap();
    }
    learn(&registry, &key, 24, (None, &path("one"))).unwrap();
    let refused = |key: &TrialKey, steps| {
        learn(&registry, key, steps, (Some(&path("one")), &path("two")))
            .unwrap_err()
            .to_string()
    };
    let said = refused(&key, 24);
    assert!(
        said.contains("it stands at step 24, and learning ends at step 24 here"),
        "{said}"
    );
    let mut more = key.clone();
    let mut config = Value::clone(&more.protocol.config);
    config["environments"] = json!(8);
    std::sync::Arc::make_mut(&mut more.protocol).config = config.into();
    let said = refused(&more, 72);
    assert!(
        said.contains("4 environments learned together, and here 8 do"),
        "{said}"
    );
    std::fs::remove_dir_all(path("one").join("checkpoint/agent")).unwrap();
    let said = refused(&key, 72);
    assert!(said.contains("does not fit this agent"), "{said}");
}

const STAGES: &str = "
study: stages
environments: { cells: { battery: { cells: 2 } }, other: { battery: { cells: 2, sensor_noise: true } } }
agents:
  dsac: { dirichlet_sac: { width: 8, batch_size: 16, learning_starts: 64, actor_learning_rate: 0.0001 } }
prepare:
  early:
    environment: cells
    agent: { dirichlet_sac: { width: 8, batch_size: 16, learning_starts: 64, actor_learning_rate: 0.01 } }
    protocol: { train_evaluate: { steps: 96, environments: 8, evaluate_every: 48, episodes: 1, final_episodes: 2, leave_checkpoint: true } }
exclude: [{ environment: other }]
protocol: { train_evaluate: { steps: 192, environments: 8, evaluate_every: 48, episodes: 1, final_episodes: 2, \
go_on_from: { from: early } } }
seeds: 2
figures: { curve: { learning_curve: { metric: cycle_length } } }
tables: { lengths: { comparison: { rows: agent, value: cycle_length } } }
";

#[test]
fn a_study_says_by_hand_how_settings_change_while_learning_goes_on() {
    let bench = Bench::new();
    bench.write("stages.yaml", STAGES);
    bench.ok(&["run", "stages.yaml", "-j", "2"]);
    let stored = bench.digests("store");
    assert_eq!(stored.len(), 4);
    // The curve is whole: what was measured before learning went on stands in it.
    let curve = std::fs::read_to_string(bench.path("results/stages/figures/curve.csv")).unwrap();
    for step in ["0", "48", "96", "144", "192"] {
        assert!(
            curve.lines().any(|line| line.split(',').any(|cell| cell == step)),
            "{step}\n{curve}"
        );
    }
    let verified = bench.ok(&["verify", "stages.yaml"]);
    assert!(verified.contains("4 the same, 0 different"), "{verified}");
    let refused = |from: &str, to: &str, said: &str| {
        assert!(STAGES.contains(from));
        bench.write("wrong.yaml", &STAGES.replace(from, to));
        let answer = bench.run(&["check", "wrong.yaml"]);
        assert_eq!(answer.code, 2, "{}", answer.err);
        assert!(
            answer.err.contains(said) && answer.err.contains("wrong.yaml:"),
            "{}",
            answer.err
        );
    };
    refused(", leave_checkpoint: true", "", "and a checkpoint is taken here");
    refused(
        "environment: cells\n",
        "environment: other\n",
        "learns in another environment",
    );
    let narrower =
        "{ dirichlet_sac: { width: 4, batch_size: 16, learning_starts: 64, actor_learning_rate: 0.01 } }";
    let written =
        "{ dirichlet_sac: { width: 8, batch_size: 16, learning_starts: 64, actor_learning_rate: 0.01 } }";
    refused(written, narrower, "does not fit the agent that shall go on");
}

const POPULATION: &str = "
study: grown
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 8, batch_size: 16, learning_starts: 64 } }
protocol: { train_evaluate: { steps: 192, environments: 8, evaluate_every: 48, episodes: 1, final_episodes: 2 } }
seeds: 2
tune:
  rates:
    over:
      dsac.actor_learning_rate: { log_uniform: { low: 0.0001, high: 0.1 } }
      dsac.batch_size: { choice: [8, 16, 32] }
    metric: cycle_length
    settings: 4
    method: { population: { pauses: [64, 128] } }
tables:
  settings: { best_settings: { search: rates, best: 3 } }
  lengths: { comparison: { rows: agent, value: cycle_length } }
figures: { curve: { learning_curve: { metric: cycle_length } } }
";

fn rendered(bench: &Bench) -> [String; 3] {
    ["tables/settings.csv", "tables/lengths.csv", "report.md"]
        .map(|name| std::fs::read_to_string(bench.path(&format!("results/grown/{name}"))).unwrap())
}

/// A report without what differs from run to run.
fn tables(bench: &Bench) -> [String; 2] {
    let [settings, lengths, _] = rendered(bench);
    [settings, lengths]
}

#[test]
fn a_population_ends_alike_for_any_number_of_workers_and_after_kills() {
    let bench = Bench::new();
    bench.write("grown.yaml", POPULATION);
    let plan = bench.ok(&["plan", "grown.yaml"]);
    assert!(plan.contains("4 members learn in generation 1 of 3"), "{plan}");
    bench.ok(&["run", "grown.yaml", "-j", "1", "--store", "one"]);
    let (expected, whole, [_, _, report]) = (tables(&bench), bench.digests("one"), rendered(&bench));
    // Four members in three generations, a rule with two seeds, and the schedule of three parts with two seeds.
    assert_eq!(whole.len(), 12 + 2 + 6);
    let said = "Search rates of dsac: its schedule is that of the best of 4 members after 3 generations";
    assert!(
        report.contains(said) && report.contains("The schedule: actor\\_learning\\_rate="),
        "{report}"
    );
    assert!(report.contains("to the end"), "{report}");
    assert!(report.contains("schedule of dsac in cells"), "{report}");
    bench.ok(&["run", "grown.yaml", "-j", "2", "--store", "two"]);
    assert_eq!(
        (tables(&bench), bench.digests("two")),
        (expected.clone(), whole.clone())
    );
    for round in 0..12u64 {
        let mut command = bench.command(&["run", "grown.yaml", "-j", "2", "--store", "killed"]);
        let mut child = command
            .process_group(0)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(40 * round));
        let group = format!("-{}", child.id());
        let _ = Command::new("kill")
            .args(["-KILL", "--", &group])
            .stderr(Stdio::null())
            .status();
        child.wait().unwrap();
    }
    bench.ok(&["run", "grown.yaml", "-j", "2", "--store", "killed"]);
    assert_eq!((tables(&bench), bench.digests("killed")), (expected, whole));
    let plan = bench.ok(&["plan", "grown.yaml", "--store", "one"]);
    assert!(plan.contains("nothing is missing"), "{plan}");
    // The results of the agent were learned along the schedule, on seeds of the study.
    let goes_on = |file: &std::path::PathBuf| {
        let trial: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
        let key = &trial["key"];
        key["protocol"]["config"]["go_on_from"].is_object() && key["seed"].as_u64().unwrap() < 2
    };
    let files = trial_files(&bench.path("one"));
    assert_eq!(files.iter().filter(|file| goes_on(file)).count(), 4);
}

#[test]
fn populations_that_cannot_be_are_refused() {
    let bench = Bench::new();
    let refused = |from: &str, to: &str, said: &[&str]| {
        assert!(POPULATION.contains(from));
        bench.write("wrong.yaml", &POPULATION.replace(from, to));
        let answer = bench.run(&["check", "wrong.yaml"]);
        assert_eq!(answer.code, 2, "{}", answer.err);
        assert!(
            said.iter().all(|said| answer.err.contains(said)),
            "{}",
            answer.err
        );
    };
    let batch = "dsac.batch_size: { choice: [8, 16, 32] }";
    refused(
        batch,
        "dsac.width: { choice: [8, 16] }",
        &[
            "members with different `dsac.width` cannot take up what others have learned",
            "wrong.yaml:13:",
        ],
    );
    refused(
        "[64, 128]",
        "[64, 192]",
        &["learning ends at step 192, so that nothing goes on at step 192"],
    );
    refused("[64, 128]", "[128, 64]", &["pauses do not rise"]);
    refused(
        "settings: 4",
        "settings: 1",
        &["a population of one setting has nobody to learn from"],
    );
    refused(
        "seeds: 2\n",
        "seeds: 2\nprepare: { trained: { environment: cells, agent: dsac } }\n",
        &["the entry `trained` would need the whole schedule"],
    );
    let tracked = "protocol: { track: { episodes: 2 } }\n";
    let start = POPULATION.find("protocol:").unwrap();
    let end = POPULATION.find("seeds: 2").unwrap();
    refused(
        &POPULATION[start..end],
        tracked,
        &["in `track` learning cannot go on from another trial's"],
    );
}
