//! Searches for the settings of programs that are over at once, through the real program.

use crate::program::Bench;

/// A study of one program in two environments, with a search over its only parameter.
fn study(search: &str) -> String {
    format!(
        "study: tuned
environments: {{ w: {{ named: {{ id: W }} }}, v: {{ named: {{ id: V }} }} }}
agents:
  mine:
    program: {{ run: [sh, p.sh, '{{x}}'], parameters: {{ x: 1 }}, sources: [p.sh], lock: none, metrics: {{ ret: ret }} }}
tune:
  best: {{ environment: w, metric: ret, {search} }}
protocol: {{ train_evaluate: {{ steps: 10, evaluate_every: 5 }} }}
seeds: 2
tables: {{ final: {{ comparison: {{ rows: agent, columns: environment, value: ret, decimals: 1 }} }} }}
"
    )
}

fn bench(search: &str, program: &str) -> Bench {
    let bench = Bench::new();
    bench.write("tuned.yaml", &study(search));
    bench.write("p.sh", program);
    bench
}

const RUN: [&str; 6] = ["run", "tuned.yaml", "--yes", "--no-rehearsal", "-j", "2"];

#[test]
fn a_search_goes_on_with_the_study_with_which_it_began() {
    let search = "over: { mine.x: { uniform: { low: 0, high: 1 } } }, settings: 6, \
                  method: { tree_parzen: { startup: 2, batch: 2 } }";
    let bench = bench(search, "");
    // Each trial saves another version of the study.
    let path = bench.path("tuned.yaml");
    let program = format!(
        "sed -i 's/settings: 6/settings: 3/' {}\necho ret=$1\n",
        path.display()
    );
    bench.write("p.sh", &program);
    bench.ok(&RUN);
    let saved = std::fs::read_to_string(path).unwrap();
    assert!(saved.contains("settings: 3"), "{saved}");
    let report = std::fs::read_to_string(bench.path("results/tuned/report.md")).unwrap();
    assert!(report.contains("chosen among 6"), "{report}");
}

#[test]
fn a_program_that_ends_before_a_pause_is_compared_by_its_last_value() {
    let search = "over: { mine.x: { choice: [1, 2, 3, 4] } }, settings: 4, \
                  method: { halving: { pauses: [5], keep: 0.5 } }";
    let bench = bench(search, "echo step=1 ret=9\necho step=4 ret=$1\n");
    let study = study(search).replace(
        "parameters:",
        "resume: [sh, p.sh, '{x}', '{checkpoint}'], parameters:",
    );
    bench.write(
        "tuned.yaml",
        &study.replace("'{x}'], resume", "'{x}', '{checkpoint}'], resume"),
    );
    let said = bench.ok(&RUN);
    assert!(said.contains("4.0 [4.0, 4.0]"), "{said}");
}

#[test]
fn only_one_environment_has_the_setting_that_was_found_in_another() {
    let search = "over: { mine.x: { choice: [1, 2, 3] } }, settings: 3";
    let bench = bench(search, "echo ret=$1\n");
    let only = [&RUN[..], &["--only", "v"]].concat();
    let said = bench.ok(&only);
    assert!(said.contains("3.0 [3.0, 3.0]"), "{said}");
    let said = bench.ok(&["status", "tuned.yaml", "--only", "v"]);
    assert!(
        said.contains("nothing is missing") && said.contains("chosen among 3"),
        "{said}"
    );
}

#[test]
fn a_searched_key_is_set_by_nothing_else() {
    let search =
        "over: { mine.x: { choice: [1, 2, 1.0] }, mine.parameters.x: { choice: [7, 8] } }, settings: 3";
    let bench = bench(search, "echo ret=$1\n");
    let caption = study(search).replace(
        "decimals: 1 }",
        "decimals: 1 }, caption: 'x is {mine.parameters.x}'",
    );
    let overrides = "overrides: [{ environment: v, agent: mine, set: { mine.x: 9 } }]\n";
    bench.write("tuned.yaml", &format!("{caption}{overrides}"));
    let refused = bench.run(&["check", "tuned.yaml"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    for said in [
        "`mine.x` is searched and overridden",
        "`mine.x` has the choice 1.0 twice",
        "`mine.parameters.x` is searched twice",
    ] {
        assert!(refused.err.contains(said), "{said}\n{}", refused.err);
    }
    let search = "over: { mine.x: { choice: [1, 2] } }, settings: 2";
    let caption = study(search).replace(
        "decimals: 1 }",
        "decimals: 1 }, caption: 'x is {mine.parameters.x}'",
    );
    bench.write("tuned.yaml", &caption);
    let refused = bench.run(&["check", "tuned.yaml"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    let said = "`{mine.parameters.x}` varies between trials";
    assert!(refused.err.contains(said), "{}", refused.err);
}

#[test]
fn a_value_that_is_meant_as_a_number_and_is_none_fails_its_trial() {
    let search = "over: { mine.x: { choice: [1, 2] } }, settings: 2, failed: rank_last";
    let bench = bench(
        search,
        "echo step=1 ret=3\n[ $1 = 1 ] && echo step=9 ret=1,5\ntrue\n",
    );
    let run = bench.run(&RUN);
    assert!(run.out.contains("3.0 [3.0, 3.0]"), "{}", run.out);
    assert!(
        run.err.contains("its values are no numbers, as `1,5`"),
        "{}",
        run.err
    );
}
