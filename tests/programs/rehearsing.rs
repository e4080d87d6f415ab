//! `check --rehearse`: programs that repeat, nearly repeat and do not repeat, and those that cannot be rehearsed.

use super::*;

/// A program that prints ten values, each with `more` added: `$starts` is how often it was started, `$1` its seed.
fn adding(more: &str) -> Place {
    let place = Place::new("", "{ return: r }", "");
    let starts = place.bench.path("starts");
    let program = format!(
        "echo >>'{starts}'\nstarts=$(wc -l <'{starts}')\nstep=0\nwhile [ $step -lt 10 ]; do\n  step=$((step + 1))\n  \
         echo \"step=${{step}}00 r=$(awk -v s=\"$1\" -v n=$step -v starts=\"$starts\" \
         'BEGIN {{ printf \"%.12f\", 1 + s + n + {more} }}')\"\ndone\n",
        starts = starts.display()
    );
    place.bench.write("a.sh", &program);
    place
}

fn rehearse(place: &Place, options: &[&str]) -> Answer {
    let words = [&["check", "study.yaml", "--rehearse", "--yes"], options].concat();
    place.bench.run(&words)
}

#[test]
fn a_program_that_repeats_is_told_from_those_that_nearly_do_and_do_not() {
    let cases = [
        ("0", "repeats to the bit"),
        ("starts * 1e-8", "repeats to 1e-8"),
        ("starts", "does not repeat"),
    ];
    for (more, words) in cases {
        let place = adding(more);
        let answer = rehearse(&place, &[]);
        assert_eq!(answer.code, 0, "{}", answer.err);
        assert!(
            answer.out.contains(&format!("`mine` in `task` {words}")),
            "{more}: {}",
            answer.out
        );
        assert!(answer.out.starts_with("one: ok, 1 trial"), "{}", answer.out);
        assert!(!place.bench.path("store").exists(), "nothing is stored");
    }
}

#[test]
fn the_values_are_those_up_to_the_first_measurement() {
    let answer = rehearse(&adding("0"), &[]);
    // Two values of the training and the measurement at step 200.
    assert!(
        answer.out.contains("repeats to the bit (3 values)"),
        "{}",
        answer.out
    );
}

#[test]
fn a_program_that_fails_or_is_too_slow_is_named_with_the_reason() {
    let failing = Place::new("echo broken >&2; exit 3\n", "{ return: r }", "");
    let answer = rehearse(&failing, &[]);
    assert_eq!(answer.code, 100, "{}", answer.out);
    let words = ["`mine` in `task` was not rehearsed: it ended as failed", "broken"];
    assert!(words.iter().all(|it| answer.out.contains(it)), "{}", answer.out);

    let slow = Place::new("sleep 60\n", "{ return: r }", "");
    let answer = rehearse(&slow, &["--rehearse-for", "1"]);
    assert_eq!(answer.code, 100, "{}", answer.out);
    let words = ["was not rehearsed", "`--rehearse-for` gives it longer"];
    assert!(words.iter().all(|it| answer.out.contains(it)), "{}", answer.out);
    until("nothing is left of it", || slow.processes().is_empty());
}

#[test]
fn a_program_whose_numbers_are_not_finite_is_not_rehearsed() {
    let program = "echo '{\"step\": 200, \"r\": NaN}'\n";
    let answer = rehearse(&Place::new(program, "{ return: r }", ""), &[]);
    assert_eq!(answer.code, 100, "{}", answer.out);
    let words = "`mine` in `task` was not rehearsed: it ended as nan: ";
    assert!(answer.out.contains(words), "{}", answer.out);
}

/// How often the program was started.
fn starts(place: &Place) -> usize {
    let lines = fs::read_to_string(place.bench.path("starts")).unwrap_or_default();
    lines.lines().count()
}

#[test]
fn a_run_says_in_its_report_whether_a_program_repeats_and_finds_it_out_once() {
    let tables = "tables:\n  returns: { comparison: { rows: agent, value: return } }\n";
    for (more, says) in [
        ("0", "Repeats to the bit with the same seed: `mine`."),
        ("starts", "Does not repeat with the same seed: `mine`."),
    ] {
        let place = adding(more);
        place.edit("seeds: 1\n", &format!("seeds: 2\n{tables}"));
        assert_eq!(place.run(&[]).code, 0);
        assert_eq!(starts(&place), 3, "two trials, and one of them again");
        let report = || fs::read_to_string(place.bench.path("results/one/report.md")).unwrap();
        assert!(report().contains(says), "{}", report());
        assert_eq!(place.run(&[]).code, 0);
        assert_eq!(starts(&place), 3);
        // The folder of results knows it without the store.
        fs::remove_dir_all(place.bench.path("store")).unwrap();
        place.bench.ok(&["report", "study.yaml", "--recorded"]);
        assert!(report().contains(says), "{}", report());
    }
}

/// One of two trials has ended when the run is stopped.
#[test]
fn a_run_that_is_stopped_starts_nothing_more() {
    let place = Place::new("", "{ return: r }", "");
    let started = place.bench.path("starts");
    let program = format!(
        "echo >>'{}'\nfor step in 200 400; do echo step=$step r=1; done\n[ $1 = 0 ] || sleep 60\n",
        started.display()
    );
    place.bench.write("a.sh", &program);
    place.edit("seeds: 1\n", "seeds: 2\n");
    let mut command = place.bench.command(&["run", "study.yaml", "-j", "1", "--yes"]);
    let mut run = command
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    until("the second trial runs", || starts(&place) == 2);
    let told = std::process::Command::new("kill")
        .args(["-INT", &run.id().to_string()])
        .status();
    assert!(told.unwrap().success());
    assert_eq!(run.wait().unwrap().code(), Some(106));
    assert_eq!(starts(&place), 2);
}

#[test]
fn a_run_computes_nothing_twice_where_that_is_not_wanted_or_not_quick() {
    let place = adding("0");
    assert_eq!(place.run(&["--no-rehearsal"]).code, 0);
    assert_eq!(starts(&place), 1);
    let place = adding("0");
    place.edit("evaluate_every: 200", "evaluate_every: 0");
    let tables = "tables:\n  returns: { comparison: { rows: agent, value: return } }\n";
    place.edit("seeds: 1\n", &format!("seeds: 1\n{tables}"));
    assert_eq!(place.run(&[]).code, 0);
    assert_eq!(starts(&place), 1);
    let report = fs::read_to_string(place.bench.path("results/one/report.md")).unwrap();
    let says = "Not known to repeat (nothing is measured before its end): `mine`.";
    assert!(report.contains(says), "{report}");
}

#[test]
fn nobody_s_program_starts_without_consent_and_json_is_refused() {
    let place = adding("0");
    let answer = place.bench.run(&["check", "study.yaml", "--rehearse"]);
    assert_eq!(answer.code, 2, "{}", answer.out);
    assert!(answer.err.contains("--yes"), "{}", answer.err);
    let answer = rehearse(&place, &["--format", "json"]);
    assert_eq!(answer.code, 2);
    assert!(answer.err.contains("leave out `--format json`"), "{}", answer.err);
}
