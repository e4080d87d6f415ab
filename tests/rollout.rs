//! The battery simulator through `regimen rollout`, against trajectories of another program.

use crate::program::{Bench, repository};
use std::{collections::BTreeMap, path::PathBuf};

fn fixture(name: &str) -> PathBuf {
    repository().join("tests/fixtures/battery").join(name)
}

/// Columns of a CSV file by name; empty cells are NaN.
fn columns(path: &std::path::Path) -> BTreeMap<String, Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut columns: BTreeMap<String, Vec<f64>> = names.iter().map(|name| ((*name).to_owned(), Vec::new())).collect();
    for line in lines {
        for (name, cell) in names.iter().zip(line.split(',')) {
            columns.get_mut(*name).unwrap().push(cell.parse().unwrap_or(f64::NAN));
        }
    }
    columns
}

const STATES: [&str; 8] = ["tb", "Vo", "Vsn", "Vsp", "qnB", "qnS", "qpB", "qpS"];

#[test]
fn one_cell_at_constant_power_follows_the_other_program() {
    let bench = Bench::new();
    bench.write(
        "cell.yaml",
        "cells: 1\nthermal: true\ndecision_interval_s: 10\nload: { constant: { power_w: 8 } }\nstart: full\n",
    );
    let actions = format!("weight_1\n{}", "1\n".repeat(300));
    bench.write("actions.csv", &actions);
    bench.ok(&["rollout", "battery", "--config", "cell.yaml", "--actions", "actions.csv", "--out", "out.csv"]);
    let (ours, theirs) = (columns(&bench.path("out.csv")), columns(&fixture("const_power_8W.csv")));
    let mut compared = 0;
    for (row, time) in theirs["t_s"].iter().enumerate() {
        let Some(mine) = ours["t_s"].iter().position(|t| (t - time).abs() < 1e-9) else { continue };
        assert!((ours["voltage_1"][mine] - theirs["v_V"][row]).abs() < 1e-6, "voltage at {time} s");
        for state in STATES {
            let (one, other) = (ours[&format!("{state}_1")][mine], theirs[state][row]);
            assert!((one - other).abs() <= 1e-9 * other.abs().max(1e-6), "{state} at {time} s: {one} against {other}");
        }
        compared += 1;
    }
    assert!(compared >= 8, "only {compared} rows could be compared");
}

#[test]
fn wrong_action_files_are_refused_with_the_place() {
    let bench = Bench::new();
    bench.write("few.csv", "weight_1,weight_2\n0.5,0.5\n");
    let answer = bench.run(&["rollout", "battery", "--actions", "few.csv", "--out", "out.csv"]);
    assert_eq!(answer.code, 2);
    assert!(answer.err.contains("`weight_3` is missing"), "{}", answer.err);
    bench.write("odd.csv", "weight_1,weight_2,weight_3,weight_4\n0.25,0.25,0.25,x\n");
    let answer = bench.run(&["rollout", "battery", "--actions", "odd.csv", "--out", "out.csv"]);
    assert!(answer.err.contains("line 2") && answer.err.contains("`x`"), "{}", answer.err);
    bench.write("sum.csv", "weight_1,weight_2,weight_3,weight_4\n0.25,0.25,0.25,0.5\n");
    let answer = bench.run(&["rollout", "battery", "--actions", "sum.csv", "--out", "out.csv"]);
    assert_ne!(answer.code, 0);
}

#[test]
fn an_agent_can_decide_and_the_seed_decides_the_rest() {
    let bench = Bench::new();
    for out in ["a.csv", "b.csv"] {
        bench.ok(&["rollout", "battery", "--agent", "equal_split", "--seed", "7", "--out", out]);
    }
    bench.ok(&["rollout", "battery", "--agent", "equal_split", "--seed", "8", "--out", "c.csv"]);
    let read = |name: &str| std::fs::read_to_string(bench.path(name)).unwrap();
    assert_eq!(read("a.csv"), read("b.csv"));
    assert_ne!(read("a.csv"), read("c.csv"));
    assert!(read("a.csv").lines().last().unwrap().ends_with("terminated"));
}
