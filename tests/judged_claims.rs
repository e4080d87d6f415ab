//! Claims through the real program: the settings in which they are judged, and the verdict that counts.

use crate::program::Bench;

const STUDY: &str = "
study: judged
environments: { plant: { battery: {} } }
agents: { water: { water_filling: {} }, rule: { equal_split: {} } }
protocol: { train_evaluate: { steps: 0, final_episodes: 2 } }
seeds: 3
sweep: { water.r_ohm: { grid: [0.1, 0.2] }, plant.cells: { grid: [4, 8] } }
claims:
  - water.return > rule.return
  - water[r_ohm=0.2].return > water[r_ohm=0.1].return
";

#[test]
fn sides_with_other_swept_keys_meet_where_their_common_keys_are_equal() {
    let bench = Bench::new();
    bench.write("judged.yaml", STUDY);
    let said = bench.ok(&["run", "judged.yaml", "-j", "2"]);
    assert!(!said.contains("NOT RUN"), "{said}");
    for setting in [
        "r_ohm=0.1 cells=4",
        "r_ohm=0.1 cells=8",
        "r_ohm=0.2 cells=4",
        "r_ohm=0.2 cells=8",
    ] {
        let claim = format!("water.return > rule.return in plant, {setting}");
        assert!(said.contains(&claim), "{claim}\n{said}");
    }
    for cells in [4, 8] {
        let claim = format!("water[r_ohm=0.2].return > water[r_ohm=0.1].return in plant, cells={cells}");
        assert!(said.contains(&claim), "{claim}\n{said}");
    }
    // The word of a line is that of all claims together.
    let alone =
        "INCONCLUSIVE        water.return > rule.return in plant, r_ohm=0.1 cells=4 (alone: SUPPORTED)";
    assert!(said.contains(alone), "{said}");
    let open = bench.ok(&["overview", "results", "--open"]);
    assert!(
        open.contains("0 of 6 values and claims that are judged are decided"),
        "{open}"
    );
}

#[test]
fn a_side_without_trials_is_named() {
    let bench = Bench::new();
    let study = STUDY
        .replace(
            "plant: { battery: {} }",
            "plant: { battery: {} }, other: { battery: {} }",
        )
        .replace(
            "claims:\n",
            "exclude: [{ environment: other, agent: rule }]\nclaims:\n",
        );
    bench.write("judged.yaml", &study);
    let said = bench.ok(&["run", "judged.yaml", "-j", "2", "--verbose"]);
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    let claim = "NOT RUN water.return > rule.return in other, r_ohm=0.1; no trial of `rule` is planned here";
    assert!(said.contains(claim), "{said}");
}

#[test]
fn a_claim_says_how_many_of_its_trials_failed() {
    let bench = Bench::new();
    bench.write("p.sh", "[ $1 = 2 ] && exit 3\necho ret=$1.5\n");
    let study = "
study: failed
environments: { w: { named: { id: W } } }
agents:
  mine: { program: { run: [sh, p.sh, '{seed}'], parameters: {}, sources: [p.sh], lock: none, metrics: { ret: ret } } }
protocol: { train_evaluate: { steps: 1, evaluate_every: 1 } }
seeds: 4
claims: [mine.ret > -1]
";
    bench.write("failed.yaml", study);
    let run = bench.run(&[
        "run",
        "failed.yaml",
        "--yes",
        "--no-rehearsal",
        "-j",
        "2",
        "--verbose",
    ]);
    let said = run.out.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        said.contains("n = 3 seeds; 1 of 4 trials of `mine` failed"),
        "{said}\n{}",
        run.err
    );
}

#[test]
fn a_claim_that_is_given_twice_is_refused() {
    let bench = Bench::new();
    let twice =
        "  - { claim: water.return > rule.return, min_effect: 2, why: a reader sees no smaller one }\n";
    bench.write("judged.yaml", &format!("{STUDY}{twice}"));
    let refused = bench.run(&["check", "judged.yaml"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    assert!(
        refused.err.contains("this claim is given twice"),
        "{}",
        refused.err
    );
}
