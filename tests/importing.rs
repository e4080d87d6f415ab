//! Runs of other programs in a study's tables, figures and claims: marked everywhere, computed nowhere.

use crate::program::{Answer, Bench};
use serde_json::Value;
use std::fs;

const STUDY: &str = "
study: small
environments: { cells: { battery: { cells: 2 } } }
agents:
  equal: { equal_split: {} }
  random: { random_allocation: {} }
protocol: { train_evaluate: { steps: 64, environments: 8, evaluate_every: 32, episodes: 1, final_episodes: 2 } }
seeds: 4
imported:
  other: { from: \"runs/*.csv\", step: global_step, metrics: { cycle_length: charts/length }, last: 2, about: Other 1.0 }
tables:
  lengths: { comparison: { value: cycle_length, rows: agent, columns: environment } }
  across: { comparison: { value: cycle_length, rows: environment, labels: { other: another program } } }
  ratio: { comparison: { value: cycle_length, rows: agent, relative_to: equal, as: ratio } }
figures:
  learning: { learning_curve: { metric: cycle_length } }
claims:
  - other.cycle_length > random.cycle_length
  - other.cycle_length within 1 % of 502
";

/// Three runs whose last two values have the means 501, 502 and 503.
fn bench() -> Bench {
    let bench = Bench::new();
    fs::create_dir(bench.path("runs")).unwrap();
    for run in 0..3 {
        let text = format!(
            "global_step,charts/length,loss\n0,10,\n32,{},0.5\n64,{},\n",
            491 + run,
            511 + run
        );
        bench.write(&format!("runs/run-{run}.csv"), &text);
    }
    bench.write("small.yaml", STUDY);
    bench
}

fn read(bench: &Bench, file: &str) -> String {
    fs::read_to_string(bench.path("results/small").join(file)).unwrap()
}

#[test]
fn imported_runs_stand_in_tables_figures_and_claims_and_are_marked_there() {
    let bench = bench();
    bench.ok(&["run", "small.yaml"]);
    assert_eq!(
        bench.digests("store").len(),
        8,
        "no imported run is a trial of the store"
    );
    let by_seed = read(&bench, "tables/lengths-seeds.csv");
    for line in [
        "other,cells,1000000,501",
        "other,cells,1000001,502",
        "other,cells,1000002,503",
    ] {
        assert!(by_seed.contains(line), "{line}\n{by_seed}");
    }
    let told = "other is imported and was not run here: 3 runs of runs/*.csv (Other 1.0), final values are means of the last 2";
    for (file, label) in [
        ("tables/lengths.md", "other (imported)"),
        ("tables/lengths.tex", "other (imported)"),
        ("tables/lengths.html", "other (imported)"),
        ("tables/across.md", "another program (imported)"),
        ("figures/learning.csv", "other (imported)"),
    ] {
        let text = read(&bench, file);
        assert!(text.contains(label), "{file}\n{text}");
    }
    let report = read(&bench, "report.md").replace('\\', "");
    // Under three tables, the figure and both claims.
    assert!(
        report.matches(told).count() >= 6,
        "{}\n{report}",
        report.matches(told).count()
    );
    assert!(!report.contains(".;"), "{report}");
    assert!(report.contains("other: runs/run-0.csv (SHA-256 "), "{report}");
    assert!(read(&bench, "index.html").contains("SHA-256"));
    let verdicts: Value = serde_json::from_str(&read(&bench, "verdicts.json")).unwrap();
    let words: Vec<&str> = verdicts["verdicts"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| it["verdict"].as_str().unwrap())
        .collect();
    assert_eq!(words, ["SUPPORTED", "SUPPORTED"]);
    assert!(
        verdicts["basis"]
            .as_str()
            .unwrap()
            .starts_with("Seeds: 4, fixed before the first trial."),
        "{verdicts}"
    );
    let ratio = read(&bench, "tables/ratio.csv");
    let line = ratio.lines().find(|line| line.starts_with("other,")).unwrap();
    assert!(
        line.contains(",0,3,,"),
        "runs of others are paired with none of ours: {line}"
    );
    assert!(report.contains("compared as unrelated samples"), "{report}");
    assert!(report.contains("| other (imported) | 3 | – |"), "{report}");
}

#[test]
fn a_resolved_study_finds_the_runs_again_and_nothing_else_meets_them() {
    let bench = bench();
    bench.ok(&["run", "small.yaml"]);
    let before = read(&bench, "tables/lengths-seeds.csv");
    bench.ok(&["report", "results/small/resolved.yaml", "-o", "again"]);
    assert_eq!(
        fs::read_to_string(bench.path("again/tables/lengths-seeds.csv")).unwrap(),
        before
    );
    let verified = bench.run(&["verify", "small.yaml"]);
    assert_eq!(verified.code, 0, "{}\n{}", verified.out, verified.err);
    assert!(
        verified
            .err
            .contains("small: 3 runs of `other` are imported and cannot be computed again here"),
        "{}",
        verified.err
    );
    let exported = bench.run(&["export", "small.yaml", "--to", "taken", "--as", "csv"]);
    assert!(
        exported.code == 0 && exported.err.contains("are imported and are not exported"),
        "{}",
        exported.err
    );
    assert!(bench.ok(&["fsck", "store"]).contains("8 trials are whole"));
    assert!(bench.ok(&["plan", "small.yaml"]).contains("small: 8 trials"));
    // Other content is another run, and the same results are compared as such.
    bench.ok(&["report", "small.yaml", "-o", "before"]);
    bench.write(
        "runs/run-2.csv",
        "global_step,charts/length\n0,10\n32,900\n64,900\n",
    );
    bench.ok(&["report", "small.yaml", "-o", "after"]);
    let said = bench.ok(&["report", "after", "--against", "before"]);
    assert!(said.contains("Of ") && said.contains("stayed within"), "{said}");
}

/// Values that this program exports for TensorBoard come back as they were, in single precision.
#[test]
fn event_files_are_read_back() {
    let bench = bench();
    bench.ok(&["run", "small.yaml"]);
    bench.ok(&["export", "small.yaml", "--to", "taken", "--as", "tensorboard"]);
    let from = "from: \"taken/cells/random/*/events*\", metrics: { cycle_length: final/cycle_length }";
    let study = STUDY.replace(
        "from: \"runs/*.csv\", step: global_step, metrics: { cycle_length: charts/length }, last: 2",
        from,
    );
    bench.write("back.yaml", &study.replace("study: small", "study: back"));
    bench.ok(&["report", "back.yaml", "-o", "back"]);
    let text = fs::read_to_string(bench.path("back/tables/lengths-seeds.csv")).unwrap();
    let values = |row: &str| -> Vec<f64> {
        let line = |line: &str| line.strip_prefix(row)?.rsplit(',').next()?.parse().ok();
        text.lines().filter_map(line).collect()
    };
    let (own, back) = (values("random,"), values("other,"));
    assert_eq!(own.len(), 4);
    #[allow(
        clippy::cast_possible_truncation,
        reason = "event files hold single precision"
    )]
    let single: Vec<f64> = own.iter().map(|value| f64::from(*value as f32)).collect();
    assert_eq!(back, single);
}

/// A study without imported runs, in a folder of its own beside those of the runs.
fn with_own_study() -> (Bench, &'static str) {
    let (bench, own) = (bench(), STUDY.split("imported:").next().unwrap());
    fs::create_dir(bench.path("studies")).unwrap();
    bench.write("studies/own.yaml", own);
    (bench, own)
}

fn import(bench: &Bench, more: &[&str]) -> Answer {
    let files = ["runs/run-0.csv", "runs/run-1.csv", "runs/run-2.csv"];
    let words = [
        &["import", "--study", "studies/own.yaml", "--name", "other"],
        &files[..],
        more,
    ];
    bench.run(&words.concat())
}

const MAPPED: [&str; 6] = [
    "--metric",
    "cycle_length=charts/length",
    "--step",
    "global_step",
    "--last",
    "2",
];

/// The study reads the entry that the command printed.
fn is_read(bench: &Bench, own: &str, entry: &Answer) {
    assert_eq!(entry.code, 0, "{}", entry.err);
    bench.write("studies/whole.yaml", &format!("{own}\n{}", entry.out));
    let checked = bench.ok(&["check", "studies/whole.yaml"]);
    assert!(checked.contains("8 trials"), "{}", entry.out);
}

#[test]
fn the_command_prints_an_entry_that_the_study_reads() {
    let (bench, own) = with_own_study();
    let entry = import(&bench, &MAPPED);
    assert!(
        entry.err.contains("other: 3 runs in 3 files") && entry.err.contains("513 at step 64"),
        "{}",
        entry.err
    );
    is_read(&bench, own, &entry);
}

#[test]
fn what_the_command_lacks_it_asks_for() {
    let (bench, _) = with_own_study();
    let refused = |answer: Answer, part: &str| {
        assert!(
            answer.code == 2 && answer.err.contains(part),
            "{part}\n{}",
            answer.err
        );
    };
    refused(
        import(&bench, &[]),
        "--metric return=charts/length`; there are global_step, charts/length, loss",
    );
    let unmapped = import(&bench, &["--metric", "cycle_length=charts/length"]);
    refused(unmapped, "column `step`: there is no such column");
    let nowhere = bench.run(&["import", "--study", "nowhere.yaml", "--name", "other", "x.csv"]);
    refused(nowhere, "there is no study `nowhere.yaml`");
    let words = [
        "import",
        "--study",
        "studies/own.yaml",
        "--name",
        "other",
        "nowhere.csv",
    ];
    refused(bench.run(&words), "cannot read `nowhere.csv`");
    refused(
        bench.run(&[&words[..], &MAPPED].concat()),
        "cannot read `nowhere.csv`",
    );
}

#[test]
fn copied_files_stand_beside_the_study_with_where_they_came_from() {
    let (bench, own) = with_own_study();
    let copied = import(&bench, &[&MAPPED[..], &["--copy"]].concat());
    assert_eq!(copied.code, 0, "{}", copied.err);
    let manifest = fs::read_to_string(bench.path("studies/imported/other/manifest.json")).unwrap();
    let manifest: Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!(manifest["files"].as_array().unwrap().len(), 3);
    assert_eq!(manifest["files"][1]["source"], "runs/run-1.csv");
    assert_eq!(manifest["files"][1]["sha256"].as_str().unwrap().len(), 64);
    fs::remove_dir_all(bench.path("runs")).unwrap();
    is_read(&bench, own, &copied);
}

/// Replacement in the study, and the message about it.
const MISTAKES: [(&str, &str, &[&str]); 10] = [
    (
        "runs/*.csv",
        "none/*.csv",
        &[
            "there is no file `none/*.csv`",
            "wrong.yaml:10:",
            "imported.other.from",
        ],
    ),
    (
        "charts/length",
        "charts/lenght",
        &[
            "runs/run-0.csv`, line 1, column `charts/lenght`",
            "did you mean `charts/length`",
        ],
    ),
    ("last: 2", "last: 0", &["imported.other"]),
    ("last: 2", "lasst: 2", &["lasst"]),
    (
        "last: 2",
        "environment: sells",
        &["no environment is named `sells`"],
    ),
    (
        "  other: {",
        "  equal: {",
        &["`equal` names something else in this study, too"],
    ),
    (
        "seeds: 4",
        "seeds: { min: 3, max: 6, looks: 2 }",
        &["runs of others cannot be"],
    ),
    (
        "seeds: 4",
        "seeds: [1, 1000000]",
        &["seeds from 1000000 on stand for imported runs"],
    ),
    (
        "value: cycle_length, rows: agent, columns",
        "value: reward, agents: [other], rows: agent, columns",
        &["no trial records `reward`"],
    ),
    (
        "  - other.cycle_length >",
        "  - others.cycle_length >",
        &["did you mean `other`"],
    ),
];

#[test]
fn what_is_wrong_with_an_entry_is_said_where_it_stands() {
    let bench = bench();
    for (from, to, parts) in MISTAKES {
        assert!(STUDY.contains(from), "{from}");
        bench.write("wrong.yaml", &STUDY.replace(from, to));
        let answer = bench.run(&["check", "wrong.yaml"]);
        assert_eq!(answer.code, 2, "{from} {to}\n{}", answer.out);
        for part in parts {
            assert!(answer.err.contains(part), "{part}\n{}", answer.err);
        }
    }
}

#[test]
fn a_value_that_is_no_number_is_named_with_its_line() {
    let bench = bench();
    bench.write("runs/run-1.csv", "global_step,charts/length\n0,1\n5,high\n");
    let answer = bench.run(&["check", "small.yaml"]);
    let said = "run-1.csv`, line 3, column `charts/length`: `high` is no number";
    assert!(answer.code == 2 && answer.err.contains(said), "{}", answer.err);
}
