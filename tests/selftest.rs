//! The program's own test of exactness, which people run on their machines.

use crate::program::Bench;

#[test]
fn every_way_to_compute_the_embedded_study_gives_the_same_digests() {
    let bench = Bench::new();
    let told: serde_json::Value = serde_json::from_str(&bench.ok(&["selftest", "--format", "json"])).unwrap();
    let ways = told["ways"].as_array().unwrap();
    assert_eq!(ways.len(), 5, "{told}");
    for way in ways {
        assert!(way["equal"] == true && way["executed_once"] == true, "{way}");
        assert_eq!(way["stored"], told["trials"], "{way}");
    }
}

#[test]
fn a_study_that_is_not_there_or_has_no_such_profile_is_said() {
    let bench = Bench::new();
    assert_eq!(bench.run(&["selftest", "nothing.yaml"]).code, 106);
    let answer = bench.run(&["selftest", "--profile", "tiny"]);
    assert_eq!(answer.code, 2);
    assert!(answer.err.contains("no profile `tiny`"), "{}", answer.err);
}
