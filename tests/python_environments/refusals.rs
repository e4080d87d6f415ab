//! Refusals before anything runs, and the parts of a trial's id.

use super::*;

/// The callable that makes an environment, its arguments, and the message about it.
const REFUSED: &[(&str, &str, &str)] = &[
    ("gymnasium:NoSuchTask-v0", "", "`NoSuchTask` doesn't exist"),
    (
        "pettingzoo:no_such_module",
        "",
        "there is neither `pettingzoo.no_such_module` nor `no_such_module` in this Python: PettingZoo has",
    ),
    (
        "pettingzoo:butterfly.knights_archers_zombies_v1",
        "",
        "pettingzoo.butterfly has no knights_archers_zombies_v1; it has knights_archers_zombies_v",
    ),
    (
        "pettingzoo:classic.no_such_game_v1",
        "",
        "pettingzoo.classic has no no_such_game_v1; it has ",
    ),
    (
        "own.py:no_such_function",
        "",
        "has no function `no_such_function`",
    ),
    ("own.py:missing", "", "in missing: import no_such_module"),
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
        "action: mixed",
        "the action has boxes beside choices",
    ),
    (
        "own.py:Returns",
        "how: alone",
        "reset returned no pair of observation and info, but an array of shape (2,) and type float64",
    ),
    (
        "own.py:Returns",
        "how: three",
        "reset returned no pair of observation and info, but a tuple of 3",
    ),
    (
        "own.py:Returns",
        "how: none",
        "the info of reset is None (NoneType) in place of a dictionary",
    ),
    (
        "own.py:Returns",
        "how: info_none",
        "the info of step is None (NoneType)",
    ),
    (
        "own.py:Returns",
        "how: reward_text",
        "the reward is '12' (str) in place of a number",
    ),
    (
        "own.py:Returns",
        "how: reward_none",
        "the reward is None (NoneType) in place of a number",
    ),
    (
        "own.py:Returns",
        "how: reward_nan",
        "`reward` is NaN after step 1, which is no finite number",
    ),
    (
        "own.py:Returns",
        "how: seen_nan",
        "`observation_0` is NaN after step 1",
    ),
    (
        "own.py:Returns",
        "how: seen_text",
        "the observation is a list of 2 in place of numbers",
    ),
    (
        "own.py:Returns",
        "how: terminated_text",
        "terminated is 'no' (str) in place of True or False",
    ),
    (
        "own.py:Returns",
        "how: truncated_number",
        "truncated is 0 (int) in place of True or False",
    ),
    (
        "own.py:Valves",
        "how: alone",
        "reset returned no pair of observations and infos, but a dictionary with 'first', 'second'",
    ),
    (
        "own.py:Valves",
        "how: no_reward",
        "step returned rewards without 'second'",
    ),
    (
        "own.py:Valves",
        "how: text",
        "the termination of 'second' is 'no' (str) in place of True or False",
    ),
    (
        "own.py:Valves",
        "how: list",
        "what step returns as rewards is a list of 2 in place of a dictionary",
    ),
    (
        "own.py:Valves",
        "how: old",
        "step returned 4 values in place of observations, rewards",
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
fn nothing_is_to_be_installed_whose_name_comes_from_a_study() {
    let Some(place) = Place::new() else { return };
    for make in [
        "pettingzoo:no_such_module",
        "pettingzoo:butterfly.pistonball_v1",
        "own.py:missing",
    ] {
        let found = place.refusal(make, "");
        assert!(!found.contains("pip install"), "{make}: {found}");
    }
}

#[test]
fn what_differs_from_a_space_and_can_be_used_is_remarked_on() {
    let Some(place) = Place::new() else { return };
    for (how, said) in [
        ("tall", "the observation has the shape (2, 1), its space (2,)"),
        ("seen_single", ""),
        ("outside", "`observation_0` of the observation is"),
        ("outside", "outside its space, 0.0 to 4.0"),
        ("right", ""),
    ] {
        place.short("own.py:Returns", &format!("how: {how}"), RULE);
        let answer = place.bench.run(&["check", "study.yaml"]);
        let words = answer.err.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(answer.code, 0, "{how}: {words}");
        assert!(words.contains(said), "{how}: {words}");
        assert!(!said.is_empty() || !words.contains("warning"), "{how}: {words}");
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
        assert_eq!(answer.code, 3, "{}", answer.err);
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
    assert!(
        bare.contains("study.yaml: not checked: needs gymnasium "),
        "{bare}"
    );
    assert!(
        bare.contains("`bare/bin/python -m pip install -r requirements.txt` installs what it says"),
        "{bare}"
    );
}

#[test]
fn the_lock_file_is_asked_for_and_held_against_what_is_installed() {
    let Some(place) = Place::new() else { return };
    let check = |code: i32, lock: &str| {
        place.bench.write("requirements.txt", lock);
        place.said_by_check(code, "own.py:Tank", "")
    };
    let other = check(3, "gymnasium==0.1\n");
    assert!(
        other.contains("installed is not what `requirements.txt` says: gymnasium"),
        "{other}"
    );
    assert!(other.contains("in place of 0.1"), "{other}");
    let silent = check(2, "# nothing is pinned\nnumpy>=1\n");
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
