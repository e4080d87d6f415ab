//! Python that crashes, hangs, raises or says nonsense ends one trial and no other.

use super::*;

/// Writes a study of which one trial is odd and another one is well.
fn beside_a_tank(place: &Place, how: &str) {
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
}

fn ends_as(how: &str, options: &[&str], state: &str, reasons: &[&str]) {
    let Some(place) = Place::new() else { return };
    beside_a_tank(&place, how);
    place.one_trial_ends(options, ["odd sac", "tank sac"], state, reasons);
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
