//! `new` writes a study that passes `check` and runs.

use crate::program::Bench;

/// Writes, checks and tries out a study; gives back its report.
fn tried_out(arguments: &[&str]) -> String {
    let bench = Bench::new();
    bench.ok(&[&["new", "first"], arguments].concat());
    for profile in ["smoke", "paper"] {
        bench.ok(&["check", "first.yaml", "-P", profile]);
    }
    let checked = bench.run(&["check", "first.yaml"]);
    assert_eq!(checked.code, 0, "{}", checked.err);
    assert!(!checked.err.contains("warning"), "{}", checked.err);
    bench.ok(&["run", "first.yaml", "-P", "smoke", "-j", "2"]);
    std::fs::read_to_string(bench.path("results/first-smoke/report.md")).unwrap()
}

#[test]
fn the_default_is_checked_and_runs_to_a_table_a_claim_and_a_curve() {
    let report = tried_out(&[]);
    for part in [
        "learner.return > rule.return",
        "Return of the final measurement",
        "learning-curve",
    ] {
        assert!(report.contains(part), "{part}:\n{report}");
    }
    assert!(!report.contains("NOT TRAINED"), "{report}");
}

#[test]
fn another_pair_is_checked_and_runs() {
    let report = tried_out(&["--environment", "pendulum", "--agent", "soft_actor_critic"]);
    assert!(
        report.contains("soft\\_actor\\_critic") && !report.contains("NOT TRAINED"),
        "{report}"
    );
}

#[test]
fn designs_are_searched_for() {
    let bench = Bench::new();
    bench.ok(&["new", "designs", "-e", "tabular_search"]);
    let text = std::fs::read_to_string(bench.path("designs.yaml")).unwrap();
    assert!(text.contains("  search:\n"), "{text}");
    bench.ok(&["check", "designs.yaml"]);
}

#[test]
fn a_file_that_is_there_stays_as_it_is() {
    let bench = Bench::new();
    bench.write("mine.yaml", "mine");
    let refused = bench.run(&["new", "mine"]);
    assert_eq!(refused.code, 2);
    assert!(
        refused.err.contains("`mine.yaml` is there already"),
        "{}",
        refused.err
    );
    assert_eq!(std::fs::read_to_string(bench.path("mine.yaml")).unwrap(), "mine");
}

#[test]
fn what_does_not_fit_is_refused_with_what_does() {
    let bench = Bench::new();
    let refused = |arguments: &[&str]| {
        let answer = bench.run(&[&["new", "first"], arguments].concat());
        assert_eq!(answer.code, 2, "{arguments:?}: {}{}", answer.out, answer.err);
        assert!(!bench.path("first.yaml").exists());
        answer.err
    };
    let error = refused(&["-e", "batery"]);
    assert!(
        error.contains("there is no environment `batery`; did you mean `battery`?"),
        "{error}"
    );
    let error = refused(&["-e", "gymnasium:CartPole-v1"]);
    assert!(
        error.contains("python: { make: \"gymnasium:CartPole-v1\", lock:"),
        "{error}"
    );
    let error = refused(&["-e", "pendulum", "-a", "dirichlet_sac"]);
    for part in [
        "does not fit the environment `pendulum`",
        "`soft_actor_critic`",
        "`battery`",
    ] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let error = refused(&["-e", "battery", "-a", "equal_split"]);
    assert!(
        error.contains("does not learn") && error.contains("`dirichlet_sac`"),
        "{error}"
    );
    let error = refused(&["-e", "battery", "-a", "behaviour_cloning"]);
    assert!(
        error.contains("learns neither from its own decisions") && error.contains("`ddpg`"),
        "{error}"
    );
    let answer = bench.run(&["new", "A study"]);
    assert!(
        answer.code == 2 && answer.err.contains("cannot name a study"),
        "{}",
        answer.err
    );
}
