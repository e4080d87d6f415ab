//! Whatever a study's file holds and whatever it names, `check` takes little time and memory and says little.

use crate::program::{Answer, Bench};
use std::process::Command;

const STUDY: &str = "
study: small
environments: { cells: { battery: { cells: 2 } } }
agents: { dsac: { dirichlet_sac: {} } }
protocol: { train_evaluate: { steps: 64 } }
";

fn check(text: &str, options: &[&str]) -> Answer {
    let bench = Bench::new();
    bench.write("small.yaml", text);
    bench.run(&[&["check", "small.yaml"], options].concat())
}

#[test]
fn samples_that_nobody_can_draw_are_refused_before_they_are_drawn() {
    for (generator, samples) in [
        ("random", "1000000000000000000"),
        ("log_uniform", "100001"),
        ("latin_hypercube", "1000000000"),
    ] {
        let sweep = format!("{{ {generator}: {{ low: 0.1, high: 0.2, samples: {samples} }} }}");
        let told = check(&format!("{STUDY}sweep: {{ dsac.discount: {sweep} }}\n"), &[]);
        assert_eq!(told.code, 2, "{}", told.err);
        assert!(
            told.err.contains("`samples`") && told.err.contains("100000"),
            "{}",
            told.err
        );
    }
}

#[test]
fn aliases_cannot_make_a_small_file_large() {
    let anchors = (1..9).map(|level| {
        let names: Vec<String> = vec![format!("*a{}", level - 1); 8];
        format!("  a{level}: &a{level} [{}]\n", names.join(", "))
    });
    let long = "x".repeat(100_000);
    let text = format!(
        "blocks:\n  a0: &a0 {long}\n{}{STUDY}",
        anchors.collect::<String>()
    );
    let told = check(&text, &[]);
    assert_eq!(told.code, 2);
    assert!(
        told.err.contains("the document has more than 32 MB"),
        "{}",
        told.err
    );
    assert!(told.err.len() < 10_000);
}

#[test]
fn many_mistakes_on_a_long_line_are_counted_and_the_first_are_shown() {
    let keys: Vec<String> = vec!["key: 1".into(); 20_000];
    let told = check(&format!("{{ {} }}", keys.join(", ")), &[]);
    assert_eq!(told.code, 2);
    assert_eq!(told.err.matches("the key `key` is given twice").count(), 50);
    assert!(
        told.err.contains("more messages, which are not shown"),
        "{}",
        told.err
    );
    assert!(told.err.len() < 100_000, "{}", told.err.len());
    let unknown: String = (0..30_000).map(|key| format!("unknown_{key}: 1\n")).collect();
    let told = check(&format!("{STUDY}{unknown}"), &[]);
    assert!(told.code == 2 && told.err.len() < 200_000, "{}", told.err.len());
    assert!(
        told.err
            .contains("the study has 29980 more unknown keys from here on"),
        "{}",
        told.err
    );
    let told = check(&format!("{STUDY}{}: 1\n", "k".repeat(1_000_000)), &[]);
    assert!(told.code == 2 && told.err.len() < 10_000, "{}", told.err.len());
}

#[test]
fn a_file_that_is_no_study_by_its_size_is_read_only_where_that_is_asked_for() {
    let lines = "\n".repeat(11_000_000);
    let told = check(&lines, &[]);
    assert_eq!(told.code, 2);
    for words in ["it has 11 MB, and no more than 10 MB are read", "`--input-mb 11`"] {
        assert!(told.err.contains(words), "{words}: {}", told.err);
    }
    let told = check(&lines, &["--input-mb", "11"]);
    assert!(
        told.code == 2 && told.err.contains("the file is empty"),
        "{}",
        told.err
    );
}

#[test]
fn a_device_or_a_pipe_is_no_study_and_no_data() {
    let bench = Bench::new();
    let pipe = bench.path("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for (named, words) in [
        ("/dev/zero", "a device or a pipe"),
        ("pipe", "a device or a pipe"),
        (".", "a folder"),
    ] {
        let told = bench.run(&["check", named]);
        assert!(
            told.code == 2 && told.err.contains(words),
            "{named}: {}",
            told.err
        );
        let load = format!("cells: 2, load: {{ file: {named} }}");
        let study = STUDY.replace("cells: 2", &load);
        bench.write("study.yaml", &study);
        let told = bench.run(&["check", "study.yaml"]);
        assert_eq!(told.code, 2, "{named}: {}", told.err);
        for words in ["cannot be read", words, "name a regular file"] {
            assert!(told.err.contains(words), "{words}: {}", told.err);
        }
    }
}

#[test]
fn a_message_about_a_foreign_file_shows_little_of_it() {
    let bench = Bench::new();
    let secret = "a line of a file that is nobody's business and long enough to hold something";
    bench.write("other.csv", &format!("t_s,power_w\n0,{secret}\n"));
    let study = STUDY.replace("cells: 2", "cells: 2, load: { file: other.csv }");
    bench.write("study.yaml", &study);
    let told = bench.run(&["check", "study.yaml"]);
    assert_eq!(told.code, 2);
    assert!(
        told.err.contains("line 2: `a line of a file tha…` is no number"),
        "{}",
        told.err
    );
    assert!(!told.err.contains("business"), "{}", told.err);
}
