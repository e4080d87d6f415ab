//! Programs that cannot see each other's processes share a store all the same.

use crate::{
    needs,
    program::{Bench, answer},
    slurm::until,
};
use std::process::{Command, Stdio};

/// Trials of a second or so, which a rule's many episodes take.
const STUDY: &str = "
study: small
environments: { cells: { battery: { cells: 4 } } }
agents:
  equal: { equal_split: {} }
  rule: { rank_rule: { weights: [0.15, 0.25, 0.25, 0.35] } }
protocol: { train_evaluate: { steps: 0, final_episodes: 2000, trace_episodes: 0 } }
seeds: 2
";

/// Command that starts a program in a process namespace of its own.
const UNSHARE: [&str; 3] = ["--pid", "--fork", "--mount-proc"];

#[test]
fn a_run_in_another_process_namespace_of_one_host_leaves_the_first_alone() {
    let mut tried = Command::new("unshare");
    tried.args(UNSHARE).arg("true");
    if needs::right("make a process namespace", &mut tried).is_none() {
        return;
    }
    let bench = Bench::new();
    bench.write("small.yaml", STUDY);
    bench.ok(&["run", "small.yaml", "--store", "alone"]);
    let arguments = ["run", "small.yaml", "-j", "1"];
    let first = bench
        .command(&arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    until("the first run has announced itself", || {
        std::fs::read_dir(bench.path("store/owners")).is_ok_and(|entries| entries.count() == 1)
    });
    let inside = bench.command(&arguments);
    let mut second = Command::new("unshare");
    second
        .args(UNSHARE)
        .arg(inside.get_program())
        .args(inside.get_args())
        .current_dir(bench.path(""));
    let second = answer(&second.env_remove("REGIMEN_STORE").output().unwrap());
    let first = answer(&first.wait_with_output().unwrap());
    assert_eq!((first.code, second.code), (0, 0), "{}\n{}", first.err, second.err);
    assert_eq!(bench.digests("store"), bench.digests("alone"));
    let ran = |text: &str| {
        text.lines()
            .filter(|line| line.starts_with('[') && !line.contains("by another program"))
            .count()
    };
    assert_eq!(
        ran(&first.err) + ran(&second.err),
        4,
        "each trial ran once:\n{}\n{}",
        first.err,
        second.err
    );
}
