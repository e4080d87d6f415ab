//! Logs that other programs left: read as pandas and TensorBoard read them, told apart or refused where they hold
//! several runs, and never averaged without a word.

use crate::{
    needs,
    program::{Answer, Bench, repository},
};
use serde_json::Value;
use std::{fs, process::Command};

const STUDY: &str = "
study: small
environments: { env: { pendulum: {} } }
agents: { rule: { zero_action: {} } }
protocol: { train_evaluate: { steps: 200, evaluate_every: 100, episodes: 2, final_episodes: 2, environments: 2 } }
seeds: 2
tables: { final: { comparison: { rows: agent, value: return } } }
";

/// A bench with a study and some files, whose folders are made.
fn bench(files: &[(&str, &str)]) -> Bench {
    let bench = Bench::new();
    for (name, text) in files {
        fs::create_dir_all(bench.path(name).parent().unwrap()).unwrap();
        bench.write(name, text);
    }
    bench.write("study.yaml", STUDY);
    bench
}

fn import(bench: &Bench, words: &[&str]) -> Answer {
    bench.run(&[&["import", "--study", "study.yaml", "--name", "theirs"], words].concat())
}

fn refused(answer: &Answer, parts: &[&str]) {
    assert_eq!(answer.code, 2, "{}", answer.out);
    for part in parts {
        assert!(answer.err.contains(part), "{part}\n{}", answer.err);
    }
}

/// The study with the entry that the command printed, which is read as it stands.
fn pasted(bench: &Bench, entry: &Answer) {
    assert_eq!(entry.code, 0, "{}", entry.err);
    bench.write("study.yaml", &format!("{STUDY}{}", entry.out));
    bench.ok(&["check", "study.yaml"]);
}

/// The report of the study.
fn report(bench: &Bench) -> String {
    bench.ok(&["run", "study.yaml"]);
    let text = fs::read_to_string(bench.path("results/small/report.md")).unwrap();
    text.replace('\\', "")
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}

fn differing(case: &Value, answer: &Answer) -> Option<String> {
    if case["runs"].is_null() {
        return (answer.code != 2).then(|| format!("is read as {}", answer.out));
    }
    if answer.code != 0 {
        return Some(answer.err.clone());
    }
    let read: Value = serde_json::from_str(&answer.out).unwrap();
    let runs: Vec<&Value> = read["runs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|run| &run["curves"]["return"])
        .collect();
    let wanted: Vec<&Value> = case["runs"].as_array().unwrap().iter().collect();
    let numbers = |runs: &[&Value]| -> Vec<Vec<(u64, f64)>> {
        let point = |point: &Value| (point[0].as_u64().unwrap(), point[1].as_f64().unwrap());
        runs.iter()
            .map(|run| run.as_array().unwrap().iter().map(point).collect())
            .collect()
    };
    let (ours, theirs) = (numbers(&runs), numbers(&wanted));
    (ours != theirs).then(|| format!("{ours:?}\nin place of\n{theirs:?}"))
}

#[test]
fn two_hundred_logs_are_read_as_pandas_and_tensorboard_read_them() {
    let Some(python) = needs::python("pandas, pyarrow, tensorboard") else {
        return;
    };
    let bench = bench(&[]);
    fs::create_dir(bench.path("logs")).unwrap();
    let script = repository().join("tests/python/imported_logs.py");
    let made = Command::new(python)
        .arg(script)
        .arg(bench.path("logs"))
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let cases: Value = serde_json::from_slice(&fs::read(bench.path("logs/cases.json")).unwrap()).unwrap();
    let cases = cases.as_array().unwrap();
    assert_eq!(cases.len(), 200);
    let words = |list: &Value, before: &str| -> Vec<String> {
        list.as_array()
            .unwrap()
            .iter()
            .map(|word| format!("{before}{}", word.as_str().unwrap()))
            .collect()
    };
    let mut wrong = Vec::new();
    for case in cases {
        let (files, options) = (words(&case["files"], "logs/"), words(&case["options"], ""));
        let all: Vec<&str> = files.iter().chain(&options).map(String::as_str).collect();
        let answer = import(&bench, &[&["--format", "json"], &all[..]].concat());
        wrong.extend(differing(case, &answer).map(|how| format!("{} {all:?}: {how}", case["kind"])));
    }
    assert!(wrong.is_empty(), "{} logs\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn the_printed_entry_works_where_it_is_pasted() {
    let text = "step,return\n0,1\n100,2\n";
    let bench = bench(&[
        ("logs/a/progress.csv", text),
        ("logs/b/progress.csv", "step,return\n0,3\n100,4\n"),
    ]);
    // Files that are named from the root are seen from the study's folder, too.
    let [one, two] = ["a", "b"].map(|run| {
        bench
            .path(&format!("logs/{run}/progress.csv"))
            .display()
            .to_string()
    });
    let entry = import(&bench, &[&one, &two, "--metric", "return=return"]);
    assert!(
        entry.out.contains("[logs/a/progress.csv, logs/b/progress.csv]")
            && entry.err.contains("2 runs in 2 files"),
        "{}",
        entry.out
    );
    pasted(&bench, &entry);
    let copied = import(&bench, &[&one, &two, "--metric", "return=return", "--copy"]);
    assert!(
        copied.out.contains("[imported/theirs/a/progress.csv, "),
        "{}",
        copied.out
    );
    pasted(&bench, &copied);
}

#[test]
fn a_monitor_is_read_by_the_sum_of_its_lengths() {
    let log = "#{\"t_start\": 1700000000.5, \"env_id\": \"Lander-v3\"}\nr,l,t\n-20,200,0.1\n-10,50,1.0\n-5,100,1.9\n";
    let bench = bench(&[("0.monitor.csv", log)]);
    refused(
        &import(&bench, &["0.monitor.csv"]),
        &["`--metric return=r --step-sum l`; there are r, l, t"],
    );
    let asked = ["0.monitor.csv", "--metric", "return=r"];
    refused(
        &import(&bench, &[&asked[..], &["--step", "l"]].concat()),
        &["line 2", "`--step-sum l`"],
    );
    let entry = import(&bench, &[&asked[..], &["--step-sum", "l"]].concat());
    assert!(entry.err.contains("-5 at step 350"), "{}", entry.err);
    pasted(&bench, &entry);
}

#[test]
fn two_stars_find_files_at_any_depth() {
    let log = |value: u32| format!("step,return\n0,{value}\n100,{value}\n");
    let logs: Vec<(String, String)> = (0..4)
        .map(|seed| (format!("runs/ppo/seed{seed}/progress.csv"), log(seed)))
        .collect();
    let mut files: Vec<(&str, &str)> = logs
        .iter()
        .map(|(name, text)| (name.as_str(), text.as_str()))
        .collect();
    files.push(("runs/old/progress.csv", "step,return\n0,-99\n100,-99\n"));
    let bench = bench(&files);
    let entry = "imported:\n  theirs: { from: \"runs/**/progress.csv\", metrics: { return: return } }\n";
    bench.write("study.yaml", &format!("{STUDY}{entry}"));
    assert!(report(&bench).contains("5 runs of runs/**/progress.csv"));
}

#[test]
fn runs_without_a_value_and_copies_are_told_in_the_report() {
    let (one, two) = ("step,return\n0,1\n100,2\n", "step,return\n0,3\n100,4\n");
    let bench = bench(&[
        ("runs/a.csv", one),
        ("runs/b.csv", two),
        ("runs/b-backup.csv", two),
        ("runs/c.csv", "step,return\n"),
    ]);
    std::os::unix::fs::symlink("a.csv", bench.path("runs/latest.csv")).unwrap();
    let entry = |more: &str| {
        format!(
            "{STUDY}imported:\n  theirs: {{ from: \"runs/*.csv\", metrics: {{ return: return }}{more} }}\n"
        )
    };
    bench.write("study.yaml", &entry(""));
    refused(
        &bench.run(&["check", "study.yaml"]),
        &[
            "runs/c.csv`: `c.csv` has no value of `return`",
            "`leave_out: [empty]`",
        ],
    );
    bench.write("study.yaml", &entry(", leave_out: [empty]"));
    let report = report(&bench);
    for part in [
        "2 runs of runs/*.csv",
        "2 files are copies and not counted again (runs/b.csv of runs/b-backup.csv, runs/latest.csv of runs/a.csv)",
        "1 run without a value is left out (c.csv)",
    ] {
        assert!(report.contains(part), "{part}\n{report}");
    }
}

#[test]
fn a_log_with_a_second_run_is_refused_with_the_line_or_told_apart() {
    let bench = bench(&[(
        "progress.csv",
        "step,return\n1000,-510\n2000,-520\n1000,110\n2000,120\n3000,130\n",
    )]);
    let asked = ["progress.csv", "--metric", "return=return"];
    let parts = [
        "`progress.csv`, line 4: step 1000 comes after step 2000 (line 3)",
        "`restart: new_run`",
    ];
    refused(&import(&bench, &asked), &parts);
    refused(
        &import(&bench, &asked),
        &["on the command line keys are options, as in `--restart new_run`"],
    );
    pasted(
        &bench,
        &import(&bench, &[&asked[..], &["--restart", "new_run"]].concat()),
    );
    let told =
        "2 runs of progress.csv, final values are the last ones, 1 run begins where steps of a log go back";
    assert!(report(&bench).contains(told));
    let resumed = import(&bench, &[&asked[..], &["--restart", "resume"]].concat());
    let told = "note: 2 values are purged, because the run went on from an earlier step";
    assert!(resumed.err.contains(told), "{}", resumed.err);
}

#[test]
fn columns_of_an_export_are_runs_of_one_metric() {
    let text = "Step,ppo__1 - charts/return,ppo__1 - charts/return__MIN,ppo__2 - charts/return\n0,1,1,3\n100,2,2,4\n";
    let bench = bench(&[("wandb.csv", text)]);
    let asked = ["wandb.csv", "--step", "Step", "--metric"];
    let one = import(&bench, &[&asked[..], &["return=charts/return"]].concat());
    refused(&one, &["`*charts/return` takes several columns, a run each"]);
    let list = [
        "return=ppo__1 - charts/return",
        "--metric",
        "return=ppo__2 - charts/return",
    ];
    for metrics in [&["return=*charts/return"][..], &list] {
        let entry = import(&bench, &[&asked[..], metrics].concat());
        assert!(entry.err.contains("2 runs in 1 file"), "{}", entry.err);
        pasted(&bench, &entry);
    }
}

#[test]
fn a_file_that_is_no_table_is_named_by_its_kind() {
    let bench = bench(&[
        ("a.xlsx", "PK\u{3}\u{4}rest"),
        ("twice.csv", "step,return,return\n0,1,100\n"),
    ]);
    fs::write(bench.path("latin.csv"), b"step,return,who\n0,1,M\xfcller\n").unwrap();
    let metric = ["--metric", "return=return"];
    for (file, parts) in [
        (
            "a.xlsx",
            ["it is a ZIP archive, as Excel (.xlsx)", "save the table as CSV"],
        ),
        (
            "twice.csv",
            [
                "line 1, column `return`: two columns have this name",
                "rename one",
            ],
        ),
        ("latin.csv", ["`latin.csv`, line 2: ", "save the file as UTF-8"]),
    ] {
        refused(&import(&bench, &[&[file], &metric[..]].concat()), &parts);
    }
}
