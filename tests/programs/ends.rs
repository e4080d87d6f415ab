//! How programs end: by their exit code, by a signal, by a limit, or because their worker does. Nothing outlives them.

use super::*;

const RETURN: &str = "{ return: r }";

/// The state of the only trial and the words of its end.
fn ends_as(program: &str, options: &[&str], state: &str, words: &[&str]) -> Place {
    let place = Place::new(program, RETURN, "");
    let answer = place.run(options);
    // A trial that was killed from outside is missing still.
    let code = if state == "killed" { 106 } else { 100 };
    assert_eq!(answer.code, code, "{program}: {}\n{}", answer.out, answer.err);
    let end = &place.trial()["end"];
    assert_eq!(end["state"], state, "{program}: {end}");
    for word in words {
        let reason = end["reason"].as_str().unwrap();
        assert!(reason.contains(word), "{program}: `{word}` is not in `{reason}`");
    }
    until("no process of it is left", || place.processes().is_empty());
    place
}

#[test]
fn an_exit_code_is_told_with_the_last_words() {
    let place = ends_as(
        "echo r=1; echo 'the pump is broken' >&2; exit 3\n",
        &[],
        "failed",
        &[
            "`sh a.sh` left with exit code 3",
            "it said last: the pump is broken",
        ],
    );
    assert!(place.trial()["output"].is_string(), "what it said is kept");
}

#[test]
fn a_fault_is_told_by_its_name() {
    ends_as(
        "echo r=1; kill -s SEGV $$\n",
        &[],
        "failed",
        &["signal 11 (segmentation fault)", "said nothing"],
    );
}

#[test]
fn a_program_that_somebody_ends_is_tried_again_and_then_called_killed() {
    let program = "echo x >> ../../../../../../attempts; kill -s KILL $$\n";
    let place = ends_as(program, &[], "killed", &["the program was ended by signal 9"]);
    let attempts = fs::read_to_string(place.bench.path("attempts")).unwrap();
    assert_eq!(attempts.lines().count(), 3);
}

#[test]
fn a_program_that_is_not_there_is_named() {
    let place = Place::new("", RETURN, "      interpreter: /nowhere/sh");
    assert_eq!(place.run(&[]).code, 100);
    let reason = place.trial()["end"]["reason"].to_string();
    assert!(
        reason.contains("`run`: `/nowhere/sh a.sh` cannot be started: No such file"),
        "{reason}"
    );
}

#[test]
fn steps_that_go_back_are_told_in_the_words_of_the_output() {
    ends_as(
        "echo step=200 r=1; echo step=100 r=2\n",
        &[],
        "failed",
        &[
            "`stdout`: step 100 comes after step 200: ",
            "its line has `r=2 step=100`",
        ],
    );
}

#[test]
fn a_metric_that_never_came_is_told_with_what_did() {
    ends_as(
        "echo loss=1 lr=0.1\n",
        &[],
        "failed",
        &["no value of it, which is to be `return`", "`loss`, `lr`"],
    );
}

#[test]
fn a_number_that_is_none_ends_the_program() {
    ends_as(
        "echo '{\"step\": 10, \"r\": 1}'; echo '{\"step\": 20, \"r\": NaN}'; sleep 600\n",
        &[],
        "nan",
        &["return (phase train) is not finite at step 20"],
    );
}

#[test]
fn wall_time_ends_it_with_all_that_it_started() {
    let program = "sleep 601 & (sleep 602 &) ; setsid sleep 603 & echo r=1; sleep 604\n";
    ends_as(
        program,
        &["--wall-time-s", "1"],
        "timeout",
        &["longer than the limit of 1 s"],
    );
}

#[test]
fn what_it_leaves_running_ends_with_it() {
    let place = Place::new("sleep 601 & setsid sleep 602 & echo r=1\n", RETURN, "");
    let answer = place.run(&[]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert_eq!(place.processes(), [0; 0]);
}

#[test]
fn memory_of_all_that_it_started_counts() {
    let program = "sh -c 'awk \"BEGIN { for (;;) { text = text \\\"0123456789abcdef0123456789abcdef\\\"; \
                   many[n++] = text } }\"'\n";
    ends_as(
        program,
        &["--memory-mb", "300"],
        "oom",
        &["above the limit of 300 MB"],
    );
}

#[test]
fn silence_ends_it() {
    ends_as(
        "echo r=1; sleep 600\n",
        &["--stalled-after-s", "1"],
        "timeout",
        &["nothing was heard of it for the limit of 1 s"],
    );
}

#[test]
fn a_trial_at_its_limit_of_time_ends_with_its_program() {
    let program = "trap 'sleep 1; echo ended >> ../../../../../../noted; exit 0' TERM\necho begun >> ../../../../../../noted\n\
                   echo r=1; sleep 600 & wait\n";
    for options in [
        &["--retries", "0", "--seeds", "2"],
        &["--retries", "1", "--retry-on", "timeout"][..],
    ] {
        let place = Place::new(program, RETURN, "");
        let answer = place.run(&[&["--wall-time-s", "1"], options].concat());
        assert_eq!(answer.code, 100, "{}", answer.err);
        let noted = fs::read_to_string(place.bench.path("noted")).unwrap();
        let noted: Vec<&str> = noted.lines().collect();
        assert_eq!(
            noted,
            ["begun", "ended", "begun", "ended"],
            "{options:?}: {}",
            answer.err
        );
    }
}

#[test]
fn nothing_outlives_a_worker_or_a_guard_that_is_killed() {
    for verb in ["trial-worker", "program-guard"] {
        let place = Place::new("echo r=1; sleep 600 & sleep 601\n", RETURN, "");
        let mut child = place
            .bench
            .command(&["run", "study.yaml", "-j", "1", "--yes", "--retries", "0"])
            .stderr(std::process::Stdio::null())
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
        until("both sleep", || place.processes().len() >= 3);
        let killed = descendants(child.id())
            .into_iter()
            .find(|pid| fs::read(format!("/proc/{pid}/cmdline")).is_ok_and(|it| contains(&it, verb)));
        let killed = killed.unwrap_or_else(|| panic!("no {verb}")).to_string();
        let status = std::process::Command::new("kill")
            .args(["-9", &killed])
            .status()
            .unwrap();
        assert!(status.success());
        assert_eq!(child.wait().unwrap().code(), Some(106), "{verb}");
        until("no process of it is left", || place.processes().is_empty());
        assert_eq!(place.trial()["end"]["state"], "killed", "{verb}");
    }
}

#[test]
fn a_run_that_is_killed_takes_its_program_with_it() {
    let place = Place::new("echo r=1; sleep 600 & sleep 601\n", RETURN, "");
    let mut command = place.bench.command(&["run", "study.yaml", "-j", "1", "--yes"]);
    command
        .stderr(std::process::Stdio::null())
        .stdout(std::process::Stdio::null());
    let mut child = command.spawn().unwrap();
    until("both sleep", || place.processes().len() >= 3);
    child.kill().unwrap();
    child.wait().unwrap();
    until("no process of it is left", || place.processes().is_empty());
}

fn contains(text: &[u8], word: &str) -> bool {
    text.windows(word.len()).any(|it| it == word.as_bytes())
}

/// All that comes from a process.
fn descendants(pid: u32) -> Vec<u32> {
    let mut all = vec![pid];
    let mut at = 0;
    while let Some(pid) = all.get(at).copied() {
        for task in fs::read_dir(format!("/proc/{pid}/task"))
            .into_iter()
            .flatten()
            .flatten()
        {
            let children = fs::read_to_string(task.path().join("children")).unwrap_or_default();
            all.extend(
                children
                    .split_whitespace()
                    .filter_map(|it| it.parse::<u32>().ok()),
            );
        }
        at += 1;
    }
    all
}
