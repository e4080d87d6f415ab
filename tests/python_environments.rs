//! Environments written in Python: what passes between the two programs, what is refused before anything runs, and
//! what a trial comes to whose Python fails, hangs, is killed or goes on elsewhere.

use crate::{
    book::blocks,
    program::{Answer, Bench, in_ci, repository},
    slurm::until,
};
use engine::{Channel, End, Environment, Space, random::stream};
use serde_json::{Value, json};
use std::{
    ffi::OsString,
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::OnceLock,
};

const FIXTURES: &str = "tests/fixtures/python";

/// A Python with Gymnasium and PettingZoo and the lock file of its packages; `None` where there is none, which is
/// said.
fn python() -> Option<&'static (String, String)> {
    static FOUND: OnceLock<Option<(String, String)>> = OnceLock::new();
    let found = FOUND.get_or_init(|| {
        let own = concat!(env!("CARGO_MANIFEST_DIR"), "/target/python/bin/python");
        [own, "python3"]
            .into_iter()
            .find_map(|python| Some((python.into(), lock_file(python)?)))
    });
    if found.is_none() {
        assert!(
            !in_ci(),
            "no Python with Gymnasium and PettingZoo: .ci/run installs them"
        );
        #[expect(clippy::print_stderr, reason = "whoever reads the test's output should know")]
        {
            eprintln!("skipped: no Python with Gymnasium and PettingZoo");
        }
    }
    found.as_ref()
}

fn lock_file(python: &str) -> Option<String> {
    let versions = "import gymnasium, numpy, pettingzoo as p\n\
                    print(f'gymnasium=={gymnasium.__version__}\\nnumpy=={numpy.__version__}\\npettingzoo=={p.__version__}')";
    let output = Command::new(python).args(["-c", versions]).output().ok()?;
    output
        .status
        .success()
        .then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}

/// The path on which the Python of the repository's studies is found; `None` where no Python here has what their lock
/// file says, which is said.
pub(crate) fn path_of_studies() -> Option<OsString> {
    let (interpreter, installed) = python()?;
    let wanted = fs::read_to_string(repository().join("experiments/data/python/requirements.txt")).unwrap();
    let is_wanted = |line: &&str| !line.starts_with("pettingzoo");
    let here = installed
        .lines()
        .filter(is_wanted)
        .all(|line| wanted.lines().any(|it| it == line));
    if !here {
        assert!(!in_ci(), "{installed} is installed, the studies want {wanted}");
        #[expect(clippy::print_stderr, reason = "whoever reads the test's output should know")]
        {
            eprintln!("left out: studies of environments in Python, which want {wanted}");
        }
        return None;
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let beside = Path::new(interpreter).parent().into_iter().map(Path::to_path_buf);
    Some(
        std::env::join_paths(
            beside
                .filter(|it| it.is_absolute())
                .chain(std::env::split_paths(&path)),
        )
        .unwrap(),
    )
}

/// A folder with the fixtures' environments and a lock file; `None` where there is no Python.
struct Place {
    bench: Bench,
    interpreter: &'static str,
}

impl Place {
    fn new() -> Option<Self> {
        let (interpreter, lock) = python()?;
        let bench = Bench::new();
        bench.write("requirements.txt", lock);
        for file in ["own.py", "level.py"] {
            fs::copy(repository().join(FIXTURES).join(file), bench.path(file)).unwrap();
        }
        Some(Self { bench, interpreter })
    }

    /// The keys of an environment beside `make` and `arguments`, in a study.
    fn with(&self, make: &str, arguments: &str) -> String {
        let interpreter = self.interpreter;
        format!(
            "{{ make: \"{make}\", arguments: {{ {arguments} }}, sources: [{{ file: level.py }}], lock: {{ file: \
             requirements.txt }}, interpreter: {interpreter} }}"
        )
    }

    /// A study of one environment in Python, whose agents learn from a few steps.
    fn study(&self, make: &str, arguments: &str, agent: &str, protocol: &str) -> PathBuf {
        let python = self.with(make, arguments);
        let text = format!(
            "study: own\nenvironments:\n  tank: {{ python: {python} }}\nagents:\n  some: {{ {agent} }}\nprotocol: {{ \
             {protocol} }}\n"
        );
        self.bench.write("study.yaml", &text)
    }

    fn short(&self, make: &str, arguments: &str, agent: &str) -> PathBuf {
        self.study(
            make,
            arguments,
            agent,
            "train_evaluate: { steps: 160, environments: 4, evaluate_every: 80, episodes: 2, final_episodes: 3 }",
        )
    }

    fn config(&self, make: &str, arguments: Value) -> Value {
        let file = |name: &str| json!({ "file": self.bench.path(name) });
        let make = match make.split_once(".py:") {
            Some((file, call)) => json!({ "file": self.bench.path(&format!("{file}.py")), "call": call }),
            None => json!(make),
        };
        json!({ "make": make, "arguments": arguments, "sources": [file("level.py")],
            "lock": file("requirements.txt"), "interpreter": self.interpreter })
    }

    fn built(&self, make: &str, arguments: Value) -> Box<dyn Environment> {
        let build = &plugins::registry().environments["python"].build;
        build(&self.config(make, arguments)).unwrap_or_else(|error| panic!("{make}: {error}"))
    }

    /// What `check` says of a study that it refuses.
    fn refusal(&self, make: &str, arguments: &str) -> String {
        self.short(make, arguments, RULE);
        let answer = self.bench.run(&["check", "study.yaml"]);
        assert_eq!(answer.code, 2, "{make} {arguments}: {}{}", answer.out, answer.err);
        answer.err.split_whitespace().collect::<Vec<_>>().join(" ")
    }
}

const RULE: &str = "random_action: {}";
const LEARNER: &str =
    "soft_actor_critic: { width: 8, batch_size: 8, learning_starts: 16, updates_per_step: 0.25 }";

fn channels(space: &Space) -> &[Channel] {
    match space {
        Space::Box(channels) => channels,
        other => panic!("{other:?}"),
    }
}

fn names(space: &Space) -> Vec<String> {
    space.names()
}

#[test]
fn every_kind_of_space_passes_as_it_is_declared() {
    let Some(place) = Place::new() else { return };
    let tank = place.built("own.py:Tank", json!({}));
    let seat = &tank.seats()[0];
    let level = &channels(&seat.observation)[0];
    assert_eq!(
        (level.low, level.high, level.center, level.spread),
        (0.0, 4.0, 2.0, 2.0)
    );
    assert_eq!(channels(&seat.observation)[1].high, f64::INFINITY);
    assert_eq!(
        (names(&seat.observation), names(&seat.action)),
        (
            vec!["observation_0".into(), "observation_1".into()],
            vec!["action".into()],
        )
    );
    let mut valve = place.built("own.py:Valve", json!({}));
    let seat = valve.seats()[0].clone();
    let expected = [
        "level",
        "flows_0",
        "flows_1",
        "inner_mode_1",
        "inner_mode_2",
        "inner_mode_3",
    ];
    let mut seen = names(&seat.observation);
    seen.sort();
    let mut sorted = expected.map(String::from).to_vec();
    sorted.sort();
    assert_eq!(seen, sorted);
    assert_eq!(names(&seat.action), ["action.1", "action.2", "action.3"]);
    let mut rng = stream(&["valve"]);
    let start = valve.reset(&mut rng).unwrap();
    let value =
        |seen: &[f64], name: &str| seen[names(&seat.observation).iter().position(|it| it == name).unwrap()];
    assert_eq!(
        expected.map(|name| value(&start[0], name)),
        [3.0, 0.25, -0.25, 1.0, 0.0, 0.0]
    );
    let third = valve.step(&[vec![-1.0, 0.5, 0.6]], &mut rng).unwrap();
    assert_eq!((third.rewards[0], third.end), (3.0, None));
    assert_eq!(
        expected.map(|name| value(&third.observations[0], name))[3..],
        [0.0, 0.0, 1.0]
    );
    let second = valve.step(&[vec![-1.0, 0.9, 0.6]], &mut rng).unwrap();
    assert_eq!((second.rewards[0], second.end), (2.0, Some(End::Terminated)));
}

#[test]
fn the_pendulum_of_gymnasium_moves_as_the_native_one() {
    let Some(place) = Place::new() else { return };
    let mut single = place.built("gymnasium:Pendulum-v1", json!({}));
    let mut bare = place.built("own.py:BarePendulum", json!({}));
    let registry = plugins::registry();
    let entry = &registry.environments["pendulum"];
    let mut native = (entry.build)(&entry.about.defaults).unwrap();
    let mut rng = stream(&["pendulum"]);
    for episode in 0..3 {
        let mut same = rng.clone();
        let seen = single.reset(&mut rng).unwrap();
        let start = bare.reset(&mut same).unwrap();
        let motion = json!({ "angle": start[0][0], "speed": start[0][1], "torque": null, "steps": 0 });
        native.restore(&motion).unwrap();
        assert!(
            (seen[0][0] - start[0][0].cos()).abs() < 1e-7,
            "of one seed is one start"
        );
        for step in 0..200 {
            // Torques that single precision holds exactly.
            let action = vec![vec![f64::from((step * 37 + episode * 11) % 129 - 64) / 64.0]];
            let [ours, precise, theirs] =
                [&mut native, &mut bare, &mut single].map(|it| it.step(&action, &mut rng).unwrap());
            let place = format!("step {step} of episode {episode}");
            let off = |one: &[f64], other: &[f64]| {
                one.iter()
                    .zip(other)
                    .map(|(one, other)| (one - other).abs())
                    .fold(0.0, f64::max)
            };
            // The native angle is given within half a turn.
            let state = &precise.observations[0];
            assert!(
                off(&[state[0].cos(), state[0].sin(), state[1]], &ours.observations[0]) < 1e-9,
                "{place}"
            );
            assert!(off(&precise.rewards, &ours.rewards) < 1e-9, "{place}");
            assert!(off(&theirs.rewards, &ours.rewards) < 1e-9, "{place}");
            // Gymnasium rounds what it gives out to single precision, of numbers up to 8.
            assert!(
                off(&theirs.observations[0], &ours.observations[0]) < 5e-7,
                "{place}"
            );
            assert_eq!((theirs.end, precise.end), (ours.end, ours.end), "{place}");
        }
    }
}

#[test]
fn environments_that_are_stepped_together_give_what_each_gives_alone() {
    let Some(place) = Place::new() else { return };
    let run = |together: bool| {
        let mut tanks: Vec<_> = (0..3).map(|_| place.built("own.py:Tank", json!({}))).collect();
        let mut streams: Vec<_> = ["a", "b", "c"].map(|name| stream(&[name])).into();
        let mut all = Vec::new();
        for (tank, rng) in tanks.iter_mut().zip(&mut streams) {
            all.push(tank.reset(rng).unwrap().concat());
        }
        for step in 0..20 {
            let action = vec![vec![f64::from(step) / 20.0]];
            if together {
                tanks.iter_mut().for_each(|tank| tank.announce(&action).unwrap());
            }
            for (tank, rng) in tanks.iter_mut().zip(&mut streams) {
                all.push(tank.step(&action, rng).unwrap().observations.concat());
            }
        }
        all
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn agents_of_the_parallel_interface_are_seats() {
    let Some(place) = Place::new() else { return };
    let mut pair = place.built("own.py:Pair", json!({}));
    let seats: Vec<(String, usize)> = pair
        .seats()
        .iter()
        .map(|seat| (seat.name.clone(), seat.observation.len()))
        .collect();
    assert_eq!(seats, [("filler".into(), 1), ("drainer".into(), 2)]);
    let traced: Vec<String> = pair
        .trace_channels()
        .into_iter()
        .map(|channel| channel.name)
        .collect();
    assert_eq!(
        traced,
        [
            "filler_observation",
            "drainer_observation_0",
            "drainer_observation_1"
        ]
    );
    let mut rng = stream(&["pair"]);
    let level = pair.reset(&mut rng).unwrap()[0][0];
    let step = pair.step(&[vec![1.0], vec![0.5]], &mut rng).unwrap();
    let expected = (level + 0.5 - 0.5).clamp(0.0, 4.0);
    assert_eq!(step.rewards, [expected, -expected]);
    assert_eq!(step.observations, [vec![expected], vec![expected, 1.0 / 3.0]]);
    for (left, end) in [
        (json!(null), End::Truncated),
        (json!("terminated"), End::Terminated),
    ] {
        let mut pair = place.built("own.py:Pair", json!({ "left": left }));
        pair.reset(&mut rng).unwrap();
        let ends: Vec<_> = (0..12)
            .map(|_| pair.step(&[vec![0.0], vec![0.0]], &mut rng).unwrap().end)
            .collect();
        assert_eq!((&ends[..11], ends[11]), (&[None; 11][..], Some(end)));
    }
    let mut pair = place.built("own.py:Pair", json!({ "left": "early" }));
    pair.reset(&mut rng).unwrap();
    let told = (0..3)
        .find_map(|_| pair.step(&[vec![0.0], vec![0.0]], &mut rng).err())
        .unwrap();
    assert!(
        told.to_string()
            .contains("filler left before the others, which is not supported"),
        "{told}"
    );
}

#[test]
fn a_learner_trains_in_python_and_two_workers_give_the_same_bits_as_one() {
    let Some(place) = Place::new() else { return };
    let python = place.with("gymnasium:Pendulum-v1", "g: 9.81");
    let own = place.with("own.py:Tank", "");
    let valve = place.with("own.py:Valve", "");
    place.bench.write(
        "study.yaml",
        &format!(
            "study: own\nenvironments:\n  pendulum: {{ python: {python} }}\n  tank: {{ python: {own} }}\n  valve: {{ \
             python: {valve} }}\nagents:\n  sac: {{ {LEARNER} }}\n  random: {{ {RULE} }}\nprotocol: {{ train_evaluate: \
             {{ steps: 120, environments: 4, evaluate_every: 60, episodes: 2, final_episodes: 3 }} }}\nseeds: 2\ntables:\
             \n  returns: {{ comparison: {{ rows: agent, value: return }} }}\n"
        ),
    );
    place
        .bench
        .ok(&["run", "study.yaml", "-j", "1", "--store", "one"]);
    let answer = place
        .bench
        .run(&["run", "study.yaml", "-j", "2", "--store", "two"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert_eq!(place.bench.digests("one").len(), 12);
    assert_eq!(place.bench.digests("one"), place.bench.digests("two"));
    assert!(answer.out.contains("sac"), "{}", answer.out);
}

#[test]
fn a_pair_of_agents_learns() {
    let Some(place) = Place::new() else { return };
    place.short(
        "own.py:Pair",
        "",
        "maddpg: { width: 8, batch_size: 8, learning_starts: 16 }",
    );
    let answer = place.bench.run(&["run", "study.yaml", "-j", "1"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
}

#[test]
fn what_an_environment_prints_and_reads_meets_nobody() {
    let Some(place) = Place::new() else { return };
    place.short("own.py:Chatty", "", RULE);
    let answer = place.bench.run(&["run", "study.yaml", "-j", "1"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(
        !answer.err.contains("ssss") && !answer.out.contains("ssss"),
        "{}",
        answer.err
    );
}

/// What makes an environment, with which arguments, and what is said of it.
const REFUSED: &[(&str, &str, &str)] = &[
    ("gymnasium:NoSuchTask-v0", "", "`NoSuchTask` doesn't exist"),
    (
        "pettingzoo:no_such_module",
        "",
        "No module named 'no_such_module'",
    ),
    (
        "pettingzoo:no_such_module",
        "",
        "-m pip install no_such_module` installs a package for this Python",
    ),
    (
        "own.py:no_such_function",
        "",
        "has no function `no_such_function`",
    ),
    ("own.py:missing", "", "own.py, line 2"),
    (
        "own.py:number",
        "",
        "what it makes is of type int, which is neither a gymnasium.Env nor",
    ),
    ("absent.py:make", "", "`make` names a file that cannot be read"),
    ("absent.py:make", "", "study.yaml:3:"),
    (
        "tank",
        "",
        "`tank` names nothing that makes an environment: write `gymnasium:ID`",
    ),
    ("own.py:Tank", "height: 3", "Tank() takes no arguments"),
    (
        "own.py:Spaces",
        "observation: multi_binary",
        "the observation is a space of kind MultiBinary, which is not supported",
    ),
    (
        "own.py:Spaces",
        "observation: multi_binary",
        "gymnasium.wrappers.FlattenObservation",
    ),
    ("own.py:Spaces", "observation: tuple", "of kind Tuple"),
    (
        "own.py:Spaces",
        "observation: twice",
        "has two entries called a_0",
    ),
    (
        "own.py:Spaces",
        "action: multi_binary",
        "the action is a space of kind MultiBinary",
    ),
    (
        "own.py:Spaces",
        "action: without_limits",
        "the action is a box without limits",
    ),
    (
        "own.py:Spaces",
        "action: without_limits",
        "gymnasium.wrappers.RescaleAction",
    ),
    (
        "own.py:Spaces",
        "action: whole_numbers",
        "a box of whole numbers (int64)",
    ),
    (
        "own.py:Spaces",
        "action: dictionary_of_choices",
        "the action['pump'] is a space of kind Discrete",
    ),
    ("own.py:Drawing", "source: numpy", "`observation_1` is"),
    (
        "own.py:Drawing",
        "source: numpy",
        "the second time, in one process: after `reset`",
    ),
    (
        "own.py:Drawing",
        "source: time",
        "the second time, in one process",
    ),
    (
        "own.py:Drawing",
        "source: import",
        "the second time, in another process",
    ),
];

#[test]
fn what_cannot_be_used_is_refused_before_anything_runs() {
    let Some(place) = Place::new() else { return };
    for (make, arguments, said) in REFUSED {
        let found = place.refusal(make, arguments);
        assert!(
            found.contains(said),
            "{make} {arguments}: `{said}` is not in: {found}"
        );
    }
}

#[test]
fn a_file_that_is_imported_and_not_named_is_not_found() {
    let Some(place) = Place::new() else { return };
    let study = place.short("own.py:Tank", "", RULE);
    let text = fs::read_to_string(&study).unwrap();
    fs::write(&study, text.replace("sources: [{ file: level.py }], ", "")).unwrap();
    let answer = place.bench.run(&["check", "study.yaml"]);
    assert_eq!(answer.code, 2);
    assert!(answer.err.contains("No module named 'level'"), "{}", answer.err);
    assert!(
        answer.err.contains("`sources: [{ file: model.py }]`"),
        "{}",
        answer.err
    );
}

#[test]
fn without_python_or_its_packages_it_is_said_what_to_install() {
    let Some(place) = Place::new() else { return };
    let study = place.short("own.py:Tank", "", RULE);
    let text = fs::read_to_string(&study).unwrap();
    let with = |interpreter: &str| {
        fs::write(&study, text.replace(place.interpreter, interpreter)).unwrap();
        let answer = place.bench.run(&["check", "study.yaml"]);
        assert_eq!(answer.code, 2, "{}", answer.err);
        answer.err
    };
    let absent = with("no-such-python");
    assert!(absent.contains("`no-such-python` cannot be started"), "{absent}");
    // A fresh environment of Python has no packages.
    let made = Command::new("python3")
        .args(["-m", "venv", "--without-pip"])
        .arg(place.bench.path("bare"))
        .status();
    assert!(made.unwrap().success());
    let bare = with("bare/bin/python");
    assert!(bare.contains("No module named 'gymnasium'"), "{bare}");
    assert!(
        bare.contains("`bare/bin/python -m pip install gymnasium`"),
        "{bare}"
    );
}

#[test]
fn the_lock_file_is_asked_for_and_held_against_what_is_installed() {
    let Some(place) = Place::new() else { return };
    let check = |lock: &str| {
        place.bench.write("requirements.txt", lock);
        place.refusal("own.py:Tank", "")
    };
    let other = check("gymnasium==0.1\n");
    assert!(
        other.contains("installed is not what `requirements.txt` says: gymnasium"),
        "{other}"
    );
    assert!(other.contains("in place of 0.1"), "{other}");
    let silent = check("# nothing is pinned\nnumpy>=1\n");
    assert!(
        silent.contains("`requirements.txt` pins no version of gymnasium"),
        "{silent}"
    );
    let study = fs::read_to_string(place.bench.path("study.yaml")).unwrap();
    place.bench.write(
        "study.yaml",
        &study.replace("lock: { file: requirements.txt }, ", ""),
    );
    let answer = place.bench.run(&["check", "study.yaml"]);
    assert!(
        answer.err.contains("`lock`: names no file") && answer.err.contains("-m pip freeze"),
        "{}",
        answer.err
    );
    // A lock file of another program, in TOML.
    let (_, versions) = python().unwrap();
    let version = versions.lines().next().unwrap().rsplit('=').next().unwrap();
    let package = format!("[[package]]\nname = \"Gymnasium\"\nversion = \"{version}\"\n");
    place.bench.write("uv.lock", &package);
    place
        .bench
        .write("study.yaml", &study.replace("requirements.txt", "uv.lock"));
    place.bench.ok(&["check", "study.yaml"]);
}

/// Ids of the trials of a study, as planned.
fn ids(place: &Place) -> Vec<String> {
    let plan: Value =
        serde_json::from_str(&place.bench.ok(&["plan", "study.yaml", "--format", "json"])).unwrap();
    assert!(plan["trials"].is_array() || plan["cells"].is_array(), "{plan}");
    let resolved = place.bench.ok(&["run", "study.yaml", "-j", "1"]);
    drop(resolved);
    let mut ids: Vec<String> = place
        .bench
        .digests("store")
        .into_iter()
        .map(|(id, _)| id)
        .collect();
    ids.sort();
    ids
}

#[test]
fn sources_and_lock_file_are_part_of_the_id_and_the_interpreter_is_not() {
    let Some(place) = Place::new() else { return };
    let study = place.study(
        "own.py:Tank",
        "",
        RULE,
        "train_evaluate: { steps: 0, final_episodes: 2 }",
    );
    let first = ids(&place);
    assert_eq!(first.len(), 1);
    let append = |name: &str, text: &str| {
        let file = place.bench.path(name);
        fs::write(&file, fs::read_to_string(&file).unwrap() + text).unwrap();
    };
    let mut known = 1;
    for (name, text) in [
        ("own.py", "\n# changed\n"),
        ("level.py", "\n# changed\n"),
        ("requirements.txt", "\n# changed\n"),
    ] {
        append(name, text);
        known += 1;
        assert_eq!(ids(&place).len(), known, "{name} is in the id");
    }
    let python = fs::read_to_string(&study).unwrap();
    let linked = place.bench.path("linked-python");
    fs::write(
        &linked,
        format!("#!/bin/sh\nexec {} \"$@\"\n", which(place.interpreter)),
    )
    .unwrap();
    Command::new("chmod").arg("+x").arg(&linked).status().unwrap();
    fs::write(
        &study,
        python.replace(place.interpreter, linked.to_str().unwrap()),
    )
    .unwrap();
    assert_eq!(ids(&place).len(), known, "another Python computes the same trial");
    fs::rename(place.bench.path("own.py"), place.bench.path("renamed.py")).unwrap();
    fs::write(&study, python.replace("own.py", "renamed.py")).unwrap();
    assert_eq!(
        ids(&place).len(),
        known,
        "what a file holds is in the id, its name is not"
    );
}

fn which(interpreter: &str) -> String {
    let found = Command::new("sh")
        .args(["-c", &format!("command -v {interpreter}")])
        .output()
        .unwrap();
    String::from_utf8_lossy(&found.stdout).trim().to_owned()
}

/// A study of which one trial is odd and another one is well.
fn beside_a_tank(place: &Place, how: &str, options: &[&str]) -> Answer {
    let (odd, tank) = (
        place.with("own.py:Odd", &format!("how: {how}")),
        place.with("own.py:Tank", ""),
    );
    place.bench.write(
        "study.yaml",
        &format!(
            "study: odd\nenvironments:\n  odd: {{ python: {odd} }}\n  tank: {{ python: {tank} }}\nagents:\n  sac: {{ \
             {LEARNER} }}\nprotocol: {{ train_evaluate: {{ steps: 64, environments: 1, evaluate_every: 0, episodes: 0, \
             final_episodes: 2 }} }}\n"
        ),
    );
    place
        .bench
        .run(&[&["run", "study.yaml", "-j", "1"], options].concat())
}

fn ends_as(how: &str, options: &[&str], state: &str, reasons: &[&str]) {
    let Some(place) = Place::new() else { return };
    let answer = beside_a_tank(&place, how, options);
    assert_eq!(answer.code, 100, "{how}: {}", answer.err);
    assert!(answer.err.contains("ok       tank sac"), "{how}: {}", answer.err);
    assert!(
        answer.err.contains(&format!("{state:<8} odd sac")),
        "{how}: {}",
        answer.err
    );
    let status = place.bench.run(&["status", "study.yaml"]).out;
    for reason in reasons {
        assert!(status.contains(reason), "{how}: `{reason}` is not in {status}");
    }
    until("Python is gone", || processes_of(&place).is_empty());
}

/// Processes that run a Python of this test.
fn processes_of(place: &Place) -> Vec<u32> {
    let lock = place.bench.path("");
    let folder = lock.to_str().unwrap();
    let mut found = Vec::new();
    for entry in fs::read_dir("/proc").unwrap().flatten() {
        let Ok(pid) = entry.file_name().to_string_lossy().parse::<u32>() else {
            continue;
        };
        let here = fs::read_link(entry.path().join("cwd")).is_ok_and(|cwd| cwd.starts_with(folder));
        let told = fs::read(entry.path().join("cmdline")).unwrap_or_default();
        if here && String::from_utf8_lossy(&told).contains("PettingZoo's parallel interface") {
            found.push(pid);
        }
    }
    found
}

#[test]
fn an_exception_in_a_step_ends_one_trial_with_its_last_lines() {
    let lines = [
        "RuntimeError: the pump is broken own.py, line",
        "in broken_pump: raise RuntimeError(\"the pump is broken\")",
        "in odd: return self.broken_pump()",
    ];
    ends_as("raise", &[], "failed", &lines);
}

#[test]
fn a_crash_of_python_ends_one_trial_with_its_last_words() {
    let words = [
        "the Python process was ended by signal 11",
        "it said last: the pump is lost",
    ];
    ends_as("crash", &[], "failed", &words);
    ends_as(
        "leave",
        &[],
        "failed",
        &["the Python process left with exit code 3"],
    );
}

#[test]
fn a_hang_of_python_ends_one_trial_when_its_time_is_over() {
    ends_as(
        "hang",
        &["--wall-time-s", "4"],
        "timeout",
        &["longer than the limit of 4 s"],
    );
}

#[test]
fn memory_of_python_counts_for_the_limit() {
    ends_as(
        "allocate",
        &["--memory-mb", "600"],
        "oom",
        &["above the limit of 600 MB"],
    );
}

#[test]
fn answers_that_are_none_end_one_trial() {
    ends_as(
        "nan",
        &[],
        "nan",
        &["`observation_0` of `", "is not finite at step 8"],
    );
    ends_as(
        "old",
        &[],
        "failed",
        &["step returned 4 values in place of observation, reward"],
    );
    ends_as(
        "short",
        &[],
        "failed",
        &["the observation has 1 entries in place of 2"],
    );
}

/// A trial of some seconds in slow tanks.
fn long(place: &Place, make: &str) {
    place.study(
        make,
        "",
        LEARNER,
        "train_evaluate: { steps: 600, environments: 2, evaluate_every: 200, episodes: 2, final_episodes: 3 }",
    );
}

/// True where a checkpoint of the running trial lies in the store.
fn has_checkpoint(place: &Place) -> bool {
    let entries = |folder: PathBuf| {
        fs::read_dir(folder)
            .into_iter()
            .flatten()
            .flatten()
            .map(|it| it.path())
    };
    let running = entries(place.bench.path("store/trials"))
        .flat_map(entries)
        .map(|trial| trial.join("running"));
    let is_checkpoint = |path: PathBuf| {
        path.file_name()
            .is_some_and(|it| it.to_string_lossy().starts_with("checkpoint-"))
    };
    running.flat_map(entries).any(is_checkpoint)
}

#[test]
fn a_killed_trial_goes_on_or_starts_over_to_the_same_bits() {
    let Some(place) = Place::new() else { return };
    place.bench.write("regimen.toml", "checkpoint_every_s = 0.2\n");
    for make in ["own.py:Slow", "own.py:Held", "own.py:Forgetful"] {
        long(&place, make);
        place
            .bench
            .ok(&["run", "study.yaml", "-j", "1", "--store", "whole"]);
        let mut run = place.bench.command(&["run", "study.yaml", "-j", "1"]);
        let mut child = run.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        until("there is a checkpoint", || has_checkpoint(&place));
        assert!(!processes_of(&place).is_empty());
        child.kill().unwrap();
        child.wait().unwrap();
        until("Python is gone with its worker", || {
            processes_of(&place).is_empty()
        });
        place.bench.ok(&["run", "study.yaml", "-j", "1"]);
        assert_eq!(
            place.bench.digests("store"),
            place.bench.digests("whole"),
            "{make}"
        );
        fs::remove_dir_all(place.bench.path("whole")).unwrap();
        fs::remove_dir_all(place.bench.path("store")).unwrap();
    }
}

#[test]
fn a_snapshot_is_taken_only_of_what_continues_alike() {
    let Some(place) = Place::new() else { return };
    let mut rng = stream(&["snapshot"]);
    let mut after = |make: &str| {
        let mut environment = place.built(make, json!({}));
        environment.reset(&mut rng).unwrap();
        for _ in 0..5 {
            environment.step(&[vec![0.5]], &mut rng).unwrap();
        }
        environment
    };
    let mut tank = after("own.py:Tank");
    let snapshot: Value = serde_json::from_str(&tank.snapshot().to_string()).unwrap();
    let mut other = place.built("own.py:Tank", json!({}));
    other.restore(&snapshot).unwrap();
    let go_on = |environment: &mut dyn Environment| {
        let mut rng = stream(&["on"]);
        (0..15)
            .map(|_| environment.step(&[vec![-0.2]], &mut rng).unwrap())
            .collect::<Vec<_>>()
    };
    assert_eq!(go_on(&mut *tank), go_on(&mut *other));
    for (make, why) in [
        ("own.py:Held", "cannot be pickled"),
        ("own.py:Forgetful", "does not continue as it does itself"),
    ] {
        let mut environment = after(make);
        let before = environment.snapshot();
        let told = environment.restore(&before).unwrap_err().to_string();
        assert!(
            told.contains("checkpoint of python does not fit") && told.contains(why),
            "{told}"
        );
    }
}

#[test]
fn the_page_of_the_book_works_as_written() {
    let Some(place) = Place::new() else { return };
    let page = fs::read_to_string(repository().join("docs/src/python-environments.md")).unwrap();
    let study = blocks(&page, "yaml")
        .into_iter()
        .find(|block| block.contains("\nprotocol:"))
        .unwrap();
    place.bench.write("my_envs.py", &blocks(&page, "python").concat());
    let interpreter = format!(" }}, interpreter: {} }} }}\nagents:", place.interpreter);
    let with_interpreter = study.replace(" } } }\nagents:", &interpreter);
    assert_ne!(with_interpreter, study);
    place.bench.write("tank.yaml", &with_interpreter);
    place.bench.ok(&["check", "tank.yaml"]);
    let table = place.bench.ok(&["run", "tank.yaml", "-j", "2"]);
    assert!(table.contains("SUPPORTED") || table.contains("sac"), "{table}");
    // The fragments that the page begins with are of the keys that there are.
    let keys = ["make", "arguments", "sources", "lock", "interpreter"];
    assert!(keys.iter().all(|key| page.contains(&format!("\n| `{key}` |"))));
}
