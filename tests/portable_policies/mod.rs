//! Policies that are taken away act as they do here: ONNX files are computed by two runtimes of other people, `tract`
//! and onnxruntime, and by this program that reads them back, and held against its own evaluation.

mod agents;
mod heads;
mod stored;

use crate::{
    datasets, needs,
    other_programs::check,
    program::{Bench, reseal, trial_files},
};
use contract::{
    Agent, ArtifactKind, Environment, Mode, NoKeeper, Observation, Registry,
    artifact::Taken,
    policy_form::PortablePolicy,
    random::{Streams, stream},
    trial::TrialKey,
};
use numerics::{
    activation::Activation,
    onnx::{Graph, Network},
    policy_file::{Head, Policy, Ports},
};
use plugins::registry;
use rand::Rng as _;
use serde_json::{Value, json};
use session::rollout::trained_agent;
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    process::Command,
};

const HEADS: [Head; 6] = [
    Head::DirichletMean,
    Head::DirichletMode,
    Head::SoftmaxMean,
    Head::Tanh,
    Head::Argmax,
    Head::Identity,
];
/// Largest difference, in parts of the scale, beside what the last bit of each observation is worth. Held against the same
/// graphs in `float64`, this program and onnxruntime are each off by up to 1.34e-6, so that two orders of adding may
/// differ by twice that. Where a policy divides by a small deviation of what it saw, single precision itself is further
/// off: by 4.7e-6 in this program, onnxruntime and NumPy alike.
const TOLERANCE: f64 = 2.7e-6;
/// Rows that are computed at once.
const ROWS: usize = 64;

/// ONNX files, each with what it must compute.
struct Cases(tempfile::TempDir);

impl Cases {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// Keeps a file with rows of observations and what `own` makes of each; the scale is that of the largest
    /// entry, 1 at least.
    fn add(&self, name: &str, onnx: &[u8], rows: &[Vec<f64>], own: impl Fn(&[f64]) -> Vec<f64>) {
        let actions: Vec<Vec<f64>> = rows.iter().map(|row| own(row)).collect();
        let entries = actions.iter().flatten();
        let scale = entries.fold(1.0, |largest: f64, entry| largest.max(entry.abs()));
        let network = Network::read(onnx).unwrap_or_else(|error| panic!("{name}: {error}"));
        let mut tolerance = TOLERANCE;
        for (row, action) in rows.iter().zip(&actions) {
            let found = network.run(row).unwrap();
            let difference = largest_difference(&found, action) / scale;
            if difference <= TOLERANCE {
                continue;
            }
            tolerance = tolerance.max(TOLERANCE + worth_of_last_bits(&network, row) / scale);
            assert!(
                difference <= tolerance,
                "{name} at {row:?}: {found:?} is read back, {action:?} is computed here"
            );
        }
        let case =
            json!({ "observations": rows, "actions": actions, "scale": scale, "tolerance": tolerance });
        fs::write(self.0.path().join(format!("{name}.onnx")), onnx).unwrap();
        fs::write(self.0.path().join(format!("{name}.json")), case.to_string()).unwrap();
    }

    fn add_policy(&self, name: &str, policy: &Policy, rows: &[Vec<f64>]) {
        let graph = policy.graph().unwrap();
        self.add(name, &graph.to_bytes(&[]), rows, |row| policy.act(row));
    }

    fn hold(&self) {
        let folder = self.0.path().to_string_lossy().into_owned();
        check(
            "run_policies.py",
            "onnx, onnxruntime",
            std::slice::from_ref(&folder),
        );
        run_with_tract(&folder);
    }
}

fn run_with_tract(folder: &str) {
    let Some(program) = needs::tract() else { return };
    let output = Command::new(program).arg(folder).output().unwrap();
    let texts = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert!(output.status.success(), "{texts:?}");
}

/// How far an action moves when the last bit of each observation does, all in the worst direction.
fn worth_of_last_bits(network: &Network, row: &[f64]) -> f64 {
    let found = network.run(row).unwrap();
    let worth = |at: usize| {
        let mut moved = row.to_vec();
        moved[at] *= 1.0 + f64::from(f32::EPSILON);
        largest_difference(&network.run(&moved).unwrap(), &found)
    };
    (0..row.len()).map(worth).sum()
}

fn largest_difference(one: &[f64], other: &[f64]) -> f64 {
    assert_eq!(one.len(), other.len());
    let differences = one.iter().zip(other).map(|(a, b)| (a - b).abs());
    differences.fold(
        0.0,
        |largest, it| if it > largest || it.is_nan() { it } else { largest },
    )
}

/// A number that single precision holds.
fn single(x: f64) -> f64 {
    f64::from(x as f32)
}

fn around(center: &[f64], spread: &[f64], rng: &mut contract::Rng) -> Vec<Vec<f64>> {
    let mut near =
        |(center, spread): (&f64, &f64)| single(center + spread.min(1e3) * rng.random_range(-2.0..2.0));
    (0..ROWS)
        .map(|_| center.iter().zip(spread).map(&mut near).collect())
        .collect()
}
