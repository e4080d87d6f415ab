//! Commands that run nothing ask nothing of Python.

use super::*;

#[test]
fn what_runs_nothing_needs_no_python() {
    let Some(place) = Place::new() else { return };
    let study = place.short("own.py:Tank", "", RULE);
    let tables = "tables:\n  returns: { comparison: { rows: agent, value: return } }\n";
    let text = fs::read_to_string(&study).unwrap() + tables;
    fs::write(&study, &text).unwrap();
    place.bench.ok(&["run", "study.yaml", "-j", "1"]);
    // As in a shell whose path leads to no such Python.
    fs::write(&study, text.replace(place.interpreter, "no-such-python")).unwrap();
    place.bench.ok(&["status", "study.yaml"]);
    place.bench.ok(&["plan", "study.yaml"]);
    place.bench.ok(&["report", "study.yaml"]);
    place
        .bench
        .ok(&["export", "study.yaml", "--as", "csv", "-o", "taken"]);
    let again = place.bench.run(&["run", "study.yaml", "-j", "1"]);
    assert_eq!(again.code, 0, "nothing is missing: {}", again.err);
    let found = place.bench.run(&["fsck"]);
    assert_eq!(found.code, 0, "{}{}", found.out, found.err);
    // Commands that run trials need it, and say so before any trial begins.
    let more = place.bench.run(&["run", "study.yaml", "-j", "1", "--seeds", "2"]);
    assert_eq!(more.code, 2, "{}", more.err);
    assert!(
        more.err.contains("`no-such-python` cannot be started"),
        "{}",
        more.err
    );
    let status: Value = serde_json::from_str(
        &place
            .bench
            .run(&["status", "study.yaml", "--seeds", "2", "--format", "json"])
            .out,
    )
    .unwrap();
    assert_eq!(
        (&status["cells"][0]["failed"], &status["cells"][0]["missing"]),
        (&json!(0), &json!(1)),
        "{status}"
    );
    let check = place.bench.run(&["check", "study.yaml"]);
    assert_eq!(check.code, 3, "`check` believes no record: {}", check.err);
    // Another environment has no record.
    fs::write(
        place.bench.path("level.py"),
        fs::read_to_string(place.bench.path("level.py")).unwrap() + "# new\n",
    )
    .unwrap();
    assert_eq!(place.bench.run(&["status", "study.yaml"]).code, 2);
}
