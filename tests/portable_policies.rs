//! Policies that are taken away act as they do here: ONNX files are computed by two runtimes of other people, `tract`
//! and onnxruntime, and held against this program's own evaluation.

use crate::{
    datasets,
    other_programs::check,
    program::{Bench, in_ci, reseal, trial_files},
};
use engine::{
    Agent, Environment, Mode, NoKeeper, Observation, ProductKind, Registry,
    export::PortablePolicy,
    product::Taken,
    random::{Streams, stream},
    rollout::trained_agent,
    trial::TrialKey,
};
use numerics::{
    network::{Activation, Mlp, device},
    onnx::Graph,
    policy_file::{Head, Policy, Ports},
};
use plugins::registry;
use rand::Rng as _;
use serde_json::{Value, json};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    process::Command,
};

const HEADS: [Head; 6] = [
    Head::DirichletMean,
    Head::DirichletMode,
    Head::SoftmaxMean,
    Head::Tanh,
    Head::Argmax,
    Head::Identity,
];
/// Rows that are computed at once.
const ROWS: usize = 64;

/// ONNX files, each with what it must compute.
struct Cases(tempfile::TempDir);

impl Cases {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// Keeps a file with rows of observations and what `own` makes of each; the scale is that of the largest entry, 1 at
    /// least.
    fn add(&self, name: &str, onnx: &[u8], rows: &[Vec<f64>], own: impl Fn(&[f64]) -> Vec<f64>) {
        let actions: Vec<Vec<f64>> = rows.iter().map(|row| own(row)).collect();
        let entries = actions.iter().flatten();
        let scale = entries.fold(1.0, |largest: f64, entry| largest.max(entry.abs()));
        let case = json!({ "observations": rows, "actions": actions, "scale": scale });
        fs::write(self.0.path().join(format!("{name}.onnx")), onnx).unwrap();
        fs::write(self.0.path().join(format!("{name}.json")), case.to_string()).unwrap();
    }

    fn add_policy(&self, name: &str, policy: &Policy, rows: &[Vec<f64>]) {
        let graph = policy.graph().unwrap();
        self.add(name, &graph.to_bytes(&[]), rows, |row| policy.act(row));
    }

    fn hold(&self) {
        let folder = self.0.path().to_string_lossy().into_owned();
        check(
            "run_policies.py",
            "onnx, onnxruntime",
            std::slice::from_ref(&folder),
        );
        run_with_tract(&folder);
    }
}

/// The program in `tests/tract`, which `.ci/run` builds beside the target folder's profiles.
#[expect(clippy::print_stderr, reason = "whoever reads the test's output should know")]
fn run_with_tract(folder: &str) {
    let profile = Path::new(env!("CARGO_BIN_EXE_regimen")).parent().unwrap();
    let program = profile.with_file_name("tract").join("release/run-with-tract");
    if !program.exists() {
        assert!(!in_ci(), "{} is not there: .ci/run builds it", program.display());
        eprintln!("skipped: {} is not there", program.display());
        return;
    }
    let output = Command::new(program).arg(folder).output().unwrap();
    let texts = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(output.status.success(), "{texts:?}");
}

/// A number that single precision holds.
fn single(x: f64) -> f64 {
    f64::from(x as f32)
}

/// Channels of several magnitudes, of which one varies little around a large value and one is not to be seen.
fn ports(outputs: usize) -> Ports {
    let name = |at: usize| format!("entry_{at}");
    Ports {
        inputs: (0..4).map(name).collect(),
        center: vec![3.4, 101_325.37, 0.0, 7.0],
        spread: vec![0.2, 0.5, 1.0, f64::MAX],
        outputs: (0..outputs).map(name).collect(),
    }
}

fn around(center: &[f64], spread: &[f64], rng: &mut engine::Rng) -> Vec<Vec<f64>> {
    let mut near =
        |(center, spread): (&f64, &f64)| single(center + spread.min(1e3) * rng.random_range(-2.0..2.0));
    (0..ROWS)
        .map(|_| center.iter().zip(spread).map(&mut near).collect())
        .collect()
}

#[test]
fn every_head_after_every_activation_acts_as_here() {
    let (cases, mut rng) = (Cases::new(), stream(&["portable", "heads"]));
    let Ports { center, spread, .. } = ports(3);
    for head in HEADS {
        for activation in [Activation::Relu, Activation::LeakyRelu, Activation::Tanh] {
            for (hidden, unused) in [
                (vec![], 0),
                (vec![activation], 3),
                (vec![activation, Activation::Tanh], 0),
            ] {
                let sizes = [vec![4], vec![16; hidden.len()], vec![3 + unused]].concat();
                let network = Mlp::new(&sizes, &hidden, 1.0, &mut rng, &device());
                let policy = Policy::new(&network, ports(3), head);
                let rows = around(&center, &spread, &mut rng);
                cases.add_policy(
                    &format!("{head:?}-{activation:?}-{}", hidden.len()),
                    &policy,
                    &rows,
                );
            }
        }
        let network = Mlp::new(&[4, 8, 3], &[Activation::LeakyRelu], 1.0, &mut rng, &device());
        let policy = Policy::new(&network, ports(3), head);
        let policy = policy.in_units(vec![700.0, 0.0, -1e-3], vec![50.0, 2.0, 1e-3]);
        let rows = around(&center, &spread, &mut rng);
        cases.add_policy(&format!("{head:?}-in-units"), &policy, &rows);
    }
    cases.hold();
}

#[test]
fn heads_hold_where_outputs_are_extreme() {
    let rows = [
        [1e4, 0.0, -1e4],
        [-80.0, -79.0, -85.0],
        [-20.0, -30.0, -25.0],
        [88.0, 89.0, 500.0],
        [0.0, 0.0, 0.0],
        [1e-8, -1e-8, 3.0],
        [-1.0, 2.0, 2.0],
    ];
    let rows = rows.map(|row| row.map(single).to_vec());
    let cases = Cases::new();
    for head in HEADS {
        let (mut graph, x) = Graph::of_observation(3);
        let action = graph.head(&x, head);
        let graph = graph.acting(&action, head.n_entries(3));
        cases.add(&format!("{head:?}"), &graph.to_bytes(&[]), &rows, |row| {
            head.apply(row)
        });
    }
    cases.hold();
}

/// What a small trial of an agent left, and how it acts.
struct Trained {
    folder: tempfile::TempDir,
    environment: Box<dyn Environment>,
    agent: Box<dyn Agent>,
}

/// A small trial of an agent, where it fits environment and protocol and leaves a policy.
fn trained(registry: &Registry, key: &TrialKey) -> Option<Trained> {
    let folder = tempfile::tempdir().unwrap();
    // Some agents say by a panic that they do not fit.
    let run = AssertUnwindSafe(|| datasets::run(registry, key, Some(folder.path()), &mut NoKeeper));
    catch_unwind(run).ok()?.ok()?;
    if !ProductKind::Policy.lies_in(folder.path()) {
        return None;
    }
    let environment = &registry.environments[key.environment.plugin.as_str()];
    let environment = (environment.build)(&key.environment.config).unwrap();
    let interface = environment.interface();
    let find = |_: &Taken| Ok(folder.path().to_path_buf());
    let agent = trained_agent(key, registry, &interface, &Streams::new("a", "b", 0), &find).unwrap();
    Some(Trained {
        folder,
        environment,
        agent,
    })
}

/// The policies in a folder and the form that knows it, as `export` finds them.
fn portable(registry: &Registry, folder: &Path) -> Vec<PortablePolicy> {
    let read = |folder: &Path| {
        registry
            .policy_forms
            .values()
            .find_map(|form| (form.read)(folder).unwrap())
    };
    if folder.join("policy.safetensors").exists() {
        return read(folder).unwrap_or_default();
    }
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.join("policy.safetensors").exists() {
            let seat = path.file_name().unwrap().to_string_lossy().into_owned();
            all.extend(read(&path).unwrap().into_iter().map(|policy| PortablePolicy {
                seat: seat.clone(),
                ..policy
            }));
        }
    }
    all
}

/// What all seats observe while the agent acts, rounded to what single precision holds.
fn observations(environment: &mut dyn Environment, agent: &mut dyn Agent) -> Vec<Observation> {
    let mut rng = stream(&["portable", "observations"]);
    let mut rows: Vec<Observation> = Vec::new();
    let mut seats = environment.reset(&mut rng).unwrap();
    while rows.len() < ROWS {
        let round = |row: &Vec<f64>| row.iter().copied().map(single).collect();
        let seen = Observation {
            seats: seats.iter().map(round).collect(),
            state: environment.state(),
        };
        let action = agent
            .act(std::slice::from_ref(&seen), Mode::Train, &mut rng)
            .unwrap()
            .remove(0);
        rows.push(seen);
        let step = environment.step(&action, &mut rng).unwrap();
        seats = match step.end {
            None => step.observations,
            Some(_) => environment.reset(&mut rng).unwrap(),
        };
    }
    rows
}

/// Holds what one trial left: each policy against the action of its seat, where the agent acts by the policy alone.
fn hold_trial(registry: &Registry, name: &str, trained: &mut Trained, cases: &Cases) -> usize {
    let rows = observations(&mut *trained.environment, &mut *trained.agent);
    let actions = trained
        .agent
        .act(&rows, Mode::Evaluate, &mut stream(&["portable"]))
        .unwrap();
    let policies = portable(registry, trained.folder.path());
    for policy in &policies {
        let seats = trained.environment.seats();
        let at = seats
            .iter()
            .position(|seat| seat.name == policy.seat)
            .unwrap_or(0);
        let seen = |row: &Observation| match policy.inputs.len() {
            n if n == row.seats[at].len() => row.seats[at].clone(),
            _ => row.seats.concat(),
        };
        let seen: Vec<Vec<f64>> = rows.iter().map(seen).collect();
        let onnx = (policy.to_onnx)(&[]);
        let name = format!("{name}-{}", policy.seat);
        if seen[0].len() == policy.inputs.len() {
            let action = |row: &[f64]| {
                let row = seen.iter().position(|it| it == row).unwrap();
                actions[row][at].clone()
            };
            cases.add(&name, &onnx, &seen, action);
        } else {
            // A sampler reads noise beside the observation, and its agent chooses among its draws.
            let file = Policy::read(&trained.folder.path().join(&policy.seat)).unwrap();
            let rows = around(
                &file.header.center,
                &file.header.spread,
                &mut stream(&["portable", "noise"]),
            );
            cases.add(&name, &onnx, &rows, |row| file.act(row));
        }
    }
    policies.len()
}

/// The same trial with a final measurement of one episode, which no policy depends on.
fn with_few_episodes(registry: &Registry, mut key: TrialKey) -> TrialKey {
    let mut part = (*key.protocol).clone();
    let mut config = (*part.config).clone();
    for name in ["final_episodes", "final_examples", "trace_episodes"] {
        if config.get(name).is_some() {
            config[name] = json!(1);
        }
    }
    let resolve = &registry.protocols[part.plugin.as_str()].about.resolve;
    if let Ok(config) = resolve(&config) {
        part.config = config.into();
        key.protocol = part.into();
    }
    key
}

#[test]
fn every_policy_that_an_agent_leaves_is_taken_away_and_acts_as_the_agent() {
    let (registry, cases) = (registry(), Cases::new());
    let mut held: BTreeMap<&str, usize> = BTreeMap::new();
    let mut refused = BTreeSet::new();
    for (name, entry) in &registry.agents {
        for key in crate::resume::keys(&registry, name)
            .into_iter()
            .filter(|_| entry.learns)
        {
            if key.environment.plugin == "generator_search" || key.protocol.plugin == "track" {
                continue;
            }
            let key = with_few_episodes(&registry, key);
            let Some(mut trained) = trained(&registry, &key) else {
                continue;
            };
            let case = format!("{name}-{}-{}", key.environment.plugin, key.protocol.plugin);
            match hold_trial(&registry, &case, &mut trained, &cases) {
                0 => drop(refused.insert(*name)),
                n => *held.entry(name).or_default() += n,
            }
        }
    }
    // It tells images apart: nothing acts by it.
    assert_eq!(refused, BTreeSet::from(["image_classifier"]));
    assert!(held.values().all(|n| *n > 0));
    let leaving: BTreeSet<&str> = held.keys().copied().collect();
    let expected = [
        "behaviour_cloning",
        "clac",
        "ddpg",
        "dirichlet_regression",
        "dirichlet_sac",
        "e2gan",
        "gaussian_softmax_regression",
        "gaussian_softmax_sac",
        "independent_sac",
        "lac",
        "maddpg",
        "masql",
        "network_regression",
        "opponent_gradients",
        "pr2",
        "rommeo",
        "soft_actor_critic",
        "td3_bc",
        "tdom_ac",
        "value_decomposition",
    ];
    assert_eq!(leaving, BTreeSet::from(expected));
    cases.hold();
}

/// Settings that give an agent another network, another sight or another scaling.
#[test]
fn networks_of_every_setting_act_as_the_agent() {
    let (registry, cases) = (registry(), Cases::new());
    let settings = [
        ("dirichlet_sac", "battery", json!({ "network": "equivariant" })),
        (
            "dirichlet_sac",
            "battery",
            json!({ "network": "equivariant", "evaluation_action": "mode" }),
        ),
        ("dirichlet_sac", "battery", json!({ "evaluation_action": "mode" })),
        (
            "dirichlet_sac",
            "battery",
            json!({ "observation_scaling": "none" }),
        ),
        ("maddpg", "particles", json!({ "policy_sight": "joint" })),
        ("independent_sac", "particles", json!({ "sight": "joint" })),
        ("masql", "particles", json!({ "sight": "joint" })),
        (
            "tdom_ac",
            "particles",
            json!({ "sight": "own", "input_normalisation": false }),
        ),
        (
            "tdom_ac",
            "particles",
            json!({ "sight": "own", "input_normalisation": true }),
        ),
        (
            "rommeo",
            "particles",
            json!({ "sight": "joint", "input_normalisation": true }),
        ),
        (
            "pr2",
            "particles",
            json!({ "sight": "own", "input_normalisation": true }),
        ),
        (
            "pr2",
            "particles",
            json!({ "sight": "joint", "input_normalisation": false }),
        ),
    ];
    for (at, (agent, environment, changes)) in settings.into_iter().enumerate() {
        let mut key = crate::resume::keys(&registry, agent)
            .into_iter()
            .find(|key| key.environment.plugin == environment && key.protocol.plugin == "train_evaluate")
            .unwrap();
        let mut part = key.agent.agent().unwrap().clone();
        let mut config = (*part.config).clone();
        for (name, value) in changes.as_object().unwrap() {
            config[name] = value.clone();
        }
        part.config = (registry.agents[agent].about.resolve)(&config).unwrap().into();
        key.agent = engine::cast::Seating::Agent(part).into();
        let mut trained = trained(&registry, &key).unwrap_or_else(|| panic!("{agent} {changes}"));
        assert!(hold_trial(&registry, &format!("{agent}-{at}"), &mut trained, &cases) > 0);
    }
    cases.hold();
}

const STUDY: &str = "
study: taken
title: Policies that are taken away
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  dsac: { dirichlet_sac: { width: 8, batch_size: 8, learning_starts: 16 } }
protocol: { train_evaluate: { steps: 64, environments: 8, evaluate_every: 32, episodes: 2, final_episodes: \
3 } }
seeds: 2
";

const GAME: &str = "
study: game
title: Policies of several seats
environments: { navigation: { particles: { scenario: cooperative_navigation } } }
agents: { sac: { independent_sac: { width: 8, batch_size: 8, learning_starts: 16 } } }
protocol: { train_evaluate: { steps: 32, environments: 8, evaluate_every: 32, episodes: 1, final_episodes: 1 } }
seeds: 1
";

/// Id, folder and agent of every trial in a store.
fn stored(bench: &Bench) -> Vec<(String, PathBuf, String)> {
    let of = |file: PathBuf| {
        let text: Value = serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
        let folder = file.parent().unwrap().to_path_buf();
        let id = folder.file_name().unwrap().to_string_lossy().into_owned();
        (
            id,
            folder,
            text["key"]["agent"]["plugin"]
                .as_str()
                .unwrap_or_default()
                .to_owned(),
        )
    };
    trial_files(&bench.path("store")).into_iter().map(of).collect()
}

#[test]
fn a_policy_of_the_store_is_taken_away_with_what_it_is() {
    let bench = Bench::new();
    bench.write("taken.yaml", STUDY);
    bench.ok(&["run", "taken.yaml"]);
    let trials = stored(&bench);
    let (id, folder, _) = trials
        .iter()
        .find(|(_, _, agent)| agent == "dirichlet_sac")
        .unwrap();
    let out = bench.ok(&["export", "--onnx", id, "-o", "one"]);
    assert!(out.contains("policy.onnx in `one`"), "{out}");
    bench.ok(&["export", "--onnx", &id[..12], "--to", "two"]);
    let bytes = fs::read(bench.path("one/policy.onnx")).unwrap();
    assert_eq!(bytes, fs::read(bench.path("two/policy.onnx")).unwrap());
    // Properties are texts: they stand in the file as they are.
    let text = String::from_utf8_lossy(&bytes);
    let digest = engine::store::digest(&fs::read(folder.join("policy.safetensors")).unwrap());
    for property in [
        id.as_str(),
        digest.as_str(),
        "dirichlet_sac",
        "battery",
        "dirichlet_mean",
        "[\"V\",\"V\",\"A\",\"A\",\"W\"]",
    ] {
        assert!(text.contains(property), "{property}");
    }
    let policy = Policy::read(folder).unwrap();
    let cases = Cases::new();
    let rows = around(
        &policy.header.center,
        &policy.header.spread,
        &mut stream(&["portable"]),
    );
    cases.add("stored", &bytes, &rows, |row| policy.act(row));
    cases.hold();

    let out = bench.run(&["export", "taken.yaml", "--to", "all", "--as", "onnx"]);
    assert_eq!(out.code, 0, "{}", out.err);
    assert!(out.err.contains("2 trials left no policy"), "{}", out.err);
    let listed: Value = serde_json::from_slice(&fs::read(bench.path("all/policies.json")).unwrap()).unwrap();
    let policies = listed["policies"].as_array().unwrap();
    assert_eq!(policies.len(), 2);
    let own = policies
        .iter()
        .find(|entry| entry["trial"] == id.as_str())
        .unwrap();
    let file = bench
        .path("all")
        .join(own["folder"].as_str().unwrap())
        .join("policy.onnx");
    assert_eq!(fs::read(file).unwrap(), bytes);
}

#[test]
fn every_seat_has_a_file() {
    let bench = Bench::new();
    bench.write("game.yaml", GAME);
    bench.ok(&["run", "game.yaml"]);
    let (id, ..) = stored(&bench).remove(0);
    bench.ok(&["export", "--onnx", &id, "--to", "seats"]);
    let mut names: Vec<String> = fs::read_dir(bench.path("seats"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, ["agent_0.onnx", "agent_1.onnx", "agent_2.onnx"]);
    let refused = bench.run(&["export", "--minari", &id, "--episodes", "1", "--to", "episodes"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(
        refused.err.contains("this environment has 3 seats"),
        "{}",
        refused.err
    );
    assert!(!bench.path("episodes").exists());
}

/// Trials of which some cannot be taken away.
struct Stored {
    bench: Bench,
    trials: Vec<(String, PathBuf, String)>,
}

impl Stored {
    fn new() -> Self {
        let bench = Bench::new();
        bench.write("taken.yaml", STUDY);
        bench.ok(&["run", "taken.yaml"]);
        let trials = stored(&bench);
        Self { bench, trials }
    }

    /// Id and folder of a trial of this agent.
    fn by(&self, plugin: &str) -> (&str, &Path) {
        let (id, folder, _) = self.trials.iter().find(|(_, _, agent)| agent == plugin).unwrap();
        (id, folder)
    }

    /// Lets a trial be refused, with these words, and nothing be written.
    fn refused(&self, trial: &str, said: &str) {
        let answer = self.bench.run(&["export", "--onnx", trial, "--to", "taken"]);
        assert_eq!(answer.code, 2, "{}", answer.err);
        assert!(answer.err.contains(said), "{}", answer.err);
        assert!(!self.bench.path("taken").exists());
    }
}

#[test]
fn what_names_no_trial_with_a_policy_is_refused_and_leaves_nothing() {
    let stored = Stored::new();
    stored.refused("nowhere", "has an id that begins with `nowhere`");
    stored.refused("", "begins the ids of 4 trials");
    let (rule, folder) = stored.by("equal_split");
    stored.refused(rule, "left no policy: `equal_split` learns none");
    let path = folder.join("trial.json");
    let trial = fs::read_to_string(&path).unwrap();
    let failed = trial.replace("\"state\":\"ok\"", "\"state\":\"panicked\"");
    assert_ne!(failed, trial);
    fs::write(&path, reseal(&failed)).unwrap();
    stored.refused(rule, "ended as panicked");
    fs::remove_file(path).unwrap();
    stored.refused(rule, "has not ended");
}

#[test]
fn a_policy_that_is_damaged_or_of_an_unknown_form_is_refused_and_leaves_nothing() {
    let stored = Stored::new();
    let (learner, folder) = stored.by("dirichlet_sac");
    let path = folder.join("policy.safetensors");
    let mut bytes = fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&path, &bytes).unwrap();
    stored.refused(learner, "`policy.safetensors` is damaged or not there");
    // Acknowledged, but no policy: what a form that nobody registered would leave.
    let trial = fs::read_to_string(folder.join("trial.json")).unwrap();
    let before = serde_json::from_str::<Value>(&trial).unwrap()["files"]["policy.safetensors"].clone();
    let acknowledged = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let digest = engine::store::digest(bytes);
        let text = reseal(&trial.replace(before.as_str().unwrap(), &digest));
        fs::write(folder.join("trial.json"), text).unwrap();
    };
    acknowledged(b"nonsense");
    stored.refused(learner, "not a file of f32 tensors");
    let mut other = numerics::tensor_file::TensorFile::default();
    other.header = json!({ "kind": "another" });
    other.write(&stored.bench.path("other")).unwrap();
    acknowledged(&fs::read(stored.bench.path("other")).unwrap());
    stored.refused(
        learner,
        "in a form that is known here: dense, equivariant, opponent_models",
    );
}
