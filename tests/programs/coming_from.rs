//! Pages for those who come from other tools, and the studies of `experiments/programs`: their programs run as they
//! are written.

use super::*;
use crate::{
    needs,
    program::{answer, repository},
};

/// A folder in which `python` is one that has what was asked for.
struct Place {
    bench: Bench,
}

impl Place {
    fn new(python: &str) -> Self {
        use std::os::unix::fs::PermissionsExt as _;
        let bench = Bench::new();
        fs::create_dir(bench.path("bin")).unwrap();
        let path = bench.write("bin/python", &format!("#!/bin/sh\nexec {python} \"$@\"\n"));
        fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
        Self { bench }
    }

    /// Runs a command that has to succeed.
    fn ok(&self, arguments: &[&str]) {
        let before = std::env::var_os("PATH").unwrap_or_default();
        let folders = [self.bench.path("bin")]
            .into_iter()
            .chain(std::env::split_paths(&before));
        let path = std::env::join_paths(folders).unwrap();
        let answer = answer(&self.bench.command(arguments).env("PATH", path).output().unwrap());
        assert_eq!(answer.code, 0, "{arguments:?}: {}", answer.err);
    }

    /// The program and the study of a page, with the blocks of other files in YAML.
    fn of_page(python: &str, page: &str) -> (Self, Vec<String>) {
        let place = Self::new(python);
        let text = fs::read_to_string(repository().join("docs/src").join(page)).unwrap();
        place.bench.write("train.py", &blocks(&text, "python")[0]);
        let (studies, others) = blocks(&text, "yaml")
            .into_iter()
            .partition(|it| it.contains("\nprotocol:"));
        let studies: Vec<String> = studies;
        place.bench.write("rates.yaml", &studies[0]);
        (place, others)
    }

    fn runs(&self, study: &str) {
        self.ok(&["check", study]);
        self.ok(&["run", study, "-P", "smoke", "--yes"]);
    }
}

#[test]
fn studies_for_those_who_come_from_loops_and_searches_run() {
    let Some(python) = needs::python("argparse, json") else {
        return;
    };
    for page in ["coming-from-a-shell-loop.md", "coming-from-ray-tune.md"] {
        let (place, _) = Place::of_page(python, page);
        place.runs("rates.yaml");
        place.ok(&["new", "again", "--from", "python train.py --lr 0.1", "--yes"]);
        place.runs("again.yaml");
    }
}

#[test]
fn the_sweep_of_the_page_on_wandb_becomes_its_study() {
    let Some(python) = needs::python("argparse, json") else {
        return;
    };
    let (place, others) = Place::of_page(python, "coming-from-wandb.md");
    place.runs("rates.yaml");
    place.bench.write("sweep.yaml", &others[0]);
    place.ok(&["new", "again", "--from", "sweep.yaml", "--yes"]);
    place.runs("again.yaml");
    let read = |name: &str| fs::read_to_string(place.bench.path(name)).unwrap();
    let (mine, made) = (read("rates.yaml"), read("again.yaml"));
    for part in [
        "run: [python, train.py, \"--lr={lr}\", \"--steps={steps}\"",
        "{ log_uniform: { low: 0.001, high: 0.5 } }",
        "metric: loss",
        "direction: minimize",
        "settings: 8",
        "method: { random: {} }",
        "steps: 1000, evaluate_every: 100",
    ] {
        assert!(mine.contains(part) && made.contains(part), "{part}:\n{made}");
    }
}

#[test]
fn a_multirun_of_hydra_becomes_the_study_of_its_page() {
    let Some(python) = needs::python("hydra, stable_baselines3") else {
        return;
    };
    let (place, others) = Place::of_page(python, "coming-from-hydra.md");
    fs::create_dir(place.bench.path("conf")).unwrap();
    place.bench.write("conf/config.yaml", &others[0]);
    place.runs("rates.yaml");
    let multirun = "hydra:\n  overrides:\n    task: [\"lr=0.01,0.1\", \"seed=0,1,2,3,4\"]\n  job: { name: train, config_name: config }\n";
    place.bench.write("multirun.yaml", multirun);
    place.ok(&["new", "again", "--from", "multirun.yaml", "--yes"]);
    place.runs("again.yaml");
    let made = fs::read_to_string(place.bench.path("again.yaml")).unwrap();
    for part in [
        "run: [python, train.py, \"lr={lr}\", \"seed={seed}\", \"steps={steps}\"]",
        "mine.lr: { grid: [0.01, 0.1] }",
        "seeds: 5",
        "sources: [\"conf/**/*.yaml\", train.py]",
    ] {
        assert!(made.contains(part), "{part}:\n{made}");
    }
}

fn experiment(place: &Place, name: &str) {
    let path = repository().join("experiments/programs").join(name);
    let path = path.to_string_lossy();
    place.ok(&["check", &path]);
    place.ok(&["run", &path, "-P", "smoke", "--yes"]);
}

#[test]
fn the_bandit_in_awk_runs() {
    experiment(&Place::new("python3"), "bandit.yaml");
}

#[test]
fn the_command_of_the_zoo_of_stable_baselines3_runs_unchanged() {
    let Some(python) = needs::python("rl_zoo3, stable_baselines3, tensorboard") else {
        return;
    };
    let place = Place::new(python);
    experiment(&place, "zoo-cartpole.yaml");
    experiment(&place, "zoo-cartpole-rates.yaml");
}

#[test]
fn a_trainer_that_jax_compiles_runs_by_the_lines_of_its_tour() {
    let Some(python) = needs::python("rejax, jax") else {
        return;
    };
    experiment(&Place::new(python), "jax-cartpole.yaml");
}

#[test]
fn the_command_of_a_trainer_of_several_agents_runs_unchanged() {
    let Some(python) = needs::python("pymarlzooplus, torch") else {
        return;
    };
    experiment(&Place::new(python), "marl-speaker-listener.yaml");
}

#[test]
fn an_agent_of_stable_baselines3_is_measured_on_the_battery_beside_our_own() {
    let Some(python) = needs::python("regimen, stable_baselines3") else {
        return;
    };
    experiment(&Place::new(python), "sb3-battery.yaml");
}
