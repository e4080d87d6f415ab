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
/// Largest difference, in parts of the scale. Held against the same graphs in `float64`, this program and onnxruntime are
/// both off by up to 4.7e-6 where inputs are divided by small deviations, but nearly alike.
const TOLERANCE: f64 = 2e-6;
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
        for (row, action) in rows.iter().zip(&actions) {
            let found = network.run(row).unwrap();
            let is_near = found.len() == action.len()
                && found
                    .iter()
                    .zip(action)
                    .all(|(a, b)| (a - b).abs() <= TOLERANCE * scale);
            assert!(
                is_near,
                "{name} at {row:?}: {found:?} is read back, {action:?} is computed here"
            );
        }
        let case =
            json!({ "observations": rows, "actions": actions, "scale": scale, "tolerance": TOLERANCE });
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
