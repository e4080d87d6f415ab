//! Every way in which a trial can end, each reached through the program, and what is tried again.

use crate::program::{Answer, Bench};
use serde_json::Value;
use std::time::{Duration, Instant};

/// One misbehaving trial, and one that is well.
pub(crate) fn study(how: &str) -> String {
    format!(
        "
study: misbehaving
environments: {{ cells: {{ battery: {{ cells: 2 }} }} }}
agents:
  equal: {{ equal_split: {{}} }}
  odd: {{ misbehaving: {how} }}
protocol: {{ train_evaluate: {{ steps: 16, environments: 8, evaluate_every: 0, episodes: 0, final_episodes: \
1 }} }}
"
    )
}

fn run(how: &str, options: &[&str]) -> (Bench, Answer) {
    let bench = Bench::new();
    bench.write("study.yaml", &study(how));
    let answer = bench.run_misused(&[&["run", "study.yaml", "-j", "1"], options].concat());
    (bench, answer)
}

/// End state and reason of the odd trial, as stored.
fn end(bench: &Bench) -> (String, String) {
    let odd = crate::program::trial_files(&bench.path("store"))
        .into_iter()
        .find_map(|file| {
            let trial: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
            (trial["key"]["agent"]["plugin"] == "misbehaving").then_some(trial)
        });
    let odd = odd.unwrap();
    (
        odd["end"]["state"].as_str().unwrap().into(),
        odd["end"]["reason"].as_str().unwrap().into(),
    )
}

/// The other trial is well whatever happens to this one, and the study says what happened.
fn ends_as(how: &str, options: &[&str], state: &str, reason: &str) {
    let (bench, answer) = run(how, options);
    let (found, why) = end(&bench);
    assert_eq!(found, state, "{}", answer.err);
    assert!(why.contains(reason), "{why}");
    assert!(answer.err.contains("ok       cells equal"), "{}", answer.err);
    assert!(
        answer.err.contains(&format!("{state:<8} cells odd")),
        "{}",
        answer.err
    );
    // A trial that was killed is missing, any other has failed.
    assert_eq!(answer.code, if state == "killed" { 106 } else { 100 });
    let status = bench.run_misused(&["status", "study.yaml"]);
    assert!(status.out.contains(reason), "{}", status.out);
}

#[test]
fn an_error_ends_as_failed() {
    ends_as("{ how: fail }", &[], "failed", "it fails as asked");
}

#[test]
fn a_panic_ends_as_panicked() {
    ends_as("{ how: panic }", &[], "panicked", "it panics as asked");
}

#[test]
fn an_engine_without_an_operating_point_ends_as_failed_and_leaves_the_others_alone() {
    let bench = Bench::new();
    let header = "altitude_m,mach,delta_t_k,thrust_n\n10000,0.8,0,20000\n";
    bench.write("calm.csv", header);
    bench.write("hopeless.csv", &format!("{header}10000,0.8,0,200000\n"));
    bench.write(
        "study.yaml",
        "study: engines\nenvironments:\n\
         \x20 calm: { turbofan: { calibrated: [hpt_efficiency], flight: { file: calm.csv } } }\n\
         \x20 hopeless: { turbofan: { calibrated: [hpt_efficiency], flight: { file: hopeless.csv } } }\n\
         agents: { healthy: { zero_action: {} } }\n\
         protocol: { track: { episodes: 1, trace_episodes: 0 } }\n",
    );
    let answer = bench.run(&["run", "study.yaml", "-j", "1"]);
    assert_eq!(answer.code, 100, "{}", answer.err);
    assert!(answer.err.contains("ok       calm healthy"), "{}", answer.err);
    assert!(answer.err.contains("failed   hopeless healthy"), "{}", answer.err);
    let status = bench.run(&["status", "study.yaml"]).out;
    let named = "turbofan: point 2 (altitude 10000 m, mach 0.8, 0 K from a standard day, thrust_n 200000): the \
                 engine finds no operating point; its parts disagree by";
    assert!(status.contains(named), "{status}");
}

#[test]
fn an_abort_ends_as_panicked() {
    ends_as("{ how: abort }", &[], "panicked", "aborted");
}

#[test]
fn a_loop_ends_as_timeout_when_its_time_is_over() {
    let started = Instant::now();
    ends_as(
        "{ how: loop }",
        &["--wall-time-s", "0.3"],
        "timeout",
        "longer than the limit of 0.3 s",
    );
    assert!(started.elapsed() < Duration::from_secs(20));
}

#[test]
fn memory_without_end_ends_as_oom() {
    ends_as(
        "{ how: allocate }",
        &["--memory-mb", "300"],
        "oom",
        "above the limit of 300 MB",
    );
}

#[test]
fn a_number_that_is_none_ends_as_nan() {
    ends_as("{ how: nan }", &[], "nan", "the loss is not finite");
}

#[test]
fn a_measurement_that_is_no_number_ends_as_nan_and_reaches_no_table() {
    let bench = Bench::new();
    let study = crate::program::repository().join("experiments/chapter-3/figure-bias-variance.yaml");
    let study = study.to_str().unwrap();
    let options = [
        "--profile",
        "smoke",
        "--set",
        "bandit.curvature=1e300",
        "--only",
        "dirichlet",
    ];
    let answer = bench.run(&[&["run", study], &options[..]].concat());
    assert_eq!(answer.code, 100, "{}", answer.err);
    let status = bench.run(&[&["status", study], &options[..]].concat());
    assert!(status.out.contains("nan      bandit dirichlet"), "{}", status.out);
    assert!(
        status
            .out
            .contains("gradient_bias (phase evaluate) is not finite at step 256: NaN"),
        "{}",
        status.out
    );
    assert!(!answer.out.contains("NaN"), "{}", answer.out);
}

#[test]
fn a_process_that_is_always_killed_ends_as_killed_after_its_retries() {
    let (bench, answer) = run("{ how: kill }", &["--retries", "2", "--retry-delay-s", "0.01"]);
    assert_eq!(answer.err.matches("tried again in").count(), 2, "{}", answer.err);
    assert!(answer.err.contains("tried again in 0.0 s"), "{}", answer.err);
    assert_eq!(end(&bench).0, "killed");
    assert_eq!(answer.code, 106);
}

#[test]
fn a_process_that_is_killed_once_ends_well() {
    let (bench, answer) = run("{ how: kill, once: mark }", &["--retry-delay-s", "0.01"]);
    assert_eq!(answer.err.matches("tried again in").count(), 1, "{}", answer.err);
    assert_eq!((end(&bench).0.as_str(), answer.code), ("ok", 0));
}

#[test]
fn only_what_was_killed_is_tried_again_unless_asked() {
    let (_, answer) = run("{ how: panic, once: mark }", &[]);
    assert_eq!((answer.code, answer.err.contains("tried again")), (100, false));
    let (bench, answer) = run(
        "{ how: panic, once: mark }",
        &["--retry-on", "panicked", "--retry-delay-s", "0.01"],
    );
    assert_eq!((end(&bench).0.as_str(), answer.code), ("ok", 0), "{}", answer.err);
    let (_, answer) = run("{}", &["--retry-on", "lost"]);
    assert_eq!(answer.code, 2);
    assert!(
        answer
            .err
            .contains("known: failed, panicked, timeout, oom, nan, killed"),
        "{}",
        answer.err
    );
}

#[test]
fn limits_in_the_study_and_on_the_machine_hold() {
    let bench = Bench::new();
    bench.write(
        "study.yaml",
        &format!("{}limits: {{ wall_time_s: 0.2 }}\n", study("{ how: loop }")),
    );
    assert_eq!(bench.run_misused(&["run", "study.yaml"]).code, 100);
    assert_eq!(end(&bench).0, "timeout");
    let bench = Bench::new();
    bench.write(
        "study.yaml",
        &format!("{}limits: {{ wall_time_s: 600 }}\n", study("{ how: loop }")),
    );
    bench.write("regimen.toml", "[limits]\nwall_time_s = 0.2\n");
    assert_eq!(bench.run_misused(&["run", "study.yaml"]).code, 100);
    assert_eq!(end(&bench).0, "timeout");
}

#[test]
fn fail_fast_stops_and_keep_going_does_not() {
    let many = study("{ how: fail }").replace("protocol:", "seeds: 20\nprotocol:");
    let stopped = Bench::new();
    stopped.write("study.yaml", &many);
    let answer = stopped.run_misused(&["run", "study.yaml", "-j", "1", "--fail-fast"]);
    assert_eq!(answer.code, 100, "{}", answer.err);
    assert!(
        answer.err.contains("39 trials are still missing"),
        "{}",
        answer.err
    );
    let answer = stopped.run_misused(&["run", "study.yaml", "-j", "1", "--keep-going"]);
    assert_eq!(answer.code, 100);
    let status = stopped.run_misused(&["status", "study.yaml", "--format", "json"]);
    let status: Value = serde_json::from_str(&status.out).unwrap();
    assert_eq!(
        (
            status["cells"][0]["ok"].as_u64(),
            status["cells"][1]["failed"].as_u64()
        ),
        (Some(20), Some(20))
    );
}

#[test]
fn limits_that_limit_nothing_or_everything_are_refused_on_the_command_line() {
    let bench = Bench::new();
    bench.write("study.yaml", &study("{ how: loop }"));
    for (option, value, instead) in [
        ("--wall-time-s", "-1", "0.001"),
        ("--wall-time-s", "nan", "0.001"),
        ("--wall-time-s", "inf", "0.001"),
        ("--wall-time-s", "0", "0.001"),
        ("--memory-mb", "0", "1 megabyte or more"),
        ("--retries", "101", "from 0 to 100"),
        ("--retry-delay-s", "-1", "from 0 to 86400"),
        ("--retry-on", "ok", "known: failed"),
    ] {
        let told = bench.run_misused(&["run", "study.yaml", option, value]);
        assert_eq!(told.code, 2, "{option} {value}: {}", told.err);
        assert!(
            told.err.contains(option) && told.err.contains(instead),
            "{}",
            told.err
        );
    }
    assert!(!bench.path("store").exists());
}

#[test]
fn the_checkpoint_that_is_kept_after_a_timeout_is_no_fault() {
    let bench = Bench::new();
    bench.write(
        "study.yaml",
        &study("{ how: loop }").replace("steps: 16", "steps: 160000"),
    );
    bench.write(
        "regimen.toml",
        "checkpoint_every_s = 0\n[limits]\nwall_time_s = 3\n",
    );
    let ran = bench.run_misused(&["run", "study.yaml", "-j", "2", "--retry-on", "killed"]);
    assert_eq!(ran.code, 100, "{}", ran.err);
    let checked = bench.ok(&["fsck", "store"]);
    assert!(checked.contains("0 files are wrong"), "{checked}");
}
