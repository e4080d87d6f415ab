//! Simulators through `regimen rollout`, against trajectories of other programs.

use crate::program::{Bench, repository, trial_files};
use contract::{
    Phase,
    metrics_file::{self, MetricsTable},
    random::stream,
    recorder::Row,
    trial::TrialKey,
};
use execution::store::Store;
use plugins::registry;
use session::rollout::{Actions, rows};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

fn fixture(name: &str) -> PathBuf {
    repository().join("tests/fixtures").join(name)
}

type Columns = BTreeMap<String, Vec<f64>>;

/// Columns of a CSV file by name; empty cells are NaN.
fn columns(path: &Path) -> Columns {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut columns: Columns = names
        .iter()
        .map(|name| ((*name).to_owned(), Vec::new()))
        .collect();
    for line in lines {
        for (name, cell) in names.iter().zip(line.split(',')) {
            columns
                .get_mut(*name)
                .unwrap()
                .push(cell.parse().unwrap_or(f64::NAN));
        }
    }
    columns
}

const STATES: [&str; 8] = ["tb", "Vo", "Vsn", "Vsp", "qnB", "qnS", "qpB", "qpS"];

#[test]
fn one_cell_at_constant_power_follows_the_other_program() {
    let bench = Bench::new();
    bench.write(
        "cell.yaml",
        "cells: 1\nthermal: true\ndecision_interval_s: 10\nload: { constant: { power_w: 8 } }\nstart: full\n",
    );
    let actions = format!("weight_1\n{}", "1\n".repeat(300));
    bench.write("actions.csv", &actions);
    bench.ok(&[
        "rollout",
        "battery",
        "--config",
        "cell.yaml",
        "--actions",
        "actions.csv",
        "--out",
        "out.csv",
    ]);
    let (ours, theirs) = (
        columns(&bench.path("out.csv")),
        columns(&fixture("battery/const_power_8W.csv")),
    );
    let mut compared = 0;
    for (row, time) in theirs["t_s"].iter().enumerate() {
        let Some(mine) = ours["t_s"].iter().position(|t| (t - time).abs() < 1e-9) else {
            continue;
        };
        assert!(
            (ours["voltage_1"][mine] - theirs["v_V"][row]).abs() < 1e-6,
            "voltage at {time} s"
        );
        for state in STATES {
            let (one, other) = (ours[&format!("{state}_1")][mine], theirs[state][row]);
            assert!(
                (one - other).abs() <= 1e-9 * other.abs().max(1e-6),
                "{state} at {time} s: {one} against {other}"
            );
        }
        compared += 1;
    }
    assert!(compared >= 8, "only {compared} rows could be compared");
}

/// Config and actions of a reference run of predators and prey, under this program's names.
fn as_input(reference: &Columns) -> (String, String) {
    let place = |name: String| {
        format!(
            "[{}, {}]",
            reference[&format!("{name}x")][0],
            reference[&format!("{name}y")][0]
        )
    };
    let places = |letter: &str, count: usize| {
        (0..count)
            .map(|i| place(format!("{letter}{i}")))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let start = format!(
        "{{ agents: [{}], landmarks: [{}] }}",
        places("p", 4),
        places("l", 2)
    );
    let each = |entry: &dyn Fn(usize, &str) -> String| {
        (0..4)
            .flat_map(|agent| ["x", "y"].map(|axis| entry(agent, axis)))
            .collect::<Vec<_>>()
            .join(",")
            + "\n"
    };
    let row = |row: usize| each(&|agent, axis| reference[&format!("u{agent}{axis}")][row].to_string());
    let header = each(&|agent, axis| format!("agent_{agent}.force_{axis}"));
    let actions = header + &(1..reference["t"].len()).map(row).collect::<String>();
    (format!("scenario: predator_prey\nstart: {start}\n"), actions)
}

/// Predators and prey of the thesis' authors, with every column that a person would look for.
#[test]
fn several_seats_follow_the_other_program() {
    let bench = Bench::new();
    let theirs = columns(&fixture("particles/thesis_tag.csv"));
    let (config, actions) = as_input(&theirs);
    bench.write("tag.yaml", &config);
    bench.write("actions.csv", &actions);
    bench.ok(&[
        "rollout",
        "particles",
        "--config",
        "tag.yaml",
        "--actions",
        "actions.csv",
        "--out",
        "out.csv",
    ]);
    let ours = columns(&bench.path("out.csv"));
    let agree = |one: String, other: String, first: usize| {
        assert_eq!(ours[&one].len(), theirs[&other].len(), "{one}");
        let mut pairs = ours[&one].iter().zip(&theirs[&other]).skip(first);
        assert!(pairs.all(|(one, other)| (one - other).abs() < 1e-9), "{one}");
    };
    agree("t".into(), "t".into(), 0);
    agree("landmark_1.position_y".into(), "l1y".into(), 0);
    for agent in 0..4 {
        agree(format!("agent_{agent}.reward"), format!("r{agent}"), 1);
        assert!(ours[&format!("agent_{agent}.reward")][0].is_nan());
        for (axis, entry) in [("x", 2), ("y", 3)] {
            agree(
                format!("agent_{agent}.position_{axis}"),
                format!("p{agent}{axis}"),
                0,
            );
            agree(
                format!("agent_{agent}.velocity_{axis}"),
                format!("v{agent}{axis}"),
                0,
            );
            agree(
                format!("agent_{agent}.force_{axis}"),
                format!("u{agent}{axis}"),
                1,
            );
            agree(format!("agent_{agent}.obs_{entry}"), format!("p{agent}{axis}"), 0);
        }
    }
    assert!(ours.contains_key("agent_2.obs_15") && !ours.contains_key("agent_3.obs_14"));
}

#[test]
fn wrong_action_files_are_refused_with_the_place() {
    let bench = Bench::new();
    for (text, message) in [
        (
            "weight_1,weight_2\n0.5,0.5\n",
            "error: `weights.csv`, line 1: column `weight_3` is missing",
        ),
        (
            "weight_1,weight_2,weight_3,weight_4\n0.25,0.25,0.25,x\n",
            "error: `weights.csv`, line 2, column `weight_4`: `x` is no number",
        ),
        (
            "weight_1,weight_2,weight_3,weight_4\n0.25,0.25,0.25,0.25\n0.25,0.25,0.25,0.5\n",
            "error: action outside its space: decision 2: the entries sum to 1.25, not to 1",
        ),
    ] {
        bench.write("weights.csv", text);
        let answer = bench.run(&[
            "rollout",
            "battery",
            "--actions",
            "weights.csv",
            "--out",
            "out.csv",
        ]);
        assert_eq!((answer.code, answer.err.trim()), (2, message));
    }
}

#[test]
fn an_agent_can_decide_and_the_seed_decides_the_rest() {
    let bench = Bench::new();
    for out in ["a.csv", "b.csv"] {
        bench.ok(&[
            "rollout",
            "battery",
            "--agent",
            "equal_split",
            "--seed",
            "7",
            "--out",
            out,
        ]);
    }
    bench.ok(&[
        "rollout",
        "battery",
        "--agent",
        "equal_split",
        "--seed",
        "8",
        "--out",
        "c.csv",
    ]);
    let read = |name: &str| std::fs::read_to_string(bench.path(name)).unwrap();
    assert_eq!(read("a.csv"), read("b.csv"));
    assert_ne!(read("a.csv"), read("c.csv"));
    assert!(read("a.csv").lines().last().unwrap().ends_with("terminated"));
}

/// Learners of every kind of policy file, a rule, and a play of two of them.
const STUDY: &str = "
study: lives
environments:
  pack: { battery: { episode_limit: 40, ageing: {} } }
  tag: { particles: { scenario: predator_prey, episode_length: 6 } }
agents:
  dense: { dirichlet_sac: { width: 8, batch_size: 8, learning_starts: 16, evaluation_action: mode } }
  alike: { dirichlet_sac: { width: 8, batch_size: 8, learning_starts: 16, network: equivariant } }
  softmax: { gaussian_softmax_sac: { width: 8, batch_size: 8, learning_starts: 16 } }
  ddpg: { ddpg: { width: 8, batch_size: 8, learning_starts: 16, observation_scaling: none } }
  equal: { equal_split: {} }
  stein: { masql: { width: 4, batch_size: 4, learning_starts: 8 } }
  tdom: { tdom_ac: { width: 4, batch_size: 4, learning_starts: 8 } }
protocol: { train_evaluate: { steps: 48, environments: 4, evaluate_every: 0, episodes: 0, final_episodes: \
5, trace_episodes: 5 } }
exclude:
  - { environment: tag, agent: dense }
  - { environment: tag, agent: alike }
  - { environment: tag, agent: softmax }
  - { environment: tag, agent: ddpg }
  - { environment: tag, agent: equal }
  - { environment: pack, agent: stein }
  - { environment: pack, agent: tdom }
cross_play:
  pursuit:
    environment: tag
    roles: { prey: [agent_3], predators: [agent_0, agent_1, agent_2] }
    agents: [stein, tdom]
    episodes: 3
";

/// Stored trials by id, each with the plugins of environment and agent and the end state.
fn trials(bench: &Bench) -> Vec<(String, String, String)> {
    let read = |file: PathBuf| {
        let trial: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
        let id = file
            .parent()
            .unwrap()
            .file_name()
            .unwrap()
            .to_string_lossy()
            .into_owned();
        // An agent that plays policies of others is no plugin.
        let plugin = |part: &str| trial["key"][part]["plugin"].as_str().unwrap_or("cast").to_owned();
        (id, plugin("environment"), plugin("agent"))
    };
    trial_files(&bench.path("store")).into_iter().map(read).collect()
}

fn trained() -> Bench {
    let bench = Bench::new();
    bench.write("lives.yaml", STUDY);
    bench.ok(&["worker", "lives.yaml", "-j", "2"]);
    bench
}

#[test]
fn an_episode_of_a_stored_trial_is_played_again_to_the_bit() {
    let bench = trained();
    let all = trials(&bench);
    assert_eq!(all.len(), 5 + 2 + 4);
    for (id, _, agent) in &all {
        let folder = bench.path("store/trials").join(&id[..2]).join(id);
        let stored = metrics_file::read(&folder.join("metrics.parquet")).unwrap();
        for episode in [0, 2] {
            let number = episode.to_string();
            let words = ["--trial", &id[..12], "--episode", &number, "--out", "out.csv"];
            bench.ok(&[&["rollout"], &words[..]].concat());
            let ours = columns(&bench.path("out.csv"));
            let compared =
                assert_same_trace(&ours, &stored, episode) + assert_same_returns(&ours, &stored, episode);
            // Trials of a play trace nothing: only their returns, one per seat, can be compared.
            assert!(
                compared > if agent == "cast" { 3 } else { 60 },
                "{agent}: {compared}"
            );
        }
    }
    bench.ok(&[
        "rollout",
        "battery",
        "--trial",
        &of(&all, "equal_split"),
        "--decisions",
        "3",
        "--out",
        "short.csv",
    ]);
    assert_eq!(
        columns(&bench.path("short.csv"))["decision"],
        [0.0, 1.0, 2.0, 3.0]
    );
}

/// The rows of an episode in a phase, each with the name of its metric.
fn rows_of(stored: &MetricsTable, phase: Phase, episode: u64) -> impl Iterator<Item = (&str, &Row)> {
    let rows = stored.rows.iter();
    rows.filter(move |row| row.phase == phase && row.episode == episode)
        .map(|row| (stored.names[usize::from(row.metric)].as_str(), row))
}

/// Holds an episode against the stored trace, decision by decision; gives the number of values.
fn assert_same_trace(ours: &Columns, stored: &MetricsTable, episode: u64) -> usize {
    let compare = |(name, row): (&str, &Row)| {
        let decision = usize::try_from(row.step).unwrap();
        let value = ours[name][decision];
        assert_eq!(value.to_bits(), row.value.to_bits(), "{name} after {decision}");
    };
    rows_of(stored, Phase::Trace, episode).map(compare).count()
}

/// Holds the sums of an episode's rewards against the stored returns; gives the number of seats.
fn assert_same_returns(ours: &Columns, stored: &MetricsTable, episode: u64) -> usize {
    let compare = |(_, row): (&str, &Row)| {
        let seat = match ours.contains_key("reward") {
            true => "reward".into(),
            false => format!("agent_{}.reward", row.seat),
        };
        let earned = ours[&seat][1..].iter().fold(0.0, |sum, reward| sum + reward);
        assert_eq!(earned.to_bits(), row.value.to_bits(), "{seat}");
    };
    let rows = rows_of(stored, Phase::Final, episode);
    rows.filter(|(name, _)| *name == "return").map(compare).count()
}

/// The id of the trial of an agent's plugin.
fn of(trials: &[(String, String, String)], plugin: &str) -> String {
    trials
        .iter()
        .find(|(_, _, agent)| agent == plugin)
        .unwrap()
        .0
        .clone()
}

#[test]
fn a_stored_policy_plays_a_new_episode_as_the_imported_agent_does() {
    let bench = trained();
    let store = Store::at(bench.path("store"));
    bench.write("pack.yaml", "episode_limit: 40\nageing: {}\n");
    let all = trials(&bench);
    for (id, _, agent) in all.iter().filter(|(_, environment, _)| environment == "battery") {
        bench.ok(&["rollout", "--trial", id, "--seed", "3", "--out", "trial.csv"]);
        let key = store.file(id).unwrap().unwrap().key;
        let folder = store.folder(id);
        let learns = play_imported(&key, &folder, &bench.path("expected.csv"));
        assert_same_files(&bench, "trial.csv", "expected.csv");
        if learns {
            play(&bench, &folder.display().to_string(), &["--out", "folder.csv"]);
            assert_same_files(&bench, "trial.csv", "folder.csv");
            leave_policy_alone(&bench, &folder, &key);
            let words = [
                "--agent",
                agent,
                "--agent-config",
                "agent.yaml",
                "--out",
                "alone.csv",
            ];
            play(&bench, "alone", &words);
            assert_same_files(&bench, "trial.csv", "alone.csv");
        }
    }
}

/// Lets an agent of a trial's config, with the trial's policy, play an episode of seed 3; says whether it learns.
fn play_imported(key: &TrialKey, folder: &Path, out: &Path) -> bool {
    let registry = registry();
    let mut pack = (registry.environments["battery"].build)(&key.environment.config).unwrap();
    let part = key.agent.agent().unwrap();
    let entry = &registry.agents[part.plugin.as_str()];
    let mut networks = stream(&["other networks"]);
    let mut agent = (entry.build)(&part.config, &pack.interface(), &mut networks).unwrap();
    let learns = entry.traits.learns();
    assert_eq!(agent.import(folder).unwrap(), learns, "{}", part.plugin);
    let actions = Actions::Agent {
        agent: &mut *agent,
        decisions: 1000,
    };
    session::rollout::write(&rows(&mut *pack, actions, 3).unwrap(), out).unwrap();
    learns
}

/// Plays an episode of seed 3 by a policy in a folder.
fn play(bench: &Bench, folder: &str, words: &[&str]) {
    let common = [
        "rollout",
        "battery",
        "--config",
        "pack.yaml",
        "--seed",
        "3",
        "--policy",
        folder,
    ];
    bench.ok(&[&common[..], words].concat());
}

/// Puts the policy of a trial into the folder `alone`, without the trial, and the agent's config beside it.
fn leave_policy_alone(bench: &Bench, folder: &Path, key: &TrialKey) {
    const FILE: &str = "policy.safetensors";
    std::fs::create_dir_all(bench.path("alone")).unwrap();
    std::fs::copy(folder.join(FILE), bench.path("alone").join(FILE)).unwrap();
    bench.write("agent.yaml", &key.agent.agent().unwrap().config.to_string());
}

fn assert_same_files(bench: &Bench, one: &str, other: &str) {
    let [one, other] = [one, other].map(|name| std::fs::read_to_string(bench.path(name)).unwrap());
    assert_eq!(one, other);
}

#[test]
fn a_learner_without_a_policy_is_refused_and_so_is_a_policy_that_does_not_fit() {
    let bench = trained();
    let id = trials(&bench)
        .iter()
        .find(|(_, _, agent)| agent == "ddpg")
        .unwrap()
        .0
        .clone();
    let folder = Store::at(bench.path("store")).folder(&id).display().to_string();
    for name in ["empty", "alone"] {
        std::fs::create_dir_all(bench.path(name)).unwrap();
    }
    std::fs::copy(
        format!("{folder}/policy.safetensors"),
        bench.path("alone/policy.safetensors"),
    )
    .unwrap();
    let refusals: [(&[&str], &[&str]); 7] = [
        (
            &["battery", "--agent", "dirichlet_sac"],
            &["`dirichlet_sac` learns", "`--trial ID`", "`--policy FOLDER`"],
        ),
        (
            &["battery", "--policy", "empty"],
            &["`empty` does not say whose policy it holds", "`--agent`"],
        ),
        (
            &["battery", "--policy", "empty", "--agent", "ddpg"],
            &["the policy in `empty` cannot be used", "cannot read"],
        ),
        (
            &["battery", "--policy", &folder, "--agent", "equal_split"],
            &["`equal_split` takes up no stored policy"],
        ),
        (
            &["battery", "--policy", "alone", "--agent", "ddpg"],
            &["cannot be used", "`center` of the policy is"],
        ),
        (
            &["battery", "--policy", &folder, "--config", "eight.yaml"],
            &["cannot be used", "`inputs` of the policy is"],
        ),
        (
            &["battery", "--policy", &folder, "--agent", "dpg"],
            &["unknown agent `dpg`", "did you mean `ddpg`?"],
        ),
    ];
    bench.write("eight.yaml", "cells: 8\n");
    for (words, parts) in refusals {
        let answer = bench.run(&[&["rollout"], words, &["--out", "out.csv"]].concat());
        assert_eq!(answer.code, 2, "{words:?}: {}", answer.err);
        assert!(
            parts.iter().all(|part| answer.err.contains(part)),
            "{words:?}: {}",
            answer.err
        );
    }
    assert!(!bench.path("out.csv").exists());
}

/// 17 trials that end well, and 17 that fail.
fn with_failures() -> Bench {
    let bench = Bench::new();
    let many = "study: many\nenvironments: { four: { allocation_bandit: {} } }\n\
                protocol: { train_evaluate: { steps: 8, evaluate_every: 0, final_episodes: 2 } }\n";
    let agents = "agents: { equal: { equal_split: {} }, bad: { misbehaving: { how: fail } } }\nseeds: 17\n";
    bench.write("many.yaml", &format!("{many}{agents}"));
    bench.run_misused(&["worker", "many.yaml", "-j", "2"]);
    bench
}

#[test]
fn a_trial_that_cannot_be_played_is_refused_with_the_reason() {
    let bench = with_failures();
    let all = trials(&bench);
    let (good, failed) = (of(&all, "equal_split"), of(&all, "misbehaving"));
    // Of 34 ids at least three begin with the same digit.
    let digit = "0123456789abcdef"
        .chars()
        .find(|digit| all.iter().filter(|it| it.0.starts_with(*digit)).count() > 2)
        .unwrap();
    let common = all.iter().filter(|it| it.0.starts_with(digit)).count();
    std::fs::create_dir_all(bench.path("store/trials/zz/zz0")).unwrap();
    let digit = digit.to_string();
    let refusals: [(&[&str], Vec<String>); 7] = [
        (
            &["--trial", "xy"],
            vec!["no trial in `store` has an id that begins with `xy`".into()],
        ),
        (
            &["--trial", &digit],
            vec![
                format!("`{digit}` begins the ids of {common} trials"),
                "give more digits".into(),
            ],
        ),
        (
            &["--trial", &failed],
            vec![
                format!("trial {failed} ended as failed: "),
                "it fails as asked".into(),
            ],
        ),
        (&["--trial", "zz"], vec!["trial zz0 has not ended".into()]),
        (
            &["battery", "--trial", &good],
            vec![format!(
                "trial {good} is of `allocation_bandit`, not of `battery`"
            )],
        ),
        (
            &["--trial", &good, "--episode", "2"],
            vec!["its final measurement has the episodes 0 to 1".into()],
        ),
        (
            &["--trial", &good, "--episode", "1", "--seed", "1"],
            vec!["cannot be used with".into()],
        ),
    ];
    for (words, parts) in refusals {
        let answer = bench.run_misused(&[&["rollout"], words, &["--out", "out.csv"]].concat());
        assert_eq!(answer.code, 2, "{words:?}: {}", answer.err);
        let says = |part: &String| answer.err.contains(part);
        assert!(parts.iter().all(says), "{words:?}: {}", answer.err);
    }
    bench.ok(&["rollout", "--trial", &good, "--out", "out.csv"]);
}

#[test]
fn a_trial_without_a_usable_policy_or_without_episodes_is_refused() {
    let bench = Bench::new();
    bench.write(
        "two.yaml",
        "study: two\nenvironments: { four: { allocation_bandit: {} } }\nagents: { moments: { \
         dirichlet_gradient: {} } }\n\
         protocol: { estimator_tracking: { batches: 2 } }\n",
    );
    bench.ok(&["worker", "two.yaml"]);
    let id = trials(&bench)[0].0.clone();
    let refused = |words: &[&str]| {
        let answer = bench.run(&[&["rollout", "--out", "out.csv"], words].concat());
        assert_eq!(answer.code, 2, "{}", answer.err);
        answer.err
    };
    assert!(refused(&["--trial", &id]).contains("it measured no episodes at its end; give `--seed`"));
    assert!(refused(&["--trial", &id, "--seed", "0"]).contains("it left no policy that was acknowledged"));
    bench.write("lives.yaml", STUDY);
    bench.ok(&["worker", "lives.yaml", "--only", "ddpg"]);
    let id = of(&trials(&bench), "ddpg");
    let policy = Store::at(bench.path("store"))
        .folder(&id)
        .join("policy.safetensors");
    let mut bytes = std::fs::read(&policy).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&policy, bytes).unwrap();
    assert!(refused(&["--trial", &id]).contains("`policy.safetensors` is damaged"));
}
