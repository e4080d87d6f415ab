//! Simulators through `regimen rollout`, against trajectories of other programs.

use crate::program::{Bench, repository};
use std::{collections::BTreeMap, path::PathBuf};

fn fixture(name: &str) -> PathBuf {
    repository().join("tests/fixtures").join(name)
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
    let (ours, theirs) = (columns(&bench.path("out.csv")), columns(&fixture("battery/const_power_8W.csv")));
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

/// Predators and prey of the thesis' authors, with every column that a person would look for.
#[test]
fn several_seats_follow_the_other_program() {
    let bench = Bench::new();
    let theirs = columns(&fixture("particles/thesis_tag.csv"));
    let pairs = |letter: &str, count: usize| {
        let pair =
            |index: usize| format!("[{}, {}]", theirs[&format!("{letter}{index}x")][0], theirs[&format!("{letter}{index}y")][0]);
        (0..count).map(pair).collect::<Vec<_>>().join(", ")
    };
    let start = format!("start: {{ agents: [{}], landmarks: [{}] }}", pairs("p", 4), pairs("l", 2));
    bench.write("tag.yaml", &format!("scenario: predator_prey\n{start}\n"));
    let header: Vec<String> = (0..4).flat_map(|agent| ["x", "y"].map(|axis| format!("agent_{agent}.force_{axis}"))).collect();
    let mut actions = header.join(",") + "\n";
    for row in 1..26 {
        let cells = (0..4).flat_map(|agent| ["x", "y"].map(|axis| theirs[&format!("u{agent}{axis}")][row].to_string()));
        actions += &(cells.collect::<Vec<_>>().join(",") + "\n");
    }
    bench.write("actions.csv", &actions);
    bench.ok(&["rollout", "particles", "--config", "tag.yaml", "--actions", "actions.csv", "--out", "out.csv"]);
    let ours = columns(&bench.path("out.csv"));
    let agree = |one: &str, other: &str, first: usize| {
        assert_eq!(ours[one].len(), 26, "{one}");
        assert!((first..26).all(|row| (ours[one][row] - theirs[other][row]).abs() < 1e-9), "{one}");
    };
    agree("t", "t", 0);
    for agent in 0..4 {
        agree(&format!("agent_{agent}.reward"), &format!("r{agent}"), 1);
        assert!(ours[&format!("agent_{agent}.reward")][0].is_nan());
        for (axis, entry) in [("x", 2), ("y", 3)] {
            agree(&format!("agent_{agent}.position_{axis}"), &format!("p{agent}{axis}"), 0);
            agree(&format!("agent_{agent}.velocity_{axis}"), &format!("v{agent}{axis}"), 0);
            agree(&format!("agent_{agent}.force_{axis}"), &format!("u{agent}{axis}"), 1);
            agree(&format!("agent_{agent}.obs_{entry}"), &format!("p{agent}{axis}"), 0);
        }
    }
    agree("landmark_1.position_y", "l1y", 0);
    assert!(ours.contains_key("agent_2.obs_15") && !ours.contains_key("agent_3.obs_14"));
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
