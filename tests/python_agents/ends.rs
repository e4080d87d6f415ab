//! An agent that crashes, hangs, raises or says nonsense ends its own trial and no other.

use super::*;

fn ends_as(how: &str, options: &[&str], state: &str, reasons: &[&str]) {
    let Some(place) = Place::new() else { return };
    let agents = [
        ("odd", rule(&place, "rules.py:Odd", &format!("how: {how}"))),
        ("well", rule(&place, "rules.py:Rule", "")),
    ];
    let agents = agents.each_ref().map(|(name, it)| (*name, it.as_str()));
    let protocol = "{ steps: 0, final_episodes: 3 }";
    study(&place, &environment(&place, "own.py:Tank"), &agents, protocol);
    place.one_trial_ends(options, ["task odd", "task well"], state, reasons);
}

#[test]
fn an_exception_ends_one_trial_with_its_last_lines() {
    let lines = [
        "RuntimeError: the sensor is lost rules.py, line",
        "in lost: raise RuntimeError(\"the sensor is lost\")",
        "in act: return self.lost()",
    ];
    ends_as("raise", &[], "failed", &lines);
}

#[test]
fn a_crash_ends_one_trial_with_its_last_words() {
    let words = [
        "the Python process was ended by signal 11",
        "it said last: the rule is lost",
    ];
    ends_as("crash", &[], "failed", &words);
    let left = ["the Python process left with exit code 3"];
    ends_as("leave", &[], "failed", &left);
}

#[test]
fn silence_ends_one_trial_when_its_time_is_over() {
    let over = ["longer than the limit of 4 s"];
    ends_as("hang", &["--wall-time-s", "4"], "timeout", &over);
}

#[test]
fn actions_that_are_none_end_one_trial() {
    ends_as("nan", &[], "nan", &["the action of `", "rules.py:Odd"]);
    ends_as(
        "outside",
        &[],
        "failed",
        &["returned 2 for `action`, outside 0 to 1"],
    );
}
