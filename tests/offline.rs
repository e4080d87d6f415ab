//! Studies that gather datasets and learn from them: what the check refuses, and that the same bits come out
//! however they run.

use crate::program::Bench;

/// A study with this environment, this entry of `prepare`, these agents and this protocol.
fn study(environment: &str, by_rule: &str, agents: &str, protocol: &str) -> String {
    format!(
        "study: offline\nenvironments: {{ here: {environment} }}\nprepare: {{ by_rule: {by_rule} }}\n\
         agents: {{ {agents} }}\nprotocol: {protocol}\nseeds: 2\n"
    )
}

const CELLS: &str = "{ battery: { cells: 2 } }";
const BY_RULE: &str =
    "{ environment: here, agent: { equal_split: {} }, protocol: { gather: { episodes: 2 } } }";
const CLONE: &str = "learner: { behaviour_cloning: { width: 8 } }";
const FIT: &str = "{ offline_fit: { datasets: [{ from: by_rule }], steps: 8, batch: 4, evaluate_every: 4, \
                   episodes: 1, \
                   final_episodes: 2, trace_episodes: 0 } }";

fn refusal(study: &str) -> String {
    let bench = Bench::new();
    bench.write("offline.yaml", study);
    let refused = bench.run(&["check", "offline.yaml"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
    refused.err
}

#[test]
fn what_cannot_be_learned_from_is_refused_by_the_check() {
    let elsewhere = BY_RULE.replace("here", "{ battery: { cells: 3 } }");
    let gathering = |agent: &str| BY_RULE.replace("equal_split", agent);
    let cases: [(String, &[&str]); 5] = [
        (
            study(CELLS, BY_RULE, CLONE, "{ train_evaluate: { steps: 64 } }"),
            &[
                "`learner` learns from datasets; `train_evaluate` gives none",
                "`offline_fit`",
                "`gather`",
            ],
        ),
        (
            study(
                "{ allocation_bandit: {} }",
                &gathering("random_allocation"),
                "learner: { dirichlet_gradient: {} }",
                FIT,
            ),
            &[
                "`learner` learns from its own decisions; `offline_fit` gives those of others",
                "`td3_bc`",
                "`dirichlet_sac`",
            ],
        ),
        (
            study(CELLS, &elsewhere, CLONE, FIT),
            &["`datasets.0`: `by_rule` cannot be learned from here", "there and"],
        ),
        (
            study(CELLS, BY_RULE, CLONE, "{ offline_fit: {} }"),
            &["`datasets`: there is none to learn from", "`gather`"],
        ),
        (
            study(CELLS, BY_RULE, CLONE, &FIT.replace("by_rule", "by_nobody")),
            &["by_nobody"],
        ),
    ];
    for (study, parts) in cases {
        let message = refusal(&study);
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in\n{message}");
        }
    }
}

#[test]
fn what_is_learned_does_not_depend_on_how_the_trials_ran() {
    let agents = format!("{CLONE}, td3: {{ td3_bc: {{ width: 8 }} }}, rule: {{ equal_split: {{}} }}");
    let bench = Bench::new();
    bench.write("offline.yaml", &study(CELLS, BY_RULE, &agents, FIT));
    bench.ok(&["run", "offline.yaml", "-j", "1", "--store", "one"]);
    bench.ok(&["run", "offline.yaml", "-j", "3", "--store", "three"]);
    let digests = bench.digests("one");
    assert_eq!((digests.len(), &digests), (2 * 4, &bench.digests("three")));
    let again = bench.run(&["run", "offline.yaml", "--store", "one"]);
    assert!(again.err.contains("nothing runs"), "{}", again.err);
}
