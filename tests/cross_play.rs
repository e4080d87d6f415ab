//! Agents that meet after they were trained: planned, scheduled after their sources, and shown as a matrix.

use crate::{
    contracts::{acting, ready_made},
    program::{Bench, answer, trial_files},
    shrunk::shrunk,
};
use contract::{
    Action, Agent, Environment, Mode, Observation, Recorder, Registry, Transition,
    complete_config::CompleteConfig, random::stream,
};
use plugins::registry;
use serde_json::{Value, json};
use std::{collections::BTreeMap, path::PathBuf, process::Stdio};

/// Two agents that learn and one that does not, and a play of all three.
pub(crate) const STUDY: &str = "
study: pursuit
environments:
  tag: { particles: { scenario: predator_prey, episode_length: 5 } }
agents:
  tdom: { tdom_ac: { width: 4, batch_size: 4, learning_starts: 8 } }
  level: { pr2: { width: 4, batch_size: 4, learning_starts: 8 } }
  still: { zero_action: {} }
protocol: { train_evaluate: { steps: 40, environments: 2, evaluate_every: 0, episodes: 0, final_episodes: 2 \
} }
seeds: 2
cross_play:
  pursuit:
    environment: tag
    roles: { prey: [agent_3], predators: [agent_0, agent_1, agent_2] }
    agents: [tdom, level, still]
    episodes: 3
    environment_config: { episode_length: 7 }
tables:
  trained: { comparison: { value: return } }
  matrix:
    cross_play: { play: pursuit, rows: prey, columns: predators, value: score, decimals: 3 }
    published: { tdom: { level: 1.0, mean: 0.9 }, mean: { tdom: 0.5 } }
claims:
  - pursuit.prey.tdom.score > pursuit.prey.level.score
  - pursuit.predators.tdom.score < pursuit.predators.level.score
";

/// Three agents train with two seeds; nine combinations meet.
pub(crate) const TRIALS: usize = 3 * 2 + 9 * 2;

fn bench(study: &str) -> Bench {
    let bench = Bench::new();
    bench.write("pursuit.yaml", study);
    bench
}

/// Everything that is stored, as JSON, by the trial's id.
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

fn is_encounter(trial: &Value) -> bool {
    trial["key"]["agent"]["roles"].is_object()
}

#[test]
fn agents_meet_after_they_were_trained() {
    let bench = bench(STUDY);
    let out = bench.run(&["run", "pursuit.yaml", "-j", "2"]);
    assert_eq!(out.code, 0, "{}\n{}", out.out, out.err);
    bench.ok(&["run", "pursuit.yaml", "-j", "1", "--store", "other"]);
    assert_eq!(bench.digests("store").len(), TRIALS);
    assert_eq!(bench.digests("store"), bench.digests("other"));
    assert!(bench.run(&["run", "pursuit.yaml"]).err.contains("nothing runs"));
    assert_eq!(
        bench.run(&["fsck", "store"]).out.trim(),
        format!("{TRIALS} trials are whole, 0 are being computed, 0 files are wrong")
    );
    let page = std::fs::read_to_string(bench.path("results/pursuit/report.md")).unwrap();
    assert!(page.contains("score, min-max normalised"), "{page}");
    assert!(
        page.contains("pursuit.prey.tdom.score > pursuit.prey.level.score"),
        "{page}"
    );
    // The table of the trained agents has a row for each of them and none for who met whom.
    let trained = std::fs::read_to_string(bench.path("results/pursuit/tables/trained.csv"))
        .unwrap_or_else(|_| page.clone());
    assert!(
        trained.contains("tdom") && !trained.contains("prey:tdom"),
        "{trained}"
    );
}

#[test]
fn what_a_play_measures_depends_on_its_policies_and_on_nothing_else() {
    let bench = bench(STUDY);
    bench.ok(&["worker", "pursuit.yaml"]);
    let before = stored(&bench, "store");
    let without_play = STUDY.split("cross_play:").next().unwrap().to_owned();
    bench.write("alone.yaml", &without_play);
    assert!(
        bench.run(&["run", "alone.yaml"]).err.contains("nothing runs"),
        "a play changes no trial that trains"
    );
    bench.ok(&["worker", "pursuit.yaml", "--set", "tdom.discount=0.9"]);
    let new: Vec<Value> = stored(&bench, "store")
        .into_iter()
        .filter(|(id, _)| !before.contains_key(id))
        .map(|(_, it)| it)
        .collect();
    // Two seeds of tdom, and the five of nine combinations in which it plays.
    assert_eq!(new.len(), 2 + 5 * 2);
    for encounter in new.iter().filter(|trial| is_encounter(trial)) {
        let roles = encounter["key"]["agent"]["roles"].as_object().unwrap();
        assert!(
            roles
                .values()
                .any(|member| member["agent"]["config"]["discount"] == 0.9)
        );
    }
}

#[test]
fn one_more_agent_runs_only_the_combinations_that_are_new() {
    let bench = bench(&STUDY.replace("agents: [tdom, level, still]", "agents: [tdom, level]"));
    bench.ok(&["run", "pursuit.yaml"]);
    let before = bench.digests("store");
    assert_eq!(before.len(), 3 * 2 + 4 * 2);
    bench.write("pursuit.yaml", STUDY);
    let run = bench.run(&["run", "pursuit.yaml"]);
    assert!(run.err.contains("running 10 trials"), "{}", run.err);
    let after = bench.digests("store");
    assert!(after.len() == TRIALS && before.iter().all(|digest| after.contains(digest)));
}

#[test]
fn shards_and_programs_side_by_side_give_what_one_gives() {
    let bench = bench(STUDY);
    bench.ok(&["run", "pursuit.yaml", "-j", "2", "--store", "whole"]);
    bench.ok(&["worker", "pursuit.yaml", "--index", "0/2", "--store", "parts"]);
    let first = bench.digests("parts").len();
    bench.ok(&["worker", "pursuit.yaml", "--index", "1/2", "--store", "parts"]);
    assert!(first < TRIALS, "the first part lacks policies of the second");
    assert_eq!(bench.digests("whole"), bench.digests("parts"));
    let start = |_| {
        let mut command =
            bench.command(&["run", "pursuit.yaml", "-j", "1", "--store", "shared", "-o", "out"]);
        command
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    };
    for program in [0, 1].map(start) {
        let answer = answer(&program.wait_with_output().unwrap());
        assert_eq!(answer.code, 0, "{}\n{}", answer.out, answer.err);
    }
    assert_eq!(bench.digests("whole"), bench.digests("shared"));
}

#[test]
fn a_run_that_was_killed_goes_on() {
    let bench = bench(&STUDY.replace("episodes: 3\n", "episodes: 400\n"));
    bench.ok(&["run", "pursuit.yaml", "-j", "2", "--store", "whole"]);
    let mut run = bench.command(&["run", "pursuit.yaml", "-j", "2", "--store", "hurt"]);
    let mut run = run.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let patience = std::time::Instant::now() + std::time::Duration::from_secs(60);
    let met = || bench.path("hurt/trials").exists() && stored(&bench, "hurt").values().any(is_encounter);
    while !met() && std::time::Instant::now() < patience {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    run.kill().unwrap();
    run.wait().unwrap();
    assert!(
        bench.digests("hurt").len() < TRIALS,
        "it was killed in the middle"
    );
    bench.ok(&["run", "pursuit.yaml", "-j", "2", "--store", "hurt"]);
    assert_eq!(bench.digests("hurt"), bench.digests("whole"));
}

#[test]
fn what_plays_a_policy_that_never_comes_is_not_run_and_says_so() {
    let bench = bench(&STUDY.replace(
        "still: { zero_action: {} }",
        "still: { misbehaving: { how: fail } }",
    ));
    let run = bench.run_misused(&["run", "pursuit.yaml", "-j", "2"]);
    assert_eq!(run.code, 106, "{}", run.err);
    assert!(
        run.err.contains("blocked  ") && run.err.contains("it fails as asked"),
        "{}",
        run.err
    );
    assert!(run.err.contains("10 trials are blocked"), "{}", run.err);
    assert_eq!(stored(&bench, "store").len(), 3 * 2 + 4 * 2, "the others met");
    let status = bench.run_misused(&["status", "pursuit.yaml"]);
    assert_eq!(status.code, 106);
    assert!(
        status
            .out
            .contains("5 trials are blocked: tag still seed 0 ended as failed"),
        "{}",
        status.out
    );
    let status = bench.run_misused(&["status", "pursuit.yaml", "--format", "json"]);
    let status: Value = serde_json::from_str(&status.out).unwrap();
    assert_eq!(
        (
            &status["waiting"]["to_come"],
            &status["waiting"]["blocked"][0]["trials"]
        ),
        (&0.into(), &5.into())
    );
    let because = status["waiting"]["blocked"][0]["because"].as_str().unwrap();
    assert!(
        because.starts_with("tag still seed 0 ended as failed:") && because.ends_with("it fails as asked"),
        "{because}"
    );
    let again = bench.run_misused(&["run", "pursuit.yaml"]);
    assert_eq!(again.code, 106);
    assert!(again.err.contains("blocked"), "{}", again.err);
}

#[test]
fn what_plays_an_agent_that_leaves_no_policy_cannot_run_and_says_so() {
    let bench = bench(&STUDY.replace("still: { zero_action: {} }", "still: { misbehaving: {} }"));
    let run = bench.run_misused(&["run", "pursuit.yaml", "-j", "2"]);
    assert_eq!(run.code, 106, "{}", run.err);
    assert!(
        run.err.contains("what trial ") && run.err.contains("left cannot be used"),
        "{}",
        run.err
    );
    assert!(
        run.err.contains("10 trials are blocked, because what they take"),
        "{}",
        run.err
    );
    assert_eq!(
        stored(&bench, "store").len(),
        TRIALS - 5 * 2,
        "nothing is stored of what did not run"
    );
    let status = bench.run_misused(&["status", "pursuit.yaml"]);
    assert!(
        status.out.contains("left no policy that was acknowledged"),
        "{}",
        status.out
    );
}

#[test]
fn what_waits_is_said_before_anything_ran() {
    let bench = bench(STUDY);
    let plan = bench.ok(&["plan", "pursuit.yaml"]);
    // still meets still without any policy.
    assert!(
        plan.contains("16 trials wait for what other trials leave"),
        "{plan}"
    );
    assert!(plan.contains("predators:tdom prey:level"), "{plan}");
    let plan: Value = serde_json::from_str(&bench.ok(&["plan", "pursuit.yaml", "--format", "json"])).unwrap();
    assert_eq!(plan["waiting"]["to_come"], 16);
    let only = bench.run(&["run", "pursuit.yaml", "--only", "pursuit"]);
    assert_eq!(only.code, 0, "{}", only.err);
    assert_eq!(
        stored(&bench, "store").len(),
        TRIALS - 2,
        "with what it takes, and without what nothing takes"
    );
}

#[test]
fn a_policy_that_is_damaged_or_absent_keeps_what_plays_it_from_running_until_a_run_mends_it() {
    let bench = bench(STUDY);
    bench.ok(&["run", "pursuit.yaml", "--only", "tag"]);
    let trained = stored(&bench, "store");
    let of = |plugin: &str| {
        let found = trained
            .iter()
            .find(|(_, it)| it["key"]["agent"]["plugin"] == plugin && it["key"]["seed"] == 0);
        let id = found.unwrap().0.clone();
        (
            bench
                .path("store/trials")
                .join(&id[..2])
                .join(&id)
                .join("policy.safetensors"),
            id,
        )
    };
    let ((damaged, damaged_id), (absent, absent_id)) = (of("tdom_ac"), of("pr2"));
    let mut bytes = std::fs::read(&damaged).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&damaged, bytes).unwrap();
    std::fs::remove_file(absent).unwrap();
    let worker = bench.run(&["worker", "pursuit.yaml"]);
    assert!(
        worker.err.contains(&damaged_id) && worker.err.contains(&absent_id),
        "{}",
        worker.err
    );
    assert!(worker.err.contains("8 trials are blocked"), "{}", worker.err);
    assert!(
        stored(&bench, "store")
            .into_values()
            .all(|it| it["end"]["state"] == "ok"),
        "what did not run is not stored"
    );
    let status = bench.run(&["status", "pursuit.yaml"]);
    assert!(
        status.out.contains("trials are blocked: what trial "),
        "{}",
        status.out
    );
    let run = bench.run(&["run", "pursuit.yaml"]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(run.err.contains("2 damaged trials run again"), "{}", run.err);
    bench.ok(&["run", "pursuit.yaml", "--store", "whole"]);
    assert_eq!(bench.digests("store"), bench.digests("whole"));
}

#[test]
fn policies_by_seat_are_acknowledged_and_checked() {
    let study = STUDY
        .replace("tdom_ac: { width: 4,", "maddpg: { width: 4,")
        .replace("pr2: { width: 4,", "masql: { width: 4,");
    let bench = bench(&study);
    bench.ok(&["run", "pursuit.yaml", "-j", "2"]);
    assert!(bench.run(&["fsck", "store"]).out.contains(" 0 files are wrong"));
    let trained = stored(&bench, "store")
        .into_iter()
        .find(|(_, it)| it["key"]["agent"]["plugin"] == "masql")
        .unwrap();
    let names: Vec<&String> = trained.1["files"].as_object().unwrap().keys().collect();
    assert!(
        names.len() == 8 && names.iter().any(|name| *name == "agent_3/critic.safetensors"),
        "{names:?}"
    );
    let seat = bench
        .path("store/trials")
        .join(&trained.0[..2])
        .join(&trained.0)
        .join("agent_0/policy.safetensors");
    std::fs::write(seat, "no policy").unwrap();
    let found = bench.run(&["fsck", "store", "--dry-run"]).out;
    assert!(found.contains("agent_0/policy.safetensors"), "{found}");
}

/// The default config with small networks.
fn small(registry: &Registry, agent: &str) -> CompleteConfig {
    let (about, values) = (
        &registry.agents[agent].about,
        json!({"width": 5, "batch_size": 4, "learning_starts": 8}),
    );
    let config = shrunk(about, &values);
    let taken = values
        .as_object()
        .unwrap()
        .iter()
        .all(|(key, value)| config[key] == *value);
    assert!(taken, "{agent}: {config:?}");
    config
}

fn trained(agent: &mut dyn Agent, environment: &mut dyn Environment) -> Vec<Observation> {
    let (mut rng, mut record, mut seen) = (stream(&["train"]), Recorder::default(), Vec::new());
    let mut seats = environment.reset(&mut rng).unwrap();
    for _ in 0..20 {
        let observation = Observation {
            seats,
            state: environment.state(),
        };
        let action: Action = agent
            .act(std::slice::from_ref(&observation), Mode::Train, &mut rng)
            .unwrap()
            .remove(0);
        let step = environment.step(&action, &mut rng).unwrap();
        let next_observation = Observation {
            seats: step.observations.clone(),
            state: environment.state(),
        };
        let (rewards, end) = (step.rewards, step.end);
        seen.push(observation.clone());
        agent
            .learn(
                &[Transition {
                    observation,
                    action,
                    rewards,
                    next_observation,
                    end,
                }],
                &mut rng,
                &mut record,
            )
            .unwrap();
        seats = if end.is_some() {
            environment.reset(&mut rng).unwrap()
        } else {
            step.observations
        };
    }
    seen
}

#[test]
fn every_agent_with_several_seats_takes_up_the_policy_that_it_exported_to_the_bit() {
    let registry = registry();
    let mut checked = Vec::new();
    for (name, entry) in acting(&registry).filter(|(_, entry)| entry.traits.learns()) {
        for environment in ready_made(&registry) {
            let environment = &registry.environments[environment];
            let mut environment = (environment.build)(&environment.about.defaults).unwrap();
            let interface = environment.interface();
            let build =
                |start: &str| (entry.build)(&small(&registry, name), &interface, &mut stream(&[start]));
            if interface.seats.len() < 2
                || (entry.build)(&entry.about.defaults, &interface, &mut stream(&["one"])).is_err()
            {
                continue;
            }
            let (mut one, mut two) = (build("one").unwrap(), build("two").unwrap());
            let seen = trained(&mut *one, &mut *environment);
            let act =
                |agent: &mut dyn Agent| agent.act(&seen, Mode::Evaluate, &mut stream(&["act"])).unwrap();
            let folder = tempfile::tempdir().unwrap();
            assert!(one.export(folder.path()).unwrap(), "{name}");
            assert_ne!(
                act(&mut *one),
                act(&mut *two),
                "{name}: agents of different starts"
            );
            assert!(two.import(folder.path()).unwrap(), "{name}");
            assert_eq!(act(&mut *one), act(&mut *two), "{name}");
            assert!(two.import(&folder.path().join("nowhere")).is_err(), "{name}");
            checked.push(name);
        }
    }
    checked.dedup();
    assert!(checked.len() >= 8, "{checked:?}");
}
