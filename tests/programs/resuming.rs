//! Programs that are interrupted: those that say how they go on do, the others begin anew, and both come to the
//! numbers of a program that was let alone.

use super::*;
use std::process::{Child, Stdio};

/// Counts to ten, notes every step outside of the store, and goes on from the folder that it is told of. On
/// SIGTERM it leaves as if all were well.
const COUNTER: &str = "trap 'exit 0' TERM; step=0; [ \"$2\" = --resume ] && step=$(cat \"$1/step\")\n\
    while [ $step -lt 10 ]; do\n  step=$((step + 1)); echo \"step=${step}00 r=$step\"; echo $step >> ../../../../../../done\n  \
    echo $step > \"$1/new\"; mv \"$1/new\" \"$1/step\"; sleep 0.2\ndone\n";

fn counter(more: &str) -> Place {
    let bench = Bench::new();
    bench.write("a.sh", COUNTER);
    let run = "[sh, a.sh, \"{checkpoint}\"]";
    bench.write("study.yaml", &study_of(run, "{ return: r }", more));
    Place { bench }
}

const RESUME: &str = "      resume: [\"--resume\"]";

fn begun(place: &Place) -> Child {
    let mut command = place.bench.command(&["run", "study.yaml", "-j", "1", "--yes"]);
    let child = command
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    until("it counts", || done(place).len() >= 3);
    child
}

fn done(place: &Place) -> Vec<u64> {
    let text = fs::read_to_string(place.bench.path("done")).unwrap_or_default();
    text.lines().filter_map(|line| line.parse().ok()).collect()
}

/// The digest of what the only trial of an uninterrupted run recorded.
fn alone(more: &str) -> Vec<(String, String)> {
    let place = counter(more);
    assert_eq!(place.run(&[]).code, 0);
    assert_eq!(done(&place), (1..=10).collect::<Vec<_>>());
    place.bench.digests("store")
}

#[test]
fn a_program_that_is_stopped_goes_on_where_it_was() {
    let place = counter(RESUME);
    let mut child = begun(&place);
    let id = child.id().to_string();
    assert!(
        std::process::Command::new("kill")
            .args(["-INT", &id])
            .status()
            .unwrap()
            .success()
    );
    assert_eq!(child.wait().unwrap().code(), Some(106));
    until("it has left", || place.processes().is_empty());
    assert!(place.work().join("checkpoint/step").is_file());
    assert_eq!(place.run(&[]).code, 0, "{}", place.trial()["end"]);
    assert_eq!(
        done(&place),
        (1..=10).collect::<Vec<_>>(),
        "nothing is done twice"
    );
    assert_eq!(place.bench.digests("store"), alone(RESUME));
    assert!(!place.work().exists());
}

#[test]
fn a_run_that_is_stopped_says_which_trials_begin_anew() {
    for (more, told) in [
        (
            RESUME,
            "stopping: running trials save a checkpoint; a second Ctrl-C ends at once",
        ),
        (
            "",
            "stopping: running trials begin anew with the next run, since their programs have no `resume`; a second",
        ),
    ] {
        let place = counter(more);
        let mut command = place.bench.command(&["run", "study.yaml", "-j", "1", "--yes"]);
        let child = command
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        until("it counts", || done(&place).len() >= 3);
        let signalled = std::process::Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status();
        assert!(signalled.unwrap().success());
        let said = child.wait_with_output().unwrap().stderr;
        let said = String::from_utf8_lossy(&said);
        assert!(said.contains(told), "{said}");
    }
}

#[test]
fn a_program_whose_run_is_killed_goes_on_too() {
    let place = counter(RESUME);
    let mut child = begun(&place);
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(place.run(&[]).code, 0, "{}", place.trial()["end"]);
    let done = done(&place);
    // The step at which it was told to leave may have been noted and not saved.
    assert!(done.len() <= 11 && done.last() == Some(&10), "{done:?}");
    assert_eq!(place.bench.digests("store"), alone(RESUME));
}

#[test]
fn a_program_that_says_nothing_of_going_on_begins_anew() {
    let place = counter("");
    let mut child = begun(&place);
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(place.run(&[]).code, 0, "{}", place.trial()["end"]);
    assert_eq!(done(&place).iter().filter(|step| **step == 1).count(), 2);
    assert_eq!(place.bench.digests("store"), alone(""));
}

#[test]
fn a_limit_of_time_leaves_what_it_saved() {
    let place = counter(RESUME);
    let answer = place.run(&["--wall-time-s", "1", "--retry-on", "timeout", "--retries", "20"]);
    assert_eq!(answer.code, 0, "{}\n{}", answer.err, place.trial()["end"]);
    assert_eq!(place.bench.digests("store"), alone(RESUME));
    assert!(done(&place).len() <= 14, "{:?}", done(&place));
}

/// A search among four rates of programs that pause.
fn halving(resume: &str) -> String {
    format!(
        "study: tuned\nenvironments:\n  task: {{ named: {{ id: Walk-v0 }} }}\nagents:\n  mine:\n    program:\n      run: [sh, a.sh, \
         \"{{rate}}\", \"{{checkpoint}}\"]\n      parameters: {{ rate: 1 }}\n      sources: [a.sh]\n      lock: none\n      \
         metrics: {{ return: r }}\n{resume}\nprotocol: {{ train_evaluate: {{ steps: 1000, evaluate_every: 100 }} }}\nseeds: \
         2\ntune:\n  rates:\n    over: {{ mine.rate: {{ choice: [1, 3, 5, 9] }} }}\n    metric: return\n    settings: 4\n    \
         method: {{ halving: {{ pauses: [300], keep: 0.5 }} }}\n"
    )
}

#[test]
fn programs_that_go_on_pause_in_a_search_and_others_are_refused() {
    let bench = Bench::new();
    let program = COUNTER
        .replace("$1/", "$2/")
        .replace("\"$2\" =", "\"$3\" =")
        .replace("r=$step", "r=$((step * $1))");
    bench.write("a.sh", &program);
    bench.write("study.yaml", &halving(""));
    let answer = bench.run(&["check", "study.yaml"]);
    assert_eq!(answer.code, 2, "{}", answer.err);
    assert!(
        answer.err.contains("would begin anew after every pause"),
        "{}",
        answer.err
    );
    bench.write("study.yaml", &halving(RESUME));
    let answer = bench.run(&["run", "study.yaml", "--yes"]);
    assert_eq!(answer.code, 0, "{}\n{}", answer.out, answer.err);
    let partial = trial_files(&bench.path("store")).len();
    assert!(
        (3..=6).contains(&partial),
        "two settings of the search and two seeds end: {partial}"
    );
}
