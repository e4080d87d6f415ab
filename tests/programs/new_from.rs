//! `new --from`: a study from the command of a program, or from the sweep of another tool. It is checked, and runs.

use super::*;

/// A learner with options and a help, as many programs have them.
const LEARNER: &str = r#"#!/bin/sh
lr=0.1; seed=1; steps=400
while [ $# -gt 0 ]; do
  case "$1" in
    --help) printf 'usage: train [OPTIONS]\n\noptions:\n  --lr LR      rate (default: 0.1)\n  --seed SEED  (default: 1)\n'
            printf '  --steps N    (default: 400)\n  --width W    (default: 3)\n'; exit 0 ;;
    --*=*) word=${1#--}; eval "${word%%=*}=${word#*=}"; shift ;;
    --*) eval "${1#--}=$2"; shift 2 ;;
  esac
done
mkdir -p "logs/run_$seed"
. ./common.sh
awk -v lr="$lr" -v seed="$seed" -v steps="$steps" 'BEGIN {
  print "timesteps,eval_loss" > ("logs/run_" seed "/progress.csv")
  for (step = 100; step <= steps; step += 100) {
    printf "{\"global_step\": %d, \"charts\": {\"return\": %f}, \"lr\": %f}\n", step, lr * (step + seed), lr
    printf "%d,%f\n", step, 1 / (lr * step + seed) > ("logs/run_" seed "/progress.csv")
  }
}'
"#;

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("train", LEARNER);
    bench.write("common.sh", "true\n");
    make_runnable(&bench, "train");
    bench
}

fn make_runnable(bench: &Bench, name: &str) {
    use std::os::unix::fs::PermissionsExt as _;
    fs::set_permissions(bench.path(name), fs::Permissions::from_mode(0o755)).unwrap();
}

fn read(bench: &Bench, name: &str) -> String {
    fs::read_to_string(bench.path(name)).unwrap()
}

#[test]
fn a_command_becomes_a_study_that_runs() {
    let bench = bench();
    let answer = bench.run(&["new", "walk", "--from", "./train --lr 0.5", "--yes"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.err.contains("no lock file was found"), "{}", answer.err);
    let text = read(&bench, "walk.yaml");
    for part in [
        "run: [./train, --lr, \"{lr}\", --seed, \"{seed}\", --steps, \"{steps}\"]",
        "lr: 0.5",
        "Options that stay with their defaults: --width (3).",
        "sources: [common.sh, train]",
        "reads: { from: stdout, step: global_step }",
        "return: charts/return",
        "# eval_loss: { key: eval_loss, from: \"logs/*/progress.csv\", step: timesteps }",
        "steps: 400, evaluate_every: 40",
    ] {
        assert!(text.contains(part), "{part}:\n{text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 120), "{text}");
    let check = bench.run(&["check", "walk.yaml"]);
    assert!(check.code == 0 && !check.err.contains("warning"), "{}", check.err);
    let run = bench.run(&["run", "walk.yaml", "-P", "smoke", "--yes"]);
    assert_eq!(run.code, 0, "{}", run.err);
}

#[test]
fn the_program_runs_as_in_a_trial_and_its_help_takes_no_longer() {
    let bench = Bench::new();
    // It ignores `--help`, and reaches its trial as `regimen.trial()` does.
    bench.write(
        "a.sh",
        "test -f \"$REGIMEN_TRIAL\" && for i in 1 2 3; do echo \"{\\\"step\\\":$i,\\\"ret\\\":$LR}\"; done > \"$REGIMEN_LOG\"\nsleep 600\n",
    );
    make_runnable(&bench, "a.sh");
    let begun = std::time::Instant::now();
    let answer = bench.run(&[
        "new",
        "log",
        "--from",
        "LR=3 env sh a.sh",
        "--seconds",
        "2",
        "--yes",
    ]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(begun.elapsed().as_secs() < 40, "{:?}", begun.elapsed());
    let text = read(&bench, "log.yaml");
    for part in ["from: log", "ret: ret", "variables: { LR: \"3\" }"] {
        assert!(text.contains(part), "{part}:\n{text}");
    }
}

#[test]
fn the_sweep_of_another_tool_becomes_a_grid_or_a_search() {
    let bench = bench();
    let sweep = "program: ./train\nmethod: METHOD\nrun_cap: 3\nmetric: { name: eval_loss, goal: minimize }\ncommand: [\"${program}\", \
                 \"${args}\"]\nparameters:\n  lr: { values: [0.1, 0.2] }\n  seed: { values: [1, 2] }\n  steps: { value: 300 }\n";
    bench.write("sweep.yaml", &sweep.replace("METHOD", "grid"));
    let answer = bench.run(&["new", "grid", "--from", "sweep.yaml", "--yes"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(
        answer.err.contains("`run_cap` has no counterpart in a grid"),
        "{}",
        answer.err
    );
    let text = read(&bench, "grid.yaml");
    for part in [
        "mine.lr: { grid: [0.1, 0.2] }",
        "seeds: 2\n",
        "eval_loss: eval_loss",
        "shown: { eval_loss: { lower_is_better: true } }",
        "comparison: { rows: setting, value: eval_loss }",
        "\"--seed={seed}\", \"--steps={steps}\"",
    ] {
        assert!(text.contains(part), "{part}:\n{text}");
    }
    bench.write(
        "random.yaml",
        &sweep
            .replace("METHOD", "random")
            .replace("values: [0.1, 0.2]", "min: 0.1, max: 0.5"),
    );
    bench.ok(&["new", "search", "--from", "random.yaml", "--yes"]);
    let text = read(&bench, "search.yaml");
    for part in [
        "mine.lr: { uniform: { low: 0.1, high: 0.5 } }",
        "metric: eval_loss\n    direction: minimize\n    settings: 3\n    method: { random: {} }",
    ] {
        assert!(text.contains(part), "{part}:\n{text}");
    }
    for study in ["grid.yaml", "search.yaml"] {
        let run = bench.run(&["run", study, "--yes"]);
        assert_eq!(run.code, 0, "{}", run.err);
    }
}

#[test]
fn nothing_starts_without_consent() {
    let bench = bench();
    let answer = bench.run(&["new", "walk", "--from", "./train --lr 0.5"]);
    assert_eq!(answer.code, 2, "{}", answer.err);
    for part in [
        "./train --help (in ",
        "./train --lr 0.5 (in ",
        "`--yes` starts them",
    ] {
        assert!(answer.err.contains(part), "{part}: {}", answer.err);
    }
    assert!(!bench.path("walk.yaml").exists());
}

#[test]
fn a_program_that_does_not_end_is_stopped() {
    let bench = Bench::new();
    bench.write("a.sh", "echo step=1 loss=3\necho step=7 loss=2\nsleep 600\n");
    let answer = bench.run(&["new", "slow", "--from", "sh a.sh 5", "--seconds", "2", "--yes"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.err.contains("`steps: 70` is a guess"), "{}", answer.err);
    assert!(answer.err.contains("`5` stay as they are"), "{}", answer.err);
    assert!(
        answer.err.contains("no option for a seed was found"),
        "{}",
        answer.err
    );
    let text = read(&bench, "slow.yaml");
    assert!(
        text.contains("loss: loss") && text.contains("sources: [a.sh]"),
        "{text}"
    );
}

#[test]
fn what_cannot_become_a_study_is_said_with_what_can() {
    let bench = Bench::new();
    bench.write("silent.sh", "echo hello\n");
    bench.write("failing.sh", "cat data.txt\n");
    bench.write("data.txt", "");
    bench.write("plain.yaml", "a: 1\n");
    bench.write("broken.yaml", "a: [\n");
    let refused = |from: &str| {
        let answer = bench.run(&["new", "first", "--from", from, "--seconds", "5", "--yes"]);
        assert_eq!(answer.code, 2, "{from}: {}", answer.err);
        assert!(!bench.path("first.yaml").exists());
        answer.err
    };
    for (from, told) in [
        (
            "sh silent.sh",
            "`sh silent.sh` ran to its end, and wrote nothing that is read as a metric",
        ),
        (
            "sh failing.sh",
            "in which these files lay: failing.sh; `--source FILE` adds one",
        ),
        (
            "python missing.py",
            "`missing.py`, which `python missing.py` names, is not in this folder",
        ),
        (
            "sh silent.sh | tee log",
            "`|` in `sh silent.sh | tee log` is for a shell",
        ),
        (
            "no-such-program --x 1",
            "`no-such-program --help` cannot be started",
        ),
        ("missing.yaml", "`missing.yaml`, a sweep, is not in this folder"),
        ("plain.yaml", "`plain.yaml` is no sweep that is read"),
        ("broken.yaml", "broken.yaml"),
    ] {
        let error = refused(from);
        assert!(error.contains(told), "{from}: {error}");
    }
}

#[test]
fn sources_that_are_named_are_added_and_nothing_is_written_over() {
    let bench = Bench::new();
    bench.write("data.txt", "");
    bench.write("failing.sh", "cat data.txt; echo r=1\n");
    let new = |name: &str, more: &[&str]| {
        let command = ["new", name, "--from", "sh failing.sh", "--yes"];
        bench.run(&[&command, more].concat())
    };
    let unknown = new("first", &["--source", "nothing*"]);
    let message = "`nothing*`, a source of the program, is not in this folder";
    assert!(unknown.err.contains(message), "{}", unknown.err);
    let made = new("first", &["--source", "data.txt"]);
    assert_eq!(made.code, 0, "{}", made.err);
    assert!(read(&bench, "first.yaml").contains("sources: [failing.sh, data.txt]"));
    let again = new("first", &[]);
    assert!(again.err.contains("is there already"), "{}", again.err);
    let named = new("Two", &[]);
    assert!(named.err.contains("cannot name a study"), "{}", named.err);
}
