//! `check` where this machine lacks what a study needs: a line and an exit code of its own, and no error of the study.

use crate::{
    needs,
    program::{Answer, Bench},
};
use serde_json::Value;

/// A study whose environment runs in an interpreter, with what its lock file pins and with its code.
struct Case<'a> {
    interpreter: &'a str,
    lock: &'a str,
    code: &'a str,
}

impl Case<'_> {
    fn write(&self, bench: &Bench, name: &str) {
        let Self {
            interpreter,
            lock,
            code,
        } = self;
        bench.write(&format!("{name}.txt"), lock);
        bench.write(&format!("{name}.py"), code);
        let text = format!(
            "study: {name}\nenvironments:\n  own: {{ python: {{ make: \"{name}.py:Own\", lock: {{ file: {name}.txt }}, \
             interpreter: {interpreter} }} }}\nagents: {{ some: {{ random_action: {{}} }} }}\nprotocol: {{ train_evaluate: \
             {{ steps: 0, final_episodes: 1 }} }}\n"
        );
        bench.write(&format!("{name}.yaml"), &text);
    }
}

const GOOD: &str = "study: good\nenvironments: { cells: { battery: { cells: 2 } } }\nagents: { equal: { equal_split: {} } }\n\
                    protocol: { train_evaluate: { steps: 0, final_episodes: 2 } }\n";
/// An environment that ends at once.
const OWN: &str = "import gymnasium
from gymnasium import spaces
class Own(gymnasium.Env):
    observation_space = spaces.Box(0.0, 1.0, (1,))
    action_space = spaces.Box(0.0, 1.0, (1,))
    def reset(self, seed=None, options=None):
        return [0.0], {}
    def step(self, action):
        return [0.0], 0.0, True, False, {}
";

/// A folder with a good study, and with one whose interpreter is not on this machine.
fn bench_without_interpreter() -> Bench {
    let bench = Bench::new();
    bench.write("good.yaml", GOOD);
    let case = Case {
        interpreter: "no-such-python",
        lock: "gymnasium==1.0\n",
        code: OWN,
    };
    case.write(&bench, "elsewhere");
    bench
}

/// The lines that say what is not checked.
fn unchecked(answer: &Answer) -> Vec<&str> {
    let lines = answer.err.lines();
    lines.filter(|line| line.contains(": not checked: ")).collect()
}

#[test]
fn a_study_that_cannot_be_made_here_is_a_line_beside_those_that_can() {
    let bench = bench_without_interpreter();
    let answer = bench.run(&["check", "elsewhere.yaml", "good.yaml"]);
    assert_eq!(answer.code, 3, "{}{}", answer.out, answer.err);
    assert!(answer.out.starts_with("good: ok, 1 trial"), "{}", answer.out);
    let said = unchecked(&answer);
    assert_eq!((said.len(), answer.err.lines().count()), (1, 1), "{}", answer.err);
    assert!(
        said[0].starts_with("elsewhere.yaml: not checked: `no-such-python` cannot be started"),
        "{said:?}"
    );
    assert_eq!(bench.run(&["check", "elsewhere.yaml"]).code, 3);
    assert_eq!(bench.run(&["check", "good.yaml"]).code, 0);
    let help = bench.ok(&["--help"]);
    let words: Vec<&str> = help.split_whitespace().collect();
    assert!(
        words
            .join(" ")
            .contains("3 a study cannot be checked for want of"),
        "{help}"
    );
}

#[test]
fn an_error_of_another_study_wins_and_what_is_not_checked_is_said_all_the_same() {
    let bench = bench_without_interpreter();
    bench.write("wrong.yaml", &GOOD.replace("cells: 2", "cells: none"));
    let answer = bench.run(&["check", "wrong.yaml", "elsewhere.yaml", "good.yaml"]);
    assert_eq!(answer.code, 2, "{}{}", answer.out, answer.err);
    assert_eq!(unchecked(&answer).len(), 1, "{}", answer.err);
    assert!(
        answer.err.contains("error: ") && answer.err.contains("wrong.yaml:2:"),
        "{}",
        answer.err
    );
    // One study with both is wrong.
    let both = std::fs::read_to_string(bench.path("elsewhere.yaml")).unwrap();
    bench.write(
        "both.yaml",
        &both.replace("random_action: {}", "random_action: { x: 1 }"),
    );
    let answer = bench.run(&["check", "both.yaml"]);
    assert_eq!((answer.code, unchecked(&answer).len()), (2, 0), "{}", answer.err);
}

#[test]
fn programs_are_told_what_is_lacking_and_whatever_runs_trials_refuses_it() {
    let bench = bench_without_interpreter();
    let answer = bench.run(&["check", "elsewhere.yaml", "good.yaml", "--format", "json"]);
    assert_eq!(answer.code, 3, "{}", answer.err);
    let told: Value = serde_json::from_str(&answer.out).unwrap();
    assert_eq!(told[0]["problems"][0]["severity"], "unavailable", "{told}");
    assert!(told[1]["problems"].as_array().unwrap().is_empty(), "{told}");
    for command in ["run", "plan", "worker"] {
        let answer = bench.run(&[command, "good.yaml", "elsewhere.yaml"]);
        assert_eq!(answer.code, 2, "{command}: {}", answer.err);
        assert!(
            answer.err.contains("elsewhere.yaml:3:") && answer.err.contains("cannot be started"),
            "{}",
            answer.err
        );
    }
}

/// Packages that a Python lacks of a lock file are not checked; a fault in the code of an environment is one,
/// also where another package is missing.
#[test]
fn what_a_python_lacks_is_told_from_what_is_wrong_in_the_code() {
    let Some(interpreter) = needs::python("gymnasium, numpy") else {
        return;
    };
    let version = std::process::Command::new(interpreter)
        .args(["-c", "import gymnasium; print(gymnasium.__version__)"])
        .output()
        .unwrap();
    let version = String::from_utf8_lossy(&version.stdout).trim().to_owned();
    let installed = format!("gymnasium=={version}\n");
    let lacking = format!("{installed}a-package-of-nobody==1.5\n");
    let imports = format!("import a_package_of_nobody\n{OWN}");
    let late = OWN.replace(
        "        return [0.0], {}\n",
        "        import a_package_of_nobody\n        return [0.0], {}\n",
    );
    let raises = OWN.replace(
        "        return [0.0], {}\n",
        "        raise ValueError('a mistake')\n",
    );
    let cases = [
        (&*installed, OWN, 0, "ok, 1 trial"),
        (&*lacking, OWN, 0, "ok, 1 trial"),
        ("gymnasium==0.1\n", OWN, 3, "in place of 0.1"),
        ("gymnasium==0.1\n", &raises, 3, "in place of 0.1"),
        (
            &lacking,
            &imports,
            3,
            "needs a-package-of-nobody 1.5, which this Python lacks",
        ),
        (
            &lacking,
            &late,
            3,
            "needs a-package-of-nobody 1.5, which this Python lacks",
        ),
        (&installed, &imports, 2, "No module named 'a_package_of_nobody'"),
        (&installed, &late, 2, "No module named 'a_package_of_nobody'"),
        (&lacking, &raises, 2, "ValueError: a mistake"),
    ];
    for (number, (lock, code, left, said)) in cases.into_iter().enumerate() {
        let bench = Bench::new();
        let case = Case {
            interpreter,
            lock,
            code,
        };
        case.write(&bench, "own");
        let answer = bench.run(&["check", "own.yaml"]);
        let told = format!("{}{}", answer.out, answer.err);
        assert_eq!(answer.code, left, "case {number}: {told}");
        assert!(told.contains(said), "case {number}: {told}");
        let install = format!("`{interpreter} -m pip install -r own.txt` installs what it says");
        assert_eq!(told.contains(&install), left == 3, "case {number}: {told}");
    }
}
