//! Programs in Python that speak as trials.

use super::{reading::values, *};
use crate::needs;

/// A study of one program in Python that reads its log.
fn place(program: &str, metrics: &str) -> Option<Place> {
    let python = needs::python("json")?;
    let place = Place::new(
        "",
        metrics,
        &format!("      reads: {{ from: log }}\n      interpreter: {python}"),
    );
    let study = fs::read_to_string(place.bench.path("study.yaml")).unwrap();
    let study = study
        .replace("[sh, a.sh,", "[python3, a.py,")
        .replace("*.sh", "*.py");
    place.bench.write("study.yaml", &study);
    place.bench.write("a.py", program);
    Some(place)
}

#[test]
fn what_it_logs_is_recorded_also_from_forks_and_threads() {
    let program = "import os, threading\nimport regimen_trial as regimen\ntrial = regimen.trial()\n\
        trial.log(step=100, ret=1, loss=0.5)\n\
        threads = [threading.Thread(target=trial.log, kwargs={'step': 300, 'ret': 2}) for _ in range(20)]\n\
        [thread.start() for thread in threads]\n[thread.join() for thread in threads]\n\
        if os.fork() == 0:\n    trial.log(step=500.0, ret=3)\n    os._exit(0)\nos.wait()\n";
    let Some(place) = place(program, "{ return: { key: ret, last: 22 }, loss: loss }") else {
        return;
    };
    let answer = place.run(&[]);
    assert_eq!(answer.code, 0, "{}\n{}", answer.err, place.trial()["end"]);
    assert_eq!(values(&place, "train", "return"), ["100:1", "300:2", "500:3"]);
    assert_eq!(values(&place, "train", "loss"), ["100:0.5"]);
    assert_eq!(
        values(&place, "final", "return"),
        ["1000:2"],
        "none of 22 is lost"
    );
}

#[test]
fn a_number_that_is_none_ends_it_and_a_word_is_refused() {
    for (value, state, why) in [
        (
            "float('nan')",
            "nan",
            "return (phase train) is not finite at step 10",
        ),
        (
            "'high'",
            "failed",
            "regimen_trial.trial().log(step=10, ret='high')",
        ),
        (
            "None",
            "failed",
            "TypeError: `ret` is None, and a value of a metric is one number",
        ),
    ] {
        let program = format!(
            "import regimen_trial, time\nregimen_trial.trial().log(step=10, ret={value})\ntime.sleep(600)\n"
        );
        let Some(place) = place(&program, "{ return: ret }") else {
            return;
        };
        assert_eq!(place.run(&[]).code, 100);
        let end = place.trial()["end"].clone();
        assert_eq!(end["state"], state, "{end}");
        assert!(end["reason"].as_str().unwrap().contains(why), "{end}");
    }
}

#[test]
fn a_program_that_logs_nothing_is_told_so() {
    let Some(place) = place("", "{ return: ret }") else {
        return;
    };
    assert_eq!(place.run(&[]).code, 100);
    let reason = place.trial()["end"]["reason"].to_string();
    assert!(
        reason.contains("wrote nothing to the file that `REGIMEN_LOG` names"),
        "{reason}"
    );
}

/// By hand a program runs as it is, and what it says is seen.
#[test]
fn outside_a_trial_it_prints() {
    let Some(python) = needs::python("json") else {
        return;
    };
    let modules = Bench::new();
    let text = include_str!("../../plugins/wheel/regimen/_trial.py");
    modules.write("regimen_trial.py", text);
    let program = "import regimen_trial; regimen_trial.trial().log(step=1, ret=2)";
    let mut command = std::process::Command::new(python);
    let answer = command
        .args(["-c", program])
        .current_dir(modules.path(""))
        .output()
        .unwrap();
    assert_eq!(
        String::from_utf8_lossy(&answer.stdout),
        "{\"step\": 1, \"ret\": 2.0}\n"
    );
}
