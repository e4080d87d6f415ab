//! Tests of the metrics of a program.

use super::*;
use crate::config::tests::config;
use serde_json::{Value, json};

struct WrittenFiles {
    folder: tempfile::TempDir,
    metrics: Metrics,
}

impl WrittenFiles {
    fn new(reads: Value, metrics: Value, goes_on: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let config = config(json!({ "reads": reads, "metrics": metrics }));
        let metrics = Metrics::of(&config, folder.path(), folder.path(), goes_on);
        Self { folder, metrics }
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn last(&mut self) -> Result<Vec<Vec<(u64, f64)>>, String> {
        let seen = [("lr", None), ("z", Some("\u{1b}[32m1,000\u{1b}[0m"))];
        let seen = seen.map(|(name, value)| SeenKey {
            name: name.to_owned(),
            no_number: value.map(str::to_owned),
        });
        let curves = self.metrics.last(&seen).map_err(|error| error.to_string())?;
        Ok(curves.iter().map(|it| it.values.clone()).collect())
    }
}

#[test]
fn values_are_read_from_every_source_while_they_grow() {
    let metrics = json!({ "a": "x", "b": { "key": "r", "from": "runs/*/log.csv", "step": { "sum": "l" } } });
    let mut written = WrittenFiles::new(json!({}), metrics, false);
    assert!(written.metrics.now().iter().all(|curve| curve.values.is_empty()));
    written.write("stdout.jsonl", "{\"step\": 1, \"x\": \"0.5\"}\n");
    assert_eq!(written.metrics.now()[0].values, [(1, 0.5)]);
    written.write("runs/1/log.csv", "r,l\n1,10\n3,10\n");
    assert_eq!(written.metrics.now()[1].values, [(10, 1.0), (20, 3.0)]);
    written.write("runs/1/log.csv", "r,l\n1,10\n3,10\n3,5\n");
    assert_eq!(
        written.last(),
        Ok(vec![vec![(1, 0.5)], vec![(10, 1.0), (20, 3.0), (25, 3.0)]])
    );
}

#[test]
fn a_number_that_is_none_stays_one_to_be_judged() {
    let mut written = WrittenFiles::new(json!({}), json!({ "a": "x" }), false);
    written.write(
        "stdout.jsonl",
        "{\"step\": \"1\", \"x\": \"NaN\"}\n{\"step\": \"2\", \"x\": \"inf\"}\n",
    );
    let values = written.last().unwrap().remove(0);
    assert!(values[0].1.is_nan() && values[1] == (2, f64::INFINITY));
}

#[test]
fn one_metric_does_not_wait_for_another() {
    let mut written = WrittenFiles::new(json!({ "from": "log.csv" }), json!({ "a": "x", "b": "y" }), false);
    written.write("log.csv", "step,y\n1,2\n");
    let _ = written.metrics.now();
    let told = written.last().unwrap_err();
    assert!(told.contains("`x`"), "{told}");
}

#[test]
fn a_metric_without_values_at_the_end_is_named_with_the_keys_found() {
    let mut written = WrittenFiles::new(json!({}), json!({ "a": "x" }), false);
    let told = written.last().unwrap_err();
    assert!(
        told.contains("no value of it, which is to be `a`; keys that were there: `lr`, `z`"),
        "{told}"
    );
    let mut written = WrittenFiles::new(json!({ "from": "*.csv" }), json!({ "a": "x" }), false);
    assert!(written.last().unwrap_err().contains("wrote no such file"));
    written.write("b.csv", "step,y\n1,2\n");
    let told = written.last().unwrap_err();
    assert!(told.contains("b.csv") && told.contains("`x`"), "{told}");
}

#[test]
fn values_that_are_no_numbers_are_quoted_with_the_name_of_their_source() {
    let refused = |name: &str, from: &str, text: &str| {
        let mut written = WrittenFiles::new(json!({ "from": from }), json!({ "a": "z" }), false);
        written.write(name, text);
        written.last().unwrap_err()
    };
    for (line, told) in [
        (
            "",
            "`stdout`, column `z`: no value of it, which is to be `a`; its values are no numbers, as `[32m1,000[0m`, \
             which has codes for colours",
        ),
        (
            r#"{"step": "100/1000", "z": "1"}"#,
            "`stdout`, column `step`: `100/1000` is no number; its line has `step=100/1000 z=1`",
        ),
        (
            r#"{"step": "-100", "z": "1"}"#,
            "`-100` is no whole number from 0 to 9e15",
        ),
    ] {
        let refusal = refused("stdout.jsonl", "stdout", &format!("{line}\n"));
        assert!(refusal.contains(told), "{refusal}");
    }
    for (text, told) in [
        ("step,z\n", "and no row"),
        ("step,z\n1,\n", "the cells of this column are empty"),
        (
            "step,z\n1,high\n",
            "`runs/log.csv`, line 2, column `z`: `high` is no number",
        ),
    ] {
        let refusal = refused("runs/log.csv", "runs/*.csv", text);
        assert!(refusal.contains(told), "{refusal}");
    }
}

#[test]
fn lines_without_a_step_beside_others_are_named_as_the_cause() {
    let mut written = WrittenFiles::new(json!({}), json!({ "a": "x" }), false);
    let lines = [
        "{\"regimen_at\":1,\"step\":\"100\",\"x\":\"1\"}",
        "{\"regimen_at\":2,\"step\":2,\"x\":\"5\"}",
    ];
    written.write("stdout.jsonl", &format!("{}\n", lines.join("\n")));
    let told = written.last().unwrap_err();
    assert!(
        told.ends_with("its line has `x=5`; 1 of its lines with metrics have no `step` and are numbered: print it in each"),
        "{told}"
    );
}

#[test]
fn a_file_outside_the_working_folder_is_refused_with_the_name_of_that_folder() {
    let mut written = WrittenFiles::new(json!({ "from": "log.csv" }), json!({ "a": "x" }), false);
    let outside = tempfile::tempdir().unwrap();
    fs::write(outside.path().join("log.csv"), "step,x\n1,2\n").unwrap();
    std::os::unix::fs::symlink(
        outside.path().join("log.csv"),
        written.folder.path().join("log.csv"),
    )
    .unwrap();
    let told = written.last().unwrap_err();
    assert!(
        told.contains("`log.csv` leads out of the working folder of the trial"),
        "{told}"
    );
}

#[test]
fn keys_that_no_line_with_metrics_has_are_told_without_keys_of_the_engine() {
    let mut written = WrittenFiles::new(json!({}), json!({ "a": "x", "b": "y" }), false);
    written.write("stdout.jsonl", "{\"regimen_at\": 1, \"step\": 1, \"y\": \"2\"}\n");
    let told = written.last().unwrap_err();
    assert!(
        told.contains("column `x`: no value of it") && told.contains("`lr`, `z`"),
        "{told}"
    );
    let mut written = WrittenFiles::new(json!({ "step": "t" }), json!({ "a": "x" }), false);
    written.write("stdout.jsonl", "{\"regimen_at\": 1, \"x\": \"2\"}\n");
    let told = written.last().unwrap_err();
    assert_eq!(
        told,
        "`stdout`, column `t`: no line with metrics has this key; of those of the study they have `x`"
    );
}

#[test]
fn steps_go_back_where_a_program_went_on_and_nowhere_else() {
    let log = "{\"step\":\"10\",\"x\":\"1\"}\n{\"step\":\"20\",\"x\":\"2\"}\n{\"step\":\"20\",\"x\":\"3\"}\n\
               {\"step\":\"15\",\"x\":\"4\"}\n";
    let read = |goes_on| {
        let mut written = WrittenFiles::new(json!({}), json!({ "a": "x" }), goes_on);
        written.write("stdout.jsonl", log);
        written.last()
    };
    assert_eq!(read(true), Ok(vec![vec![(10, 1.0), (15, 4.0)]]));
    let told = read(false).unwrap_err();
    assert!(
        told.contains("`stdout`: step 15 comes after step 20: ")
            && told.ends_with("; its line has `step=15 x=4`"),
        "{told}"
    );
}

/// A program that is killed after a row that its checkpoint does not cover writes the row again.
#[test]
fn rows_of_a_table_that_stand_twice_behind_each_other_count_once() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(json!({ "reads": { "from": "log.csv" }, "metrics": { "a": "x" } }));
    let metrics = || Metrics::of(&config, folder.path(), folder.path(), true);
    fs::write(folder.path().join("log.csv"), "step,x\n1,1\n2,10\n").unwrap();
    metrics().mark_continuation().unwrap();
    fs::write(
        folder.path().join("log.csv"),
        "step,x\n1,1\n2,10\n2,20\n3,30\n3,50\n",
    )
    .unwrap();
    let curves = metrics().last(&[]).unwrap()[0].values.clone();
    assert_eq!(curves, [(1, 1.0), (2, 20.0), (3, 30.0), (3, 50.0)]);
}

#[test]
fn several_runs_are_no_trial() {
    let mut written = WrittenFiles::new(json!({ "from": "*/log.csv" }), json!({ "a": "x" }), false);
    written.write("one/log.csv", "step,x\n1,2\n");
    written.write("two/log.csv", "step,x\n1,2\n");
    let told = written.last().unwrap_err();
    assert!(told.contains("these files hold 2: `one`, `two`"), "{told}");
}
