//! Folders of results: whose they are, what is said of options, and what an earlier report leaves.

use crate::program::Bench;
use std::fs;

const STUDY: &str = "
study: small
title: A small study
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  random: { random_allocation: {} }
protocol: { train_evaluate: { steps: 0, final_episodes: 2 } }
seeds: 2
profiles:
  smoke: { seeds: 1 }
tables:
  lengths: { comparison: { rows: agent, value: cycle_length } }
figures:
  bars: { bars: { of: { rows: agent, value: cycle_length } } }
";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench
}

fn read(bench: &Bench, name: &str) -> String {
    fs::read_to_string(bench.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

#[test]
fn results_of_other_options_have_a_folder_of_their_own_and_say_so_at_their_head() {
    let bench = bench();
    bench.ok(&["run", "small.yaml"]);
    let (report, page) = (
        read(&bench, "results/small/report.md"),
        read(&bench, "results/small/index.html"),
    );
    assert!(
        !report.contains("Computed with") && !page.contains("Computed with"),
        "{report}"
    );
    let options = [
        "run",
        "small.yaml",
        "--set",
        "cells.cells=3",
        "--seeds",
        "1",
        "--only",
        "equal",
    ];
    let out = bench.ok(&options);
    let folder = "results/small+cells.cells=3+seeds=1+only=equal";
    let words = "Computed with --set cells.cells=3, --seeds 1, --only equal.";
    assert!(out.contains(words) && out.contains(folder), "{out}");
    assert!(read(&bench, &format!("{folder}/report.md")).contains(words));
    assert!(read(&bench, &format!("{folder}/index.html")).contains(words));
    let page_of_profile = bench.ok(&["run", "small.yaml", "--profile", "smoke", "--seeds", "2", "-v"]);
    assert!(
        page_of_profile.contains("results/small-smoke+seeds=2/index.html"),
        "{page_of_profile}"
    );
    assert!(
        read(&bench, "results/small-smoke+seeds=2/report.md")
            .contains("Computed with --profile smoke, --seeds 2.")
    );
    assert!(page_of_profile.contains("Seeds: 2, by `--seeds 2` in place of the study's number."));
    bench.ok(&["run", "small.yaml", "--profile", "smoke"]);
    assert!(
        read(&bench, "results/small-smoke/report.md").contains("Seeds: 1, fixed before the first trial.")
    );
    bench.ok(&["report", "small.yaml", "--seeds", "1", "-o", "elsewhere"]);
    assert!(read(&bench, "elsewhere/report.md").contains("Computed with --seeds 1."));
    assert_eq!(
        (
            read(&bench, "results/small/report.md"),
            read(&bench, "results/small/index.html")
        ),
        (report, page)
    );
}

#[test]
fn two_study_files_of_one_name_are_refused_in_one_command() {
    let bench = bench();
    bench.write("other.yaml", &STUDY.replace("seeds: 2", "seeds: 3"));
    for verb in ["run", "report"] {
        let answer = bench.run(&[verb, "small.yaml", "other.yaml"]);
        assert_eq!(answer.code, 2, "{}", answer.err);
        for part in [
            "`small.yaml`",
            "`other.yaml`",
            "results/small",
            "rename one of the studies",
        ] {
            assert!(answer.err.contains(part), "{part}: {}", answer.err);
        }
    }
    assert!(
        !bench.path("store").exists() && !bench.path("results").exists(),
        "nothing ran"
    );
    assert_eq!(
        bench.run(&["run", "small.yaml", "./small.yaml"]).code,
        0,
        "one file by two names is one study"
    );
    bench.write("third.yaml", &STUDY.replace("study: small", "study: third"));
    bench.ok(&["run", "small.yaml", "third.yaml", "-o", "out"]);
    let there = |name: &str| bench.path("out").join(name).exists();
    assert!(
        ["small/report.md", "third/report.md", "index.html"]
            .into_iter()
            .all(there)
    );
    let answer = bench.run(&["run", "third.yaml", "-o", "out/small"]);
    assert!(
        answer.code == 2 && answer.err.contains("give each a folder of its own with `-o`"),
        "{}",
        answer.err
    );
}

#[test]
fn a_folder_belongs_to_one_study_file_until_that_is_gone() {
    let bench = bench();
    bench.ok(&["run", "small.yaml"]);
    let before = read(&bench, "results/small/report.md");
    fs::create_dir(bench.path("copies")).unwrap();
    bench.write(
        "copies/other.yaml",
        &STUDY.replace("A small study", "Another study"),
    );
    for arguments in [
        &["report", "copies/other.yaml"][..],
        &["run", "copies/other.yaml", "-o", "results/small"],
    ] {
        let refused = bench.run(arguments);
        assert_eq!(refused.code, 2, "{}", refused.err);
        assert!(
            refused.err.contains("small.yaml`") && refused.err.contains("`copies/other.yaml`"),
            "{}",
            refused.err
        );
    }
    assert_eq!(read(&bench, "results/small/report.md"), before);
    bench.ok(&["report", "copies/other.yaml", "-o", "results/other"]);
    // Seen from another folder it is the same file.
    let mut elsewhere = bench.command(&[
        "report",
        "../small.yaml",
        "-o",
        "../results/small",
        "--store",
        "../store",
    ]);
    assert!(
        elsewhere
            .current_dir(bench.path("copies"))
            .output()
            .unwrap()
            .status
            .success()
    );
    fs::rename(bench.path("small.yaml"), bench.path("renamed.yaml")).unwrap();
    bench.ok(&["report", "renamed.yaml"]);
    assert_eq!(bench.run(&["report", "copies/other.yaml"]).code, 2);
    fs::remove_file(bench.path("renamed.yaml")).unwrap();
    bench.ok(&["report", "copies/other.yaml"]);
    assert!(read(&bench, "results/small/report.md").contains("Another study"));
}

#[test]
fn what_a_report_does_not_write_any_more_goes_and_nothing_else() {
    let bench = bench();
    bench.ok(&["run", "small.yaml"]);
    bench.write("results/small/tables/mine.md", "by hand");
    bench.write(
        "small.yaml",
        &STUDY
            .replace("  lengths:", "  cycles:")
            .replace("  bars:", "  columns:"),
    );
    let told = bench.run(&["report", "small.yaml"]);
    assert_eq!(told.code, 0);
    assert!(
        told.err.contains("removed") && told.err.contains("tables/lengths.md"),
        "{}",
        told.err
    );
    let there = |name: &str| bench.path(&format!("results/small/{name}")).exists();
    for extension in ["md", "tex", "csv", "html"] {
        assert!(
            !there(&format!("tables/lengths.{extension}")) && there(&format!("tables/cycles.{extension}"))
        );
    }
    assert!(!there("figures/bars.svg") && there("figures/columns.svg") && there("tables/mine.md"));
    let again = bench.run(&["report", "small.yaml"]);
    assert_eq!((again.code, again.err.as_str()), (0, ""));
}

#[test]
fn where_no_report_noted_what_it_wrote_nothing_is_removed_and_the_rest_is_said() {
    let bench = bench();
    bench.ok(&["run", "small.yaml"]);
    fs::remove_file(bench.path("results/small/manifest.json")).unwrap();
    bench.write("small.yaml", &STUDY.replace("  lengths:", "  cycles:"));
    let told = bench.run(&["report", "small.yaml"]);
    assert!(
        told.err.contains("files that are not of this report") && told.err.contains("tables/lengths.csv"),
        "{}",
        told.err
    );
    assert!(
        !told.err.contains("tables/cycles.csv") && !told.err.contains("figures/bars.svg"),
        "{}",
        told.err
    );
    assert!(bench.path("results/small/tables/lengths.csv").exists());
}
