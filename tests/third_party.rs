//! The engine under a program of somebody else: plugins of its own, everything else as in `regimen`.

use crate::program::{Bench, answer, repository};

#[test]
fn plugins_of_another_program_are_computed_to_the_same_bits_in_every_way() {
    crate::ways::hold(
        "third-party",
        &repository().join("examples/third_party/study.yaml"),
    );
}

#[test]
fn a_program_runs_its_study_without_a_command_line() {
    let bench = Bench::new();
    let study = std::fs::read_to_string(repository().join("examples/third_party/study.yaml")).unwrap();
    bench.write("study.yaml", &study);
    let ran = answer(&bench.built("third-party", &[]).output().unwrap());
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    assert_eq!(ran.err, "", "the session is silent");
    assert!(
        ran.out.contains("tuned.return > fixed.return: SUPPORTED"),
        "{}",
        ran.out
    );
    assert!(bench.path("results/thermostat/index.html").is_file());
    bench.write("study.yaml", &study.replace("seeds:", "seed:"));
    let refused = answer(&bench.built("third-party", &[]).output().unwrap());
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(refused.err.contains("unknown key `seed`"), "{}", refused.err);
}

#[test]
fn a_study_of_another_program_is_run_to_its_report() {
    let bench = Bench::new();
    let study = repository().join("examples/third_party/study.yaml");
    let run = bench
        .built("third-party", &["run", &study.to_string_lossy()])
        .output()
        .unwrap();
    let ran = answer(&run);
    assert_eq!(ran.code, 0, "{}\n{}", ran.out, ran.err);
    let report = std::fs::read_to_string(bench.path("results/thermostat/report.md")).unwrap();
    assert!(
        report.contains("tuned.return > fixed.return") && report.contains("SUPPORTED"),
        "{report}"
    );
    // Its own kinds of tables and figures stand beside those of the engine.
    let spread = std::fs::read_to_string(bench.path("results/thermostat/tables/spread.csv")).unwrap();
    assert!(
        spread.contains("lowest") && spread.lines().count() == 5,
        "{spread}"
    );
    assert!(bench.path("results/thermostat/figures/seeds.svg").is_file());
    let listed = answer(
        &bench
            .built("third-party", &["list", "protocols"])
            .output()
            .unwrap(),
    );
    assert!(
        listed.out.contains("episodes") && listed.out.contains("train_evaluate"),
        "{}",
        listed.out
    );
}

#[test]
fn an_executor_of_another_program_writes_its_script_with_its_own_options() {
    let bench = Bench::new();
    let study = repository().join("examples/third_party/study.yaml");
    bench.write("regimen.toml", "[lsf]\nqueue = \"short\"\ntrials_per_task = 3\n");
    let submit = [
        "submit",
        &study.to_string_lossy(),
        "--executor",
        "lsf",
        "--dry-run",
    ];
    let written = answer(&bench.built("third-party", &submit).output().unwrap());
    assert_eq!(written.code, 0, "{}", written.err);
    assert!(
        written.out.contains("#BSUB -J regimen[1-4]%100\n") && written.out.contains("#BSUB -q short\n"),
        "{}",
        written.out
    );
    bench.write("regimen.toml", "[lsf]\nqeue = \"short\"\n");
    let refused = answer(&bench.built("third-party", &submit).output().unwrap());
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(refused.err.contains("unknown field `qeue`"), "{}", refused.err);
    let unknown = answer(
        &bench
            .built("third-party", &["describe", "spread"])
            .output()
            .unwrap(),
    );
    assert!(
        unknown.out.contains("lowest and the highest seed"),
        "{}",
        unknown.out
    );
}
