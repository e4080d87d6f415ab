//! Texts of a study are text wherever they are shown: no link, no formula, nothing that a terminal obeys.

use crate::program::Bench;

const STUDY: &str = "
study: small
title: \"A [title](javascript:alert(1)) with ![an image](https://example.org/a.png)\"
source: made for this test
environments: { cells: { battery: { cells: 2 } } }
agents: { equal: { equal_split: {} } }
protocol: { train_evaluate: { steps: 0, final_episodes: 2 } }
seeds: 2
tables:
  life:
    caption: \"Press [here](javascript:alert(2)) <script>alert(3)</script>\"
    comparison: { rows: environment, columns: agent, value: return }
figures:
  curve:
    caption: \"[press](javascript:alert(4))\"
    learning_curve: { metric: return }
    labels: { equal: \"=2+2 [b](javascript:alert(5))\" }
";

fn written(bench: &Bench, name: &str) -> String {
    std::fs::read_to_string(bench.path("results/small").join(name)).unwrap()
}

#[test]
fn links_and_images_in_a_study_are_text_in_its_report() {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml", "-j", "2"]);
    let report = written(&bench, "report.md");
    assert!(
        report.contains("javascript:alert(1)"),
        "the words are there: {report}"
    );
    for mark in ["](javascript:", "](https:", "<script"] {
        let plain = report.replace("\\]", "").replace("\\<", "");
        assert!(!plain.contains(mark), "{mark}: {report}");
    }
    let page = written(&bench, "index.html");
    for mark in ["href=\"javascript:", "src=\"https:", "<script>alert"] {
        assert!(!page.contains(mark), "{mark}");
    }
    for entry in std::fs::read_dir(bench.path("results/small/figures")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|it| it == "csv") {
            let text = std::fs::read_to_string(path).unwrap();
            assert!(
                !text.split([',', '\n']).any(|cell| cell.starts_with(['=', '@'])),
                "{text}"
            );
        }
    }
}

#[test]
fn control_characters_of_a_study_are_refused_and_reach_no_terminal() {
    let bench = Bench::new();
    for (word, code) in [("\\e[2J", "U+001B"), ("\\0", "U+0000"), ("\\x9b", "U+009B")] {
        let study = STUDY.replace("made for this test", &format!("\"made {word} for this test\""));
        bench.write("small.yaml", &study);
        let told = bench.run(&["check", "small.yaml"]);
        assert_eq!(told.code, 2);
        assert!(told.err.contains(code), "{}", told.err);
        assert!(!told.err.contains(['\u{1b}', '\u{9b}', '\0']), "{:?}", told.err);
    }
    let told = bench.run(&["check", "no\u{1b}[2Jthing.yaml"]);
    assert!(told.code == 2 && !told.err.contains('\u{1b}'), "{:?}", told.err);
}

/// Words of others about a failure are short and colour nothing, wherever they are shown.
#[test]
fn a_long_error_with_codes_for_the_terminal_is_told_briefly_and_plainly() {
    let bench = Bench::new();
    bench.write("study.yaml", &crate::end_states::study("{ how: shout }"));
    let commands: [&[&str]; 5] = [
        &["run", "study.yaml", "-j", "1"],
        &["status", "study.yaml"],
        &["watch", "study.yaml", "--once"],
        &["plan", "study.yaml"],
        &["report", "study.yaml"],
    ];
    for arguments in commands {
        let told = bench.run_misused(arguments);
        let said = told.out + &told.err;
        let is_foreign =
            |letter: char| letter.is_control() && !"\n\t".contains(letter) || letter == '\u{202e}';
        assert!(!said.contains(is_foreign), "{arguments:?}: {said:?}");
        assert!(said.len() < 20_000, "{arguments:?}: {}", said.len());
    }
    let told = bench.run_misused(&["status", "study.yaml"]);
    assert!(told.out.contains("boom"), "{}", told.out);
    let report = std::fs::read_to_string(bench.path("results/misbehaving/report.md")).unwrap();
    assert!(report.len() < 20_000, "{}", report.len());
}

#[test]
fn marks_that_turn_the_direction_of_a_text_are_refused_in_a_study() {
    let bench = Bench::new();
    bench.write(
        "small.yaml",
        &STUDY.replace("made for this test", "\"made \\u202e for this test\""),
    );
    let told = bench.run(&["check", "small.yaml"]);
    assert!(told.code == 2 && told.err.contains("U+202E"), "{}", told.err);
}
