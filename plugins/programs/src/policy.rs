//! The policy that a program left as an ONNX file, evaluated by the engine.

use crate::agent::not_finite;
use contract::{Error, Seat, Space, first_largest};
use document::reach::Reach;
use imported::matching;
use numerics::onnx::{Graph, Network};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// The file of a policy in a trial's folder.
const FILE: &str = "policy.onnx";
/// Tolerance for the sum of shares, which are then scaled to sum to 1.
const SHARES_WITHIN: f64 = 1e-3;

/// A policy for one seat.
#[derive(Debug)]
pub struct Policy {
    network: Network,
    bytes: Vec<u8>,
    path: PathBuf,
    action: Space,
}

impl Policy {
    /// The only file in a folder that a pattern matches.
    ///
    /// # Errors
    /// [`Error::Input`] without a file or with several, and for a file that is not a policy of the seat.
    pub fn left(folder: &Path, pattern: &str, seat: &Seat) -> Result<Self, Error> {
        let found = matching(&Reach::of(folder), folder, pattern);
        let found = found.map_err(|error| Error::config("leaves.policy", error.to_string()))?;
        match &found[..] {
            [only] => Self::read(only, seat),
            [] => Err(wrong(Path::new(pattern), "the program left no such file".into())),
            several => {
                let name = |path: &PathBuf| path.strip_prefix(folder).unwrap_or(path).display().to_string();
                let names: Vec<String> = several.iter().map(name).collect();
                let problem = format!(
                    "a trial leaves one policy, and these are several: {}",
                    names.join(", ")
                );
                Err(wrong(Path::new(pattern), problem))
            }
        }
    }

    /// Reads the policy that [`leave`](Self::leave) wrote.
    ///
    /// # Errors
    /// The errors of [`left`](Self::left).
    pub fn taken_up(folder: &Path, seat: &Seat) -> Result<Self, Error> {
        Self::read(&folder.join(FILE), seat)
    }

    fn read(path: &Path, seat: &Seat) -> Result<Self, Error> {
        let bytes = fs::read(path).map_err(Error::file("read", path))?;
        let network = Network::read(&bytes).map_err(|error| wrong(path, error.to_string()))?;
        let n_seen = seat.observation.len();
        if let Some(width) = network.width().filter(|width| *width != n_seen) {
            let problem = format!("it takes {width} numbers, and the environment shows {n_seen}");
            return Err(wrong(path, problem));
        }
        let policy = Self {
            network,
            bytes,
            path: path.to_owned(),
            action: seat.action.clone(),
        };
        // A policy with wrong sizes is refused before anything is measured.
        let n_acted = policy.outputs(&vec![0.0; n_seen])?.len();
        if !entries(&seat.action).contains(&n_acted) {
            let expected: Vec<String> = entries(&seat.action).iter().map(usize::to_string).collect();
            let problem = format!(
                "it gives {n_acted} numbers, and an action has {}",
                expected.join(" or ")
            );
            return Err(wrong(path, problem));
        }
        Ok(policy)
    }

    /// A policy stub that returns zeros, for the rehearsal of `check`.
    pub fn stub(seat: &Seat) -> Vec<u8> {
        let (n_seen, n_acted) = (seat.observation.len(), seat.action.len());
        let (mut graph, observation) = Graph::of_observation(n_seen);
        let weights = graph.constant("weight", &[n_seen, n_acted], &vec![0.0; n_seen * n_acted]);
        let action = graph.node("MatMul", &[&observation, &weights], &[]);
        graph.acting(&action, n_acted).to_bytes(&[])
    }

    /// Writes a policy into a trial's folder.
    ///
    /// # Errors
    /// [`Error::File`] where the file cannot be written.
    pub fn leave(bytes: &[u8], folder: &Path) -> Result<(), Error> {
        let path = folder.join(FILE);
        fs::write(&path, bytes).map_err(Error::file("write", &path))
    }

    /// Content of the file.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The action at an observation: clamped to the limits of a box, shares that sum to 1, the best option of
    /// each choice.
    ///
    /// # Errors
    /// [`Error::Action`] for outputs that are not an action, [`Error::NotFinite`] at the number of `decisions` for one
    /// that is not a number, and [`Error::Input`] where the network cannot be evaluated.
    pub fn act(&self, observation: &[f64], decisions: u64) -> Result<Vec<f64>, Error> {
        let outputs = self.outputs(observation)?;
        if let Some(value) = outputs.iter().find(|value| value.is_nan()) {
            return Err(not_finite("the action of the policy", decisions, *value));
        }
        match &self.action {
            Space::Box(channels) => {
                let limited = |(value, it): (&f64, &contract::Channel)| value.max(it.low).min(it.high);
                Ok(outputs.iter().zip(channels).map(limited).collect())
            }
            Space::Simplex(_) => shares(&outputs),
            #[allow(clippy::cast_precision_loss, reason = "nobody names 2^52 options")]
            Space::Discrete(names) if outputs.len() == names.len() && names.len() > 1 => {
                Ok(vec![first_largest(&outputs) as f64])
            }
            Space::Choices(choices) if outputs.len() != choices.len() => Ok(outputs),
            space => space.asked(&outputs),
        }
    }

    fn outputs(&self, observation: &[f64]) -> Result<Vec<f64>, Error> {
        let found = self.network.run(observation);
        found.map_err(|error| wrong(&self.path, error.to_string()))
    }
}

/// The accepted numbers of entries of an action.
fn entries(space: &Space) -> Vec<usize> {
    match space {
        Space::Discrete(names) => vec![1, names.len()],
        Space::Choices(choices) => vec![choices.len(), space.len()],
        space => vec![space.len()],
    }
}

/// Shares in single precision sum to 1 approximately.
fn shares(outputs: &[f64]) -> Result<Vec<f64>, Error> {
    let positive: Vec<f64> = outputs.iter().map(|share| share.max(0.0)).collect();
    let total: f64 = positive.iter().sum();
    if (total - 1.0).abs() <= SHARES_WITHIN {
        return Ok(positive.iter().map(|share| share / total).collect());
    }
    let problem = format!("shares sum to {total}: let the policy end with a softmax");
    Err(Error::Action { problem })
}

fn wrong(path: &Path, problem: String) -> Error {
    Error::Input {
        path: path.into(),
        line: None,
        column: None,
        problem,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::{Channel, Choice};

    fn seat(action: Space) -> Seat {
        Seat {
            name: String::new(),
            observation: Space::Box(vec![Channel::new("a", ""), Channel::new("b", "")]),
            action,
        }
    }

    fn names(count: usize) -> Vec<String> {
        (0..count).map(|at| at.to_string()).collect()
    }

    /// A file whose outputs at `[0, 0]` are these numbers, to which the sum of the observation is added.
    fn giving(numbers: &[f32], inputs: usize) -> Vec<u8> {
        let (mut graph, observation) = Graph::of_observation(inputs);
        let (n, weight) = (numbers.len(), vec![1.0; inputs * numbers.len()]);
        let weight = graph.constant("weight", &[inputs, n], &weight);
        let bias = graph.constant("bias", &[n], numbers);
        let action = graph.node("Gemm", &[&observation, &weight, &bias], &[]);
        graph.acting(&action, n).to_bytes(&[])
    }

    fn acted(numbers: &[f32], action: Space, observation: [f64; 2]) -> Result<Vec<f64>, String> {
        let folder = tempfile::tempdir().unwrap();
        Policy::leave(&giving(numbers, 2), folder.path()).unwrap();
        let policy = Policy::taken_up(folder.path(), &seat(action)).map_err(|error| error.to_string())?;
        policy.act(&observation, 7).map_err(|error| error.to_string())
    }

    #[test]
    fn actions_lie_in_their_space() {
        let channel = |low, high| Channel {
            low,
            high,
            ..Channel::new("x", "")
        };
        let limited = Space::Box(vec![channel(-1.0, 1.0), channel(f64::NEG_INFINITY, 2.0)]);
        assert_eq!(
            acted(&[0.5, -7.0], limited.clone(), [1.0, 1.0]).unwrap(),
            [1.0, -5.0]
        );
        let simplex = Space::Simplex(names(2));
        assert_eq!(
            acted(&[1.0, -1e-9], simplex.clone(), [0.0, 0.0]).unwrap(),
            [1.0, 0.0]
        );
        assert!(
            acted(&[1.0, 1.0], simplex, [0.0, 0.0])
                .unwrap_err()
                .contains("end with a softmax")
        );
        let discrete = Space::Discrete(names(3));
        assert_eq!(
            acted(&[0.1, 0.3, 0.3], discrete.clone(), [0.0, 0.0]).unwrap(),
            [1.0]
        );
        assert_eq!(acted(&[0.0], discrete, [1.0, 1.0]).unwrap(), [2.0]);
        let choices = Space::Choices(vec![
            Choice::new("c", &["x", "y"]),
            Choice::new("d", &["x", "y", "z"]),
        ]);
        assert_eq!(
            acted(&[1.0, 2.0], choices.clone(), [0.0, 0.0]).unwrap(),
            [-1.0, 1.0, -1.0, -1.0, 1.0]
        );
        assert_eq!(acted(&[0.5; 5], choices, [0.0, 0.0]).unwrap(), [0.5; 5]);
        // A limit of the box would hide it.
        assert_eq!(
            acted(&[f32::NAN, 0.0], limited.clone(), [0.0, 0.0]).unwrap_err(),
            "the action of the policy (counted in its decisions) is not finite at step 7: NaN"
        );
        assert!(
            acted(&[1.0; 3], limited, [0.0, 0.0])
                .unwrap_err()
                .contains("gives 3 numbers, and an action has 2")
        );
    }

    #[test]
    fn a_trial_leaves_one_policy_for_its_environment() {
        let folder = tempfile::tempdir().unwrap();
        let seat = seat(Space::Simplex(names(2)));
        let told = || {
            Policy::left(folder.path(), "runs/*.onnx", &seat)
                .unwrap_err()
                .to_string()
        };
        assert!(told().contains("left no such file"), "{}", told());
        fs::create_dir(folder.path().join("runs")).unwrap();
        let write =
            |name: &str, bytes: &[u8]| fs::write(folder.path().join("runs").join(name), bytes).unwrap();
        write("a.onnx", b"no model");
        assert!(told().contains("it is no ONNX model"), "{}", told());
        write("a.onnx", &giving(&[0.0; 2], 3));
        assert!(
            told().contains("takes 3 numbers, and the environment shows 2"),
            "{}",
            told()
        );
        write("b.onnx", b"");
        assert!(told().contains("several: runs/a.onnx, runs/b.onnx"), "{}", told());
    }

    #[test]
    fn a_stub_fits_its_seat() {
        let folder = tempfile::tempdir().unwrap();
        let seat = seat(Space::Discrete(names(3)));
        Policy::leave(&Policy::stub(&seat), folder.path()).unwrap();
        assert_eq!(
            Policy::taken_up(folder.path(), &seat)
                .unwrap()
                .act(&[1.0, 2.0], 1)
                .unwrap(),
            [0.0]
        );
    }
}
